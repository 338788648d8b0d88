"""Timed runs: contact search, long histories, the price of every method, adaptive rounds, discrete problems beside Siconos."""
