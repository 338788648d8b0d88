"""Condition numbers with Gram preconditioners: `python -m stickslip.workflows.lab.studies.gram [N ...]` prints a table.

The block of the ready scene, 4 x 2 m, n cells high, all of its base closed and sticking: condition number of
Q^-1 B K_B^-1 B^T on forces, and the entries of the factor P beside those of the matrix's own lower triangle.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI
from rich.console import Console
from rich.table import Table
from scipy import sparse

from stickslip import Counters, Gram, Scene
from stickslip.geometry.arrays import Array
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.solvers.classical.gram_uzawa import GramMetric, contact_last, drop_of, incomplete_cholesky, volume_gram
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.prepare import prepare_surface
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.system.system import System, assemble
from stickslip.workflows.scene_file.read import from_dict

SIZES = (8, 16, 32)
METRE = Gram(length=1.0)  # the source has no length in its product
READINGS = {
    "multiplier": replace(METRE, space="multiplier"),
    "volume, complete": METRE,
    "volume, drop 1e-3": replace(METRE, factor="drop", drop=1e-3),
    "volume, drop 1e-2": replace(METRE, factor="drop", drop=1e-2),
    "volume, IC(0)": replace(METRE, factor="ic0"),
}


@dataclass(frozen=True)
class Row:
    """One choice of Q at one mesh size."""

    n: int
    reading: str
    spectrum: Array  # increasing
    fill: float | None  # None: nothing is factorised, or only the surface

    @property
    def condition(self) -> float:
        """Largest over smallest eigenvalue."""
        return float(self.spectrum[-1] / self.spectrum[0])


def scene(n: int, held: bool = True, dim: int = 2) -> Scene:
    """The block, n cells high; 4 x 2 x 2 m in 3D."""
    last, zero = "xyz"[dim - 1], [0.0] * dim
    size = {"length": 4.0, "height": 2.0, "mesh_size": 2.0 / n} | ({"width": 2.0} if dim == 3 else {})
    top = {"boundary": "block.top", "displacement": dict.fromkeys("xyz"[:dim], 0.0)}
    normal = [float(axis == last) for axis in "xyz"[:dim]]
    return from_dict(
        {
            "model": "plane strain" if dim == 2 else "3d",
            "geometry": {"builder": "block"} | size,
            "bodies": {"block": {"E": 1.0, "nu": 0.3}},
            "obstacles": {"foundation": {"shape": "plane", "point": zero, "normal": normal}},
            "contacts": {"base": {"surface": "block.bottom", "against": "foundation", "friction": {"law": "stick"}}},
            "supports": {"top": top} if held else {},
        }
    )


def block(n: int, held: bool = True, dim: int = 2) -> System:
    """Meshed and assembled; without its support the Gram matrix is that of all displacements."""
    found = scene(n, held, dim)
    return assemble(resolve(found), build_mesh(found.geometry, found.request(), MPI.COMM_SELF), Counters())


def surface_of(system: System) -> tuple[CondensedSurface, AdmissibleSet]:
    """K_B^-1 on the contact dofs, and the laws that say which rows carry tractions."""
    volume = FactorisedVolume(system.K_B, system.interface.dofs, system.counters)
    return prepare_surface(system, volume), AdmissibleSet(system.contacts, 0.0, system.problem.timeline.end)


def fill(system: System, gram: Gram) -> float:
    """Number of entries of P over that of IC(0)."""
    matrix, _ = contact_last(volume_gram(system, gram.length or system.extent), system.interface.dofs)
    return float(incomplete_cholesky(matrix, drop_of(gram)).P.nnz / sparse.tril(matrix).nnz)


def rows(n: int, dim: int = 2) -> Iterator[Row]:
    """All choices of Q at one mesh size."""
    system = block(n, dim=dim)
    surface, cone = surface_of(system)
    carried = surface.flexibility.between(surface.N, surface.N.T.tocsr())
    yield Row(n, "none", np.linalg.eigvalsh(carried), None)
    for reading, gram in READINGS.items():
        values = GramMetric(system, gram).spectrum(surface, cone)
        yield Row(n, reading, values, fill(system, gram) if gram.space == "volume" else None)
    values = GramMetric(block(n, held=False, dim=dim), METRE).spectrum(surface, cone)
    yield Row(n, "volume, complete, supports left out", values, None)


def table(sizes: tuple[int, ...] = SIZES) -> Table:
    """One column of condition numbers for each mesh size, with the fill in brackets."""
    found = {n: list(rows(n)) for n in sizes}
    drawn = Table("Q", *(f"n = {n}" for n in sizes), title="condition number of Q^-1 B K_B^-1 B^T (fill)")
    for line in zip(*found.values(), strict=True):
        drawn.add_row(line[0].reading, *(f"{r.condition:.4g}{f' ({r.fill:.2f})' if r.fill else ''}" for r in line))
    return drawn


if __name__ == "__main__":
    Console().print(table(tuple(int(n) for n in sys.argv[1:]) or SIZES))
