"""The block system as one nested PETSc matrix, [[F', B^T], [B, -C]], with splits `u` and `lambda` by name.

Any PETSc fieldsplit applies to it from options, as `-pc_type fieldsplit -fieldsplit_u_pc_type gamg`; `-ksp_view` shows
the splits.

Source: Pop (1999), (1.1), (5.3): C = -K_C.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.arrays import EXACT
from stickslip.geometry.protocols import KSP, Mat, Vec
from stickslip.solvers.linear.inner_solver import direct, mumps_options
from stickslip.solvers.linear.petsc_options import PetscOptions

PREFIX = "block_"  # of PETSc's options; solver.petsc_options are without it
SPLITS = ("", "fieldsplit_u_", "fieldsplit_lambda_")  # prefixes, after that one, of the nest's solvers


def nested(V: Mat, B_T: Mat, B: Mat, minus_C: Mat) -> Mat:
    """[[V, B^T], [B, -C]] as a MATNEST (PETSc); V: (n, n), B^T: (n, m), B: (m, n), -C: (m, m)."""
    nest: Mat = PETSc.Mat().createNest([[V, B_T], [B, minus_C]], comm=V.comm)
    nest.assemble()
    return nest


def solve(nest: Mat, right: tuple[Vec, Vec], found: tuple[Vec, Vec], options: PetscOptions) -> KSP:
    """Solve nest (u, p) = (f, g) by a sparse LU factor, or as PETSc's options with PREFIX say; returns the KSP.

    A preconditioner alone (`pc_type` without `ksp_type`) is used inside flexible GMRES.

    Args:
        nest: its splits are `u` and `lambda`.
        right: f and g.
        found: u and p, the start of an iterative solve, then the solution.
        options: of the user.
    """
    ksp: KSP = PETSc.KSP().create(nest.comm)
    ksp.setOptionsPrefix(PREFIX)
    ksp.setOperators(nest)
    ksp.setType("preonly")
    pc = ksp.getPC()
    pc.setType("lu")
    pc.setFactorSolverType("mumps")
    ksp.setTolerances(rtol=EXACT)  # relative residual at which an iterative solve of the nest stops
    splits, _ = nest.getNestISs()
    with options.in_force(mumps_options(PREFIX)):
        ksp.setFromOptions()
        if ksp.getType() == "preonly" and not direct(ksp):
            ksp.setType("fgmres")
        whole = nest if pc.getType() == "fieldsplit" else nest.convert("aij", PETSc.Mat())  # factors need one piece
        ksp.setOperators(whole)
        if pc.getType() == "fieldsplit":
            pc.setFieldSplitIS(("u", splits[0]), ("lambda", splits[1]))
        ksp.setInitialGuessNonzero(not direct(ksp))
        b, x = whole.createVecLeft(), whole.createVecRight()
        for split, given, start in zip(splits, right, found, strict=True):
            _copy(given, b, split)
            _copy(start, x, split)
        ksp.solve(b, x)
    for split, part in zip(splits, found, strict=True):
        solved = x.getSubVector(split)
        solved.copy(part)
        x.restoreSubVector(split, solved)
    return ksp


def backward_error(nest: Mat, right: tuple[Vec, Vec], found: tuple[Vec, Vec]) -> float:
    """Largest |b - A x| / (|A| |x| + |b|) of the two rows of blocks, each in the maximum norm [-]."""
    largest, worst = PETSc.NormType.INFINITY, 0.0
    for row, given in enumerate(right):
        left, scale = given.copy(), given.norm(largest)
        for column, part in enumerate(found):
            block = nest.getNestSubMatrix(row, column)
            left -= block * part
            scale += block.norm(largest) * part.norm(largest)
        worst = max(worst, left.norm(largest) / scale if scale else 0.0)
        if not np.isfinite(worst):
            return float("inf")
    return worst


def _copy(part: Vec, whole: Vec, split: Any) -> None:
    """Copy a vector into its split of a whole one."""
    there = whole.getSubVector(split)
    part.copy(there)
    whole.restoreSubVector(split, there)
