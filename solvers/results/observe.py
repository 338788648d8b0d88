"""From an accepted step to its `StepResult`: contact states, reactions, stress, probes and error estimates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import EXACT, ROUNDING, TINY, Array, Ints, cross
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.protocols import Vec
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.effects import active
from stickslip.solvers.effects.effect import Equilibrium
from stickslip.solvers.laws.wear import WORN
from stickslip.solvers.parallel.gather import Gather, cells_of, nodes_of
from stickslip.solvers.results.recovered_stress import RecoveredStress
from stickslip.solvers.results.resultants import acting, moved_along
from stickslip.solvers.results.step_result import (
    OPEN,
    SLIP,
    STICK,
    ContactState,
    MeshData,
    Numbers,
    Quantity,
    StepResult,
    SurfaceMesh,
    von_mises,
)
from stickslip.solvers.scene.record import (
    BodyState,
    ContactNumbers,
    ObstacleState,
    ProbeValue,
    Reaction,
    Record,
    Value,
    numbers_of,
)
from stickslip.solvers.scene.timeline import Place
from stickslip.solvers.stepping.law_memory import with_memory
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.stepper import Accepted
from stickslip.solvers.stepping.substep import SubstepSolver
from stickslip.solvers.system.system import System

Estimate = Callable[["Observer", "Accepted", StepResult], StepResult]
LINEAR = 4.0  # the error of conjugate gradients is estimated from below; measured up to 3.7 times too small


def iteration_error(accepted: Accepted) -> float:
    """Error of the displacement that the iteration leaves, energy norm, relative to the largest so far [-].

    The exact solution of the same discrete steps is found on the surface, see `Correction`; what an iterative volume
    solve leaves is added. NaN: no exact solution was found.
    """
    state = accepted.state
    if state.correction is None or state.peak <= 0:
        return 0.0
    return EXACT + LINEAR * accepted.linear_error + state.correction.size / float(np.sqrt(2 * state.peak))


def law_error(accepted: Accepted) -> float:
    """Error left by the method's approximation of the contact laws, energy norm, relative to the largest so far [-].

    The errors of all steps add up: each step starts from the slip of the one before, and an error of that slip changes
    the displacement by no more than itself (with Tresca's law a step is a non-expansive map in the energy norm).
    """
    state = accepted.state
    return state.law_error / float(np.sqrt(2 * state.peak)) if state.law_error else 0.0


class CellStress:
    """Stress at the midpoints of this rank's own cells, or at points, of the strain minus the initial strain.

    It is compiled once.

    Attributes:
        displacement: dolfinx Function that the last call has set to its u, ghosts included [m].
        members: own cells of each body.
    """

    def __init__(self, system: System) -> None:
        """Compile the strain; collective."""
        self._system, mesh = system, system.mesh
        self.displacement = dx.fem.Function(system.space)
        self._strain = system.weak.strain_by_cell(self.displacement)
        self._means = system.dilatation.functions()
        count = mesh.domain.topology.index_map(mesh.dim).size_local
        shape, degree = mesh.domain.topology.cell_type.name, mesh.geometry_degree
        basis, slope = dx.reference_basis(shape, degree, dx.midpoint(mesh.domain))
        corners = mesh.domain.geometry.x[:, : mesh.dim][dx.cell_nodes(mesh.domain)[:count]]
        self._middles = np.einsum("n,cnd->cd", basis[0], corners)
        self._volumes = np.abs(np.linalg.det(np.einsum("ak,ckd->cad", slope[:, 0], corners)))
        if mesh.axisymmetric:
            self._volumes *= self._middles[:, 0]
        self._nodes, self._axis = len(system.nodes.points), ROUNDING * system.extent  # radius [m] of what lies on it
        self.members = {name: cells[cells < count] for name, cells in ((b, mesh.cells_of(b)) for b in mesh.bodies)}

    def __call__(self, u: Vec, initial: Array) -> Array:
        """Stress (own cells, 3, 3) [Pa], tension positive; collective.

        Args:
            u: displacement of all dofs [m].
            initial: values (k,) of the initial strains.
        """
        dx.fill(self.displacement, u.array_r)
        strain, problem, strains = self._strain(), self._system.problem, self._system.initial
        grown, stress = np.zeros(len(strain)), np.empty_like(strain)
        for number, given in enumerate(strains.strains):
            members, timeline = self.members[given.body], self._system.course.timeline
            own_strain = strains.at(number, self._middles[members], members, timeline)
            strain[members] -= initial[number] * own_strain
            grown[members] += initial[number] * strains.dilatation(number, own_strain, members)
        for body, members in self.members.items():
            stress[members] = problem.bodies[body].stress(strain[members], problem.model == "plane stress")
        for body, mean in self._system.dilatation.at_midpoints(u, self._means).items():
            members = self.members[body]
            change = mean[members] - grown[members]
            stress[members] = problem.isotropic[body].stress(strain[members], False, change)
        return stress

    def at(self, places: Mapping[str, tuple[int, Array] | None], stress: Array, initial: Array) -> dict[str, Array]:
        """Stress (3, 3) [Pa] at points, on every rank; collective.

        With order 2 it is that of the displacement there. With order 1, whose stress hardly changes in a cell, the
        recovered stress is nearer: means at the nodes, of the cells of the body around each, interpolated to the point.

        Args:
            places: cell and basis (k,) at the point, on the rank that owns it; None on others.
            stress: of the last call (own cells, 3, 3) [Pa].
            initial: values (k,) of the initial strains then.
        """
        comm, mesh = self._system.mesh.comm, self._system.mesh
        own = {name: (place, self._body_of(place[0])) for name, place in places.items() if place is not None}
        if mesh.degree == 2:
            found = {
                name: stress[place[0]] + self._beside(*place, body, initial) for name, (place, body) in own.items()
            }
        else:
            asked = sorted(set[str]().union(*comm.allgather({body for _, body in own.values()})))
            means = {body: self._means_at_nodes(self.members[body], stress) for body in asked}
            nodes = dx.cell_dofs(self._system.space)
            found = {name: basis @ means[body][nodes[cell]] for name, ((cell, basis), body) in own.items()}
            found = {name: six.reshape(3, 3) for name, six in found.items()}
        return {name: each for offer in comm.allgather(found) for name, each in offer.items()}

    def _body_of(self, cell: int) -> str:
        return next(name for name, members in self.members.items() if cell in members)

    def _beside(self, cell: int, basis: Array, body: str, initial: Array) -> Array:
        """Stress (3, 3) [Pa] at a point less that at the midpoint of its cell."""
        system, middle = self._system, dx.midpoint(self._system.mesh.domain)
        shape, degree, dim = system.mesh.domain.topology.cell_type.name, system.mesh.degree, system.mesh.dim
        local = np.concatenate([basis[None] @ dx.reference_nodes(shape, degree), middle])
        values, slope = dx.reference_basis(shape, degree, local)  # (2, k), (dim, 2, k)
        points = system.nodes.points[dx.cell_dofs(system.space)[cell]]
        moved = self.displacement.x.array.reshape(-1, dim)[dx.cell_dofs(system.space)[cell]]
        change = np.linalg.solve(np.einsum("aqk,ki->qai", slope, points), np.einsum("aqk,ki->qai", slope, moved))
        strain = np.zeros((2, 3, 3))
        strain[:, :dim, :dim] = (change + np.swapaxes(change, 1, 2)) / 2
        x = values @ points
        if system.mesh.axisymmetric:
            on_axis = x[:, 0] <= self._axis  # there u_r / r is its limit
            strain[:, 2, 2] = np.where(on_axis, strain[:, 0, 0], values @ moved[:, 0] / np.where(on_axis, 1.0, x[:, 0]))
        for number, given in enumerate(system.initial.strains):
            if given.body == body:
                strain -= initial[number] * system.initial.at(number, x, np.repeat(cell, 2), system.course.timeline)
        beside, plane_stress = strain[:1] - strain[1:], system.problem.model == "plane stress"
        if body in system.problem.averaged:  # the dilatation is a mean of the cell
            return np.asarray(system.problem.isotropic[body].stress(beside, False, np.zeros(1))[0])
        return np.asarray(system.problem.bodies[body].stress(beside, plane_stress)[0])

    def _means_at_nodes(self, members: Ints, stress: Array) -> Array:
        """Means (nodes, 9) [Pa] of the stress of the cells of a body around each node, by volume; collective."""
        nodes, six = dx.cell_dofs(self._system.space)[members].T, stress[members].reshape(-1, 9).T
        of_cells = self._volumes[members] * np.concatenate([six, np.ones((1, len(members)))])
        total = np.array([np.bincount(nodes.ravel(), np.tile(each, len(nodes)), self._nodes) for each in of_cells])
        total = dx.sums_at_nodes(self._system.space, total)
        return np.asarray((total[:9] / np.maximum(total[9], TINY)).T)


@dataclass(frozen=True, kw_only=True)
class Observer:
    """Makes the `StepResult` of an accepted step; made once for a simulation with `of`, then called."""

    stepper: SubstepSolver
    stress: CellStress
    by_node: Gather  # own nodes to all nodes, on rank 0
    by_cell: Gather  # own cells to all cells, on rank 0
    probes: Mapping[str, tuple[int, Array] | None]  # cell, and its basis at the point (k,); None on other ranks
    data: MeshData | None  # whose error is estimated; None: nobody asks for it
    recovered: RecoveredStress | None  # estimates it
    estimate: Estimate | None  # adds errors of numbers to a result

    @classmethod
    def of(cls, stepper: SubstepSolver, data: MeshData | None = None, estimate: Estimate | None = None) -> Observer:
        """Compile the strain and find the cells of the probes; collective.

        Args:
            stepper: whose steps it will observe.
            data: the mesh, to estimate its error; None: it is not estimated.
            estimate: adds errors of numbers to a result; collective. None: nothing is added.

        Raises:
            SceneError: a probe lies outside the bodies.
        """
        system = stepper.system
        points = {name: np.array(probe.point) for name, probe in system.problem.probes.items()}
        return cls(
            stepper=stepper,
            stress=CellStress(system),
            by_node=nodes_of(system.mesh, system.nodes),
            by_cell=cells_of(system.mesh),
            probes={name: _locate(system.mesh, x, name) for name, x in points.items()},
            data=data,
            recovered=None if data is None else RecoveredStress(system),
            estimate=estimate,
        )

    def without_errors(self) -> Observer:
        """The same that estimates nothing."""
        return replace(self, data=None, recovered=None, estimate=None)

    def __call__(self, accepted: Accepted) -> StepResult:
        """The result of a step; collective. Displacement and stress are on rank 0 only."""
        system, state = accepted.stepper.system, accepted.state
        cell_stress, nodal = self.stress(state.u, state.initial), self.stress.displacement.x.array
        numbers = self.numbers(accepted)
        displacement = self.by_node(state.u.array.reshape(-1, system.mesh.dim))
        mesh_error, stress_error = self._mesh_error(state)
        found = StepResult(
            time=state.time,
            substeps=accepted.substeps,
            iterations=accepted.iterations,
            volume_solves=accepted.volume_solves,
            residual=accepted.residual,
            displacement=displacement,
            stress=self.by_cell(cell_stress),
            **vars(numbers),
            probes=self._probes(nodal, cell_stress, state.initial),
            iteration_error=iteration_error(accepted),
            mesh_error=mesh_error,
            stress_error=stress_error,
            law_error=law_error(accepted),
            linear_error=accepted.linear_error,
            p=state.p,
            w=state.w,
            reference=accepted.problem.gap,
            driven=state.driven,
            shortened=state.initial[[bolt.index for bolt in system.initial.tightened]],
            searched=state.searched,
            memory=state.memory,
            weakening=accepted.weakening,
            p_ref=accepted.problem.p_ref,
            u_ref=accepted.problem.u_ref,
            convergence=accepted.convergence,
            history=tuple(row.as_tuple() for row in accepted.history),
            other_solutions=tuple(_normal_forces(accepted, p) for p in accepted.others),
            unique="several" if accepted.others else "proved" if accepted.proved else "not proved",
            jump=accepted.jump,
            bodies=self._bodies(nodal, cell_stress),
            events=state.events,
            batches=state.batches,
            columns=self._columns(state.time),
        )
        if self.estimate is None:
            return found
        with system.counters.clock.phase("error", "mesh"):
            return self.estimate(self, accepted, found)

    def numbers(self, accepted: Accepted) -> Numbers:
        """Numbers of a step, without fields of the volume; collective."""
        system, state = accepted.stepper.system, accepted.state
        contacts = {c.name: self._contact(i, c.at(state.time), accepted) for i, c in enumerate(system.contacts)}
        reactions = system.reactions(state.residual) if state.reactions is None else state.reactions
        held = {**reactions, **system.ground.by_key(state.ground, system.mesh.dim)}
        reactions = moved_along(system, state.u, held)
        return Numbers(
            contacts=contacts,
            obstacles=self._obstacles(state, contacts),
            supports={name: Reaction(*pair) for name, pair in reactions.items() if "." not in name},
            energy=state.energy,
            effects=self._effects(state, reactions),
            sums={name: self._sum(pairs, contacts, accepted) for name, pairs in system.problem.sums.items()},
        )

    def _sum(self, pairs: Sequence[str], contacts: Mapping[str, ContactState], accepted: Accepted) -> ContactNumbers:
        """Numbers of a contact of several partners: sums of those of its pairs, or the largest of them."""
        rows, parts = accepted.stepper.system.contacts, [contacts[pair] for pair in pairs]
        tangential = [self._tangential(i, c, accepted) for i, c in enumerate(rows) if c.name in pairs]
        merged: dict[str, Any] = {
            key: (np.max if key.startswith("max") or key in ("slip_rate", "state") else np.sum)(
                [getattr(part, key) for part in parts], axis=0
            )
            for key in (number.name for number in fields(ContactNumbers))
            if getattr(parts[0], key) is not None
        }
        merged = {key: value if np.ndim(value) else float(value) for key, value in merged.items()}
        return ContactNumbers(**merged | {"tangential_force": float(np.linalg.norm(np.sum(tangential, axis=0)))})

    def _tangential(self, index: int, c: ContactRows, accepted: Accepted) -> Array:
        """Resultant (d,) [N] of the multipliers along one contact, on the side that the scene calls `surface`."""
        state = accepted.state
        p_n, t = (parts[index] for parts in accepted.stepper.split(state.p))
        own = slice(len(c.surface.points))
        between = (state.forces[c.name] - c.nodal_forces(p_n, t))[own]  # the friction of a state with bubbles
        found = -c.sense * (c.node_weights[:, None] * c.node_traction(t) + between).sum(axis=0)
        return np.asarray(found * [0, 1] if c.surface.axisymmetric else found)  # the radial parts balance

    def _effects(self, state: State, reactions: Mapping[str, tuple[Array, Array]]) -> dict[str, Mapping[str, Record]]:
        """Records of what active effects report, by table and name."""
        system, reporting = self.stepper.system, [e for e in active(self.stepper.system.problem) if e.reports]
        if not reporting:
            return {}
        links, remote = system.constraints.links, system.constraints.remote
        motions = zip(remote.every, remote.split, strict=True)
        rest = state.initial[len(system.initial.strains) :] @ links.at_rest
        forces = links.resultants(links.stiffness * (state.elongation - rest))
        strained = zip(system.initial.every, state.initial, state.initial_work, strict=True)
        reached = Equilibrium(
            problem=system.problem,
            value=partial(system.course.value, time=state.time),
            links={".".join(place): force for place, force in forces.items()},
            couplings={each.coupling.key: state.remote[own] for each, own in motions},
            reactions=reactions,
            strains={e.drive: (float(x), float(work)) for e, x, work in strained if isinstance(e.drive, Place)},
        )
        return {effect.name: effect.read(reached) for effect in reporting}

    def _mesh_error(self, state: State) -> tuple[float, Array]:
        """`StepResult.mesh_error` and `stress_error`, this one on rank 0; collective."""
        if self.recovered is None:
            return np.nan, np.zeros(0)
        with self.stepper.system.counters.clock.phase("error", "stress"):
            found = self.recovered(state.u, state.initial)
            size = found.size / float(np.sqrt(2 * state.peak)) if state.peak > 0 else 0.0
            return size, self.by_cell(found.stress)

    def _bodies(self, nodal: Array, cell_stress: Array) -> dict[str, BodyState]:
        """The largest values of each body; collective.

        Args:
            nodal: displacement of all dofs that this rank knows, ghosts included [m].
            cell_stress: of the own cells (cells, 3, 3) [Pa].
        """
        system = self.stepper.system
        lengths, equivalent = np.linalg.norm(nodal.reshape(-1, system.mesh.dim), axis=1), von_mises(cell_stress)
        nodes, members = dx.cell_dofs(system.space), self.stress.members
        own = {
            name: (lengths[nodes[m]].max(initial=0.0), equivalent[m].max(initial=0.0)) for name, m in members.items()
        }
        offers = system.mesh.comm.allgather(own)
        return {name: BodyState(*np.max([offer[name] for offer in offers], axis=0).tolist()) for name in own}

    def _columns(self, time: float) -> dict[str, float]:
        """Numbers that active effects add to steps.csv at a time [s], by column."""
        system = self.stepper.system
        found = [effect.columns(system.problem, system.course.timeline, time) for effect in active(system.problem)]
        return {name: value for columns in found for name, value in columns.items()}

    def _contact(self, index: int, c: ContactRows, accepted: Accepted) -> ContactState:
        """State of one contact, number `index` of the system's."""
        state = accepted.state
        stepper = accepted.stepper
        p_n, t = (parts[index] for parts in stepper.split(state.p))
        if c.wears:
            depth = state.memory[f"{c.name}{WORN}"]
            c = c.worn(depth)
        displaced = stepper.system.interface.displacement(state.u)[index]
        u_n = c.node_motion(displaced - state.motion[c.name])[0]
        if state.surplus_motion is not None:
            u_n = u_n + np.einsum("nd,nd->n", c.frames[:, 0], state.surplus_motion[c.name])
        pressure, multiplier, gap = c.node_pressure(p_n), c.node_traction(t), c.node_gap - u_n
        slip, increment = state.slip[c.name], state.slip[c.name] - accepted.substep_start.slip[c.name]
        cone, bound = with_memory(stepper.cone.at(state.time), state.memory), np.zeros_like(pressure)
        if c.friction is not None:  # at the points that carry the multipliers, then distributed to nodes
            bound = cone.bound_at_nodes(cone.places[index], state.p)
        lam = np.divide(multiplier, bound[:, None], out=np.zeros_like(multiplier), where=bound[:, None] > 0)
        status = _status(c, pressure, multiplier, bound, increment, accepted)
        if c.slides and c.path(None, state.time, state.time - accepted.substep_start.time).any():
            status[status == STICK] = SLIP  # out of the plane
        known, law = state.memory.get(c.name), c.friction
        rates, ages = (None, None) if law is None or known is None else (law.rates(known), law.ages(known))
        weight = c.node_weights
        own = np.arange(len(c.points)) < len(c.surface.points)
        on = own if c.sense > 0 else ~own  # nodes of the side that the scene calls the surface
        forces = -state.forces[c.name][on]
        resultant, tangential = forces.sum(axis=0), self._tangential(index, c, accepted)
        here = state.time, state.driven
        acts = acting(stepper.system, c, state.forces[c.name], displaced, state.searched, here)
        moment = c.sense * acts.moment
        if c.surface.axisymmetric:  # over the full circle the radial parts balance
            resultant, moment = resultant * [0, 1], 0 * moment
        return ContactState(
            points=c.surface.points,
            weight=weight,
            gap=gap,
            pressure=pressure,
            traction=-c.sense * multiplier,
            slip=c.sense * slip,
            slip_increment=c.sense * increment,
            bound=bound,
            lam=c.sense * lam,
            status=status,
            wear=c.node_pressure(depth) if c.wears else None,
            rate=None if rates is None else c.share_t.T @ rates,
            moved=displaced[: len(c.surface.points)],
            force=resultant,
            moment=moment,
            normal_force=float(c.W_n @ p_n),
            tangential_force=float(np.linalg.norm(tangential)),
            max_pressure=float(p_n.max(initial=0.0)),
            contact_area=float(weight[status != OPEN].sum()),
            stick_area=float(weight[status == STICK].sum()),
            slip_area=float(weight[status == SLIP].sum()),
            max_penetration=float(np.max(state.w[stepper.cone.places[index].normal] - c.gap, initial=0.0)),
            max_slip=float(np.linalg.norm(slip[status != OPEN], axis=1).max(initial=0.0)),
            dissipation=float(state.energy.dissipation[index] - accepted.start.energy.dissipation[index]),
            dissipation_total=float(state.energy.dissipation[index]),
            max_wear=float(depth.max(initial=0.0)) if c.wears else None,
            worn_volume=float(c.W_n @ depth) if c.wears else None,
            slip_rate=None if rates is None else float(rates.max(initial=0.0)),
            state=None if ages is None else float(ages.max(initial=0.0)),
        )

    def _obstacles(self, state: State, contacts: Mapping[str, ContactState]) -> dict[str, ObstacleState]:
        """Each obstacle, by the contacts that it is part of."""
        system = self.stepper.system
        found = {}
        for name, obstacle in system.problem.obstacles.items():
            moved = system.obstacles.translation(name, state.time, state.driven)
            touching = [contacts[pair.name] for pair in system.problem.pairs.values() if pair.obstacle == name]
            force = sum((c.force for c in touching), np.zeros(system.mesh.dim))
            moment = sum((c.moment for c in touching), np.zeros(1 if system.mesh.dim == 2 else 3))
            axis_point = np.array(obstacle.rotation.point) + moved if obstacle.rotation else np.zeros(system.mesh.dim)
            found[name] = ObstacleState(displacement=moved, force=force, moment=moment - cross(axis_point, force))
        return found

    def at_probes(self, accepted: Accepted) -> dict[Quantity, Value]:
        """Numbers at the probes, without anything else of the volume; collective."""
        if not self.probes:
            return {}
        state = accepted.state
        cell_stress = self.stress(state.u, state.initial)
        found = self._probes(self.stress.displacement.x.array, cell_stress, state.initial)
        return {
            Quantity("probes", name, key): number.value(getattr(probe, key))
            for name, probe in found.items()
            for key, number in numbers_of(ProbeValue).items()
        }

    def _probes(self, nodal: Array, cell_stress: Array, initial: Array) -> dict[str, ProbeValue]:
        """Fields at the probes, on every rank; collective.

        Args:
            nodal: displacement of all dofs that this rank knows, ghosts included [m].
            cell_stress: of the own cells (cells, 3, 3) [Pa].
            initial: values (k,) of the initial strains.
        """
        if not self.probes:
            return {}
        system, stress = self.stepper.system, self.stress.at(self.probes, cell_stress, initial)
        values, nodes = nodal.reshape(-1, system.mesh.dim), dx.cell_dofs(system.space)
        own = {name: place[1] @ values[nodes[place[0]]] for name, place in self.probes.items() if place is not None}
        moved = {name: each for offer in system.mesh.comm.allgather(own) for name, each in offer.items()}
        return {name: ProbeValue(displacement=moved[name], stress=stress[name]) for name in self.probes}


def _normal_forces(accepted: Accepted, p: Array) -> dict[str, float]:
    """Normal force [N] of each contact under tractions p (rows,) [Pa]."""
    pressures = accepted.stepper.split(p)[0]
    rows = accepted.stepper.system.contacts
    return {c.name: float(c.W_n @ p_n) for c, p_n in zip(rows, pressures, strict=True)}


def _status(
    c: ContactRows, pressure: Array, multiplier: Array, bound: Array, increment: Array, accepted: Accepted
) -> NDArray[np.int8]:
    """OPEN, SLIP or STICK of each slave node (n,); a bilateral contact is never open.

    Args:
        c: the contact's rows.
        pressure: (n,) [Pa].
        multiplier: (n, d) tangential [Pa].
        bound: (n,) friction bound [Pa].
        increment: (n, d) slip in the last substep [m].
        accepted: the step, for its scales and its method's slack.
    """
    problem = accepted.problem
    before = float(np.abs(accepted.substep_start.p).max(initial=0.0))  # a release leaves a rest of it
    # p_ref is far too large where bodies bend freely
    scale = max(problem.scales.of_tractions(accepted.state.p), before)
    # of the largest traction, and of the motion that it causes: less than that is none
    touching = (pressure > ROUNDING * scale) | (c.normal.sides == 2)
    at_bound = np.linalg.norm(multiplier, axis=1) >= bound * (1 - accepted.slack)
    motion = min(problem.u_ref, scale / problem.stiffness)
    moving = np.linalg.norm(increment, axis=1) > ROUNDING * motion
    rests = bound.any() and (c.friction is None or c.friction.rests)  # nothing sticks without friction
    slipping = (at_bound & moving) | (not rests)
    return np.where(touching, np.where(slipping, SLIP, STICK), OPEN).astype(np.int8)


def _locate(mesh: Mesh, point: Array, name: str) -> tuple[int, Array] | None:
    """Cell of a probe and its basis (k,) at the point (d,) [m], on the rank that owns it, else None; collective.

    Of several cells it is the first one of the gmsh model.
    """
    size = float(np.max(np.diff(mesh.box(), axis=0)))
    found = dx.find_cell(mesh.domain, point, size)
    mine = (int(mesh.domain.topology.original_cell_index[found[0]]), mesh.comm.rank) if found else (np.inf, -1)
    best = min(mesh.comm.allgather(mine))
    if best[1] < 0:
        raise SceneError(f"probes.{name}.point = {point.tolist()}: lies outside the bodies")
    if found is None or best[1] != mesh.comm.rank:
        return None
    (cell, basis), shape = found, mesh.domain.topology.cell_type.name
    if mesh.degree > mesh.geometry_degree:
        local = basis[None] @ dx.reference_nodes(shape, mesh.geometry_degree)
        basis = dx.reference_basis(shape, mesh.degree, local)[0][0]
    return cell, basis


def mesh_data(system: System) -> MeshData:
    """The mesh and its contact surfaces as plain arrays, volume arrays on rank 0 only; collective."""
    mesh, nodes = system.mesh, system.nodes
    by_node, by_cell = nodes_of(mesh, nodes), cells_of(mesh)
    own = mesh.domain.topology.index_map(mesh.dim).size_local
    body = np.zeros(own, np.int64)
    for index, cells in enumerate(map(mesh.cells_of, mesh.bodies)):
        body[cells[cells < own]] = index
    known = by_node(nodes.input[: nodes.owned])
    return MeshData(
        points=by_node(nodes.points[: nodes.owned]),
        cells=np.searchsorted(known, by_cell(nodes.input[dx.cell_dofs(system.space)[:own]])),
        shape=mesh.domain.topology.cell_type.name,
        body=by_cell(body),
        bodies=tuple(mesh.bodies),
        surfaces={
            c.name: SurfaceMesh(points=c.surface.points, facets=c.surface.facets, shape=c.surface.shape)
            for c in system.contacts
        },
        slaves={c.name: np.searchsorted(known, c.surface.input) for c in system.contacts} if len(known) else {},
        gaps={c.name: c.node_gap for c in system.contacts},
    )
