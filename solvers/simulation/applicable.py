"""Whether the method can do what the scene asks: the table of methods, held against a scene."""

from __future__ import annotations

from collections.abc import Iterator

from geometry.errors import SceneError
from solvers.scene.applicability import METHODS, RIGID, Applicability
from solvers.scene.contact import Contact
from solvers.scene.gram import Gram
from solvers.scene.problem import Problem
from solvers.scene.settings import Solver

Reason = tuple[str, object, str]  # key, value, and why not


def refuse_method(problem: Problem) -> None:
    """
    Raises:
        SceneError: the first key that the method cannot do, and what can.
    """
    for sentence in refusals(problem):
        raise SceneError(sentence)


def refusals(problem: Problem) -> Iterator[str]:
    """What the method cannot do, a sentence each: key, value, and what can."""
    method = f"solver.method = {problem.solver.method}"
    table = METHODS[problem.solver.method]
    for key, value, reason in (*_keys(problem.solver, table), *_forms(problem.solver, table)):
        yield f"solver.{key} = {value}: {method} {reason}"
    for name, pair in problem.pairs.items():
        contact = pair.contact
        for key, value, reason in _contact(contact, pair.obstacle is not None, table):
            yield f"contacts.{name}.{key} = {value}: {method} {reason}; use condensed-newton"
        if "gram" in table.keys and contact.normal.at_quadrature:
            for key, value, other in _without_basis(problem.solver.gram):
                reason = f"has no basis in H1 for tractions at the quadrature points of contacts.{name}"
                yield f"solver.gram.{key} = {value}: {method} {reason}; use {other}"
    for reason in _floating(problem) if not table.floating else ():
        yield f"{method}: {reason}; use condensed-newton"


def _keys(solver: Solver, table: Applicability) -> Iterator[Reason]:
    """Keys that would change nothing."""
    for key in dict.fromkeys(key for other in METHODS.values() for key in other.keys):
        value = getattr(solver, key)
        if key not in table.keys and value != getattr(Solver(), key):
            knowing = [name for name, other in METHODS.items() if key in other.keys]
            yield key, value, f"does not know it; use {' or '.join(knowing)}"


def _forms(solver: Solver, table: Applicability) -> Iterator[Reason]:
    if solver.surface == "matrix-free" and not table.matrix_free:
        yield "surface", solver.surface, "needs the condensed form of the bodies; use surface-uzawa"
    if solver.surface == "condensed" and not table.condensed:
        yield "surface", solver.surface, "solves the bodies iteratively; use uzawa"


def _contact(contact: Contact, rigid: bool, table: Applicability) -> Iterator[Reason]:
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


def _without_basis(gram: Gram) -> Iterator[Reason]:
    """Readings that want one of the tractions themselves, not of the nodal forces that they make; and the other."""
    if gram.space == "multiplier":
        yield "space", gram.space, "volume"
    if gram.unknown == "tractions":
        yield "unknown", gram.unknown, "forces"


def _floating(problem: Problem) -> Iterator[str]:
    if problem.rigid_modes.shape[1]:
        yield "needs bodies that their supports hold; this one is held by contact alone"
    for name in dict.fromkeys(name for name, _ in problem.driven):
        yield f"cannot move obstacles.{name} by a force"
