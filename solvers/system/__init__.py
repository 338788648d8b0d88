"""The assembled system: stiffness, loads, contact rows; all that does not depend on the tractions."""
