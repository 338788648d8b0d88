"""Errors that iterations, and iterative volume solves, leave in each number of a step.

Tractions and relative displacement of the exact solution of the same discrete steps are known, see `Correction`: the
numbers of a contact are compared with those of them. Reactions of supports change by no more than all contact forces
together change. The error of an iterative volume solve is known in the energy norm, relative: numbers are off by that
part of the largest of their kind.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import EPS
from stickslip.solvers.accuracy.mesh_error import Values
from stickslip.solvers.results.observe import LINEAR, Observer
from stickslip.solvers.results.step_result import ErrorParts, Quantity, number_of, quantities
from stickslip.solvers.scene.record import ContactNumbers, Value, numbers_of
from stickslip.solvers.stepping.stepper import Accepted
from stickslip.solvers.system.system import System

AREAS = tuple(key for key, number in numbers_of(ContactNumbers).items() if number.kind == "area")
LIKE = {"moment": "force", "rotation": "length"}  # kinds that are measured by another


def iteration_errors(observe: Observer, accepted: Accepted, found: Values) -> dict[Quantity, ErrorParts]:
    """Parts `iteration` and `linear_solver` of the errors of the numbers `found`; collective."""
    state, W = accepted.state, accepted.stepper.surface.W
    left = state.correction
    if left is None or np.isnan(left.size):
        return {}
    exact = replace(accepted, state=replace(state, p=state.p + left.p, w=state.w + left.w))
    theirs = quantities(observe.numbers(exact))
    sizes = {
        "force": float(np.abs(W * state.p).sum()),
        "length": float(np.abs(state.w).max(initial=0.0)),
        "energy": 2 * state.peak,
        "pressure": float(np.abs(state.p).max(initial=0.0)),
    }
    pushed = np.abs(W * left.p).sum()
    worked = float(pushed * sizes["length"] + np.abs(W * state.p) @ np.abs(left.w))
    bounds = {
        "force": float(pushed),
        "length": float(np.abs(left.w).max(initial=0.0)),
        "energy": worked + left.size * float(np.sqrt(2 * state.peak)),
        "pressure": float(np.abs(left.p).max(initial=0.0)),
    }
    errors = {}
    for key, value in found.items():
        kind, lever = number_of(key).kind, _lever(accepted.stepper.system, key)
        kind = LIKE.get(kind, kind)
        if not kind:
            continue
        if kind == "area":
            off: Value = np.abs(theirs[key] - value)
            linear = 0.0 * off
        elif key.quantity == "stress":
            off, linear = (
                0.0 * value + bounds["pressure"],
                0.0 * value + LINEAR * accepted.linear_error * sizes["pressure"],
            )
        else:
            size = lever * sizes[kind]
            off = 0.0 * np.abs(value) + lever * bounds[kind] + EPS * size  # of the largest number of its kind
            linear = 0.0 * np.abs(value) + LINEAR * accepted.linear_error * size
        errors[key] = ErrorParts(iteration=off, linear_solver=linear)
    return errors


def _lever(system: System, key: Quantity) -> float:
    """By what the error of a force [N] or a displacement [m] gives that of the number: 1 unless something turns.

    Of a moment it is the distance [m] of the farthest corner of the bodies' box from the point that it is about, of a
    rotation 2 / size [1/m] of the side that turns, whose ends may move in opposite directions.
    """
    kind = number_of(key).kind
    if kind not in ("moment", "rotation"):
        return 1.0
    about, problem = np.zeros(system.mesh.dim), system.problem
    of_points = {each.coupling.key: each for each in system.constraints.remote.every}
    if point := of_points.get(f"{key.kind}.{key.name}"):
        if kind == "rotation":
            return 2 / float(np.ptp(point.points, axis=0).max())
        about = np.array(point.coupling.point)
    elif key.kind == "obstacles" and (rotation := problem.obstacles[key.name].rotation):
        about = np.array(rotation.point)
    return float(np.linalg.norm(np.abs(system.box - about).max(axis=0)))
