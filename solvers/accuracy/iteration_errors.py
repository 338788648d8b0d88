"""Errors that iterations, and iterative volume solves, leave in each number of a step.

Tractions and relative displacement of the exact solution of the same discrete steps are known, see `Correction`: the
numbers of a contact are compared with those of them. Reactions of supports change by no more than all contact forces
together change. The error of an iterative volume solve is known in the energy norm, relative: numbers are off by that
part of the largest of their kind.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stickslip.solvers.accuracy.mesh_error import Values
from stickslip.solvers.results.error_parts import ErrorParts, Quantity, Value
from stickslip.solvers.results.numbers import quantities
from stickslip.solvers.results.observe import LINEAR, Observer
from stickslip.solvers.stepping.stepper import Accepted

ROUNDING = 1e-15  # of the largest number of its kind
FORCES = ("force", "normal_force", "tangential_force")
AREAS = ("contact_area", "stick_area", "slip_area")
LENGTHS = ("displacement", "max_penetration", "max_slip")


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
    arm = accepted.stepper.system.extent
    errors = {}
    for key, value in found.items():
        kind = _kind(key.quantity)
        lever = arm if key.quantity == "moment" else 1.0
        if kind == "area":
            off: Value = np.abs(theirs[key] - value)
            linear = 0.0 * off
        elif kind == "stress":
            off, linear = (
                0.0 * value + bounds["pressure"],
                0.0 * value + LINEAR * accepted.linear_error * sizes["pressure"],
            )
        else:
            size = lever * sizes[kind]
            off = 0.0 * np.abs(value) + lever * bounds[kind] + ROUNDING * size
            linear = 0.0 * np.abs(value) + LINEAR * accepted.linear_error * size
        errors[key] = ErrorParts(iteration=off, linear_solver=linear)
    return errors


def _kind(quantity: str) -> str:
    """What a number's error is measured by."""
    if quantity in (*FORCES, "moment"):
        return "force"
    if quantity in AREAS:
        return "area"
    if quantity in LENGTHS:
        return "length"
    return {"max_pressure": "pressure", "stress": "stress"}.get(quantity, "energy")
