"""The assembled system: stiffness, loads, contact rows; all data that do not depend on the tractions."""
