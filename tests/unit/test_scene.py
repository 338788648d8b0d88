"""Scenes: what is said is kept, what is wrong is refused in the scene's own words."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from stickslip.geometry.errors import SceneError
from stickslip.solvers.effects import EFFECTS
from stickslip.solvers.effects.gravity import Gravity
from stickslip.solvers.scene.loads import Load
from stickslip.solvers.scene.scene import Scene, over
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.scene_file.read import READY, from_dict, read, to_dict, with_keys

SceneOf = Callable[..., Scene]
READY_NAMES = sorted(path.stem for path in READY.glob("*.toml"))
PRESSED: dict[str, Any] = {
    "contacts": {"base": {"surface": "block.bottom", "against": "foundation"}},
    "supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": -0.1}}},
}


def test_there_are_ready_scenes() -> None:
    assert {"block", "cube", "foundation"} <= set(READY_NAMES)


@pytest.mark.parametrize("name", READY_NAMES)
def test_a_ready_scene_survives_being_written_and_read(name: str) -> None:
    scene = read(name)
    plain = to_dict(scene)
    assert from_dict(plain) == scene
    assert to_dict(from_dict(plain)) == plain
    assert scene.title
    assert any(row.on for row in make_plan(scene))


def test_every_noun_survives_being_written_and_read(scene_of: SceneOf) -> None:
    scene = scene_of(
        title="all of it",
        bodies={"block": {"E": 2.0, "nu": 0.1, "density": 3.0}},
        contacts={
            "base": {"surface": "block.bottom", "against": "foundation", "normal": {"law": "compliance", "c_n": 3.0},
                     "friction": {"law": "tresca", "bound": [[0, 1.0], [1, 2.0]]}},
            "lid": {"surface": "block.top", "against": "foundation", "normal": {"law": "bilateral"},
                    "friction": {"law": "stick"}},
        },
        supports={"pin": {"point": [0.0, 1.0], "displacement": {"x": [[0, 0], [1, 0.1]]}}},
        loads={"f": {"boundary": "block.top", "force": [1.0, [[0.5, 2.0]]]},
               "p": {"boundary": "block.top", "pressure": -1}},
        probes={"here": {"point": [0.5, 0.5]}},
        periodic={"sides": {"boundary": "block.right", "with": "block.left"}},
        gravity={"acceleration": [0.0, [[0, 0], [1, -9.81]]]},
        steps={"end": 2.0, "count": 3},
        solver={"method": "uzawa", "tolerance": 1e-6, "max_iterations": 7},
        output={"every": 2, "pictures": False},
    )  # fmt: skip
    assert from_dict(to_dict(scene)) == scene
    assert to_dict(scene)["periodic"]["sides"]["with"] == "block.left"


def test_a_component_of_a_vector_has_a_key_however_the_vector_is_given() -> None:
    for given in ("[0.0, -9.81]", "{ y = -9.81 }"):
        scene = read("block", [f"gravity.acceleration={given}", "bodies.block.density=1.0"])
        turned = with_keys(scene, {"gravity.acceleration.x": 0.5})
        assert to_dict(turned)["gravity"]["acceleration"] == [0.5, -9.81]
        assert read("block", [f"gravity.acceleration={given}", "bodies.block.density=1", "gravity.acceleration.x=0.5"])
        with pytest.raises(SceneError, match=r"acceleration is not a table|z"):
            with_keys(scene, {"gravity.acceleration.z": 0.5})


def test_an_override_changes_one_key_and_nothing_else() -> None:
    plain, changed = to_dict(read("block")), to_dict(read("block", ["contacts.base.friction.mu=0.5"]))
    assert plain["contacts"]["base"]["friction"].pop("mu") == 0.3
    assert changed["contacts"]["base"]["friction"].pop("mu") == 0.5
    assert plain == changed


def lid(*table: list[float]) -> dict[str, Any]:
    return {
        "supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": [list(row) for row in table]}}}
    }


@pytest.mark.parametrize(
    ("tables", "times"),
    [
        ({}, (1.0,)),  # one step at t = 1
        ({"steps": {"end": 2.0, "count": 4}}, (0.5, 1.0, 1.5, 2.0)),
        (lid([0, 0], [0.3, 1]) | {"steps": {"count": 2}}, (0.3, 0.5, 1.0)),  # every time of a table is hit
        (lid([0, 0], [0.5, 1]) | {"steps": {"count": 2}}, (0.5, 1.0)),  # once
        (lid([0.25, 1], [7.0, 2]), (0.25, 1.0)),  # nothing after the end
        (lid([0, 0.1], [1, 0.2]), (0.0, 1.0)),  # a value at t = 0 is a step of its own
        (lid([0, 0], [1, 0.2]), (1.0,)),
        ({"gravity": {"acceleration": [0.0, [[0.4, -1.0]]]}}, (0.4, 1.0)),
        ({"loads": {"p": {"boundary": "block.top", "pressure": [[0.6, 1.0]]}}}, (0.6, 1.0)),
        ({"steps": {"end": 0.3, "count": 3}} | lid([0.1, 1], [0.2, 2]), (0.1, 0.2, 0.3)),  # 3 * 0.1 > 0.3 in floats
    ],
)
def test_equal_steps_and_every_listed_time_are_requested_once(
    tables: dict[str, Any], times: tuple[float, ...], scene_of: SceneOf
) -> None:
    bodies = {"block": {"E": 1.0, "nu": 0.3, "density": 1.0}}
    assert scene_of(**(PRESSED | {"bodies": bodies} | tables)).requested_times() == pytest.approx(times, rel=1e-15)


def test_times_of_obstacles_and_of_friction_bounds_are_requested(scene_of: SceneOf) -> None:
    moving = {
        "foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "displacement": {"x": [[0.2, 1.0]]}}
    }
    friction = {"law": "tresca", "bound": [[0.7, 1.0]]}
    contacts = {"base": PRESSED["contacts"]["base"] | {"friction": friction}}
    scene = scene_of(**(PRESSED | {"obstacles": moving, "contacts": contacts}))
    assert scene.requested_times() == (0.2, 0.7, 1.0)
    assert scene.timeline().turns >= {0.2, 0.7}


def test_every_value_in_time_has_its_place_and_can_be_changed_there(scene_of: SceneOf) -> None:
    plane = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
    roller = plane | {"force": {"y": 1.0}, "displacement": {"x": 0.0}, "rotation": {"angle": 0.1, "point": [0.0, 0.0]}}
    friction = {"law": "tresca", "bound": [[0.7, 1.0]]}
    scene = scene_of(
        **PRESSED
        | {
            "bodies": {"block": {"E": 1.0, "nu": 0.3, "density": 1.0}},
            "obstacles": {"foundation": roller},
            "contacts": {"base": PRESSED["contacts"]["base"] | {"friction": friction}},
            "loads": {
                "wind": {"boundary": "block.left", "traction": [0.1, [[0.3, 1.0]]]},
                "hand": {"boundary": "block.right", "force": [0.2, 0.0]},
                "rain": {"boundary": "block.top", "pressure": 0.5},
            },
            "supports": lid([0.25, 1])["supports"],
            "gravity": {"acceleration": [0.0, -1.0]},
        }
    )
    places = [str(place) for place in scene.drives()]
    assert sorted(places) == [
        "contacts.base.friction.bound",
        "gravity.acceleration.x",
        "gravity.acceleration.y",
        "loads.hand.force.x",
        "loads.hand.force.y",
        "loads.rain.pressure",
        "loads.wind.traction.x",
        "loads.wind.traction.y",
        "obstacles.foundation.displacement.x",
        "obstacles.foundation.force.y",
        "obstacles.foundation.rotation.angle",
        "supports.top.displacement.x",
        "supports.top.displacement.y",
    ]
    wanted = {place: ((1.0, float(k)),) for k, place in enumerate(scene.drives())}
    changed = over(scene, lambda place, amplitude: wanted[place])
    assert changed.drives() == wanted
    assert over(changed, lambda place, amplitude: scene.drives()[place]) == scene


@pytest.mark.parametrize("dim", [2, 3])
def test_a_table_by_axis_has_zeros_up_to_the_dimension_of_the_model(scene_of: SceneOf, dim: int) -> None:
    axis, zeros = "xyz"[dim - 1], [0.0] * (dim - 1)
    side = {"boundary": "block.top"}

    def scene(**by: Any) -> Scene:
        return scene_of(
            dim,
            bodies={"block": {"E": 1.0, "nu": 0.3, "density": 1.0}},
            loads={"t": side | {"traction": by}, "f": side | {"force": by}},
            gravity={"acceleration": by},
            springs={"s": {"at": "block.top", "stiffness": [1.0] * dim, "displacement": by}},
            **PRESSED | {"supports": {"top": {"boundary": "block.top", "displacement": {axis: -0.1}}}},
        )

    found = scene(x=2.0)
    assert found == from_dict(to_dict(found))
    assert found.loads["t"].traction == found.loads["f"].force == (2.0, *zeros)
    places = [str(place) for place in found.drives()]
    for key in ("loads.t.traction", "loads.f.force", "gravity.acceleration", "springs.s.displacement"):
        assert f"{key}.{axis}" in places
    by_program = {"t": Load(boundary="block.top", traction={"x": 2.0})}  # type: ignore[arg-type]
    assert replace(found, loads=by_program).loads["t"].traction == (2.0, *zeros)
    with pytest.raises(SceneError, match=r"gravity\.acceleration = \[0\.0, 0\.0.*: expected . components"):
        replace(found, sections={"gravity": Gravity(acceleration=[0.0] * (5 - dim))})  # type: ignore[arg-type]
    if dim == 2:
        with pytest.raises(SceneError, match=r"loads\.t\.traction = \[0\.0, 0\.0, 1\.0\]: expected 2 components"):
            scene(z=1.0)


def test_axes_of_a_body_may_be_tables_by_axis(scene_of: SceneOf) -> None:
    constants = dict.fromkeys(("E_1", "E_2", "E_3", "G_12", "G_13", "G_23"), 1.0)
    constants |= dict.fromkeys(("nu_12", "nu_13", "nu_23"), 0.1)
    supports = {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0, "z": 0.0}}}
    body = scene_of(3, bodies={"block": constants | {"axis_1": {"y": 2.0}, "axis_2": {"z": 1.0}}}, supports=supports)
    assert body.bodies["block"].axis_1 == (0.0, 2.0, 0.0)
    with pytest.raises(SceneError, match=r"^bodies\.block\.axis_2 = absent, so y: is parallel to axis_1"):
        scene_of(3, bodies={"block": constants | {"axis_1": {"y": 2.0}}}, supports=supports)


def test_the_plan_switches_on_what_the_scene_contains_and_says_why(scene_of: SceneOf) -> None:
    rows = {row.effect: row for row in make_plan(scene_of(**PRESSED))}
    assert set(rows) == {effect.name for effect in EFFECTS}
    assert {name for name, row in rows.items() if row.on} == {"contact", "unilateral"}
    assert rows["contact"].because == "contacts.base"
    assert rows["unilateral"].because == "contacts.base.normal"
    assert rows["gravity"].because == "not in the scene"
    assert (rows["contact"].adds, rows["gravity"].adds) == ("a problem on the surface, one row a point", "")


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"suports": {}}, r"suports: unknown key; did you mean supports\?"),
    ({"bodies": {"block": {"E": -1.0, "nu": 0.3}}}, r"bodies\.block\.E = -1\.0: must be positive, in pascal"),
    (
        {"bodies": {"block": {"E": 1.0, "nu": 0.51}}},
        r"bodies\.block\.nu = 0\.51: must lie above -1, and not above 0\.5",
    ),
    ({"bodies": {}}, r"bodies\.block: missing"),
    ({"loads": {"p": {"boundary": "block.tpo", "pressure": 1.0}}}, r"loads\.p\.boundary = block\.tpo: .* block\.top\?"),
    ({"loads": {"p": {"boundary": "block.top", "force": [1.0]}}}, r"loads\.p\.force = \[1\.0\]: expected 2 components"),
    ({"loads": {"p": {"boundary": "block.top"}}}, "exactly one of the three is needed"),
    ({"steps": {"count": 0}}, r"steps\.count = 0: must be a whole number"),
    ({"steps": {"end": float("nan")}}, r"steps\.end = nan: must be a finite number"),
    ({"solver": {"method": "usawa"}}, r"solver\.method = usawa: did you mean uzawa\?"),
    ({"probes": {"a": {"point": [0.0, 0.0, 0.0]}}}, r"probes\.a\.point = .*: expected 2 components"),
    ({"gravity": {"acceleration": [0.0, -9.81]}}, r"gravity: no body has a density"),
    (
        {"contacts": PRESSED["contacts"] | {"again": PRESSED["contacts"]["base"]}},
        r"contacts\.again\.surface = block\.bottom: already the slave of contacts\.base",
    ),
]


@pytest.mark.parametrize(("tables", "text"), WRONG)
def test_impossible_scenes_are_refused_in_one_line(tables: dict[str, Any], text: str, scene_of: SceneOf) -> None:
    with pytest.raises(SceneError, match=text) as caught:
        scene_of(**(PRESSED | tables))
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


def test_a_motion_that_nothing_resists_is_refused(scene_of: SceneOf) -> None:
    with pytest.raises(SceneError, match="nothing resists the translation along x"):
        make_plan(scene_of(contacts=PRESSED["contacts"]))
    held = PRESSED["contacts"]["base"] | {"friction": {"law": "coulomb", "mu": 0.3}}
    with pytest.raises(SceneError, match=r"solver\.method = uzawa: needs bodies that their supports hold"):
        make_plan(scene_of(contacts={"base": held}, solver={"method": "uzawa"}))
    make_plan(scene_of(contacts={"base": held}))  # friction may hold it
