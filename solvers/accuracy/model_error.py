"""Model error: what strains and rotations that linear elasticity leaves out change in each number of a step.

Of a displacement u with gradient H, the St. Venant-Kirchhoff stress is S = C : (eps + H^T H / 2), and F S with
F = I + H acts on the undeformed body. By D = C : A + H (sigma + C : A) with A = H^T H / 2 it exceeds sigma = C : eps,
and its inner forces are not balanced. Of A in brackets W^T W / 2 is left out, W the rotation in H: bodies give way to
it. The step is solved once more with the forces of D as loads (one step of modified Newton's method for the total
Lagrangian problem): bodies answer with their linear stiffness, contact and friction anew. What numbers change by is the
estimate; where D is below `SLIGHT` of the stress, it is that part of each number. Sides keep their normals, and loads
their direction. Of bodies whose dilatation is averaged there is no estimate, nor in steps between two turns of the
values in time, at which it is the largest.

Source: Bathe, Finite Element Procedures (1996), section 6.3.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import EXACT, SLIGHT, Array, inverse_and_determinant
from stickslip.geometry.errors import SolverError
from stickslip.geometry.protocols import Vec
from stickslip.solvers.iteration import Status, ignore
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.step_result import Quantity, StepResult, quantities
from stickslip.solvers.scene.record import Value
from stickslip.solvers.stepping.pairs import carried_over
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.stepper import Accepted
from stickslip.solvers.stepping.update import displacement, new_state
from stickslip.solvers.system.system import System

log = logging.getLogger(__name__)


def model_errors(observe: Observer, accepted: Accepted, result: StepResult) -> dict[Quantity, Value]:
    """The estimate for each number of a step, >= 0; empty where it is not found; collective."""
    if accepted.stepper.system.problem.averaged or _between_turns(accepted):
        return {}
    with accepted.stepper.system.counters.clock.phase("error", "model"):
        return _changes(observe, accepted, result)


def _changes(observe: Observer, accepted: Accepted, result: StepResult) -> dict[Quantity, Value]:
    share, forces, _ = left_out(observe, accepted.stepper.system, accepted.state)
    values = quantities(result)
    if share < SLIGHT:
        return {key: share * np.abs(value) for key, value in values.items()}
    try:
        with accepted.stepper.system.counters.for_error():
            state = _answer(accepted, forces)
    except (SolverError, np.linalg.LinAlgError) as error:
        log.info("t = %g: the error of the model is unknown: %s", result.time, error)
        state = None
    if state is None:
        return {}
    theirs = quantities(observe.without_errors()(replace(accepted, state=state)))
    return {key: np.abs(theirs[key] - value) for key, value in values.items()}


def _between_turns(accepted: Accepted) -> bool:
    """Whether a step ends between two turns of the values in time: what it is off by grows up to the next one."""
    line, time = accepted.stepper.system.problem.timeline, accepted.state.time
    near = EXACT * line.end
    own, turns = np.array(line.times), np.array([*line.turns, line.times[-1]])
    return bool(np.abs(own - time).min() <= near < np.abs(turns - time).min())


def left_out(observe: Observer, system: System, state: State) -> tuple[float, Vec, Array]:
    """What D is of the stress, in the mean over the bodies [-], and its inner forces over all dofs [N]; collective.

    Third is the size of D in this rank's own cells (cells,) [Pa].
    """
    mesh = system.mesh
    stress, shape = observe.stress(state.u, state.initial), mesh.domain.topology.cell_type.name
    basis, slopes = dx.reference_basis(shape, mesh.degree, dx.midpoint(mesh.domain))
    own = slice(len(stress))
    x = mesh.domain.geometry.x[:, : mesh.dim][dx.cell_nodes(mesh.domain)[own]]
    nodes = dx.cell_dofs(system.space)[own]
    u = observe.stress.displacement.x.array.reshape(-1, mesh.dim)[nodes]
    jacobian = np.einsum("kn,cni->cki", slopes[:, 0], x)
    inverse, determinant = inverse_and_determinant(np.moveaxis(jacobian, 0, -1))
    gradients = np.moveaxis(inverse, -1, 0) @ slopes[:, 0]  # (c, i, n)
    volume = np.abs(determinant) * dx.reference_rule(shape, 1)[1].sum()
    H = np.zeros_like(stress)
    H[:, : mesh.dim, : mesh.dim] = np.einsum("cni,cjn->cij", u, gradients)
    radius = x[..., 0] @ basis[0]
    if mesh.axisymmetric:
        H[:, 2, 2], volume = u[..., 0] @ basis[0] / radius, 2 * np.pi * radius * volume
    half, spin = np.einsum("cki,ckj->cij", H, H) / 2, (H - H.swapaxes(1, 2)) / 2
    more, lasting = np.zeros_like(stress), half + spin @ spin / 2
    for body, members in observe.stress.members.items():
        law, plane_stress = system.problem.bodies[body], system.problem.model == "plane stress"
        more[members] = law.stress(half[members], plane_stress)
        lasting[members] = law.stress(lasting[members], plane_stress)
    more += H @ (stress + lasting)
    weighted = more * volume[:, None, None]
    forces = np.einsum("cij,cjn->cni", weighted[:, : mesh.dim, : mesh.dim], gradients)
    if mesh.axisymmetric:
        forces[..., 0] += np.outer(weighted[:, 2, 2] / radius, basis[0])
    at_nodes = np.zeros((len(observe.stress.displacement.x.array) // mesh.dim, mesh.dim))
    np.add.at(at_nodes, nodes, forces)
    vector = system.vector()
    vector.array[:] = dx.sums_on_owners(system.space, at_nodes).ravel()
    sizes = np.linalg.norm([more, stress], axis=(2, 3))
    part, whole = mesh.comm.allreduce(sizes @ volume)
    return float(part / whole) if whole else 0.0, vector, sizes[0]


def _answer(accepted: Accepted, forces: Vec) -> State | None:
    """The state of a step that has to balance these inner forces over all dofs [N] too; None: no solver; collective."""
    stepper, state, problem = accepted.stepper, accepted.state, accepted.problem
    system, surface = stepper.system, stepper.surface
    old = accepted.substep_start
    if old.rows is not system.contacts:
        old = carried_over(old, system)
    free = system.T.createVecRight()
    system.T.multTranspose(-forces, free)
    problem = replace(problem, load=surface.with_more(problem.load, free, balanced=False))
    p, u_c = state.p, np.zeros(surface.size)
    if len(p):
        solve = stepper.chain.beside(system, surface, state, SLIGHT)
        if solve is None:
            return None
        found = solve(problem, p, ignore)
        if found.status is not Status.CONVERGED:
            raise SolverError(found.status.value)
        p, u_c = found.p, found.u_c
    u, strained = displacement(system, state.time, surface.recover(problem.load, p, u_c), state.u_s)
    driven: Array = u_c[len(u_c) - surface.driven :]
    return new_state(
        system=system,
        old=old,
        problem=problem,
        u=u,
        u_strained=strained,
        u_s=state.u_s,
        load=state.load - forces,
        p=p,
        driven=driven,
        initial=state.initial,
    )
