"""The scene: frozen data that refuse invalid values, and what is derived from them without a mesh."""
