"""The audit: holds each step, as its file has it, against the scene, equilibrium and the contact laws.

It shares no code with what it judges where that is cheap: inner forces are the derivative of an energy of their own,
contact forces on rigid obstacles are UFL forms of the tractions, not the solver's N^T W p; relative displacements come
from the stored displacement; laws, gaps and supports are written a second time. `Auditor.shared` lists the rest.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np
from petsc4py import PETSc

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import EPS, EXACT, LAST_DIGITS, ROUNDING, SLIGHT, TINY, Array
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.obstacles.plane import Plane
from stickslip.geometry.protocols import CompiledForm, Vec
from stickslip.solvers.contact.admissible_set import AdmissibleSet, ContactBlock
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.effects import active
from stickslip.solvers.fem.contact_forms import ComplianceForms
from stickslip.solvers.fem.elastic_energy import forces_of_energy
from stickslip.solvers.laws.normal import Compliance
from stickslip.solvers.laws.rate_and_state import RateAndStateByPoint
from stickslip.solvers.laws.wear import SLID, WORN, Turned
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.parallel.replicated import sum_of_sizes
from stickslip.solvers.results.closed_formulas import (
    bound,
    gap,
    penetration,
    prescribed,
    pressure,
    remembered,
    slid,
    stored_energy,
    worn_rate,
)
from stickslip.solvers.results.resultants import acting
from stickslip.solvers.results.second_forces import SecondForces
from stickslip.solvers.results.second_numbers import SecondNumbers
from stickslip.solvers.results.stored_fields import (
    MultiplierForces,
    Record,
    contact_differences,
    difference,
    slip_of,
    stress_difference,
)
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.record import OPEN, SLIP, STATUS_WORDS, STICK
from stickslip.solvers.scene.timeline import Place
from stickslip.solvers.system.nodal_contact import relative_to_obstacle
from stickslip.solvers.system.system import System, assemble

log = logging.getLogger(__name__)
FRICTION = 0.1  # of the pressures; smaller friction bounds are judged as if so large: tolerances are of all tractions
UNFOLLOWED = "in steps of several substeps, or after what is not known"
SUMMED = 1e3  # times the rounding error of K u; smaller forces count as zero


@dataclass(frozen=True)
class Audit:
    """Relative defects of a step [-], all >= 0, and zero for an exact solution of the discrete problem.

    p_top [Pa] is the largest traction of the step, u_top [m] the motion that it causes: p_top times the extent of the
    closed part by E, and what compliant laws give; s_top [Pa] is the largest friction bound, at least FRICTION p_top.
    ()_+ is the positive part. Where nothing loads the bodies, tractions that are rounding of the motions count as zero.
    """

    equilibrium: float  # sum |nodal force out of balance| / sum |nodal force|
    # largest |moment that a contact reports - that of its forces on the other side, where both sides are now|, less
    # forces times slips and gaps, the square of the motion / (sum |nodal force| extent)
    moment: float
    rounding: float  # how much of `equilibrium` the last digit of the stored displacement decides
    supports: float  # largest |displacement - prescribed| / largest |displacement|
    penetration: float  # max (u_n - g)_+ / u_top; with compliance, distance of p_n and u_n - g from the law
    negative_pressure: float  # max (-p_n)_+ / p_top
    cone: float  # max (|t| - s)_+ / s_top, s the friction bound
    # max of min(p_n / p_top, open gap / u_top), and of |t - P_s(t + (s_top / u_top) du)| / s_top
    complementarity: float
    # max(-friction work, 0) / (sum of |friction work| at all points, of tractions not below the smallest s_top,
    # + s_top u_top area)
    dissipation: float
    fields: float  # largest difference of a stored field from what displacement and tractions give / its largest value
    numbers: float  # largest difference of a reported number from its second value / itself; a status that is wrong: 1
    # largest difference of what tables and XDMF files tell from the numbers and from the step's file / itself
    files: float = 0.0

    @staticmethod
    def worst(audits: Iterable[Audit]) -> dict[str, float | None]:
        """Maximum of each defect over several steps, by its name; None if there is no step."""
        rows = [asdict(audit) for audit in audits]
        return {f.name: _largest([row[f.name] for row in rows]) if rows else None for f in fields(Audit)}


@dataclass(frozen=True, kw_only=True)
class Scales:
    """Scales of a step that its defects are relative to."""

    p: float  # p_top [Pa]
    u: Mapping[str, float]  # u_top by contact [m]
    rounding: float  # of lengths and motions [m]
    noise: float = 0.0  # tractions that are rounding beside all forces [Pa]
    rest: float = 0.0  # tractions that are rounding of the motions, where nothing loads the bodies [Pa]
    area: float = 0.0  # of all contacts [m^(d-1)]


@dataclass(frozen=True)
class Balance:
    """Forces of a step: what is left of them, and sums of their magnitudes."""

    out: Vec  # inner forces less loads, with those of contact; of free dofs, defects; else reactions [N]
    obstacles: Array  # on driven obstacles and bolts [N]
    load: float  # of all loads [N]
    size: float  # of all forces [N]


class Auditor:
    """Audits steps with a system of its own; called with one `Record` after the other."""

    def __init__(self, problem: Problem, mesh: Mesh) -> None:
        """Assemble all but the stiffness matrix; collective.

        Args:
            problem: the resolved scene.
            mesh: the same mesh that was solved on.
        """
        self.start: System = assemble(problem, mesh, Counters())
        self._u, self._dilatation = dx.fem.Function(self.start.space), self.start.dilatation.functions()
        bodies, weak = forces_of_energy(self.start.weak, self._u, self._dilatation), self.start.weak
        stiffening = (form for effect in active(problem) for form in effect.stiffness(problem, weak, self._u))
        self._inner_forces = [weak.compile(form) for form in (*bodies, *stiffening)]
        self._multiplier_forces: dict[str, MultiplierForces] = {}  # by contact, compiled at the first step
        self._j_n: dict[str, tuple[ComplianceForms, CompiledForm]] = {}  # likewise
        self._largest, self._unseen = 0.0, set[str]()  # traction so far [Pa]; numbers without a second formula
        self._second = SecondNumbers(self.start)
        self._last: Balance  # of the step that is judged
        self._before: Record | None  # the step before that
        self._set_system(self.start)

    @cached_property
    def _terms(self) -> dict[str, float | None]:
        """Difference of each load, initial strain and averaged dilatation from its second value; collective."""
        return SecondForces(self.start, self._second).apart()

    def _set_system(self, system: System, time: float = 0.0) -> None:
        """Use the contact rows of `system` as they are at a time [s]."""
        self.system, self.cone = system, AdmissibleSet(system.contacts, 0.0, system.problem.timeline.end).at(time)

    @property
    def _sectors(self) -> Array:
        return self.start.constraints.periodic.sectors

    @property
    def shared(self) -> tuple[str, ...]:
        """Return terms without a second formula, for which the solver's own is used: an error in it is not seen."""
        problem, zero = self.start.problem, np.zeros(1)
        found = [name for name, off in self._terms.items() if off is None] + [x.key for x in problem.couplings]
        found += [f"{effect.name}: stiffness" for effect in active(problem) if effect.other_stiffness(problem)]
        found += [f"{place}: expression" for place in problem.timeline.expressions if place.table == "supports"]
        for name, obstacle in problem.obstacles.items():
            if gap(obstacle, np.zeros((1, problem.dim))) is None:
                found.append(f"obstacles.{name}: gap")
        for c in self.start.contacts:
            if c.master is not None:
                found.append(f"contacts.{c.name}: gap and forces between bodies")
            elif c.surface.images is not None:
                found.append(f"contacts.{c.name}: forces of a cyclic sector")
            if penetration(c.normal, zero) is None:
                found.append(f"contacts.{c.name}.normal")
            law, one = c.friction, np.ones((1, 1))
            rest = zero if law is None else np.zeros_like(law.memory(len(c.W_t)))[:1]
            if law is not None and bound(law, c.normal, zero, one, 0.0, 1.0, rest) is None:
                found.append(f"contacts.{c.name}.friction")
        return tuple(dict.fromkeys([*found, *sorted(self._unseen)]))

    def __call__(self, record: Record, before: Record | None = None) -> Audit:
        """Audit one step; collective, `displacement` is read on every rank.

        Args:
            before: the step before, where this one was solved in one substep: then slip is followed from there.
        """
        if not record.finite:
            return Audit(**{f.name: np.inf for f in fields(Audit)})
        self._set_system(self.start.searched(record.searched) if record.searched else self.start, record.time)
        recall(self.start, record.time, record.shortened)
        self._before = before
        u = self.system.vector()
        u.array[:] = record.displacement[self.system.nodes.input[: self.system.nodes.owned]].ravel()
        inner, w = self._inner(u), self._relative(record)
        scales = self._scales(record, inner)
        tangential = [self._tangential(place, record, w, scales) for place in self.cone.places]
        normal = [self._normal(place, record, w, scales) for place in self.cone.places]
        equilibrium, rounding = self._equilibrium(record, u, inner, scales)
        found = Audit(
            equilibrium=equilibrium,
            moment=_largest([self._moment(place, record) for place in self.cone.places]),
            rounding=rounding,
            supports=self._supports(record, u),
            penetration=_largest([n[0] for n in normal]),
            negative_pressure=_largest([n[1] for n in normal]),
            cone=_largest([t[0] for t in tangential]),
            complementarity=_largest([*(n[2] for n in normal), *(t[1] for t in tangential)]),
            dissipation=_largest([t[2] for t in tangential]),
            fields=self._fields(record, before, w, scales),
            numbers=self._numbers(record, u, w, inner, scales) if record.stored.told else 0.0,
        )
        return Audit(**{name: float(f"{value:.6g}") for name, value in asdict(found).items()})  # BLAS sums by alignment

    def _motion(self, rows: ContactRows, record: Record) -> Array:
        """Displacement (n_all, d) [m] of a contact's nodes, less that of its obstacle."""
        moved = rows.of_mesh(record.displacement, self._sectors)
        if rows.master is not None:
            return moved
        return moved - self._second.motion(rows.name, rows.points, record)

    def _relative(self, record: Record) -> Array:
        """w (rows,) [m] of the stored displacement."""
        found = np.zeros(self.cone.size)
        for place in self.cone.places:
            moved = self._motion(place.rows, record).ravel()
            found[place.normal], found[place.tangential] = place.rows.N_n @ moved, place.rows.N_t @ moved
        return found

    def _gap(self, rows: ContactRows, record: Record) -> tuple[Array, Array]:
        """Gaps (m_n,) at the points of pressure and (n,) at the nodes [m], from the closed formula if there is one.

        What has worn off is a part of them.
        """
        found = self._gap_at_rest(rows, record)
        worn = record.memory.get(f"{rows.name}{WORN}")
        return found if worn is None else (found[0] + worn, found[1] + rows.node_pressure(worn))

    def _gap_at_rest(self, rows: ContactRows, record: Record) -> tuple[Array, Array]:
        """The same without wear."""
        pair, side = self.system.problem.pairs[rows.name], rows.surface
        assert rows.fields is not None
        offset, node_offset = rows.fields.offsets(record.time)
        if rows.normal.ties:
            return np.full(len(rows.gap), offset), np.full(len(rows.node_gap), node_offset)
        if pair.obstacle is None or gap(obstacle := self.system.problem.obstacles[pair.obstacle], side.points) is None:
            return rows.gap, rows.node_gap
        moved = record.searched.get(rows.name, np.zeros_like(side.points))
        at = side.points + moved  # gaps there belong to displacements counted from the start
        nodal = side.transform @ np.asarray(gap(obstacle, at)) + node_offset
        nodal = nodal + np.einsum("nd,nd->n", rows.frames[:, 0], side.transform @ moved)
        if not rows.normal.at_quadrature:
            return np.asarray(rows.psi.T @ nodal / rows.W_n), nodal
        assert rows.quadrature is not None
        points = rows.quadrature(rows.degree)
        distance = rows.at_points(np.asarray(gap(obstacle, points.own.basis(side) @ at)))
        return distance + offset + rows.N_n @ moved.ravel(), nodal

    def _scales(self, record: Record, inner: Vec) -> Scales:
        """See `Audit`; tractions are never taken to be smaller than the rounding of all forces."""
        system, p_top = self.system, float(np.abs(record.p).max(initial=0.0))
        self._largest = max(self._largest, p_top)
        area = sum(float(c.node_weights.sum()) for c in system.contacts) or 1.0
        load = sum_of_sizes(system.load(record.time))
        relative = (np.abs(self._motion(place.rows, record)).max(initial=0.0) for place in self.cone.places)
        motion = float(max(np.abs(record.displacement).max(), *relative, 0.0))
        digit = EPS * self._largest_stiffness * motion / area
        # of the mean traction that all forces make on the contact area; smaller tractions are rounding
        noise, found = ROUNDING * (sum_of_sizes(inner) + load) / area + digit, dict[str, float]()
        # of the largest tractions so far: errors of earlier steps stay when a contact is unloaded
        p_top = max(p_top, SLIGHT * self._largest, noise) or 1.0
        for place in self.cone.places:
            rows = place.rows
            own = penetration(rows.normal, np.array([p_top]))
            give = float((own if own is not None else rows.normal.penetration(np.array([p_top])))[0])
            softness = 1 / rows.friction.k_T if rows.friction is not None and rows.friction.k_T else 0.0
            found[rows.name] = p_top * (self._give(rows, record.p[place.normal]) + softness) + give
        rest = digit + EPS * motion * sum(_law_stiffness(place, record.p) for place in self.cone.places) / area
        # else bodies drift
        rest = 0.0 if load or motion > system.extent else min(SUMMED * rest, ROUNDING / EPS * digit)
        lengths = LAST_DIGITS * max(system.extent, motion)
        return Scales(p=p_top, u=found, area=area, rounding=lengths, noise=noise, rest=rest)

    def _give(self, rows: ContactRows, p_n: Array) -> float:
        """Motion by unit traction [m/Pa]: the extent of the closed part, at most a body's depth, by E of each body."""
        closed = float(rows.W_n[np.abs(p_n) > ROUNDING * np.abs(p_n).max(initial=0.0)].sum())
        powers = self.system.mesh.dim - 1 + self.system.mesh.axisymmetric
        extent = (closed or float(rows.W_n.sum()) or np.inf) ** (1 / powers)  # inf: nothing can touch
        problem, normals = self.system.problem, rows.frames[:, 0]
        behind = ((min(extent, self._depths[b]), problem.bodies[b]) for b in problem.pairs[rows.name].bodies)
        return float(sum(depth / body.modulus_along(normals) for depth, body in behind))

    @cached_property
    def _depths(self) -> dict[str, float]:
        """Smallest side of each body's box [m]."""
        boxes = {body: self.start.mesh.body_box(body) for body in self.start.problem.bodies}
        return {body: float(np.ptp(box, axis=0).min()) for body, box in boxes.items()}

    def _balance(self, record: Record, u: Vec, inner: Vec, scales: Scales) -> Balance:
        """Forces that are not in balance; collective."""
        system = self.system
        contact, obstacles = system.vector(), system.obstacles.driving_force(record.time)
        applied = float(np.abs(obstacles).sum())
        for place in self.cone.places:
            force = self._contact_force(place, u, record, scales)
            contact += force
            obstacles += system.interface.resultant_on_driven(place.rows, force)
        obstacles = np.append(obstacles, tension_off(system, u, record.time))
        load = system.initial.added(system.load(record.time), system.initial.values(system.course, record.time))
        sizes = sum_of_sizes(load), sum(map(sum_of_sizes, (inner, load, contact))) + applied
        return Balance(inner - load + contact, obstacles, *sizes)

    def _equilibrium(self, record: Record, u: Vec, inner: Vec, scales: Scales) -> tuple[float, float]:
        """Defect of K u - f + B^T p at free dofs, on driven obstacles and bolts, relative to all forces [-].

        The second number is the change of these forces by one unit in the last place of u, and of the coordinates that
        gaps are computed from: a stiff body that moves far is out of balance by that, however well it was solved.
        """
        system, balance = self.system, self._balance(record, u, inner, scales)
        self._last = balance
        free, last_digit = system.T.createVecRight(), system.T.createVecRight()
        system.T.multTranspose(balance.out, free)
        scale, rounding = balance.size, SUMMED * EPS * self._largest_stiffness * sum_of_sizes(u)
        rounding += max(scales.rest, ROUNDING * self._largest) * scales.area
        if balance.load == 0 and scale <= rounding:  # bodies move as a whole, or are released
            return 0.0, 0.0
        shaken = u.copy()
        shaken.array[:] *= 1 + EPS * self._signs.array
        system.T.multTranspose(self._inner(shaken) - inner, last_digit)
        found = (sum_of_sizes(free) + np.abs(balance.obstacles).sum()) / scale
        of_laws = EPS * sum(
            self._gap_digits(place, record) * _law_stiffness(place, record.p) for place in self.cone.places
        )
        return float(found), float((sum_of_sizes(last_digit) + of_laws) / scale)

    def _moment(self, place: ContactBlock, record: Record) -> float:
        """Moment of a contact that its other side does not feel, see `Audit` [-]."""
        system, rows, told = self.system, place.rows, record.stored.moments.get(place.rows.name)
        pair, moved = system.problem.pairs[rows.name], rows.of_mesh(record.displacement, self._sectors)
        forces = rows.nodal_forces(record.p[place.normal], record.p[place.tangential].reshape(-1, place.components))
        acts = acting(system, rows, forces, moved, record.searched, (record.time, record.driven))
        size = np.linalg.norm(acts.forces, axis=1)
        pushed = size > 0
        given = rows.normal.ties or pair.contact.gap is not None  # not the gap between the sides as they are meshed
        if told is None or given or not pushed.any():
            return 0.0
        if system.mesh.axisymmetric:  # over a full circle there is none about any axis
            return float(np.linalg.norm(told)) / float(size.sum() * system.extent)
        if pair.obstacle is None:
            apart = rows.relative @ (rows.points + moved)
        else:
            obstacle, apart = system.problem.obstacles[pair.obstacle], np.zeros_like(acts.points)
            x = (acts.points - system.obstacles.translation(pair.obstacle, record.time, record.driven))[pushed]
            apart[pushed] = obstacle.signed_gap(x)[:, None] * obstacle.normals(x)
        other = replace(acts, points=acts.points - apart).moment * rows.sense
        open_now = self._gap(rows, record)[1] - rows.node_motion(self._motion(rows, record))[0]
        assert rows.fields is not None
        offset = rows.fields.offsets(record.time)[1]
        allowed = np.linalg.norm(rows.tangential_part(apart), axis=1) + np.abs(open_now) + np.abs(offset)
        if (worn := record.memory.get(f"{rows.name}{WORN}")) is not None:
            allowed += rows.node_pressure(worn)
        return max(float(np.linalg.norm(told - other) - size @ allowed), 0.0) / float(size.sum() * system.extent)

    def _gap_digits(self, place: ContactBlock, record: Record) -> float:
        """Size of the numbers whose last digit decides a gap [m]: coordinates along the normals, and motions.

        On a plane through the origin gaps are exact, however large the body is.
        """
        rows, system, problem = place.rows, self.system, self.system.problem
        pair, motion = problem.pairs[rows.name], float(np.abs(record.w).max(initial=0.0))
        normals = np.abs(rows.frames[:, 0])
        size = _largest(np.einsum("nd,nd->n", normals, np.abs(rows.surface.points)))
        if pair.obstacle is not None:
            obstacle = problem.obstacles[pair.obstacle]
            size = size + _largest(normals @ np.abs(obstacle.point)) if isinstance(obstacle, Plane) else system.extent
        return size + motion

    def _supports(self, record: Record, u: Vec) -> float:
        """Prescribed displacements that are not met, see `Audit` [-]; periodic sides move alike."""
        system, problem = self.system, self.system.problem
        largest, off = float(np.abs(record.displacement).max(initial=0.0)), 0.0
        for name, nodes, points, directions in self._second.supported:
            for axis in problem.supports[name].displacement:
                wanted = prescribed(problem, name, axis, points, record.time)
                along = directions if axis == "normal" else np.eye(problem.dim)["xyz".index(axis)]
                found = np.sum(record.displacement[nodes] * along, axis=1)
                largest, off = max(largest, _largest(np.abs(wanted))), max(off, _largest(np.abs(found - wanted)))
        if len(system.constraints.followers) or system.constraints.remote.rigid or system.mesh.axisymmetric:
            alike = system.T * system.free_part(u, record.time) + system.prescribed(record.time)
            off = max(off, float((u - alike).norm(PETSc.NormType.INFINITY)))
        return float(off / largest) if largest else 0.0

    def _numbers(self, record: Record, u: Vec, w: Array, inner: Vec, scales: Scales) -> float:
        """Largest distance of a reported number from its second value, see `Audit` [-]; collective."""
        told, system, places, balance = record.stored.told, self.system, self.cone.places, self._last
        contacts = {place.rows.name: self._contact(place, record, w) for place in places}
        out = np.zeros(record.displacement.shape)
        out[system.nodes.input[: system.nodes.owned]] = balance.out.array_r.reshape(-1, system.mesh.dim)
        out = system.mesh.comm.allreduce(out)
        seen = self._second.seen(record, contacts, out)
        values = system.initial.values(system.course, record.time)
        work, works = system.initial.stress_work(values, u), told["energy"]
        for strain, value, pull in zip(system.initial.strains, values, work, strict=False):
            if strain.shrunk is not None:
                assert isinstance(strain.drive, Place)
                seen["bolts"][strain.drive.name] = SimpleNamespace(tension=-float(pull), shortening=float(value))
        compliance, at_contacts = (self._compliance(place, record) for place in places), self._work(record)
        if at_contacts is None:  # then by the balance alone
            self._unseen.add(f"energy.contact: {UNFOLLOWED}")
        seen["energy"] = {
            "": SimpleNamespace(
                external=works["stored"] + works["contact"],
                stored=inner.dot(u) / 2 + system.initial.stored(values, work),
                contact=works["external"] - works["stored"] if at_contacts is None else at_contacts,
                compliance=sum(compliance),
                dissipated=sum(told["contacts"][name]["dissipation_total"] for name in contacts),
                time_remainder=works["contact"] - works["compliance"] - works["dissipated"],
            )
        }
        motion, length = float(max(np.abs(record.displacement).max(), np.abs(record.w).max(initial=0.0))), system.extent
        pressure = max(scales.p, float(np.abs(record.stored.stress).max()))
        rest = max(scales.noise, scales.rest)
        noise = SUMMED * EPS * self._largest_stiffness * sum_of_sizes(u) + rest * scales.area
        largest = {"N": balance.size, "N m": balance.size * length, "J": balance.size * motion, "m": motion}
        largest |= {"Pa": pressure, "m²": scales.area, "rad": motion / length}
        least = {"N": noise, "N m": noise * length, "J": noise * motion, "m": scales.rounding}
        least |= {"Pa": rest + noise / scales.area, "rad": scales.rounding / length}
        found = self._second.differences(record.stored, seen, largest, least)
        self._unseen |= {f"{name}: number" for name, off in found.items() if off is None}
        log.debug("t = %g: %s", record.time, {name: off for name, off in found.items() if off})
        return _largest(
            [
                *(off or 0.0 for off in self._terms.values()),
                *(off or 0.0 for off in found.values()),
                *(each.wrong for each in contacts.values()),
            ]
        )

    def _work(self, record: Record) -> float | None:
        """Work at contacts since t = 0 [J]: forces at both ends of the step, on what moves between them.

        None: it is not known, for the step has several substeps, or the one before or where slacks close is not known.
        """
        before, told = self._before, record.stored.told_before
        sliding = any(self._searched(place.rows, record) for place in self.cone.places)
        if record.stored.told["substeps"] > 1 or (told and before is None) or sliding or len(self.start.initial.slacks):
            return None
        found = float(told["energy"]["contact"]) if told else 0.0
        for place in self.cone.places:
            force, moved, pressed, offset = self._end(place, record)
            old_force, old_moved, old_pressed, old_offset = self._end(place, before)
            found += float(np.sum((force + old_force) / 2 * (moved - old_moved))) + self._aside(place, record)
            found -= float(np.sum(place.rows.W_n * (pressed + old_pressed) / 2 * (offset - old_offset)))
        return found

    def _end(self, place: ContactBlock, record: Record | None) -> tuple[Array | float, ...]:
        """Forces [N] and motions [m] of a contact's nodes, its pressures [Pa] and gap offsets [m]; None: at rest."""
        rows = place.rows
        assert rows.fields is not None
        offset = rows.fields.offsets(record.time if record else 0.0)[0]
        if record is None:
            return 0.0, 0.0, 0.0, offset
        p_n = record.p[place.normal]
        return rows.nodal_forces(p_n, record.p[place.tangential]), self._motion(rows, record), p_n, offset

    def _compliance(self, place: ContactBlock, record: Record) -> float:
        """Energy that the laws of a contact store [J]."""
        rows, t = place.rows, record.p[place.tangential].reshape(-1, place.components)
        own = stored_energy(rows.normal, record.p[place.normal])
        found = float(rows.W_n @ (rows.normal.energy(record.p[place.normal]) if own is None else own))
        soft = rows.friction.k_T if rows.friction is not None else None
        return found + (float(rows.W_t @ (t**2).sum(axis=1)) / (2 * soft) if soft else 0.0)

    def _contact(self, place: ContactBlock, record: Record, w: Array) -> SimpleNamespace:
        """What is seen of a contact: fields at its nodes, forces where they act, and the work of friction."""
        rows, told = place.rows, record.stored.told["contacts"][place.rows.name]
        p_n, t = record.p[place.normal], record.p[place.tangential].reshape(-1, place.components)
        moved, before = rows.of_mesh(record.displacement, self._sectors), record.stored.told_before.get("contacts")
        acts = acting(
            self.system, rows, rows.nodal_forces(p_n, t), moved, record.searched, (record.time, record.driven)
        )
        shown = {
            key: values[:, : rows.surface.dim] if np.ndim(values) == 2 else values
            for key, values in record.stored.contacts[rows.name].items()
            if key in ("weight", "pressure", "traction", "slip", "status")
        }
        status = shown.pop("status")
        soft = rows.friction.k_T if rows.friction is not None else None
        slid = (w - record.reference)[place.tangential].reshape(t.shape) - (t / soft if soft else 0.0)
        total = before[rows.name]["dissipation_total"] if before else 0.0
        whole = told["dissipation_total"] - total  # of several substeps the parts are not known
        work, beside = float(rows.W_t @ (t * slid).sum(axis=1)), self._beside(place, record)
        memory, theta, law = record.memory.get(rows.name, np.zeros(0)), np.zeros(0), rows.friction
        if isinstance(law, RateAndStateByPoint):
            theta = law.Dc * np.exp(memory[:, 0]) / law.of.V0
        if beside is None or record.stored.told["substeps"] > 1:
            self._unseen.add(f"contacts.{rows.name}.dissipation: {UNFOLLOWED}")
        counts = dict(zip(STATUS_WORDS, np.bincount(status, minlength=len(STATUS_WORDS)).tolist(), strict=True))
        return self._second.acting(
            acts.points,
            rows.sense * acts.forces,
            turned=rows.sense * acts.turned,
            touches=status != OPEN,
            sticks=status == STICK,
            slips=status == SLIP,
            peaks=self._pressure_of_law(rows, record) if isinstance(rows.normal, Compliance) else shown["pressure"],
            closing=w[place.normal] - self._gap(rows, record)[0],
            dissipation=whole if beside is None or record.stored.told["substeps"] > 1 else work + beside,
            dissipation_total=total + told["dissipation"],
            wrong=float(counts != told["statuses"]),
            normal_weight=rows.W_n,
            wear=record.memory.get(f"{rows.name}{WORN}", np.zeros(0)),
            rates=memory[:, 1] if memory.ndim > 1 else memory,
            ages=theta,
            **shown,
        )

    def _beside(self, place: ContactBlock, record: Record) -> float | None:
        """Work in a step of friction on the sliding out of the plane, and of pressure on what wears away [J].

        None: it is not known, for the step before is not.
        """
        if not (place.rows.wears or place.rows.slides):
            return 0.0
        if self._before is None and record.stored.told_before:
            return None
        rows, key = place.rows, f"{place.rows.name}{WORN}"
        found = self._aside(place, record)
        if key in record.memory:
            worn = record.memory[key] - (self._before.memory[key] if self._before is not None else 0.0)
            found += float(rows.W_n @ (record.p[place.normal] * worn))
        return found

    def _aside(self, place: ContactBlock, record: Record) -> float:
        """Work in a step of friction on the sliding out of the plane [J]."""
        rows, law = place.rows, place.rows.friction
        if not isinstance(law, Turned) or law.points is None:
            return 0.0
        lasts = record.time - (self._before.time if self._before is not None else 0.0)
        far, share = slid(law.slide, law.points, record.time, lasts, law.end), record.memory[rows.name]
        whole = self._bound(place, record, np.ones_like(share))
        return float(rows.W_t @ (whole * np.sqrt(np.maximum(1 - share**2, 0.0)) * far))

    def _fields(self, record: Record, before: Record | None, w: Array, scales: Scales) -> float:
        """Largest difference of a stored field, see `Audit` [-]; collective."""
        stored, found = record.stored, [difference(record.w, w, rounding=scales.rounding)]
        for place in self.cone.places:
            rows, moved = place.rows, self._motion(place.rows, record)
            if before is not None:
                found += self._history(place, record, before, scales)
            if rows.name in stored.contacts:
                found += contact_differences(
                    rows,
                    stored.contacts[rows.name],
                    record.p[place.normal],
                    record.p[place.tangential].reshape(-1, place.components),
                    self._along_traction(place, record),
                    self._gap(rows, record)[1],
                    moved,
                    scales.p,
                    scales.u[rows.name],
                    scales.rounding,
                    max(scales.noise, scales.rest),
                    not stored.law_error,
                )
            if rows.name in stored.contacts and not self._searched(rows, record):
                slip = np.asarray(stored.contacts[rows.name]["slip"], float)[:, : rows.surface.dim]
                found.append(difference(slip, slip_of(rows, moved), rounding=scales.rounding))
        if len(stored.stress):
            found.append(stress_difference(self.system, record.displacement, record.time, stored))
        return _largest(found)

    def _searched(self, rows: ContactRows, record: Record) -> bool:
        """Whether pairs of a contact are not those of the start."""
        return self.system.problem.pairs[rows.name].contact.sliding or rows.name in record.searched

    def _history(self, place: ContactBlock, record: Record, before: Record, scales: Scales) -> list[float]:
        """Differences of what slip is counted from, and of the stored slip, from those of the step before [-]."""
        rows, t, found = place.rows, before.p[place.tangential], []
        law, wears = rows.friction, f"{rows.name}{WORN}" in record.memory
        softness, moved = law.k_T if law is not None else None, self._motion(rows, before)
        if not (softness and rows.name in record.searched):  # t turns with the frames of other rows
            start = rows.N_t @ moved.ravel() - (t / softness if softness else 0.0)
            # of points that close in the step it counts from where they touch: that is known at its end alone
            pressed = rows.average @ record.p[place.normal] > 0
            same = len(before.p) == len(record.p)  # else pairs were found, and what was pressed has other rows
            was = rows.average @ before.p[place.normal] > 0 if same else np.zeros(len(pressed), bool)
            closes = np.repeat(pressed & ~was & (rows.normal.sides == 1), rows.free.shape[1])
            reference = np.where(closes, start, record.reference[place.tangential])
            found.append(difference(reference, start, scales.u[rows.name], scales.rounding))
        if wears or rows.name in record.memory:
            moves = rows.N_t @ self._motion(rows, record).ravel() - record.reference[place.tangential]
            moves -= record.p[place.tangential] / softness if softness else 0.0
            length = np.linalg.norm(moves.reshape(rows.free.shape) * rows.free, axis=1)
            lasts = record.time - before.time
            if wears and not self._searched(rows, record):
                found += self._wear(place, record, before, length, scales)
            if law is not None and rows.name in record.memory:
                length *= (rows.average @ record.p[place.normal] > 0) | (rows.normal.sides == 2)
                known = self._carried(rows, before) if rows.name in record.searched else before.memory[rows.name]
                own, now_known = remembered(law, known, length, lasts), record.memory[rows.name]
                expected = law.after(known, length, lasts) if own is None else own
                unit = np.asarray(lasts if law.timed else 1.0)  # of a rate; what it makes of a step is a length
                if isinstance(law, RateAndStateByPoint):
                    unit = np.column_stack([law.Dc, np.full(len(law.Dc), lasts)])
                found.append(difference(unit * now_known, unit * expected, scales.u[rows.name], scales.rounding))
                if (shown := record.stored.contacts.get(rows.name, {}).get("rate")) is not None:
                    rates = rows.share_t.T @ np.atleast_2d(now_known.T)[-1]
                    found.append(difference(np.asarray(shown, float), rates, rounding=scales.rounding))
        now, then = (each.stored.contacts.get(rows.name) for each in (record, before))
        if now is not None and then is not None:
            step = slip_of(rows, self._motion(rows, record) - moved)
            total = np.asarray(then["slip"], float)[:, : rows.surface.dim] + step
            for name, expected in (("slip_increment", step), ("slip", total)):
                slip = np.asarray(now[name], float)[:, : rows.surface.dim]
                found.append(difference(slip, expected, scales.u[rows.name], scales.rounding))
        return found

    def _carried(self, rows: ContactRows, before: Record) -> Array:
        """What the points of a step remember, at the points of rows whose pairs were found since (m_t,)."""
        system = self.start.searched(before.searched) if before.searched else self.start
        (old,) = (c for c in system.contacts if c.name == rows.name)
        return rows.tangential_mean(old.share_t.T @ before.memory[rows.name])

    def _wear(self, place: ContactBlock, record: Record, before: Record, slip: Array, scales: Scales) -> list[float]:
        """Differences of worn depths, and of the path that wears, from those of pressure and slip (m_t,) [m] [-]."""
        rows, now, found = place.rows, record.memory, list[float]()
        assert rows.fields is not None
        assert rows.fields.wear is not None
        points = np.asarray(rows.fields.to_points @ rows.fields.points)
        path = slid(rows.fields.slide, points, record.time, record.time - before.time, rows.fields.end)
        if (key := f"{rows.name}{SLID}") in now:
            near = rows.average.T @ rows.W_t
            path = np.sqrt(path**2 + (rows.average.T @ (rows.W_t * slip) / np.where(near > 0, near, np.inf)) ** 2)
            found.append(difference(now[key], before.memory[key] + path, scales.u[rows.name], scales.rounding))
        key, shown = f"{rows.name}{WORN}", record.stored.contacts.get(rows.name, {}).get("wear")
        if shown is not None:
            found.append(difference(np.asarray(shown, float), rows.node_pressure(now[key]), rounding=scales.rounding))
        p_n, far = record.p[place.normal], now.get(f"{rows.name}{SLID}", np.zeros(0))
        off = worn_rate(rows.fields.wear, points, record.time, rows.fields.end, p_n, far) * path * p_n
        return [*found, difference(now[key], before.memory[key] + off, scales.u[rows.name], scales.rounding)]

    def _inner(self, u: Vec) -> Vec:
        """Inner forces of bodies and of effects that stiffen them [N]; u: displacement of all dofs [m]."""
        dx.fill(self._u, u.array_r)
        self.start.dilatation.fill(self._dilatation, u)
        return self.start.constraints.links.inner(u, dx.assemble_vector(*self._inner_forces))

    @cached_property
    def _signs(self) -> Vec:
        """A pseudo-random sign for each displacement dof, the same on any number of ranks."""
        nodes, signs = self.start.nodes, self.start.vector()
        numbers = nodes.input[: nodes.owned, None] * self.start.mesh.dim + np.arange(self.start.mesh.dim)
        signs.array[:] = np.sign(np.sin(numbers.astype(float) ** 2)).ravel()
        return signs

    @cached_property
    def _largest_stiffness(self) -> float:
        """Estimate from below of the largest row sum of |K| [N/m]: the inner forces of pseudo-random signs."""
        return float(self._inner(self._signs).norm(PETSc.NormType.INFINITY))

    def _contact_force(self, place: ContactBlock, u: Vec, record: Record, scales: Scales) -> Vec:
        """Nodal forces B^T p of one contact over all displacement dofs [N]; with compliance p_n is that of u.

        Against a rigid obstacle those of multipliers come from forms. Between bodies, on a part of a side, round its
        corners, and on that of a cyclic sector, no form over one mesh has them: there they are the rows' own, N^T W p.
        """
        system, rows = self.system, place.rows
        p_n, t = record.p[place.normal], record.p[place.tangential].reshape(-1, place.components)
        compliant = isinstance(rows.normal, Compliance)
        side = rows.surface
        parts = system.problem.shares(rows.name) or side.images is not None or (compliant and not rows.of_facets)
        if rows.master is not None or parts:
            return system.interface.force_of(rows, self._pressure_of_law(rows, record) if compliant else p_n, t)
        force = self._compliant_force(rows, u, record) if compliant else system.vector()
        if compliant and rows.friction is None:
            return force
        if rows.name not in self._multiplier_forces:
            (start,) = (c for c in self.start.contacts if c.name == rows.name)
            self._multiplier_forces[rows.name] = MultiplierForces(self.start, start)
        s = self._along_traction(place, record)
        return force + self._multiplier_forces[rows.name](rows, p_n, t, s, scales.p, record.searched.get(rows.name))

    def _compliant_force(self, rows: ContactRows, u: Vec, record: Record) -> Vec:
        """Nodal forces of a compliant pressure against a rigid obstacle [N]: j_n of u, as the side was at the start.

        Where contact slides, normals and gaps are those of the rows, and so are the forces.
        """
        system, law = self.system, rows.normal
        assert isinstance(law, Compliance)
        pair = system.problem.pairs[rows.name]
        formula = system.problem.obstacles[str(pair.obstacle)].written_in_operators and pair.contact.wear is None
        if rows.name in record.searched or not (formula and isinstance(pair.contact.gap_offset, float | int)):
            p_n = self._pressure_of_law(rows, record)
            return system.interface.force_of(rows, p_n, np.zeros(rows.free.shape))
        if rows.name not in self._j_n:
            forms = ComplianceForms(system.weak, pair.contact, law)
            self._j_n[rows.name] = forms, system.weak.compile(forms.work)
        forms, work = self._j_n[rows.name]
        relative = relative_to_obstacle(system, rows.name, u, record.time, record.driven)
        dx.fill(forms.relative, relative.array_r)
        return dx.assemble_vector(work)

    def _pressure_of_law(self, rows: ContactRows, record: Record) -> Array:
        """Compliant pressures (m_n,) [Pa] of the displacement, at the quadrature points of the rows."""
        law = rows.normal
        assert isinstance(law, Compliance)
        closing = rows.N_n @ self._motion(rows, record).ravel() - self._gap(rows, record)[0]
        own = pressure(law, closing)
        return own if own is not None else law.pressure(closing)

    def _bound(self, place: ContactBlock, record: Record, memory: Array | None = None) -> Array:
        """Friction bound (m_t,) [Pa] at the stored pressures, by the second formula if there is one.

        Args:
            memory: of the law (m_t,); by default the stored one.
        """
        rows, p_n = place.rows, record.p[place.normal]
        assert rows.friction is not None
        now = record.time, self.cone.end
        memory = record.memory.get(rows.name, np.zeros(len(rows.W_t))) if memory is None else memory
        own = bound(rows.friction, rows.normal, p_n, rows.average, *now, memory)
        return own if own is not None else rows.friction.at(memory).limit(p_n, rows.average, rows.normal, *now)

    def _along_traction(self, place: ContactBlock, record: Record) -> Array:
        """The same in the directions of the tangential tractions, zero without friction."""
        if place.rows.friction is None:
            return np.zeros(len(place.rows.W_t))
        t = record.p[place.tangential].reshape(-1, place.components)
        return place.rows.along_traction(self._bound(place, record), t)

    def _normal(self, place: ContactBlock, record: Record, w: Array, scales: Scales) -> tuple[float, float, float]:
        """Penetration, negative pressure and complementarity of one contact, see `Audit` [-]."""
        rows, p, u_top = place.rows, record.p[place.normal], scales.u[place.rows.name]
        own = penetration(rows.normal, p)
        depth = own if own is not None else rows.normal.penetration(p)
        closing = w[place.normal] - self._gap(rows, record)[0]
        deeper = closing - depth
        deeper = np.sign(deeper) * np.maximum(np.abs(deeper) - scales.rounding, 0.0)
        if rows.normal.sides == 2:
            return _largest(np.abs(deeper)) / u_top, 0.0, 0.0
        negative = _largest(-p - scales.rest) / scales.p
        if isinstance(rows.normal, Compliance):  # near the law's graph in either direction
            by_pressure = (np.abs(p - self._pressure_of_law(rows, record)) - scales.rest) / scales.p
            by_depth = np.where((p > 0) | (closing > scales.rounding), np.abs(deeper), 0.0) / u_top
            return _largest(np.minimum(by_pressure, by_depth)), negative, 0.0
        both = np.minimum(np.maximum(p - scales.rest, 0.0) / scales.p, np.maximum(-deeper, 0.0) / u_top)
        return _largest(deeper) / u_top, negative, _largest(both)

    def _tangential(self, place: ContactBlock, record: Record, w: Array, scales: Scales) -> tuple[float, float, float]:
        """Excess over the friction bound, slip law and negative friction work of one contact, see `Audit` [-]."""
        rows, u_top = place.rows, scales.u[place.rows.name]
        if rows.friction is None:
            return 0.0, 0.0, 0.0
        t = record.p[place.tangential].reshape(-1, place.components)
        moved = (w - record.reference)[place.tangential] - (t.ravel() / rows.friction.k_T if rows.friction.k_T else 0.0)
        du = moved.reshape(t.shape) * rows.free
        du = np.where(np.linalg.norm(du, axis=1, keepdims=True) > scales.rounding, du, 0.0)
        s = self._bound(place, record)
        finite = np.isfinite(s)
        least = FRICTION * scales.p
        s_top = max(_largest(s[finite]), least)
        length, slip = np.linalg.norm(t, axis=1), np.linalg.norm(du, axis=1)
        inside = t * np.minimum(1.0, s / np.maximum(length, TINY))[:, None]
        trial = inside + s_top / u_top * du
        far = np.linalg.norm(trial, axis=1)
        back = trial * np.minimum(1.0, s / np.maximum(far, TINY))[:, None]
        work = np.einsum("mi,mi->m", t, du)
        some = float(rows.W_t @ (np.maximum(length, least) * slip)) + s_top * u_top * float(rows.W_t.sum())
        excess = _largest((length - s)[finite] - scales.rest) / s_top
        wasted = max(-float(rows.W_t @ (work + scales.rest * slip)), 0.0)
        slips = _largest(np.linalg.norm(inside - back, axis=1) - scales.rest) / s_top
        return excess, slips, wasted / some if some else 0.0  # 0: smaller than the smallest number


def _law_stiffness(place: ContactBlock, p: Array) -> float:
    """Change of the normal force of a compliant contact by a common motion [N/m]; 0 for rigid laws."""
    p_n = p[place.normal]
    k = place.rows.normal.stiffness(p_n, p_n)
    return float(place.rows.W_n @ np.where(np.isfinite(k), k, 0.0))


def _largest(values: Array | list[float]) -> float:
    """The largest value, at least 0; nan if one is nan."""
    return float(np.max(values, initial=0.0)) + 0.0  # no -0


def recall(system: System, time: float, shortened: Array) -> None:
    """Use the shortenings and slacks (b,) [m] that were found at a time [s]."""
    bolts = zip(system.initial.tightened, shortened.tolist(), strict=True)
    system.course.found = {bolt.shortening: ((time, x),) for bolt, x in bolts}


def tension_off(system: System, u: Vec, time: float) -> Array:
    """By how much the tension of each bolt differs from what the scene gives [N], 0 where it is held; collective.

    Of a spring that acts in one way it is the smaller one of its force and of what its slack would take.
    """
    course, bolts = system.course, system.initial.tightened
    held = [time > bolt.held_from * (1 + EXACT) for bolt in bolts]
    if all(held):
        return np.zeros(0)
    values, k = system.initial.values(course, time), np.diag(system.initial.coupling)
    work, off = system.initial.stress_work(values, u), list[float]()
    for bolt, gone in zip(bolts, held, strict=True):
        if bolt.tension is None:
            off.append(min(-work[bolt.index], k[bolt.index] * (values[bolt.index] + bolt.gap)))
        elif not gone:
            off.append(-work[bolt.index] - course.value(bolt.tension, time))
    return np.array(off)
