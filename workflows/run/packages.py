"""Versions of the packages that the numbers of a run depend on, as Debian and PyPI name them."""

from __future__ import annotations

import re
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

DPKG = Path("/var/lib/dpkg/status")
DEBIAN = re.compile(  # the rest of a name is the version of the library's interface
    r"lib(dolfinx-real|petsc-real|slepc-real|mumps-|hypre-|gmsh|occt-modeling-algorithms-|openblas0-pthread|openmpi|"
    r"hdf5-openmpi-|seccomp)[0-9.t-]*|python3-(dolfinx-real|ffcx|ufl|gmsh|petsc4py-real|scipy|h5py-mpi|seccomp)"
)
PYPI = ("numpy", "pydantic")


@cache
def packages() -> dict[str, str]:
    """Version of each package by name; without Debian's on a machine that has no dpkg."""
    found: dict[str, str] = {}
    for name in PYPI:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    try:
        text = DPKG.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return found
    for entry in text.split("\n\n"):
        fields = dict(re.findall(r"^(Package|Status|Version): (.*)$", entry, re.MULTILINE))
        if DEBIAN.fullmatch(fields.get("Package", "")) and fields.get("Status", "").endswith(" installed"):
            found[fields["Package"]] = fields["Version"]
    return dict(sorted(found.items()))
