"""Clocks, memory that is given back, and options of PETSc belong to one simulation."""

import logging
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from petsc4py import PETSc

from shared.cases import slow
from shared.cells import Cell
from shared.ranks import mpirun
from stickslip.geometry.errors import SceneError
from stickslip.geometry.user_files.child_process import child_environment
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.parallel.counters import PHASES, Clock, Counters, Row
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.stepper import StepError
from stickslip.workflows.commands import _sweep
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.run.terminal import SAID, Reporter
from stickslip.workflows.scene_file.read import read
from stickslip.workflows.sweep.sweep import Member, Solved, Sweep


class Hands:
    """A time and a number of volume solves that a test moves."""

    def __init__(self) -> None:
        self.time, self.solves = 100.0, 7

    def pass_on(self, seconds: float, solves: int = 0) -> None:
        self.time, self.solves = self.time + seconds, self.solves + solves

    def clock(self) -> Clock:
        return Clock(lambda: self.solves, lambda: self.time)


def spent(clock: Clock) -> dict[tuple[str, str], tuple[float, int, int]]:
    return {(row.phase, row.part): (row.seconds, row.calls, row.volume_solves) for row in clock.rows()}


def test_a_phase_within_another_one_counts_once() -> None:
    hands = Hands()
    clock = hands.clock()
    hands.pass_on(1.0)
    with clock.phase("iterate"):
        hands.pass_on(2.0, 3)
        with clock.phase("error"):
            hands.pass_on(4.0, 5)
            with clock.part("stress"):
                hands.pass_on(8.0)
        hands.pass_on(16.0, 1)
    assert spent(clock) == {
        ("iterate", ""): (18.0, 1, 4),
        ("error", ""): (4.0, 1, 5),
        ("error", "stress"): (8.0, 1, 0),
        ("other", ""): (1.0, 0, 0),
    }
    assert clock.seconds("error") == 12.0


def test_a_phase_that_fails_has_its_seconds_and_gives_the_clock_back() -> None:
    hands = Hands()
    clock = hands.clock()
    try:
        with clock.phase("iterate"):
            hands.pass_on(2.0)
            raise ArithmeticError
    except ArithmeticError:
        hands.pass_on(3.0)
    assert spent(clock) == {("iterate", ""): (2.0, 1, 0), ("other", ""): (3.0, 0, 0)}


def test_rows_are_true_within_a_phase() -> None:
    hands = Hands()
    clock = hands.clock()
    with clock.phase("output"):
        hands.pass_on(2.0)
        assert clock.seconds("output") == 2.0
        hands.pass_on(2.0)
    assert clock.seconds("output") == 4.0


def test_what_an_earlier_process_spent_is_added() -> None:
    hands = Hands()
    clock = hands.clock()
    with clock.phase("mesh"):
        hands.pass_on(1.0)
    clock.add([Row(phase=name, part="", seconds=2.0, calls=3, volume_solves=4) for name in ("mesh", "audit")])
    assert spent(clock) == {("mesh", ""): (3.0, 4, 4), ("audit", ""): (2.0, 3, 4), ("other", ""): (0.0, 0, 0)}


def test_solves_of_an_earlier_process_belong_to_no_phase_of_this_one() -> None:
    counters = Counters()
    with counters.clock.phase("prepare"):
        counters.add(Counters(volume_solves=5, error_solves=6))
        counters.volume_solves += 1
    assert [row.volume_solves for row in counters.clock.rows() if row.phase == "prepare"] == [1]


def test_solves_for_errors_count_in_their_phase() -> None:
    counters = Counters()
    with counters.clock.phase("error"), counters.for_error():
        counters.volume_solves += 2
    assert (counters.volume_solves, counters.error_solves) == (0, 2)
    assert [row.volume_solves for row in counters.clock.rows() if row.phase == "error"] == [2]


RUNS = """
import gc
import weakref

from mpi4py import MPI

import stickslip
from stickslip.solvers.parallel.released import destroy_released


def solved(name, *overrides):
    simulation = stickslip.prepare(stickslip.read(name, overrides))
    for step in simulation.steps(lambda row, held=simulation: None):
        assert step.contacts
    return weakref.ref(simulation.mesh)


for name in ("block", "cube"):  # modules that are imported leave reference cycles of their own
    solved(name, "{COARSE}")
gc.collect()
gc.disable()
for words in {words}:
    assert solved(*words)() is None, words
    destroy_released(MPI.COMM_WORLD)
"""
COARSE = "geometry.mesh_size=0.5"
FORMS = [("cube", COARSE, f'solver.surface="{form}"') for form in ("condensed", "matrix-free")]


def left(words: list[tuple[str, ...]]) -> str:
    """What PETSc says at the end of a process of the objects that were not destroyed."""
    environment = {**child_environment(), "PETSC_OPTIONS": "-objects_dump"}
    script = RUNS.format(words=words, COARSE=COARSE)
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("first", [0, *slow(1, 2)])
def test_every_method_and_both_forms_of_the_bodies_give_their_memory_back(first: int) -> None:
    methods = [("cube", COARSE, "output.error=false", f'solver.method="{name}"') for name in [*METHODS][first::3]]
    spheres = ("spheres", COARSE, "geometry.contact_mesh_size=0.2")
    assert left([*methods, *FORMS, spheres, ("block", "geometry.order=2")]) == ""


@pytest.mark.slow  # one rank does it above
def test_ranks_give_their_memory_back(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(RUNS.format(words=FORMS, COARSE=COARSE), encoding="utf-8")
    done = mpirun(2, ["-objects_dump"], tmp_path, (str(script),))
    assert (done.returncode, done.stdout.strip()) == (0, ""), done.stderr


ENDS = """
import sys
import time

from petsc4py import PETSc

import stickslip.solvers.parallel.released


def end():
    kept = PETSc.Vec().createMPI(2, comm=PETSc.COMM_WORLD)  # by this frame, until PETSc has ended
    vector = PETSc.Vec().createMPI(2, comm=PETSc.COMM_WORLD)
    shown = vector.array_r
    if kept.comm.rank:
        del vector, shown  # destroyed here
    else:
        del shown, vector  # marked here: PETSc waits for the other rank
    sys.exit(3)


end()
"""


def test_ranks_end_that_have_released_a_vector_in_different_ways(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(ENDS, encoding="utf-8")
    assert mpirun(2, [], tmp_path, (str(script),)).returncode == 3


CG = "-fieldsplit_u_ksp_type cg -fieldsplit_u_pc_type gamg"
SCHUR = (
    "-ksp_type fgmres -pc_type fieldsplit -pc_fieldsplit_type schur -pc_fieldsplit_schur_precondition selfp "
    "-fieldsplit_u_ksp_type preonly -fieldsplit_u_pc_type cholesky "
    "-fieldsplit_lambda_ksp_type gmres -fieldsplit_lambda_pc_type lu"
)


PLAIN = Cell("block-uzawa")


def scene(options: str = "", tolerance: float = 1e-9, cell: Cell = PLAIN, **keys: Any) -> Scene:
    made = cell.scene(tolerance)
    return replace(made, solver=replace(made.solver, petsc_options=options, **keys))


def solved(made: Scene) -> tuple[Simulation, list[StepResult]]:
    simulation = prepare(made)
    return simulation, list(simulation.steps())


@pytest.mark.parametrize("options", [*slow("-fieldsplit_u_pc_type gamg"), "-fieldsplit_u_pc_type jacobi"])
def test_a_preconditioner_alone_is_used_inside_conjugate_gradients(options: str) -> None:
    """As if it were a solver, each solve would be one cycle of it, and the answer wrong by tens of per cents."""
    (simulation, found), (_, expected) = solved(scene(options)), solved(scene())
    assert simulation.counters.linear_iterations > simulation.counters.volume_solves
    assert_allclose(found[-1].p, expected[-1].p, atol=1e-6 * np.abs(expected[-1].p).max())


def test_a_preconditioner_alone_is_used_inside_gmres_on_the_nest() -> None:
    found, expected = solved(scene(SCHUR.removeprefix("-ksp_type fgmres "), outer="ksp"))[1], solved(scene())[1]
    assert_allclose(found[-1].p, expected[-1].p, atol=1e-6 * np.abs(expected[-1].p).max())


def test_options_belong_to_the_simulation_that_they_were_given_to() -> None:
    """Also where another one is prepared in between."""
    first = prepare(scene(CG))
    second = prepare(scene())
    list(first.steps())
    list(second.steps())
    assert first.counters.linear_iterations > 0
    assert second.counters.linear_iterations == 0
    assert not [name for name in PETSc.Options().getAll() if name.startswith("block_")]


def test_options_of_a_sliding_contact_are_not_called_unused(caplog: pytest.LogCaptureFixture) -> None:
    """Each search makes new blocks, with the solver of the bodies as it was."""
    with caplog.at_level(logging.WARNING):
        solved(scene(CG + " -foo", cell=Cell("block-uzawa", more="sliding")))
    assert [record.getMessage() for record in caplog.records] == [
        "solver.petsc_options: PETSc does not use -foo with outer = uzawa"
    ]


def test_an_inner_solver_that_is_not_exact_states_its_error() -> None:
    def stated(options: str, **keys: Any) -> float:
        return max(step.linear_error for step in solved(scene(options, 1e-6, **keys))[1])

    assert stated("") == stated("", outer="ksp") == 0.0
    loose = f"{CG} -fieldsplit_u_ksp_rtol"
    assert 1e-13 < stated(f"{loose} 1e-8") < 1e-6
    assert stated(f"{loose} 1e-12") < 1e-3 * stated(f"{loose} 1e-8")
    rough = SCHUR.replace("preonly -fieldsplit_u_pc_type cholesky", "cg -fieldsplit_u_pc_type gamg")
    assert 1e-14 < stated(f"{rough} -fieldsplit_u_ksp_rtol 1e-5 -ksp_rtol 1e-8", outer="ksp") < 1e-5


def test_a_ksp_that_does_not_converge_is_named_as_such(caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(StepError), caplog.at_level(logging.WARNING):
        solved(scene(f"{SCHUR} -ksp_max_it 1 -fieldsplit_lambda_pc_type none", outer="ksp"))
    assert "fgmres with fieldsplit ended with DIVERGED" in caplog.records[0].getMessage()


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"petsc_options": "fieldsplit"}, "petsc_options = fieldsplit: is not an option; write for example"),
        ({"petsc_options": '-a "b'}, "No closing quotation"),
        ({"petsc_options": "-fieldsplit_u_pc_type nonsense"}, "PETSc refuses it"),
        ({"petsc_options": "-ksp_type nonsense", "outer": "ksp"}, "PETSc refuses it"),
        ({"outer": "ksp", "alpha": 1.0}, 'solver.alpha = 1.0: .* use outer = "uzawa"'),
        ({"outer": "ksp", "rates": True}, 'solver.rates = True: .* use outer = "uzawa"'),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line_before_anything_is_solved(keys: dict[str, Any], words: str) -> None:
    made = Cell("block-uzawa").scene(1e-8)
    with pytest.raises(SceneError, match=words) as refused:
        make_plan(replace(made, solver=replace(made.solver, **keys)))
    assert "\n" not in str(refused.value)


def test_a_long_phase_is_spoken_of_while_it_lasts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("stickslip.workflows.run.terminal.ANNOUNCED", 0.05)
    clock = Clock()
    with Reporter(quiet=False, verbose=False) as reporter:
        clock.on_phase = reporter.watch().on_phase
        with clock.phase("output", "pictures"):
            time.sleep(0.4)
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "meshing and preparing ..."
    assert 2 <= len(said[1:]) <= 4  # each when it has lasted twice as long
    assert all(line.startswith("drawing: ") and line.endswith(" s so far") for line in said[1:])


def test_what_is_done_in_many_short_parts_is_spoken_of_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("stickslip.workflows.run.terminal.ANNOUNCED", 0.1)
    clock = Clock()
    with Reporter(quiet=False, verbose=False) as reporter:
        clock.on_phase = reporter.watch().on_phase
        with clock.phase("output", "results"):
            pass
        with clock.phase("iterate"):
            for _ in range(40):
                with clock.part("tangent"):
                    time.sleep(0.01)
    said = [line for line in capsys.readouterr().err.splitlines() if "so far" in line]
    assert said
    assert all(line.startswith("solving: ") for line in said)


def test_every_phase_says_what_it_does() -> None:
    assert {*SAID} == {*PHASES} - {"imports", "other"}  # these are none that begins by itself


def test_each_round_counts_its_own_steps() -> None:
    simulation = prepare(read("block", ["geometry.mesh_size=1.0", "geometry.contact_mesh_size=1.0"]))
    with Reporter(quiet=True, verbose=False) as reporter:
        watch = reporter.watch()
        for _ in range(2):
            watch.on_prepared(simulation)
            for step in simulation.steps():
                watch.on_step(step)
            assert (reporter.done, reporter.progress.tasks[0].completed) == (2, 2)


def test_what_is_counted_tells_how_long_it_will_go_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("stickslip.workflows.run.terminal.ANNOUNCED", 0.05)
    hands = [0.0]
    clock = Clock(now=lambda: hands[0])
    with Reporter(quiet=False, verbose=False) as reporter:
        clock.on_phase = reporter.watch().on_phase
        with clock.phase("audit"):
            for number in clock.counted(range(3)):
                hands[0] += 100.0
                time.sleep(0.4 * (number == 1))
    said = [line for line in capsys.readouterr().err.splitlines() if "so far" in line]
    assert said[0].startswith("auditing: ")
    assert said[0].endswith(" s so far, about 7 minutes left")  # 200 s for one of three
    assert clock.left is None


def test_each_step_that_is_solved_tells_how_long_the_others_take() -> None:
    simulation = prepare(read("block", ["geometry.mesh_size=0.5", "steps.count=3"]))
    left = [simulation.clock.left for _ in simulation.steps()]
    assert left[0] is None
    assert all(left[1:])
    assert simulation.clock.left is None


def test_members_of_a_sweep_tell_how_long_the_others_take(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    scene, hands = read("block"), [0.0]
    member = Member("mu_1", {}, scene)

    def solved(*given: Any) -> Sweep:
        for number, seconds in enumerate((None, 200.0, 200.0), 1):  # one was solved before
            hands[0] += seconds or 0.0
            given[4](number, 5, Solved(member, tmp_path, "converged", "", seconds))
        return Sweep((), tmp_path)

    monkeypatch.setattr(_sweep, "monotonic", lambda: hands[0])
    monkeypatch.setattr(_sweep, "sweep", solved)
    monkeypatch.setattr(_sweep, "_print", lambda *given: None)
    assert _sweep.sweep_scene(scene, [], tmp_path, tmp_path, 1, False) == 0
    said = capsys.readouterr()
    lines = [line for line in (said.out + said.err).splitlines() if "/5" in line]
    assert [line.partition(", about ")[2] for line in lines] == ["", "10 minutes left", "7 minutes left"]
