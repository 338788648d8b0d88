"""How long the parts take that have to be fast."""
