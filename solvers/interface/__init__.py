"""The bodies as contact sees them: Schur complement, Delassus (Steklov-Poincaré) operator, limit analysis."""
