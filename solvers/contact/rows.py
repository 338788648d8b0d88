"""The rows of one contact: its multipliers' points, their weights, and the relative displacement they measure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stickslip.geometry.arrays import ROUNDING, TINY, Array, Bools, Ints
from stickslip.geometry.curved_facets import SHARP
from stickslip.geometry.errors import prefixed
from stickslip.geometry.field import Field, in_time, values
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.surfaces.surface import SECTOR, Surface, in_sectors
from stickslip.solvers.contact.coupling import Points
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw
from stickslip.solvers.laws.rate_and_state import STEADY
from stickslip.solvers.laws.wear import Slide, Wear, Worn
from stickslip.solvers.scene.contact import Initial


@dataclass(frozen=True, kw_only=True)
class Fields:
    """What a scene gives a contact by place and time: its gap offset, its friction law, how it slides and wears."""

    gap_offset: Field
    law: FrictionLaw | None
    points: Array  # (n, d) [m] of the slave's nodes at the start
    to_nodes: Sparse  # (n, n) values there to nodal values of the gap
    to_points: Sparse  # (m_n, n) and to values at the normal points
    to_tangential: Sparse  # (m_t, n) and to values at the tangential points
    end: float  # last time of the scene [s]
    slide: Slide | None = None  # out of the plane; None: not at all
    wear: Wear | None = None
    initial: Initial | None = None

    @property
    def change(self) -> bool:
        """Whether one of them changes in time."""
        return bool(in_time(self.gap_offset, "") or (self.law is not None and self.law.changes))

    def offsets(self, time: float) -> tuple[Array, Array]:
        """Gap offset at the normal points (m_n,) and at the nodes (n,) [m]; one number () where it is uniform."""
        found = values(self.gap_offset, "gap_offset", self.points, time, self.end)
        return (found, found) if not found.ndim else (self.to_points @ found, self.to_nodes @ found)

    def law_at(self, time: float) -> FrictionLaw | None:
        """The law with its parameters at the tangential points."""
        return self.law and self.law.placed(self.to_tangential @ self.points, time, self.end)


def of_both(surface: Surface, master: Surface | None) -> Bools:
    """Nodes (n,) of a slave surface that the master has, too: the ends of a crack, which cannot open.

    They carry no contact; their neighbours carry theirs. In a corner, whose faces do not lie on each other, they do.
    """
    if master is None or not (shared := np.isin(surface.nodes, master.nodes)).any():
        return np.zeros(len(surface.nodes), bool)
    found, same = np.zeros(len(shared), bool), surface.nodes[shared, None] == master.nodes
    opposed = surface.node_normals()[shared] @ master.node_normals().T < -np.cos(np.radians(SHARP))
    found[shared] = (same & opposed).any(axis=1)
    return found


@dataclass(frozen=True, kw_only=True)
class ContactRows:
    """m_n normal points, m_t tangential points, n nodes of the slave surface and n_all with the master's, d dimensions.

    `N_n` and `N_t` act on the displacement of `nodes`, flattened (n_all d), relative to a rigid obstacle if it is one.
    """

    name: str
    surface: Surface  # slave
    master: Surface | None  # None: a rigid obstacle
    normal: NormalLaw
    friction: FrictionLaw | None
    frames: Array  # (n, d, d): row 0 the normal n, then the tangents
    node_weights: Array  # (n,) [m^(d-1)], 0 where no other side faces a node
    node_gap: Array  # (n,) [m], gap_offset included; like all nodal values in the basis phi~ of `Surface`
    node_distance: Array  # (n,) [m] from the other side where it was searched, without gap_offset
    relative: Sparse  # (n, n_all): displacement of `nodes` to relative displacement at the slave's nodes
    N_n: Sparse  # (m_n, n_all d)
    W_n: Array  # (m_n,) weights [m^(d-1)]
    normals: Array  # (m_n, d) directions of the rows of N_n, unit
    gap: Array  # (m_n,) [m], positive when open
    N_t: Sparse  # (m_t (d-1), n_all d)
    W_t: Array  # (m_t,) weights [m^(d-1)]
    tangents: Array  # (m_t, d-1, d) at the tangential points, unit unless the law is orthotropic
    free: Bools  # (m_t, d-1) tangential directions that carry a multiplier
    psi: Sparse  # (n, m_n): values at the normal points to integrals ∫ psi_j, psi_j the dual basis, by node
    phi: Sparse  # (n, m_n): likewise to integrals ∫ phi~_j, of rigid laws psi; no entry is negative
    share_t: Sparse  # (m_t, n): which nodes a tangential point stands for; columns add up to 1
    dropped: int  # nodes whose multiplier a support or another contact makes redundant, or that end a crack
    quadrature: Callable[[int], Points] | None = None  # integration points by degree; None: the rows are given without
    degree: int = 0  # of that at which a compliance law gives pressure by displacement
    of_points: Sparse | None = None  # (m_n, q) see `Points.at_nodes`; None: the normal points are those of quadrature
    turning: Sparse | None = None  # (n, n_all d) see `Coupling`
    fields: Fields | None = None  # None: the rows are given without
    tips: Array | None = None  # (n,) see `Coupling`
    near: Bools | None = None  # (n_all,) of skins the nodes that may touch; None: all
    time: float = 0.0  # that `gap`, `node_gap` and `friction` are of [s]
    sense: float = (
        1.0  # -1 where the side that the scene calls `surface` is the master: vectors are reported as its own
    )

    def at(self, time: float) -> ContactRows:
        """The rows with the gap and the friction law of another time [s]."""
        if self.fields is None or time == self.time or not self.fields.change:
            return self
        return self.with_fields(self.fields, time)

    def with_fields(self, fields: Fields, time: float) -> ContactRows:
        """The rows with another gap offset and friction law, at a time [s]."""
        assert self.fields is not None
        pairs = zip(fields.offsets(time), self.fields.offsets(self.time), strict=True)
        wider, nodes_wider = (new - old for new, old in pairs)
        gap, node_gap = self.gap + wider, self.node_gap + nodes_wider
        return replace(self, gap=gap, node_gap=node_gap, friction=fields.law_at(time), fields=fields, time=time)

    @cached_property
    def initial(self) -> tuple[Array, Array]:
        """Pressures (m_n,) and tangential tractions (m_t, d-1) [Pa] at t = 0; what supports hold carries none."""
        p, given = np.zeros(len(self.W_n)), self.fields.initial if self.fields else None
        if given is not None and self.fields is not None:
            p += values(given.pressure, "pressure", self.fields.to_points @ self.fields.points, 0.0, self.fields.end)
        return p, self._shear() * self.free

    def _shear(self) -> Array:
        """The latter, of supports that hold nothing."""
        given = self.fields.initial if self.fields else None
        if given is None:
            return np.zeros(self.free.shape)
        if isinstance(given.traction, float | int):  # of a plane model: along the axis that is nearest to the tangent
            axis = np.abs(self.tangents).argmax(axis=2)[..., None]
            return self.sense * given.traction * np.sign(np.take_along_axis(self.tangents, axis, axis=2))[..., 0]
        return np.asarray(self.sense * self.tangents @ np.array(given.traction))

    def first_memory(self) -> Array:
        """What the law remembers of points at t = 0."""
        law, fields = self.friction, self.fields
        assert law is not None
        found = law.memory(len(self.W_t))
        if fields is None or fields.initial is None:
            return found
        with prefixed(f"contacts.{self.name}.initial"):
            state, at = fields.initial.state, fields.to_tangential @ fields.points
            theta = state if state is None or state == STEADY else values(state, "state", at, 0.0, fields.end)
            pressure, size = np.asarray(self.average @ self.initial[0]), np.linalg.norm(self._shear(), axis=1)
            return law.begun(found, pressure, size, theta, fields.initial.rate)

    @property
    def slides(self) -> bool:
        """Whether sliding out of the plane is prescribed."""
        return self.fields is not None and self.fields.slide is not None

    @property
    def wears(self) -> bool:
        """Whether points lose depth by sliding."""
        return self.fields is not None and self.fields.wear is not None

    def path(self, slip: Array | None, time: float, step: float) -> Array:
        """Length (m_n,) [m] by which the normal points slide in a step of a length [s] up to a time [s].

        Args:
            slip: of the tangential points in the step (m_t,) [m]; None: what is prescribed counts alone.
        """
        assert self.fields is not None
        own, aside = np.zeros(len(self.W_n)), np.zeros(len(self.W_n))
        if self.fields.slide is not None:
            points = np.asarray(self.fields.to_points @ self.fields.points)
            aside = self.fields.slide.within(points, time, step, self.fields.end)
        if slip is not None:
            near = self.average.T @ self.W_t
            own = np.divide(self.average.T @ (self.W_t * slip), near, out=own, where=near > 0)
        return np.hypot(own, aside)

    def wear_rate(self, time: float, pressed: Array | None, slid: Array | None) -> Array:
        """Worn depth by pressure and length of slip (m_n,) [1/Pa], see `Wear.rate`."""
        assert self.fields is not None
        assert self.fields.wear is not None
        points = np.asarray(self.fields.to_points @ self.fields.points)
        with prefixed(f"contacts.{self.name}"):
            return self.fields.wear.rate(points, time, self.fields.end, pressed, slid)

    def worn(self, depth: Array, softness: Array | None = None) -> ContactRows:
        """The rows with gaps that are wider by a worn depth (m_n,) [m].

        Args:
            softness: of a step in which they wear on, worn depth by pressure in it (m_n,) [m/Pa].
        """
        law = self.normal if softness is None else Worn(of=self.normal, softness=softness)
        return replace(self, gap=self.gap + depth, node_gap=self.node_gap + self.node_pressure(depth), normal=law)

    @cached_property
    def nodes(self) -> Ints:
        """Global numbers (n_all,): the slave's, then the master's."""
        return np.concatenate([self.surface.nodes, self.master.nodes]) if self.master else self.surface.nodes

    @cached_property
    def of_facets(self) -> bool:
        """Whether its normal points are those of whole facets, u_n there its own, as a form over the side has them."""
        return self.of_points is None and len(self.W_n) == self.surface.quadrature(self.degree)[0].size

    def at_points(self, values: Array | Sparse) -> Array | Sparse:
        """Values (m_n, ...) at the normal points from those (q, ...) at the integration points of a compliance law."""
        return values if self.of_points is None else self.of_points @ values

    @cached_property
    def near_nodes(self) -> Ints:
        """Those of `nodes` that may touch."""
        return self.nodes if self.near is None else self.nodes[self.near]

    @cached_property
    def input(self) -> Ints:
        """Their numbers in the gmsh model (n_all,)."""
        return np.concatenate([self.surface.input, self.master.input]) if self.master else self.surface.input

    @cached_property
    def _spread(self) -> tuple[Sparse, Sparse]:
        """N_n^T and N_t^T, which scipy makes anew at each access."""
        return self.N_n.T, self.N_t.T

    @cached_property
    def ends(self) -> Bools:
        """Nodes (n,) of the slave, facing the other side, at which both sides of one body end; see `of_both`."""
        return np.asarray(of_both(self.surface, self.master) & (self.node_weights != 0))

    def of_mesh(self, values: Array, sectors: Array) -> Array:
        """Vectors (n_all, d) at its nodes, from those at all nodes of the gmsh model; see `in_sectors`."""
        return in_sectors(values[self.input % SECTOR], self.input, sectors)

    @property
    def part(self) -> Ints:
        """Their parts of the mesh (n_all,)."""
        return np.concatenate([self.surface.part, self.master.part]) if self.master else self.surface.part

    @cached_property
    def points(self) -> Array:
        """Their coordinates (n_all, d) [m]."""
        return np.concatenate([self.surface.points, self.master.points]) if self.master else self.surface.points

    @cached_property
    def average(self) -> Sparse:
        """(m_t, m_n): pressure at normal points to its averages at tangential points; no weight is negative.

        They are those with phi~_j: a node's bound is mu times the normal force there, and the bounds add up to mu N.
        """
        return (self.share_t @ self.phi).multiply(1 / self.W_t[:, None]).tocsr()

    def node_pressure(self, p_n: Array) -> Array:
        """Pressure (n,) [Pa] at the surface's nodes from that at the normal points (m_n,), with the same resultant."""
        return self._per_weight(self.psi @ p_n)

    def node_traction(self, t: Array) -> Array:
        """Tangential multiplier (n, d) [Pa], Cartesian, at the surface's nodes, from t (m_t, d-1); sigma_T = -t."""
        return np.asarray(self.share_t.T @ np.einsum("mc,mcd->md", t * self.free, self.tangents))

    def normal_of_nodes(self, pressure: Array) -> Array:
        """Pressure at normal points (m_n,) from that of the nodes (n,): the transpose of `node_pressure`, weighted."""
        spread = self.psi.T @ pressure
        total = self.psi.T @ np.ones(len(pressure))
        return np.asarray(np.divide(spread, total, out=np.zeros_like(spread), where=np.abs(total) > 0))

    def tangential_of_nodes(self, traction: Array) -> Array:
        """Multiplier t (m_t, d-1) from a Cartesian one at the nodes (n, d): each point takes its nodes' mean."""
        d = self.surface.dim
        if not len(self.W_t):
            return np.zeros((0, d - 1))
        along = self.tangents
        if self.friction is not None and self.friction.orthotropic:
            along = along / (along**2).sum(axis=2, keepdims=True)
        return np.asarray(np.einsum("mcd,md->mc", along, self.tangential_mean(traction)))

    def tangential_mean(self, values: Array) -> Array:
        """Mean (m_t, ...) at each tangential point of values (n, ...) at the nodes that it stands for."""
        return np.asarray(self.share_t.multiply(1 / np.maximum(self.share_t.sum(axis=1), TINY)) @ values)

    def along_traction(self, bound: Array, t: Array) -> Array:
        """Friction bounds (m_t,) [Pa] in the directions of t (m_t, d-1): those of an orthotropic law differ."""
        if self.friction is None or not self.friction.orthotropic:
            return bound
        size = np.linalg.norm(t * self.free, axis=1)
        true = np.linalg.norm(np.einsum("mc,mcd->md", t * self.free, self.tangents), axis=1)
        # of the friction bound; smaller tractions have no direction
        return np.asarray(bound * np.divide(true, size, out=np.ones_like(size), where=size > ROUNDING * bound))

    def _per_weight(self, values: Array) -> Array:
        weights = self.node_weights.reshape(-1, *[1] * (values.ndim - 1))
        return np.divide(values, weights, out=np.zeros_like(values), where=weights > 0)

    def nodal_forces(self, p_n: Array, t: Array) -> Array:
        """Nodal forces B^T p (n_all, d) [N] of pressures p_n (m_n,) and multipliers t (m_t, d-1) [Pa].

        The force on the bodies is their negative.
        """
        normal, tangential = self._spread
        total = normal @ (self.W_n * p_n)
        if len(self.W_t):
            total = total + tangential @ (t.reshape(len(self.W_t), -1) * self.W_t[:, None]).ravel()
        return np.asarray(total.reshape(self.points.shape))

    def node_motion(self, moved: Array) -> tuple[Array, Array]:
        """Normal (n,) and tangential (n, d) relative displacement [m] of the slave's nodes.

        Args:
            moved: displacement (n_all, d) [m] of `nodes`.
        """
        relative = self.relative @ moved
        along = np.einsum("nd,nd->n", self.frames[:, 0], relative)
        return along if self.turning is None else self.turning @ moved.ravel(), self.tangential_part(relative)

    def tangential_part(self, relative: Array) -> Array:
        """Tangential part (n, d) of vectors (n, d) at the slave's nodes."""
        normal = np.einsum("nd,nd->n", self.frames[:, 0], relative)
        return np.asarray(relative - normal[:, None] * self.frames[:, 0])
