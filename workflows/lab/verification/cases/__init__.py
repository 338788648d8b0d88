"""The verification problems, each a scene, its check and its source."""
