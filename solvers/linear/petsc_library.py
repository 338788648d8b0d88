"""Functions of the PETSc library that petsc4py does not wrap."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache

from stickslip.geometry.errors import MachineError


@cache
def petsc_library() -> ctypes.CDLL:
    """The PETSc library that petsc4py has loaded."""
    with open("/proc/self/maps") as maps:
        return ctypes.CDLL(next(line.split()[-1] for line in maps if "libpetsc" in line))


def call(function: Callable[..., int], *handles: int) -> None:
    """Call a function of the PETSc library with the handles of PETSc objects.

    Raises:
        MachineError: it returns an error.
    """
    code = function(*(ctypes.c_void_p(handle) for handle in handles))
    if code:
        raise MachineError(f"PETSc error {code} in {function.__name__}")


def option_used(name: str) -> bool:
    """Whether PETSc has asked for an option (without the leading dash) since it was set."""
    used = ctypes.c_int(0)
    code = petsc_library().PetscOptionsUsed(None, name.encode(), ctypes.byref(used))
    if code:
        raise MachineError(f"PETSc error {code} in PetscOptionsUsed")
    return bool(used.value)
