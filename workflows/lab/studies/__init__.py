"""Short scripts to copy and change, and studies of the methods."""
