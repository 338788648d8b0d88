"""The block system as one nested PETSc matrix, [[F', B^T], [B, -C]], with splits `u` and `lambda` by name.

Any PETSc fieldsplit applies to it from options, as `-fieldsplit_u_pc_type gamg`; `-ksp_view` shows the splits.

Source: Pop (1999), (1.1), (5.3): C = -K_C.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from typing import Any

import numpy as np
from petsc4py import PETSc

from geometry.errors import SceneError
from geometry.protocols import KSP, Mat, Vec
from solvers.linear.inner_solver import mumps_workspace
from solvers.linear.petsc_library import option_used

RTOL = 1e-12  # relative residual at which an iterative solve of the nest stops
PREFIX = "block_"  # of PETSc's options; solver.petsc_options are without it


def nested(V: Mat, B: Mat, C: Mat) -> Mat:
    """[[V, B^T], [B, -C]] as a MATNEST (PETSc); V: (n, n), B: (m, n), C: (m, m)."""
    minus_C = C.copy()
    minus_C.scale(-1.0)
    transposed = PETSc.Mat()
    B.transpose(transposed)
    nest: Mat = PETSc.Mat().createNest([[V, transposed], [B, minus_C]], comm=V.comm)
    nest.assemble()
    return nest


def solve(nest: Mat, f: Vec, g: Vec, u: Vec, p: Vec) -> KSP:
    """Solve nest (u, p) = (f, g) by a sparse LU factor, or as PETSc's options with PREFIX say; returns the KSP.

    The splits are `u` and `lambda`; u and p are the start of an iterative solve, then the solution.
    """
    ksp: KSP = PETSc.KSP().create(nest.comm)
    ksp.setOptionsPrefix(PREFIX)
    ksp.setOperators(nest)
    ksp.setType("preonly")
    pc = ksp.getPC()
    pc.setType("lu")
    pc.setFactorSolverType("mumps")
    ksp.setTolerances(rtol=RTOL)
    ksp.setFromOptions()
    (of_u, of_lambda), _ = nest.getNestISs()
    mumps_workspace(pc)
    whole = nest if pc.getType() == "fieldsplit" else nest.convert("aij", PETSc.Mat())  # factors need it in one piece
    ksp.setOperators(whole)
    if pc.getType() == "fieldsplit":
        pc.setFieldSplitIS(("u", of_u), ("lambda", of_lambda))
    ksp.setInitialGuessNonzero(ksp.getType() != "preonly")
    right, found = whole.createVecLeft(), whole.createVecRight()
    for split, given, start in ((of_u, f, u), (of_lambda, g, p)):
        _copy(given, right, split)
        _copy(start, found, split)
    ksp.solve(right, found)
    for split, part in ((of_u, u), (of_lambda, p)):
        of_found = found.getSubVector(split)
        of_found.copy(part)
        found.restoreSubVector(split, of_found)
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


def use_options(text: str) -> None:
    """Give PETSc the options, with PREFIX; those of an earlier call are forgotten."""
    known = PETSc.Options()
    for name in _used:
        known.delValue(name)
    _used.clear()
    _named.clear()
    for name, value in options_of(text):
        known.setValue(name, value)
        _used.append(name)


def unused_options() -> list[str]:
    """The options of `use_options` that PETSc has not asked for, as the user wrote them; each is named only once."""
    found = [name for name in _used if name not in _named and not option_used(name)]
    _named.update(found)
    return [f"-{name.removeprefix(PREFIX)}" for name in found]


_used: list[str] = []  # names that `use_options` has set
_named: set[str] = set()  # those of them that `unused_options` has returned


def options_of(text: str) -> Iterator[tuple[str, str | None]]:
    """Names (with PREFIX) and values of PETSc options as one writes them on a command line.

    Raises:
        SceneError: a word is no option and no value of one.

    >>> list(options_of("-ksp_view -fieldsplit_u_ksp_rtol 1e-10"))
    [('block_ksp_view', None), ('block_fieldsplit_u_ksp_rtol', '1e-10')]
    """
    words = shlex.split(text)
    while words:
        name = words.pop(0)
        if not (name.startswith("-") and name[1:2].isalpha()):
            raise SceneError(f"petsc_options = {name}: is not an option; write for example -fieldsplit_u_pc_type gamg")
        value = words.pop(0) if words and not (words[0].startswith("-") and words[0][1:2].isalpha()) else None
        yield PREFIX + name[1:], value
