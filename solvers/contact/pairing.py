"""Contact operators by name, and contact rows of all pairs: obstacles by their shape, bodies by a search."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import CLOSE, Array, Bools
from stickslip.geometry.errors import SceneError
from stickslip.geometry.surfaces.faces import halves, split_at_edges
from stickslip.geometry.surfaces.surface import Surface, joined, selected
from stickslip.geometry.user_files.touching import WITHIN
from stickslip.solvers.contact.build import build_rows
from stickslip.solvers.contact.coupling import Coupling, nodal_coupling
from stickslip.solvers.contact.edges import with_edges
from stickslip.solvers.contact.mortar import mortar_coupling
from stickslip.solvers.contact.partners import Operator, Partner, alone, among_partners, within_reach
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.contact.skins import NEAR, among_skins, nodes_near
from stickslip.solvers.fem.constraints import Constraints
from stickslip.solvers.scene.contact import REACH, Contact
from stickslip.solvers.scene.problem import BESIDE, Pair, Problem

OPERATORS: Mapping[str, Operator] = {
    "mortar": mortar_coupling,
    "node-to-segment": nodal_coupling,
    "node-to-face": nodal_coupling,
}


def with_halves(problem: Problem, sides: Mapping[str, Surface]) -> Mapping[str, Surface]:
    """Sides by name, with the halves of those that touch themselves, see `Pair.surfaces`.

    Raises:
        SceneError: a side is flat.
    """
    found = dict(sides)
    for known in problem.pairs.values():
        if known.slave == known.master:
            side = sides[known.slave]
            parts = halves(side, known.contact.search_distance or REACH * _spread(side))
            if not all(len(part.facets) for part in parts):
                raise SceneError(f"contacts.{known.name}: nothing of {known.slave} can face itself: it is flat")
            found |= zip((str(name).removesuffix(BESIDE) for name in known.surfaces), parts, strict=True)
    return found


def pair_up(
    problem: Problem, sides: Mapping[str, Surface], constraints: Constraints, moved: Mapping[str, Array]
) -> tuple[ContactRows, ...]:
    """Rows of all pairs; of those that are found some may touch nowhere.

    Args:
        sides: surfaces in the reference configuration, see `Pair.surfaces`.
        moved: displacement (n_all, d) [m] of the nodes of pairs that slide, relative to a rigid obstacle; of pairs that
            are found also which nodes are near, see `NEAR`.

    Raises:
        SceneError: nothing of a slave side faces its master within reach.
    """
    sharing = dict[tuple[str, bool], list[str]]()
    for name, known in problem.pairs.items():
        sharing.setdefault((known.surfaces[0], known.skins), []).append(name)
    couplings, near = dict[str, tuple[Contact, Coupling]](), dict[str, Bools]()
    missed, touched = list[tuple[tuple[str, ...], bool, str]](), set[tuple[str, ...]]()
    for (side, skins), names in sharing.items():
        pairs = [problem.pairs[name] for name in names]
        partners = [_partner(problem, known, sides, moved.get(known.name)) for known in pairs]
        if not skins and any(
            len(known.bodies) != 2 or len({*known.bodies}) > 1 for known in pairs
        ):  # of one body behind is the body
            partners = [replace(each, slave=replace(each.slave, depth=None)) for each in partners]
        positive = any(pair.contact.normal.at_quadrature and pair.contact.friction is not None for pair in pairs)
        if positive:  # friction bounds are means of pressures with phi~
            partners = [replace(each, slave=replace(each.slave, positive=True)) for each in partners]
        if skins:
            each = dict(zip(names, partners, strict=True))
            near |= {name: _nodes_near(problem, name, partner, moved) for name, partner in each.items()}
            given = {name for name in names if problem.pairs[name].contact.gap is not None}
            of_skins = among_skins(each, {name: near[name] for name in names}, given)
            found = [of_skins[name] for name in names]
        else:
            if not any(pair.contact.sliding for pair in pairs):
                partners = within_reach(partners)
            facing = among_partners(partners) if len(partners) > 1 else [alone(partners[0])]
            found = [with_edges(*each, p.at_quadrature) for each, p in zip(facing, partners, strict=True)]
        touching = [bool(np.any(coupling.weights > 0)) for coupling in found]
        for known, partner, coupling, touches in zip(pairs, partners, found, touching, strict=True):
            couplings[known.name] = known.contact, coupling
            if not (touches or known.found) and not (known.contact.sliding and any(touching)):
                nowhere = f"contacts.{known.name}: nothing of {side} faces {known.master} within {partner.reach:g} "
                nowhere += f"{problem.labels.length}; set search_distance, or exchange the sides"
                hidden = f"contacts.{known.name}: all of {side} reaches other partners first; leave this one out, set "
                hidden += "search_distance, or let the contact slide"
                flank = any(isinstance(s, Surface) and s.beside is not None for s in (partner.slave, partner.other))
                missed.append((known.bodies, flank, hidden if any(touching) else nowhere))
            touched |= {known.bodies, known.bodies[::-1]} if touches else set()
    for bodies, flank, said in missed:  # a flank may touch nothing where the side beside it does
        if not (flank and bodies in touched):
            raise SceneError(said)
    couplings = {name: couplings[name] for name in problem.pairs}
    softest = {k: min(problem.bodies[body].least_modulus for body in p.bodies) for k, p in problem.pairs.items()}
    every = build_rows(couplings, constraints, moved, problem.timeline.end, softest)
    exchanged = {name for name, known in problem.pairs.items() if known.slave != known.contact.surface}
    signed = (replace(rows, sense=-1.0) if rows.name in exchanged else rows for rows in every)
    return tuple(replace(rows, near=near[rows.name]) if rows.name in near else rows for rows in signed)


def _nodes_near(problem: Problem, name: str, partner: Partner, moved: Mapping[str, Array]) -> Bools:
    assert isinstance(partner.other, Surface)
    found, key = nodes_near(partner.slave, partner.other, margin(problem, name)), f"{name}{NEAR}"
    return found | (moved[key] > 0) if key in moved else found


def margin(problem: Problem, name: str) -> float:
    """Distance [m] within which facets of a pair that is found may touch, see `nodes_near`."""
    diagonal = float(np.linalg.norm(np.ptp(problem.shape.box(problem.dim), axis=0)))
    return problem.pairs[name].contact.search_distance or WITHIN * diagonal


def with_images(side: Surface, constraints: Constraints) -> Surface:
    """A side of a cyclic sector, whose nodes at one end are those at the other, turned.

    Where it bends between two sectors as at an edge, its nodes at both ends are those of different faces.
    """
    turns, roots = constraints.turns(side.nodes), constraints.roots(side.nodes)
    there = np.flatnonzero((turns != np.eye(side.dim)).any(axis=(1, 2)) & np.isin(roots, side.nodes))
    if not len(there):
        return side
    turn = turns[there[0]]
    at = np.flatnonzero(side.nodes == roots[there[0]])[0]
    moved = (side.points - side.points[at]) @ turn.T + side.points[there[0]]
    of_place = dict(zip(roots[there].tolist(), side.nodes[there].tolist(), strict=True))
    again = np.array([of_place.get(node, -1 - node) for node in side.nodes.tolist()])  # as the next sector's are
    both, n = joined([side, replace(side, nodes=again, points=moved)]), len(side.nodes)
    _, first, same = np.unique(both.nodes, return_index=True, return_inverse=True)
    both = split_at_edges(replace(selected(both, first, same[both.facets]), faces=None))
    sector, following = np.split(both.facets.ravel(), 2)
    _, goes_on, begins = np.intersect1d(sector, following, return_indices=True)
    ends = np.isin(roots, roots[there])
    there, here = side.facets.ravel()[goes_on], side.facets.ravel()[begins]
    ends[there] = ends[here] = False
    faces = np.zeros(n, np.int64) if side.faces is None else side.faces
    faces = faces + (faces.max() + 1) * (ends & (roots != side.nodes))
    if not np.allclose(turn, constraints.periodic.sectors[1]):
        here, there, turn = there, here, turn.T
    images = (here, there, np.tile(turn, (len(here), 1, 1))) if len(here) else None
    return replace(side, images=images, **({"faces": faces, "ends": ends.astype(int)} if ends.any() else {}))


def _partner(problem: Problem, known: Pair, sides: Mapping[str, Surface], moved: Array | None) -> Partner:
    """Both sides of a pair, where their nodes have moved to (n_all, d) [m]."""
    (one, two), contact = known.surfaces, known.contact
    slave = sides[one]
    own, other = (None, None) if moved is None else np.split(moved, [len(slave.nodes)])
    at_quadrature, here = contact.normal.at_quadrature, _displaced(slave, own)
    if two is None:
        return Partner(slave=here, other=problem.obstacles[str(known.obstacle)], at_quadrature=at_quadrature)
    if known.cyclic and own is not None and other is not None:
        turn = problem.request.sectors[0]
        here_turned, there_turned = turn.of(slave.points, own), turn.of(sides[two].points, other)
        far = max(here_turned.max() - there_turned.min(), there_turned.max() - here_turned.min())
        if far > abs(turn.angle):
            past = f"points slide by {far:.3g} degrees, past the sectors beside theirs"
            raise SceneError(f"contacts.{known.name}.sliding = true: {past}; mesh more of the whole")
    # of the start, and the same for a scene that is turned as a whole
    reach = contact.search_distance or REACH * _spread(slave, sides[two])
    return Partner(
        slave=here,
        other=_displaced(sides[two], other),
        reach=reach * (1 + CLOSE),  # as wide a gap to rounding
        operator=OPERATORS[contact.operator or "mortar"],
        at_quadrature=at_quadrature,
    )


def _displaced(side: Surface, moved: Array | None) -> Surface:
    return side if moved is None else replace(side, points=side.points + moved)


def _spread(*sides: Surface) -> float:
    """Diameter of the sphere about the middle of the sides' nodes [m]."""
    points = np.concatenate([side.points for side in sides])
    return 2 * float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
