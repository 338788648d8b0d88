"""The command line `stickslip`, and what it prints."""
