"""Timed runs: contact search, long histories, the price of every method, discrete problems beside Siconos."""
