"""The bodies reduced to the contact surface: Delassus (Steklov-Poincaré) operator, Schur complement, limit analysis."""
