"""One run: solve, write, resume, report doubts."""
