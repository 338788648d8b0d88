"""Sides of bodies as surfaces: contact search, overlap of two surfaces, their mass and stiffness."""
