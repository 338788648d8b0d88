"""Other programs on the meshes of the price benchmark: seconds, memory, and errors of the forces."""
