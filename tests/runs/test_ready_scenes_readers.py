"""The fields of every ready scene, read by readers that are not ours."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import pyvista
from numpy.testing import assert_allclose

from shared.measures import bend, measures
from shared.solved import ROUNDING, Solved


def assert_shows_the_probes(solved: Solved, index: int, points: Any, displacement: Any) -> None:
    """At the mesh node where a probe lies, the field is what the probe says; the probes lie on corners."""
    for name, probe in solved.scene.probes.items():
        distance = np.linalg.norm(points[:, : solved.scene.dim] - np.array(probe.point), axis=1)
        assert distance.min() <= ROUNDING
        expected = solved.result["steps"][index]["probes"][name]["displacement"]
        scale = np.abs(displacement).max()
        found = displacement[distance <= ROUNDING, : solved.scene.dim]  # bodies that touch have a node each there
        assert np.abs(found - expected).max(axis=1).min() <= ROUNDING * scale


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # meshio's own
def test_meshio_reads_the_fields(solved: Solved, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(solved.folder)  # meshio looks for the HDF5 file where it stands itself
    with meshio.xdmf.TimeSeriesReader("fields.xdmf") as reader:
        points, cells = reader.read_points_cells()
        assert reader.num_steps == len(solved.result["steps"])
        for index, step in enumerate(solved.result["steps"]):
            time, at_points, at_cells = reader.read_data(index)
            assert time == step["time"]
            assert_shows_the_probes(solved, index, points, at_points["displacement"])
            assert len(at_cells["von_mises"][0]) == sum(len(block.data) for block in cells)
            assert at_cells["stress"][0].shape[-1] == 9


def shown(path: Path) -> Iterator[tuple[float, Any]]:
    """Times and grids, as VTK reads them."""
    reader: Any = pyvista.get_reader(str(path))  # type: ignore[no-untyped-call]
    for time in reader.time_values:
        reader.set_active_time_value(time)
        grid = reader.read()
        yield time, grid[0] if isinstance(grid, pyvista.MultiBlock) else grid


def test_vtk_reads_the_fields(solved: Solved) -> None:
    shape, dim = solved.scene.geometry, solved.scene.dim
    size = sum(measures(shape, dim)[body] for body in shape.bodies(dim))
    measure = ("Area", "Volume")[dim - 2]
    straight = bend(shape) ** 2 / 6  # VTK cuts curved cells into straight ones
    times = []
    for index, (time, grid) in enumerate(shown(solved.folder / "fields.xdmf")):
        times.append(time)
        assert_shows_the_probes(solved, index, np.array(grid.points), np.array(grid.point_data["displacement"]))
        cells = grid.compute_cell_sizes().cell_data[measure]
        assert_allclose(cells.sum(), size, rtol=1e-6 + straight)  # single precision, in case VTK turns to it
    assert times == [step["time"] for step in solved.result["steps"]]


def test_vtk_reads_the_contact_surface(solved: Solved) -> None:
    for name in solved.scene.contacts:
        for time, surface in shown(solved.folder / f"contact_{name}.xdmf"):
            points, data = solved.points(name, time), surface.point_data
            assert (np.array(data["pressure"]) == points["pressure"]).all()
            assert_allclose(np.array(data["slip"])[:, : solved.scene.dim], points["slip"], rtol=ROUNDING)
            words = np.array(["open", "slip", "stick"])[np.array(data["status"]).astype(int)]
            assert (words == points["status"]).all()
