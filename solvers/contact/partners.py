"""One side against several partners: each part of it belongs to the partner that it reaches first.

Between bodies the parts are mortar's cells, or nodes that meet a facet. What bodies leave goes to rigid obstacles: at
each node to the one that is nearest along the side's normal. The parts add up to the side, so that a pressure that is
the same everywhere is the same on all partners. Distances are those of the surfaces, without gap offsets.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from scipy import sparse

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CLOSE, ROUNDING, Array, Bools
from stickslip.geometry.curved_facets import SMOOTH
from stickslip.geometry.obstacles import Obstacle
from stickslip.geometry.surfaces.cells import Cells, graded, uncovered
from stickslip.geometry.surfaces.faces import facets_near, part_of
from stickslip.geometry.surfaces.overlap import Overlap, faced, over
from stickslip.geometry.surfaces.search import Pairing, pair
from stickslip.geometry.surfaces.surface import Surface, joined
from stickslip.solvers.contact.coupling import (
    Coupling,
    Facing,
    On,
    of_facets,
    on_nodes,
    rigid_coupling,
    seen_from,
    shares,
)
from stickslip.solvers.contact.mortar import LITTLE, mortar_coupling, positive_shares, product_degree

Operator = Callable[[Facing], Coupling]


@dataclass(frozen=True, kw_only=True)
class Partner:
    """What a side may touch: a rigid obstacle, or another body's surface."""

    slave: Surface  # the side, where it is as seen from an obstacle
    other: Surface | Obstacle
    reach: float = 0.0  # farthest gap [m] across which a body is looked for
    operator: Operator = mortar_coupling  # between bodies
    at_quadrature: bool = False  # whether the normal law acts at integration points

    def distance(self, on: On, along: Array) -> Array:
        """Distances (q,) [m] of points of the side from an obstacle along unit directions (q, d); inf: averted."""
        assert isinstance(self.other, Obstacle)
        gap, normals = seen_from(self.other, on.basis(self.slave) @ self.slave.points)
        lean = -np.einsum("qd,qd->q", normals, along)
        faces = np.where(lean > CLOSE, lean, 1.0)
        return np.where(lean > CLOSE, np.where(gap > 0, gap / faces, gap * faces), np.inf)


@dataclass(frozen=True)
class AmongPartners(Facing):
    """Where a side faces one of several masters, and reaches it before the others and before obstacles."""

    earlier: Sequence[Facing]  # with masters that have a part at the same distance
    later: Sequence[Facing]  # with the others
    every: Callable[[int], Overlap]  # with all masters as one surface, by degree of quadrature
    rigid: Callable[[On, Array], Array]  # distance (q,) of points from the nearest obstacle along directions [m]

    def points(self, degree: int) -> Overlap:
        found, start = self.every(degree), sum(len(other.master.facets) for other in self.earlier)
        own = (found.master_facet >= start) & (found.master_facet < start + len(self.master.facets))
        found = found.at(own)
        found = found.at(np.abs(found.gap) <= np.abs(self.rigid(_places(found), found.normals)))
        return replace(found, master_facet=found.master_facet - start)

    def nodes(self, along: Array) -> Pairing:
        found = Facing.nodes(self, along)
        on = on_nodes(self.slave, np.ones(len(along), bool))
        return found.only((found.facet >= 0) & self.first(on, along, found.gap))

    def first(self, on: On, along: Array, gap: Array) -> Bools:
        points, size = on.basis(self.slave) @ self.slave.points, np.abs(gap)
        found = size <= np.abs(self.rigid(on, along))
        for others, farther in ((self.earlier, np.less), (self.later, np.less_equal)):
            for other in others:
                found &= farther(size, np.abs(pair(points, along, other.master, other.reach).gap))
        return np.asarray(found)


def within_reach(partners: Sequence[Partner]) -> list[Partner]:
    """The same with those parts alone that may touch, where surfaces have edges and so may be all of a body's skin.

    What faces away from an obstacle does not touch it.
    """
    slave, others = partners[0].slave, [each.other for each in partners if isinstance(each.other, Surface)]
    sides = slave, *others
    if all(side.faces is None for side in sides) or any(side.images is not None for side in sides):
        return list(partners)
    on, normals = on_nodes(slave, np.ones(len(slave.nodes), bool)), slave.node_normals()
    kept = np.zeros(len(slave.facets), bool)
    for each in partners:
        if isinstance(each.other, Surface):
            kept |= facets_near(slave, each.other, each.reach)
        else:
            kept |= np.isfinite(each.distance(on, normals))[slave.facets].any(axis=1)
    slave = part_of(slave, kept | ~kept.any())
    found = []
    for each in partners:
        other = each.other
        if isinstance(other, Surface):
            beside = facets_near(other, slave, each.reach)
            other = part_of(other, beside | ~beside.any())
        found.append(replace(each, slave=slave, other=other))
    return found


def alone(partner: Partner) -> tuple[Coupling, Facing | None]:
    """Coupling of a side with its only partner, and where it faces it if that is a body."""
    slave, other = partner.slave, partner.other
    if isinstance(other, Surface):
        facing = Facing(slave, other, partner.reach)
        return partner.operator(facing), facing
    if not partner.at_quadrature:
        return rigid_coupling(slave, other), None
    whole, cut = _finer_at_tips([partner], np.ones(len(slave.facets), bool))
    return rigid_coupling(slave, other, partial(of_facets, slave, whole, cut)), None


def _finer_at_tips(rigid: Sequence[Partner], whole: Bools) -> tuple[Bools, Cells]:
    """Which of the whole facets (f,) have no corner or edge that touches an obstacle, and cells of the others.

    All facets around such a place rise from the obstacle. In 2D it may be an end of the side.
    """
    slave, corners = rigid[0].slave, dx.reference_nodes(rigid[0].slave.shape, 1)
    around = slave.beside or slave
    nodes, middles = around.facets[:, : len(corners)], around.points[around.facets].mean(axis=1)
    steep = np.sin(np.radians(SMOOTH)) * np.linalg.norm(around.points[nodes] - middles[:, None], axis=2)
    tips, at = np.zeros((len(slave.facets), len(corners)), bool), slave.facets[:, : len(corners)]
    number, count = np.unique(around.nodes[nodes], return_counts=True)
    sharp = (slave.at_edge > 0) | ((slave.dim == 2) & np.isin(slave.nodes, number[count == 1]))
    for each in rigid if sharp.any() else ():
        assert isinstance(each.other, Obstacle)
        gap, beyond = (seen_from(each.other, x)[0] for x in (around.points, middles))
        beneath = around.nodes[nodes[beyond[:, None] - gap[nodes] <= steep]]
        tips |= sharp[at] & ~np.isin(slave.nodes[at], beneath)
    facet, corner = np.nonzero(tips & whole[:, None])
    return whole & ~tips.any(axis=1), graded(slave, facet, corners[corner])


def among_partners(partners: Sequence[Partner]) -> list[tuple[Coupling, Facing | None]]:
    """Coupling of one side with each of its partners, and where it faces those that are bodies."""
    rigid = [partner for partner in partners if isinstance(partner.other, Obstacle)]

    def nearest(on: On, along: Array) -> Array:
        distances = [partner.distance(on, along) for partner in rigid]
        return np.asarray(np.min([np.full(len(along), np.inf), *distances], axis=0))

    bodies = [partner for partner in partners if isinstance(partner.other, Surface)]
    plain = [Facing(p.slave, p.other, p.reach) for p in bodies if isinstance(p.other, Surface)]
    slave = (bodies or rigid)[0].slave
    masters = joined([facing.master for facing in plain]) if plain else slave

    @cache
    def faces() -> Cells:
        """The parts that bodies face."""
        if not plain:
            return Cells.of(np.zeros(0, np.int64), np.zeros((0, slave.dim, slave.dim - 1)))
        return faced(slave, masters, np.concatenate([np.full(len(f.master.facets), f.reach) for f in plain]))

    @cache
    def every(degree: int) -> Overlap:
        return over(faces(), slave, masters, degree)

    full, left, found = slave.node_weights(), np.ones(len(slave.nodes)), dict[int, tuple[Coupling, Facing | None]]()
    for k, (partner, own) in enumerate(zip(bodies, plain, strict=True)):
        facing = AmongPartners(own.slave, own.master, own.reach, plain[:k], plain[k + 1 :], every, nearest)
        coupling = partner.operator(facing)
        taken = coupling.weights
        if partner.operator is mortar_coupling:
            points = coupling.points(0)
            taken = np.asarray(shares(points.own, slave, points.weights).sum(axis=1)).ravel()
        left = left - taken / full
        found[id(partner)] = coupling, facing
    left[np.abs(left) <= ROUNDING] = 0.0
    normals, whole = slave.node_normals(), np.ones(len(slave.facets), bool)

    @cache
    def bare(degree: int) -> tuple[On, Array]:
        """Integration points of what bodies leave: mortar parts of facets, and of each point what nodes leave of it."""
        if bodies and bodies[0].operator is not mortar_coupling:
            on, weights = of_facets(slave, *_finer_at_tips(rigid, whole), degree)
            size = shares(on, slave, weights).T @ left
            return on.at(size > ROUNDING * weights), size[size > ROUNDING * weights]
        rest, cut = uncovered(slave, faces())
        rest, fine = _finer_at_tips(rigid, rest)
        on, weights = of_facets(slave, rest, Cells.joined([cut, fine]), degree)
        nearer = every(max([degree, *(product_degree(slave, facing.master) for facing in plain)]))
        nearer = nearer.at(np.abs(nearer.gap) > np.abs(nearest(_places(nearer), nearer.normals)))
        return On.joined([on, _places(nearer)]), np.concatenate([weights, nearer.weights])

    def owned(k: int, on: On) -> Bools:
        along = on.basis(slave) @ normals
        return np.asarray(np.argmin([each.distance(on, along) for each in rigid], axis=0) == k)

    def own_points(k: int, degree: int) -> tuple[On, Array]:
        on, weights = bare(degree)
        own = owned(k, on)
        return on.at(own), weights[own]

    at_nodes = on_nodes(slave, np.ones(len(left), bool))
    for k, partner in enumerate(rigid):
        found[id(partner)] = _part(partner, left * owned(k, at_nodes), partial(own_points, k)), None
    return [found[id(partner)] for partner in partners]


def _places(found: Overlap) -> On:
    return On(found.slave_facet, found.slave_local)


def _part(partner: Partner, parts: Array, points: Callable[[int], tuple[On, Array]]) -> Coupling:
    """Coupling with an obstacle of a part of a side; where it is less than a little of a node's, it goes to neighbours.

    Args:
        parts: of the nodes' areas (n,).
        points: integration points of the part by degree, for laws that act there.
    """
    assert isinstance(partner.other, Obstacle)
    surface, at_quadrature = partner.slave, partner.at_quadrature
    coupling = rigid_coupling(surface, partner.other, points if at_quadrature else None)
    full, taken = coupling.weights, sparse.diags(np.ones(len(parts)) if at_quadrature else parts)
    weights = parts * full
    if at_quadrature:
        degree = 2 * surface.degree * (1 + (surface.shape == "quadrilateral")) + surface.axisymmetric
        weights = np.asarray(coupling.points(degree).phi.sum(axis=1)).ravel()
        weights[weights <= ROUNDING * full] = 0.0
    share = positive_shares(surface, weights, weights > LITTLE * full)
    total = np.asarray(share @ weights)
    each = np.divide(1.0, total, out=np.zeros_like(total), where=total > 0)
    elsewhere = sparse.diags((total == 0).astype(float))  # nodes of other partners keep their distance and motion
    mean = (sparse.diags(each) @ share @ sparse.diags(weights) + elsewhere).tocsr()
    own = (share @ taken).tocsr()
    return replace(
        coupling,
        weights=total,
        relative=(mean @ coupling.relative).tocsr(),
        gap=mean @ coupling.gap,
        carries=total > 0,
        points=lambda degree: coupling.points(degree).moved(own),
    )
