"""The published methods, measured: what the source claims, and whether it holds."""
