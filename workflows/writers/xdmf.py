"""XDMF for ParaView: light XML that points at fields.h5 (mesh) and at the step files; nothing is stored twice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from solvers.step_result import Array, MeshData
from workflows.writers.aside import make_folder, write_aside
from workflows.writers.hdf5 import AnyArray, checksum, stored_checksum, write_arrays
from workflows.writers.shapes import Shape, shape_of
from workflows.writers.steps import step_name, three

MESH_FILE = "fields.h5"
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


class FieldFiles:
    """fields.h5, fields.xdmf and contact_NAME.xdmf of one mesh."""

    def __init__(self, folder: Path, mesh: MeshData) -> None:
        self._folder, self._mesh = folder, mesh
        self._checksum: str | None = None  # of the mesh in fields.h5, once it is known

    @property
    def checksum(self) -> str:
        """Of the mesh."""
        return checksum(_arrays(self._mesh), {})

    def write(self, steps: Sequence[tuple[int, float]]) -> None:
        """Write them; again after each step, while ParaView reads them.

        Args:
            steps: index and time [s] of the steps to show, all of them in their files. None: only fields.h5 is
                written, as an XDMF series without a time is refused by its readers.

        Raises:
            MachineError: the disk is full.
        """
        make_folder(self._folder)
        stored = stored_checksum(self._folder / MESH_FILE)
        if stored is None or stored != self._checksum:
            arrays = _arrays(self._mesh)
            self._checksum = checksum(arrays, {})
            if stored != self._checksum:
                write_arrays(self._folder / MESH_FILE, arrays, {})
        if not steps:
            return
        mesh = self._mesh
        body = _grid("mesh", "bodies", mesh.points, mesh.cells, mesh.shape)
        write_aside(self._folder / "fields.xdmf", _series(body, BODY_FIELDS, steps))
        for name, surface in mesh.surfaces.items():
            grid = _grid(f"contacts/{name}", name, *surface)
            write_aside(self._folder / f"contact_{name}.xdmf", _series(grid, contact_fields(name), steps))


def contact_fields(name: str) -> tuple[Field, ...]:
    """Fields at the nodes of a contact surface."""

    def field(key: str, kind: str, number: tuple[str, str] = FLOAT) -> Field:
        return Field(key, kind, "Node", f"{{step}}:/contacts/{name}/{key}", number)

    return (
        field("pressure", "Scalar"),
        field("traction", "Vector"),
        field("slip", "Vector"),
        field("slip_increment", "Vector"),
        field("gap", "Scalar"),
        field("lam", "Vector"),
        field("status", "Scalar", INT8),
    )


def _arrays(mesh: MeshData) -> dict[str, AnyArray]:
    """All that fields.h5 holds."""
    found: dict[str, AnyArray] = {"mesh/body": np.asarray(mesh.body, np.int64)}
    places = {"mesh": (mesh.points, mesh.cells, mesh.shape)}
    places |= {f"contacts/{name}": surface for name, surface in mesh.surfaces.items()}
    for place, (points, cells, shape) in places.items():
        found[f"{place}/points"] = three(points)
        found[f"{place}/cells"] = np.asarray(cells[:, shape_of(shape, cells).order], np.int64)
    return found


def _grid(place: str, name: str, points: Array, cells: NDArray[np.int64], shape: str) -> Grid:
    return Grid(name, place, len(points), len(cells), cells.shape[1], shape_of(shape, cells))


def _series(grid: Grid, fields: Sequence[Field], steps: Sequence[tuple[int, float]]) -> bytes:
    """The XML of a temporal collection."""
    root = ET.Element("Xdmf", Version="3.0")
    domain = ET.SubElement(root, "Domain")
    series = ET.SubElement(domain, "Grid", Name="time", GridType="Collection", CollectionType="Temporal")
    for index, time in steps:
        step = ET.SubElement(series, "Grid", Name=grid.name, GridType="Uniform")
        ET.SubElement(step, "Time", Value=repr(float(time)))
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
            size = (count,) if width == 1 else (count, width)
            _data(
                ET.SubElement(step, "Attribute", about), field.place.format(step=step_name(index)), size, field.number
            )
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True))


def _data(parent: Any, place: str, size: tuple[int, ...], number: tuple[str, str]) -> None:
    kind, precision = number
    about = {"Format": "HDF", "NumberType": kind, "Precision": precision, "Dimensions": " ".join(map(str, size))}
    ET.SubElement(parent, "DataItem", about).text = place
