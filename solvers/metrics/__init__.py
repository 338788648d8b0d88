"""Metrics of the contact surface: what bodies give there, guessed, learnt or published."""
