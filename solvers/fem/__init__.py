"""Finite elements: weak forms in UFL, constraints, supports, rigid modes."""
