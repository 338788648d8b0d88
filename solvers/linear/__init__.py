"""Linear algebra without contact: conjugate gradients, multigrid, Cholesky factors, GMRES."""
