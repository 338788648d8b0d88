"""Zeros: no force, friction, increment, bound or touch. Nothing changes, in at most one iteration; 0/0 does not occur.

A block of 4 x 4 x 2 triangles whose top is held, so that pressing and shearing leave a state that is not uniform.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from stickslip import Block, Contact, FrictionLaw, Load, Material, Plane, Scene, StepResult, Steps, Support
from stickslip.geometry.amplitude import Amplitude
from stickslip.solvers.laws.friction import Coulomb, Tresca
from stickslip.solvers.method_registry import METHODS
from stickslip.workflows.lab.verification.check import Check, problem, within
from stickslip.workflows.lab.verification.prepared import solved, solver

E, NU, MU = 1000.0, 0.3, 0.3
DOWN, ACROSS = 0.01, 0.005  # of the top [m]
PRESS_THEN_SHEAR: dict[str, Amplitude] = {"x": ((1.0, 0.0), (2.0, ACROSS)), "y": ((1.0, -DOWN),)}
ROUNDING = 1e-14  # [m] of one solve with the bodies, whose motion is 10 mm
WORK = ROUNDING * MU * E * DOWN  # [J] of the friction on 1 m, along a slip by that much
AGREEMENT = 1e-9  # two runs at tolerance 1e-12, each off by its condition, about 10, and two digits to spare


def scene(
    method: str,
    *,
    top: dict[str, Amplitude] | None,
    friction: FrictionLaw | None = None,
    gap: float = 0.0,
    load: float | None = None,
    steps: int = 2,
) -> Scene:
    """Unit block above a floor at -gap, its top moved by `top`, its left side under a pressure `load` [Pa]."""
    return Scene(
        model="plane strain",
        geometry=Block(length=1.0, height=1.0, mesh_size=0.25),
        bodies={"block": Material(E=E, nu=NU)},
        obstacles={"floor": Plane(point=(0.0, -gap), normal=(0.0, 1.0))},
        contacts={"base": Contact(surface="block.bottom", against="floor", friction=friction)},
        supports={} if top is None else {"top": Support(boundary="block.top", displacement=top)},  # type: ignore[arg-type]
        loads={} if load is None else {"left": Load(boundary="block.left", pressure=load)},
        steps=Steps(end=float(steps), count=steps),
        solver=solver(method, 1e-12),
    )


def not_finite(step: StepResult) -> int:
    """Count the numbers of the step that are NaN or infinite."""
    found = [step.displacement, step.stress, step.p, step.w, step.residual, step.p_ref, step.u_ref]
    found += [getattr(contact, f.name) for contact in step.contacts.values() for f in fields(contact)]
    found += [part for support in step.supports.values() for part in support]
    found += [getattr(step.energy, f.name) for f in fields(step.energy)]
    return sum(int(np.sum(~np.isfinite(np.asarray(value, float)))) for value in found if value is not None)


def unmoved(name: str, step: StepResult, displacement: float, tractions: float, work: float) -> list[Check]:
    """Changes of the state that must be 0 exactly or to rounding, in at most one iteration."""
    return [
        Check(f"{name}: displacement [m]", displacement, 0.0, ROUNDING, relative=False),
        Check(f"{name}: traction [Pa]", tractions, 0.0, E * ROUNDING, relative=False),
        Check(f"{name}: dissipation [J]", work, 0.0, WORK, relative=False),
        Check(f"{name}: iterations", step.iterations, 0, 1, relative=False),
        Check(f"{name}: numbers that are none", not_finite(step), 0, 0, relative=False),
    ]


def no_force(method: str, held: bool = True) -> list[Check]:
    """Loads of 0 on a block that touches the floor; `held` by its top, or by contact and friction alone."""
    top: dict[str, Amplitude] | None = {"x": 0.0, "y": 0.0} if held else None
    found = []
    for step in solved(scene(method, top=top, friction=Coulomb(mu=MU), load=0.0))[1]:
        name = f"F = 0, {'held' if held else 'floating'}, t = {step.time:g}"
        base = step.contacts["base"]
        found += unmoved(name, step, np.abs(step.displacement).max(), np.abs(step.p).max(), base.dissipation)
    return found


def no_touch(method: str) -> list[Check]:
    """A gap of 0.1 m and a motion of 10 mm: the block follows its top as a rigid body."""
    found = []
    for step in solved(scene(method, top=PRESS_THEN_SHEAR, friction=Coulomb(mu=MU), gap=0.1))[1]:
        base, name = step.contacts["base"], f"nothing touches, t = {step.time:g}"
        strained = np.abs(step.displacement - [ACROSS if step.time > 1 else 0.0, -DOWN]).max()
        found += unmoved(name, step, strained, np.abs(step.p).max(), base.dissipation)
        found.append(Check(f"{name}: contact area [m]", base.contact_area, 0.0, 0.0, relative=False))
    return found


def no_increment(method: str, mu: float = MU) -> list[Check]:
    """After pressing and shearing, partly slipping, one more step in which nothing moves."""
    _, (_, before, after) = solved(scene(method, top=PRESS_THEN_SHEAR, friction=Coulomb(mu=mu), steps=3))
    then, now = before.contacts["base"], after.contacts["base"]
    moved = np.abs(after.displacement - before.displacement).max()
    found = unmoved("no increment", after, moved, np.abs(after.p - before.p).max(), now.dissipation)
    total = now.dissipation_total - then.dissipation_total
    return [
        *found,
        Check("no increment: change of the dissipation [J]", total, 0.0, WORK, relative=False),
        # a test of friction only if the step before both sticks and slips
        within("no increment: slip area of the step before [m]", then.slip_area, 0.1, 0.9),
    ]


def no_friction(method: str, mu: float = 0.0) -> list[Check]:
    """mu = 0 and a bound of 0 give the answer of the frictionless block; another mu must not."""
    smooth = solved(scene(method, top=PRESS_THEN_SHEAR))[1][-1]
    laws = {"mu = 0": Coulomb(mu=mu), "bound = 0": Tresca(bound=((1.0, mu * DOWN * E),))}
    found = []
    for name, law in laws.items():
        step = solved(scene(method, top=PRESS_THEN_SHEAR, friction=law))[1][-1]
        base, free = step.contacts["base"], smooth.contacts["base"]
        apart = np.abs(step.displacement - smooth.displacement).max() / np.abs(smooth.displacement).max()
        found += [
            Check(f"{name}: displacement against frictionless, relative", apart, 0.0, AGREEMENT, relative=False),
            Check(f"{name}: normal force [N]", base.normal_force, free.normal_force, AGREEMENT, relative=True),
            Check(f"{name}: friction [N]", base.tangential_force, 0.0, 0.0, relative=False),
            Check(f"{name}: dissipation [J]", base.dissipation_total, 0.0, 0.0, relative=False),
            Check(f"{name}: numbers that are none", not_finite(step), 0, 0, relative=False),
        ]
    return found


@problem("no force, friction, increment, bound or touch: nothing changes")
def checks(method: str) -> list[Check]:
    """All of them."""
    floating = no_force(method, held=False) if METHODS[method].WORKS_WITH.floating else []
    return no_force(method) + floating + no_touch(method) + no_increment(method) + no_friction(method)
