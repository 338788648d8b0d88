"""Scripts step through histories, laws and results as scene files do."""

import inspect
import pickle
import runpy
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import matplotlib
import numpy as np
import pytest
from matplotlib import image
from numpy.testing import assert_allclose, assert_array_equal

import stickslip
from shared.cases import every_nth
from shared.command import LIMIT, result
from shared.histories import FOUR
from stickslip.geometry.amplitude import Amplitude
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.scene.loads import Direction
from stickslip.solvers.simulation.script import Script
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.stepper import StepError
from stickslip.workflows.lab.studies import block_from_python, shear_until_it_slips
from stickslip.workflows.lab.verification.cases.sheared_column import COLUMN, TABLE
from stickslip.workflows.lab.verification.cases.sheared_column import TOP as TO_AND_FRO
from stickslip.workflows.lab.verification.cases.sheared_column import scene as column
from stickslip.workflows.scene_file.read import from_dict, read, to_dict


def script() -> stickslip.Scene:
    size = 0.5
    return stickslip.Scene(
        title="Block pressed on a rigid foundation, then pushed sideways",
        model="plane strain",
        geometry=stickslip.Block(length=4.0, height=2.0, mesh_size=size, contact_mesh_size=size / 2),
        bodies={"block": stickslip.Material(E=1.0, nu=0.3)},
        obstacles={"foundation": stickslip.Plane(point=(0.0, 0.0), normal=(0.0, 1.0))},
        contacts={
            "base": stickslip.Contact(surface="block.bottom", against="foundation", friction=stickslip.Coulomb(mu=0.3))
        },
        supports={"top": stickslip.Support(boundary="block.top", displacement=TOP)},
        probes={"corner": stickslip.Probe(point=(0.0, 2.0))},
        steps=stickslip.Steps(end=2.0, count=2),
    )


TOP: Mapping[Direction, Amplitude] = {"x": ((0.0, 0.0), (1.0, 0.0), (2.0, 0.05)), "y": ((0.0, 0.0), (1.0, -0.1))}


@pytest.fixture(scope="module")
def ready() -> stickslip.Scene:
    return stickslip.read("block", ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25"])


def test_study_of_twenty_lines_builds_solves_and_draws_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = Path(inspect.getfile(block_from_python))
    assert len(study.read_text(encoding="utf-8").splitlines()) <= 20
    matplotlib.use("Agg")
    monkeypatch.chdir(tmp_path)
    left = runpy.run_path(str(study), run_name="__main__")
    block = stickslip.read("block")
    scene = left["scene"]  # says nothing of rest at t = 0, which goes without saying: the answer below is the same
    assert scene == replace(block, title="", probes={}, supports=scene.supports)
    (last,) = list(stickslip.steps(block))[1:]
    base = left["step"].contacts["base"]
    assert_allclose(base.pressure, last.contacts["base"].pressure, rtol=0, atol=1e-12)  # a probe changes nothing
    assert 0 < base.stick_area < 4.0
    drawn = image.imread(tmp_path / "pressure.png")
    assert len({tuple(pixel) for row in drawn for pixel in row}) > 10  # a sheet that is empty has few colours
    assert [path.name for path in tmp_path.iterdir()] == ["pressure.png"]


def test_script_of_twenty_lines_says_what_the_file_says(ready: stickslip.Scene) -> None:
    assert len(inspect.getsource(script).splitlines()) <= 20
    assert script() == ready


def test_script_and_file_have_the_same_answer_step_by_step(ready: stickslip.Scene) -> None:
    for mine, theirs in zip(stickslip.steps(script()), stickslip.steps(ready), strict=True):
        assert mine.time == theirs.time
        assert (mine.displacement == theirs.displacement).all()  # the same arithmetic: bit by bit
        assert (mine.p == theirs.p).all()
        base = mine.contacts["base"]
        assert_allclose(base.force + mine.supports["top"][0], 0, atol=1e-12 * base.normal_force)
        assert 0 < base.tangential_force < 0.3 * base.normal_force  # it does not slide as a whole


def test_steps_are_solved_one_at_a_time_as_they_are_asked_for(ready: stickslip.Scene) -> None:
    simulation = stickslip.prepare(ready)
    steps = simulation.steps()
    assert next(steps).time == 1.0
    solved = simulation.counters.volume_solves
    assert next(steps).time == 2.0
    assert simulation.counters.volume_solves > solved


def test_what_the_steps_give_does_not_change_under_the_reader(ready: stickslip.Scene) -> None:
    steps = stickslip.steps(ready)
    first = next(steps)
    kept = first.displacement.copy(), first.contacts["base"].pressure.copy()
    list(steps)
    assert (first.displacement == kept[0]).all()
    assert (first.contacts["base"].pressure == kept[1]).all()


def test_scene_survives_the_way_through_plain_data() -> None:
    assert from_dict(to_dict(script())) == script()


def test_nouns_refuse_nonsense_as_the_file_does() -> None:
    with pytest.raises(stickslip.StickslipError, match=r"nu = 0\.51: must lie above -1, and not above 0\.5"):
        stickslip.Material(E=1.0, nu=0.51)
    with pytest.raises(stickslip.StickslipError, match=r"did you mean block\.bottom"):
        stickslip.Scene(
            model="plane strain",
            geometry=stickslip.Block(length=1.0, height=1.0, mesh_size=0.5),
            bodies={"block": stickslip.Material(E=1.0, nu=0.3)},
            obstacles={"floor": stickslip.Plane(point=(0.0, 0.0), normal=(0.0, 1.0))},
            contacts={"base": stickslip.Contact(surface="block.botom", against="floor")},
        )


def test_what_every_script_calls_is_public() -> None:
    assert {"read", "run", "steps"} <= set(stickslip.__all__)


def test_first_use_outside_the_main_thread(tmp_path: Path) -> None:
    program = (
        f"import threading, stickslip; found, scene = [], lambda: stickslip.read('block', {FOUR!r})\n"
        "thread = threading.Thread(target=lambda: found.append(stickslip.run(scene(), 'out')[0].status))\n"
        "thread.start(); thread.join(); assert found == ['converged'], found\n"
        "stickslip.prepare(scene())\n"  # and then in the main one
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=LIMIT, check=False
    )
    assert done.returncode == 0, done.stderr


def test_results_and_scenes_can_be_pickled() -> None:
    scene = read("block", FOUR)
    simulation = stickslip.prepare(scene)
    step = next(simulation.steps())
    for one in (scene, step, simulation.data):
        again = pickle.loads(pickle.dumps(one))
        assert type(again) is type(one)
    again = pickle.loads(pickle.dumps(step))
    assert again.contacts["base"].normal_force == step.contacts["base"].normal_force
    assert np.array_equal(again.displacement, step.displacement)
    assert pickle.loads(pickle.dumps(scene)) == scene


@dataclass(frozen=True, kw_only=True)
class Odd(stickslip.Obstacle):
    """An obstacle whose formulas are wrong."""

    far: str
    long: str
    shape: Annotated[Literal["odd"], stickslip.Key("-", "kind of obstacle")] = "odd"

    def distance(self, x: Any, sqrt: Callable[[Any], Any]) -> Any:
        return 0.0 * x[1] + float(self.far)

    def normals(self, points: Array) -> Array:
        return np.tile([0.0, float(self.long)], (len(points), 1))


stickslip.Obstacle.kinds.remove(Odd)  # no other test knows it


@pytest.mark.parametrize(
    ("far", "long", "said"),
    [
        (np.nan, 1.0, "distance is nan"),
        (np.inf, 1.0, "distance is inf"),
        (0.0, np.nan, "nan long"),
        (0.0, 2.0, "2 long"),
    ],
)
def test_obstacle_without_a_distance_is_named(far: float, long: float, said: str) -> None:
    scene = replace(read("block", FOUR), obstacles={"foundation": Odd(far=str(far), long=str(long))})
    with pytest.raises(SceneError, match=rf"obstacle Odd: at \(.*\).*{said}.*expected a number, and a unit vector"):
        list(stickslip.steps(scene))


COARSE = ["geometry.mesh_size=1.0", "geometry.contact_mesh_size=0.5"]
PLANE = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
SIDE = {"boundary": "block.left"}
SHANK = {"body": "block", "shank": [[2.0, 0.5], [2.0, 1.5]]}
ACROSS = {"head": "block.left", "nut": "block.right", "axis": [-1.0, 0.0], "stiffness": 0.1}
HEAVY = {"bodies": {"block": {"E": 1.0, "nu": 0.3, "density": 1.0}}}
BASE = {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": 0.3}}
DRIVEN: dict[str, dict[str, Any]] = {  # what is changed at t = 2 and 3, and the scene that says so
    "support": {"supports": {"top": {"x": (0.05, -0.02)}}},
    "normal support": {"supports": {"top": {"normal": (-0.05, -0.2)}}},
    "pressure": {"loads": {"side": {"pressure": (0.01, 0.0)}}},
    "traction": {"loads": {"side": {"x": (0.01, -0.01)}}},
    "force": {"loads": {"side": {"x": (0.02, 0.01)}}},
    "obstacle": {"obstacles": {"foundation": {"x": (-0.05, 0.01), "y": (0.01, 0.0)}}},
    "force on obstacle": {"obstacles": {"foundation": {"y": (0.2, 0.3)}}},
    "rotation": {"obstacles": {"foundation": {"angle": (0.01, 0.0)}}},
    "gravity": {"gravity": {"": {"y": (-0.02, -0.01)}}},
    "speed": {"centrifugal": {"": {"speed": (0.1, 0.05)}}},
    "body force": {"body_force": {"block": {"x": (0.01, -0.005)}}},
    "temperature": {"thermal": {"block": {"temperature": (20.0, 10.0)}}},
    "spring": {"springs": {"rope": {"x": (0.05, -0.02)}}},
    "plunger": {"plungers": {"stop": {"preload": (0.03, 0.01)}}},
    "remote point": {"remote_points": {"hub": {"x": (0.02, -0.01)}}},
    "bolt": {"bolts": {"m8": {"shortening": (0.02, 0.01)}}},
    "bolt by force": {"bolts": {"m8": {"force": (0.02, 0.01)}}},
    "gap": {"contacts": {"base": {"gap_offset": (-0.01, 0.01)}}},
    "map of the gap": {"contacts": {"base": {"plus": (-0.01, 0.01)}}},
    "slide": {"contacts": {"base": {"slide": (0.02, 0.01)}}},
}
TABLES: dict[str, Any] = {  # the tables of each that are not those of the ready block; None is what changes
    "normal support": {"supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "normal": None}}}},
    "pressure": {"loads": {"side": {"boundary": "block.left", "pressure": None}}},
    "traction": {"loads": {"side": {"boundary": "block.left", "traction": [None, 0.0]}}},
    "force": {"loads": {"side": {"boundary": "block.left", "force": [None, 1e-3]}}},
    "obstacle": {"obstacles": {"foundation": PLANE | {"displacement": {"x": None, "y": None}}}},
    "force on obstacle": {"obstacles": {"foundation": PLANE | {"force": {"y": None}}}},
    "rotation": {"obstacles": {"foundation": PLANE | {"rotation": {"point": [0.0, -5.0], "angle": None}}}},
    "gravity": HEAVY | {"gravity": {"acceleration": [0.0, None]}},
    "speed": HEAVY | {"centrifugal": {"speed": None}},
    "body force": {"body_force": {"block": {"force": [None, 0.0]}}},
    "temperature": {"thermal": {"block": {"expansion": 1e-3, "temperature": None}}},
    "spring": {"springs": {"rope": {"at": "block.left", "stiffness": [0.1, 0.1], "displacement": [None, 0.0]}}},
    "plunger": {"plungers": {"stop": SIDE | {"direction": [1.0, 0.0], "stiffness": 0.1, "preload": None}}},
    "remote point": {
        "remote_points": {
            "hub": SIDE | {"point": [0.0, 1.0], "coupling": "distributing", "force": {"x": None}, "moment": {"z": 0.01}}
        }
    },
    "bolt": {"bolts": {"m8": SHANK | {"shortening": None}}},
    "bolt by force": {"bolts": {"m8": ACROSS | {"force": None}}},
    "gap": {"contacts": {"base": BASE | {"gap_offset": None}}},
    "slide": {"contacts": {"base": BASE | {"slide": None, "wear": {"k": 0.5}}}},
    "map of the gap": {
        "contacts": {"base": BASE | {"gap_offset": {"over": ["x"], "rows": [[0.0, 0.0], [4.0, 0.01]], "plus": None}}}
    },
}
AT_ONE = {"support": 0.0, "normal support": -0.1, "obstacle": 0.02, "force on obstacle": 0.1}  # else 0.005


def scene_of(case: str, value: Callable[[str], Any]) -> stickslip.Scene:
    """The block, with `value(component)` for what the case changes."""

    def filled(plain: Any, key: str = "") -> Any:
        if isinstance(plain, dict):
            return {k: filled(v, k) for k, v in plain.items()}
        if isinstance(plain, list):
            return [filled(v, "xy"[i]) for i, v in enumerate(plain)]
        return value(key) if plain is None else plain

    top = {"x": None if case == "support" else 0.0, "y": 0.0 if "obstacle" in case else [[1, -0.1]]}
    tables = {
        "model": "plane strain",
        "geometry": {"builder": "block", "length": 4.0, "height": 2.0, "mesh_size": 1.0, "contact_mesh_size": 0.5},
        "bodies": {"block": {"E": 1.0, "nu": 0.3}},
        "obstacles": {"foundation": PLANE},
        "contacts": {"base": BASE},
        "supports": {"top": {"boundary": "block.top", "displacement": top}},
        "steps": {"end": 3.0, "count": 3},
    }
    return from_dict(filled(tables | TABLES.get(case, {})))


def assert_same(mine: stickslip.StepResult, theirs: stickslip.StepResult) -> None:
    """The same arithmetic, bit by bit."""
    assert mine.time == theirs.time
    for key in ("displacement", "stress", "p", "w"):
        assert_array_equal(getattr(mine, key), getattr(theirs, key))
    assert mine.energy.external == theirs.energy.external
    assert mine.energy.dissipated == theirs.energy.dissipated
    assert_array_equal(mine.contacts["base"].slip, theirs.contacts["base"].slip)
    assert mine.iterations == theirs.iterations


@pytest.mark.parametrize("case", DRIVEN)
def test_scripted_values_are_those_of_a_scene_that_lists_them(case: str) -> None:
    first = AT_ONE.get(case, 0.005)
    said = {part: v for of in DRIVEN[case].values() for parts in of.values() for part, v in parts.items()}
    alone = next(iter(said.values()))
    listed = scene_of(case, lambda c: [[1, first], [2, said.get(c, alone)[0]], [3, said.get(c, alone)[1]]])
    expected = list(stickslip.steps(listed))
    simulation = stickslip.prepare(scene_of(case, lambda c: [[1, first]]))
    prepared = simulation.counters.factorisations
    script = simulation.script()
    assert_same(script.step(to=1.0), expected[0])
    for k, theirs in enumerate(expected[1:]):
        now: dict[str, Any] = {
            t: {n: {c: v[k] for c, v in of.items()} for n, of in all_of.items()} for t, all_of in DRIVEN[case].items()
        }
        now = {table: values.get("", values) for table, values in now.items()}
        mine = script.step(to=theirs.time, **now)
        assert_same(mine, theirs)
        assert [u.tolist() for u, *_ in mine.obstacles.values()] == [u.tolist() for u, *_ in theirs.obstacles.values()]
    assert simulation.counters.factorisations == prepared == 1
    assert abs(expected[2].p - expected[1].p).max() > 1e-3 * expected[1].p_ref  # what was changed matters


def test_a_component_of_several_keys_is_named_with_its_key() -> None:
    """A hub with force and moment about z in space; a gap that a script opens is in the scene that repeats it."""
    base = BASE | {"gap_offset": 0.01}
    tables = {
        "model": "3d",
        "geometry": {"builder": "block", "length": 1.0, "width": 1.0, "height": 1.0, "mesh_size": 0.5},
        "bodies": {"block": {"E": 1.0, "nu": 0.3}},
        "obstacles": {"foundation": {"shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}},
        "contacts": {"base": base},
        "supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0, "z": [[1, -0.1]]}}},
        "remote_points": {
            "hub": SIDE
            | {"point": [0.0, 0.5, 0.5], "coupling": "distributing"}
            | {"force": {"z": [[1, 0.0]]}, "moment": {"z": [[1, 0.0]]}}
        },
        "steps": {"end": 2.0, "count": 2},
    }
    script = stickslip.prepare(from_dict(tables)).script()
    script.step(to=1.0)
    with pytest.raises(stickslip.SceneError, match=r"hub\.z = 0\.1: the scene prescribes only force\.z, moment\.z"):
        script.step(to=2.0, remote_points={"hub": {"z": 0.1}})
    step = script.step(to=2.0, remote_points={"hub": {"moment": {"z": 0.01}}}, contacts={"base": {"gap_offset": 0.02}})
    assert_allclose(step.remote_points["hub"].moment, [0.0, 0.0, 0.01], atol=1e-15)
    assert_same(list(stickslip.steps(script.scene))[-1], step)
    assert script.scene.contacts["base"].gap_offset == ((0.0, 0.01), (1.0, 0.01), (2.0, 0.02))


def test_a_column_is_driven_to_and_fro_by_closed_loop_as_its_closed_form_says() -> None:
    """The table of the exact states, the top's next place not known before the step before is solved."""
    rest = column(dim=2, method="condensed-newton", E=2600.0, friction=stickslip.Coulomb(mu=0.3), path=np.zeros((1, 1)))
    script = stickslip.prepare(rest).script()
    script.step(to=1.0)
    for k, x in enumerate(TO_AND_FRO):
        base = script.step(to=script.time + 0.5, supports={"top": {"x": x}}).contacts["base"]
        assert_allclose(base.traction[:, 0], -TABLE.tau[k], atol=1e-9)
        assert_allclose(base.slip[:, 0], TABLE.slip[k], atol=1e-12)
        assert_allclose(base.dissipation_total, TABLE.dissipation[k], atol=1e-11)
        assert (base.slip_area > 0) == (abs(TABLE.tau[k]) == COLUMN.bound)


def shear(script: Script, count: int) -> list[stickslip.StepResult]:
    """To the right, and once friction bears more than it does now, to the left."""
    found, x, push = [script.step(to=0.5), script.step(to=1.0)], 0.0, 0.03
    for _ in range(count):
        x += push
        found.append(script.step(to=script.time + 0.25, supports={"top": {"x": x}}))
        if found[-1].contacts["base"].slip_area > 0.5 * found[-1].contacts["base"].contact_area:
            push = -abs(push)
    return found


def test_what_a_script_has_done_is_a_scene_that_repeats_it() -> None:
    """Also what the scene prescribes by bare numbers, which mean another thing with another last time."""
    ready = stickslip.read("block", COARSE)
    gravity = {"gravity": stickslip.Gravity(acceleration=(0.0, -1e-3))}
    bodies = {"block": stickslip.Material(E=1.0, nu=0.3, density=1.0)}
    script = stickslip.prepare(replace(ready, sections=gravity, bodies=bodies)).script()
    done = shear(script, 8)
    assert {np.sign(b.contacts["base"].slip_increment[:, 0].sum()) for b in done} >= {1.0, -1.0}  # it went both ways
    again = list(stickslip.steps(script.scene))
    assert len(again) == len(done) == 10
    for mine, theirs in zip(done, again, strict=True):
        assert_same(mine, theirs)
    with pytest.raises(stickslip.StickslipError, match="no step yet"):
        _ = stickslip.prepare(ready).script().scene


def test_a_script_that_changes_nothing_goes_as_the_scene_says_and_disturbs_no_other() -> None:
    scene = stickslip.read("block", COARSE)
    simulation = stickslip.prepare(scene)
    expected = list(simulation.steps())
    plain, sheared = simulation.script(), simulation.script()
    for theirs in expected:  # one by one in turn
        sheared.step(to=theirs.time, supports={"top": {"x": -0.05 * theirs.time}})
        assert_same(plain.step(to=theirs.time), theirs)
    for mine, theirs in zip(simulation.steps(), expected, strict=True):
        assert_same(mine, theirs)
    assert simulation.counters.factorisations == 1


def test_what_was_named_once_stays_and_may_be_named_again_later() -> None:
    script = stickslip.prepare(stickslip.read("block", COARSE)).script()
    for to, named in ((1.0, {}), (1.5, {"x": 0.01}), (2.5, {}), (4.0, {"x": 0.04})):
        step = script.step(to=to, supports={"top": named})
        corner = {1.0: 0.0, 1.5: 0.01, 2.5: 0.01, 4.0: 0.04}[to]  # the scene's own table says 0.05 from t = 2 on
        assert step.probes["corner"][0][0] == pytest.approx(corner, abs=1e-15)
    assert script.scene.supports["top"].displacement["x"] == ((1.0, 0.0), (1.5, 0.01), (2.5, 0.01), (4.0, 0.04))


def test_a_step_hits_the_times_that_the_scene_lists_on_the_way() -> None:
    """One step does what the scene's own steps do: friction remembers the way there, and tells it by its forces."""
    ready = stickslip.read("block", COARSE)
    path: dict[Any, Any] = {"x": ((1.0, 0.0), (2.0, 0.08), (4.0, -0.02)), "y": ((0.0, -0.05), (1.0, -0.1))}
    gravity = {"gravity": stickslip.Gravity(acceleration=(0.0, -1e-3))}  # whose ramp ends at t = 3, as `steps` says
    scene = replace(
        ready,
        bodies={"block": stickslip.Material(E=1.0, nu=0.3, density=1.0)},
        sections=gravity,
        supports={"top": replace(ready.supports["top"], displacement=path)},
        steps=stickslip.Steps(end=3.0),
    )
    heavy = {"gravity": stickslip.Gravity(acceleration=(0.0, ((3.0, -1e-3),)))}
    expected = list(stickslip.steps(replace(scene, sections=heavy, steps=stickslip.Steps(end=4.0))))
    script = stickslip.prepare(scene).script()
    seen: list[float] = []
    step = script.step(to=4.0, on_iteration=lambda row: seen.append(row.time))
    assert [theirs.time for theirs in expected] == sorted(set(seen)) == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert_allclose(step.p, expected[-1].p, atol=1e-9 * step.p_ref)  # gravity's ramp rounds otherwise
    base = step.contacts["base"]
    assert base.dissipation == base.dissipation_total > expected[-1].contacts["base"].dissipation
    for key in ("substeps", "iterations", "volume_solves"):
        assert getattr(step, key) == sum(getattr(theirs, key) for theirs in expected)
    assert [row[0] for row in step.history] == seen
    short: dict[Any, Any] = {"x": ((4.0, -0.02),), "y": ((4.0, -0.1),)}
    jump = replace(scene, supports={"top": replace(ready.supports["top"], displacement=short)})
    leap = stickslip.prepare(jump).script().step(to=4.0)
    assert abs(leap.contacts["base"].force[0] - base.force[0]) > 0.05 * abs(base.force[0])  # the way matters
    again = list(stickslip.steps(script.scene))
    assert_same(replace(again[-1], iterations=step.iterations), step)


@pytest.mark.parametrize("named", [{}, {"x": -0.02}])
def test_listed_times_are_those_of_the_scene_file_bit_by_bit(named: dict[str, float]) -> None:
    """What is named goes along its straight line meanwhile."""
    ready = stickslip.read("block", COARSE)
    x = ((2.0, 0.04), (4.0, -0.02))
    listed: dict[Any, Any] = {"x": ((1.0, -0.005), (2.0, -0.01), (4.0, -0.02)) if named else x}
    pressed: dict[Any, Any] = {"y": ((1.0, -0.1), (2.0, -0.08))}
    top = ready.supports["top"]
    file, mine = (
        replace(ready, supports={"top": replace(top, displacement=way | pressed)}, steps=stickslip.Steps(end=4.0))
        for way in (listed, {"x": x})
    )
    expected = list(stickslip.steps(file))
    script = stickslip.prepare(mine).script()
    step = script.step(to=4.0, supports={"top": named})
    assert_same(replace(step, iterations=expected[-1].iterations), expected[-1])
    again = list(stickslip.steps(script.scene))
    assert len(again) == len(expected) == 3
    for one, other in zip(again, expected, strict=True):
        assert_same(one, other)


def pushed(pressed_at: float, hand: Amplitude) -> stickslip.Scene:
    """The block under a lid, which presses by .1 Pa on 4 m: friction bears .12 N against a hand."""
    loads = {
        "lid": stickslip.Load(boundary="block.top", pressure=((pressed_at, 0.1),)),
        "hand": stickslip.Load(boundary="block.left", force=(hand, 0.0)),
    }
    return replace(stickslip.read("block", COARSE), supports={}, loads=loads, probes={})


def test_a_step_that_fails_on_the_way_leaves_all_as_it_was() -> None:
    """The scene's hand pushes harder than friction bears at t = 2, and less at t = 3."""
    script = stickslip.prepare(pushed(0.5, ((1.0, 0.1), (2.0, 0.13), (3.0, 0.05)))).script()
    with pytest.raises(StepError, match="cannot balance the loads"):
        script.step(to=3.0)
    assert script.time == 0.0
    with pytest.raises(stickslip.StickslipError, match="no step yet"):
        _ = script.scene
    found = script.step(to=3.0, loads={"hand": {"x": 0.05}})
    assert [t for t, _ in script.scene.loads["lid"].pressure] == [0.5, 3.0]
    assert_allclose(found.contacts["base"].force, [-0.05, 0.4], atol=1e-9)


def test_a_step_that_fails_leaves_all_as_it_was() -> None:
    """Pushed harder than friction can bear: no equilibrium; the script tries less, as if nothing had happened."""
    scene, holds, moves = pushed(1.0, ((1.0, 0.0),)), 0.11, 0.13  # [N]
    simulation = stickslip.prepare(scene)
    script = simulation.script()
    script.step(to=1.0)
    with pytest.raises(StepError, match=r"cannot balance the loads: bodies\.block moves along x"):
        script.step(to=2.0, loads={"hand": {"x": moves}})
    assert script.time == 1.0
    found = script.step(to=2.0, loads={"hand": {"x": holds}})
    assert_allclose(found.contacts["base"].force, [-holds, 0.4], atol=1e-9)
    straight = stickslip.prepare(scene).script()
    straight.step(to=1.0)
    assert_allclose(straight.step(to=2.0, loads={"hand": {"x": holds}}).p, found.p, atol=1e-9 * found.p_ref)


@pytest.mark.parametrize("method", ["regularised", "surface-uzawa"])
def test_every_kind_of_method_sees_what_a_script_says(method: str) -> None:
    scene = stickslip.read("block", [*COARSE, f'solver.method="{method}"', "solver.tolerance=1e-10"])
    script = stickslip.prepare(scene).script()
    script.step(to=1.0)
    step = script.step(to=2.0, supports={"top": {"x": -0.05}})
    (_, expected) = stickslip.steps(scene)
    shear, other = step.contacts["base"].force[0], expected.contacts["base"].force[0]
    assert shear > 0 > other  # the scene pushes to the right; as the block is symmetric, only the sign changes
    assert_allclose(shear, -other, rtol=0.02)  # the mesh is not symmetric


def test_pairs_that_slide_follow_a_script() -> None:
    coarse = ["geometry.mesh_size=0.5", "geometry.lower_mesh_size=0.4"]
    scene = stickslip.read("sliding", [*coarse, "steps.count=4"])
    pressed = replace(scene.supports["drive"], displacement={"x": ((1.0, 0.0),), "y": ((1.0, -0.01),)})
    script = stickslip.prepare(replace(scene, supports={**scene.supports, "drive": pressed})).script()
    for theirs in stickslip.steps(scene):
        x = max(0.0, 0.5 * (theirs.time - 1.0))
        mine = script.step(to=theirs.time, supports={"drive": {"x": x}})
        assert_allclose(mine.displacement, theirs.displacement, atol=1e-12)
        assert_allclose(mine.contacts["joint"].normal_force, theirs.contacts["joint"].normal_force, rtol=1e-9)
    assert mine.contacts["joint"].max_slip > 0.4


@pytest.fixture(scope="module")
def moved() -> stickslip.Simulation:
    """The block with supports and loads that a script may change, and some that it may not."""
    ready = stickslip.read("block", COARSE)
    wind = stickslip.Load(boundary="block.left", traction=(((1.0, 0.0),), 0.0))
    calm = stickslip.Load(boundary="block.right", traction=(0.0, 0.0))
    corner = stickslip.Support(point=(0.0, 2.0), displacement={"x": ready.supports["top"].displacement["x"]})
    return stickslip.prepare(
        replace(ready, loads={"wind": wind, "calm": calm}, supports={**ready.supports, "corner": corner})
    )


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"to": 1.0}, r"to = 1\.0: expected a time after 1"),
        ({"to": float("nan")}, "to = nan: expected a number"),
        ({"to": 2.0, "supports": {"tip": {"x": 0.0}}}, r"supports\.tip: nothing there .* did you mean top\?"),
        ({"to": 2.0, "supports": {"top": {"z": 0.1}}}, r"supports\.top\.z = 0\.1: the scene prescribes only x, y"),
        ({"to": 2.0, "supports": {"top": {"x": float("inf")}}}, r"supports\.top\.x = inf: expected a number"),
        ({"to": 2.0, "supports": {"top": {"x": "far"}}}, r"supports\.top\.x = 'far': expected a number"),
        ({"to": 2.0, "supports": {"top": {"x": True}}}, r"supports\.top\.x = True: expected a number"),
        ({"to": 2.0, "supports": {"top": {"x": [0.1]}}}, r"supports\.top\.x = \[0\.1\]: expected a number"),
        ({"to": 2.0, "supports": {"top": {"x": np.eye(4)}}}, r"supports\.top\.x = array.*: expected a number"),
        ({"to": 2.0, "supports": {"top": {"x": 10**400}}}, r"supports\.top\.x = 1000.*: expected a number"),
        ({"to": 2.0, "supports": {"top": 0.1}}, r"supports\.top = 0\.1: expected { component: number }"),
        ({"to": 2.0, "supports": [0.1]}, r"supports = \[0\.1\]: expected { name: { component: number } }"),
        ({"to": 2.0, "supports": {1: {"x": 0.1}}}, r"supports\.1: nothing there"),
        ({"to": "3"}, "to = '3': expected a number"),
        ({"to": True}, "to = True: expected a number"),
        ({"to": None}, "to = None: expected a number"),
        ({"to": 1e308}, "expected at most 1e"),
        ({"to": 2.0, "on_iteration": 3}, "on_iteration = 3: expected a function"),
        ({"to": 2.0, "loads": {"wind": {"y": 1.0}}}, r"loads\.wind\.y = 1\.0: the scene prescribes only x,"),
        ({"to": 2.0, "loads": {"wind": {"pressure": 1.0}}}, r"loads\.wind\.pressure = 1\.0: the scene"),
        ({"to": 2.0, "obstacles": {"foundation": {"x": 1.0}}}, r"foundation: has no displacement, .* must name one"),
        ({"to": 2.0, "obstacles": {"foundatoin": {"x": 1.0}}}, r"nothing there .* did you mean foundation\?"),
        ({"to": 2.0, "gravty": {"y": 1.0}}, r"gravty: nothing there to change"),
        ({"to": 2.0, "gravity": {"y": 1.0}}, r"gravity: nothing there to change"),
        ({"to": 2.0, "supports": {"top": {"displacement": {"z": 1.0}}}}, r"top\.displacement\.z = 1\.0: the scene"),
        ({"to": 2.0, "contacts": {"base": {"plus": 1.0}}}, r"contacts\.base\.plus: nothing there to change"),
        ({"to": 2.0, "loads": {"calm": {"x": 1.0}}}, r"loads\.calm: has no traction, .* must name one"),
        ({"to": 2.0, "supports": {"top": {"x": 0.1}, "corner": {"x": 0.0}}}, r"contradict each other"),
    ],
)
def test_what_cannot_be_changed_is_refused_in_one_line_and_changes_nothing(
    wrong: dict[str, Any], text: str, moved: stickslip.Simulation
) -> None:
    script = moved.script()
    before = script.step(to=1.0)
    with pytest.raises(stickslip.StickslipError, match=text) as error:
        script.step(**wrong)
    assert "\n" not in str(error.value)
    after = script.step(to=1.5)  # as the scene says: half way to 0.05
    assert after.time == 1.5
    assert after.supports["top"][0][0] > abs(before.supports["top"][0][0])


@pytest.mark.slow  # it is long: shorter ones stand above
def test_study_of_twenty_lines_shears_a_block_until_it_slips(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = Path(inspect.getfile(shear_until_it_slips))
    assert len(study.read_text(encoding="utf-8").splitlines()) <= 20
    monkeypatch.chdir(tmp_path)
    left = runpy.run_path(str(study), run_name="__main__")
    simulation, turns = left["simulation"], left["turns"]
    assert simulation.counters.factorisations == 1
    for step, sign in zip(turns, (-1, 1), strict=True):
        base = step.contacts["base"]
        # all slips, so friction bears mu times the normal force, against the push; the solver's 1e-8 and a digit
        assert_allclose(base.force[0], sign * 0.3 * base.normal_force, rtol=1e-7)
        assert base.slip_area == base.contact_area
        assert (sign * base.slip_increment[:, 0] <= 0).all()
    written = result(tmp_path / "results" / "shear")
    assert written["status"] == "converged"
    last = written["steps"][-1]["contacts"]["base"]
    assert last["force"] == left["base"].force.tolist()  # what was written is what was scripted


COARSER = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25", "output.error=false"]
TRESCA = "contacts.base.friction={law='tresca', bound=[[0, 0], [1, 0.02], [2, 0.01], [3, 0.03]]}"


def prepared(*sets: str) -> Simulation:
    return stickslip.prepare(read("block", [*COARSER, *sets]))


def test_after_a_drop_of_friction_the_force_is_that_of_the_new_coefficient() -> None:
    simulation = prepared("contacts.base.friction.mu=0.4")
    script = simulation.script()
    script.step(to=1.0)
    pulled = script.step(to=2.0, supports={"top": {"x": 0.3}}).contacts["base"]
    assert pulled.stick_area == 0
    assert_allclose(pulled.tangential_force, 0.4 * pulled.normal_force, rtol=1e-6)
    for mu in (0.1, 0.2):  # it slides back, and on
        let = script.step(to=script.time + 1, contacts={"base": {"mu": mu}}, supports={"top": {"x": 0.3 * script.time}})
        base = let.contacts["base"]
        assert base.stick_area == 0
        assert_allclose(base.tangential_force, mu * base.normal_force, rtol=1e-6)
    assert simulation.counters.factorisations == 1
    with pytest.raises(stickslip.SceneError, match="parameters of contacts have changed"):
        script.scene  # noqa: B018
    again, (*_, last) = simulation.script().step(to=2.0), simulation.steps()  # the scene's own laws
    assert again.contacts["base"].tangential_force == last.contacts["base"].tangential_force


def test_bound_in_time_is_that_of_a_scene_that_lists_it() -> None:
    listed = [*prepared(TRESCA, "steps.end=3", "steps.count=3").steps()]
    script = prepared(TRESCA.replace("[2, 0.01], [3, 0.03]", "[2, 0.02]"), "steps.end=3", "steps.count=3").script()
    script.step(to=1.0)
    for step, bound in zip(listed[1:], (0.01, 0.03), strict=True):
        found = script.step(to=step.time, contacts={"base": {"bound": bound}})
        assert_allclose(found.contacts["base"].force, step.contacts["base"].force, rtol=1e-12, atol=1e-15)
    assert script.scene.contacts["base"].friction.bound[-1] == (3.0, 0.03)


@pytest.mark.parametrize("method", every_nth(3, METHODS))
def test_every_method_goes_on_with_other_friction_and_another_gap(method: str) -> None:
    """T = mu N with the new mu; and without friction a gap .1 smaller doubles the force of a support .1 down."""
    sets = [f'solver.method="{method}"', "solver.tolerance=1e-5"]
    script = prepared(*sets, "contacts.base.friction.mu=0.3").script()
    script.step(to=1.0)
    script.step(to=2.0, supports={"top": {"x": 0.3}})
    let = script.step(to=3.0, contacts={"base": {"mu": 0.1}}, supports={"top": {"x": 0.6}}).contacts["base"]
    assert_allclose(let.tangential_force, 0.1 * let.normal_force, rtol=1e-3)
    smooth = prepared(*sets, "contacts.base.friction.mu=0.0", "supports.top.displacement={x=0.0, y=-0.1}").script()
    once = smooth.step(to=2.0).contacts["base"].normal_force
    twice = smooth.step(to=3.0, contacts={"base": {"gap_offset": -0.1}}).contacts["base"].normal_force
    assert_allclose(twice, 2 * once, rtol=1e-3)


@pytest.mark.parametrize("method", ["auto", "regularised"])
@pytest.mark.parametrize("normal", ["{law='unilateral'}", "{law='compliance', c_n=1.0, m_n=1.0}"])
def test_gap_offset_presses_like_the_motion_of_the_support(normal: str, method: str) -> None:
    sets = [f"contacts.base.normal={normal}", f'solver.method="{method}"']
    still = prepared(*sets, "supports.top.displacement={x=0.0, y=0.0}").script()
    still.step(to=1.0)
    by_offset = still.step(to=2.0, contacts={"base": {"gap_offset": -0.1}}).contacts["base"]
    moved = prepared(*sets, "supports.top.displacement={x=0.0, y=-0.1}").script()
    by_support = moved.step(to=2.0).contacts["base"]
    assert by_support.normal_force > 0
    assert_allclose(by_offset.normal_force, by_support.normal_force, rtol=1e-10)


def test_pairs_that_were_searched_stay_when_laws_change() -> None:
    """A block is drawn over the end of another one, which rests on a floor: coefficients change by nothing."""
    friction = {"law": "coulomb", "mu": 0.3}
    drawn = {"x": [[1.0, 0.0], [4.0, 0.3]], "y": [[1.0, -1e-3], [4.0, -1e-3]]}
    blocks = {"builder": "two_blocks", "length": 1.0, "lower_length": 1.1, "height": 0.5}
    scene = from_dict(
        {
            "model": "plane strain",
            "geometry": blocks | {"mesh_size": 0.125, "lower_mesh_size": 0.1},
            "bodies": {"upper": {"E": 1e9, "nu": 0.3}, "lower": {"E": 1e9, "nu": 0.3}},
            "obstacles": {"floor": {"shape": "plane", "point": [0.0, -0.5], "normal": [0.0, 1.0]}},
            "contacts": {
                "joint": {"surface": "upper.bottom", "against": "lower.top", "friction": friction, "sliding": True},
                "base": {"surface": "lower.bottom", "against": "floor", "friction": friction | {"mu": 0.5}},
            },
            "supports": {"top": {"boundary": "upper.top", "displacement": drawn}},
            "steps": {"end": 4.0, "count": 4},
        }
    )
    simulation = stickslip.prepare(scene)
    script, other = simulation.script(), simulation.script()
    for time in (1.0, 2.0, 3.0, 4.0):
        more = 1 + 1e-13 * max(time - 2.0, 0.0)
        mine = script.step(to=time, contacts={"joint": {"mu": 0.3 * more}, "base": {"mu": 0.5 * more}})
        theirs = other.step(to=time)
        for name, contact in mine.contacts.items():
            assert_allclose(contact.force, theirs.contacts[name].force, rtol=1e-8)
            assert_allclose(contact.dissipation, theirs.contacts[name].dissipation, rtol=1e-8, atol=1e-8)
        assert_allclose(mine.energy.external, theirs.energy.external, rtol=1e-8)
    assert mine.contacts["joint"].max_slip > 0.25


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"bas": {"mu": 0.1}}, "contacts.bas: nothing there to change; did you mean base"),
        ({"base": {"my": 0.1}}, "contacts.base.my: nothing there to change"),
        ({"base": {"law": 1.0}}, "contacts.base.law: nothing there to change"),
        ({"base": {"mu": -1.0}}, "mu = -1"),
        ({"base": {"mu": "much"}}, "expected a number"),
        ({"base": 0.1}, "expected { component: number }"),
    ],
)
def test_what_is_wrong_is_refused_and_changes_nothing(wrong: dict[str, Any], said: str) -> None:
    script = prepared().script()
    with pytest.raises(stickslip.SceneError, match=said):
        script.step(to=1.0, contacts=wrong)
    assert script.time == 0


@pytest.mark.parametrize(
    ("output", "told"),
    [
        ("output.error_budget='inf'", (True, True)),
        ("output.error='full'", (True, True)),
        ("output.error_budget=0.0", (False, False)),
        ("output.error='rough'", (False, False)),
        ("output.error=false", (False, False)),
    ],
)
def test_errors_of_the_mesh_follow_a_script_as_far_as_the_scene_pays_for_them(
    output: str, told: tuple[bool, bool]
) -> None:
    script = prepared("output.error=true", output).script()
    errors = [script.step(to=time).errors for time in (1.0, 2.0)]
    parts = [found.get("contacts.base.normal_force") for found in errors]
    assert tuple(one is not None and one.mesh is not None for one in parts) == told
