"""From the accuracy that is asked for to the mesh and the time steps that reach it, round by round."""
