"""Scene files: TOML to a scene and back, and whether two scenes are the same."""
