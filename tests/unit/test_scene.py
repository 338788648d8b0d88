"""Scenes survive being written and read; their keys, units and values are checked and documented."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

import stickslip as s
from shared.problems import SceneOf
from stickslip import Coulomb, Gravity, Load
from stickslip.geometry.errors import LONGEST_LINE, SceneError, nearest, require
from stickslip.solvers import effects
from stickslip.solvers.effects import EFFECTS
from stickslip.solvers.scene.record import CONTACT_NUMBERS, numbers_of
from stickslip.solvers.scene.scene import Scene, over
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.commands.schema import schema
from stickslip.workflows.run import result as records
from stickslip.workflows.scene_file.read import READY, from_dict, lines_of_keys, read, to_dict, with_keys
from stickslip.workflows.scene_file.schema import scene_schema

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
    by_program = {"t": Load(boundary="block.top", traction={"x": 2.0})}
    assert replace(found, loads=by_program).loads["t"].traction == (2.0, *zeros)
    with pytest.raises(SceneError, match=r"gravity\.acceleration = \[0\.0, 0\.0.*: expected . components"):
        replace(found, sections={"gravity": Gravity(acceleration=[0.0] * (5 - dim))})
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
        r"contacts\.again\.surface = block\.bottom: contacts\.base has the same slave and the same partner",
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


def scene(**keys: Any) -> s.Scene:
    found = dict[str, Any](
        model="plane strain",
        geometry=s.Block(length=4.0, height=2.0, mesh_size=0.5),
        bodies={"block": s.Material(E=1.0, nu=0.3)},
        supports={"bottom": s.Support(boundary="block.bottom", displacement={"x": 0.0, "y": 0.0})},
    )
    return s.Scene(**(found | keys))


WRONG_VALUES: dict[str, tuple[Callable[[], object], str]] = {
    "3D": (lambda: scene(model="3D"), r'^model = "3D": not one of these; did you mean 3d\?$'),
    "misspelt model": (lambda: scene(model="axisymetric"), r"^model = .*; did you mean axisymmetric\?$"),
    "no model": (lambda: scene(model=None), "^model = null: not one of these; known: 3d, axisymmetric, plane strain"),
    "cells": (lambda: s.Block(length=1.0, height=1.0, mesh_size=1.0, cells="quad"), "^cells = .*known: simplex, tens"),
    "surface": (lambda: s.Solver(surface="condensd"), r"^surface = .*did you mean condensed\?$"),
    "infinite": (lambda: s.Steps(end=math.inf), "^end = Infinity: must be a finite number$"),
    "nan": (lambda: s.Material(E=math.nan, nu=0.3), "^E = NaN: must be a finite number$"),
    "tiny": (lambda: s.Steps(end=1e-300), "^end = 1e-300: must be from 1e-100 to 1e.100 s$"),
    "text for a number": (lambda: s.Material(E="1", nu=0.3), '^E = "1": expected a number, in Pa$'),
    "fraction": (lambda: s.Steps(count=2.5), "^count = 2.5: expected a whole number$"),
    "truth": (lambda: s.Steps(count=True), "^count = true: expected a whole number$"),
    "unknown key": (lambda: s.Steps(cout=2), r"^cout: unknown key; did you mean count\?$"),
    "missing": (lambda: s.Material(E=1.0), "^nu: missing, it has no default$"),
    "no geometry": (lambda: scene(geometry=None), "^geometry = null: expected a table$"),
    "no body": (lambda: scene(bodies={"block": None}), "^bodies.block = null: expected a Material$"),
    "a list of bodies": (lambda: scene(bodies=[1]), r"^bodies = \[1\]: expected a table$"),
    "effect": (lambda: scene(gravity=9.81), "^gravity = 9.81: expected a Gravity$"),
    "misspelt effect": (lambda: scene(gravty=None), r"^gravty: unknown key; did you mean gravity\?$"),
    "effect's table": (lambda: scene(springs={"s": 1.0}), "^springs.s = 1.0: expected a Spring$"),
    "law": (lambda: s.Contact(surface="a.b", against="c", friction=0.3), "^friction = 0.3: expected a table$"),
    "row": (
        lambda: s.Support(boundary="a.b", displacement={"y": [[0, 0], [1]]}),
        r"^displacement.y.1 = \[1\]: expected a pair \[time, value\]$",
    ),
    "direction": (lambda: s.Support(boundary="a.b", displacement={"q": 1.0}), "^displacement.q = .*known: normal, x"),
    "replaced": (lambda: replace(scene(), model="4d"), '^model = "4d": not one of these'),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG_VALUES)
def test_wrong_values_are_refused(name: str) -> None:
    make, says = WRONG_VALUES[name]
    with pytest.raises(SceneError, match=says):
        make()


@pytest.mark.parametrize(("keys", "value"), [("steps.end", '"x"'), ("steps.count", "2.5"), ("steps.end", "[1]")])
def test_the_words_are_those_of_a_file(keys: str, value: str) -> None:
    table, key = keys.split(".")
    with pytest.raises(SceneError) as from_file:
        read("block", [f"{keys}={value}"])
    with pytest.raises(SceneError) as from_python:
        s.Steps(**{key: {'"x"': "x", "2.5": 2.5, "[1]": [1]}[value]})
    assert str(from_file.value) == f"block.toml: {table}.{from_python.value}"


def test_numpys_numbers_lists_and_whole_numbers_are_what_they_mean() -> None:
    assert s.Probe(point=np.array([1, 2])).point == (1.0, 2.0)
    assert s.Steps(count=np.int64(3)).count == 3
    assert isinstance(s.Material(E=1, nu=0.3).E, float)


def test_tables_of_effects_are_given_and_replaced_like_all_others() -> None:
    spring = s.Spring(at="block.top", stiffness=(1.0, 1.0))
    found = scene(bodies={"block": s.Material(E=1.0, nu=0.3, density=1.0)}, springs={"s": spring})
    heavy: s.Scene = replace(found, gravity=s.Gravity(acceleration=(0.0, -9.81)))
    assert (heavy.springs, heavy.bolts, heavy.gravity.acceleration) == ({"s": spring}, {}, (0.0, -9.81))
    assert heavy == replace(found, sections=heavy.sections)
    assert replace(heavy, gravity=None) == found
    assert replace(heavy, springs={}).sections.keys() == {"gravity"}
    with pytest.raises(AttributeError, match="no attribute 'gravty'"):
        _ = found.gravty


def test_a_law_of_ones_own_is_accepted() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Own(Coulomb):
        pass

    assert isinstance(s.Contact(surface="a.b", against="c", friction=Own(mu=0.3)).friction, Own)


ODD = {
    "digits": f"geometry.mesh_size={'1' * 5000}",
    "many digits": f"geometry.mesh_size={'1' * 400}",
    "brackets": f"geometry.mesh_size={'[' * 3000}{']' * 3000}",
    "open brackets": f"geometry.mesh_size={'[' * 3000}",
    "tables": f"{'a.' * 3000}a=1",
    "long key": f"{'a' * 100_000}=1",
    "long value": f"model={'x' * 100_000}",
    "lone surrogate": "title=\udcff",
    "row": "supports.top.displacement.y=[[0,0],[1]]",
}


@pytest.mark.parametrize("name", ODD)
def test_odd_words_of_set_are_refused_in_a_short_line(name: str) -> None:
    with pytest.raises(SceneError) as caught:
        read("block", [ODD[name]])
    assert len(str(caught.value)) <= LONGEST_LINE
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["x" * 5000, "a\0b", "/dev/zero", "\udcff"])
def test_odd_names_of_scenes_are_refused(name: str) -> None:
    with pytest.raises(SceneError, match=r"no such file|cannot be read"):
        read(name)


def test_deep_tables_of_a_file_are_refused() -> None:
    value: Any = 1
    for _ in range(30):
        value = {"a": value}
    with pytest.raises(SceneError, match="tables and lists more than 20 deep"):
        from_dict({"title": value})


def test_long_names_are_compared_with_nothing() -> None:
    assert nearest("x" * 100_000, ["a", "b"]) == "known: a, b"
    with pytest.raises(SceneError, match=r"^key = x+ \.\.\. x+: expected$"):
        require(False, "key", "x" * 1000, "expected")


@pytest.mark.parametrize(
    ("name", "key", "size"),
    [("block", "contact", 1e-7), ("cube", "contact", 1e-6), ("two_blocks", "contact", 1e-7), ("ring", "contact", 1e-6),
     ("strip", "", 1e-9)],
)  # fmt: skip
def test_the_key_of_a_mesh_that_is_too_large_is_named(name: str, key: str, size: float) -> None:
    key = f"{key}_mesh_size".removeprefix("_")
    with pytest.raises(SceneError, match=rf"^{name}\.toml: geometry\.{key} = {size}: makes"):
        read(name, [f"geometry.{key}={size}"])


def test_a_mesh_that_does_not_fit_is_refused_with_what_it_needs() -> None:
    geometry, request = scene().geometry.refined(0.01), scene().request()
    geometry.refuse_too_large(request, free=1e10)
    with pytest.raises(
        SceneError, match=r"^mesh_size = 0.005: makes about 6.4e\+05 cells; gmsh would take about 0.96 GB"
    ):
        geometry.refuse_too_large(request, free=1e8)


def test_lines_of_keys_are_found_beside_texts_comments_and_brackets() -> None:
    text = (
        '\ntitle = """a\n "b" # no\n"""\n'  # from line 2
        "s = '''\nx = [\n'''\n"  # 5
        'b = "]#"  # ]\n'  # 8
        "[t]\nc = [ # [\n 1,\n]\n"  # 9, 10
        "d = '['\n\"p.q\" = { r = 1 }\n"  # 13, 14
    )
    expected = {"title": 2, "s": 5, "b": 8, "t": 9, "t.c": 10, "t.d": 13, "t.p.q": 14, "t.p.q.r": 14}
    assert lines_of_keys(text) == expected
    assert lines_of_keys("[a]\nt = [" + "[0, 1],\n" * 10_000 + "]\nz = 1\n")["a.z"] == 10_003


def test_keys_that_are_too_deep_have_no_line(tmp_path: Path) -> None:
    (tmp_path / "deep.toml").write_text("a." * 3000 + "a = 1\n")
    with pytest.raises(SceneError, match=r"^deep\.toml: a\.a\..*more than 20 deep"):
        read(tmp_path / "deep.toml")


BLOCK = tomllib.loads((READY / "block.toml").read_text(encoding="utf-8"))
WRONG_WORDS: dict[str, tuple[str, Any]] = {
    "unknown table": ("gravty", {}),
    "unknown key": ("contacts.base.surfce", "block.bottom"),
    "unknown key of a law": ("contacts.base.friction.eta", 1.0),
    "law without its number": ("contacts.base.friction", {"law": "coulomb"}),
    "law without a name": ("contacts.base.friction", {"mu": 0.3}),
    "unknown law": ("contacts.base.normal.law", "unilatral"),
    "unknown builder": ("geometry.builder", "blok"),
    "builder and file": ("geometry.file", "part.step"),
    "unknown method": ("solver", {"method": "uzava"}),
    "unknown model": ("model", "plane"),
    "text for a number": ("bodies.block.E", "steel"),
    "constants of two kinds of bodies": ("bodies.block.E_1", 1.0),
    "fraction for a whole number": ("steps.count", 2.5),
    "row of a table without a value": ("supports.top.displacement.y", [[0, 0], [1]]),
    "number for a truth": ("output", {"vtu": 1}),
    "number for a table": ("bodies.block", 3),
    "table of an effect": ("gravity", {"acceleration": "down"}),
}


@cache
def of_scenes() -> Draft202012Validator:
    found = scene_schema()
    Draft202012Validator.check_schema(found)
    return Draft202012Validator(found)


def with_value(key: str, value: Any) -> dict[str, Any]:
    """The ready scene `block` with another value."""
    *tables, last = key.split(".")
    whole = node = json.loads(json.dumps(BLOCK))
    for table in tables:
        node = node[table]
    node[last] = value
    return whole


BY_COMPONENT: tuple[tuple[str, Any, Any], ...] = (
    ("supports.top.displacement", {"x": 0.0, "y": [[0, 0], [1, -0.1]]}, [0.0, [[0, 0], [1, -0.1]]]),
    ("obstacles.foundation.displacement", {"x": 0.1, "y": 0.0}, [0.1, 0.0]),
    (
        "loads",
        {"l": {"boundary": "block.left", "traction": {"y": 3.0}}},
        {"l": {"boundary": "block.left", "traction": [0, 3]}},
    ),
    (
        "loads",
        {"l": {"boundary": "block.left", "force": {"x": 3.0}}},
        {"l": {"boundary": "block.left", "force": [3, 0]}},
    ),
    ("gravity", {"acceleration": {"y": -9.81}}, {"acceleration": [0, -9.81]}),
)


@pytest.mark.parametrize(("key", "table", "listed"), BY_COMPONENT)
def test_components_are_a_list_or_a_table(key: str, table: Any, listed: Any) -> None:
    scenes = [with_value(key, value) for value in (table, listed)]
    for scene in scenes:
        scene["bodies"]["block"]["density"] = 1.0
        assert not [*of_scenes().iter_errors(scene)]
    one, other = map(from_dict, scenes)
    assert one == other


@pytest.mark.parametrize("scene", sorted(READY.glob("*.toml")), ids=lambda path: path.stem)
def test_every_ready_scene_is_valid(scene: Path) -> None:
    errors = of_scenes().iter_errors(tomllib.loads(scene.read_text(encoding="utf-8")))
    assert [f"{error.json_path}: {error.message}" for error in errors] == []


@pytest.mark.parametrize("name", WRONG_WORDS)
def test_a_wrong_scene_is_wrong_for_both(name: str) -> None:
    scene = with_value(*WRONG_WORDS[name])
    assert not of_scenes().is_valid(scene)
    with pytest.raises(SceneError):
        from_dict(scene)


def test_a_scene_with_all_defaults_filled_in_is_valid() -> None:
    assert list(of_scenes().iter_errors(to_dict(read("block", ["output.vtu=true"])))) == []


def test_parameters_of_a_file_are_free() -> None:
    scene = with_value("geometry", {"file": "plate.geo", "lc": 0.1, "mesh_size": 0.2})
    assert of_scenes().is_valid(scene)
    assert not of_scenes().is_valid(with_value("geometry", {"file": "plate.geo", "mesh_size": "fine"}))


def test_editors_get_units_meanings_and_defaults() -> None:
    material = scene_schema()["$defs"]["Material"]["properties"]
    assert material["E"] == {"description": "Young's modulus [Pa]", "type": "number"}
    assert material["density"]["default"] == 0.0
    assert "null" not in json.dumps(scene_schema())


def test_a_schema_is_asked_for_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    schema("scene")
    assert json.loads(capsys.readouterr().out) == scene_schema()
    with pytest.raises(SceneError, match=r"reslt: has no schema; did you mean result\?"):
        schema("reslt")
    schema("result")
    assert json.loads(capsys.readouterr().out) == records.result_schema()


@pytest.mark.parametrize("table", effects.records())
def test_every_number_of_a_record_has_a_unit_and_a_meaning(table: str) -> None:
    record = effects.records()[table]
    fields = getattr(record, "_fields", numbers_of(record))
    assert list(numbers_of(record)) == list(fields)
    assert all(number.unit and number.meaning for number in numbers_of(record).values())
    step = records.result_schema()["$defs"]["StepRecord"]["properties"][table]
    assert step.get("$ref", step.get("additionalProperties", {}).get("$ref")) == f"#/$defs/{record.__name__}"


def test_every_number_of_a_contact_has_a_unit() -> None:
    units = records.units(plane=False)
    assert {f"contacts.{key}" for key in (*CONTACT_NUMBERS, "force", "moment")} <= set(units)
    assert (units["contacts.stick_area"], records.units(plane=True)["contacts.stick_area"]) == ("m²", "m")


def test_what_is_not_finite_may_be_null() -> None:
    found = records.result_schema()
    Draft202012Validator.check_schema(found)
    step = found["$defs"]["StepRecord"]["properties"]
    assert step["residual"]["type"] == ["number", "null"]
    assert step["time"]["description"] == "its end [s]"
