"""The command `stickslip sweep`: one scene with many values, over processes or ranks, as a table."""
