"""What a run goes on from is plain data that comes back to the same bits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, make_dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from shared.histories import SMALL
from shared.synthetic import mesh_of, result_of
from stickslip.geometry.errors import MachineError
from stickslip.solvers.parallel.serialise import deserialise, serialise
from stickslip.solvers.simulation.checkpoint import APART, FOR_RESULTS, ROWS, Checkpoints
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.solvers.stepping.state import State
from stickslip.workflows.formats.marker import mark
from stickslip.workflows.formats.serialised import BYTES, TEXT, from_arrays, to_arrays
from stickslip.workflows.formats.steps import read_checkpoint, write_step
from stickslip.workflows.run.resume import LearntFiles, is_kept
from stickslip.workflows.scene_file.read import read


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
    simulation = prepare(read("block", [*SMALL, "solver.method=condensed-newton"]))
    next(simulation.steps())
    return simulation


def test_every_field_of_the_state_is_put_back(marched: Simulation) -> None:
    accepted = marched.reported
    assert accepted is not None
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
    state, _ = Checkpoints(other.stepper).put_back(stored, None)
    assert state.refined is not None
    assert state.refined.surplus is not None
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
