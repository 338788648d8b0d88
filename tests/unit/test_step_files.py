"""Files of steps and checkpoints come back bit for bit; damage is said."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, make_dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

import stickslip as s
from shared.disks import make_full
from shared.histories import SMALL, Stop
from shared.problems import followed
from shared.synthetic import MESHES, job_of, mesh_of, padded, result_of
from stickslip.geometry.errors import MachineError
from stickslip.solvers.accuracy.two_level import MeshCorrection
from stickslip.solvers.parallel.serialise import deserialise, serialise
from stickslip.solvers.simulation.checkpoint import APART, FOR_RESULTS, ROWS, Checkpoints
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.solvers.stepping.state import State
from stickslip.workflows.formats.csv_tables import read_table
from stickslip.workflows.formats.hdf5 import checksum
from stickslip.workflows.formats.marker import mark
from stickslip.workflows.formats.mesh_file import mesh_arrays, mesh_from
from stickslip.workflows.formats.serialised import BYTES, TEXT, from_arrays, to_arrays
from stickslip.workflows.formats.steps import read_checkpoint, read_step, write_step
from stickslip.workflows.run.resume import LearntFiles, is_kept
from stickslip.workflows.scene_file.read import read
from stickslip.workflows.writers.xdmf import FieldFiles


@pytest.mark.parametrize("shape", ["triangle", "hexahedron"])
def test_a_step_reads_back_to_the_same_bits(tmp_path: Path, shape: str) -> None:
    mesh = mesh_of(shape)
    result = result_of(mesh)
    path = write_step(tmp_path, 12, result)
    assert path == tmp_path / "steps" / "000012.h5"
    stored = read_step(path)
    assert (stored.index, stored.time, stored.p_ref, stored.u_ref) == (12, result.time, result.p_ref, result.u_ref)
    assert_array_equal(stored.displacement, padded(result.displacement))
    for name in ("stress", "von_mises", "p", "w", "reference", "driven"):
        assert_array_equal(getattr(stored, name), getattr(result, name))
    contact, found = result.contacts["base"], stored.contacts["base"]
    for name in ("weight", "gap", "pressure", "status"):
        assert_array_equal(getattr(found, name), getattr(contact, name))
    for name in ("traction", "slip", "slip_increment", "lam"):
        assert_array_equal(getattr(found, name), padded(getattr(contact, name)))
    assert found.status.dtype == np.int8
    assert sorted(p.name for p in path.parent.iterdir()) == ["000012.h5"]


def test_a_step_without_its_fields_keeps_all_else_and_none_of_their_memory() -> None:
    result = result_of(mesh_of("hexahedron"))
    left = result.without_fields()
    for name in vars(result):
        if name in ("displacement", "stress", "stress_error"):
            assert getattr(left, name).size == 0
            assert getattr(left, name).base is None  # no view of the whole
        else:
            assert getattr(left, name) is getattr(result, name)


def test_the_checksum_can_be_recomputed_by_others(tmp_path: Path) -> None:
    path = write_step(tmp_path, 3, result_of(mesh_of("triangle")))
    arrays: dict[str, Any] = {}
    with h5py.File(path, "r") as file:
        file.visititems(lambda name, item: arrays.update({name: item[()]} if isinstance(item, h5py.Dataset) else {}))
        assert file.attrs["checksum"] == checksum(
            arrays, {name: file.attrs[name].item() for name in ("index", "time", "p_ref", "u_ref")}
        )
        fields = "contacts displacement state stress stress_error von_mises"
        assert sorted(file) == ["checkpoint", *fields.split()]


def test_every_flipped_byte_is_refused(tmp_path: Path) -> None:
    # also in HDF5's own tables: given such a file, the HDF5 library has been seen to loop for ever
    path = write_step(tmp_path, 1, result_of(mesh_of("triangle")))
    whole = path.read_bytes()
    for place in range(0, len(whole), 7):
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
    FieldFiles(job_of(tmp_path, mesh_of("triangle"))).write_index([])
    with pytest.raises(MachineError, match=r"fields\.h5: not a step"):
        read_step(tmp_path / "fields.h5")


def test_a_full_disk_leaves_the_old_step_and_no_rubbish(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = mesh_of("triangle")
    path = write_step(tmp_path, 1, result_of(mesh))
    before = path.read_bytes()

    make_full(monkeypatch)
    with pytest.raises(MachineError, match="cannot be written: No space left on device"):
        write_step(tmp_path, 1, result_of(mesh, seed=1))
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == ["000001.h5"]


def test_a_file_in_the_way_of_the_folder_is_said(tmp_path: Path) -> None:
    (tmp_path / "steps").write_text("")
    with pytest.raises(MachineError, match="steps: cannot be written: File exists"):
        write_step(tmp_path, 1, result_of(mesh_of("triangle")))


# XDMF


@dataclass(frozen=True)
class Inner:
    size: float = np.inf
    count: int = 0


@dataclass(frozen=True)
class Outer:
    name: str
    arrays: Mapping[str, NDArray[np.float64]]
    pairs: tuple[tuple[float, int, str], ...]
    mixed: tuple[NDArray[np.float64], Inner]
    here: Inner | None = None
    there: Inner | None = None
    made: int = field(init=False, default=3)


def through_files(plain: Any, known: dict[str, Any] | None = None) -> Any:
    arrays = to_arrays(plain, known or {})
    return from_arrays(arrays[TEXT], arrays[BYTES], known or {})


def test_dataclasses_come_back_to_the_same_bits() -> None:
    numbers = np.array([0.1, -0.0, np.nan, np.inf, 5e-324])
    value = Outer(
        "ä", {"a": numbers, "b": np.eye(3)[:, ::2]}, ((0.1, 2, "x"),), (numbers[:0], Inner()), here=Inner(0.3, 7)
    )
    again: Outer = deserialise(Outer, through_files(serialise(value)))
    assert again.arrays["a"].tobytes() == numbers.tobytes()
    assert_array_equal(again.arrays["b"], value.arrays["b"])
    assert (again.name, again.pairs, again.here, again.there, again.mixed[1]) == (
        "ä",
        ((0.1, 2, "x"),),
        Inner(0.3, 7),
        None,
        Inner(),
    )
    assert isinstance(again.pairs[0], tuple)
    assert again.mixed[0].shape == (0,)


class Named(NamedTuple):
    force: NDArray[np.float64]
    inner: Inner


def test_named_tuples_are_stored_as_lists_and_come_back_by_name() -> None:
    plain = serialise({"top": Named(np.ones(2), Inner(0.3, 7))})
    assert isinstance(plain["top"], list)
    again = deserialise(Mapping[str, Named], through_files(plain))["top"]
    assert isinstance(again, Named)
    assert again.inner == Inner(0.3, 7)
    assert_array_equal(again[0], again.force)
    with pytest.raises(KeyError, match="Named has 2 fields, not 1"):
        deserialise(Named, plain["top"][:1])


def test_the_order_in_memory_comes_back_for_sums_depend_on_it() -> None:
    values = np.random.default_rng(1).normal(size=(7, 5))
    for order in ("C", "F"):
        array = np.array(values, order=order)
        again = through_files({"x": array})["x"]
        assert again.flags.c_contiguous == array.flags.c_contiguous
        assert_array_equal(again, array)


def test_equal_arrays_are_stored_once_and_known_ones_not_at_all() -> None:
    values = np.random.default_rng(1).normal(size=100)
    plain = {"x": values, "y": values.copy().reshape(10, 10), "z": values.reshape(10, 10).T}
    twice = to_arrays(plain, {})
    assert twice[BYTES].nbytes == values.nbytes
    for name, array in from_arrays(twice[TEXT], twice[BYTES], {}).items():
        assert_array_equal(array, plain[name])
    known = {"beside": values.reshape(50, 2)}
    again = through_files({"x": values}, known)
    assert to_arrays({"x": values}, known)[BYTES].nbytes == 0
    assert_array_equal(again["x"], values)


@pytest.mark.parametrize("value", [object(), {"a": [1, {2}]}, b"bytes"])
def test_what_plain_data_cannot_say_is_refused(value: Any) -> None:
    with pytest.raises(TypeError, match="no plain data"):
        serialise(value)


def test_results_come_back_whole(tmp_path: Path) -> None:
    result = result_of(mesh_of("triangle"))
    again, going = read_checkpoint(write_step(tmp_path, 1, result, {"so far": 3}))
    assert going == {"so far": 3}
    for f in fields(result):
        if f.name not in ("contacts", "energy"):
            np.testing.assert_equal(getattr(again, f.name), getattr(result, f.name))
    np.testing.assert_equal(vars(again.contacts["base"]), vars(result.contacts["base"]))
    np.testing.assert_equal(vars(again.energy), vars(result.energy))


def test_a_step_of_another_version_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_step(tmp_path, 1, result_of(mesh_of("triangle")))
    with_more = make_dataclass("StepResult", [("news", float)])
    monkeypatch.setattr("stickslip.solvers.results.step_result.StepResult", with_more)
    with pytest.raises(MachineError, match=r"000001\.h5: not a step of this version"):
        read_checkpoint(path)


def test_learnt_is_kept_for_two_steps_and_written_when_it_is_new(tmp_path: Path) -> None:
    mark(tmp_path)
    files, said = LearntFiles(tmp_path, MPI.COMM_SELF), []
    for index, value in enumerate((1.0, 2.0, 2.0, 3.0), start=1):
        said.append(files.write(index, {"x": np.array([value])}))
        files.forget()
    assert [reference.partition(" ")[0] for reference in said] == ["000001", "000002", "000002", "000004"]
    assert sorted(p.name for p in (tmp_path / "learnt").iterdir()) == ["000002.0.bin", "000004.0.bin"]

    def read(reference: str) -> Any:
        assert is_kept(tmp_path, reference) == (LearntFiles(tmp_path, MPI.COMM_SELF, "", reference).read() is not None)
        return LearntFiles(tmp_path, MPI.COMM_SELF, "", reference).read()

    assert read(said[3])["x"] == 3.0
    assert read(said[0]) is None  # removed
    assert read(said[3].replace(" ", " 0")) is None  # of another time
    assert LearntFiles(tmp_path, MPI.COMM_SELF, "", f"{said[3]} {said[3].split()[1]}").read() is None  # of two ranks


@pytest.mark.parametrize("place", [3, 200, -1])
def test_learnt_that_is_damaged_is_lost(place: int, tmp_path: Path) -> None:
    values = np.random.default_rng(1).normal(size=(30, 4))
    reference = LearntFiles(tmp_path, MPI.COMM_SELF).write(1, {"x": values, "y": values[:, :2].T, "z": values[:0]})
    again = LearntFiles(tmp_path, MPI.COMM_SELF, "", reference)
    assert_array_equal(again.read()["y"], values[:, :2].T)
    (path,) = (tmp_path / "learnt").iterdir()
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)
    assert again.read() is None
    path.write_bytes(path.read_bytes()[:-8])
    assert not is_kept(tmp_path, reference)


@pytest.fixture(scope="module")
def marched() -> Simulation:
    """A scene after its first step."""
    simulation = followed(read("block", [*SMALL, "solver.method=condensed-newton"]))
    next(simulation.steps())
    return simulation


def test_every_field_of_the_state_is_put_back(marched: Simulation) -> None:
    accepted = marched.reported
    checkpoint = Checkpoints(marched.stepper).take(accepted)
    assert accepted.state.refined is not None
    stored = replace(
        checkpoint,
        state=through_files(checkpoint.state),
        refined=through_files(checkpoint.refined),
        surplus=through_files(checkpoint.surplus),
    )
    assert set(stored.state) == {f.name for f in fields(State)} - {ROWS, *FOR_RESULTS, *APART}
    other = prepare(marched.scene, reached=stored.reached)
    other.stepper.companion = MeshCorrection(other.stepper)
    state, _ = Checkpoints(other.stepper).put_back(stored, None)
    assert state.refined.surplus.norm() > 0
    for before, after in ((accepted.state, state), (accepted.state.refined, state.refined)):
        for f in fields(State):
            old, new = getattr(before, f.name), getattr(after, f.name)
            if f.name == ROWS:
                assert [c.name for c in new] == [c.name for c in old]
            elif hasattr(old, "array"):
                assert_array_equal(new.array, old.array)
            elif f.name not in ("refined", *FOR_RESULTS):
                np.testing.assert_equal(serialise(new), serialise(old))
    assert other.counters.volume_solves == marched.counters.volume_solves
    assert other.counters.factorisations == 2  # of two processes


def test_what_was_learnt_on_other_ranks_is_left_out(marched: Simulation) -> None:
    checkpoints = Checkpoints(marched.stepper)
    accepted = marched.reported
    assert accepted is not None
    learnt = checkpoints.learnt()
    other = prepare(marched.scene)
    for layout, used in ((learnt["layout"], True), ("2 ranks", False)):
        _, usable = Checkpoints(other.stepper).put_back(checkpoints.take(accepted), {**learnt, "layout": layout})
        assert usable == used


QUIET = [*SMALL, "output.pictures=false", "output.error=false"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a run of the ready scene `block`."""
    place = tmp_path_factory.mktemp("load") / "out"
    s.run(s.read("block", QUIET), place)
    return place


def assert_same(one: Any, other: Any) -> None:
    """Every field of two dataclasses, to the bits; ± and iterations, which hold seconds, apart."""
    for name in (f.name for f in dataclasses.fields(one)):
        a, b = getattr(one, name), getattr(other, name)
        if dataclasses.is_dataclass(a):
            assert_same(a, b)
        elif name not in ("history", "contacts", "errors", "corrected", "convergence"):
            np.testing.assert_equal(a, b, name)


def test_what_is_loaded_is_what_was_solved(folder: Path) -> None:
    scene = s.read("block", QUIET)
    simulation, loaded = s.prepare(scene), s.load(folder)
    assert (loaded.status, loaded.times) == ("converged", scene.requested_times())
    assert len(loaded.steps) == len(loaded.times)
    assert dataclasses.replace(simulation.data, gaps={}).bodies == loaded.mesh.bodies
    for name in ("points", "cells", "body"):
        assert_array_equal(getattr(loaded.mesh, name), getattr(simulation.data, name))
    for solved, step in zip(simulation.steps(), loaded.steps, strict=True):
        assert_same(solved, step)
        assert_same(solved.contacts["base"], step.contacts["base"])
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


def test_a_run_without_a_step_has_no_columns(tmp_path: Path) -> None:
    s.run(s.read("block", [*QUIET, "solver.max_iterations=1"]), tmp_path / "out")
    loaded = s.load(tmp_path / "out")
    assert (loaded.status, loaded.times, len(loaded.steps), loaded.columns) == ("not_converged", (), 0, {})
    assert "0 steps" in loaded._repr_html_()


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
    header, cells = read_table(folder / "contact_base.csv")
    rows = list(cells)
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
        said = f"{base.normal_force:.6g}" if table is not loaded else f"{base.normal_force:.5g} ± ?"
        assert f"<td>normal_force</td><td>{said}</td>" in table._repr_html_()


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
