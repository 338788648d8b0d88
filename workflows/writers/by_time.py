"""steps.csv: one row a reported step, of what the scene prescribes then and of what comes of it."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from geometry.amplitude import Amplitude, value_at
from geometry.errors import MachineError
from solvers.nouns.load import Load
from solvers.nouns.scene import Scene
from solvers.quantities import CONTACT_NUMBERS, ENERGIES, values
from solvers.step_result import Array, ContactState, StepResult
from workflows.writers.tables import append_rows

NAME = "steps.csv"
EFFORT = ("substeps", "iterations", "volume_solves", "residual")


def write_by_time(folder: Path, index: int, scene: Scene, step: StepResult) -> None:
    """Append the row of a step.

    Raises:
        MachineError: the disk is full.
    """
    row = row_of(index, scene, step)
    append_rows(folder / NAME, list(row), [list(row.values())])


def row_of(index: int, scene: Scene, step: StepResult) -> dict[str, float]:
    """By column: SI units; resultants act on the slave side."""
    found: dict[str, float] = {"step": index, "time": step.time}
    found |= {name: value_at(amplitude, step.time, scene.steps.end) for name, amplitude in drives(scene)}
    numbers = values(step)
    for name, contact in step.contacts.items():
        found |= {f"{name}.{key}": numbers.pop(f"{name}.{key}") for key in CONTACT_NUMBERS}
        found |= _vectors(name, contact, scene.axisymmetric)
    energies = {key: numbers.pop(key) for key in (f"energy.{key}" for key in ENERGIES)}
    for name, (_, moment) in step.supports.items():
        numbers |= _moment(f"support.{name}", moment)
    for name, (_, _, moment) in step.obstacles.items():
        numbers |= _moment(f"obstacle.{name}", moment)
    effort = {key: getattr(step, key) for key in EFFORT}
    return {
        name: float(n) if isinstance(n, float) else int(n) for name, n in (found | numbers | energies | effort).items()
    }


def drives(scene: Scene) -> Iterator[tuple[str, Amplitude]]:
    """What the scene prescribes in time, by column; an obstacle's displacement is told with what comes of its force."""
    for name, support in scene.supports.items():
        yield from ((f"support.{name}.displacement.{axis}", a) for axis, a in support.displacement.items())
    for name, load in scene.loads.items():
        yield from _load(f"load.{name}", load)
    for name, obstacle in scene.obstacles.items():
        if obstacle.rotation is not None:
            yield f"obstacle.{name}.rotation", obstacle.rotation.angle


def read_by_time(folder: Path) -> dict[str, Array]:
    """The columns of steps.csv, each with a value a step.

    Raises:
        MachineError: it is missing or damaged.
    """
    path = folder / NAME
    try:
        with path.open(encoding="utf-8", newline="") as file:
            header, *rows = csv.reader(file)
            table = np.array(rows, float).reshape(len(rows), len(header))
    except (OSError, ValueError) as error:
        raise MachineError(f"{path}: cannot be read: {error}") from error
    return dict(zip(header, table.T, strict=True))


def _load(name: str, load: Load) -> Iterator[tuple[str, Amplitude]]:
    if load.pressure is not None:
        yield f"{name}.pressure", load.pressure
    for key in ("traction", "force"):
        yield from ((f"{name}.{key}.{axis}", a) for axis, a in zip("xyz", getattr(load, key) or (), strict=False))


def _vectors(name: str, contact: ContactState, axisymmetric: bool) -> dict[str, float]:
    """Components of the resultant, of its tangential part, and of the mean slip, weighted by pressure."""
    tangential = contact.weight @ contact.traction
    pressing = contact.weight * np.abs(contact.pressure)
    slip = pressing @ contact.slip / (pressing.sum() or 1.0)
    if axisymmetric:  # over the full circle the radial parts balance
        tangential = tangential * [0, 1]
    vectors = {"force": contact.force, "tangential_force": tangential, "slip": slip}
    return {
        f"{name}.{key}.{axis}": float(x)
        for key, vector in vectors.items()
        for axis, x in zip("xyz", vector, strict=False)
    }


def _moment(name: str, moment: Array) -> dict[str, float]:
    axes = "z" if len(moment) == 1 else "xyz"
    return {f"{name}.moment.{axis}": float(value) for axis, value in zip(axes, moment, strict=True)}
