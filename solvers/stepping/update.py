"""A solved step becomes the new state: displacement, relative displacement, work."""

from __future__ import annotations

from typing import Any

import numpy as np

from geometry.arrays import Array
from solvers.contact.admissible_set import AdmissibleSet
from solvers.contact.rows import ContactRows
from solvers.interface.problem import SurfaceProblem
from solvers.stepping.state import Energy, State
from solvers.system.system import System


def split(cone: AdmissibleSet, p: Array) -> tuple[list[Array], list[Array]]:
    """Flat tractions to normal (m_n,) and tangential (m_t, d-1) ones of each contact."""
    return [p[s.normal] for s in cone.places], [p[s.tangential].reshape(-1, s.components) for s in cone.places]


def stack(contacts: tuple[ContactRows, ...], relative: list[Array]) -> Array:
    """Rows (rows,) [m] of each contact's displacement (n_all, d), relative to a rigid obstacle."""
    pairs = list(zip(contacts, relative, strict=True))
    blocks = [c.N_n @ v.ravel() for c, v in pairs] + [c.N_t @ v.ravel() for c, v in pairs]
    return np.concatenate([np.zeros(0), *blocks])


def relative_displacement(system: System, u: Any, time: float, driven: Array) -> Array:
    """Rows (rows,) [m] of a displacement, the obstacles' motion taken off."""
    motion = system.obstacles.motions(system.contacts, time, driven)
    surfaces = system.interface.displacement(u)
    return stack(system.contacts, [v - motion[c.name] for c, v in zip(system.contacts, surfaces, strict=True)])


def displacement(system: System, time: float, q: Any, u_s: Any) -> tuple[Any, Any]:
    """u = T q + u_s over all displacements [m], and what of it bodies resist: not u_s where that is a rigid motion."""
    moved = system.T * q
    u = moved + u_s
    return u, u if system.lifting.followed(time) is None else moved


def new_state(
    system: System,
    old: State,
    problem: SurfaceProblem,
    u: Any,
    strained: Any,
    u_s: Any,
    load: Any,
    p: Array,
    driven: Array,
) -> State:
    """The state at the problem's time.

    Args:
        u: displacement [m], strained what of it the bodies resist, u_s its prescribed part, load the external forces
            [N]: over all displacements.
        p: tractions (rows,) [Pa].
        driven: motion (o,) of driven obstacles [m].
    """
    cone, W, contacts, time = problem.cone, problem.surface.W, system.contacts, problem.cone.time
    inner = system.K * strained
    initial = system.initial.values(system.course, time)
    initial_work = system.initial.stress_work(initial, strained)
    residual = inner - system.initial.added(load, initial) + system.interface.forces(*split(cone, p))
    w, motion = relative_displacement(system, u, time, driven), system.obstacles.motions(system.contacts, time, driven)
    external = (load + old.load).dot(u - old.u) / 2 + (residual + old.residual).dot(u_s - old.u_s) / 2
    external += system.initial.external(old.initial, initial, old.initial_work, initial_work)
    contact, slip = 0.0, {}
    forces = {c.name: c.nodal_forces(*parts) for c, *parts in zip(contacts, *split(cone, p), strict=True)}
    here, there = system.interface.displacement(u), system.interface.displacement(old.u)
    for c, v, v_old in zip(contacts, here, there, strict=True):
        # forces of both ends of the step, each in its own rows, so that the balance of energy is exact
        mean, pushed = (forces[c.name] + old.forces[c.name]) / 2, motion[c.name] - old.motion[c.name]
        external -= float(np.sum(mean * pushed))
        contact += float(np.sum(mean * (v - v_old - pushed)))
        slip[c.name] = old.slip[c.name] + c.node_motion(v - v_old - pushed)[1]
    slipping = W * p * (w - problem.gap - cone.give(p))
    energy = Energy(
        external=old.energy.external + external,
        stored=inner.dot(strained) / 2 + system.initial.stored(initial, initial_work),
        contact=old.energy.contact + contact,
        compliance=float(W @ cone.energy(p)),
        dissipation=old.energy.dissipation + np.array([slipping[place.tangential].sum() for place in cone.places]),
    )
    return State(
        time=time,
        u=u,
        u_s=u_s,
        load=load,
        initial=initial,
        initial_work=initial_work,
        residual=residual,
        p=p,
        w=w,
        motion=motion,
        driven=driven,
        slip=slip,
        forces=forces,
        rows=contacts,
        energy=energy,
    )
