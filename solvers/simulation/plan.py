"""Checks before any mesh: the plan of active effects, refusals of what cannot be solved, warnings."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stickslip.geometry.amplitude import value_at
from stickslip.geometry.arrays import CLOSE, EXACT, ROUNDING
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.user_files.child_process import walls
from stickslip.geometry.user_files.open_file import kind_of
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.solvers.contact.rigid_obstacle import seen_from
from stickslip.solvers.effects import active
from stickslip.solvers.scene.material import NEARLY, Elastic, Material
from stickslip.solvers.scene.problem import PlanRow, Problem
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.applicable import refuse_method
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.simulation.unresisted_modes import is_faint, least_springs

INWARD = 0.99  # component along -r of the outward normal of a facet on the axis of symmetry
UNLOCKED = {True: 'formulation = "auto"', False: "geometry.order = 2"}  # by whether the body is isotropic
STIFF = 1e15  # times the softest spring that can hold a body: the answer keeps some ten digits


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
    _refuse_on_axis(scene)
    _refuse_reversed(scene)
    _refuse_faint(scene)
    problem = resolve(scene)
    if problem.unheld:
        faint = [name for name, contact in scene.contacts.items() if is_faint(scene, contact)]
        but = f" (contacts.{faint[0]}.friction.k_T is too soft beside the bodies)" if faint else ""
        raise SceneError(f"supports: nothing resists the {problem.unheld}{but}; add a support, a contact or friction")
    for effect in active(problem):
        if effect.other_stiffness(problem) and problem.rigid_modes.shape[1]:
            raise SceneError(f"{effect.name}: needs bodies that their supports hold; add a support")
    refuse_method(problem)
    return problem


def warnings(scene: Scene) -> tuple[str, ...]:
    """Warnings (one line each) about a scene that can be solved, but only with a large error or at a risk."""
    found = (_uncontained, _of_another_unit, _cut, _locking, _weakening)
    return tuple(line for lines in found for line in lines(scene))


def _uncontained(scene: Scene) -> tuple[str, ...]:
    if not isinstance(scene.geometry, UserFile) or kind_of(Path(scene.geometry.file)) == "py" or walls():
        return ()
    return (
        "geometry.file: this machine has neither seccomp (Debian's python3-seccomp) nor Landlock, so commands in the "
        "file can start programs and write files; use files that you trust",
    )


def _of_another_unit(scene: Scene) -> tuple[str, ...]:
    geometry = scene.geometry
    if not isinstance(geometry, UserFile) or geometry.length_unit is not None:
        return ()
    if not geometry.other_unit:
        return ()
    return (
        f"geometry.file: gmsh gives coordinates of STEP files in {geometry.other_unit}; {geometry.as_read(scene.dim)}: "
        f'write length_unit = "{geometry.other_unit}", or "{scene.labels.length}" if that is meant',
    )


def _cut(scene: Scene) -> tuple[str, ...]:
    """Tables whose values change after the last step; one that only stays as it is loses nothing."""
    end, late = scene.steps.end, dict[str, float]()
    for place, amplitude in scene.drives().items():
        table = () if isinstance(amplitude, float | int) else amplitude
        if any(t > end * (1 + EXACT) and value != value_at(amplitude, end, end) for t, value in table):
            late[str(place)] = table[-1][0]
    if not late:
        return ()
    first = max(late, key=late.__getitem__)
    more = f", as {len(late)} tables do" * (len(late) > 1)
    said = f"its table goes on up to t = {late[first]:g}, past steps.end = {end:g}{more}"
    return (f"{first}: {said}; what it lists for later times is left out",)


def _locking(scene: Scene) -> tuple[str, ...]:
    if scene.geometry.degree > 1 or scene.model == "plane stress":  # in plane stress the thickness changes freely
        return ()
    return tuple(
        f"bodies.{name}.{_ratios(material)}: displacements of order 1 lock when nearly incompressible, too stiff and "
        f"with wrong pressures; set {UNLOCKED[isinstance(material, Material)]}"
        for name, material in scene.bodies.items()
        if material.near_incompressible >= NEARLY and not material.averages
    )


def _ratios(material: Elastic) -> str:
    """Poisson's ratio, or ratios, of a body."""
    found = material.constants
    return ", ".join(f"{key} = {value:g}" for key, value in found.items() if key.startswith("nu"))


def _weakening(scene: Scene) -> Iterator[str]:
    """Whether a step keeps one solution where friction weakens by slip: mu's fall times p_n against E / extent."""
    extent, of = float(np.linalg.norm(np.ptp(scene.geometry.box(scene.dim), axis=0))), scene.labels
    for name, contact in scene.contacts.items():
        fall = contact.friction.weakening if contact.friction is not None else 0.0
        if fall:
            sides = (side.split(".")[0] for side in (contact.surface, contact.against))
            softest = min(scene.bodies[body].least_modulus for body in sides if body in scene.bodies)
            yield (
                f"contacts.{name}.friction: mu falls by {fall:.3g} per {of.metre} of slip; above a pressure of about "
                f"{softest / extent / fall:.2g} {of.pressure} (E / extent of the bodies by that fall) it falls faster "
                "than the bodies unload: slip may jump within a step, which then has several solutions, and the "
                "nearest one is taken; springs in the drive lower that pressure"
            )


def _refuse_on_axis(scene: Scene) -> None:
    """Refuse loads on a side on the axis of symmetry, which has no area, and contacts of which a part lies there.

    Raises:
        SceneError: the key, and the side.
    """
    if not scene.axisymmetric:
        return
    # relative to the scene's size: points closer than this to the axis of symmetry lie on it
    small = ROUNDING * float(np.max(np.ptp(scene.geometry.box(scene.dim), axis=0)))
    sides = {f"contacts.{name}.surface": contact.surface for name, contact in scene.contacts.items()}
    of_loads = {f"loads.{name}.boundary": load.boundary for name, load in scene.loads.items()}
    for key, side in (sides | of_loads).items():
        points, normals = scene.geometry.sample(side, scene.dim)
        on_axis = points[:, 0] <= small
        if on_axis.all():
            raise SceneError(f"{key} = {side}: lies on the axis of symmetry and has no area; name another side")
        if key in sides and (on_axis & (normals[:, 0] < -INWARD)).any():
            raise SceneError(f"{key} = {side}: a part lies on the axis of symmetry and has no area; leave it out")


def _refuse_faint(scene: Scene) -> None:
    """Refuse springs whose stiffness differs so much from that of the bodies that rounding errors count.

    Raises:
        SceneError: the key, the stiffness, and the least or the largest one.
    """
    for springs in scene.springs():
        least = least_springs(scene)
        stiffness = min(k for k in (springs.normal, springs.tangential) if k > 0)
        wrong = f"too soft beside the bodies, at least {least:.1e} {scene.labels('Pa/m')}"
        require(stiffness >= least, springs.key, stiffness, wrong)
    extent = float(np.max(np.ptp(scene.geometry.box(scene.dim), axis=0)))
    least = least_springs(scene) * (extent if scene.model.startswith("plane") else extent**2)
    per_length = scene.labels("N/m")
    for link in scene.links():
        key, soft, hard = f"{link.key}.stiffness", float(link.stiffness.min()), float(link.stiffness.max())
        require(soft >= least, key, soft, f"too soft beside the bodies, at least {least:.1e} {per_length}")
        most = STIFF * least
        wrong = f"too stiff beside the bodies, at most {most:.1e} {per_length}; take a support"
        require(hard <= most, key, hard, wrong)


def _refuse_reversed(scene: Scene) -> None:
    """Refuse an obstacle whose normal points away from the contact side everywhere.

    Raises:
        SceneError: the obstacle, the side, and the side's normal.
    """
    for name, contact in scene.contacts.items():
        if contact.against not in scene.obstacles:
            continue
        points, outward = scene.geometry.sample(contact.surface, scene.dim)
        facing = np.einsum("kd,kd->k", seen_from(scene.obstacles[contact.against], points)[1], outward)
        # cosine of the angle between normals, below which two surfaces do not face each other
        if np.all(facing > -CLOSE):
            raise SceneError(
                f"obstacles.{contact.against}: its normal must point against {contact.surface} (contacts.{name}), and "
                f"does so nowhere; the side's outward normal is {np.round(outward[0], 6).tolist()}, reverse it"
            )
