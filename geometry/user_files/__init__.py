"""Geometry from a user's own file; gmsh reads it in a process of its own, which a damaged file may bring down."""
