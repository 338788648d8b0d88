"""Linear algebra that knows no contact: conjugate gradients, multigrid, Cholesky factors, GMRES."""
