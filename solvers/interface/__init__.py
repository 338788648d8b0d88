"""The bodies as contact feels them: Schur complement, Delassus (Steklov-Poincaré) operator, limit analysis."""
