"""`stickslip.load` gives back what `steps` has yielded; contact states show themselves."""

import dataclasses
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import stickslip as s
from shared.histories import SMALL, Stop
from shared.synthetic import MESHES, mesh_of, result_of
from stickslip.workflows.formats.csv_tables import read_table
from stickslip.workflows.formats.mesh_file import mesh_arrays, mesh_from

QUIET = [*SMALL, "output.pictures=false", "output.error=false"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a run of the ready scene `block`."""
    place = tmp_path_factory.mktemp("load") / "out"
    s.run(s.read("block", QUIET), place)
    return place


def assert_same(one: Any, other: Any) -> None:
    """Every field of two dataclasses, to the bits; ± and iterations, which hold seconds, apart."""
    for field in dataclasses.fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if dataclasses.is_dataclass(a):
            assert_same(a, b)
        elif field.name not in ("history", "contacts", "errors", "corrected", "convergence"):
            np.testing.assert_equal(a, b, field.name)


def test_what_is_loaded_is_what_was_solved(folder: Path) -> None:
    scene = s.read("block", QUIET)
    simulation, loaded = s.prepare(scene), s.load(folder)
    assert (loaded.status, loaded.times) == ("converged", scene.requested_times())
    assert len(loaded.steps) == len(loaded.times)
    assert dataclasses.replace(simulation.data, gaps={}).bodies == loaded.mesh.bodies
    for name in ("points", "cells", "body"):
        assert_array_equal(getattr(loaded.mesh, name), getattr(simulation.data, name))
    for solved, read in zip(simulation.steps(), loaded.steps, strict=True):
        assert_same(solved, read)
        assert_same(solved.contacts["base"], read.contacts["base"])
    assert_array_equal(loaded.columns["time"], loaded.times)
    assert loaded.columns["base.normal_force"][-1] == loaded.steps[-1].contacts["base"].normal_force
    assert [step.time for step in loaded.steps[1:]] == list(loaded.times[1:])


@pytest.mark.parametrize(("shape", "order"), MESHES)
def test_a_mesh_comes_back_as_it_was(shape: str, order: int) -> None:
    mesh = mesh_of(shape, order)
    again = mesh_from(mesh_arrays(mesh), mesh.points.shape[1])
    assert (again.shape, again.bodies) == (mesh.shape, mesh.bodies)
    for name in ("points", "cells", "body"):
        assert_array_equal(getattr(again, name), getattr(mesh, name))
    for one, other in zip(again.surfaces["base"], mesh.surfaces["base"], strict=True):
        assert_array_equal(one, other)


def test_a_run_that_was_stopped_can_be_loaded(tmp_path: Path) -> None:
    s.run(s.read("block", [*QUIET, "steps.count=4"]), tmp_path / "out", s.Watch(on_step=Stop(2)))
    loaded = s.load(tmp_path / "out")
    assert loaded.status == "interrupted"
    assert [step.time for step in loaded.steps] == list(loaded.times) == [0.5, 1.0]


def test_what_no_run_has_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(s.FolderError, match="holds no results of a run"):
        s.load(tmp_path)
    with pytest.raises(s.FolderError, match="no such folder"):
        s.load(tmp_path / "nowhere")


def test_a_mesh_of_an_earlier_version_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def older(*arguments: object) -> None:
        raise KeyError("mesh/bodies")

    monkeypatch.setattr("stickslip.workflows.run.stored_results.mesh_from", older)
    with pytest.raises(s.FolderError, match=r"fields\.h5: of an earlier version, without 'mesh/bodies'; run it again"):
        _ = s.load(folder).mesh


def test_the_columns_of_a_contact_are_those_of_its_table(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=lambda columns: ("a table of", columns)))
    loaded = s.load(folder)
    header, rows = read_table(folder / "contact_base.csv")
    for step in loaded.steps:
        kind, columns = step.contacts["base"].to_pandas()
        assert (kind, header) == ("a table of", ["time", *columns, "arc"])
        own = [row for row in rows if float(row[0]) == step.time]
        for name, cells in zip(columns, list(zip(*own, strict=True))[1:-1], strict=True):
            assert_array_equal(columns[name], np.array(cells, columns[name].dtype), err_msg=name)
        along = sorted((float(row[-1]), float(row[1])) for row in own)  # of the base, by x
        assert [arc for arc, _ in along] == pytest.approx([x for _, x in along])
    assert loaded.to_pandas() == ("a table of", loaded.columns)
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pip install pandas"):
        loaded.to_pandas()


def test_results_show_themselves_in_a_line_and_as_a_table(folder: Path) -> None:
    loaded = s.load(folder)
    base = loaded.steps[-1].contacts["base"]
    counts = base.counts()
    assert sum(counts.values()) == len(base.points)
    assert repr(base).startswith(f"ContactState({len(base.points)} nodes: {counts['open']} open, ")
    for shown in (base, loaded.steps[-1], loaded, loaded.mesh):
        assert len(repr(shown)) < 300
    for table in (base, loaded.steps[-1], loaded):
        assert f"<td>normal_force</td><td>{base.normal_force:.6g}</td>" in table._repr_html_()


def test_a_body_has_its_largest_values() -> None:
    """Against the fields themselves."""
    for step in s.steps(s.read("two_blocks", ["geometry.mesh_size=0.5", "geometry.lower_mesh_size=0.5"])):
        found = step.bodies
        assert max(body.max_von_mises for body in found.values()) == step.von_mises.max()
        largest = np.linalg.norm(step.displacement, axis=1).max()
        assert max(body.max_displacement for body in found.values()) == pytest.approx(largest, rel=1e-15)
        assert set(found) == {"lower", "upper"}
        break


def test_random_numbers_show_themselves_too() -> None:
    assert "nodes" in repr(result_of(mesh_of("triangle")))


def test_a_script_hears_warnings_of_a_run_and_no_more(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Even if a library has made the root's logger speak; run.log has all lines."""
    scene = s.read("block", [*QUIET, "steps.count=1"])
    with caplog.at_level("WARNING"):
        s.run(scene, tmp_path / "out")
    assert not [record for record in caplog.records if record.levelname == "INFO"]
    assert "iteration 0" in (tmp_path / "out" / "run.log").read_text()
    with caplog.at_level("INFO"):
        s.run(scene, tmp_path / "out")
    assert "iteration 0" in caplog.text
