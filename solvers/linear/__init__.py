"""Linear solvers that know nothing of contact: conjugate gradients, multigrid, Cholesky factors."""
