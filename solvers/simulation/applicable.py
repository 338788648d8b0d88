"""Whether the method can do what the scene asks: the table of methods, held against a scene."""

from __future__ import annotations

from collections.abc import Iterator

from geometry.errors import SceneError
from solvers.methods import METHODS, Solver, method_of
from solvers.methods.applicability import RIGID, Applicability
from solvers.methods.method import Method, Refusal, keys_of
from solvers.scene.contact import Contact
from solvers.scene.problem import Problem


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
    asked = method_of(problem.solver)
    table = asked.WORKS_WITH
    for key, value, reason in (*_keys(problem, type(asked)), *_forms(problem, table), *asked.refusals(problem)):
        yield f"solver.{key} = {value}: {method} {reason}"
    for name, pair in problem.pairs.items():
        contact = pair.contact
        for key, value, reason in _contact(contact, pair.obstacle is not None, table):
            yield f"contacts.{name}.{key} = {value}: {method} {reason}; use condensed-newton"
    for reason in _floating(problem) if not table.floating else ():
        yield f"{method}: {reason}; use condensed-newton"


def _keys(problem: Problem, asked: type[Method]) -> Iterator[Refusal]:
    """Keys that would change nothing."""
    default = Solver()
    for key in dict.fromkeys(key for other in METHODS.values() for key in keys_of(other)):
        value = getattr(problem.solver, key, getattr(default, key))
        if key not in keys_of(asked) and value != getattr(default, key):
            knowing = [name for name, other in METHODS.items() if key in keys_of(other)]
            yield key, value, f"does not know it; use {' or '.join(knowing)}"


def _forms(problem: Problem, table: Applicability) -> Iterator[Refusal]:
    solver = problem.solver
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


def _floating(problem: Problem) -> Iterator[str]:
    if problem.rigid_modes.shape[1]:
        yield "needs bodies that their supports hold; this one is held by contact alone"
    for name in dict.fromkeys(name for name, _ in problem.driven):
        yield f"cannot move obstacles.{name} by a force"
