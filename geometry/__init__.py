"""From the description of a shape to a distributed mesh whose bodies and sides have names."""

import os

# Signals end the process or raise an error, as Python has it: PETSc, once it is imported, would print a page and end
# all ranks.
os.environ["PETSC_OPTIONS"] = f"{os.environ.get('PETSC_OPTIONS', '')} -no_signal_handler".strip()
