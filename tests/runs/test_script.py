"""A scene in Python: `import stickslip`, the nouns, the steps."""

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
from numpy.testing import assert_allclose

import stickslip
from shared.command import LIMIT
from shared.histories import FOUR
from stickslip.geometry.amplitude import Amplitude
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError
from stickslip.solvers.scene.loads import Direction
from stickslip.workflows.lab.studies import block_from_python
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


def test_study_of_twenty_lines_builds_solves_and_draws_the_block(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
        "import threading, stickslip\n"
        "def act():\n"
        f"    found.append(stickslip.run(stickslip.read('block', {FOUR!r}), 'out')[0].status)\n"
        "found = []\n"
        "thread = threading.Thread(target=act)\n"
        "thread.start()\n"
        "thread.join()\n"
        "assert found == ['converged'], found\n"
        f"stickslip.prepare(stickslip.read('block', {FOUR!r}))\n"  # and then in the main one
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

    far: float
    long: float
    shape: Annotated[Literal["odd"], stickslip.Key("-", "kind of obstacle")] = "odd"

    def distance(self, x: Any, sqrt: Callable[[Any], Any]) -> Any:
        return 0.0 * x[1] + self.far

    def normals(self, points: Array) -> Array:
        return np.tile([0.0, self.long], (len(points), 1))


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
    scene = replace(read("block", FOUR), obstacles={"foundation": Odd(far=far, long=long)})
    with pytest.raises(SceneError, match=rf"obstacle Odd: at \(.*\).*{said}.*expected a number, and a unit vector"):
        list(stickslip.steps(scene))
