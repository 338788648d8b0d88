"""From nouns (material, support, load, contact) to displacement and contact traction, step by step."""
