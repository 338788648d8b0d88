"""Timed runs: histories, prices of methods and of other programs, adaptive rounds, scaling, Siconos."""
