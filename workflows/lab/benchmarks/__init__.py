"""Timed runs: search, histories, prices of methods and of other programs, adaptive rounds, scaling, Siconos."""
