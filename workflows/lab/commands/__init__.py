"""Commands of the lab: verification problems, and the suites hard, accuracy and effects."""
