"""result.json of every ready scene is complete and names what the scene names."""

import math
from typing import Any

from jsonschema import Draft202012Validator

from shared.solved import Json, Solved
from stickslip.workflows.run.result import result_schema
from stickslip.workflows.scene_file.read import from_dict

SCHEMA = Draft202012Validator(result_schema())


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def is_text(value: Any) -> bool:
    return isinstance(value, str) and value != ""


def is_null(value: Any) -> bool:
    return value is None


def is_truth(value: Any) -> bool:
    return isinstance(value, bool)


def is_vector(value: Any) -> bool:
    return isinstance(value, list) and len(value) in (2, 3) and all(map(is_number, value))


def is_moment(value: Any) -> bool:
    """A number in the plane, three components in space."""
    return is_number(value) or (is_vector(value) and len(value) == 3)


def is_error(value: Any) -> bool:
    """Of a number, or of a vector by component."""
    return all(is_number(part) and part >= 0 for part in (value if isinstance(value, list) else [value]))


def is_stress(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 6 and all(map(is_number, value))


AUDIT = dict.fromkeys(
    ("equilibrium", "penetration", "negative_pressure", "cone", "complementarity", "dissipation"), is_number
)
RESULTANTS = ("normal_force", "tangential_force", "max_pressure", "max_penetration", "max_slip")
ENERGIES = ("external", "stored", "contact", "compliance", "dissipated")
AREAS = ("contact_area", "stick_area", "slip_area")
CONTACT = dict.fromkeys((*RESULTANTS, *AREAS, "dissipation", "dissipation_total"), is_number) | {
    "force": is_vector,
    "moment": is_moment,
}
PARTS = ("time_step", "law", "iteration", "linear_solver")  # of every number, whatever the order


def is_known_or_null(value: Any) -> bool:
    """Of order 1 it is known, and of a number that has a limit."""
    return value is None or is_error(value)


def error_of(*names: str) -> Json:
    """Error of each of these numbers, by its parts."""
    by_order = dict.fromkeys(("mesh", "geometry", "total"), is_known_or_null)
    parts = dict.fromkeys(PARTS, is_error) | by_order | {"converges": lambda value: value in (None, True, False)}
    return {"error": {name: parts | {"corrected": lambda value: True} for name in names}}


FORMAT_1: Json = {
    "format": lambda value: value == 1,
    "status": lambda value: value == "converged",
    "version": is_text,
    "dolfinx": is_text,
    "ranks": lambda value: value == 1,
    "method": lambda value: is_text(value) and value != "auto",
    "dofs": is_count,
    "contact_points": is_count,
    "plan": [{"effect": is_text, "on": is_truth, "because": is_text, "adds": lambda value: isinstance(value, str)}],
    "steps": [
        {
            "time": is_number,
            "substeps": is_count,
            "iterations": is_count,
            "volume_solves": is_count,
            "residual": is_number,
            "contacts": {
                "*": CONTACT | {"force": is_vector, "moment": is_moment} | error_of(*CONTACT, "force", "moment")
            },
            "supports": {"*": {"force": is_vector, "moment": is_moment} | error_of("force", "moment")},
            "obstacles": {
                "*": {"displacement": is_vector, "force": is_vector, "moment": is_moment}
                | error_of("displacement", "force", "moment")
            },
            "probes": {"*": {"displacement": is_vector, "stress": is_stress} | error_of("displacement", "stress")},
            "energy": dict.fromkeys((*ENERGIES, "time_remainder"), is_number) | error_of(*ENERGIES),
            "error": {
                "energy_norm": {
                    **dict.fromkeys(("mesh", "law", "iteration", "linear_solver"), is_number),
                    **dict.fromkeys(("total", "geometry", "time_step"), is_null),  # not computed yet
                    "converges": lambda value: value is True,
                }
            },
            "audit": AUDIT,
        }
    ],
    "counters": {
        "unknowns": dict.fromkeys(("displacement", "normal", "tangential"), is_count),
        **dict.fromkeys(("forms", "searches", "factorisations", "schur_size"), is_count),
        **dict.fromkeys(("volume_solves", "linear_iterations", "error_solves"), is_count),
    },
    "audit": AUDIT,
    "error": {
        "discretisation": is_number,
        "law": lambda value: value == 0,  # the laws themselves are solved, not smoothed ones
        "iteration": is_number,
        "linear_solver": is_number,
        "what": lambda value: value == "relative, energy norm",
    },
    "seconds": {
        **dict.fromkeys(("mesh", "assemble", "prepare", "iterate", "error", "output", "total"), is_number),
        "linear_reference": is_null,
    },
}


def assert_has(value: Any, form: Any, at: str = "result.json") -> None:
    """Every key of the form is there, of the right kind; `*` stands for any name."""
    if isinstance(form, dict):
        assert isinstance(value, dict), at
        for key, inner in form.items():
            for name in value if key == "*" else [key]:
                assert name in value, f"{at}.{name} is missing"
                assert_has(value[name], inner, f"{at}.{name}")
    elif isinstance(form, list):
        assert isinstance(value, list), at
        assert value, at
        for index, item in enumerate(value):
            assert_has(item, form[0], f"{at}[{index}]")
    else:
        assert form(value), f"{at} = {value!r}"


def test_result_holds_every_key_of_format_1(solved: Solved) -> None:
    assert_has(solved.result, FORMAT_1)


def test_result_names_what_the_scene_names_at_every_requested_time(solved: Solved) -> None:
    assert [step["time"] for step in solved.result["steps"]] == list(solved.scene.requested_times())
    for step in solved.result["steps"]:
        for table in ("contacts", "supports", "probes"):
            assert step[table].keys() == getattr(solved.scene, table).keys()
        d = solved.scene.dim
        assert all(len(item["force"]) == d for table in ("contacts", "supports") for item in step[table].values())


def test_result_repeats_the_scene_so_that_it_can_be_solved_again(solved: Solved) -> None:
    stored = dict(solved.result["scene"])
    assert len(stored.pop("hash")) == 64
    assert from_dict(stored) == solved.scene


def test_is_valid_under_its_schema(solved: Solved) -> None:
    errors = SCHEMA.iter_errors(solved.result)
    assert [f"{error.json_path}: {error.message[:200]}" for error in errors] == []
