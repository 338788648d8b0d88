"""Versions of the packages that the numbers of a run depend on, as Debian and PyPI name them."""

from __future__ import annotations

import re
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

DPKG = Path("/var/lib/dpkg/status")
DEBIAN = re.compile(  # the rest of a name is the version of the library's interface
    r"lib(dolfinx-real|petsc-real|slepc-real|mumps-|hypre-|gmsh|occt-modeling-algorithms-|openblas0-pthread|openmpi|"
    r"hdf5-openmpi-|seccomp)[0-9.t-]*|python3-(dolfinx-real|ffcx|ufl|gmsh|petsc4py-real|scipy|h5py-mpi|seccomp)"
)
PYPI = ("numpy", "pydantic")
WHEEL = "dolfinx-solver-real"  # PETSc, SLEPc, MUMPS, OpenBLAS and HDF5 are in it
BESIDE_WHEEL = ("fenics-ffcx", "fenics-ufl", "gmsh", "h5py", "mpi4py", "mpich", "scipy")


@cache
def packages() -> dict[str, str]:
    """Version of each package by name: PyPI's alone where dolfinx is a wheel, else Debian's too where there is dpkg."""
    found = _of_pypi(*PYPI, WHEEL)
    if WHEEL in found:
        return dict(sorted((found | _of_pypi(*BESIDE_WHEEL)).items()))
    try:
        text = DPKG.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return found
    for entry in text.split("\n\n"):
        fields = dict(re.findall(r"^(Package|Status|Version): (.*)$", entry, re.MULTILINE))
        if DEBIAN.fullmatch(fields.get("Package", "")) and fields.get("Status", "").endswith(" installed"):
            found[fields["Package"]] = fields["Version"]
    return dict(sorted(found.items()))


def _of_pypi(*names: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for name in names:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found
