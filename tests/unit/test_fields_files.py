"""Fields and contact surfaces, read by readers that are not ours."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import pyvista as pv
from numpy.testing import assert_allclose, assert_array_equal
from vtkmodules.vtkCommonDataModel import vtkGenericCell

from shared.synthetic import FACET, MESHES, SIZE, job_of, mesh_of, padded, reference_nodes, result_of
from stickslip.solvers.results.step_result import MeshData, StepResult
from stickslip.workflows.formats.mesh_file import SHAPES
from stickslip.workflows.formats.steps import shown_as, write_step
from stickslip.workflows.writers.writer import Ended
from stickslip.workflows.writers.xdmf import FieldFiles

ENDED = Ended(status="converged", steps=[])


@pytest.mark.parametrize(("name", "nodes"), SHAPES)
def test_nodes_are_renumbered_as_vtk_numbers_its_cells(name: str, nodes: int) -> None:
    order = next(k for k in (1, 2) if len(reference_nodes(name, k)) == nodes)
    shape = SHAPES[name, nodes]
    cell = vtkGenericCell.InstantiateCell(shape.vtk)
    expected = np.array([cell.GetParametricCoords()[i] for i in range(3 * nodes)]).reshape(-1, 3)
    assert_allclose(padded(reference_nodes(name, order)[list(shape.order)]), expected, atol=1e-12)


def written(folder: Path, shape: str, order: int) -> tuple[MeshData, list[StepResult]]:
    mesh = mesh_of(shape, order)
    results = [result_of(mesh, time, seed) for seed, time in enumerate((0.5, 1.0))]
    for index, result in enumerate(results, start=1):
        write_step(folder, index, result)
    FieldFiles(job_of(folder, mesh)).write_index(
        [(index, result.time) for index, result in enumerate(results, start=1)]
    )
    return mesh, results


@pytest.mark.parametrize(("shape", "order"), MESHES)
def test_meshio_reads_fields_and_contacts(tmp_path: Path, shape: str, order: int) -> None:
    mesh, results = written(tmp_path, shape, order)
    with meshio.xdmf.TimeSeriesReader(tmp_path / "fields.xdmf") as reader:
        points, cells = reader.read_points_cells()
        assert_array_equal(points, padded(mesh.points))
        assert_array_equal(np.sort(cells[0].data, axis=1), mesh.cells)
        assert reader.num_steps == 2
        for k, result in enumerate(results):
            time, at_nodes, at_cells = reader.read_data(k)
            assert time == result.time
            assert_array_equal(at_nodes["displacement"], padded(result.displacement))
            assert_array_equal(at_cells["stress"][0], result.stress.reshape(-1, 9))
            assert_array_equal(at_cells["von_mises"][0], result.von_mises)
            assert_array_equal(at_cells["body"][0], mesh.body)
    with meshio.xdmf.TimeSeriesReader(tmp_path / "contact_base.xdmf") as reader:
        points, _ = reader.read_points_cells()
        assert_array_equal(points, padded(mesh.surfaces["base"][0]))
        for k, result in enumerate(results):
            _, at_nodes, _ = reader.read_data(k)
            contact = result.contacts["base"]
            for name in ("pressure", "gap", "status"):
                assert_array_equal(at_nodes[name], getattr(contact, name))
            for name in ("traction", "slip", "slip_increment", "lam"):
                assert_array_equal(at_nodes[shown_as(name)], padded(getattr(contact, name)))


def vtk_grid(path: Path, time: float) -> Any:
    """Through VTK's own XDMF reader, as ParaView does."""
    reader: Any = pv.get_reader(path)  # type: ignore[no-untyped-call]
    assert_array_equal(reader.time_values, [0.5, 1.0])
    reader.set_active_time_value(time)
    found = reader.read()
    return found[0] if isinstance(found, pv.MultiBlock) else found


@pytest.mark.parametrize(("shape", "order"), MESHES)
def test_vtk_reads_fields_and_its_cells_are_whole(tmp_path: Path, shape: str, order: int) -> None:
    mesh, results = written(tmp_path, shape, order)
    for result in results:
        grid = vtk_grid(tmp_path / "fields.xdmf", result.time)
        assert_array_equal(grid.points, padded(mesh.points))
        assert_array_equal(grid.point_data["displacement"], padded(result.displacement))
        assert_array_equal(grid.cell_data["stress"].reshape(-1, 3, 3), result.stress)
        assert_array_equal(grid.cell_data["von_mises"], result.von_mises)
        assert_array_equal(grid.cell_data["body"], mesh.body)
        expected = SHAPES[shape, mesh.cells.shape[1]]
        assert_array_equal(grid.celltypes, expected.vtk)
        assert_array_equal(grid.cell_connectivity.reshape(2, -1), mesh.cells[:, expected.order])
        sizes = grid.compute_cell_sizes()  # volumes of VTK are signed
        size = sizes["Volume" if mesh.points.shape[1] == 3 else "Area"]
        assert_allclose(size, SIZE[shape], rtol=1e-12)


@pytest.mark.parametrize("shape", FACET)
def test_linear_cells_are_not_twisted(tmp_path: Path, shape: str) -> None:
    written(tmp_path, shape, 1)
    grid = vtk_grid(tmp_path / "fields.xdmf", 1.0)
    # a quadrilateral or hexahedron in tensor order crosses itself: its scaled Jacobian is not positive
    assert grid.cell_quality("scaled_jacobian")["scaled_jacobian"].min() > 0.5


@pytest.mark.parametrize(("shape", "order"), MESHES)
def test_vtk_reads_a_contact_surface(tmp_path: Path, shape: str, order: int) -> None:
    mesh, results = written(tmp_path, shape, order)
    points, facets, facet = mesh.surfaces["base"]
    contact = results[1].contacts["base"]
    grid = vtk_grid(tmp_path / "contact_base.xdmf", 1.0)
    assert_array_equal(grid.points, padded(points))
    assert_array_equal(grid.cell_connectivity.reshape(2, -1), facets[:, SHAPES[facet, facets.shape[1]].order])
    sizes = grid.compute_cell_sizes()
    assert_allclose(sizes["Length" if facet == "interval" else "Area"], SIZE[facet], rtol=1e-12)
    for name in ("pressure", "gap", "status"):
        assert_array_equal(grid.point_data[name], getattr(contact, name))
    for name in ("traction", "slip", "slip_increment", "lam"):
        assert_array_equal(grid.point_data[shown_as(name)], padded(getattr(contact, name)))


def test_fields_are_rewritten_while_a_run_goes_on(tmp_path: Path) -> None:
    mesh = mesh_of("triangle")
    FieldFiles(job_of(tmp_path, mesh)).write_index([])
    assert [p.name for p in tmp_path.iterdir()] == ["fields.h5"]
    before = (tmp_path / "fields.h5").stat()
    for index in (1, 2, 3):
        write_step(tmp_path, index, result_of(mesh, float(index)))
        FieldFiles(job_of(tmp_path, mesh)).write_index([(k, float(k)) for k in range(1, index + 1)])
        with meshio.xdmf.TimeSeriesReader(tmp_path / "fields.xdmf") as reader:
            assert reader.num_steps == index
    assert (tmp_path / "fields.h5").stat().st_ino == before.st_ino  # the same mesh is not written again
    files = FieldFiles(job_of(tmp_path, mesh))
    for _ in range(2):
        files.write_index([])
        assert (tmp_path / "fields.h5").stat().st_ino == before.st_ino
    FieldFiles(job_of(tmp_path, mesh_of("quadrilateral"))).write_index([])
    assert (tmp_path / "fields.h5").stat().st_ino != before.st_ino
    files.write_index([])  # what it has written once is not what stands there now
    assert (tmp_path / "fields.h5").stat().st_size == before.st_size


def test_a_long_history_is_written_again_rarely_and_read_whole(tmp_path: Path) -> None:
    """A thousand steps: 8 writings up to step 8, then one for each eighth more, ln(125) / ln(1.125) = 41."""
    mesh = mesh_of("triangle")
    write_step(tmp_path, 1, result_of(mesh, 1.0))
    write_step(tmp_path, 1000, result_of(mesh, 1000.0, seed=1))
    files, writings, before = FieldFiles(job_of(tmp_path, mesh)), 0, 0
    for index in range(1, 1001):
        files.step(index, result_of(mesh, float(index)))
        now = (tmp_path / "fields.xdmf").stat().st_ino
        writings, before = writings + (now != before), now
    assert writings <= 8 + 41 + 1
    with meshio.xdmf.TimeSeriesReader(tmp_path / "fields.xdmf") as reader:
        assert 1000 / 1.125 <= reader.num_steps <= 1000  # killed here it shows all but the last few
    files.finish(ENDED)
    with meshio.xdmf.TimeSeriesReader(tmp_path / "fields.xdmf") as reader:
        reader.read_points_cells()
        assert reader.num_steps == 1000
        for index, seed in ((1, 0), (1000, 1)):
            time, at_nodes, _ = reader.read_data(index - 1)
            assert time == index
            assert_array_equal(at_nodes["displacement"], padded(result_of(mesh, seed=seed).displacement))
    reader_of_vtk: Any = pv.get_reader(tmp_path / "fields.xdmf")  # type: ignore[no-untyped-call]
    assert_array_equal(reader_of_vtk.time_values, np.arange(1.0, 1001.0))
    size = (tmp_path / "fields.h5").stat().st_size
    assert size < 20_000  # the mesh stands there once


def test_a_resumed_run_shows_no_step_that_was_taken_away(tmp_path: Path) -> None:
    mesh, times = mesh_of("triangle"), list(range(1, 21))
    for index in times:
        write_step(tmp_path, index, result_of(mesh, float(index)))
    FieldFiles(job_of(tmp_path, mesh)).write_index([(index, float(index)) for index in times])
    resumed = FieldFiles(job_of(tmp_path, mesh))  # the last four were damaged, and one of them is solved again
    resumed.resume([result_of(mesh, float(index)) for index in times[:16]])
    resumed.step(17, result_of(mesh, 17.5))
    reader: Any = pv.get_reader(tmp_path / "fields.xdmf")  # type: ignore[no-untyped-call]
    assert_array_equal(reader.time_values, [*times[:16], 17.5])


@pytest.mark.parametrize("lacking", [0, 1, None])
def test_errors_are_shown_where_every_step_has_them(lacking: int | None, tmp_path: Path) -> None:
    """A run may go on with the estimate switched on, or off; VTK shows the first step's error with a step without."""
    mesh = mesh_of("triangle")
    steps = [replace(result_of(mesh, time), stress_error=np.full(2, time)) for time in (0.5, 1.0)]
    if lacking is not None:
        steps[lacking] = replace(steps[lacking], mesh_error=np.nan, stress_error=np.zeros(0))
    for index, step in enumerate(steps, start=1):
        write_step(tmp_path, index, step)
        files = FieldFiles(job_of(tmp_path, mesh))
        files.resume([step.without_fields() for step in steps[: index - 1]])
        files.step(index, step)
        files.finish(ENDED)
    assert ("stress_error" in (tmp_path / "fields.xdmf").read_text()) == (lacking is None)
    for step in steps:
        shown = vtk_grid(tmp_path / "fields.xdmf", step.time).cell_data
        assert_array_equal(shown["von_mises"], step.von_mises)
        if lacking is None:
            assert_array_equal(shown["stress_error"], step.stress_error)


@pytest.mark.parametrize(
    ("every", "count", "shown"), [(1, 3, [1, 2, 3]), (2, 5, [2, 4, 5]), (2, 4, [2, 4]), (9, 2, [2])]
)
def test_every_nth_step_is_shown_and_the_last(tmp_path: Path, every: int, count: int, shown: list[int]) -> None:
    files = FieldFiles(job_of(tmp_path, mesh_of("triangle"), every=every))
    for index in range(1, count + 1):
        result = result_of(mesh_of("triangle"), float(index))
        write_step(tmp_path, index, result)
        files.step(index, result)
    files.finish(ENDED)
    files.finish(ENDED)
    for name in ("fields.xdmf", "contact_base.xdmf"):
        reader: Any = pv.get_reader(tmp_path / name)  # type: ignore[no-untyped-call]
        assert_array_equal(reader.time_values, shown)
