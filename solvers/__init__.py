"""From a scene to displacement and contact tractions, step by step."""
