"""Steps are cut where they are hard, hit every listed time, and end by name."""

import itertools
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from shared.problems import SceneOf, SimulationOf, march
from stickslip import Scene, SceneError, SolverError, StepResult
from stickslip.geometry.amplitude import value_at
from stickslip.geometry.arrays import Array
from stickslip.solvers.effects.thermal import Thermal
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import OnStep, Solution, Status, Step
from stickslip.solvers.results.observe import _status as status_of
from stickslip.solvers.results.step_result import OPEN, SLIP, STICK
from stickslip.solvers.scene.settings import Solver
from stickslip.solvers.simulation.simulation import prepare
from stickslip.solvers.stepping import halving
from stickslip.solvers.stepping.history import History, count_iterations
from stickslip.solvers.stepping.method_chain import MethodChain
from stickslip.solvers.stepping.pairs import PairSearch
from stickslip.solvers.stepping.state import ENOUGH, HALVINGS, State, StepControl
from stickslip.solvers.stepping.stepper import NoEquilibriumError, StepError, Stepper
from stickslip.solvers.stepping.substep import SubstepSolver
from stickslip.workflows.run.warnings import reasons_to_doubt
from stickslip.workflows.scene_file.read import read

MU = 0.3
SMALLEST = 0.5**HALVINGS


def sheared(scene_of: SceneOf, count: int = 2, **tables: Any) -> Scene:
    """Pressed, then drawn until a part slips; by one method, so that a step that it does not solve is cut.

    It has a small gap: without one the first steps are the same problem in another unit, and are not cut.
    """
    drag = {"x": [[0, 0], [1, 0], [2, 0.02]], "y": [[0, 0], [1, -0.05]]}
    tables = {"steps": {"end": 2.0, "count": count}, "solver": {"method": "condensed-newton"}} | tables
    return scene_of(base={"gap_offset": 1e-6, "friction": {"law": "coulomb", "mu": MU}}, top=drag, **tables)


class Reluctant:
    """A method that fails, after its iterations, at steps that are longer than allowed [s] where they begin."""

    def __init__(self, stepper: Stepper, allowed: Callable[[float], float]) -> None:
        self.whole, self.allowed, self.tried = stepper.method_after, allowed, list[tuple[float, float]]()
        self.starts = list[Any]()
        stepper.method_after = self.after

    def after(self, state: State) -> Callable[[SurfaceProblem, Any, OnStep], Solution]:
        method = self.whole(state)

        def solve(problem: SurfaceProblem, p: Any, on_step: OnStep) -> Solution:
            found, asked = method(problem, p, on_step), (state.time, problem.cone.time)
            if asked not in self.tried[-1:]:  # once more where points have closed
                self.starts.append(p.copy())
                self.tried.append(asked)
            too_long = problem.cone.time - state.time > self.allowed(state.time) * (1 + 1e-9)
            return replace(found, status=Status.STALLED) if too_long else found

        return solve


def ends(tried: list[tuple[float, float]]) -> list[float]:
    """Where the accepted substeps ended: at the next one's begin, or at the end."""
    return [*dict.fromkeys(begin for begin, _ in tried[1:] if begin > tried[0][0]), tried[-1][1]]


def test_substeps_shrink_where_it_is_hard_and_grow_back_after(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    simulation = simulation_of(sheared(scene_of))
    reluctant = Reluctant(simulation.stepper, lambda time: 1 / 16 if time < 0.25 else 1.0)
    (step,) = march(simulation, 1.0)
    sizes = np.diff([0.0, *ends(reluctant.tried)])
    assert step.state.time == 1.0  # to the last digit
    assert step.substeps == len(sizes)
    assert_allclose(sizes[:ENOUGH], 1 / 16)
    assert sizes.max() >= 1 / 4
    assert len(reluctant.tried) == len(sizes) + 5  # four halvings, and one attempt at 1/8 that came too early


def test_the_next_step_begins_with_what_was_learnt_of_the_size(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    simulation = simulation_of(sheared(scene_of))
    reluctant = Reluctant(simulation.stepper, lambda time: 0.5)
    first, second = march(simulation, 1.0, 2.0)
    assert (first.substeps, second.state.time) == (2, 2.0)
    of_second = [(begin, end) for begin, end in reluctant.tried if begin >= 1.0]
    assert of_second[0] == (1.0, 1.5)  # not 2.0
    assert first.state.control == StepControl(0.5, 2)


def test_substeps_are_those_steps(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """Nothing of a failed attempt is left: the answer is that of the same steps asked for, bit for bit."""
    simulation = simulation_of(sheared(scene_of))
    Reluctant(simulation.stepper, lambda time: 0.25)
    cut = march(simulation, 1.0, 2.0)
    assert cut[-1].substeps == 4
    plain = march(simulation_of(sheared(scene_of, count=8)), *np.arange(0.25, 2.1, 0.25))
    assert [cut[0].iterations > sum(step.iterations for step in plain[:4])] == [True]  # those of failed attempts count
    for one, other in ((cut[0], plain[3]), (cut[1], plain[7])):
        for name in ("p", "w"):
            assert_array_equal(getattr(one.state, name), getattr(other.state, name))
        assert_array_equal(one.state.u.array, other.state.u.array)
        assert_array_equal(one.state.slip["base"], other.state.slip["base"])
        assert one.state.energy.external == other.state.energy.external
        assert_array_equal(one.state.energy.dissipation, other.state.energy.dissipation)
    (size,) = cut[-1].state.energy.dissipation
    assert size > 0


def test_what_a_method_learnt_in_a_failed_attempt_is_no_harm(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    table = {"solver": {"method": "surface-uzawa", "surface": "matrix-free", "tolerance": 1e-11}}
    simulation = simulation_of(sheared(scene_of, **table))
    Reluctant(simulation.stepper, lambda time: 0.5)
    *_, cut = march(simulation, 1.0, 2.0)
    *_, plain = march(simulation_of(sheared(scene_of, count=4, **table)), 0.5, 1.0, 1.5, 2.0)
    size = np.abs(plain.state.p).max()
    assert_allclose(cut.state.p, plain.state.p, rtol=0, atol=1e-8 * size)  # solver.tolerance is 1e-11
    assert_allclose(cut.state.energy.dissipation, plain.state.energy.dissipation, rtol=1e-8)


def test_few_iterations_force_substeps_which_are_counted(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """A contact that grows and slips: the shorter the way, the fewer points change sides."""
    base = {"gap_offset": 1e-6, "friction": {"law": "coulomb", "mu": MU}}
    drag = {"x": [[0, 0], [1, 0], [2, 0.03]], "y": [[0, 0], [1, -0.001], [2, -0.06]]}

    def steps(limit: int, count: int = 2) -> list[StepResult]:
        scene = scene_of(
            geometry={"mesh_size": 0.1},
            obstacles={"foundation": {"shape": "cylinder", "point": [1.0, -5.0], "radius": 5.0}},
            base=base,
            top=drag,
            steps={"end": 2.0, "count": count},
            solver={"method": "condensed-newton", "max_iterations": limit},
        )
        return list(simulation_of(scene).steps())

    limit = 3
    expected, found = steps(100), steps(limit)
    assert [step.substeps for step in expected] == [1, 1]
    assert expected[1].iterations > limit
    assert [step.time for step in found] == [1.0, 2.0]
    assert found[1].substeps > 2
    attempts = sum(row[1] == 0 for row in found[1].history)
    assert found[1].substeps < attempts  # those that failed are told too
    assert found[1].iterations > expected[1].iterations
    assert max(row[1] for row in found[1].history) == limit
    one, cut, fine = (s[-1].contacts["base"].force for s in (expected, found, steps(100, count=32)))
    assert_allclose(cut, fine, rtol=0.01)  # the path of friction is followed more closely
    assert np.abs(one - fine).max() > 3 * np.abs(cut - fine).max()


def test_the_smallest_step_that_fails_names_contact_point_law_and_what_to_try(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    scene = sheared(scene_of, solver={"method": "uzawa", "max_iterations": 3})
    simulation = simulation_of(scene)
    says = (
        r"t = 0\.0039\d*: contacts\.base at \(.+, 0\): normal residual \d\.\de-\d+, not 1e-08, in a step of 0\.00391 s "
        "after 3 iterations; the iterations ran out: raise solver.max_iterations"
    )
    with pytest.raises(StepError, match=says) as failed:
        list(simulation.steps())
    assert failed.value.last_good is None
    assert {row.time for row in failed.value.history} == {0.5**k for k in range(HALVINGS + 1)}


def test_iterations_that_contract_too_little_for_any_step_end_at_once(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    simulation = simulation_of(sheared(scene_of, solver={"method": "uzawa", "max_iterations": 40}))
    says = (
        r"t = 1: .*; the iterations ran out: raise solver.max_iterations by about \S+, for each leaves 0\.9\d+ of the"
    )
    with pytest.raises(StepError, match=says) as failed:
        list(simulation.steps())
    assert {row.time for row in failed.value.history} == {1.0}
    more = float(str(failed.value).split("by about ")[1].split(",")[0])
    whole = sheared(scene_of, solver={"method": "uzawa", "max_iterations": 1000})
    assert 0.5 < (next(simulation_of(whole).steps()).iterations - 40) / more < 2


def test_what_was_reached_before_the_smallest_step_is_kept(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    simulation = simulation_of(sheared(scene_of))
    Reluctant(simulation.stepper, lambda time: 0.25 if time < 0.5 else 0.0)
    steps = simulation.steps()
    step = next(steps)
    assert (step.time, step.substeps) == (0.5, 2)
    with pytest.raises(StepError, match=r"t = 0\.50390.*: contacts\.base .*the residual stopped falling: try another"):
        next(steps)


def test_a_step_starts_where_the_last_went_unless_loads_turn(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """The press ends at t = 1, where the shear begins."""
    simulation = simulation_of(sheared(scene_of, count=8))
    reluctant = Reluctant(simulation.stepper, lambda time: 1.0)
    times = 0.25, 0.75, 1.0, 1.25, 1.5, 1.501, 1.75
    p = [simulation.stepper.start().p, *(step.state.p for step in march(simulation, *times))]
    ahead = p[5] + (1.501 - 1.5) / 0.25 * (p[5] - p[4])
    expected = [p[0], p[1] + 2 * (p[1] - p[0]), p[2] + (p[2] - p[1]) / 2, p[3], p[4] + p[4] - p[3], ahead, p[6]]
    for found, start in zip(reluctant.starts, expected, strict=True):
        # 1e-14: the sums are those of the program, in another order
        assert_allclose(found, start, rtol=1e-14, atol=1e-14 * np.abs(start).max())


def test_steps_of_a_load_that_grows_alone_take_no_iterations(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """All of the contact sticks: the answer is in proportion, and each start is right."""
    scene = scene_of(base={"friction": {"law": "stick"}}, top={"x": 0.01, "y": -0.05}, steps={"count": 5})
    first, *others = simulation_of(scene).steps()
    assert first.iterations > 0
    assert [step.iterations for step in others] == [0] * 4
    assert others[-1].contacts["base"].normal_force == pytest.approx(5 * first.contacts["base"].normal_force)


@pytest.mark.parametrize("part", ["normal", "tangential"])
@pytest.mark.parametrize("name", ["base", "wall"])
def test_the_worst_contact_is_the_off_one(name: str, part: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    sides = {"base": ("bottom", "foundation"), "wall": ("right", "wall")}
    rough = {"law": "coulomb", "mu": MU}
    stop = {"shape": "plane", "point": [2.0, 0.0], "normal": [-1.0, 0.0]}
    contacts = {k: {"surface": f"block.{s}", "against": o, "friction": rough} for k, (s, o) in sides.items()}
    simulation = simulation_of(
        scene_of(
            obstacles={"foundation": FLOOR, "wall": stop},
            contacts=contacts,
            top={"x": 0.03, "y": -0.05},
        )
    )
    stepper = simulation.stepper
    (reached,) = march(simulation, 1.0)
    (place,) = (p for p in stepper.cone.places if p.rows.name == name)
    span = {"normal": place.normal, "tangential": place.tangential}[part]
    p = reached.state.p.copy()
    p[span.start + 1] -= 10 * reached.problem.p_ref
    nothing = np.zeros(stepper.surface.size)
    wrong = Solution(p, reached.state.w, nothing, Status.STALLED, 10.0, ())
    told = halving.largest_residual(reached.problem, wrong)
    measured = {"normal": place.rows.N_n, "tangential": place.rows.N_t}[part][1].toarray()
    node = np.argmax(np.abs(measured)) // 2  # whose displacement the row is
    x, y = place.rows.surface.points[node]
    assert told == f"contacts.{name} at ({x:.4g}, {y:.4g}): {part} "


def test_a_step_without_a_residual_says_so(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    (reached,) = march(simulation_of(sheared(scene_of)), 1.0)
    nothing = np.zeros(reached.stepper.surface.size)
    broken = Solution(reached.state.p, reached.state.w, nothing, Status.BROKEN, np.inf, ())
    auto, named = Solver(), Solver(method="condensed-newton")
    told = halving.explain(reached.problem, broken, auto, 0.25)
    assert halving.explain(None, broken, named, 0.25) == told.replace("try ", "try another solver.method, or ")
    assert told == f"no residual in a step of 0.25 s after 0 iterations; {Status.BROKEN.value}"
    assert halving.explain(None, broken, auto, 0.25) == told
    rest = f"in a step of 0.25 s after 0 iterations; {Status.BROKEN.value}"
    # the tractions are those of the step before: they tell of no contact
    told = halving.explain(reached.problem, replace(broken, residual=0.1), auto, 0.25)
    assert told == f"residual 1.0e-01, not 1e-08, {rest}"


@pytest.mark.parametrize("heat", [0.0, 1e99, -1e99])  # what a temperature strains is no load, and may open all
def test_a_step_whose_work_overflows_is_refused(heat: float, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = replace(sheared(scene_of), supports=scene_of(top={"y": -0.1 if heat else -1e90}).supports)
    warm = dict.fromkeys(scene.bodies, Thermal(expansion=1e99, temperature=heat))
    scene = replace(scene, thermal=warm) if heat else scene  # type: ignore[call-arg]
    with pytest.raises(SceneError, match=r"motions of about .* and tractions of .* leave the range of numbers"):
        list(simulation_of(scene).steps())


@pytest.mark.parametrize("status", sorted(set(Status) - {Status.CONVERGED, Status.NO_EQUILIBRIUM}, key=str))
def test_every_bad_ending_says_what_to_try(status: Status) -> None:
    """But where there is no equilibrium: that says which body moves, and how."""
    assert any(f"{word} " in status.value for word in ("try", "raise", "check"))


@given(
    st.lists(st.floats(SMALLEST, 2.0), min_size=1, max_size=40),
    st.floats(1e-3, 1e3),
    st.lists(st.booleans(), min_size=40, max_size=40),
)
def test_a_march_ends_at_its_target_whatever_fails(limits: list[float], step: float, easy: list[bool]) -> None:
    """`limits`, in units of the step: what can be solved of the substep in that part of the way."""
    smallest, time, control, attempts = step * SMALLEST, 0.0, StepControl(), 0
    while time < step:
        tried = control.next_size(step - time, smallest)
        assert tried <= max(control.size, smallest) * (1 + 1e-6)
        assert tried >= min(smallest / 2, step - time) * (1 - 1e-6)
        attempts += 1
        if tried > step * limits[int(time / step * len(limits))] * (1 + 1e-6):
            control = control.after_failure(tried, smallest)
        else:
            time = step if tried == step - time else time + tried
            control = control.after_success(tried, step, easy[attempts % 40])
    assert attempts <= 4 * 2**HALVINGS


def test_a_hard_substep_does_not_let_the_next_ones_grow() -> None:
    control = StepControl(0.25, ENOUGH - 1)
    assert control.after_success(0.25, 1.0, easy=False) == StepControl(0.25)
    assert control.after_success(0.25, 1.0, easy=True) == StepControl(0.5)
    assert control.after_success(0.1, 1.0, easy=True) == control  # so short a one proves nothing
    assert (
        StepControl(0.5, ENOUGH - 1).after_success(0.5, 1.0, easy=True) == StepControl()
    )  # nothing is left to be grown


TABLE = [[0.0, 0.0], [0.3, 0.04], [0.7, -0.02]]
FLOOR = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
RIGHT = "block.right"
AREA, LENGTH = 2.0, 2.0  # of the block


def total_x(step: StepResult) -> float:
    """What supports and contacts bear of the loads."""
    return -float(step.contacts["base"].force[0] + step.supports["top"][0][0])


def held(against: dict[str, Any] = FLOOR, **tables: Any) -> dict[str, Any]:
    """The block between a clamped top and the foundation, which pulls too: a linear problem."""
    bilateral = {"normal": {"law": "bilateral"}}
    return {"obstacles": {"foundation": against}, "base": bilateral, "top": {"x": 0.0, "y": 0.0}} | tables


DRIVES: dict[str, tuple[dict[str, Any], Callable[[StepResult], float], float]] = {  # and the measure of a value 1
    "support": (
        held(top={"x": TABLE, "y": 0.0}, probes={"corner": {"point": [0.0, 1.0]}}),
        lambda step: float(step.probes["corner"][0][0]),
        1.0,
    ),
    "traction": (held(loads={"side": {"boundary": RIGHT, "traction": [TABLE, 0.0]}}), total_x, 1.0),
    "pressure": (held(loads={"side": {"boundary": RIGHT, "pressure": TABLE}}), total_x, -1.0),
    "force": (held(loads={"side": {"boundary": RIGHT, "force": [TABLE, 0.0]}}), total_x, 1.0),
    "gravity": (
        held(gravity={"acceleration": [TABLE, 0.0]}, bodies={"block": {"E": 1.0, "nu": 0.3, "density": 3.0}}),
        total_x,
        3.0 * AREA,
    ),
    "obstacle's displacement": (
        held(FLOOR | {"displacement": {"y": TABLE}}),
        lambda step: float(step.obstacles["foundation"][0][1]),
        1.0,
    ),
    "obstacle's force": (
        held(FLOOR | {"force": {"y": TABLE}}),
        lambda step: float(step.contacts["base"].force[1]),
        1.0,
    ),
    "obstacle's rotation": (  # about the middle of the bottom, of which the corner is 1 m away
        held(FLOOR | {"rotation": {"point": [1.0, 0.0], "angle": TABLE}}, probes={"corner": {"point": [2.0, 0.0]}}),
        lambda step: float(step.probes["corner"][0][1]),
        1.0,
    ),
    "Tresca's bound": (
        held(
            FLOOR | {"displacement": {"x": 1.0}},
            base={
                "normal": {"law": "bilateral"},
                "friction": {"law": "tresca", "bound": [[t, abs(v)] for t, v in TABLE]},
            },
        ),
        lambda step: step.contacts["base"].tangential_force,
        LENGTH,
    ),
}


@pytest.mark.parametrize("name", DRIVES)
def test_times_of_tables_are_hit_with_their_values(name: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    tables, measure, of_one = DRIVES[name]
    scene = scene_of(**tables, steps={"end": 1.0, "count": 2})
    table = tuple((t, abs(v) if name == "Tresca's bound" else v) for t, v in TABLE)
    steps = list(simulation_of(scene).steps())
    assert [step.time for step in steps] == [0.3, 0.5, 0.7, 1.0]
    for step in steps:
        assert_allclose(measure(step), of_one * value_at(table, step.time, 1.0), rtol=1e-8)  # solver.tolerance


def test_sides_that_move_apart_end_the_step(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = simulation_of(scene_of(base={"sliding": True}, top={"x": 0.0, "y": -0.05}))

    def gone(self: PairSearch, searched: Mapping[str, Array]) -> SubstepSolver:
        raise SceneError("contacts.base: nothing of block.bottom faces foundation")

    monkeypatch.setattr(PairSearch, "found", gone)
    with pytest.raises(StepError, match="the sides of a sliding contact have moved apart"):
        next(simulation.steps())


SLIDING = ["geometry.mesh_size=0.5", "geometry.lower_mesh_size=0.4", "steps.count=2"]


@pytest.mark.parametrize(("failing", "ended"), [(range(2, 3), ""), (range(1, 99), "a linear solve failed")])
def test_pairs_that_no_method_can_be_prepared_for_cut_the_step(
    failing: range, ended: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of the second step's end, or all that are searched from there on."""
    simulation = prepare(read("sliding", [*SLIDING, 'solver.method="condensed-newton"']))
    whole, count = MethodChain.method, itertools.count(1)

    def unable(*bodies: Any) -> Any:
        if next(count) in failing:
            raise SolverError("the contact rows of a node are nearly the same")
        return whole(*bodies)

    steps = simulation.steps()
    assert next(steps).substeps == 1
    monkeypatch.setattr(MethodChain, "method", unable)
    if ended:
        with pytest.raises(StepError, match=rf"t = 1\.00391: no residual in a step of 0\.00391 s .*{ended}"):
            next(steps)
    else:
        last = next(steps)
        assert (last.time, last.substeps) == (2.0, 2)


def test_pairs_that_never_settle_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = prepare(read("sliding", SLIDING))
    steps = [*simulation.steps()]
    assert not [*reasons_to_doubt(simulation, steps)]
    monkeypatch.setattr("stickslip.solvers.stepping.pairs.slid_since", lambda *arguments: 1.0)
    steps = [*simulation.steps()]
    times = [step.time for step in steps]
    said = f"the pairs of a sliding contact change from search to search at t = {times[0]:g} and 1 other times"
    again = prepare(simulation.scene, reached=simulation.stepper.chain.reached)
    for each in (simulation, again):
        assert said in "".join(reasons_to_doubt(each, steps))


JAMMED = [*SLIDING, "contacts.joint.friction.mu=200", "steps.end=1.5", "steps.count=3"]


def test_pairs_settle_behind_a_jump(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before it the trailing corner is closed, behind it open: pairs of both ends took turns."""
    simulation, found, count = prepare(read("sliding", JAMMED)), PairSearch.found, itertools.count(1)
    monkeypatch.setattr(PairSearch, "found", lambda *given: (next(count), found(*given))[1])
    *_, last = steps = [*simulation.steps()]
    assert last.jump
    assert last.jump > 0
    assert not [*reasons_to_doubt(simulation, steps)]
    assert next(count) <= 40  # 96 when a cut for a jump was kept behind it


SPHERES = ["geometry.order=1", "geometry.mesh_size=0.8", "geometry.lower_mesh_size=0.9", "contacts.pole.sliding=true"]
WIDE = ["geometry.contact_mesh_size=0.25", "geometry.contact_radius=0.5", "steps.count=3"]


@pytest.mark.parametrize(
    ("name", "overrides", "most"),
    [
        ("sliding", [*SLIDING, "supports.drive.displacement.y=[[0, 0], [1, -0.1]]", "steps.count=4"], 9),
        ("spheres", [*SPHERES, *WIDE, "supports.top.displacement.z=-0.4"], 10),
    ],
)
def test_a_search_leaves_the_next_one_nothing_that_the_tolerance_hides(
    name: str, overrides: list[str], most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Under pressures of a tenth of E tractions of other pairs pass the tolerance, and moved the pairs on for ever."""
    ends, found = list[float](), SubstepSolver.solve
    monkeypatch.setattr(SubstepSolver, "solve", lambda self, *to: (ends.append(to[1]), found(self, *to))[1])
    assert [*prepare(read(name, overrides)).steps()]
    assert max(Counter(ends).values()) <= most  # of twelve


RUBBED: dict[str, Any] = {"friction": {"law": "coulomb", "mu": MU}}


def pulled(mu: float) -> dict[str, Any]:
    """Pressed by 0.2 N, pulled by 0.02 N, held by nothing else."""
    rough = {"friction": {"law": "coulomb", "mu": mu}}
    return {"base": rough, "loads": {"top": {"boundary": "block.top", "traction": [0.01, -0.1]}}}


def test_body_held_by_friction_alone_stays_below_the_limit(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    (step,) = simulation_of(scene_of(**pulled(mu=0.2))).steps()
    assert_allclose(step.contacts["base"].force, [-0.02, 0.2], rtol=1e-9)


def test_body_pulled_beyond_friction_has_no_answer(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """The pull is twice the friction limit: no displacement, however large, is an equilibrium."""
    with pytest.raises(NoEquilibriumError, match="cannot balance the loads"):
        list(simulation_of(scene_of(**pulled(mu=0.05))).steps())


def test_friction_coefficient_zero_holds_nothing(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    with pytest.raises(SceneError, match="nothing resists the translation along x"):
        simulation_of(scene_of(**pulled(mu=0.0)))


def test_unloading_to_zero_leaves_no_traction(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    way = {"x": 0.0, "y": [[0, 0], [1, -0.1], [2, 0.0]]}
    pressed, unloaded = simulation_of(scene_of(base={}, top=way, steps={"end": 2.0, "count": 2})).steps()
    assert pressed.contacts["base"].normal_force > 0.1
    assert abs(unloaded.contacts["base"].normal_force) < 1e-15


@pytest.mark.parametrize("slide", [1e-3, 4.0])
def test_friction_does_not_fade_with_the_length_of_the_slide(
    slide: float, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """A stiff body pressed by a nanometre: its friction is mu times the normal force, after a metre too."""
    scene = scene_of(
        bodies={"block": {"E": 2e11, "nu": 0.3}},
        obstacles={"foundation": FLOOR | {"displacement": {"x": [[0, 0], [1, 0], [2, slide]]}}},
        base=RUBBED,
        top={"x": 0.0, "y": [[0, 0], [1, -1e-9]]},
        steps={"end": 2.0, "count": 2},
    )
    *_, step = simulation_of(scene).steps()
    base = step.contacts["base"]
    assert_allclose(base.tangential_force, 0.3 * base.normal_force, rtol=1e-6)
    assert_allclose(base.slip_area, 2.0)


def test_obstacle_that_faces_away_is_refused(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    upside_down = {"foundation": FLOOR | {"normal": [0.0, -1.0]}}
    with pytest.raises(SceneError, match=r"obstacles\.foundation: its normal must point against block\.bottom"):
        simulation_of(scene_of(obstacles=upside_down, base=RUBBED))


def test_contact_on_a_surface_that_a_support_carries_is_refused(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    held = {"bed": {"boundary": "block.bottom", "displacement": {"x": 0.0, "y": 0.0}}}
    with pytest.raises(SceneError, match=r"contacts\.base: supports prescribe the normal motion"):
        simulation_of(scene_of(base=RUBBED, supports=held))


def test_body_that_is_prescribed_whole_is_refused(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    still = {"displacement": {"x": 0.0, "y": 0.0}}
    whole = {side: {"boundary": f"block.{side}", **still} for side in ("left", "right", "top")}
    with pytest.raises(SceneError, match="nothing is left to solve"):
        simulation_of(scene_of(geometry={"mesh_size": 1.0, "length": 1.0}, supports=whole))


POINTS = {  # pressure, traction, bound [Pa], slip increment [m]; the largest traction is 1 Pa, the motion by it 1 m
    "touches nothing": (0.0, 0.0, 0.0, 0.5, OPEN),
    "a pressure of rounding": (0.9e-9, 0.0, 0.3e-9, 0.5, OPEN),
    "at its bound, and moves": (1.0, 0.3, 0.3, 0.5, SLIP),
    "at its bound, and stays": (1.0, 0.3, 0.3, 0.0, STICK),
    "at its bound, moved by rounding": (1.0, 0.3, 0.3, 0.9e-9, STICK),
    "below its bound, on springs that give": (1.0, 0.2, 0.3, 0.5, STICK),
    "within the slack of its bound": (1.0, 0.2998, 0.3, 0.5, SLIP),
    "beyond the slack of its bound": (1.0, 0.2996, 0.3, 0.5, STICK),
    "held without end": (1.0, 0.3, np.inf, 0.5, STICK),
}


@pytest.mark.parametrize("sides", [1, 2])
@pytest.mark.parametrize("smooth", [False, True])
def test_a_point_slips_at_its_bound_if_it_moves(smooth: bool, sides: int) -> None:
    pressure, t, bound, by, expected = np.array([*POINTS.values()]).T
    bound = 0 * pressure if smooth else bound
    rows = SimpleNamespace(normal=SimpleNamespace(sides=sides), friction=None)
    problem = SimpleNamespace(scales=SimpleNamespace(of_tractions=np.max), u_ref=1.0, stiffness=1.0)
    start = SimpleNamespace(p=np.zeros(1))
    accepted: Any = SimpleNamespace(problem=problem, state=SimpleNamespace(p=pressure), substep_start=start, slack=1e-3)
    vectors = (np.column_stack([values, 0 * values]) for values in (t, by))
    multiplier, increment = vectors
    found = status_of(rows, pressure, multiplier, bound, increment, accepted)  # type: ignore[arg-type]
    if sides == 2:  # a bilateral contact is never open: what is pressed by nothing slips at its bound of zero
        expected = np.where(expected == OPEN, np.where(bound == 0, SLIP, STICK), expected)
    if smooth:  # nothing sticks without friction
        expected = np.where(expected == STICK, SLIP, expected)
    assert dict(zip(POINTS, found, strict=True)) == dict(zip(POINTS, expected.astype(int), strict=True))
    start.p[0] = 1e3  # a release leaves a rest of the tractions before, and of the motions that they make
    released = status_of(rows, 1e-7 * pressure, multiplier, bound, increment, accepted)  # type: ignore[arg-type]
    assert sides == 2 or set(released.tolist()) == {OPEN}


def test_each_solve_with_an_active_set_counts_and_starts_do_not() -> None:
    history = History()
    record = history.attempt(1.0, lambda: "condensed-newton", [])
    for number in (1, 2, 1, 1, 0, 1):  # solved, solved again twice with other gaps, and once by iterations
        record(Step(number, 0.0, 3))
    assert count_iterations(history.rows) == 5
