"""The published methods, measured: what the paper claims, and whether it holds."""
