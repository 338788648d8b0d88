"""The sides that contacts name, each once, and the map from contact dofs to the displacement of their nodes."""

from __future__ import annotations

from collections.abc import Iterator

from stickslip.geometry.protocols import Sparse
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.system.system import System


def contact_sides(system: System) -> Iterator[tuple[str, Surface, Sparse]]:
    """Name, surface, and the sparse matrix (n d, c) from contact dofs to the displacement of the side's nodes."""
    seen = set[str]()
    for rows in system.contacts:
        pair, trace, first = system.problem.pairs[rows.name], system.interface.trace(rows), 0
        for name, side in ((pair.slave, rows.surface), (pair.master, rows.master)):
            if side is not None and name is not None:
                last = first + side.dim * len(side.nodes)
                if name not in seen:
                    yield name, side, trace[first:last]
                seen.add(name)
                first = last
