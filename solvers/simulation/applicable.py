"""Whether the method can do what the scene asks: the table of methods, held against a scene."""

from __future__ import annotations

from collections.abc import Iterator

from geometry.errors import SceneError
from solvers.methods import METHODS, Solver, method_of
from solvers.methods.applicability import RIGID, Applicability
from solvers.methods.method import Method, Refusal, keys_of
from solvers.scene.contact import Contact
from solvers.scene.scene import Scene
from solvers.simulation.held import free_motions


def refuse_method(scene: Scene) -> None:
    """
    Raises:
        SceneError: the first key that the method cannot do, and what can.
    """
    for sentence in refusals(scene):
        raise SceneError(sentence)


def refusals(scene: Scene) -> Iterator[str]:
    """What the method cannot do, a sentence each: key, value, and what can."""
    method = f"solver.method = {scene.solver.method}"
    asked = method_of(scene.solver)
    table = asked.WORKS_WITH
    for key, value, reason in (*_keys(scene, type(asked)), *_forms(scene, table), *asked.refusals(scene)):
        yield f"solver.{key} = {value}: {method} {reason}"
    for name, contact in scene.contacts.items():
        for key, value, reason in _contact(contact, contact.against in scene.obstacles, table):
            yield f"contacts.{name}.{key} = {value}: {method} {reason}; use condensed-newton"
    for reason in _floating(scene) if not table.floating else ():
        yield f"{method}: {reason}; use condensed-newton"


def _keys(scene: Scene, asked: type[Method]) -> Iterator[Refusal]:
    """Keys that would change nothing."""
    default = Solver()
    for key in dict.fromkeys(key for other in METHODS.values() for key in keys_of(other)):
        value = getattr(scene.solver, key, getattr(default, key))
        if key not in keys_of(asked) and value != getattr(default, key):
            knowing = [name for name, other in METHODS.items() if key in keys_of(other)]
            yield key, value, f"does not know it; use {' or '.join(knowing)}"


def _forms(scene: Scene, table: Applicability) -> Iterator[Refusal]:
    solver = scene.solver
    if solver.surface == "matrix-free" and not table.matrix_free:
        yield "surface", solver.surface, "needs the condensed form of the bodies; use surface-uzawa"
    if solver.surface == "condensed" and not table.condensed:
        yield "surface", solver.surface, "solves the bodies iteratively; use uzawa"


def _contact(contact: Contact, rigid: bool, table: Applicability) -> Iterator[Refusal]:
    operator = RIGID if rigid else contact.operator or "mortar"
    if not table.knows("operators", operator):
        key = "operator" if contact.operator else "against"
        only = "rigid obstacles alone" if table.operators == (RIGID,) else ", ".join(table.operators or ())
        yield key, getattr(contact, key), f"knows {only}"
    if contact.sliding and not table.sliding:
        yield "sliding", "true", "finds contact where the bodies are at the start"
    if contact.friction is not None and contact.friction.k_T is not None and not table.k_T:
        yield "friction.k_T", contact.friction.k_T, "knows no tangential stiffness"
    for key, law in (("normal", contact.normal), ("friction", contact.friction)):
        chosen = getattr(law, "law", None)  # absent: no friction
        if chosen is not None and not table.knows(key, chosen):
            yield f"{key}.law", chosen, f"works with {', '.join(getattr(table, key))}"


def _floating(scene: Scene) -> Iterator[str]:
    if free_motions(scene, with_contacts=False)[0].shape[1]:
        yield "needs bodies that their supports hold; this one is held by contact alone"
    for name, obstacle in scene.obstacles.items():
        if obstacle.driven():
            yield f"cannot move obstacles.{name} by a force"
