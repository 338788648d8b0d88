"""Time series for ParaView, and XDMF: light XML that points at fields.h5 (mesh) and at the step files; nothing twice.

Of a series every n-th step and the last one are shown, listed in an index that is written anew as it grows.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stickslip.geometry.arrays import Array, Ints
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.contact import Contact
from stickslip.workflows.formats.files import make_folder, write_aside
from stickslip.workflows.formats.hdf5 import checksum, is_whole, stored_checksum, write_arrays
from stickslip.workflows.formats.mesh_file import MESH_FILE, mesh_arrays, shape_of
from stickslip.workflows.formats.steps import shown_as, step_files, step_name
from stickslip.workflows.formats.templates import render
from stickslip.workflows.writers.writer import Ended, Job, Writer


class SeriesWriter(Writer):
    """Base of the writers of series: which steps are shown, and when the index is written.

    The index is written again once an eighth more steps are there: all of a long history together cost then no more
    than nine times the last writing, whatever the number of steps.
    """

    reader = "ParaView"

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        self._last: tuple[int, float] | None = None  # index and time [s] of the last step
        self.shown: list[tuple[int, float]] = []  # index and time [s] of the steps to show
        self._written = 0  # so many of them stand in the index

    @abstractmethod
    def write_index(self, steps: Sequence[tuple[int, float]]) -> None:
        """Write the index, or what can be written of it before a step is to be shown.

        Args:
            steps: index and time [s] of all steps to show.
        """

    def write_step(self, index: int) -> None:
        """Write the files that a step to be shown has of its own in this series, if any; its step's file is there."""
        return None

    def resume(self, steps: Sequence[StepResult]) -> None:
        """The index may list fewer steps, or one that has been taken away: the next step or the end writes it again.

        Where steps have files of their own, a subclass sees to these as well.
        """
        every = self.job.scene.output.every
        times = [(index, step.time) for index, step in enumerate(steps, start=1)]
        self._last = times[-1] if times else None
        there = step_files(self.job.folder)  # an earlier process may have stored the fields of fewer steps
        self.shown = [(index, time) for index, time in times if index % every == 0 and index in there]

    def step(self, index: int, result: StepResult) -> None:
        """Show it, at once or with those that follow; a viewer reads meanwhile."""
        self._last = index, result.time
        if index % self.job.scene.output.every == 0:
            self._show(self._last)
        if len(self.shown) >= max(1, 1.125 * self._written) or index == 1:
            self._write_index()

    def finish(self, ended: Ended) -> None:
        """Show every step that is to be shown, and the last one."""
        if self._last is not None and self._last not in self.shown[-1:]:
            self._show(self._last)
        self._write_index()

    def _show(self, step: tuple[int, float]) -> None:
        self.write_step(step[0])
        self.shown.append(step)

    def _write_index(self) -> None:
        self.write_index(self.shown)
        self._written = len(self.shown)


@dataclass(frozen=True)
class Field:
    """A field that is shown, and where it lies; `{step}` in the place stands for the step's file."""

    name: str
    kind: str  # Scalar, Vector or Tensor
    centre: str  # Node or Cell
    place: str
    number: str = "Float"
    bytes: int = 8


BODY_FIELDS = (
    Field("displacement", "Vector", "Node", "{step}:/displacement"),
    Field("von_mises", "Scalar", "Cell", "{step}:/von_mises"),
    Field("stress", "Tensor", "Cell", "{step}:/stress"),
    Field("body", "Scalar", "Cell", f"{MESH_FILE}:/mesh/body", "Int"),
)
ERROR = Field("stress_error", "Scalar", "Cell", "{step}:/stress_error")


class FieldFiles(SeriesWriter):
    """fields.h5, fields.xdmf and contact_NAME.xdmf."""

    files = ("fields.xdmf", "contact_*.xdmf")

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        self._checksum: str | None = None  # of the mesh in fields.h5, once it is known
        self._with_error = True  # whether all steps have theirs: a run may go on with estimates switched on or off

    def names(self) -> Sequence[str]:
        return [MESH_FILE, "fields.xdmf", *(f"contact_{name}.xdmf" for name in self.job.scene.pairs)]

    def resume(self, steps: Sequence[StepResult]) -> None:
        self._with_error = not any(np.isnan(step.mesh_error) for step in steps)
        super().resume(steps)

    def step(self, index: int, result: StepResult) -> None:
        self._with_error &= not np.isnan(result.mesh_error)
        super().step(index, result)

    def write_index(self, steps: Sequence[tuple[int, float]]) -> None:
        """Write them all; without a step only fields.h5: readers of XDMF refuse a series that has no time."""
        folder, mesh = self.job.folder, self.job.mesh
        make_folder(folder)
        stored = stored_checksum(folder / MESH_FILE)
        if stored is None or stored != self._checksum:
            arrays = mesh_arrays(mesh)
            self._checksum = checksum(arrays, {})
            if not is_whole(folder / MESH_FILE, self._checksum):
                write_arrays(folder / MESH_FILE, arrays, {})
        if not steps:
            return
        # a step without it would be shown with that of another one: VTK's reader keeps fields that it has read first
        fields = (*BODY_FIELDS, ERROR) if self._with_error else BODY_FIELDS
        _write(folder / "fields.xdmf", "mesh", "bodies", (mesh.points, mesh.cells, mesh.shape), fields, steps)
        for name, surface in mesh.surfaces.items():
            _write(
                folder / f"contact_{name}.xdmf",
                f"contacts/{name}",
                name,
                surface,
                contact_fields(name, self.job.scene.pairs[name]),
                steps,
            )


def contact_fields(name: str, pair: Contact | None = None) -> tuple[Field, ...]:
    """Fields at the nodes of a contact surface."""

    kinds = {"pressure": "Scalar", "traction": "Vector", "slip": "Vector", "slip_increment": "Vector", "gap": "Scalar"}
    place = f"{{step}}:/contacts/{name}/"
    kinds |= {"wear": "Scalar"} if pair is not None and pair.wear is not None else {}
    kinds |= {"rate": "Scalar"} if pair is not None and pair.friction is not None and pair.friction.timed else {}
    fields = (Field(shown_as(key), kind, "Node", place + key) for key, kind in (kinds | {"lam": "Vector"}).items())
    return (*fields, Field("status", "Scalar", "Node", f"{place}status", "Int", 1))


def _write(
    path: Path,
    place: str,
    name: str,
    surface: tuple[Array, Ints, str],
    fields: Sequence[Field],
    steps: Sequence[tuple[int, float]],
) -> None:
    """Write a temporal collection of a mesh that is stored in fields.h5 below `place`."""
    points, cells, shape = surface
    text = render(
        "writers/templates/series.xdmf",
        name=name,
        place=f"{MESH_FILE}:/{place}",
        shape=shape_of(shape, cells).xdmf,
        nodes=len(points),
        cells=cells.shape,
        fields=fields,
        steps=[(step_name(index), repr(float(time))) for index, time in steps],
    )
    write_aside(path, text.encode())
