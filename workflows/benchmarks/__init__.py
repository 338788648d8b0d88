"""Timed runs: search, histories, prices of all methods, adaptive rounds, scaling, problems beside Siconos."""
