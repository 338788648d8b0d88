"""The numbers of a step by the names that error estimates, cost tables and closed forms use."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.results.error_parts import Errors
from stickslip.solvers.results.numbers import quantities
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.quantities import CONTACT_NUMBERS, ENERGIES, STRESSES


def values(step: StepResult) -> dict[str, float]:
    """All numbers of a step by name, in SI units: base.normal_force, probe.tip.stress.xx, energy.stored.

    `stickslip.solvers.scene.quantities.names` gives the same names before anything is solved.
    """
    found: dict[str, float] = {}
    for name, contact in step.contacts.items():
        found |= {f"{name}.{key}": getattr(contact, key) for key in CONTACT_NUMBERS}
    for name, (moved, stress) in step.probes.items():
        found |= _vector(f"probe.{name}.displacement", moved)
        found |= {f"probe.{name}.stress.{key}": float(stress[ij]) for key, ij in STRESSES.items()}
    for name, (force, _) in step.supports.items():
        found |= _vector(f"support.{name}.force", force)
    for name, (moved, force, _) in step.obstacles.items():
        found |= _vector(f"obstacle.{name}.displacement", moved) | _vector(f"obstacle.{name}.force", force)
    return found | {f"energy.{key}": float(getattr(step.energy, key)) for key in ENERGIES}


def _vector(name: str, components: Array) -> dict[str, float]:
    return {f"{name}.{axis}": float(value) for axis, value in zip("xyz", components, strict=False)}


SINGULAR = {"contacts": "", "supports": "support.", "obstacles": "obstacle.", "probes": "probe.", "energy": "energy"}


def total_errors(step: StepResult, errors: Errors) -> dict[str, float]:
    """Total error of every number by the names that `values` has, and of moments; NaN: not known."""
    found: dict[str, float] = {}
    for key, value in quantities(step).items():
        name = ".".join(filter(None, (f"{SINGULAR[key.kind]}{key.name}", key.quantity)))
        total = errors[key].total if key in errors else None
        parts = np.full(np.shape(value), np.nan if total is None else total)
        axes: Iterable[str] = STRESSES if key.quantity == "stress" else "xyz"
        if key.quantity == "moment" and not parts.shape:
            parts, axes = parts[None], "z"
        if parts.shape:
            found |= {f"{name}.{axis}": float(part) for axis, part in zip(axes, parts, strict=False)}
        else:
            found[name] = float(parts)
    return found
