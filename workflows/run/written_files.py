"""Tables and XDMF files of a run, read back: the audit holds them against the steps and their files.

What they should tell is found here without their writers: numbers by the records that declare them, fields in the
step's file, values in time by a second formula.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from stickslip.geometry.arrays import TINY, AnyArray, Array
from stickslip.solvers.effects import by_name, records
from stickslip.solvers.results.closed_formulas import in_time
from stickslip.solvers.results.step_result import STATUS_WORDS, Errors, StepResult, told
from stickslip.solvers.scene.record import STRESSES, flat_names, numbers_of
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.formats.csv_tables import column, is_prescribed, read_steps_table, read_table
from stickslip.workflows.formats.hdf5 import read_arrays
from stickslip.workflows.formats.mesh_file import MESH_FILE
from stickslip.workflows.formats.steps import StoredContact, read_step, shown_as, step_files, step_name


class WrittenFiles:
    """What the files of a run tell, on rank 0."""

    def __init__(self, simulation: Simulation, folder: Path) -> None:
        self._scene, self._data, self._folder = simulation.scene, simulation.data, folder
        self._dim, self._around = simulation.mesh.dim, [0.0, 1.0] if simulation.mesh.axisymmetric else 1.0
        self._table = read_steps_table(folder)
        names = (*self._data.surfaces, *(["probes"] if self._scene.probes else []))
        files = {name: folder / (f"{name}.csv" if name == "probes" else f"contact_{name}.csv") for name in names}
        self._rows = {name: read_table(path) for name, path in files.items()}
        self._series = {path.stem: dict(_shown(path)) for path in sorted(folder.glob("*.xdmf"))}
        mesh = read_arrays(folder / MESH_FILE)[0]
        cells = np.sort(mesh["mesh/cells"]), np.sort(self._data.cells)
        self._mesh = _apart(mesh["mesh/points"][:, : self._dim], self._data.points) + float(
            (cells[0] != cells[1]).any()
        )

    def apart(self, steps: Sequence[StepResult], errors: Sequence[Errors] | None) -> list[float]:
        """Largest difference of each step, relative to the number [-]; infinite: something is missing."""
        stored, found, starts = step_files(self._folder), list[float](), dict.fromkeys(self._rows, 0)
        for index, step in enumerate(steps, start=1):
            own = [*self._numbers(index, step, None if errors is None else errors[index - 1])]
            contacts = read_step(stored[index]).contacts if index in stored else {}
            for name, (header, rows) in self._rows.items():
                count = len(self._scene.probes) if name == "probes" else len(self._data.surfaces[name].points)
                part = rows[starts[name] : starts[name] + count]
                starts[name] += count
                columns = dict(zip(header, np.array(part, object).reshape(count, len(header)).T, strict=True))
                if name == "probes":
                    own += self._probes(step, columns)
                elif name in contacts:
                    own += self._contact(name, step, contacts[name], columns)
                    own += self._means(index, name, contacts[name])
            if index in stored and (index % self._scene.output.every == 0 or index == len(steps)):
                own += self._shown(index, step)
            found.append(max(own, default=0.0))
        return found

    def _numbers(self, index: int, step: StepResult, errors: Errors | None) -> Iterator[float]:
        """Numbers of a step in steps.csv, their errors, and values in time."""
        row, reported = {name: rows[index - 1] for name, rows in self._table.items()}, set[str]()
        plain = told(step, errors)
        for table, record in records().items():
            for name, own in by_name(table, plain[table]).items():
                for key, number in numbers_of(record).items():
                    parts = np.ravel(own[key])
                    stated = ((own.get("error") or {}).get(key) or {}).get("total")
                    for k, flat in enumerate(flat_names(table, name, key, number, len(parts))):
                        reported.add(flat)
                        if number.column or flat in row:
                            yield _apart(row.get(flat, np.inf), parts[k])
                        if number.column and number.error and errors is not None:
                            error = np.nan if stated is None else np.ravel(stated)[k]
                            yield _apart(row.get(f"{flat}.error", np.inf), error)
        for key in numbers_of(StepResult):
            yield _apart(row.get(key, np.inf), getattr(step, key))
        for key, value in step.columns.items():
            yield _apart(row.get(key, np.inf), value)
        for place, amplitude in self._scene.drives().items():
            if is_prescribed(place) and column(place) not in reported:  # what is found wins
                yield _apart(row.get(column(place), np.inf), in_time(amplitude, step.time, self._scene.steps.end))

    def _means(self, index: int, name: str, contact: StoredContact) -> Iterator[float]:
        """Tangential force and mean slip of a contact in steps.csv, of the fields at its nodes."""
        push = contact.weight * np.abs(contact.pressure)
        drag, slid = contact.weight[:, None] * contact.traction, push[:, None] * contact.slip
        expected = {"tangential_force": (drag[:, : self._dim].sum(axis=0) * self._around, np.abs(drag).sum())}
        touches = bool((contact.status > 0).any()) and push.sum() > 0
        mean = slid[:, : self._dim].sum(axis=0) / push.sum() if touches else np.full(self._dim, np.nan)
        expected["slip"] = mean, np.abs(slid).sum() / push.sum() if touches else 0.0
        for key, (vector, size) in expected.items():
            found = np.array(
                [self._table.get(f"{name}.{key}.{axis}", {index - 1: np.inf})[index - 1] for axis in "xyz"[: self._dim]]
            )
            yield _apart(found, vector, size)

    def _contact(
        self, name: str, step: StepResult, contact: StoredContact, columns: dict[str, AnyArray]
    ) -> Iterator[float]:
        """Rows of a contact's table, which has what the step's file has."""
        points, axes = self._data.surfaces[name].points, "xyz"[: self._dim]
        expected = {axis: points[:, k] for k, axis in enumerate(axes)} | {"time": np.full(len(points), step.time)}
        for key, found in vars(contact).items():
            if key == "status":
                yield float((columns[key] != np.array(STATUS_WORDS)[found]).any())
            else:
                each = {f"_{axis}": found[:, k] for k, axis in enumerate(axes)} if found.ndim == 2 else {"": found}
                expected |= {f"{shown_as(key)}{axis}": part for axis, part in each.items()}
        for key, found in expected.items():
            yield _apart(columns[key].astype(float), found) if key in columns else np.inf

    def _probes(self, step: StepResult, columns: dict[str, AnyArray]) -> Iterator[float]:
        """Rows of the table of probes."""
        for k, (name, probe) in enumerate(step.probes.items()):
            yield float(columns["probe"][k] != name) + _apart(float(columns["time"][k]), step.time)
            for axis, value in zip("xyz", probe.displacement, strict=False):
                yield _apart(float(columns[f"displacement_{axis}"][k]), value)
            for axis, at in STRESSES.items():
                yield _apart(float(columns[f"stress_{axis}"][k]), probe.stress[at])

    def _shown(self, index: int, step: StepResult) -> Iterator[float]:
        """What XDMF files show of a step: its own fields under their names, at its time, on the mesh."""
        yield self._mesh
        for name, series in self._series.items():
            time, fields = series.get(index, (np.inf, {}))
            place = "/".join(["contacts", name.removeprefix("contact_"), ""]) if name.startswith("contact_") else ""
            yield _apart(time, step.time)
            for field, source in fields.items():
                own = {"lambda": "lam"}.get(field, field)
                yield float(source not in (f"{step_name(index)}:/{place}{own}", f"{MESH_FILE}:/mesh/{field}"))


def _shown(path: Path) -> Iterator[tuple[int, tuple[float, dict[str, str]]]]:
    """By number of a step, its time [s] and the place of each field that an XDMF file shows."""
    for grid in re.findall(r'<Grid [^>]*GridType="Uniform">(.*?)</Grid>', path.read_text(), re.DOTALL):
        (time,) = re.findall(r'<Time Value="([^"]*)"', grid)
        fields = dict(re.findall(r'<Attribute Name="([^"]*)".*?<DataItem[^>]*>([^<]*)</DataItem>', grid, re.DOTALL))
        files = Counter(Path(source.split(":")[0]).stem for source in fields.values() if MESH_FILE not in source)
        yield int(files.most_common(1)[0][0]), (float(time), fields)


def _apart(found: Array | float, expected: Array | float, size: float = 0.0) -> float:
    """Largest difference of numbers, each relative to itself, or to `size` if that is larger; NaN is like NaN [-]."""
    a, b = np.asarray(found, float), np.asarray(expected, float)
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    off = np.abs(a - b) / np.maximum(np.maximum(np.abs(a), np.abs(b)), size + TINY)
    return float(np.where(same, 0.0, np.where(np.isnan(off), np.inf, off)).max(initial=0.0))
