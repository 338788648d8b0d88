"""JSON schemas: what the program reads and writes is valid, what it refuses is not."""

import json
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from stickslip.geometry.errors import SceneError
from stickslip.solvers import effects
from stickslip.solvers.scene.record import CONTACT_NUMBERS, numbers_of
from stickslip.workflows.commands.schema import schema
from stickslip.workflows.run import result as records
from stickslip.workflows.scene_file.read import READY, from_dict, read, to_dict
from stickslip.workflows.scene_file.schema import scene_schema

BLOCK = tomllib.loads((READY / "block.toml").read_text(encoding="utf-8"))
WRONG: dict[str, tuple[str, Any]] = {
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


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_scene_is_wrong_for_both(name: str) -> None:
    scene = with_value(*WRONG[name])
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
