"""Time series for ParaView, and XDMF: light XML that points at fields.h5 (mesh) and at the step files; nothing twice.

Of a series every n-th step and the last one are shown, listed in an index that is written anew as it grows.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET  # it writes only

import numpy as np

from stickslip.geometry.arrays import Array, Ints
from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.formats.files import make_folder, write_aside
from stickslip.workflows.formats.hdf5 import checksum, stored_checksum, write_arrays
from stickslip.workflows.formats.mesh_file import MESH_FILE, Shape, mesh_arrays, shape_of
from stickslip.workflows.formats.steps import shown_as, step_files, step_name
from stickslip.workflows.writers.writer import Ended, Job, Writer

GROWTH = 1.125  # the index is written again once so many times the steps are there
HEAD = """<?xml version='1.0' encoding='utf-8'?>
<Xdmf Version="3.0">
  <Domain>
    <Grid Name="time" GridType="Collection" CollectionType="Temporal">
"""
TAIL = """    </Grid>
  </Domain>
</Xdmf>
"""
FLOAT, INT64, INT8 = ("Float", "8"), ("Int", "8"), ("Int", "1")
WIDTH = {"Scalar": 1, "Vector": 3, "Tensor": 9}


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
        if len(self.shown) >= max(1, GROWTH * self._written) or index == 1:
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
    number: tuple[str, str] = FLOAT


@dataclass(frozen=True)
class Grid:
    """A mesh stored in fields.h5 below `place`."""

    name: str
    place: str
    nodes: int
    cells: int
    width: int  # nodes a cell
    shape: Shape


BODY_FIELDS = (
    Field("displacement", "Vector", "Node", "{step}:/displacement"),
    Field("von_mises", "Scalar", "Cell", "{step}:/von_mises"),
    Field("stress", "Tensor", "Cell", "{step}:/stress"),
    Field("body", "Scalar", "Cell", f"{MESH_FILE}:/mesh/body", INT64),
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
        return [MESH_FILE, "fields.xdmf", *(f"contact_{name}.xdmf" for name in self.job.scene.contacts)]

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
            if stored != self._checksum:
                write_arrays(folder / MESH_FILE, arrays, {})
        if not steps:
            return
        # a step without it would be shown with that of another one: VTK's reader keeps fields that it has read first
        fields = (*BODY_FIELDS, ERROR) if self._with_error else BODY_FIELDS
        body = _grid("mesh", "bodies", mesh.points, mesh.cells, mesh.shape)
        write_aside(folder / "fields.xdmf", _series(body, fields, steps))
        for name, surface in mesh.surfaces.items():
            grid = _grid(f"contacts/{name}", name, *surface)
            write_aside(folder / f"contact_{name}.xdmf", _series(grid, contact_fields(name), steps))


def contact_fields(name: str) -> tuple[Field, ...]:
    """Fields at the nodes of a contact surface."""

    def field(key: str, kind: str, number: tuple[str, str] = FLOAT) -> Field:
        return Field(shown_as(key), kind, "Node", f"{{step}}:/contacts/{name}/{key}", number)

    return (
        field("pressure", "Scalar"),
        field("traction", "Vector"),
        field("slip", "Vector"),
        field("slip_increment", "Vector"),
        field("gap", "Scalar"),
        field("lam", "Vector"),
        field("status", "Scalar", INT8),
    )


def _grid(place: str, name: str, points: Array, cells: Ints, shape: str) -> Grid:
    return Grid(name, place, len(points), len(cells), cells.shape[1], shape_of(shape, cells))


def _series(grid: Grid, fields: Sequence[Field], steps: Sequence[tuple[int, float]]) -> bytes:
    """The XML of a temporal collection; a step's text is made once and then repeated."""
    any_step = _any_step(grid, fields)
    ET.indent(any_step, level=3)
    text = f"      {ET.tostring(any_step, encoding='unicode')}\n"
    shown = [text.replace("{step}", step_name(index)).replace("{time}", repr(float(time))) for index, time in steps]
    return "".join([HEAD, *shown, TAIL]).encode()


def _any_step(grid: Grid, fields: Sequence[Field]) -> ET.Element:
    """One step, of `{step}` and `{time}`."""
    step = ET.Element("Grid", Name=grid.name, GridType="Uniform")
    ET.SubElement(step, "Time", Value="{time}")
    cells = {"TopologyType": grid.shape.xdmf, "NumberOfElements": str(grid.cells)}
    if grid.shape.xdmf == "Polyline":
        cells["NodesPerElement"] = str(grid.width)
    topology = ET.SubElement(step, "Topology", cells)
    _data(topology, f"{MESH_FILE}:/{grid.place}/cells", (grid.cells, grid.width), INT64)
    geometry = ET.SubElement(step, "Geometry", GeometryType="XYZ")
    _data(geometry, f"{MESH_FILE}:/{grid.place}/points", (grid.nodes, 3), FLOAT)
    for field in fields:
        about = {"Name": field.name, "AttributeType": field.kind, "Center": field.centre}
        count, width = grid.nodes if field.centre == "Node" else grid.cells, WIDTH[field.kind]
        _data(
            ET.SubElement(step, "Attribute", about),
            field.place,
            (count,) if width == 1 else (count, width),
            field.number,
        )
    return step


def _data(parent: Any, place: str, size: tuple[int, ...], number: tuple[str, str]) -> None:
    kind, precision = number
    about = {"Format": "HDF", "NumberType": kind, "Precision": precision, "Dimensions": " ".join(map(str, size))}
    ET.SubElement(parent, "DataItem", about).text = place
