"""Weak forms in UFL, supports and rigid modes: what finite elements make of bodies."""
