"""One run: solve, write, resume, warn."""
