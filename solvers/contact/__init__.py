"""Contact operators: rows from nodal to relative displacement, and the admissible set of tractions."""
