"""Whether the method can solve the scene: the applicability of the method, checked against the scene."""

from __future__ import annotations

from collections.abc import Iterator

from stickslip.geometry.errors import SceneError
from stickslip.solvers.method_registry import METHODS, Solver, method_of
from stickslip.solvers.methods.method import RIGID, Applicability, Method, Refusal, keys_of
from stickslip.solvers.scene.contact import Contact
from stickslip.solvers.scene.problem import Problem


def refuse_method(problem: Problem) -> None:
    """Check that the method can solve the problem.

    Raises:
        SceneError: the first key that the method does not support, and what to use instead.
    """
    for sentence in refusals(problem):
        raise SceneError(sentence)


def refusals(problem: Problem) -> Iterator[str]:
    """What the method does not support, one sentence each: key, value, and what to use instead."""
    method = f"solver.method = {problem.solver.method}"
    asked = method_of(problem.solver)
    table = asked.WORKS_WITH
    for key, value, reason in (*_keys(problem, type(asked)), *_forms(problem, table), *asked.refusals(problem)):
        yield f"solver.{key} = {value}: {method} {reason}"
    for name, pair in problem.pairs.items():
        contact = pair.contact
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
    for key, law in (("normal", contact.normal), ("friction", contact.friction)):
        chosen = getattr(law, "law", None)  # absent: no friction
        if chosen is not None and not table.knows(key, chosen):
            yield f"{key}.law", chosen, f"works with {', '.join(getattr(table, key))}"


def _floating(problem: Problem, table: Applicability) -> Iterator[str]:
    """Why a method cannot solve a problem with floating bodies or driven obstacles."""
    if problem.rigid_modes.shape[1] and not table.floating and not (table.bedded and problem.bedded):
        what = "supports or compliant pressures" if table.bedded else "supports"
        yield f"needs bodies that their {what} hold; this one is held by contact alone"
    for name in dict.fromkeys(name for name, _ in problem.driven) if not (table.floating and table.driven) else ():
        yield f"cannot move obstacles.{name} by a force"
