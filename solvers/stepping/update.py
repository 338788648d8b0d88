"""States of equilibrium, at rest and from the solution of a substep: displacement, slip, forces, work and energy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Vec
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.laws.wear import WORN
from stickslip.solvers.scene.record import Energy
from stickslip.solvers.stepping.law_memory import LawMemory, Memory, no_memory, repeats
from stickslip.solvers.stepping.state import State
from stickslip.solvers.system.system import System


def split(cone: AdmissibleSet, p: Array) -> tuple[list[Array], list[Array]]:
    """Flat tractions (rows,) [Pa] as pressures (m_n,) and tangential tractions (m_t, d-1) of each contact."""
    return [p[s.normal] for s in cone.places], [p[s.tangential].reshape(-1, s.components) for s in cone.places]


def flat_rows(contacts: tuple[ContactRows, ...], relative: list[Array]) -> Array:
    """Relative displacement of the contact rows, flat (rows,) [m].

    Args:
        contacts: the contact rows.
        relative: displacement (n_all, d) [m] of each contact's nodes, minus that of its rigid obstacle.
    """
    pairs = list(zip(contacts, relative, strict=True))
    blocks = [c.N_n @ v.ravel() for c, v in pairs] + [c.N_t @ v.ravel() for c, v in pairs]
    return np.concatenate([np.zeros(0), *blocks])


def relative_displacement(system: System, u: Vec, time: float, driven: Array) -> Array:
    """Relative displacement of the contact rows, flat (rows,) [m]; collective.

    Args:
        system: its contact rows count, and its obstacles.
        u: displacement of all dofs [m].
        time: of the obstacles' motion [s].
        driven: displacement (o,) of the obstacles that forces drive [m].
    """
    motion = system.obstacles.motions(system.contacts, time, driven)
    surfaces = system.interface.displacement(u)
    return flat_rows(system.contacts, [v - motion[c.name] for c, v in zip(system.contacts, surfaces, strict=True)])


def displacement(system: System, time: float, q: Vec, u_s: Vec) -> tuple[Vec, Vec]:
    """Displacement u = T q + u_s of all dofs [m], and u minus its rigid part [m].

    The rigid part is u_s where the supports prescribe a rigid motion and nothing else; otherwise it is zero and both
    vectors are the same. It strains nothing, and leaving it out avoids its rounding errors.
    """
    moved = system.T * q
    u = moved + u_s
    return u, u if system.rigid_motion(time) is None else moved


def at_rest(system: System, cone: AdmissibleSet) -> State:
    """The state at t = 0, without displacement, and without load or traction but for initial ones; collective.

    Args:
        cone: of the contact rows.
    """
    zero, vector = np.zeros(cone.size), system.vector
    first = np.concatenate(
        [zero[:0], *(c.initial[0] for c in cone.contacts), *(c.initial[1].ravel() for c in cone.contacts)]
    )
    nothing_yet = np.zeros(len(system.contacts))
    energy = Energy(external=0.0, stored=0.0, contact=0.0, compliance=0.0, dissipation=nothing_yet)
    driven = np.zeros(len(system.obstacles.driven))
    motion = {c.name: np.zeros_like(c.points) for c in system.contacts}
    slip = {c.name: np.zeros_like(c.surface.points) for c in system.contacts}
    forces, rows = {c.name: c.nodal_forces(*c.initial) for c in system.contacts}, system.contacts
    unstrained = np.zeros(len(system.initial.forces))
    return State(
        time=0.0,
        u=vector(),
        u_s=vector(),
        load=vector() if system.prestress is None else system.prestress.copy(),
        initial=unstrained,
        initial_work=unstrained,
        elongation=np.zeros(len(system.constraints.links.stiffness)),
        remote=np.zeros(system.constraints.remote.rows.shape[0]),
        ground=np.zeros(system.ground.forces.shape[0]),
        residual=vector(),
        p=first,
        w=zero,
        motion=motion,
        driven=driven,
        slip=slip,
        memory=no_memory(cone),
        forces=forces,
        rows=rows,
        searched={},
        energy=energy,
    )


@dataclass(frozen=True, kw_only=True)
class Surplus:
    """Contributions to a state by a displacement that is added to that of the nodes."""

    inner: Vec  # inner forces over all displacement dofs [N]
    relative: Array  # (rows,) relative displacement [m]
    motion: Mapping[str, Array]  # (n, d) relative motion at the slave's nodes of each contact in the substep [m]
    stored: float  # elastic energy [J]
    external: float  # work of loads in the substep [J]
    contact: float  # work on the contacts in the substep [J]
    initial_work: Array  # (k,) see `InitialStrains.stress_work` [J]
    elongation: Array  # (r,) of links [m]
    remote: Array  # (components,) motion of remote points [m, rad]
    ground: Array  # (components,) what springs to the ground exert [N, N m]
    friction: Mapping[
        str, tuple[Array, float]
    ]  # by contact, nodal forces (n_all, d) [N] like B^T p, and dissipation [J]


def new_state(
    *,
    system: System,
    old: State,
    problem: SurfaceProblem,
    u: Vec,
    u_strained: Vec,
    u_s: Vec,
    load: Vec,
    p: Array,
    driven: Array,
    surplus: Surplus | None = None,
    initial: Array | None = None,
    memory: Memory | None = None,
) -> State:
    """The state at the time of a solved problem; collective.

    Args:
        system: with the contact rows that the problem was solved in.
        old: state that the substep starts from, carried over to the same rows.
        problem: what was solved.
        u: displacement of all dofs [m].
        u_strained: u minus its rigid part [m], see `displacement`.
        u_s: prescribed part of u [m].
        load: external forces without reactions and initial strains, over all dofs [N].
        p: tractions (rows,) [Pa].
        driven: displacement (o,) of the obstacles that forces drive [m].
        surplus: of a displacement that is added to that of the nodes.
        initial: values (k,) of the initial strains; None: those of the course.
        memory: of the laws at its end; None: that of one substep.

    Returns:
        The state; of its `previous`, `control`, `law_error` and `peak` it knows nothing.
    """
    cone, W, contacts, time = problem.cone, problem.surface.W, system.contacts, problem.cone.time
    inner = system.K * u_strained
    initial = system.initial.values(system.course, time) if initial is None else initial
    initial_work = system.initial.stress_work(initial, u_strained)
    stored, elongation = inner.dot(u_strained) / 2, system.constraints.links.elongation(u_strained)
    remote, ground = system.constraints.remote.motion(u), system.ground.exerted(u)
    residual = inner - system.initial.added(load, initial) + system.interface.forces(*split(cone, p))
    w, motion = relative_displacement(system, u, time, driven), system.obstacles.motions(system.contacts, time, driven)
    if surplus is not None:
        initial = system.initial.followed(initial, initial_work + surplus.initial_work)
        initial_work = system.initial.stress_work(initial, u_strained) + surplus.initial_work
        stored = stored + surplus.stored
        residual, w = residual + surplus.inner, w + surplus.relative
        elongation, remote = elongation + surplus.elongation, remote + surplus.remote
        ground = ground + surplus.ground
    external = (load + old.load).dot(u - old.u) / 2 + (residual + old.residual).dot(u_s - old.u_s) / 2
    prescribed, of_slacks = system.initial.external(old.initial, initial, old.initial_work, initial_work)
    external, contact, slip = external + prescribed, -of_slacks, {}
    forces = {c.name: c.nodal_forces(*parts) for c, *parts in zip(contacts, *split(cone, p), strict=True)}
    for name, (between, _) in surplus.friction.items() if surplus is not None else ():
        forces[name] = forces[name] + between
    here, there = system.interface.displacement(u), system.interface.displacement(old.u)
    for c, v, v_old in zip(contacts, here, there, strict=True):
        # forces at both ends of the substep, each by its own rows: so the energy balance is exact
        mean, pushed = (forces[c.name] + old.forces[c.name]) / 2, motion[c.name] - old.motion[c.name]
        external -= float(np.sum(mean * pushed))
        contact += float(np.sum(mean * (v - v_old - pushed)))
        slip[c.name] = old.slip[c.name] + c.node_motion(v - v_old - pushed)[1]
        if surplus is not None:
            slip[c.name] = slip[c.name] + c.tangential_part(surplus.motion[c.name])
    widened = np.zeros(len(p))  # gaps that change in time: the pressures' work on them comes from outside, like motions
    for c, place in zip(contacts, cone.places, strict=True):
        widened[place.normal] = c.at(time).gap - c.at(old.time).gap
    by_gaps = float(W @ ((p + old.p) / 2 * widened))
    external, contact = external - by_gaps, contact - by_gaps
    slipping = W * p * (w - problem.gap - cone.give(p))
    dissipated = np.array([slipping[place.tangential].sum() for place in cone.places])
    if surplus is not None:
        external, contact = external + surplus.external, contact + surplus.contact
        dissipated += [surplus.friction[c.name][1] if c.name in surplus.friction else 0.0 for c in contacts]
    repeat = repeats(old.memory)  # so many cycles rub as often
    again = (repeat - 1) * float(dissipated.sum())
    external, contact, dissipated = external + again, contact + again, repeat * dissipated
    lasting = LawMemory(replace(cone, contacts=contacts).at(time), old.memory, time - old.time)
    memory = lasting.after(problem, p, w) if memory is None else memory
    for k, place in enumerate(lasting.cone.places):
        (p_n, law), name = (p[place.normal], place.rows.friction), place.rows.name
        if (worn := f"{name}{WORN}") in memory:  # what the pressure does to what wears away is lost
            dissipated[k] += W[place.normal] * p_n @ (memory[worn] - old.memory[worn])
        if law is not None and name in memory:  # what drives it brings the work
            beside = repeat * float(place.rows.W_t @ law.work_aside(p_n, place.average, memory[name], lasting.step))
            external, contact, dissipated[k] = external + beside, contact + beside, dissipated[k] + beside
    energy = Energy(
        external=old.energy.external + external,
        stored=stored + system.initial.stored(initial, initial_work),
        contact=old.energy.contact + contact,
        compliance=float(W @ cone.energy(p)),
        dissipation=old.energy.dissipation + dissipated,
    )
    return State(
        time=time,
        u=u,
        u_s=u_s,
        load=load,
        initial=initial,
        initial_work=initial_work,
        elongation=elongation,
        remote=remote,
        ground=ground,
        residual=residual,
        p=p,
        w=w,
        motion=motion,
        driven=driven,
        slip=slip,
        memory=memory,
        forces=forces,
        rows=contacts,
        searched=old.searched,
        energy=energy,
    )
