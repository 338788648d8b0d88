"""Verification problems with closed forms or published figures, each run by the tests and by `stickslip verify`."""
