"""The scene: frozen data that refuse invalid values, and what follows from them before any mesh."""
