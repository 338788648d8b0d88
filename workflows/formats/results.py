"""A results folder, read: the content of result.json, the steps' files, the mesh, the pictures; and its profile.

A run that was interrupted, or an older one, may lack some of it; what is not there is left out.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stickslip.geometry.arrays import SLIGHT, AnyArray
from stickslip.geometry.errors import FolderError
from stickslip.geometry.units import Units
from stickslip.solvers.effects import by_name, records
from stickslip.solvers.parallel.counters import PHASES, Row
from stickslip.solvers.results.step_result import PARTS, told
from stickslip.solvers.scene.record import ContactNumbers, Energy, numbers_of
from stickslip.workflows.formats.files import json_text, parse_json, read_json
from stickslip.workflows.formats.hdf5 import read_arrays
from stickslip.workflows.formats.marker import RESULT, checksums, marker_of, own_files, read_checked_json, text_of
from stickslip.workflows.formats.mesh_file import MESH_FILE
from stickslip.workflows.formats.neglect_table import largest_neglected
from stickslip.workflows.formats.plus_minus import AT_LEAST, UNKNOWN, missing, of_parts, parts_of
from stickslip.workflows.formats.steps import light_files, read_checkpoint, step_files

BEGUN, LOG = "begun.json", "run.log"
PER_METRE = {"N": "N/m", "N m": "N m/m", "J": "J/m", "m²": "m", "m³": "m²"}
WORK = re.compile(r"^\.(.*)\.running$")  # name of the folder in which a run works
OF_MESH = re.compile(r" INFO ((?:mesh|contact \w+): .*)$", re.MULTILINE)  # lines of the log
HEAD = ("phase", "seconds", "share", "calls", "volume solves")
REFERENCE = "linear_reference"
MAIN = ("normal_force", "tangential_force", "max_pressure", "stored")  # numbers whose errors are told by part
INPUTS, WITH_INPUTS, NEGLECTED = "inputs, k = 1", "with inputs, k = 1", "largest neglected"


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
        """Units of the numbers."""
        return Units.of(str(self.scene.get("units", "SI")))

    @property
    def reported(self) -> list[Mapping[str, Any]]:
        """The steps of result.json."""
        return list(self.content.get("steps") or ())

    def unit(self, of: str) -> str:
        """Unit in the model and the units of the scene of what has this unit of the SI in space."""
        return unit_of(self.scene, of)

    def lacks(self) -> Iterator[str]:
        """Yield sentences on what cannot be told or vouched for: files that are lost, and results without checksums."""
        known, every = checksums(self.folder), {*range(1, len(self.reported) + 1)}
        if lost := every - {*self.steps, *light_files(self.folder)}:
            yield f"files of {len(lost)} of {len(every)} steps are lost; not told"
        gone = [name for name in known if "/" not in name and not (self.folder / name).exists()]
        if gone:
            yield f"{', '.join(gone)}: lost; not told"
        if (self.folder / RESULT).exists() and not {*known} - {RESULT}:
            yield "has no checksums, as results of earlier versions: read as it is"


def unit_of(scene: Mapping[str, Any], of: str) -> str:
    """Unit in the model and the units of a scene of what has this unit of the SI in space."""
    plane = str(scene.get("model", "")).startswith("plane")
    return Units.of(str(scene.get("units", "SI")))(PER_METRE.get(of, of) if plane else of)


def error_budget(content: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows of a table: main numbers of the last step with ±, by part, by inputs, and by what is left out.

    A part that is less than a thousandth of the largest is a dash.

    Args:
        content: of result.json; no rows where errors and inputs are not asked for.
    """
    last, found = (content.get("steps") or [{}])[-1], list[dict[str, str]]()
    owners = [(name, ContactNumbers, owner) for name, owner in (last.get("contacts") or {}).items()]
    for name, record, owner in (*owners, ("", Energy, last.get("energy"))):
        declared = {key: number for key, number in numbers_of(record).items() if key in MAIN and (owner or {}).get(key)}
        for key, number in declared.items():
            error, inputs = ((owner.get(table) or {}).get(key) or {} for table in ("error", "uncertainty"))
            words = f"{name} {number.words} [{unit_of(content.get('scene') or {}, number.unit)}]".strip()
            parts = {part: error.get(part) for part in (*PARTS, "model")}
            parts |= {INPUTS: inputs.get("inputs"), WITH_INPUTS: inputs.get("combined")}
            least = SLIGHT * max((size for size in parts.values() if size is not None), default=0.0)
            known = {part: f"{size:.1g}" for part, size in parts.items() if size is not None and size > least}
            effect = largest_neglected(content, f"{name or 'energy'}.{key}", owner[key])
            known |= {NEGLECTED: effect} if effect else {}
            found.append({"number": words, "±": of_parts(owner[key], parts_of(error)), **known})
    columns = ("number", "±", *PARTS, "model", INPUTS, WITH_INPUTS, NEGLECTED)
    head = [key for key in columns if any(key in row for row in found)]
    rows = [tuple(row.get(key, "–") for key in head) for row in found]
    return tuple(key.replace("_", " ") for key in head), rows if len(head) > len(("number", "±")) else []


def legend(content: Mapping[str, Any]) -> str:
    """What marks beside the numbers of result.json mean, and why errors are not estimated, in a line."""
    owners = [own for step in content["steps"] for kind in records() for own in by_name(kind, step.get(kind)).values()]
    every = [parts_of(error) for own in owners if own for error in (own.get("error") or {}).values()]
    lacking = {name: cost for parts in every if missing(parts) for name, cost in parts.lacking.items()}
    said = {name: f" ({cost:.2g} times the run)" if cost else " (not known)" for name, cost in lacking.items()}
    unknown = "output.error = false" if not (content["scene"].get("output") or {}).get("error", True) else ""
    if any(parts.total is None and parts.converges is not False for parts in every):
        unknown = "the mesh's part cannot be told"
    notes = ["without ±: exact in the digits shown"]
    if unknown or not every:
        notes.append(f"± {UNKNOWN}: not estimated, {unknown or 'the run has left no estimates'}")
    if without := [name.replace("_", " ") + said[name] for name in PARTS if name in lacking]:
        notes.append(f"± {AT_LEAST}, ± {UNKNOWN}: without the error of the {listed(without)}")
    if any(parts.converges is False for parts in every):
        notes.append("grows: has no limit on ever finer meshes, as at a sharp edge")
    return "; ".join(notes)


def listed(names: Iterable[str]) -> str:
    """As one says it.

    >>> listed(["a", "b", "c"])
    'a, b and c'
    """
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last


def read_results(folder: Path) -> Results:
    """Read a results folder; what a run has left when it ended is compared with its checksums.

    Raises:
        FolderError: no run has written it, or one of another format.
        MachineError: one of its files is damaged, changed, or another one; or result.json is missing.
    """
    content, path = dict[str, Any](), folder / RESULT
    if os.path.lexists(path) or (RESULT in marker_of(folder).sha256 and not WORK.match(folder.name)):
        content = read_checked_json(path)
    if content.get("format", 1) != 1:
        raise FolderError(f"{folder / RESULT}: format {content['format']}, and this version reads format 1")
    if not isinstance(content.get("scene"), dict):
        content = _without_end(folder)
    return Results(
        folder=folder,
        name=WORK.sub(r"\1", folder.resolve().name),
        content=content,
        steps=step_files(folder),
        mesh=read_arrays(folder / MESH_FILE)[0] if (folder / MESH_FILE).exists() else {},
        mesh_lines=tuple(dict.fromkeys(OF_MESH.findall(text_of(folder / LOG)))),
        pictures=tuple(sorted(path for path in own_files(folder) if path.suffix == ".png")),
    )


def _without_end(folder: Path) -> dict[str, Any]:
    """Return what is known of a run that is at work, or was killed: its scene, and its steps from their files.

    Raises:
        FolderError: no run has written the folder.
        MachineError: the file of a step is damaged, or that of another one.
    """
    begun = read_json(folder / BEGUN)
    if not isinstance(begun.get("scene"), dict):
        raise FolderError(f"{folder}: holds no results of a run, neither {RESULT} nor {BEGUN}")
    files = light_files(folder) | step_files(folder)
    results = (read_checkpoint(files[index])[0] for index in sorted(files))
    steps = [parse_json(json_text(told(result, None)).encode()) for result in results]
    said = "the run has not ended: it is at work, or was killed; stickslip run --resume goes on with it"
    return {"status": "not ended", "sentence": said, "version": begun.get("stickslip"), "steps": steps} | {
        "scene": begun["scene"] | {"units": begun.get("units", "SI")},
        "dolfinx": begun.get("dolfinx"),
    }


def seconds_of(rows: Sequence[Row], reference: float | None) -> dict[str, float | None]:
    """Wall time by phase [s], and `total`, which is the sum of all others.

    Args:
        rows: of the run's clock.
        reference: of the fastest solver of the linear reference [s], which stands apart; None: it was not measured.

    >>> row = Row(phase="linear_reference", part="", seconds=3.0, calls=1, volume_solves=0)
    >>> found = seconds_of([row], 1.0)
    >>> found["linear_reference"], found["linear_reference_others"], found["total"]
    (1.0, 2.0, 3.0)
    """
    found: dict[str, float | None] = {phase: sum(r.seconds for r in rows if r.phase == phase) for phase in PHASES}
    spent = found[REFERENCE] or 0.0
    found[REFERENCE] = reference
    found[f"{REFERENCE}_others"] = None if reference is None else spent - reference
    return found | {"total": sum(row.seconds for row in rows)}


def profile_rows(profile: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, ...]]:
    """Rows below `HEAD` of the profile of result.json: each phase as a whole, and its parts below it."""
    total = sum(row["seconds"] for row in profile)
    for phase in dict.fromkeys(row["phase"] for row in profile):
        own = [row for row in profile if row["phase"] == phase]
        calls = sum(row["calls"] for row in own if not row["part"]) or max(row["calls"] for row in own)
        yield _cells(phase, sum(r["seconds"] for r in own), total, calls, sum(r["volume_solves"] for r in own))
        for row in own if len(own) > 1 else ():
            name = f"  {row['part'] or 'all else'}"
            yield _cells(name, row["seconds"], total, row["calls"], row["volume_solves"])
    yield _cells("total", total, total, 0, sum(row["volume_solves"] for row in profile))


def profile_lines(profile: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the profile as a table of plain text."""
    rows = [HEAD, *profile_rows(profile)]
    wide = [max(len(row[column]) for row in rows) for column in range(len(HEAD))]
    return [
        "  ".join([row[0].ljust(wide[0]), *(cell.rjust(w) for cell, w in zip(row[1:], wide[1:], strict=True))]).rstrip()
        for row in rows
    ]


def _cells(name: str, seconds: float, total: float, calls: int, solves: int) -> tuple[str, ...]:
    share = f"{seconds / total:.1%}" if total else ""
    return name.replace("_", " "), f"{seconds:.3f}", share, str(calls or ""), str(solves or "")
