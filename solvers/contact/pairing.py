"""Contact operators by name, and contact rows of all pairs: obstacles by their shape, bodies by a search."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import CLOSE, Array
from stickslip.geometry.errors import SceneError
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.build import build_rows
from stickslip.solvers.contact.coupling import Coupling, nodal_coupling, rigid_coupling
from stickslip.solvers.contact.edges import with_edges
from stickslip.solvers.contact.mortar import mortar_coupling
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.fem.constraints import Constraints
from stickslip.solvers.scene.problem import Problem

Operator = Callable[[Surface, Surface, float], Coupling]  # slave, master, reach [m]: farthest gap looked across

OPERATORS: Mapping[str, Operator] = {
    "mortar": mortar_coupling,
    "node-to-segment": nodal_coupling,
    "node-to-face": nodal_coupling,
}


REACH = 0.2  # of the sides' extent: as far as contact is searched for where the scene does not say


def pair_up(
    problem: Problem, sides: Mapping[str, Surface], constraints: Constraints, moved: Mapping[str, Array]
) -> tuple[ContactRows, ...]:
    """Rows of all pairs.

    Args:
        sides: surfaces in the reference configuration by name, body.side.
        moved: displacement (n_all, d) [m] of the nodes of pairs that slide, relative to a rigid obstacle.

    Raises:
        SceneError: nothing of a slave side faces its master within reach.
    """
    couplings = {}
    for name, known in problem.pairs.items():
        slave = sides[known.slave]
        master = sides[known.master] if known.master is not None else None
        if known.contact.normal.at_quadrature and known.contact.friction is not None:
            slave = replace(slave, positive=True)  # friction bounds are means of pressures with phi~
        if name in moved:
            own, other = np.split(moved[name], [len(slave.nodes)])
            slave = replace(slave, points=slave.points + own)
            master = master and replace(master, points=master.points + other)
        if known.obstacle is not None:
            couplings[name] = known.contact, with_edges(rigid_coupling(slave, problem.obstacles[known.obstacle]), 0.0)
            continue
        assert master is not None
        assert known.master is not None
        # of the start, and the same for a scene that is turned as a whole
        reach = known.contact.search_distance or REACH * _spread(sides[known.slave], sides[known.master])
        operator = OPERATORS[known.contact.operator or "mortar"]
        reach *= 1 + CLOSE  # as wide a gap to rounding
        couplings[name] = known.contact, with_edges(operator(slave, master, reach), reach)
        if not np.any(couplings[name][1].weights > 0):
            raise SceneError(
                f"contacts.{name}: nothing of {known.slave} faces {known.master} within {reach:g} "
                f"{problem.labels.length}; set search_distance, or exchange the sides"
            )
    return tuple(build_rows(couplings, constraints, moved, problem.timeline.end))


def with_images(side: Surface, constraints: Constraints, name: str) -> Surface:
    """A side of a cyclic sector, whose nodes at one end are those at the other, turned.

    Raises:
        SceneError: it has an edge there.
    """
    roots, turn = constraints.roots(side.nodes), constraints.turns(side.nodes)
    there = np.flatnonzero((turn != np.eye(side.dim)).any(axis=(1, 2)) & np.isin(roots, side.nodes))
    known, count = np.unique(side.nodes, return_counts=True)
    if (count[np.searchsorted(known, np.concatenate([roots[there], side.nodes[there]]))] > 1).any():
        raise SceneError(f"{name}: has an edge on a cyclic side; turn the sector so that it has none there")
    order = np.argsort(side.nodes)
    here = order[np.searchsorted(side.nodes, roots[there], sorter=order)]
    return replace(side, images=(here, there, turn[there])) if len(there) else side


def _spread(*sides: Surface) -> float:
    """Diameter of the sphere about the middle of the sides' nodes [m]."""
    points = np.concatenate([side.points for side in sides])
    return 2 * float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
