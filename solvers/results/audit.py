"""The audit: displacement and tractions, as the files hold them, against equilibrium and the contact laws.

Inner forces are integrated over the cells, without a stiffness matrix: none need fit beside the solver's. The contact
rows are built anew. Nothing here imports a method: none can vouch for itself.
Gap and slip are those that the step file holds, not recomputed from its displacement.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from petsc4py import PETSc

from geometry import dolfinx_versions as dx
from geometry.arrays import Array
from geometry.mesh.mesh import Mesh
from geometry.protocols import Vec
from solvers.contact.admissible_set import AdmissibleSet, ContactBlock
from solvers.laws.compliance import Compliance
from solvers.parallel.counters import Counters
from solvers.scene.problem import Problem
from solvers.system.system import System, assemble, inner_forces

ROUNDED = 1e-9  # of p_ref: less is no traction
ROUNDING = 1e3  # forces below this multiple of the rounding of K u are none


@dataclass(frozen=True)
class Audit:
    """Relative defects; all zero for an exact answer."""

    equilibrium: float  # sum |nodal force out of balance| / sum |nodal force|
    penetration: float  # max (u_n - g)_+ / u_ref; with compliance |u_n - g - law's inverse|
    negative_pressure: float  # max (-p_n)_+ / p_ref
    cone: float  # max (|t| - s)_+ / s_max
    complementarity: float  # max of min(p/p_ref, open gap/u_ref), and of |t.du - s|du|| / (s_max u_ref)
    dissipation: float  # max(-friction work, 0) / |external work|

    @staticmethod
    def worst(audits: Iterable[Audit]) -> dict[str, float | None]:
        """Maximum of each defect over the steps; None where nothing was audited."""
        rows = [asdict(audit) for audit in audits]
        return {f.name: max((row[f.name] for row in rows), default=None) for f in fields(Audit)}


@dataclass(frozen=True, kw_only=True)
class Record:
    """What is audited: one step as the files hold it."""

    time: float
    displacement: Array  # (nodes, d) in the order of the gmsh model [m]
    p: Array  # (rows,) flat tractions [Pa]
    w: Array  # (rows,) flat relative displacement [m]
    reference: Array  # (rows,) what slip is counted from [m]; the gap is recomputed
    driven: Array  # displacement of the obstacles that forces move, by `Obstacles.driven` [m]
    searched: Mapping[str, Array]  # where sliding contacts were paired
    p_ref: float
    u_ref: float
    external_work: float  # in this run so far [J]


class Auditor:
    """A system of its own, for as many records as there are."""

    def __init__(self, problem: Problem, mesh: Mesh) -> None:
        """Assemble without the solver's own system; collective."""
        self.start: System = assemble(problem, mesh, Counters())
        self._u = dx.fem.Function(self.start.space)
        self._inner_forces = self.start.weak.compile(inner_forces(problem, self.start.weak, self._u))
        self._tell(self.start)

    def _tell(self, system: System) -> None:
        self.system, self.cone = system, AdmissibleSet(system.contacts, 0.0, system.problem.timeline.end)

    def __call__(self, record: Record) -> Audit:
        """Audit one step; collective, `displacement` is read on every rank."""
        self._tell(self.start.searched(record.searched) if record.searched else self.start)
        tangential = [self._tangential(place, record) for place in self.cone.places]
        normal = [self._normal(place, record) for place in self.cone.places]
        return Audit(
            equilibrium=self._equilibrium(record),
            penetration=max((n[0] for n in normal), default=0.0),
            negative_pressure=max((n[1] for n in normal), default=0.0),
            cone=max((t[0] for t in tangential), default=0.0),
            complementarity=max(
                (x for n, t in zip(normal, tangential, strict=True) for x in (n[2], t[1])), default=0.0
            ),
            dissipation=max((t[2] for t in tangential), default=0.0),
        )

    def _equilibrium(self, record: Record) -> float:
        """K u - f + contact forces, where nothing is prescribed; compliance pressures from the UFL form j_n."""
        system = self.system
        own = system.nodes.input[: system.nodes.owned]
        u = system.vector()
        u.array[:] = record.displacement[own].ravel()
        contact, obstacles = system.vector(), system.obstacles.driving_force(record.time)
        applied = float(np.abs(obstacles).sum())
        for place in self.cone.places:
            force = self._contact_force(place, u, record)
            contact += force
            obstacles += system.interface.resultant_on_driven(place.rows, force)
        values = system.initial.values(system.course, record.time)
        load, inner = system.initial.added(system.load(record.time), values), self._inner(u)
        out = inner - load + contact
        free = system.T.createVecRight()
        system.T.multTranspose(out, free)
        scale = sum(v.norm(0) for v in (inner, load, contact)) + applied
        rounding = np.finfo(float).eps * self._largest_stiffness * u.norm(0)
        if (
            load.norm(0) == 0 and scale <= ROUNDING * rounding
        ):  # a body that moves as a whole: there is no force to speak of
            return 0.0
        return float((free.norm(0) + np.abs(obstacles).sum()) / scale) if scale else 0.0

    def _inner(self, u: Any) -> Any:
        """∫ sigma(u) : eps(v) dx over all displacements [N]."""
        dx.petsc_vector(self._u).array[:] = u.array
        self._u.x.scatter_forward()
        return dx.assemble_vector(self._inner_forces)

    @cached_property
    def _largest_stiffness(self) -> float:
        """About the largest row sum of |K| [N/m], from below: the inner forces of signs without a pattern."""
        nodes, signs = self.start.nodes, self.start.vector()
        numbers = nodes.input[: nodes.owned, None] * self.start.mesh.dim + np.arange(self.start.mesh.dim)
        signs.array[:] = np.sign(np.sin(numbers.astype(float) ** 2)).ravel()
        return float(self._inner(signs).norm(PETSc.NormType.INFINITY))

    def _contact_force(self, place: ContactBlock, u: Vec, record: Record) -> Vec:
        system, rows, law = self.system, place.rows, place.rows.normal
        p_n, t = record.p[place.normal], record.p[place.tangential].reshape(-1, place.components)
        if not isinstance(law, Compliance):
            return system.interface.force_of(rows, p_n, t)
        if rows.master is not None or rows.name in record.searched:  # UFL knows one side, where it was at the start
            (index,) = (i for i, c in enumerate(system.contacts) if c.name == rows.name)
            motion = system.obstacles.motions((rows,), record.time, record.driven)[rows.name]
            w = rows.N_n @ (system.interface.displacement(u)[index] - motion).ravel()
            return system.interface.force_of(rows, law.pressure(w - rows.gap), t)
        contact = system.problem.pairs[rows.name].contact
        relative = dx.fem.Function(system.space)
        dx.petsc_vector(relative).array[:] = u.array
        relative.x.scatter_forward()
        motion = system.obstacles.motion(rows.name, system.nodes.points, record.time, record.driven)
        relative.x.array[:] -= motion.ravel()
        form = system.weak.normal_compliance(relative, contact, law)
        return dx.assemble_vector(system.weak.compile(form)) + system.interface.force_of(rows, np.zeros_like(p_n), t)

    def _normal(self, place: ContactBlock, record: Record) -> tuple[float, float, float]:
        """Penetration, negative pressure and complementarity of one contact."""
        law, p = place.rows.normal, record.p[place.normal]
        opening = place.rows.gap - record.w[place.normal] + law.penetration(p)
        p_ref, u_ref = record.p_ref or 1.0, record.u_ref or 1.0
        if law.sides == 2:
            return float(np.abs(opening).max(initial=0.0)) / u_ref, 0.0, 0.0
        both = np.minimum(np.maximum(p, 0.0) / p_ref, np.maximum(opening, 0.0) / u_ref)
        negative = np.maximum(-p, 0.0).max(initial=0.0) / p_ref
        return float(np.maximum(-opening, 0.0).max(initial=0.0)) / u_ref, float(negative), float(both.max(initial=0.0))

    def _tangential(self, place: ContactBlock, record: Record) -> tuple[float, float, float]:
        """AdmissibleSet, slip direction and friction work of one contact."""
        if place.rows.friction is None:
            return 0.0, 0.0, 0.0
        t = record.p[place.tangential].reshape(-1, place.components)
        moved = record.w - record.reference - self.cone.give(record.p)
        du = moved[place.tangential].reshape(t.shape) * place.rows.free
        s = self.cone.at(record.time).bound(place, record.p[place.normal])
        finite = np.isfinite(s)
        s_max = float(s[finite].max(initial=0.0))
        if s_max <= ROUNDED * record.p_ref:  # nothing presses: what there is of a bound is rounding
            s_max = record.p_ref or 1.0
        length, slip = np.linalg.norm(t, axis=1), np.linalg.norm(du, axis=1)
        work = np.einsum("mi,mi->m", t, du)
        against = np.where(finite, np.abs(work - np.where(finite, s, 0.0) * slip), length * slip)
        excess = float(np.maximum(length - s, 0.0)[finite].max(initial=0.0)) / s_max
        friction_work = float(place.rows.W_t @ work)
        external = abs(record.external_work) or s_max * (record.u_ref or 1.0) * float(place.rows.W_t.sum())
        direction = float(against.max(initial=0.0)) / (s_max * (record.u_ref or 1.0))
        return excess, direction, max(-friction_work, 0.0) / external
