"""Contact rows: nodal displacements to relative displacement at contact points, and the admissible set of tractions."""
