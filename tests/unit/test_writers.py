"""Result files hold what was computed, read by readers that are not ours, and say so when they are damaged."""

from __future__ import annotations

import csv
import dataclasses
import errno
import os
from pathlib import Path
from typing import Any

import basix
import h5py
import meshio
import numpy as np
import pytest
import pyvista as pv
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkGenericCell

from geometry.errors import MachineError
from solvers.energy import Energy
from solvers.step_result import OPEN, SLIP, STICK, Array, ContactState, MeshData, StepResult
from workflows.writers.hdf5 import checksum
from workflows.writers.shapes import SHAPES
from workflows.writers.steps import read_step, write_step
from workflows.writers.tables import cut_tables, write_tables
from workflows.writers.xdmf import write_fields

FACET = {"triangle": "interval", "quadrilateral": "interval", "tetrahedron": "triangle", "hexahedron": "quadrilateral"}
SIZE = {"triangle": 1 / 2, "quadrilateral": 1, "tetrahedron": 1 / 6, "hexahedron": 1, "interval": 1}
MESHES = [(shape, order) for shape in FACET for order in (1, 2)]


def reference_nodes(shape: str, order: int) -> Array:
    """The nodes of dolfinx's reference cell, from basix: an answer that our tables do not know."""
    cell = getattr(basix.CellType, shape)
    return np.array(basix.create_element(basix.ElementFamily.P, cell, order, basix.LagrangeVariant.gll_warped).points)


def two_cells(shape: str, order: int) -> tuple[Array, NDArray[np.int64]]:
    """Two reference cells three metres apart."""
    nodes = reference_nodes(shape, order)
    shift = np.eye(nodes.shape[1])[0] * 3.0
    return np.vstack([nodes, nodes + shift]), np.arange(2 * len(nodes)).reshape(2, -1)


def mesh_of(shape: str, order: int = 1) -> MeshData:
    points, cells = two_cells(shape, order)
    on_surface, facets = two_cells(FACET[shape], order)
    flat = np.pad(on_surface, ((0, 0), (0, 1)))  # the plane y = 0 or z = 0
    return MeshData(
        points=points,
        cells=cells,
        shape=shape,
        body=np.array([0, 1]),
        bodies=("left", "right"),
        surfaces={"base": (flat, facets, FACET[shape])},
    )


def result_of(mesh: MeshData, time: float = 0.1 + 0.2, seed: int = 0) -> StepResult:
    """Numbers without a pattern, so that nothing can be mistaken for anything else."""
    random = np.random.default_rng(seed)
    d, n = mesh.points.shape[1], len(mesh.surfaces["base"][0])
    stress = random.normal(size=(len(mesh.cells), 3, 3))
    contact = ContactState(
        weight=random.random(n),
        gap=random.random(n),
        pressure=random.random(n),
        traction=random.normal(size=(n, d)),
        slip=random.normal(size=(n, d)),
        slip_increment=random.normal(size=(n, d)),
        lam=random.normal(size=(n, d)),
        status=np.resize(np.array([OPEN, SLIP, STICK], np.int8), n),
        force=np.zeros(d),
        moment=np.zeros(1 if d == 2 else 3),
        **dict.fromkeys(
            (
                *("normal_force", "tangential_force", "max_pressure", "contact_area", "stick_area", "slip_area"),
                *("max_penetration", "max_slip", "dissipation", "dissipation_total"),
            ),
            0.0,
        ),
    )
    return StepResult(
        time=time,
        substeps=1,
        iterations=2,
        volume_solves=3,
        residual=1e-9,
        displacement=random.normal(size=mesh.points.shape),
        stress=stress + stress.transpose(0, 2, 1),
        contacts={"base": contact},
        supports={},
        probes={"corner": (random.normal(size=d), stress[0] + stress[0].T)},
        energy=Energy(0.0, 0.0, 0.0, 0.0, np.zeros(1)),
        iteration_error=0.0,
        p=random.normal(size=n * d),
        w=random.normal(size=n * d),
        w_before=random.normal(size=n * d),
        p_ref=1.5,
        u_ref=1e-3 / 3,
        history=((time, 1, 0.1, 1, 0.5), (time, 2, 1e-9, 3, 0.1 + 0.7)),
    )


def padded(values: Array) -> Array:
    return np.pad(values, ((0, 0), (0, 3 - values.shape[1])))


# steps


@pytest.mark.parametrize("shape", ["triangle", "hexahedron"])
def test_a_step_reads_back_to_the_same_bits(tmp_path: Path, shape: str) -> None:
    mesh = mesh_of(shape)
    result = result_of(mesh)
    path = write_step(tmp_path, 12, result)
    assert path == tmp_path / "steps" / "000012.h5"
    stored = read_step(path)
    assert (stored.index, stored.time, stored.p_ref, stored.u_ref) == (12, result.time, result.p_ref, result.u_ref)
    assert_array_equal(stored.displacement, padded(result.displacement))
    for name in ("stress", "von_mises", "p", "w", "w_before"):
        assert_array_equal(getattr(stored, name), getattr(result, name))
    contact, found = result.contacts["base"], stored.contacts["base"]
    for name in ("weight", "gap", "pressure", "status"):
        assert_array_equal(getattr(found, name), getattr(contact, name))
    for name in ("traction", "slip", "slip_increment", "lam"):
        assert_array_equal(getattr(found, name), padded(getattr(contact, name)))
    assert found.status.dtype == np.int8
    assert sorted(p.name for p in path.parent.iterdir()) == ["000012.h5"]


def test_the_checksum_can_be_recomputed_by_others(tmp_path: Path) -> None:
    path = write_step(tmp_path, 3, result_of(mesh_of("triangle")))
    arrays: dict[str, Any] = {}
    with h5py.File(path, "r") as file:
        file.visititems(lambda name, item: arrays.update({name: item[()]} if isinstance(item, h5py.Dataset) else {}))
        assert file.attrs["checksum"] == checksum(
            arrays, {name: file.attrs[name].item() for name in ("index", "time", "p_ref", "u_ref")}
        )
        assert sorted(file) == ["contacts", "displacement", "state", "stress", "von_mises"]


def test_every_flipped_byte_is_refused(tmp_path: Path) -> None:
    # also in HDF5's own tables: given such a file, the HDF5 library has been seen to loop for ever
    path = write_step(tmp_path, 1, result_of(mesh_of("triangle")))
    whole = path.read_bytes()
    for place in range(0, len(whole), 3):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        with pytest.raises(MachineError, match=r"000001\.h5: damaged"):
            read_step(path)


def test_a_flipped_bit_in_the_numbers_is_refused(tmp_path: Path) -> None:
    result = result_of(mesh_of("triangle"))
    path = write_step(tmp_path, 1, result)
    whole = path.read_bytes()
    place = whole.index(result.p.tobytes()) + 6
    path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
    with pytest.raises(
        MachineError, match=r"000001\.h5: damaged or cut short: its content does not match its checksum"
    ):
        read_step(path)


@pytest.mark.parametrize("part", [0.0, 0.02, 0.5, 0.999])
def test_a_step_cut_short_is_refused(tmp_path: Path, part: float) -> None:
    path = write_step(tmp_path, 1, result_of(mesh_of("triangle")))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(MachineError, match=r"000001\.h5: damaged") as caught:
        read_step(path)
    assert "\n" not in str(caught.value)


def test_a_missing_step_and_a_foreign_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match="cannot be read: No such file"):
        read_step(tmp_path / "steps" / "000001.h5")
    foreign = tmp_path / "foreign.h5"
    with h5py.File(foreign, "w") as file:
        file["x"] = 1.0
    with pytest.raises(MachineError, match="not a file of stickslip"):
        read_step(foreign)
    write_fields(tmp_path, mesh_of("triangle"), [])
    with pytest.raises(MachineError, match=r"fields\.h5: not a step"):
        read_step(tmp_path / "fields.h5")


def test_a_full_disk_leaves_the_old_step_and_no_rubbish(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = mesh_of("triangle")
    path = write_step(tmp_path, 1, result_of(mesh))
    before = path.read_bytes()

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(MachineError, match="cannot be written: No space left on device"):
        write_step(tmp_path, 1, result_of(mesh, seed=1))
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == ["000001.h5"]


def test_a_file_in_the_way_of_the_folder_is_said(tmp_path: Path) -> None:
    (tmp_path / "steps").write_text("")
    with pytest.raises(MachineError, match="steps: cannot be written: File exists"):
        write_step(tmp_path, 1, result_of(mesh_of("triangle")))


# XDMF


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
    write_fields(folder, mesh, [(index, result.time) for index, result in enumerate(results, start=1)])
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
                assert_array_equal(at_nodes[name], padded(getattr(contact, name)))


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
        assert_array_equal(grid.point_data[name], padded(getattr(contact, name)))


def test_fields_are_rewritten_while_a_run_goes_on(tmp_path: Path) -> None:
    mesh = mesh_of("triangle")
    write_fields(tmp_path, mesh, [])
    assert [p.name for p in tmp_path.iterdir()] == ["fields.h5"]
    before = (tmp_path / "fields.h5").stat()
    for index in (1, 2, 3):
        write_step(tmp_path, index, result_of(mesh, float(index)))
        write_fields(tmp_path, mesh, [(k, float(k)) for k in range(1, index + 1)])
        with meshio.xdmf.TimeSeriesReader(tmp_path / "fields.xdmf") as reader:
            assert reader.num_steps == index
    assert (tmp_path / "fields.h5").stat().st_ino == before.st_ino  # the same mesh is not written again
    write_fields(tmp_path, mesh_of("quadrilateral"), [])
    assert (tmp_path / "fields.h5").stat().st_ino != before.st_ino


# tables


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("shape", ["quadrilateral", "tetrahedron"])
def test_tables_read_back_to_the_same_bits(tmp_path: Path, shape: str) -> None:
    mesh = mesh_of(shape)
    results = [result_of(mesh, time, seed) for seed, time in enumerate((1 / 3, 2 / 3))]
    for index, result in enumerate(results, start=1):
        write_tables(tmp_path, index, mesh, result)
    axes, n = "xyz"[: mesh.points.shape[1]], len(mesh.surfaces["base"][0])
    table = rows_of(tmp_path / "contact_base.csv")
    assert len(table) == 2 * n
    for k, result in enumerate(results):
        rows, contact = table[k * n : (k + 1) * n], result.contacts["base"]
        for name in ("weight", "gap", "pressure"):
            assert_array_equal([float(row[name]) for row in rows], getattr(contact, name))
        vectors = {"traction": "traction", "slip": "slip", "slip_increment": "slip_increment", "lambda": "lam"}
        for column, name in vectors.items():
            found = [[float(row[f"{column}_{a}"]) for a in axes] for row in rows]
            assert_array_equal(found, getattr(contact, name))
        assert_array_equal([[float(row[a]) for a in axes] for row in rows], mesh.surfaces["base"][0])
        assert {float(row["time"]) for row in rows} == {result.time}
        assert [row["status"] for row in rows][:3] == ["open", "slip", "stick"]
    probe = rows_of(tmp_path / "probes.csv")[1]
    displacement, stress = results[1].probes["corner"]
    assert (float(probe["time"]), probe["probe"]) == (results[1].time, "corner")
    assert_array_equal([float(probe[f"displacement_{a}"]) for a in axes], displacement)
    assert float(probe["stress_xy"]) == stress[0, 1]
    assert float(probe["stress_zz"]) == stress[2, 2]
    history = rows_of(tmp_path / "history.csv")
    assert [row["step"] for row in history] == ["1", "1", "2", "2"]
    assert history[3] == {
        "step": "2",
        "time": repr(2 / 3),
        "iteration": "2",
        "residual": "1e-09",
        "volume_solves": "3",
        "seconds": repr(0.1 + 0.7),
    }


def test_numbers_of_numpy_are_written_like_those_of_python(tmp_path: Path) -> None:
    mesh = mesh_of("triangle")
    counted: Any = ((np.float64(0.1), np.int64(2), np.float32(0.5), np.int64(3), 0.1),)
    write_tables(tmp_path, 1, mesh, dataclasses.replace(result_of(mesh), history=counted))
    assert (tmp_path / "history.csv").read_text().splitlines()[1] == "1,0.1,2,0.5,3,0.1"


def test_tables_are_cut_back_to_the_last_good_step(tmp_path: Path) -> None:
    mesh = mesh_of("triangle")
    names = ("contact_base.csv", "probes.csv", "history.csv")
    write_tables(tmp_path, 1, mesh, result_of(mesh, 1 / 3))
    before = {name: (tmp_path / name).read_bytes() for name in names}
    write_tables(tmp_path, 2, mesh, result_of(mesh, 2 / 3))
    for name in names:
        path = tmp_path / name
        path.write_bytes(path.read_bytes()[:-9])  # a crash in the middle of a row
    cut_tables(tmp_path, 1 / 3)
    assert {name: (tmp_path / name).read_bytes() for name in names} == before


def test_a_table_that_cannot_grow_is_said(tmp_path: Path) -> None:
    mesh = mesh_of("triangle")
    (tmp_path / "contact_base.csv").mkdir()
    with pytest.raises(MachineError, match=r"contact_base\.csv: cannot be written: Is a directory"):
        write_tables(tmp_path, 1, mesh, result_of(mesh))
