"""Tables and XDMF files of a run, read back: the audit holds them against the steps and their files.

What they should tell is found here without their writers: numbers by the records that declare them, fields in the
step's file, values in time by a second formula.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stickslip.geometry.arrays import TINY, AnyArray, Array
from stickslip.solvers.effects import by_name, records
from stickslip.solvers.results.closed_formulas import in_time
from stickslip.solvers.results.step_result import STATUS_WORDS, Errors, StepResult, told
from stickslip.solvers.scene.record import STRESSES, flat_names, numbers_of
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.formats.csv_tables import column, is_prescribed, read_steps_table, read_table
from stickslip.workflows.formats.hdf5 import read_arrays
from stickslip.workflows.formats.mesh_file import MESH_FILE
from stickslip.workflows.formats.steps import shown_as, step_files, step_name

Expected = tuple[str, float, float]  # a column of steps.csv, its value, and what that is relative to if it is larger


class WrittenFiles:
    """What the files of a run tell, on rank 0: tables of contacts step by step, the others once all are written."""

    def __init__(self, simulation: Simulation, folder: Path) -> None:
        self._scene, self._data, self._folder = simulation.scene, simulation.data, folder
        self._dim, self._around = simulation.mesh.dim, np.array([0.0, 1.0] if simulation.mesh.axisymmetric else [1.0])
        self._contacts = {name: read_table(folder / f"contact_{name}.csv") for name in self._data.surfaces}
        self._off, self._means = list[list[float]](), list[list[Expected]]()  # by step

    def see(self, time: float, contacts: Mapping[str, Mapping[str, AnyArray]]) -> None:
        """Hold tables of contacts against the next step.

        Args:
            time: [s].
            contacts: as its file has them; empty where it has none.
        """
        self._off.append([])
        self._means.append([])
        for name, (header, rows) in self._contacts.items():
            points = self._data.surfaces[name].points
            own = [*islice(rows, len(points))]
            if name in contacts:
                self._means[-1].extend(self._mean(name, contacts[name]))
                self._off[-1].extend(self._contact(points, time, contacts[name], _columns(header, own, len(points))))

    def apart(self, steps: Sequence[StepResult], errors: Sequence[Errors] | None) -> list[float]:
        """Largest difference of each step that was seen, relative to the number [-]; infinite: something is missing."""
        table, found, probes = read_steps_table(self._folder), list[float](), len(self._scene.probes)
        header, rows = read_table(self._folder / "probes.csv") if probes else ([], iter([]))
        series = {path.stem: dict(_shown(path)) for path in sorted(self._folder.glob("*.xdmf"))}
        stored, mesh = step_files(self._folder), self._mesh()
        for index, (step, off) in enumerate(zip(steps, self._off, strict=True), start=1):
            row = {name: values[index - 1] for name, values in table.items() if index <= len(values)}
            expected = [*self._numbers(row, step, None if errors is None else errors[index - 1])]
            names, values, sizes = zip(*expected, *self._means[index - 1], strict=True)
            off.append(_apart([row.get(name, np.inf) for name in names], values, np.array(sizes)))
            if probes:
                off.extend(self._probes(step, _columns(header, [*islice(rows, probes)], probes)))
            if index in stored and (index % self._scene.output.every == 0 or index == len(steps)):
                off.extend((mesh, *_shown_apart(series, index, step)))
            found.append(max(off))
        return found

    def _mesh(self) -> float:
        mesh = read_arrays(self._folder / MESH_FILE)[0]
        same = np.array_equal(np.sort(mesh["mesh/cells"]), np.sort(self._data.cells))
        return _apart(mesh["mesh/points"][:, : self._dim], self._data.points) + float(not same)

    def _numbers(self, row: Mapping[str, float], step: StepResult, errors: Errors | None) -> Iterator[Expected]:
        """Numbers of a step in steps.csv, their errors, and values in time."""
        reported, plain = set[str](), told(step, errors)
        for table, record in records().items():
            for name, own in by_name(table, plain[table]).items():
                for key, number in ((key, n) for key, n in numbers_of(record).items() if key in own):
                    parts = np.ravel(own[key])
                    stated = ((own.get("error") or {}).get(key) or {}).get("total")
                    slopes = own.get("sensitivity", {}).get(key, {})
                    for k, flat in enumerate(flat_names(table, name, key, number, len(parts))):
                        reported.add(flat)
                        if number.column or flat in row:
                            yield flat, parts[k], 0.0
                        if number.column and number.error and errors is not None:
                            yield f"{flat}.error", np.nan if stated is None else np.ravel(stated)[k], 0.0
                        yield from _by_inputs(flat, {by: _sides(slope, k) for by, slope in slopes.items()}, step)
        for key in numbers_of(StepResult):
            yield key, getattr(step, key), 0.0
        for key, value in step.columns.items():
            yield key, value, 0.0
        for place, amplitude in self._scene.drives().items():
            if is_prescribed(place) and column(place) not in reported:  # what is found wins
                yield column(place), in_time(amplitude, step.time, self._scene.steps.end), 0.0

    def _mean(self, name: str, contact: Mapping[str, AnyArray]) -> Iterator[Expected]:
        """Tangential force and mean slip of a contact in steps.csv, of the fields at its nodes."""
        push = contact["weight"] * np.abs(contact["pressure"])
        drag, slid = contact["weight"][:, None] * contact["traction"], push[:, None] * contact["slip"]
        expected = {"tangential_force": (drag[:, : self._dim].sum(axis=0) * self._around, np.abs(drag).sum())}
        touches = bool((contact["status"] > 0).any()) and push.sum() > 0
        mean = slid[:, : self._dim].sum(axis=0) / push.sum() if touches else np.full(self._dim, np.nan)
        expected["slip"] = mean, np.abs(slid).sum() / push.sum() if touches else 0.0
        for key, (vector, size) in expected.items():
            yield from ((f"{name}.{key}.{axis}", value, size) for axis, value in zip("xyz", vector, strict=False))

    def _contact(
        self, points: Array, time: float, contact: Mapping[str, AnyArray], columns: Mapping[str, AnyArray]
    ) -> Iterator[float]:
        """Rows of a contact's table, which has what the step's file has."""
        axes, expected = "xyz"[: self._dim], {"time": np.full(len(points), time)}
        expected |= {axis: points[:, k] for k, axis in enumerate(axes)}
        for key, found in contact.items():
            if key != "status" and found is not None:
                each = {f"_{axis}": found[:, k] for k, axis in enumerate(axes)} if found.ndim == 2 else {"": found}
                expected |= {f"{shown_as(key)}{axis}": part for axis, part in each.items()}
        if not {*expected, "status"} <= columns.keys():
            yield np.inf
            return
        yield float((columns["status"] != np.array(STATUS_WORDS)[contact["status"]]).any())
        yield _apart([columns[key].astype(float) for key in expected], [*expected.values()])

    def _probes(self, step: StepResult, columns: Mapping[str, AnyArray]) -> Iterator[float]:
        """Rows of the table of probes."""
        if not columns:
            yield np.inf
            return
        for k, (name, probe) in enumerate(step.probes.items()):
            yield float(columns["probe"][k] != name) + _apart(float(columns["time"][k]), step.time)
            for axis, value in zip("xyz", probe.displacement, strict=False):
                yield _apart(float(columns[f"displacement_{axis}"][k]), value)
            for axis, at in STRESSES.items():
                yield _apart(float(columns[f"stress_{axis}"][k]), probe.stress[at])


def _sides(slope: Any, k: int) -> Array:
    """Both sides (2,) of the derivative of a component, as result.json has it; NaN: there is none."""
    both = [slope["below"], slope["above"]] if isinstance(slope, dict) else [slope, slope]
    return np.array([np.nan if side is None else np.ravel(side)[k] for side in both])


def _by_inputs(name: str, slopes: Mapping[str, Array], step: StepResult) -> Iterator[Expected]:
    """Derivatives of a number in steps.csv; and what is left by inputs, of a gradient and its jump.

    Args:
        name: of the number's column.
        slopes: both sides (2,) of each derivative, by number of the scene.
    """
    for by, (below, above) in slopes.items():
        yield f"{name}.sensitivity.{by}", above if below == above else np.nan, 0.0
    if slopes and (inputs := step.covariance):
        half = np.array([np.diff(slopes[by])[0] / 2 for by in inputs])
        mean, C = (
            np.array([slopes[by][0] for by in inputs]) + half,
            np.array([[*row.values()] for row in inputs.values()]),
        )
        yield f"{name}.uncertainty", float(np.sqrt(mean @ C @ mean + np.diag(C) @ half**2)), 0.0


def _columns(header: Sequence[str], rows: Sequence[Sequence[str]], count: int) -> dict[str, AnyArray]:
    """Cells by column; none where rows or cells are missing."""
    whole = len(rows) == count and all(len(row) == len(header) for row in rows)
    return dict(zip(header, np.array(rows, object).T, strict=True)) if whole else {}


def _shown_apart(
    series: Mapping[str, Mapping[int, tuple[float, Mapping[str, str]]]], index: int, step: StepResult
) -> Iterator[float]:
    """What XDMF files show of a step: its own fields under their names, at its time."""
    for name, shown in series.items():
        time, fields = shown.get(index, (np.inf, {}))
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


def _apart(found: ArrayLike, expected: ArrayLike, size: Array | float = 0.0) -> float:
    """Largest difference of numbers, each relative to itself, or to `size` if that is larger; NaN is like NaN [-]."""
    a, b = np.asarray(found, float), np.asarray(expected, float)
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    with np.errstate(invalid="ignore"):  # what is missing is infinite
        off = np.abs(a - b) / np.maximum(np.maximum(np.abs(a), np.abs(b)), size + TINY)
    return float(np.where(same, 0.0, np.where(np.isnan(off), np.inf, off)).max(initial=0.0))
