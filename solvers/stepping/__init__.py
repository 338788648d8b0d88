"""Load steps: which method, from which state, and what happens when one fails."""
