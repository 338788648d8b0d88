"""How far off a result is: errors of the mesh and of the time steps, quantity by quantity."""
