"""The audit: checks displacement and tractions, as the step files hold them, against equilibrium and contact laws.

It is independent of the solver: inner forces are integrated over the cells without a stiffness matrix, which also saves
its memory; contact forces on rigid obstacles are UFL forms of the tractions, not the solver's N^T W p; contact rows are
built anew; no method is imported. Gap and slip are those of the step file, not recomputed from its displacement.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from functools import cached_property

import numpy as np
from petsc4py import PETSc

from geometry import dolfinx_versions as dx
from geometry.arrays import Array
from geometry.mesh.mesh import Mesh
from geometry.protocols import CompiledForm, Vec
from solvers.contact.admissible_set import AdmissibleSet, ContactBlock
from solvers.contact.rows import ContactRows
from solvers.fem.contact_forms import ComplianceForms
from solvers.laws.compliance import Compliance
from solvers.parallel.counters import Counters
from solvers.results.multiplier_forces import MultiplierForces
from solvers.scene.problem import Problem
from solvers.system.nodal_contact import fill, relative_to_obstacle
from solvers.system.system import System, assemble, inner_forces

ROUNDED = 1e-9  # of p_ref; smaller bounds count as zero
ROUNDING = 1e3  # times the rounding error of K u; smaller forces count as zero


@dataclass(frozen=True)
class Audit:
    """Relative defects of a step [-], all >= 0, and zero for an exact solution of the discrete problem.

    p_ref [Pa] and u_ref [m] are the step's scales of traction and displacement. ()_+ is the positive part.
    """

    equilibrium: float  # sum |nodal force out of balance| / sum |nodal force|
    penetration: float  # max (u_n - g)_+ / u_ref; with compliance, u_n - g minus what the law gives
    negative_pressure: float  # max (-p_n)_+ / p_ref
    cone: float  # max (|t| - s)_+ / s_max, s the friction bound
    complementarity: float  # max of min(p/p_ref, open gap/u_ref), and of |t.du - s|du|| / (s_max u_ref)
    dissipation: float  # max(-friction work, 0) / |external work|

    @staticmethod
    def worst(audits: Iterable[Audit]) -> dict[str, float | None]:
        """Maximum of each defect over several steps, by its name; None if there is no step."""
        rows = [asdict(audit) for audit in audits]
        return {f.name: max((row[f.name] for row in rows), default=None) for f in fields(Audit)}


@dataclass(frozen=True, kw_only=True)
class Record:
    """One step as its file holds it: what is audited."""

    time: float  # [s]
    displacement: Array  # (nodes, d) in the order of the gmsh model [m]
    p: Array  # (rows,) tractions, flat [Pa]
    w: Array  # (rows,) relative displacement, flat [m]
    reference: Array  # (rows,) w at the start of the last substep [m]: slip counts from it; gaps are recomputed
    driven: Array  # (o,) displacement of the obstacles that forces drive, by `Problem.driven` [m]
    searched: Mapping[str, Array]  # by sliding contact, displacement (n_all, d) [m] that its pairs were searched at
    p_ref: float  # [Pa]
    u_ref: float  # [m]
    external_work: float  # since t = 0 [J]


class Auditor:
    """Audits steps with a system of its own; called with one `Record` after the other."""

    def __init__(self, problem: Problem, mesh: Mesh) -> None:
        """Assemble all but the stiffness matrix; collective.

        Args:
            problem: the resolved scene.
            mesh: the same mesh that was solved on.
        """
        self.start: System = assemble(problem, mesh, Counters())
        self._u = dx.fem.Function(self.start.space)
        self._inner_forces = self.start.weak.compile(inner_forces(problem, self.start.weak, self._u))
        self._multiplier_forces: dict[str, MultiplierForces] = {}  # by contact, compiled at the first step
        self._j_n: dict[str, tuple[ComplianceForms, CompiledForm]] = {}  # likewise
        self._set_system(self.start)

    def _set_system(self, system: System) -> None:
        """Use the contact rows of `system`."""
        self.system, self.cone = system, AdmissibleSet(system.contacts, 0.0, system.problem.timeline.end)

    def __call__(self, record: Record) -> Audit:
        """Audit one step; collective, `displacement` is read on every rank."""
        self._set_system(self.start.searched(record.searched) if record.searched else self.start)
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
        """Defect of K u - f + B^T p at free dofs and of forces on driven obstacles, relative to all forces [-].

        The contact forces are those of `_contact_force`.
        """
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
        ):  # a body that moves as a whole: its forces are rounding errors
            return 0.0
        return float((free.norm(0) + np.abs(obstacles).sum()) / scale) if scale else 0.0

    def _inner(self, u: Vec) -> Vec:
        """Inner forces of bodies and of effects that stiffen them [N]; u: displacement of all dofs [m]."""
        dx.petsc_vector(self._u).array[:] = u.array
        self._u.x.scatter_forward()
        return dx.assemble_vector(self._inner_forces)

    @cached_property
    def _largest_stiffness(self) -> float:
        """Estimate from below of the largest row sum of |K| [N/m]: the inner forces of pseudo-random signs."""
        nodes, signs = self.start.nodes, self.start.vector()
        numbers = nodes.input[: nodes.owned, None] * self.start.mesh.dim + np.arange(self.start.mesh.dim)
        signs.array[:] = np.sign(np.sin(numbers.astype(float) ** 2)).ravel()
        return float(self._inner(signs).norm(PETSc.NormType.INFINITY))

    def _contact_force(self, place: ContactBlock, u: Vec, record: Record) -> Vec:
        """Nodal forces B^T p of one contact over all displacement dofs [N]; with compliance p_n is that of u.

        Against a rigid obstacle those of multipliers come from forms. Between bodies no form over one mesh has them:
        there they are the rows' own, N^T W p.
        """
        system, rows = self.system, place.rows
        p_n, t = record.p[place.normal], record.p[place.tangential].reshape(-1, place.components)
        compliant = isinstance(rows.normal, Compliance)
        if rows.master is not None:
            return system.interface.force_of(rows, self._pressure_of_law(rows, u, record) if compliant else p_n, t)
        force = self._compliant_force(rows, u, record) if compliant else system.vector()
        if compliant and rows.friction is None:
            return force
        if rows.name not in self._multiplier_forces:
            (start,) = (c for c in self.start.contacts if c.name == rows.name)
            self._multiplier_forces[rows.name] = MultiplierForces(self.start, start)
        s = self.cone.at(record.time).bound(place, p_n) if rows.friction is not None else np.zeros(0)
        return force + self._multiplier_forces[rows.name](rows, p_n, t, s, record.p_ref, record.searched.get(rows.name))

    def _compliant_force(self, rows: ContactRows, u: Vec, record: Record) -> Vec:
        """Nodal forces of a compliant pressure against a rigid obstacle [N]: j_n of u, as the side was at the start.

        Where contact slides, normals and gaps are those of the rows, and so are the forces.
        """
        system, law = self.system, rows.normal
        assert isinstance(law, Compliance)
        if rows.name in record.searched:
            p_n = self._pressure_of_law(rows, u, record)
            return system.interface.force_of(rows, p_n, np.zeros(rows.free.shape))
        if rows.name not in self._j_n:
            forms = ComplianceForms(system.weak, system.problem.pairs[rows.name].contact, law)
            self._j_n[rows.name] = forms, system.weak.compile(forms.work)
        forms, work = self._j_n[rows.name]
        fill(forms.relative, relative_to_obstacle(system, rows.name, u, record.time, record.driven))
        return dx.assemble_vector(work)

    def _pressure_of_law(self, rows: ContactRows, u: Vec, record: Record) -> Array:
        """Compliant pressures (m_n,) [Pa] of a displacement, at the quadrature points of the rows."""
        system, law = self.system, rows.normal
        assert isinstance(law, Compliance)
        (index,) = (i for i, c in enumerate(system.contacts) if c.name == rows.name)
        motion = system.obstacles.motions((rows,), record.time, record.driven)[rows.name]
        w = rows.N_n @ (system.interface.displacement(u)[index] - motion).ravel()
        return law.pressure(w - rows.gap)

    def _normal(self, place: ContactBlock, record: Record) -> tuple[float, float, float]:
        """Penetration, negative pressure and complementarity of one contact, see `Audit` [-]."""
        law, p = place.rows.normal, record.p[place.normal]
        opening = place.rows.gap - record.w[place.normal] + law.penetration(p)
        p_ref, u_ref = record.p_ref or 1.0, record.u_ref or 1.0
        if law.sides == 2:
            return float(np.abs(opening).max(initial=0.0)) / u_ref, 0.0, 0.0
        both = np.minimum(np.maximum(p, 0.0) / p_ref, np.maximum(opening, 0.0) / u_ref)
        negative = np.maximum(-p, 0.0).max(initial=0.0) / p_ref
        return float(np.maximum(-opening, 0.0).max(initial=0.0)) / u_ref, float(negative), float(both.max(initial=0.0))

    def _tangential(self, place: ContactBlock, record: Record) -> tuple[float, float, float]:
        """Excess over the friction bound, slip direction and negative friction work of one contact, see `Audit` [-]."""
        if place.rows.friction is None:
            return 0.0, 0.0, 0.0
        t = record.p[place.tangential].reshape(-1, place.components)
        moved = record.w - record.reference - self.cone.give(record.p)
        du = moved[place.tangential].reshape(t.shape) * place.rows.free
        s = self.cone.at(record.time).bound(place, record.p[place.normal])
        finite = np.isfinite(s)
        s_max = float(s[finite].max(initial=0.0))
        if s_max <= ROUNDED * record.p_ref:  # nothing presses: the bound is a rounding error
            s_max = record.p_ref or 1.0
        length, slip = np.linalg.norm(t, axis=1), np.linalg.norm(du, axis=1)
        work = np.einsum("mi,mi->m", t, du)
        against = np.where(finite, np.abs(work - np.where(finite, s, 0.0) * slip), length * slip)
        excess = float(np.maximum(length - s, 0.0)[finite].max(initial=0.0)) / s_max
        friction_work = float(place.rows.W_t @ work)
        external = abs(record.external_work) or s_max * (record.u_ref or 1.0) * float(place.rows.W_t.sum())
        direction = float(against.max(initial=0.0)) / (s_max * (record.u_ref or 1.0))
        return excess, direction, max(-friction_work, 0.0) / external
