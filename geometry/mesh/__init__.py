"""The mesh: a gmsh model becomes a distributed mesh with named bodies and sides; nodes, quality, .msh files."""
