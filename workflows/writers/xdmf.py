"""XDMF for ParaView: light XML that points at fields.h5 (mesh) and at the step files; nothing is stored twice."""

from __future__ import annotations

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
from stickslip.workflows.formats.steps import shown_as, step_name
from stickslip.workflows.writers.series import SeriesWriter
from stickslip.workflows.writers.writer import Job

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


@dataclass(frozen=True)
class Field:
    """What is shown and where it lies; `{step}` in the place stands for the step's file."""

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
