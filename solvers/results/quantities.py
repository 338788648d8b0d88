"""The numbers of a step by the names that error estimates, cost tables and closed forms use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.results.error_parts import Errors, Quantity, Value
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
    for name, (force, moment) in step.supports.items():
        found |= _vector(f"support.{name}.force", force) | turns(f"support.{name}.moment", moment)
    for name, (force, moment) in step.elastic_support.items():
        found |= _vector(f"elastic_support.{name}.force", force) | turns(f"elastic_support.{name}.moment", moment)
    for name, (moved, force, moment) in step.obstacles.items():
        found |= _vector(f"obstacle.{name}.displacement", moved) | _vector(f"obstacle.{name}.force", force)
        found |= turns(f"obstacle.{name}.moment", moment)
    for name, spring in step.springs.items():
        found |= _vector(f"spring.{name}.force", spring.force)
    found |= {f"bolt.{name}.tension": bolt.tension for name, bolt in step.bolts.items()}
    for name, point in step.remote_points.items():
        found |= _vector(f"remote_point.{name}.displacement", point.displacement)
        found |= _vector(f"remote_point.{name}.force", point.force)
        found |= turns(f"remote_point.{name}.rotation", point.rotation)
        found |= turns(f"remote_point.{name}.moment", point.moment)
    return found | {f"energy.{key}": float(getattr(step.energy, key)) for key in ENERGIES}


def _vector(name: str, components: Array) -> dict[str, float]:
    return {f"{name}.{axis}": float(value) for axis, value in zip("xyz", components, strict=False)}


def turns(name: str, components: Array) -> dict[str, float]:
    """Of a moment or a rotation, (1,) about z in 2D."""
    axes = "z" if len(components) == 1 else "xyz"
    return {f"{name}.{axis}": float(value) for axis, value in zip(axes, components, strict=True)}


SINGULAR = {
    "contacts": "", "supports": "support.", "obstacles": "obstacle.", "springs": "spring.",
    "bolts": "bolt.", "remote_points": "remote_point.", "elastic_support": "elastic_support.", "probes": "probe.",
    "energy": "energy",
}  # fmt: skip


def total_errors(step: StepResult, errors: Errors) -> dict[str, float]:
    """Total error of every number by the names that `values` has; NaN: not known."""
    found: dict[str, float] = {}
    for key, value in quantities(step).items():
        total = errors[key].total if key in errors else None
        parts = np.full(np.shape(value), np.nan if total is None else total)
        found |= {name: float(parts if axis is None else parts[axis]) for name, axis in names_of(key, value)}
    return found


def names_of(key: Quantity, value: Value) -> Sequence[tuple[str, int | None]]:
    """Names of a number as `values` has them, and the component that each is; None: it has no components."""
    whole = ".".join(filter(None, (f"{SINGULAR[key.kind]}{key.name}", key.quantity)))
    if np.ndim(value) == 0:
        return [(f"{whole}.z" if key.quantity in ("moment", "rotation") else whole, None)]
    axes = [*STRESSES] if key.quantity == "stress" else [*"xyz"]
    return [(f"{whole}.{axis}", i) for i, axis in enumerate(axes[: np.size(value)])]
