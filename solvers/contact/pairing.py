"""Contact operators by name, and contact rows of all pairs: obstacles by their shape, bodies by a search."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import CLOSE, Array
from stickslip.geometry.errors import SceneError
from stickslip.geometry.surfaces.faces import halves, near
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.build import build_rows
from stickslip.solvers.contact.coupling import Coupling, nodal_coupling, rigid_coupling
from stickslip.solvers.contact.edges import with_edges
from stickslip.solvers.contact.mortar import mortar_coupling
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.fem.constraints import Constraints
from stickslip.solvers.scene.problem import Pair, Problem

Operator = Callable[[Surface, Surface, float], Coupling]  # slave, master, reach [m]: farthest gap looked across

OPERATORS: Mapping[str, Operator] = {
    "mortar": mortar_coupling,
    "node-to-segment": nodal_coupling,
    "node-to-face": nodal_coupling,
}


Sides = tuple[Surface, Surface | None]
REACH = 0.2  # of the sides' extent: as far as contact is searched for where the scene does not say


def sides_of(problem: Problem, known: Pair, sides: Mapping[str, Surface]) -> Sides:
    """The surfaces of a contact, that of the slave first; of one side that touches itself two halves.

    Args:
        sides: by name, body.side.
    """
    slave = sides[known.slave]
    if known.master is None:
        return replace(slave, depth=None), None
    if known.master == known.slave:
        parts = halves(slave, _reach(known, slave))
        if not all(len(part.facets) for part in parts):
            raise _faces_nothing(problem, known, slave)
        return parts
    one_body = len(set(known.bodies)) == 1
    found = slave, sides[known.master]
    return found if one_body else (replace(found[0], depth=None), replace(found[1], depth=None))


def _reach(known: Pair, *sides: Surface) -> float:
    """Farthest gap [m] across which the sides of a contact are looked at."""
    return known.contact.search_distance or REACH * _spread(*sides)


def _faces_nothing(problem: Problem, known: Pair, *sides: Surface) -> SceneError:
    """Explain that nothing of a contact's slave faces its master."""
    return SceneError(
        f"contacts.{known.name}: nothing of {known.slave} faces {known.master} within "
        f"{(1 + CLOSE) * _reach(known, *sides):g} {problem.labels.length}; set search_distance, or exchange the sides"
    )


def pair_up(
    problem: Problem, sides: Mapping[str, Sides], constraints: Constraints, moved: Mapping[str, Array]
) -> tuple[ContactRows, ...]:
    """Rows of all pairs.

    Args:
        sides: surfaces of each contact in the reference configuration, that of the slave first.
        moved: displacement (n_all, d) [m] of the nodes of pairs that slide, relative to a rigid obstacle.

    Raises:
        SceneError: nothing of a slave side faces its master within reach.
    """
    couplings = {}
    for name, known in problem.pairs.items():
        slave, master = sides[name]
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
        both = [side for side in sides[name] if side is not None]
        reach = _reach(known, *both)
        operator = OPERATORS[known.contact.operator or "mortar"]
        reach *= 1 + CLOSE  # as wide a gap to rounding
        if not known.contact.sliding and (slave.faces is not None or master.faces is not None):
            slave, master = near(slave, master, reach), near(master, slave, reach)  # sides may be whole skins
        couplings[name] = known.contact, with_edges(operator(slave, master, reach), reach)
        if not np.any(couplings[name][1].weights > 0):
            raise _faces_nothing(problem, known, *both)
    return tuple(build_rows(couplings, constraints, moved, problem.timeline.end))


def _spread(*sides: Surface) -> float:
    """Diameter of the sphere about the middle of the sides' nodes [m]."""
    points = np.concatenate([side.points for side in sides])
    return 2 * float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
