"""Timed runs: search, long histories, the price of every method, adaptive rounds, discrete problems beside Siconos."""
