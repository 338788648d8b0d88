"""Results of a run, given back from its folder as what `steps` yields: arrays with coordinates."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any, overload

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import FolderError
from stickslip.geometry.keys import typed
from stickslip.geometry.protocols import DataFrame
from stickslip.solvers.results.step_result import MeshData, StepResult, data_frame, html_table
from stickslip.solvers.scene.record import CONTACT_NUMBERS
from stickslip.workflows.formats.csv_tables import STEPS, read_steps_table
from stickslip.workflows.formats.hdf5 import read_arrays
from stickslip.workflows.formats.mesh_file import MESH_FILE, mesh_from
from stickslip.workflows.formats.plus_minus import error_of, of_parts
from stickslip.workflows.formats.results import Results, read_results
from stickslip.workflows.formats.steps import light_files, read_checkpoint, step_name
from stickslip.workflows.run.folder import BEGUN, RESULT, work_of

log = logging.getLogger(__name__)


class StoredSteps(Sequence[StepResult]):
    """The steps of a folder, each read when it is asked for."""

    def __init__(self, files: Sequence[Path]) -> None:
        self._files = tuple(files)

    def __len__(self) -> int:
        return len(self._files)

    @overload
    def __getitem__(self, index: int) -> StepResult: ...
    @overload
    def __getitem__(self, index: slice) -> StoredSteps: ...
    def __getitem__(self, index: int | slice) -> StepResult | StoredSteps:
        """A step, verified.

        Raises:
            DamagedError: its file is cut short, or damaged.
            MachineError: it cannot be read, or is of another version.
        """
        return StoredSteps(self._files[index]) if isinstance(index, slice) else read_checkpoint(self._files[index])[0]

    def kept(self) -> Iterator[StepResult]:
        """Yield those whose files are not lost."""
        return (read_checkpoint(path)[0] for path in self._files if os.path.lexists(path))

    def __repr__(self) -> str:
        return f"<{len(self)} steps>"


@dataclass(frozen=True, kw_only=True, repr=False)
class Loaded:
    """Results that a run has left in its folder; files are read when they are asked for."""

    folder: Path
    result: Mapping[str, Any]  # the content of result.json; of a run without an end: its scene, and what steps.csv has
    steps: StoredSteps  # as `steps` has yielded them

    @property
    def status(self) -> str:
        """Status with which the run ended, see `Outcome`; "not ended" while it is at work, or was killed."""
        return str(self.result["status"])

    @property
    def scene(self) -> Mapping[str, Any]:
        """The resolved scene, as the tables of its file."""
        return dict(self.result["scene"])

    @property
    def times(self) -> tuple[float, ...]:
        """End of each step [s]."""
        return tuple(float(step["time"]) for step in self.result["steps"])

    @cached_property
    def mesh(self) -> MeshData:
        """The mesh, in whose order the fields of the steps are.

        Raises:
            FolderError: another version has written it.
            MachineError: it is missing or damaged.
        """
        arrays = read_arrays(self.folder / MESH_FILE)[0]
        try:
            return mesh_from(arrays, 3 if self.scene["model"] == "3d" else 2)
        except KeyError as error:
            raise FolderError(
                f"{self.folder / MESH_FILE}: of an earlier version, without {error}; run it again"
            ) from None

    @cached_property
    def columns(self) -> dict[str, Array]:
        """The columns of steps.csv, with a value for each step; NaN where a cell is empty."""
        none = not self.result["steps"] and not (self.folder / STEPS).exists()
        return {} if none else read_steps_table(self.folder)

    def to_pandas(self) -> DataFrame:
        """The table of the steps as a `pandas.DataFrame`.

        Raises:
            ImportError: pandas is not installed.
        """
        return data_frame(self.columns)

    def __repr__(self) -> str:
        return f"Loaded({str(self.folder)!r}: {self.scene['title']!r}, {self.status}, {len(self.steps)} steps)"

    def _repr_html_(self) -> str:
        """A table of the contacts at the last step, for notebooks."""
        last: Mapping[str, Any] = next(reversed(self.result["steps"]), {"time": 0.0, "contacts": {}})
        kept = {
            name: {key: of_parts(own[key], error_of(own, key)) for key in CONTACT_NUMBERS if own.get(key) is not None}
            for name, own in last["contacts"].items()
        }
        return f"<p>{escape(repr(self))}</p>" + html_table(f"t = {last['time']:g}", kept)


def found(folder: Path, tell: Callable[[str], object] = log.warning) -> Results:
    """The results that stand there, or those of the run that was to leave them there.

    Args:
        tell: told what of them cannot be vouched for, in a line each.

    Raises:
        FolderError: there are none.
        MachineError: result.json or the mesh is damaged or missing, or not what the run has left.
    """
    target = folder if folder.name not in ("", "..") else folder.resolve()  # only what is written needs a name
    known = (folder, work_of(target)) if target.name else (folder,)
    if not any(place.is_dir() for place in known):
        raise FolderError(f"{folder}: no such folder")
    places = [place for place in known if any((place / name).is_file() for name in (RESULT, BEGUN))]
    results = read_results(places[0] if places else folder)
    for line in results.lacks():
        tell(f"{folder}: {line}")
    return results


@typed
def load(folder: str | Path) -> Loaded:
    """Read what a run has left; nothing is solved.

    Args:
        folder: of the results; of a run that is at work or was killed, where they would stand.

    Returns:
        The results; steps and mesh are read when they are asked for.

    Raises:
        FolderError: there are no results.
        MachineError: they are damaged, or not what the run has left.
    """
    return loaded(found(Path(folder)))


def loaded(read: Results) -> Loaded:
    """Return results as `load` does."""
    files = light_files(read.folder) | dict(read.steps)  # steps without fields too
    count = len(read.reported)
    steps = StoredSteps([files.get(index, read.folder / step_name(index)) for index in range(1, count + 1)])
    return Loaded(folder=read.folder, result=read.content, steps=steps)
