"""What the audit writes a second time: the fields of a step's file, of displacement and tractions, and the forces of
multipliers of a contact with a rigid obstacle, by UFL forms.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CLOSE, EPS, ROUNDING, AnyArray, Array, Ints, inverses
from stickslip.geometry.protocols import Vec
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.fem.elastic_energy import stress_by_compliance
from stickslip.solvers.scene.material import Material, Orthotropic
from stickslip.solvers.scene.record import OPEN, SLIP, STICK
from stickslip.solvers.system.nodal_contact import NodalContact, traction_fields
from stickslip.solvers.system.system import System


@dataclass(frozen=True, kw_only=True)
class StoredFields:
    """Fields that are written for readers, beside the state; empty where they are not to be judged."""

    stress: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))  # (cells, 3, 3), by number in gmsh's model [Pa]
    von_mises: Array = field(default_factory=lambda: np.zeros(0))  # (cells,) [Pa]
    contacts: Mapping[str, Mapping[str, AnyArray]] = field(default_factory=dict)  # by contact, as in `ContactState`
    moments: Mapping[str, Array] = field(default_factory=dict)  # by contact, as reported [N m]
    told: Mapping[str, Any] = field(default_factory=dict)  # all numbers of the step, as result.json has them
    law_error: float = 0.0  # that the method states of its approximate contact laws, see `StepResult`
    told_before: Mapping[str, Any] = field(default_factory=dict)  # and those of the step before; empty: it is the first


@dataclass(frozen=True, kw_only=True)
class Record:
    """One step as its file holds it: what is audited."""

    time: float  # [s]
    displacement: Array  # (nodes, d) in the order of the gmsh model [m]
    p: Array  # (rows,) tractions, flat [Pa]
    w: Array  # (rows,) relative displacement, flat [m]
    reference: Array  # (rows,) w at the start of the last substep [m]: slip counts from it; gaps are recomputed
    driven: Array  # (o,) displacement of the obstacles that forces drive, by `Problem.driven` [m]
    shortened: Array  # (b,) that are found: shortening of bolts by force, slack of springs of one way [m]
    searched: Mapping[str, Array]  # by sliding contact, displacement (n_all, d) [m] that its pairs were searched at
    memory: Mapping[str, Array] = field(default_factory=dict)  # see `State.memory`; contacts without a memory have none
    stored: StoredFields = field(default_factory=StoredFields)  # fields for the reader; by default none is judged

    @classmethod
    def of(cls, step: object) -> Record:
        """The record of a step that has these fields, as `StepResult`; without fields for the reader."""
        return cls(**{f.name: getattr(step, f.name) for f in fields(cls) if f.name != "stored"})

    @property
    def finite(self) -> bool:
        """Whether every number of it is one, and none is infinite but the bound of what is tied."""
        state = (self.displacement, self.p, self.w, self.reference, self.driven, self.shortened)
        every = (*state, *self.searched.values(), *self.memory.values(), self.stored.stress, self.stored.von_mises)
        shown = (values for fields in self.stored.contacts.values() for values in fields.values())
        numbers = (values for values in shown if isinstance(values, np.ndarray) and values.dtype.kind == "f")
        return all(np.isfinite(values).all() for values in every) and not any(np.isnan(n).any() for n in numbers)


def difference(found: Array, expected: Array, scale: float = 0.0, rounding: float = 0.0) -> float:
    """Largest difference beyond rounding [-], relative to the largest value, or to `scale` if that is larger."""
    largest = max(scale, float(np.abs(expected).max(initial=0.0)), float(np.abs(found).max(initial=0.0)))
    apart = float(np.abs(found - expected).max(initial=0.0)) - rounding
    return max(apart, 0.0) / largest if largest else 0.0


def contact_differences(
    rows: ContactRows,
    stored: Mapping[str, AnyArray],
    p_n: Array,
    t: Array,
    bound: Array,
    node_gap: Array,
    moved: Array,
    p_top: float,
    u_top: float,
    rounding: float,
    noise: float,
    exact: bool,
) -> Iterator[float]:
    """Differences of the stored fields of a contact, slip apart [-]; tractions also as forces on the nodes of bodies.

    Args:
        stored: by name, on the n nodes of the slave side.
        p_n: pressures (m_n,) [Pa].
        t: tangential multipliers (m_t, d-1) [Pa].
        bound: of t (m_t,) [Pa].
        node_gap: initial gaps (n,) [m].
        moved: displacement (n_all, d) [m] of the nodes, less that of a rigid obstacle.
        p_top: scale of tractions [Pa].
        u_top: scale of motions [m].
        rounding: of lengths [m].
        noise: of tractions [Pa]; a node that is open may have a pressure of that size.
        exact: whether the method's friction laws are; if not, points below their bound count as slipping.
    """
    d, weights = rows.surface.dim, np.where(rows.node_weights > 0, rows.node_weights, np.inf)
    pressure = (rows.psi @ p_n) / weights
    traction = -rows.sense * (rows.share_t.T @ np.einsum("mc,mcd->md", t * rows.free, rows.tangents))
    finite = np.isfinite(bound)
    nodal = rows.share_t.T @ np.where(finite, bound, 0.0)
    judged = (rows.share_t.T @ (~finite).astype(float) == 0) & (nodal > 0)
    closing = rows.node_motion(moved)[0]
    lam = np.asarray(stored["lam"], float)[:, :d] * nodal[:, None]
    yield difference(np.asarray(stored["weight"], float), rows.node_weights)
    yield difference(np.asarray(stored["pressure"], float), pressure, p_top)
    shown = np.asarray(stored["traction"], float)[:, :d]
    yield difference(shown, traction, p_top)
    felt = -rows.sense * (rows.N_t.T @ (t * rows.W_t[:, None]).ravel()).reshape(-1, d)  # by the nodes of both sides [N]
    yield difference(rows.relative.T @ (rows.node_weights[:, None] * shown), felt, p_top * rows.node_weights.max())
    yield difference(lam[judged], -traction[judged], p_top)
    yield difference(np.asarray(stored["gap"], float), node_gap - closing, rounding=rounding)
    status, size = stored["status"], np.linalg.norm(shown, axis=1)
    slid = np.linalg.norm(np.asarray(stored["slip_increment"], float), axis=1)
    limit = np.where(rows.share_t.T @ (~finite).astype(float) > 0, np.inf, nodal)
    wrong = (status != OPEN) & (pressure <= 0) & (rows.normal.sides == 1)
    if not limit.any() or not (rows.friction is None or rows.friction.rests):
        wrong |= status == STICK
    elif exact:
        known = CLOSE * p_top * rows.slides  # what is left in the plane may be far less than what iterations leave
        wrong |= (status == SLIP) & ((size + known < limit * (1 - 2 * CLOSE)) | ((slid == 0) & (not rows.slides)))
        wrong |= (status == STICK) & (size >= limit * (1 - CLOSE / 2)) & (slid > CLOSE * u_top)
    yield float(wrong.any() and np.abs(p_n).max(initial=0.0) > noise)
    # where the edge of contact crosses a facet, dual means of compliant pressures may be below zero beside it
    yield max(float(pressure[status == OPEN].max(initial=0.0)) - noise, 0.0) / p_top


def slip_of(rows: ContactRows, moved: Array) -> Array:
    """Tangential displacement (n, d) [m] of `surface` relative to the other side at the slave's nodes.

    Args:
        moved: displacement (n_all, d) [m].
    """
    n, relative = rows.frames[:, 0], rows.relative @ moved
    return np.asarray(rows.sense * (relative - (relative * n).sum(axis=1, keepdims=True) * n))


def stress_difference(system: System, displacement: Array, time: float, stored: StoredFields) -> float:
    """Largest difference of the stored stress and equivalent stress from those of the displacement [-]; collective.

    Args:
        displacement: (nodes, d) in the order of the gmsh model [m].
        time: of the initial strains [s].
    """
    mesh = system.mesh
    count = mesh.domain.topology.index_map(mesh.dim).size_local
    numbers = np.asarray(mesh.domain.topology.original_cell_index)[:count]
    expected, rounding = stress_again(system, displacement, time, np.arange(count), dx.midpoint(mesh.domain))
    a, b, c = (expected[:, i, i] - expected[:, i - 1, i - 1] for i in range(3))
    shear = expected[:, 0, 1] ** 2 + expected[:, 1, 2] ** 2 + expected[:, 0, 2] ** 2
    equivalent = np.sqrt((a**2 + b**2 + c**2) / 2 + 3 * shear)
    apart = np.abs(stored.stress[numbers] - expected).max(axis=(1, 2), initial=0.0)
    apart = np.maximum(apart, np.abs(stored.von_mises[numbers] - equivalent)) - rounding
    largest, worst = (
        max(system.mesh.comm.allgather(float(values.max(initial=0.0)))) for values in (np.abs(expected), apart)
    )
    return worst / largest if largest else float(worst > 0)


def stress_again(system: System, displacement: Array, time: float, own: Ints, local: Array) -> tuple[Array, Array]:
    """Stress (c, 3, 3) [Pa] of a displacement in cells of this rank, and what of it (c,) is rounding; collective.

    Args:
        displacement: (nodes, d) in the order of the gmsh model [m].
        time: of the initial strains [s].
        own: (c,) cells.
        local: coordinates (1, d) of the same point of each on the reference cell.
    """
    mesh, problem, d = system.mesh, system.problem, system.mesh.dim
    dofs = dx.cell_dofs(system.space)[own]
    basis, slope = dx.reference_basis(mesh.domain.topology.cell_type.name, mesh.degree, local)
    x, u = system.nodes.points[dofs], displacement[system.nodes.input[dofs]]
    jacobian, change = (np.swapaxes(slope[:, 0] @ values, 1, 2) for values in (x, u))
    strain, reach = np.zeros((len(own), 3, 3)), np.abs(u).max(axis=(1, 2), initial=0.0)
    inverse = inverses(jacobian)
    strain[:, :d, :d] = change @ inverse
    if mesh.axisymmetric:
        radius = x[:, :, 0] @ basis[0]
        off = radius > ROUNDING * system.extent  # on the axis u_r / r is its limit
        strain[:, 2, 2] = np.where(off, u[:, :, 0] @ basis[0], strain[:, 0, 0]) / np.where(off, radius, 1.0)
    strain = (strain + np.swapaxes(strain, 1, 2)) / 2
    values, places = system.initial.values(system.course, time), np.einsum("n,cnd->cd", basis[0], x)
    everywhere = system.vector()
    everywhere.array[:] = displacement[system.nodes.input[: system.nodes.owned]].ravel()
    means = system.dilatation.at_midpoints(everywhere, system.dilatation.functions())
    expected, modulus = np.zeros_like(strain), np.zeros(len(own))
    tags = np.zeros(mesh.domain.topology.index_map(d).size_local, np.int64)
    known = mesh.cell_tags.indices < len(tags)
    tags[mesh.cell_tags.indices[known]] = mesh.cell_tags.values[known]
    for name, body in problem.bodies.items():
        inside = tags[own] == mesh.bodies[name]
        elastic, grown = strain[inside], np.zeros(np.count_nonzero(inside))
        for number, given in enumerate(system.initial.strains):
            if given.body == name:
                cells = own[inside]
                at = system.initial.at(number, places[inside], cells, system.course.timeline)
                elastic = elastic - values[number] * at
                grown += values[number] * system.initial.dilatation(number, at, cells)
        if isinstance(body, Orthotropic):
            expected[inside] = stress_by_compliance(body, elastic, problem.model == "plane stress")
            modulus[inside] = np.abs(body.stiffness).max()
            continue
        assert isinstance(body, Material)
        volume = np.trace(elastic, axis1=1, axis2=2)
        if name in means:
            volume = means[name][own[inside]] - grown
        if problem.model == "plane stress":
            elastic[:, 2, 2] = -body.nu / (1 - body.nu) * (elastic[:, 0, 0] + elastic[:, 1, 1])
            volume = np.trace(elastic, axis1=1, axis2=2)
        spherical = body.nu / body.give * volume
        expected[inside] = body.E / (1 + body.nu) * (elastic + spherical[:, None, None] * np.eye(3))
        modulus[inside] = body.E / body.give
    # of the stress that motions as large as u make over a cell
    return expected, 1e3 * EPS * modulus * reach * np.abs(inverse).max(axis=(1, 2), initial=0.0)


class MultiplierForces:
    """∫ p_n n . v ds + b(lambda, v; s) of one contact, by dolfinx; s lambda is the tangential traction t.

    The solver's forces are N^T W p of the contact rows, and so would be an audit with the same rows: a wrong N or W
    would then be wrong on both sides, and never seen. Here only the fields come from the rows (which nodes a multiplier
    stands for, and its direction); positions, areas and sums are those of the mesh, as dolfinx has them.
    """

    def __init__(self, system: System, rows: ContactRows) -> None:
        """Compile the forms; collective. Later calls only set their fields, also where the contact slides.

        Args:
            system: at the start.
            rows: of the contact, at the start; with a pressure multiplier or friction.
        """
        self._nodal, compile_ = NodalContact(system, rows), system.weak.compile
        self._pressure, self._lam, self._bound = (dx.fem.Function(system.space) for _ in range(3))
        sliding = system.problem.pairs[rows.name].contact.sliding
        self._moved = dx.fem.Function(system.space) if sliding else None
        self._areas = compile_(self._nodal.rule.areas(self._moved))
        rule, v, works = self._nodal.rule, system.weak.v, []
        if not rows.normal.at_quadrature:
            works.append(rule.normal_work(self._pressure, v))
        if rows.friction is not None:
            works.append(rule.friction_work(self._lam, v, self._bound[0]))
        self._work, self._fields = compile_(sum(works[1:], start=works[0])), traction_fields(rows)
        self._weigh(rows)

    def _weigh(self, rows: ContactRows, moved: Array | None = None) -> None:
        """W_j = ∫ phi~_j ds of the side as it lies; at edges those of the face that carries the contact."""
        nodal, side = self._nodal, rows.surface
        if moved is not None and side.faces is not None:
            side = replace(side, points=side.points + moved)
        part = np.where(side.at_edge > 0, rows.node_weights / side.node_weights(), 1.0)
        areas = nodal.assembled_at_nodes(self._areas).reshape(-1, side.dim)[:, 0] * side.shares_at_edges
        nodal.carry(rows)
        nodal.weigh(part * (side.forces_transform @ areas))

    def __call__(self, rows: ContactRows, p_n: Array, t: Array, s: Array, scale: float, moved: Array | None) -> Vec:
        """Nodal forces over all displacements [N]; collective.

        Args:
            rows: of the contact in this step.
            p_n: pressures (m_n,) [Pa]; of no account where the law gives them by the displacement.
            t: tangential multipliers (m_t, d-1) [Pa].
            s: friction bounds (m_t,) [Pa]. Where they are infinite or negligible, lambda has no unit: the field is the
                traction itself, and s is 1.
            scale: of tractions in this step [Pa].
            moved: of a sliding contact, the displacement (n, d) [m] at which its rows were built; None: none.
        """
        nodal, d = self._nodal, rows.surface.dim
        if self._moved is not None:
            at = nodal.spread(np.zeros(rows.points.size) if moved is None else moved.ravel())
            dx.fill(self._moved, at.array_r)
            self._weigh(rows, moved)
        normal, tangential = self._fields if self._moved is None else traction_fields(rows)
        bound = rows.share_t.T @ s
        # of the step's scale of traction; a smaller bound is no unit to measure lambda in
        bound[~np.isfinite(bound) | (bound <= ROUNDING * scale)] = 1.0
        fields = (self._pressure, normal.T @ p_n), (self._bound, np.repeat(bound, d))
        for function, values in (*fields, (self._lam, tangential.T @ t.ravel() / np.repeat(bound, d))):
            dx.fill(function, nodal.spread(values).array_r)
        return nodal.on_displacements(dx.assemble_vector(self._work))
