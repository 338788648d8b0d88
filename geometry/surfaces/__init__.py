"""Sides of bodies as surfaces: contact search, overlap of two surfaces, mass and stiffness."""
