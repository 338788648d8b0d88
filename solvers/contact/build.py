"""Build contact rows from couplings and laws: which nodes carry a multiplier, and in which directions.

Normal multipliers are placed first, since they may make a direction of friction redundant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import CLOSE, EXACT, ROUNDING, TINY, Array, Bools, Ints
from stickslip.geometry.curved_facets import SMOOTH
from stickslip.geometry.errors import SceneError, prefixed
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.shape import SKIN
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.coupling import DIGITS, Coupling
from stickslip.solvers.contact.rows import ContactRows, Fields, of_both
from stickslip.solvers.fem.constraints import Constraints
from stickslip.solvers.scene.contact import Contact


@dataclass(frozen=True, kw_only=True)
class MultiplierNodes:
    """The m nodes of a surface that carry a multiplier, the nodes that each stands for, and the directions of each."""

    share: Sparse  # (m, n), columns add up to 1, or to 0 where no node near can carry a multiplier
    directions: Array  # (m, c, d): c unit directions each
    free: Bools  # (m, c) directions that carry a multiplier

    def mean(self, weights: Array) -> tuple[Sparse, Array]:
        """Matrix (m, n) from values at nodes to weighted means, and the total weights W (m,).

        Args:
            weights: of the nodes (n,) [m^(d-1)].
        """
        total = np.asarray(self.share @ weights)
        return self.share.multiply(weights[None, :]).multiply(1 / total[:, None]).tocsr(), total

    def rows(self, coupling: Coupling) -> tuple[Sparse, Array]:
        """N (m c, (n + n_master) d), nodal displacement to mean relative displacement, and the weights W (m,)."""
        mean, total = self.mean(coupling.weights)
        return along(mean @ coupling.relative, self.directions * self.free[:, :, None]), total


def along(relative: Sparse, directions: Array) -> Sparse:
    """Nodal displacement to relative displacement along c directions at m points (m c, n d).

    Args:
        relative: (m, n) nodal displacements to relative displacement.
        directions: (m, c, d).
    """
    (m, c, d), entries = directions.shape, relative.tocoo()
    components = directions[entries.row]  # (nnz, c, d)
    i = entries.row[:, None, None] * c + np.arange(c)[None, :, None]
    j = entries.col[:, None, None] * d + np.arange(d)[None, None, :]
    i, j = np.broadcast_to(i, components.shape), np.broadcast_to(j, components.shape)
    values = entries.data[:, None, None] * components
    shape = (m * c, entries.shape[1] * d)
    found: Sparse = sparse.coo_matrix((values.ravel(), (i.ravel(), j.ravel())), shape=shape).tocsr()
    found.eliminate_zeros()  # of directions along axes
    return found


def frames_of(normals: Array) -> Array:
    """Orthonormal frames (n, d, d), row 0 the normal (n, d).

    >>> frames_of(np.array([[0.0, -1.0]]))[0]
    array([[ 0., -1.],
           [ 1.,  0.]])
    """
    if normals.shape[1] == 2:
        return np.stack([normals, np.stack([-normals[:, 1], normals[:, 0]], axis=1)], axis=1)
    least = np.eye(3)[np.argmin(np.abs(normals).round(DIGITS), axis=1)]
    first = np.cross(normals, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([normals, first, np.cross(normals, first)], axis=1)


class HeldMotions:
    """Motions of nodes that multipliers against rigid obstacles hold already."""

    def __init__(self, dim: int) -> None:
        self._nodes, self._projectors = np.zeros(0, np.int64), np.zeros((0, dim, dim))

    def of(self, nodes: Ints) -> Array:
        """Projectors (n, d, d) onto the held motions of nodes (n,)."""
        found = np.zeros((len(nodes), *self._projectors.shape[1:]))
        at = np.searchsorted(self._nodes, nodes)
        known = np.isin(nodes, self._nodes)
        found[known] = self._projectors[at[known]]
        return found

    def hold(self, nodes: Ints, projectors: Array) -> None:
        """From now on these (n, d, d) are held at the nodes (n,), each once."""
        every, first = np.unique(np.concatenate([nodes, self._nodes]), return_index=True)
        self._nodes, self._projectors = every, np.concatenate([projectors, self._projectors])[first]


def place_multipliers(
    coupling: Coupling, directions: Array, constraints: Constraints, used: HeldMotions
) -> MultiplierNodes:
    """Give each node a multiplier in the directions in which its motion is free and not yet held by another one.

    Args:
        coupling: the surface and what it may touch.
        directions: (n, c, d) unit directions at the nodes.
        constraints: supports and periodicity.
        used: of root nodes; what is held by those placed here is added, between bodies at edges only.
    """
    surface, facing = coupling.surface, coupling.weights != 0
    tried = np.flatnonzero(coupling.carries & ~of_both(surface, coupling.master))
    roots, bases = constraints.roots(surface.nodes[tried]), constraints.bases(surface.nodes[tried])[0]
    faces = np.zeros(len(tried), np.int64) if surface.faces is None else surface.faces[tried]
    key = roots * (1 + faces.max(initial=0)) + faces  # periodic images share one multiplier
    _, order, of_key = np.unique(key, return_index=True, return_inverse=True)
    starts = np.searchsorted(roots[order], roots[order])
    turn = (np.arange(len(order)) - starts)[of_key]  # among the faces that meet at an edge
    turned, free = np.empty_like(directions[tried]), np.empty((len(tried), directions.shape[1]), bool)
    for one in (np.flatnonzero(turn == k) for k in range(turn.max(initial=-1) + 1)):
        turned[one], free[one], held = _independent(directions[tried[one]], bases[one], used.of(roots[one]))
        holds = free[one].any(axis=1) & ((coupling.master is None) | (surface.at_edge[tried[one]] > 0))
        first = np.flatnonzero(holds)
        first = first[np.unique(roots[one[first]], return_index=True)[1]]
        used.hold(roots[one[first]], held[first])
    able = np.flatnonzero(free.any(axis=1))
    first = able[np.sort(np.unique(key[able], return_index=True)[1])]
    order = np.argsort(key[first])
    able = np.flatnonzero(np.isin(key, key[first]))
    owner = np.full(len(surface.nodes), -1)
    owner[tried[able]] = order[np.searchsorted(key[first], key[able], sorter=order)]
    share = distribute_to_neighbours(surface, owner, facing, len(first))
    return MultiplierNodes(share=share, directions=turned[first], free=free[first])


def _independent(directions: Array, bases: Array, held: Array) -> tuple[Array, Bools, Array]:
    """Turn directions so that those of free motion, independent of what is held, come first.

    Args:
        directions: (n, c, d).
        bases: (n, d, d) motions that supports leave free.
        held: (n, d, d) projectors onto the motions that other multipliers hold.

    Returns:
        Directions (n, c, d), which of them are free (n, c), and the projectors onto all that is held then (n, d, d).
    """
    turned, free = directions.copy(), np.ones(directions.shape[:2], bool)
    across = held + np.swapaxes(directions, 1, 2) @ directions
    plain = (bases == np.eye(bases.shape[1])).all(axis=(1, 2)) & (np.abs(directions @ held) < EXACT).all(axis=(1, 2))
    at = np.flatnonzero(~plain)
    turned[at], free[at], across[at] = _turned(directions[at], bases[at], held[at])
    return turned, free, across


def _turned(directions: Array, bases: Array, held: Array) -> tuple[Array, Bools, Array]:
    """The same where supports or other multipliers hold something of the directions."""
    motion = directions @ bases  # (n, c, d): free motion seen in each direction
    left, size, _ = np.linalg.svd(motion - motion @ held)
    free = size > CLOSE  # sine of the angle below which directions count as parallel
    left[free.all(axis=1)] = np.eye(directions.shape[1])
    turned = np.swapaxes(left, 1, 2) @ directions
    every = np.concatenate([held, free[:, :, None] * (turned @ bases)], axis=1)
    return turned, free, np.linalg.pinv(every, rcond=ROUNDING) @ every


def distribute_to_neighbours(surface: Surface, owner: Ints, facing: Bools, count: int) -> Sparse:
    """Distribute each node without a multiplier equally among its nearest neighbours that have one.

    Args:
        surface: of n nodes.
        owner: (n,) number of each node's multiplier, -1 without one.
        facing: (n,) nodes that face the other side; the others are not distributed.
        count: number of multipliers.

    Returns:
        Shares (count, n) of the multipliers in the nodes.
    """
    own = np.flatnonzero(owner >= 0)
    share: Sparse = sparse.csr_matrix((np.ones(len(own)), (own, owner[own])), shape=(len(owner), count))
    missing = (owner < 0) & facing
    neighbours = surface.neighbours if missing.any() else None
    while missing.any():
        near = neighbours @ sparse.diags((~missing & facing).astype(float))
        total = np.asarray(near.sum(axis=1)).ravel()
        layer = missing & (total > 0)
        if not layer.any():
            break
        share = share + sparse.diags(layer / np.maximum(total, 1)) @ (near @ share)
        missing &= ~layer
    return share.T.tocsr()


LEANS = 0.98  # cosine of the largest angle by which a normal at a surface's edge is turned into a symmetry plane


def build_rows(
    contacts: Mapping[str, tuple[Contact, Coupling]],
    constraints: Constraints,
    moved: Mapping[str, Array],
    end: float,
    softest: Mapping[str, float],
) -> list[ContactRows]:
    """Rows of all contacts; a law of compliance acts at nodes where it is stiffer than the cells behind the side.

    Args:
        contacts: scene table and coupling, by name.
        constraints: supports and periodicity.
        moved: by name of a sliding contact, the displacement (n_all, d) [m] of its nodes at which its gap was measured.
            Its relative part is added, so that the gap belongs to displacements counted from the start.
        end: last time of the scene [s].
        softest: by name, smallest Young's modulus of its bodies [Pa].

    Raises:
        SceneError: supports leave a contact no node that can carry a pressure.
    """
    contacts = _told_once({name: (contact, _folded(coupling)) for name, (contact, coupling) in contacts.items()})
    against_obstacles = HeldMotions(constraints.dim)
    used = {name: HeldMotions(constraints.dim) if c.master else against_obstacles for name, (_, c) in contacts.items()}
    frames = {
        name: frames_of(_normals_in_symmetry_planes(coupling, constraints)) for name, (_, coupling) in contacts.items()
    }
    normal_carriers = {
        name: place_multipliers(coupling, frames[name][:, :1], constraints, used[name])
        for name, (contact, coupling) in contacts.items()
        if not contact.normal.at_quadrature
    }
    found = []
    for name, (contact, coupling) in contacts.items():
        weights, (friction, slide) = coupling.weights, contact.law(coupling.surface.axisymmetric)
        of_points: Sparse | None = None
        degree = contact.degree(coupling.surface.degree)
        known = 0.0 if contact.normal.ties else contact.gap
        gap = coupling.gap if known is None else np.full_like(coupling.gap, known)
        if contact.normal.at_quadrature:
            points = coupling.points(degree)
            N_n = along(points.relative, points.normals[:, None])
            folded = points if coupling.surface.images is None else points.moved(coupling.surface.fold)
            W_n, psi, phi = points.weights, folded.psi, folded.phi
            gap_n = points.gap if known is None else np.full_like(points.gap, known)
            to_points, directions = points.own.basis(coupling.surface), points.normals
            give = contact.normal.penetration(np.array([softest[name]]))
            if np.all(give < coupling.surface.facet_size) and (nodal := folded.at_nodes(N_n)) is not None:
                of_points, psi, phi = nodal
                W_n, gap_n, directions = phi.sum(axis=0).A1, of_points @ gap_n, of_points @ directions
                N_n, to_points = (of_points @ N_n).tocsr(), of_points @ to_points
                directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
            dropped = 0
        else:
            carrier = normal_carriers[name]
            if not carrier.share.shape[0] and weights.any() and not contact.surface.endswith(SKIN):
                raise SceneError(
                    f"contacts.{name}: supports prescribe the normal motion of all of {contact.surface}, so it can "
                    "carry no contact pressure; free it or remove the contact"
                )
            N_n, W_n = carrier.rows(coupling)
            if coupling.turning is not None:
                N_n = (carrier.mean(weights)[0] @ coupling.turning).tocsr()
            directions = carrier.directions[:, 0]
            psi = phi = carrier.share.T.multiply(weights[:, None]).tocsr()
            to_points = carrier.mean(weights)[0] @ coupling.surface.transform
            gap_n = carrier.mean(weights)[0] @ gap
            dropped = int(np.sum(weights != 0)) - len(W_n)
        if friction is not None:
            carrier = place_multipliers(coupling, frames[name][:, 1:], constraints, used[name])
            dropped += int(np.sum(weights != 0)) - carrier.share.shape[0]
            if friction.orthotropic:
                with prefixed(f"contacts.{name}.friction"):
                    carrier = replace(carrier, directions=friction.directions(carrier.directions, carrier.free))
        else:
            carrier = _no_friction(coupling)
        N_t, W_t = carrier.rows(coupling)
        if contact.wear is not None and slide is None and weights.any() and not len(W_t):
            raise SceneError(
                f"contacts.{name}.wear: supports hold all of {contact.surface} along the surface, so that no slip is "
                "measured there; free it, or prescribe slide"
            )
        if name in moved:
            gap_n = gap_n + N_n @ moved[name].ravel()
            gap = gap + coupling.closing(moved[name])
        place = coupling.surface.points
        start = place - moved[name][: len(place)] if name in moved else place
        to_tangential = carrier.mean(weights)[0] if len(W_t) else carrier.share
        fields = Fields(
            gap_offset=contact.gap_offset, law=friction, points=start, to_nodes=coupling.surface.transform,
            to_points=to_points, to_tangential=to_tangential, end=end, slide=slide, wear=contact.wear,
            initial=contact.initial,
        )  # fmt: skip
        with prefixed(f"contacts.{name}"):
            offset, node_offset = fields.offsets(0.0)
            law = fields.law_at(0.0)
        found.append(
            ContactRows(
                name=name, surface=coupling.surface, master=coupling.master, normal=contact.normal, friction=law,
                frames=frames[name], node_weights=weights, node_gap=node_offset + gap, node_distance=coupling.gap,
                relative=coupling.relative, turning=coupling.turning,
                N_n=N_n, W_n=W_n, normals=directions, gap=offset + gap_n, N_t=N_t, W_t=W_t,
                tangents=carrier.directions, free=carrier.free, psi=psi, phi=phi, share_t=carrier.share,
                dropped=dropped, quadrature=coupling.points, degree=degree, of_points=of_points, fields=fields,
                tips=coupling.tips,
            )
        )  # fmt: skip
    return found


def _told_once(contacts: Mapping[str, tuple[Contact, Coupling]]) -> dict[str, tuple[Contact, Coupling]]:
    """The same contacts; where sides of the same two bodies meet, a motion that several see is left to one of them.

    That is one which ties, or the first; the others' parts go to their neighbours.
    """
    found, together = dict(contacts), dict[frozenset[str], list[str]]()
    for name in sorted(found, key=lambda name: not found[name][0].normal.ties):
        contact, coupling = found[name]
        bodies = frozenset(side.partition(".")[0] for side in (contact.surface, str(contact.against)))
        for before, earlier in (found[other] for other in together.setdefault(bodies, [])):
            alike = before.normal.ties or (before.gap, before.gap_offset) == (contact.gap, contact.gap_offset)
            if coupling.master and earlier.master and alike:
                carries = coupling.carries & ~_seen(coupling, earlier, bool(before.normal.ties))
                coupling = replace(coupling, carries=carries)
        found[name] = contact, coupling
        together[bodies].append(name)
    return found


def _seen(coupling: Coupling, earlier: Coupling, whole: bool) -> Bools:
    """Nodes (n,) whose relative displacement is that of a carrier of another coupling, of either sign.

    Args:
        whole: whether that one holds all of it, not its part along the normal alone.
    """
    nodes = [np.append(c.surface.nodes, [] if c.master is None else c.master.nodes) for c in (coupling, earlier)]
    numbers = np.unique(np.concatenate(nodes))
    rows = []
    for c, own in zip((coupling, earlier), nodes, strict=True):
        onto = sparse.csr_matrix((np.ones(len(own)), (np.arange(len(own)), np.searchsorted(numbers, own))))
        onto.resize(len(own), len(numbers))
        size = np.sqrt((c.relative @ onto).power(2).sum(axis=1).A1)
        rows.append(sparse.diags(c.carries / np.maximum(size, TINY)) @ c.relative @ onto)
    same = abs(rows[0] @ rows[1].T).tocoo()
    parallel = np.abs(np.einsum("kd,kd->k", coupling.normals[same.row], earlier.normals[same.col]))
    seen = (same.data > 1 - ROUNDING) & (whole | (parallel > np.cos(np.radians(SMOOTH))))
    return np.isin(np.arange(len(coupling.carries)), same.row[seen])


def _folded(coupling: Coupling) -> Coupling:
    """The same coupling, where nodes of a cyclic sector carry what their turned images would: these have no weight."""
    fold = coupling.surface.fold
    if coupling.surface.images is None:
        return coupling
    return replace(coupling, weights=fold @ coupling.weights, carries=coupling.carries & (fold.diagonal() > 0))


def _normals_in_symmetry_planes(coupling: Coupling, constraints: Constraints) -> Array:
    """Normals (n, d) to a body, turned into the symmetry planes that supports hold nodes in.

    At the surface's edge an averaged normal has facets on one side only, and so leans out of that plane.
    """
    if not coupling.master:
        return coupling.normals
    bases, free = constraints.bases(coupling.surface.nodes)
    inside = np.einsum("nik,njk,nj->ni", bases, bases, coupling.normals)
    length = np.linalg.norm(inside, axis=1)
    turned = ~free.all(axis=1) & (length > LEANS)
    normals = coupling.normals.copy()
    normals[turned] = inside[turned] / length[turned, None]
    return normals


def _no_friction(coupling: Coupling) -> MultiplierNodes:
    """No node carries a tangential multiplier."""
    n, d = coupling.surface.points.shape
    return MultiplierNodes(
        share=sparse.csr_matrix((0, n)), directions=np.zeros((0, d - 1, d)), free=np.zeros((0, d - 1), bool)
    )
