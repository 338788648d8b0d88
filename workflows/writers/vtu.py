"""fields.pvd and the folder vtu/: each step complete, one block for each body and each contact, for readers of VTK.

XDMF stores nothing twice, but needs a reader of HDF5. Here a step can be taken alone, vtu/000012.vtm or one of its
blocks, vtu/000012_body_NAME.vtu and vtu/000012_contact_NAME.vtu; each file holds its part of the mesh. All blocks have
the displacement, so that they warp together. paraview_view.py beside them shows the usual picture in ParaView.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from stickslip.geometry.arrays import AnyArray, Array, Ints
from stickslip.geometry.errors import MachineError
from stickslip.geometry.keys import Key
from stickslip.solvers.results.step_result import StepResult, von_mises
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.formats.files import disk_errors, make_folder, write_aside
from stickslip.workflows.formats.marker import OF_STEP
from stickslip.workflows.formats.mesh_file import shape_of
from stickslip.workflows.formats.steps import StoredStep, read_step, shown_as, step_name, three
from stickslip.workflows.formats.templates import render
from stickslip.workflows.writers import paraview_view
from stickslip.workflows.writers.writer import Keys, keys_of
from stickslip.workflows.writers.xdmf import SeriesWriter

INDEX, FOLDER = "fields.pvd", "vtu"
VIEW = Path(paraview_view.__file__)  # copied as it is


@dataclass(frozen=True, kw_only=True)
class VtuKeys(Keys):
    """Whether they are written."""

    vtu: Annotated[bool, Key("-", "write fields.pvd for ParaView: a VTK file for each step, body and contact")] = False


@dataclass(frozen=True)
class Block:
    """A part of the mesh."""

    points: Array  # (n, 3) [m]
    cells: Ints  # (c, k) in VTK's order of nodes
    cell_type: int  # of VTK
    nodes: Ints | slice  # of the mesh or surface, of which these are the points
    members: AnyArray | slice  # of the mesh or surface, which cells these are

    def content(self, at_nodes: Mapping[str, AnyArray], at_cells: Mapping[str, AnyArray]) -> bytes:
        """The block as a file, with its part of these fields."""
        from vtkmodules.util import numpy_support
        from vtkmodules.vtkCommonCore import vtkPoints
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkUnstructuredGrid
        from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

        library: Any = numpy_support  # comes without types

        def array(values: AnyArray) -> Any:
            return library.numpy_to_vtk(np.ascontiguousarray(values), deep=True)

        def indices(values: Ints) -> Any:
            return library.numpy_to_vtkIdTypeArray(np.ascontiguousarray(values, dtype=np.int64), deep=True)

        grid, points, cells = vtkUnstructuredGrid(), vtkPoints(), vtkCellArray()
        points.SetData(array(self.points))
        grid.SetPoints(points)
        count, width = self.cells.shape
        cells.SetData(indices(np.arange(0, (count + 1) * width, width)), indices(self.cells.ravel()))
        grid.SetCells(self.cell_type, cells)
        parts = ((grid.GetPointData(), at_nodes, self.nodes), (grid.GetCellData(), at_cells, self.members))
        for data, named, part in parts:
            for name, values in named.items():
                field = array(values[part])
                field.SetName(name)
                data.AddArray(field)
        writer = vtkXMLUnstructuredGridWriter()
        writer.SetInputData(grid)
        writer.SetDataModeToBinary()
        writer.SetHeaderTypeToUInt64()
        writer.SetWriteToOutputString(True)
        if not writer.Write():
            raise MachineError("VTK cannot write an unstructured grid")
        return str(writer.GetOutputString()).encode()


class VtuFiles(SeriesWriter):
    """A time series of multiblock data sets, with the blocks `bodies` and `contacts`."""

    keys = VtuKeys
    files = (INDEX, VIEW.name)

    @classmethod
    def wanted(cls, scene: Scene) -> bool:
        return keys_of(VtuKeys, scene.output).vtu

    def names(self) -> Sequence[str]:
        return [*self.files, f"{FOLDER}/"]

    def resume(self, steps: Sequence[StepResult]) -> None:
        """Write what is missing, also where this output was not asked for before; then remove what is surplus."""
        super().resume(steps)
        folder = self.job.folder / FOLDER
        for index, _ in self.shown:
            if not (folder / f"{index:06d}.vtm").exists():  # it is the last of a step's files to be written
                self.write_step(index)
        self.write_index(self.shown)
        numbers = {f"{index:06d}" for index, _ in self.shown}
        with disk_errors(folder):
            for path in folder.glob("*.vt[mu]"):
                if OF_STEP.fullmatch(path.name) and path.name[:6] not in numbers:
                    path.unlink()

    def write_step(self, index: int) -> None:
        """The step's blocks, then the file that names them."""
        step, folder = read_step(self.job.folder / step_name(index)), self.job.folder / FOLDER
        make_folder(folder)
        groups: dict[str, dict[str, str]] = {"bodies": {}, "contacts": {}}
        parts = zip(groups.values(), ("body", "contact"), (self._bodies(step), self._contacts(step)), strict=True)
        for files, word, blocks in parts:
            for name, content in blocks:
                files[name] = f"{index:06d}_{word}_{name}.vtu"
                write_aside(folder / files[name], content)
        write_aside(folder / f"{index:06d}.vtm", render("writers/templates/blocks.vtm", groups=groups).encode())

    def write_index(self, steps: Sequence[tuple[int, float]]) -> None:
        """The file that names the steps, and the one that shows them; none without a step."""
        path, view = self.job.folder / INDEX, self.job.folder / VIEW.name
        if not steps:
            with disk_errors(path):
                for file in (path, view):
                    file.unlink(missing_ok=True)
            return
        if not view.exists():
            write_aside(view, VIEW.read_bytes())
        listed = [(repr(float(time)), f"{FOLDER}/{index:06d}.vtm") for index, time in steps]
        write_aside(path, render("writers/templates/series.pvd", steps=listed).encode())

    def _bodies(self, step: StoredStep) -> Iterator[tuple[str, bytes]]:
        """Name and file of each; nodes and cells in the order of the mesh."""
        mesh = self.job.mesh
        shape = shape_of(mesh.shape, mesh.cells)
        at_cells = {"stress": step.stress.reshape(-1, 9), "von_mises": step.von_mises}
        if len(step.stress_error):
            at_cells["stress_error"] = step.stress_error
        for number, name in enumerate(mesh.bodies):
            own = mesh.body == number
            nodes, local = np.unique(mesh.cells[own], return_inverse=True)
            cells = local.reshape(-1, mesh.cells.shape[1])[:, shape.order]
            block = Block(three(mesh.points[nodes]), cells, shape.vtk, nodes, own)
            stress = means_at_nodes(mesh.cells[own], step.stress[own], len(mesh.points))
            smooth = {"nodal_stress": stress.reshape(-1, 9), "nodal_von_mises": von_mises(stress)}
            yield name, block.content({"displacement": step.displacement, **smooth}, at_cells)

    def _contacts(self, step: StoredStep) -> Iterator[tuple[str, bytes]]:
        """Name and file of each; nodes and facets in the order of the surface."""
        for name, (points, facets, kind) in self.job.mesh.surfaces.items():
            shape, contact = shape_of(kind, facets), step.contacts[name]
            block = Block(three(points), facets[:, shape.order], shape.vtk, slice(None), slice(None))
            found = {shown_as(field.name): getattr(contact, field.name) for field in fields(contact)}
            at_nodes = {key: values for key, values in found.items() if values is not None}
            yield name, block.content(at_nodes | {"displacement": step.displacement[self.job.mesh.slaves[name]]}, {})


def means_at_nodes(cells: Ints, values: Array, count: int) -> Array:
    """Mean at each of `count` nodes of the values (c, 3, 3) of its cells (c, k); NaN at nodes of no cell.

    >>> means_at_nodes(np.array([[0, 1], [1, 2]]), np.array([2.0, 4.0])[:, None, None] * np.eye(3), 4)[:, 0, 0]
    array([ 2.,  3.,  4., nan])
    """
    at, width = cells.ravel(), cells.shape[1]
    sums = [np.bincount(at, np.repeat(part, width), count) for part in values.reshape(len(cells), 9).T]
    with np.errstate(invalid="ignore"):
        return np.asarray((np.array(sums) / np.bincount(at, minlength=count)).T.reshape(count, 3, 3))
