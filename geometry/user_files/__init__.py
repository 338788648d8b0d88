"""Geometry from a user's file; gmsh reads it in a separate process, which a damaged file may crash."""
