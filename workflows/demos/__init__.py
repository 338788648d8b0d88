"""Programs to read from top to bottom: the method in plain gmsh, UFL, dolfinx and PETSc."""
