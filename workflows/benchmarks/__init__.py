"""Timed runs: search, histories, the price of every method, adaptive rounds, scaling, discrete problems beside Siconos."""
