"""From an accepted step to its result: what the unknowns mean at the surface's nodes, the supports and the probes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry import dolfinx_versions as dx
from geometry.errors import SceneError
from geometry.mesh import Mesh
from geometry.nodes import Nodes
from solvers.certificate import iteration_error, law_error
from solvers.operators.rows import ContactRows
from solvers.state import State
from solvers.step_result import OPEN, SLIP, STICK, ContactState, MeshData, StepResult
from solvers.stepping import Accepted, Stepper
from solvers.stress import CellStress
from solvers.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Observer:
    """Reads results off accepted steps; collective."""

    stepper: Stepper
    stress: CellStress = field(init=False)
    probes: dict[str, tuple[int, Array] | None] = field(init=False)  # cell and reference basis, where this rank has it

    def __post_init__(self) -> None:
        object.__setattr__(self, "stress", CellStress(self.stepper.system))
        system = self.stepper.system
        points = {name: np.array(probe.point) for name, probe in system.scene.probes.items()}
        object.__setattr__(self, "probes", {name: _locate(system.mesh, x, name) for name, x in points.items()})

    def __call__(self, accepted: Accepted) -> StepResult:
        system, state = accepted.stepper.system, accepted.state
        contact = system.contact_forces(*accepted.stepper.split(state.p))
        cell_stress = self.stress(state.u)
        contacts = {c.name: self._contact(i, c, accepted) for i, c in enumerate(system.contacts)}
        return StepResult(
            time=state.time,
            substeps=accepted.substeps,
            iterations=accepted.iterations,
            volume_solves=accepted.volume_solves,
            residual=accepted.residual,
            displacement=gather_nodes(system.mesh, system.nodes, state.u.array.reshape(-1, system.mesh.dim)),
            stress=gather_cells(system.mesh, cell_stress),
            contacts=contacts,
            obstacles=self._obstacles(accepted.state, contacts),
            supports=system.reactions(state.u, state.load, contact),
            probes={name: self._probe(where, state.u, cell_stress) for name, where in self.probes.items()},
            energy=state.energy,
            iteration_error=iteration_error(accepted),
            law_error=law_error(accepted),
            linear_error=accepted.linear_error,
            p=state.p,
            w=state.w,
            reference=accepted.problem.gap,
            driven=state.driven,
            searched=accepted.stepper.searched,
            p_ref=accepted.problem.p_ref,
            u_ref=accepted.problem.u_ref,
            history=tuple(row.as_tuple() for row in accepted.history),
        )

    def _contact(self, index: int, c: ContactRows, accepted: Accepted) -> ContactState:
        state = accepted.state
        stepper = accepted.stepper
        p_n, t = (parts[index] for parts in stepper.split(state.p))
        u_n = c.node_motion(stepper.system.contact_displacement(state.u)[index] - state.motion[c.name])[0]
        pressure, multiplier, gap = c.node_pressure(p_n), c.node_traction(t), c.node_gap - u_n
        slip, increment = state.slip[c.name], state.slip[c.name] - accepted.last.slip[c.name]
        place = stepper.cone.places[index]
        bound = np.zeros_like(pressure)
        if c.friction is not None:  # at the points that carry the multipliers, then at the nodes that each stands for
            bound = c.share_t.T @ accepted.problem.cone.bound(place, p_n)
        lam = np.divide(multiplier, bound[:, None], out=np.zeros_like(multiplier), where=bound[:, None] > 0)
        status = _status(c, pressure, multiplier, bound, increment, accepted)
        weight, x = c.node_weights, c.surface.points
        forces = -c.nodal_forces(p_n, t)[: len(x)]  # on the slave side
        resultant, tangential = forces.sum(axis=0), (weight[:, None] * multiplier).sum(axis=0)
        moment = np.atleast_1d(np.cross(x, forces).sum(axis=0))
        if c.surface.axisymmetric:  # over the full circle the radial parts balance
            resultant, tangential, moment = resultant * [0, 1], tangential * [0, 1], 0 * moment
        return ContactState(
            weight=weight,
            gap=gap,
            pressure=pressure,
            traction=-multiplier,
            slip=slip,
            slip_increment=increment,
            bound=bound,
            lam=lam,
            status=status,
            force=resultant,
            moment=moment,
            normal_force=float(c.W_n @ p_n),
            tangential_force=float(np.linalg.norm(tangential)),
            max_pressure=float(p_n.max(initial=0.0)),
            contact_area=float(weight[status != OPEN].sum()),
            stick_area=float(weight[status == STICK].sum()),
            slip_area=float(weight[status == SLIP].sum()),
            max_penetration=float(np.max(state.w[place.normal] - c.gap, initial=0.0)),
            max_slip=float(np.linalg.norm(slip[status != OPEN], axis=1).max(initial=0.0)),
            dissipation=float(state.energy.dissipation[index] - accepted.before.energy.dissipation[index]),
            dissipation_total=float(state.energy.dissipation[index]),
        )

    def _obstacles(self, state: State, contacts: Mapping[str, ContactState]) -> dict[str, tuple[Array, Array, Array]]:
        """Translation of each obstacle, force and moment that it exerts on the bodies."""
        system, end = self.stepper.system, self.stepper.system.scene.steps.end
        found = {}
        for name, obstacle in system.scene.obstacles.items():
            moved = obstacle.translation(state.time, end, system.mesh.dim)
            for (driven, axis), size in zip(system.driven, state.driven, strict=True):
                moved[axis] += size * (driven == name)
            touching = [contacts[key] for key, c in system.scene.contacts.items() if c.against == name]
            force = sum((c.force for c in touching), np.zeros(system.mesh.dim))
            moment = sum((c.moment for c in touching), np.zeros(1 if system.mesh.dim == 2 else 3))
            axis_point = np.array(obstacle.rotation.point) if obstacle.rotation else np.zeros(system.mesh.dim)
            found[name] = (moved, force, moment - np.cross(axis_point, force))
        return found

    def _probe(self, where: tuple[int, Array] | None, u: Any, cell_stress: Array) -> tuple[Array, Array]:
        system = self.stepper.system
        function = dx.fem.Function(system.space)
        dx.petsc_vector(function).array[:] = u.array
        function.x.scatter_forward()
        found = None
        if where is not None:
            cell, basis = where
            values = function.x.array.reshape(-1, system.mesh.dim)[dx.cell_dofs(system.space)[cell]]
            found = (basis @ values, cell_stress[cell])
        offers = [offer for offer in system.mesh.comm.allgather(found) if offer is not None]
        found_first: tuple[Array, Array] = offers[0]
        return found_first


def _status(
    c: ContactRows, pressure: Array, multiplier: Array, bound: Array, increment: Array, accepted: Accepted
) -> NDArray[np.int8]:
    """OPEN, SLIP or STICK of each node, as the result files define them."""
    touching = (pressure > 1e-9 * accepted.problem.p_ref) | (c.normal.sides == 2)
    at_bound = np.linalg.norm(multiplier, axis=1) >= bound * (1 - accepted.slack)
    moving = np.linalg.norm(increment, axis=1) > 1e-9 * accepted.problem.u_ref
    slipping = at_bound & (moving | (not bound.any()))  # nothing sticks without friction
    return np.where(touching, np.where(slipping, SLIP, STICK), OPEN).astype(np.int8)


def _locate(mesh: Mesh, point: Array, name: str) -> tuple[int, Array] | None:
    """Cell that holds the point, and its basis there: on one rank, that of the gmsh model's first such cell."""
    size = float(np.max(np.diff(mesh.box(), axis=0)))
    found = dx.find_cell(mesh.domain, mesh.degree, point, 1e-9 * size)
    mine = (int(mesh.domain.topology.original_cell_index[found[0]]), mesh.comm.rank) if found else (np.inf, -1)
    best = min(mesh.comm.allgather(mine))
    if best[1] < 0:
        raise SceneError(f"probes.{name}.point = {point.tolist()}: lies outside the bodies")
    return found if best[1] == mesh.comm.rank else None


def gather_nodes(mesh: Mesh, nodes: Nodes, values: Any) -> NDArray[Any]:
    """Values at owned nodes (own, ...) to rank 0 in the order of the gmsh model; empty elsewhere."""
    return _in_order(mesh, nodes.input[: nodes.owned], values)


def gather_cells(mesh: Mesh, values: Any) -> NDArray[Any]:
    """Values at owned cells to rank 0 in the order of the gmsh model; empty elsewhere."""
    return _in_order(mesh, np.asarray(mesh.domain.topology.original_cell_index)[: len(values)], values)


def _in_order(mesh: Mesh, numbers: NDArray[np.int64], values: Any) -> NDArray[Any]:
    parts = mesh.comm.gather((numbers, values))
    if parts is None:
        return np.asarray(values[:0])
    order = np.argsort(np.concatenate([part[0] for part in parts]))
    return np.asarray(np.concatenate([part[1] for part in parts])[order])


def mesh_data(system: System) -> MeshData:
    """The mesh and its contact surfaces as plain arrays; collective."""
    mesh, nodes = system.mesh, system.nodes
    own = mesh.domain.topology.index_map(mesh.dim).size_local
    names = tuple(mesh.bodies)
    body = np.zeros(own, np.int64)
    mine = mesh.cell_tags.indices < own
    tag_of = {tag: names.index(name) for name, tag in mesh.bodies.items()}
    body[mesh.cell_tags.indices[mine]] = [tag_of[int(tag)] for tag in mesh.cell_tags.values[mine]]
    inputs = gather_cells(mesh, nodes.input[dx.cell_dofs(system.space)[:own]])
    known = gather_nodes(mesh, nodes, nodes.input[: nodes.owned])
    return MeshData(
        points=gather_nodes(mesh, nodes, nodes.points[: nodes.owned]),
        cells=np.searchsorted(known, inputs),
        shape=mesh.domain.topology.cell_type.name,
        body=gather_cells(mesh, body),
        bodies=names,
        surfaces={c.name: (c.surface.points, c.surface.facets, c.surface.shape) for c in system.contacts},
        gaps={c.name: c.node_gap for c in system.contacts if c.master},
    )
