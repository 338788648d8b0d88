"""Checks before any mesh: the plan of active effects, refusals of what cannot be solved, warnings."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stickslip.geometry.amplitude import value_at
from stickslip.geometry.arrays import CLOSE, EXACT, ROUNDING
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.units import SI
from stickslip.geometry.user_files.child_process import walls
from stickslip.geometry.user_files.open_file import kind_of
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.solvers.contact.coupling import seen_from
from stickslip.solvers.effects import active
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.laws.normal import Compliance
from stickslip.solvers.method_registry import METHODS, Solver, method_of
from stickslip.solvers.methods.method import RIGID, Applicability, Method, Refusal, keys_of
from stickslip.solvers.scene.contact import Contact, table_of
from stickslip.solvers.scene.material import NEARLY, Elastic, Material
from stickslip.solvers.scene.problem import PlanRow, Problem, Setup
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.resolve import is_faint, least_springs, set_up, with_rigid_modes

UNLOCKED = {True: 'formulation = "auto"', False: "geometry.order = 2"}  # by whether the body is isotropic


def make_plan(scene: Scene) -> tuple[PlanRow, ...]:
    """The rows of `stickslip plan`: every effect, whether it is on, and the scene key that asks for it.

    Raises:
        SceneError, GeometryError: see `planned`.
    """
    return planned(scene).plan


def planned(scene: Scene) -> Problem:
    """Resolve a scene, and refuse one that cannot be solved; nothing is meshed.

    Raises:
        SceneError: nothing resists a rigid motion, a contact side lies on the axis of symmetry, an obstacle faces the
            wrong way, or the method cannot do what the scene asks.
        GeometryError: the geometry does not have a side that the scene names.
    """
    setup = set_up(scene)
    _refuse_on_axis(setup)
    _refuse_reversed(setup)
    _refuse_faint(setup)
    problem = with_rigid_modes(setup)
    if problem.unheld:
        faint = [name for name, pair in problem.pairs.items() if is_faint(problem, pair)]
        but = f" (contacts.{faint[0]}.friction.k_T is too soft beside the bodies)" if faint else ""
        inside = "".join(f"; {line.removeprefix('geometry.file: ')}" for line in _overlapping(problem))
        raise SceneError(
            f"supports: nothing resists the {problem.unheld}{but}; add a support, a contact or friction{inside}"
        )
    for effect in active(problem):
        if effect.other_stiffness(problem) and problem.rigid_modes.shape[1]:
            raise SceneError(f"{effect.name}: needs bodies that their supports hold; add a support")
    if problem.timeline.clock is not None and problem.rigid_modes.shape[1]:
        raise SceneError("steps.clock: needs bodies that their supports hold; add a support")
    for sentence in refusals(problem):
        raise SceneError(sentence)
    return problem


def warnings(scene: Scene) -> tuple[str, ...]:
    """Warnings (one line each) about a scene that can be solved, but only with a large error or at a risk."""
    found = (_uncontained, _of_another_unit, _too_stiff, _overlapping, _cut, _locking, _weakening)
    setup = set_up(scene)
    return tuple(line for lines in found for line in lines(setup))


def _uncontained(setup: Setup) -> tuple[str, ...]:
    if not isinstance(setup.shape, UserFile) or kind_of(Path(setup.shape.file)) == "py" or walls():
        return ()
    return (
        "geometry.file: this machine has neither seccomp (Debian's python3-seccomp) nor Landlock, so commands in the "
        "file can start programs and write files; use files that you trust",
    )


def _of_another_unit(setup: Setup) -> tuple[str, ...]:
    shape = setup.shape
    if not isinstance(shape, UserFile) or shape.length_unit is not None:
        return ()
    if not shape.other_unit:
        return ()
    return (
        f"geometry.file: gmsh gives coordinates of STEP files in {shape.other_unit}; {shape.as_read(setup.dim)}: "
        f'write length_unit = "{shape.other_unit}", or "{setup.labels.length}" if that is meant',
    )


def _too_stiff(setup: Setup) -> Iterator[str]:
    """Bodies stiffer than diamond in the units that the scene names: E is then given in Pa."""
    size = setup.labels.pascals
    for name, body in setup.bodies.items():
        if setup.labels != SI and size is not None and body.modulus * size > 2e12:
            yield (
                f"bodies.{name}: E = {body.modulus:g} {setup.labels.pressure} is more than that of diamond (1e12 Pa); "
                f"is it in Pa? units says that it is in {setup.labels.pressure}"
            )


def _overlapping(setup: Setup) -> Iterator[str]:
    """Bodies that lie in each other, but for those that the gap of a contact puts apart whose sides face each other."""
    between = {
        frozenset(side.split(".")[0] for side in (pair.slave, pair.master)): pair.contact
        for pair in setup.pairs.values()
        if pair.master is not None and np.min(setup.sample(pair.slave)[1] @ setup.sample(pair.master)[1].T) < 0
    }
    for overlap in setup.shape.overlaps(setup.dim) if isinstance(setup.shape, UserFile) else ():
        contact, said = between.get(frozenset(overlap.bodies)), overlap.said(setup.labels.length)
        if contact is None:
            yield f"geometry.file: {said}; no contact pushes them apart"
        elif contact.gap is None:
            yield f"geometry.file: {said}; contact pushes them apart"
        elif contact.gap < 0:
            yield f"geometry.file: {said}, of which the gap of their contact leaves {-contact.gap:.3g}"


def _cut(setup: Setup) -> tuple[str, ...]:
    """Tables whose values change after the last step; one that only stays as it is loses nothing."""
    end, late = setup.timeline.end, dict[str, float]()
    for place, amplitude in setup.timeline.amplitudes.items():
        table = () if isinstance(amplitude, float | int) else amplitude
        if any(t > end * (1 + EXACT) and value != value_at(amplitude, end, end) for t, value in table):
            late[str(place)] = table[-1][0]
    if not late:
        return ()
    first = max(late, key=late.__getitem__)
    more = f", as {len(late)} tables do" * (len(late) > 1)
    said = f"its table goes on up to t = {late[first]:g}, past steps.end = {end:g}{more}"
    return (f"{first}: {said}; what it lists for later times is left out",)


def _locking(setup: Setup) -> tuple[str, ...]:
    if setup.shape.degree > 1 or setup.model == "plane stress":  # in plane stress the thickness changes freely
        return ()
    return tuple(
        f"bodies.{name}.{_ratios(material)}: displacements of order 1 lock when nearly incompressible, too stiff and "
        f"with wrong pressures; set {UNLOCKED[isinstance(material, Material)]}"
        for name, material in setup.bodies.items()
        if material.near_incompressible >= NEARLY and not material.averages
    )


def _ratios(material: Elastic) -> str:
    """Poisson's ratio, or ratios, of a body."""
    found = material.constants
    return ", ".join(f"{key} = {value:g}" for key, value in found.items() if key.startswith("nu"))


def _weakening(setup: Setup) -> Iterator[str]:
    """Whether a step keeps one solution where friction weakens by slip: mu's fall times p_n against E / extent."""
    extent, of = float(np.linalg.norm(np.ptp(setup.shape.box(setup.dim), axis=0))), setup.labels
    for name, pair in setup.pairs.items():
        friction = pair.contact.friction
        fall = friction.weakening if friction is not None else 0.0
        if fall:
            softest = min(setup.bodies[body].least_modulus for body in pair.bodies)
            yield (
                f"contacts.{name}.friction: mu falls by {fall:.3g} per {of.metre} of slip; above a pressure of about "
                f"{softest / extent / fall:.2g} {of.pressure} (E / extent of the bodies by that fall) it falls faster "
                "than the bodies unload: slip may jump within a step, which then has several solutions, and the "
                "nearest one is taken; springs in the drive lower that pressure"
            )


def _refuse_on_axis(setup: Setup) -> None:
    """Refuse loads on a side on the axis of symmetry, which has no area, and contacts of which a part lies there.

    Raises:
        SceneError: the key, and the side.
    """
    if not setup.axisymmetric:
        return
    small = ROUNDING * setup.extent
    sides = {f"contacts.{name}.surface": pair.contact.surface for name, pair in setup.pairs.items()}
    of_loads = {f"loads.{name}.boundary": load.boundary for name, load in setup.loads.items()}
    for key, side in (sides | of_loads).items():
        points, normals = setup.sample(side)
        on_axis = points[:, 0] <= small
        if on_axis.all():
            raise SceneError(f"{key} = {side}: lies on the axis of symmetry and has no area; name another side")
        if key in sides and (on_axis & (normals[:, 0] < -0.99)).any():
            raise SceneError(f"{key} = {side}: a part lies on the axis of symmetry and has no area; leave it out")


def _refuse_faint(setup: Setup) -> None:
    """Refuse springs whose stiffness differs so much from that of the bodies that rounding errors count.

    Raises:
        SceneError: the key, the stiffness, and the least or the largest one.
    """
    for springs in setup.springs:
        least = least_springs(setup)
        stiffness = min(k for k in (springs.normal, springs.tangential) if k > 0)
        wrong = f"too soft beside the bodies, at least {least:.1e} {setup.labels('Pa/m')}"
        require(stiffness >= least, springs.key, stiffness, wrong)
    extent = setup.extent
    for name, pair in setup.pairs.items():
        law, most, p = pair.contact.normal, setup.softest / extent / ROUNDING, np.array([setup.softest])
        if isinstance(law, Compliance) and (found := float(law.stiffness(p, p)[0])) > most:
            limit = law.c_n * (most / found) ** law.m_n
            wrong = f"penetrations drown in rounding, at most {limit:.1e} here; a rigid surface has no c_n"
            raise SceneError(f"contacts.{name}.normal.c_n = {law.c_n:g}: {wrong}")
        if (wear := pair.contact.wear) is not None and not isinstance(wear.k, str):
            k, largest = max((k for _, k in wear.table), default=float(np.sum(wear.k))), 1 / (ROUNDING * setup.softest)
            wrong = f"takes off all that presses within rounding, at most {largest:.1e} {setup.labels('1/Pa')} here"
            require(k <= largest, f"contacts.{name}.wear.k", k, wrong)
    least = least_springs(setup) * (extent if setup.model.startswith("plane") else extent**2)
    per_length = setup.labels("N/m")
    for link in setup.links:
        key, soft, hard = f"{link.key}.stiffness", float(link.stiffness.min()), float(link.stiffness.max())
        require(soft >= least, key, soft, f"too soft beside the bodies, at least {least:.1e} {per_length}")
        most = 1e15 * least  # the answer keeps some ten digits
        wrong = f"too stiff beside the bodies, at most {most:.1e} {per_length}; take a support"
        require(hard <= most, key, hard, wrong)


def _refuse_reversed(setup: Setup) -> None:
    """Refuse an obstacle whose normal points away from the contact side everywhere.

    Raises:
        SceneError: the obstacle, the side, and the side's normal.
    """
    for name, pair in setup.pairs.items():
        if pair.obstacle is None:
            continue
        points, outward = setup.sample(pair.slave)
        facing = np.einsum("kd,kd->k", seen_from(setup.obstacles[pair.obstacle], points)[1], outward)
        if np.all(facing > -CLOSE):
            raise SceneError(
                f"obstacles.{pair.obstacle}: its normal must point against {pair.slave} (contacts.{name}), and "
                f"does so nowhere; the side's outward normal is {np.round(outward[0], 6).tolist()}, reverse it"
            )


def refusals(problem: Problem) -> Iterator[str]:
    """Yield what the method does not support, one sentence each: key, value, and what to use instead."""
    method = f"solver.method = {problem.solver.method}"
    asked = method_of(problem.solver)
    table = asked.WORKS_WITH
    for key, value, reason in (*_keys(problem, type(asked)), *_forms(problem, table), *asked.refusals(problem)):
        yield f"solver.{key} = {value}: {method} {reason}"
    for name, pair in problem.pairs.items():
        contact = pair.contact
        if pair.obstacle is not None and not problem.obstacles[pair.obstacle].written_in_operators and not table.fields:
            yield f"contacts.{name}.against = {pair.obstacle}: {method} takes no graph; use condensed-newton"
        if (problem.shares(name) or pair.skins) and not table.shared:
            key = "between" if pair.found else f"surface = {pair.slave}"
            yield f"contacts.{table_of(name)}.{key}: {method} takes one contact a side; use condensed-newton"
        for key, value, reason in _contact(contact, pair.obstacle is not None, table):
            yield f"contacts.{name}.{key} = {value}: {method} {reason}; use condensed-newton"
    for reason in _floating(problem, table):
        yield f"{method}: {reason}; use condensed-newton"


def _keys(problem: Problem, asked: type[Method]) -> Iterator[Refusal]:
    """Keys of other methods that are not at their default: the method does not use them."""
    default = Solver()
    for key in dict.fromkeys(key for other in METHODS.values() for key in keys_of(other)):
        value = getattr(problem.solver, key, getattr(default, key))
        if key not in keys_of(asked) and value != getattr(default, key):
            users = [name for name, other in METHODS.items() if key in keys_of(other)]
            yield key, value, f"does not use it; use {' or '.join(users)}"


def _forms(problem: Problem, table: Applicability) -> Iterator[Refusal]:
    """A form of the bodies that the method does not work with."""
    solver = problem.solver
    if solver.surface != "auto" and not (table.matrix_free or table.condensed):
        yield "surface", solver.surface, "solves the bodies as they are; leave it out, or use condensed-newton"
        return
    if solver.surface == "matrix-free" and not table.matrix_free:
        yield "surface", solver.surface, "needs the condensed form of the bodies; use surface-uzawa"
    if solver.surface == "condensed" and not table.condensed:
        yield "surface", solver.surface, "solves the bodies iteratively; use uzawa"


def _contact(contact: Contact, rigid: bool, table: Applicability) -> Iterator[Refusal]:
    """Keys of a contact, with a rigid obstacle or not, that the method does not support."""
    operator = RIGID if rigid else contact.operator or "mortar"
    if not table.knows("operators", operator):
        key = "operator" if contact.operator else "against"
        only = "rigid obstacles only" if table.operators == (RIGID,) else ", ".join(table.operators or ())
        yield key, getattr(contact, key), f"works with {only}"
    if contact.friction is not None and contact.friction.k_T is not None and not table.k_T:
        yield "friction.k_T", contact.friction.k_T, "has no tangential stiffness"
    if contact.friction is not None and contact.friction.drags and not table.rates:
        yield "friction.law", getattr(contact.friction, "law", ""), "has no friction by slip rate"
    given = {key: getattr(contact, key) for key in ("slide", "slide_speed", "wear")}
    for key, value in given.items() if not table.worn else ():
        if value is not None and not (key == "slide" and contact.along):
            yield key, "true", "has no prescribed sliding, and no wear"
    mu = contact.friction.mu if isinstance(contact.friction, Coulomb) else 0.0
    for key, value in (("gap_offset", contact.gap_offset), ("friction.mu", mu)):
        if not isinstance(value, float | int) and not table.fields:
            yield key, value, "takes one number for a side, which does not change in time"
    for key, law in (("normal", contact.normal), ("friction", contact.friction)):
        chosen = getattr(law, "law", None)  # absent: no friction
        if chosen is not None and not table.knows(key, chosen):
            yield f"{key}.law", chosen, f"works with {', '.join(getattr(table, key))}"


def _floating(problem: Problem, table: Applicability) -> Iterator[str]:
    """Explain why a method cannot solve a problem with floating bodies or driven obstacles."""
    if problem.rigid_modes.shape[1] and not table.floating and not (table.bedded and problem.bedded):
        what = "supports or compliant pressures" if table.bedded else "supports"
        yield f"needs bodies that their {what} hold; this one is held by contact alone"
    for name in dict.fromkeys(name for name, _ in problem.driven) if not (table.floating and table.driven) else ():
        yield f"cannot move obstacles.{name} by a force"
