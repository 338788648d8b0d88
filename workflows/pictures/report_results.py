"""What a results folder holds for a page: the content of result.json, the steps' files, the mesh, the pictures.

A run that was interrupted, or an older one, may lack some of it; what is not there is left out.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stickslip.geometry.arrays import AnyArray
from stickslip.geometry.errors import FolderError
from stickslip.geometry.units import Units
from stickslip.solvers.scene.record import CONTACT_NUMBERS
from stickslip.workflows.formats.csv_tables import STEPS, read_steps_table
from stickslip.workflows.formats.hdf5 import read_arrays
from stickslip.workflows.formats.marker import own_files
from stickslip.workflows.formats.mesh_file import MESH_FILE
from stickslip.workflows.formats.regular import read_json, read_regular
from stickslip.workflows.formats.steps import step_files

RESULT, BEGUN, LOG = "result.json", "begun.json", "run.log"
PER_METRE = {"N": "N/m", "N m": "N m/m", "J": "J/m", "m²": "m"}
WORK = re.compile(r"^\.(.*)\.running$")  # name of the folder in which a run works
OF_MESH = re.compile(r" INFO ((?:mesh|contact \w+): .*)$", re.MULTILINE)  # lines of the log


@dataclass(frozen=True, kw_only=True)
class Results:
    """A results folder, read."""

    folder: Path
    name: str  # of the results, for people
    content: Mapping[str, Any]  # of result.json; of a run without it: what is known of scene and steps
    steps: Mapping[int, Path]  # files of steps by index
    mesh: Mapping[str, AnyArray]  # fields.h5 by place, empty if there is none
    mesh_lines: tuple[str, ...]  # what the run has said of its mesh
    pictures: tuple[Path, ...]  # of the run, not those that a user keeps there

    @property
    def scene(self) -> Mapping[str, Any]:
        return dict(self.content.get("scene") or {})

    @property
    def title(self) -> str:
        return " ".join(str(self.scene.get("title") or self.name).split())

    @property
    def plane(self) -> bool:
        """Whether resultants are those of a metre of thickness."""
        return str(self.scene.get("model", "")).startswith("plane")

    @property
    def solid(self) -> bool:
        return self.scene.get("model") == "3d"

    @property
    def units(self) -> Units:
        """What the numbers are in."""
        return Units.of(str(self.scene.get("units", "SI")))

    @property
    def reported(self) -> list[Mapping[str, Any]]:
        """The steps of result.json."""
        return list(self.content.get("steps") or ())

    def unit(self, of: str) -> str:
        """Unit in the model and the units of the scene of what has this unit of the SI in space."""
        return self.units(PER_METRE.get(of, of) if self.plane else of)


def read_results(folder: Path) -> Results:
    """Read a results folder.

    Raises:
        FolderError: no run has written it, or one of another format.
        MachineError: one of its files is damaged.
    """
    content = read_json(folder / RESULT)
    if content.get("format", 1) != 1:
        raise FolderError(f"{folder / RESULT}: format {content['format']}, and this version reads format 1")
    if not isinstance(content.get("scene"), dict):
        content = _without_end(folder)
    return Results(
        folder=folder,
        name=WORK.sub(r"\1", folder.resolve().name),
        content=content,
        steps=step_files(folder),
        mesh=read_arrays(folder / MESH_FILE)[0] if (folder / MESH_FILE).is_file() else {},
        mesh_lines=tuple(dict.fromkeys(OF_MESH.findall(_text(folder / LOG)))),
        pictures=tuple(sorted(path for path in own_files(folder) if path.suffix == ".png")),
    )


def _without_end(folder: Path) -> dict[str, Any]:
    """What is known of a run that is at work, or was killed: its scene, and the rows of steps.csv.

    Raises:
        FolderError: no run has written the folder.
    """
    begun = read_json(folder / BEGUN)
    if not isinstance(begun.get("scene"), dict):
        raise FolderError(f"{folder}: holds no results of a run, neither {RESULT} nor {BEGUN}")
    names = tuple(begun["scene"].get("contacts") or ())
    table: Mapping[str, AnyArray] = {}
    if (folder / STEPS).is_file():
        table = read_steps_table(folder)

    def numbers(row: int, name: str) -> dict[str, Any]:
        found = {key: float(table[f"{name}.{key}"][row]) for key in CONTACT_NUMBERS if f"{name}.{key}" in table}
        return {key: value for key, value in found.items() if np.isfinite(value)}

    steps = [
        {"time": float(time), "contacts": {name: numbers(row, name) for name in names}}
        for row, time in enumerate(table.get("time", ()))
    ]
    said = "the run has not ended: it is at work, or was killed; stickslip run --resume goes on with it"
    return {"status": "not ended", "sentence": said, "version": begun.get("stickslip"), "steps": steps} | {
        "scene": begun["scene"] | {"units": begun.get("units", "SI")},
        "dolfinx": begun.get("dolfinx"),
    }


def _text(path: Path) -> str:
    try:
        return read_regular(path).decode(errors="replace")
    except OSError:
        return ""
