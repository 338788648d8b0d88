"""The block system as one nested PETSc matrix, [[F', B^T], [B, -C]], with splits `u` and `lambda` by name.

Any PETSc fieldsplit applies to it from options, as `-fieldsplit_u_pc_type gamg`; `-ksp_view` shows the splits.

Source: Pop (1999), (1.1), (5.3): C = -K_C.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from petsc4py import PETSc

from geometry.errors import SceneError
from geometry.protocols import KSP, Mat, Vec

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


def nested_vector(u: Vec, p: Vec) -> Vec:
    """The vector (u, p) of the nest."""
    found: Vec = PETSc.Vec().createNest([u, p], comm=u.comm)
    return found


def solver_of(nest: Mat) -> KSP:
    """A KSP of the nest with fieldsplit, splits `u` and `lambda`; PETSc's options with PREFIX change it."""
    ksp: KSP = PETSc.KSP().create(nest.comm)
    ksp.setOptionsPrefix(PREFIX)
    ksp.setOperators(nest)
    ksp.setType("fgmres")
    pc = ksp.getPC()
    pc.setType("fieldsplit")
    (of_u, of_lambda), _ = nest.getNestISs()
    pc.setFieldSplitIS(("u", of_u), ("lambda", of_lambda))
    ksp.setFromOptions()
    return ksp


def use_options(text: str) -> None:
    """Give PETSc the options, with PREFIX; those of an earlier call are forgotten."""
    known = PETSc.Options()
    for name in _used:
        known.delValue(name)
    _used.clear()
    for name, value in options_of(text):
        known.setValue(name, value)
        _used.append(name)


_used: list[str] = []  # names that `use_options` has set


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
