"""Bodies that may all touch each other: the parts of two skins that are near, and the skins that they belong to.

Facets enter that are within the margin of the other skin. That list holds until the bodies have moved against each
other by the margin. Rows are found among the parts, and act on the skins, which stay the same as bodies move on.

Source of lists with a margin: Verlet, Phys. Rev. 159 (1967).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import Array, Bools, Ints
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.surfaces.faces import facets_near, farthest, part_of
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.coupling import Coupling, On, Points
from stickslip.solvers.contact.edges import with_edges
from stickslip.solvers.contact.partners import Partner, alone, among_partners

NEAR = ".near"  # behind a pair's name: which nodes are near, beside where its skins were searched


@dataclass(frozen=True)
class Part:
    """The facets of a skin all of whose nodes are near another one."""

    skin: Surface
    near: Bools  # (n,) nodes of the skin

    @property
    def facets(self) -> Ints:
        """Those of the skin (f,) that it has."""
        found: Ints = np.flatnonzero(self.near[self.skin.facets].all(axis=1))
        return found

    @property
    def nodes(self) -> Ints:
        """Those of the skin (k,) that it has."""
        found: Ints = np.unique(self.skin.facets[self.facets])
        return found

    @property
    def surface(self) -> Surface:
        kept = np.zeros(len(self.skin.facets), bool)
        kept[self.facets] = True
        return part_of(self.skin, kept)

    @property
    def onto(self) -> Sparse:
        """Values at its nodes to those of the skin (n, k), 0 at the others."""
        nodes = self.nodes
        shape = len(self.skin.nodes), len(nodes)
        found: Sparse = sparse.csr_matrix((np.ones(len(nodes)), (nodes, np.arange(len(nodes)))), shape=shape)
        return found


def nodes_near(one: Surface, other: Surface, margin: float) -> Bools:
    """Nodes (n_all,) of two skins that may be within a margin [m] of the other one."""
    low, high = (np.array([getattr(side.points, end)(axis=0) for side in (one, other)]) for end in ("min", "max"))
    found = [np.zeros(len(side.nodes), bool) for side in (one, other)]
    if (np.maximum(low[0] - high[1], low[1] - high[0]) <= margin).all():
        for near, side, beside in zip(found, (one, other), (other, one), strict=True):
            near[side.facets[facets_near(side, beside, margin)]] = True
    return np.concatenate(found)


def motion_between(one: Array, other: Array) -> float:
    """How far [m] nodes (n, d) and (m, d) of two bodies have moved against each other, at most."""
    away = np.maximum(one.max(axis=0) - other.min(axis=0), other.max(axis=0) - one.min(axis=0))
    return float(np.linalg.norm(np.abs(away)))


def among_skins(
    partners: Mapping[str, Partner], near: Mapping[str, Bools], given: Collection[str]
) -> dict[str, Coupling]:
    """Coupling of one skin with each of those that it may touch; without a weight where nothing is near.

    Args:
        partners: by pair; the slave is the same skin.
        near: of each pair (n_all,), see `nodes_near`.
        given: pairs whose gap is given: it is that of facets within reach alone, others may be as far as the parts are.
    """
    skin = next(iter(partners.values())).slave
    of_slave = {name: each[: len(skin.nodes)] for name, each in near.items()}
    slave = Part(skin, np.any([*of_slave.values()], axis=0))
    masters = {name: Part(_master(each), near[name][len(skin.nodes) :]) for name, each in partners.items()}
    meeting = [name for name in partners if of_slave[name].any() and len(masters[name].facets)]
    found = {name: _untouched(skin, _master(each)) for name, each in partners.items()}
    if not meeting or not len(slave.facets):
        return found
    here = slave.surface
    parts = list[Partner]()
    for name in meeting:
        there = masters[name].surface
        far = farthest(here, there)
        reach = partners[name].reach if name in given else far
        parts.append(replace(partners[name], slave=here, other=there, reach=reach))
    couplings = among_partners(parts) if len(parts) > 1 else [alone(parts[0])]
    for name, (coupling, facing) in zip(meeting, couplings, strict=True):
        found[name] = _on_skins(with_edges(coupling, facing, partners[name].at_quadrature), slave, masters[name])
    return found


def _master(partner: Partner) -> Surface:
    assert isinstance(partner.other, Surface)
    return partner.other


def _untouched(skin: Surface, master: Surface) -> Coupling:
    n, d = skin.points.shape
    nothing = sparse.csr_matrix((n, n + len(master.nodes)))

    def no_points(degree: int) -> Points:
        none, at = sparse.csr_matrix((n, 0)), On(np.zeros(0, np.int64), np.zeros((0, d - 1)))
        return Points(
            weights=np.zeros(0), relative=nothing[:0], gap=np.zeros(0), normals=np.zeros((0, d)), psi=none, phi=none,
            own=at, other=at,
        )  # fmt: skip

    return Coupling(
        surface=skin,
        master=master,
        weights=np.zeros(n),
        relative=nothing,
        gap=np.zeros(n),
        normals=skin.node_normals(),
        carries=np.zeros(n, bool),
        points=no_points,
    )


def _on_skins(coupling: Coupling, slave: Part, master: Part) -> Coupling:
    """A coupling of two parts as one of their skins."""
    onto, nodes, empty = slave.onto, slave.nodes, _untouched(slave.skin, master.skin)
    both = sparse.block_diag([onto, master.onto], format="csr").T

    def points(degree: int) -> Points:
        found = coupling.points(degree)
        assert found.other is not None
        return replace(
            found.moved(onto),
            relative=(found.relative @ both).tocsr(),
            own=On(slave.facets[found.own.facet], found.own.local),
            other=On(master.facets[found.other.facet], found.other.local),
        )

    normals, carries = empty.normals, empty.carries.copy()
    normals[nodes], carries[nodes] = coupling.normals, coupling.carries
    return replace(
        empty,
        weights=onto @ coupling.weights,
        relative=(onto @ coupling.relative @ both).tocsr(),
        gap=onto @ coupling.gap,
        normals=normals,
        carries=carries,
        points=points,
        tips=None if coupling.tips is None else onto @ coupling.tips,
    )
