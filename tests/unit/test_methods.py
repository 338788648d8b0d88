"""A method is one file; a chain of methods hands a step on when one of them fails."""

import os
import pickle
import shutil
import subprocess
import sys
from dataclasses import fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import stickslip
import stickslip.solvers
from shared.problems import scene_of
from stickslip.geometry.errors import MachineError, SceneError, SolverError
from stickslip.solvers.interface.coarse_mesh import CoarseMesh
from stickslip.solvers.iteration import Solution, Status
from stickslip.solvers.linear.conjugate_gradients import MOST_ITERATIONS
from stickslip.solvers.method_registry import METHODS, Solver, method_of
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.methods.method import Ready, keys_of
from stickslip.solvers.methods.surface_uzawa import PATIENCE, LearningIteration
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene import settings
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.choice import Size, Stage, chain, chosen
from stickslip.solvers.stepping.method_chain import MethodChain
from stickslip.solvers.stepping.stepper import StepError
from stickslip.workflows.lab.benchmarks.auto import BARS, Case
from stickslip.workflows.lab.verification.prepared import prepare, system_of
from stickslip.workflows.run.audit import Audited
from stickslip.workflows.run.result import Outcome, summary
from stickslip.workflows.scene_file.read import read, to_dict

ROOT = Path(stickslip.solvers.__file__).parents[2]
NEW = '''
"""Halving: a method that a test adds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.solvers.methods.method import Applicability
from stickslip.solvers.methods.method import Ready, Setup, Turn
from stickslip.solvers.classical.uzawa import Uzawa


@dataclass(frozen=True, kw_only=True)
class Halving(Uzawa):
    NAME: ClassVar = "halving"
    WHEN: ClassVar = "to be tested"
    WORKS_WITH: ClassVar = Applicability(floating=False, matrix_free=False)
    TURNS: ClassVar = (Turn("condensed", 2),)
    ROW: ClassVar = 50

    part: Annotated[float, Key("-", "of a half")] = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.part > 0, "part", self.part, "must be positive")

    def build(self, setup: Setup) -> Ready:
        assert self.part == 0.25
        return super().build(setup)
'''
ASKED = """
import stickslip
from stickslip.solvers.stepping.choice import Size, chain

from stickslip.workflows.lab.pages.scene_page import METHODS_PAGE, reference, renewed
from stickslip.workflows.scene_file.read import to_dict

small = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.5", "output.error=false"]
scene = stickslip.read("block", [*small, "solver.method=halving", "solver.part=0.25", "solver.relaxation=1.9"])
first = next(iter(stickslip.prepare(scene).steps()))
assert {row[-1] for row in first.history} == {"halving"}
assert to_dict(scene)["solver"]["part"] == 0.25
assert "| `part` | number | - | 0.5 | of a half |" in reference()
methods = renewed(METHODS_PAGE.read_text())
assert "| `halving` | to be tested | all | all | all | held by supports | condensed |" in methods
assert "halving (condensed)" in [str(stage) for stage in chain("condensed", Size(2, 1000, 8e4, 100))]
for words, text in (
    (["solver.part=-1"], "solver.part = -1.0: must be positive"),
    (["solver.part=2"], "solver.part = 2.0: solver.method = auto does not use it; use halving"),
):
    try:
        stickslip.prepare(stickslip.read("block", [*small, *words]))
    except stickslip.StickslipError as error:
        assert text in str(error), error
    else:
        raise AssertionError(words)
"""


def test_a_new_method_with_a_key_of_its_own_is_one_new_file(tmp_path: Path) -> None:
    for package in ("geometry", "solvers", "workflows"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "stickslip", tmp_path / "stickslip", symlinks=True)
    shutil.copytree(ROOT / "docs" / "theory", tmp_path / "docs" / "theory")
    (tmp_path / "solvers/methods/halving.py").write_text(NEW)
    done = subprocess.run(
        [sys.executable, "-c", ASKED],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", METHODS)
def test_a_method_is_found_under_its_name_in_a_file_of_its_name(name: str) -> None:
    method = METHODS[name]
    assert name == method.NAME
    assert method.__module__.split(".")[-1] == name.replace("-", "_")
    assert is_dataclass(method)
    assert method.__doc__
    assert {f.name for f in fields(method)} == {"rtol", "max_it", *keys_of(method)}


def test_the_order_is_fixed() -> None:
    assert list(METHODS)[:2] == ["auto", "condensed-newton"]
    assert list(METHODS) == sorted(METHODS, key=lambda name: (METHODS[name].ROW, name))


def test_auto_goes_by_the_turns_of_the_classes() -> None:
    size = Size(2, 1000, 8e4, 100)
    newton = ["condensed-newton (condensed)", "surface-uzawa (condensed)"]
    assert [str(stage) for stage in chain("condensed", replace(size, floating=True))] == newton
    assert [str(stage) for stage in chain("condensed", size)] == [*newton, "nsgs (condensed)"]
    uzawa = ["surface-uzawa (matrix-free)", "surface-uzawa (matrix-free, safer metric)"]
    assert [str(stage) for stage in chain("matrix-free", size)] == uzawa
    body = replace(size, dim=3, floating=True)
    assert [str(stage) for stage in chain("matrix-free", body)] == ["tangent-cg (matrix-free)", *uzawa]
    assert [str(stage) for stage in chain("matrix-free", replace(body, driven=True))] == uzawa


def test_a_method_has_the_settings_of_the_scene() -> None:
    solver = stickslip.Solver(method="uzawa", relaxation=1.9, tolerance=1e-5, max_iterations=7)
    method: Any = method_of(solver)
    assert (method.relaxation, method.rtol, method.max_it, method.alpha) == (1.9, 1e-5, 7, None)


def test_settings_without_keys_of_methods_mean_the_defaults() -> None:
    assert method_of(settings.Solver(method="uzawa")) == method_of(Solver(method="uzawa"))
    scene = replace(read("block"), solver=settings.Solver(method="condensed-newton"))
    assert make_plan(scene)


def test_settings_keep_their_class_when_sent_to_other_ranks() -> None:
    scene = read("block", ["solver.method=uzawa", "solver.relaxation=1.9"])
    again = pickle.loads(pickle.dumps(scene))
    assert again == scene
    assert type(again.solver) is Solver
    assert Solver.__doc__ == settings.Solver.__doc__


def test_a_scene_has_the_keys_of_all_methods_by_default() -> None:
    scene = read("block")
    same = stickslip.Scene(model=scene.model, geometry=scene.geometry, bodies=scene.bodies)
    assert same.solver == Solver()
    assert replace(same.solver, method="regularised", smoothing=1e-3).smoothing == 1e-3
    keys = {key for method in METHODS.values() for key in keys_of(method)}
    assert keys - {"alpha"} <= set(to_dict(scene)["solver"])  # absent by default


def test_unknown_methods_are_refused_by_the_nearest_name() -> None:
    with pytest.raises(SceneError, match=r"method = usawa: did you mean uzawa\?"):
        Solver(method="usawa")
    with pytest.raises(SceneError, match=r"method = usawa: did you mean uzawa\?"):
        make_plan(replace(read("block"), solver=settings.Solver(method="usawa")))


CHAIN = ["surface-uzawa", "surface-uzawa", "condensed-newton", "surface-uzawa", "nsgs"]
BASE = {"base": {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": 0.3}}}
FEW = 2  # iterations


def pressed(**solver: Any) -> Scene:
    """Pressed, then dragged until a part slips."""
    drag = {"x": [[0, 0], [1, 0], [2, 0.02]], "y": [[0, 0], [1, -0.05]]}
    return scene_of(
        contacts=BASE,
        supports={"top": {"boundary": "block.top", "displacement": drag}},
        steps={"end": 2.0, "count": 2},
        solver=solver,
    )


def forces(simulation: Simulation) -> list[Any]:
    return [step.contacts["base"].force for step in simulation.steps()]


@cache
def exact() -> list[StepResult]:
    """Steps by the method that does all."""
    return list(prepare(pressed(method="condensed-newton")).steps())


def agrees(simulation: Simulation) -> list[StepResult]:
    """Its steps, which have the forces of the exact ones."""
    found = list(simulation.steps())
    for step, other in zip(found, exact(), strict=True):
        assert_allclose(step.contacts["base"].force, other.contacts["base"].force, rtol=0, atol=1e-7)
    return found


def hasten(monkeypatch: pytest.MonkeyPatch, method: Any = LearningIteration, most: int = FEW) -> None:
    """The method gives up soon."""
    whole = method.__call__
    monkeypatch.setattr(method, "__call__", lambda self, *given: whole(replace(self, max_it=most), *given))


def test_methods_that_fail_hand_the_step_on(monkeypatch: pytest.MonkeyPatch) -> None:
    hasten(monkeypatch)
    simulation = prepare(pressed(method="auto", surface="matrix-free"))
    chain = simulation.stepper.chain
    assert [stage.method for stage in chain.choice.stages] == CHAIN
    found, expected = agrees(simulation), exact()
    first, second = chain.switches  # both in the first step: what failed is not tried again
    assert (first.time, first.iteration, first.because) == (1.0, FEW, Status.MAX_IT.value)
    assert (first.after, second.after) == ("surface-uzawa (matrix-free, safer metric)", "condensed-newton (condensed)")
    assert found[0].iterations == 2 * FEW + expected[0].iterations
    assert found[1].iterations == expected[1].iterations
    choice = summary(simulation, Outcome("converged", "", Path()), [], Audited())["choice"]
    assert (choice["method"], choice["because"]) == ("surface-uzawa", "solver.surface = matrix-free")


def test_a_switch_on_the_same_bodies_lasts_for_one_step(monkeypatch: pytest.MonkeyPatch) -> None:
    calls, whole = list[None](), CondensedNewton.__call__

    def fails_once(self: CondensedNewton, *arguments: Any) -> Solution:
        calls.append(None)
        return whole(replace(self, max_it=1) if len(calls) == 1 else self, *arguments)

    monkeypatch.setattr(CondensedNewton, "__call__", fails_once)
    monkeypatch.setattr("stickslip.solvers.stepping.halving.HALVINGS", 0)  # the step is not cut first
    simulation = prepare(pressed())
    found = agrees(simulation)
    (switch,) = simulation.stepper.chain.switches
    assert (switch.time, switch.after) == (1.0, "surface-uzawa (condensed)")
    assert [{row[-1] for row in step.history} for step in found] == [
        {"condensed-newton", "surface-uzawa"},
        {"condensed-newton"},
    ]
    assert [step.substeps for step in found] == [1, 1]
    assert simulation.counters.factorisations == 1


POWER = {"law": "compliance", "c_n": 40.0, "m_n": 2.0}


@pytest.mark.parametrize("normal", [{"law": "unilateral"}, POWER])
def test_sweeps_are_the_last_resort_in_space(normal: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of(
        dim=3,
        contacts={"base": BASE["base"] | {"normal": normal}},
        supports={"top": {"boundary": "block.top", "displacement": {"x": 0.02, "y": 0.0, "z": -0.05}}},
        solver={"tolerance": 1e-10},
    )
    expected = forces(prepare(scene))
    hasten(monkeypatch)
    hasten(monkeypatch, CondensedNewton, 1)
    monkeypatch.setattr("stickslip.solvers.stepping.halving.HALVINGS", 0)
    simulation = prepare(scene)
    assert_allclose(forces(simulation), expected, rtol=0, atol=1e-8)
    assert [switch.after for switch in simulation.stepper.chain.switches] == [str(stage) for stage in DENSE[1:]]


def test_a_step_that_cutting_does_not_help_is_tried_by_all_methods(monkeypatch: pytest.MonkeyPatch) -> None:
    """From rest, in proportion to time: half of the step is the same problem again. The second half is not."""
    supports = {"top": {"boundary": "block.top", "displacement": {"x": 0.02, "y": -0.05}}}
    scene = scene_of(contacts=BASE, supports=supports)
    expected = forces(prepare(scene))
    hasten(monkeypatch, CondensedNewton, 1)
    simulation = prepare(scene)
    assert_allclose(forces(simulation), expected, rtol=0, atol=1e-7)
    assert simulation.stepper.chain.switches[0].time == 0.5
    (step,) = list(simulation.steps())
    first = [row for row in step.history if row[0] == 0.5]
    assert {row[-1] for row in first} == {"condensed-newton", "surface-uzawa"}
    assert min(row[0] for row in step.history) == 0.5


def test_a_linear_solve_that_fails_hands_the_step_on(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = prepare(pressed(method="auto", surface="matrix-free"))
    monkeypatch.setattr("stickslip.solvers.linear.conjugate_gradients.MOST_ITERATIONS", 1)
    agrees(simulation)
    assert {switch.because for switch in simulation.stepper.chain.switches} == {Status.BROKEN.value}


def test_a_linear_solve_that_fails_leaves_the_steps_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    steps = prepare(pressed(method="surface-uzawa", surface="matrix-free")).steps()
    assert next(steps).time == 1.0
    monkeypatch.setattr("stickslip.solvers.linear.conjugate_gradients.MOST_ITERATIONS", 0)
    with pytest.raises(StepError, match="a linear solve failed"):
        next(steps)


def test_a_method_that_cannot_be_prepared_on_the_way_hands_the_step_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last one with this form of the bodies: another form is next."""
    hasten(monkeypatch)
    simulation = prepare(pressed(method="auto", surface="matrix-free"))
    whole = MethodChain._readied

    def unable(chain: MethodChain, *bodies: Any) -> Ready:
        if chain.stage.safe:
            raise SolverError("no safer metric")
        return whole(chain, *bodies)

    monkeypatch.setattr(MethodChain, "_readied", unable)
    agrees(simulation)
    last = simulation.stepper.chain.switches[-1]
    assert (last.after, last.because) == ("condensed-newton (condensed)", "no safer metric")


def test_no_switch_to_what_memory_has_no_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    hasten(monkeypatch)
    simulation = prepare(pressed(method="auto", surface="matrix-free"))
    monkeypatch.setattr("stickslip.solvers.stepping.choice.available", lambda: 0)
    with pytest.raises(StepError, match="iterations ran out"):
        next(simulation.steps())
    chain = simulation.stepper.chain
    assert {switch.after for switch in chain.switches} == {"surface-uzawa (matrix-free, safer metric)"}
    assert chain.stage.surface == "matrix-free"


SMALL, LARGE = Size(3, 1000, 8e4, 100), Size(3, 1_000_000, 8e7, 30_000)
DENSE = tuple(Stage(name, "condensed") for name in ("condensed-newton", "surface-uzawa", "nsgs"))
FREE = (
    Stage("tangent-cg", "matrix-free"),
    Stage("surface-uzawa", "matrix-free"),
    Stage("surface-uzawa", "matrix-free", safe=True),
)


def test_the_choice_goes_by_size_and_memory() -> None:
    assert chosen(SMALL, Solver(), 1e12).stages == DENSE
    assert chosen(LARGE, Solver(), 1e15).stages == (*FREE, *DENSE)
    assert chosen(SMALL, Solver(), 1e3).stages == FREE
    assert chosen(SMALL, Solver(method="surface-uzawa"), 1e12).stages == DENSE[1:2]
    assert chosen(replace(SMALL, floating=True), Solver(), 1e12).stages == DENSE[:2]
    assert chosen(replace(LARGE, clock=True), Solver(), 1e15).stages == DENSE  # all of D is needed
    with pytest.raises(MachineError, match="more than this machine has free"):
        chosen(LARGE, Solver(method="condensed-newton"), 1e9)


def form(size: Size) -> str:
    return chosen(size, Solver(), 1e12).stages[0].surface


def test_a_factor_pays_in_many_steps() -> None:
    """Sizes and fastest forms of the table that `stickslip.workflows.lab.benchmarks.auto` prints."""
    cube, half_ball = Size(3, 50_700, 4.1e6, 2028), Size(3, 22_903, 1.0e6, 3048)
    assert [form(each) for each in (cube, half_ball)] == ["matrix-free"] * 2
    assert form(replace(cube, steps=32)) == "condensed"
    assert form(Size(2, 3180, 44_520, 868)) == "condensed"  # bars: many of the dofs are contact dofs


def test_multigrid_is_not_for_slender_bodies_that_float() -> None:
    beam = Size(3, 50_000, 4e6, 2000)
    assert (form(beam), form(replace(beam, slender=10.0))) == ("matrix-free", "condensed")
    system = system_of(bars())
    size = Size.of(system.problem, system.mesh, system.constraints, system.contacts)
    assert size.slender == pytest.approx(10.0 / 0.3)


def bars(*words: str) -> Scene:
    """A bar on a bar under its own weight; nothing but contact holds the upper one."""
    scene = Case("two_blocks", 3.0, BARS, free=("top",)).read(2)
    return replace(scene, solver=replace(scene.solver, **dict(word.split("=") for word in words)))


@pytest.mark.parametrize("words", [(), ("surface=matrix-free",)])
def test_bars_of_which_one_floats(words: tuple[str, ...]) -> None:
    """Conjugate gradients take hundreds of iterations for each solve: the step is handed on after some of them."""
    simulation = prepare(bars(*words))
    (*_, last) = simulation.steps()
    assert last.contacts["joint"].force[1] == pytest.approx(1e-3 * 9.81 * 10.0 * 0.3, rel=1e-9)  # its weight
    assert [switch.because for switch in simulation.stepper.chain.switches] == [Status.SLOW.value] * len(words)
    assert simulation.counters.linear_iterations <= len(words) * (PATIENCE + MOST_ITERATIONS)


def test_each_rank_of_a_machine_has_a_dense_stiffness_of_its_own() -> None:
    one, four = LARGE.dense_bytes, replace(LARGE, ranks=4).dense_bytes
    assert four - one == pytest.approx(3 * 6 * 8 * LARGE.contact_dofs**2)  # five copies, and Delassus
    memory = (one + four) / 2 / 0.7  # the part of it that may be taken
    assert DENSE[0] in chosen(LARGE, Solver(), memory).stages
    assert DENSE[0] not in chosen(replace(LARGE, ranks=4), Solver(), memory).stages


def test_the_size_is_that_of_what_is_assembled() -> None:
    system = system_of(scene_of(2, {"cells": "tensor", "mesh_size": 0.05}, contacts=BASE))
    size = Size.of(system.problem, system.mesh, system.constraints, system.contacts)
    assert (size.dim, size.dofs, size.ranks) == (2, system.K_B.size[0], 1)
    assert (size.steps, size.slender) == (1, 2.0)  # nothing supports it
    assert size.contact_dofs == len(system.interface.dofs)
    assert size.entries == pytest.approx(system.K_B.getInfo()["nz_used"], rel=0.1)  # fewer at the boundary


def test_the_coarse_mesh_has_fewer_dofs() -> None:
    fine = system_of(read("two_blocks"))
    coarse = CoarseMesh.beside(fine)
    assert coarse.system.constraints.free_total < fine.constraints.free_total / 2
    forces, displacements = coarse.smooth_responses(fine, np.zeros((len(fine.interface.dofs), 0)), 1.0)
    assert forces.shape == displacements.shape
    acting = forces.any(axis=0)  # a flat surface has nothing across
    assert acting.any()
    assert np.all(np.sum(forces * displacements, axis=0)[acting] > 0)  # bodies give way
