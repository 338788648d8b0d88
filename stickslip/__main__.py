"""`python -m stickslip`: the command line."""

from stickslip.workflows.commands.start import main

main()
