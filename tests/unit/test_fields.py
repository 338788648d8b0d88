"""Gap offsets, coefficients of friction and obstacles by formula and by measured heights."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydantic import TypeAdapter

import stickslip
from stickslip import StepResult, read
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError
from stickslip.geometry.field import FieldTable, HeightMap, in_time, number, values
from stickslip.geometry.obstacles.graph import Graph

HALF_DISC = ["geometry.mesh_size=0.3", "geometry.contact_mesh_size=0.02", "steps.count=4"]
BALL = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.05", "steps.count=2"]


def solve(name: str, *sets: str) -> list[StepResult]:
    return list(stickslip.steps(read(name, list(sets))))


def forces(steps: list[StepResult]) -> Array:
    """Normal and tangential forces, areas and largest pressures of all steps and contacts."""
    each = [c for step in steps for c in step.contacts.values()]
    return np.array([(c.normal_force, c.tangential_force, c.contact_area, c.max_pressure) for c in each])


@pytest.mark.parametrize(
    "offset",
    [
        "-0.002",
        '"-0.002"',
        '{ over = ["x"], rows = [[-9, -0.002], [9, -0.002]] }',
        '{ over = ["y", "x"], rows = [[-9, -9, -0.002], [9, 9, -0.002], [9, -9, -0.002], [-9, 9, -0.002]] }',
        '{ over = ["x"], rows = [[-9, -0.003], [9, -0.003]], plus = 0.001 }',
    ],
)
@pytest.mark.parametrize("operator", ["mortar", "node-to-segment"])
def test_an_interference_that_is_one_number_may_be_written_in_many_ways(offset: str, operator: str) -> None:
    sets = ["geometry.mesh_size=0.5", "geometry.inner_mesh_size=0.3", f'contacts.fit.operator="{operator}"']
    plain = solve("shrink_fit", *sets, "contacts.fit.gap_offset=-0.002")
    assert_allclose(
        forces(solve("shrink_fit", *sets, f"contacts.fit.gap_offset={offset}")), forces(plain), rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize(
    "offset",
    ["[[0, 0], [1, -0.002]]", '"-0.002*min(t, 1)"', "{ over = ['x'], rows = [[-9, 0], [9, 0]], plus = [[1, -0.002]] }"],
)
def test_an_interference_that_grows_ends_where_one_at_once_does_and_its_work_comes_from_outside(offset: str) -> None:
    sets = ["geometry.mesh_size=0.5", "geometry.inner_mesh_size=0.3", "geometry.interference=0.0", "steps.count=4"]
    at_once = solve("shrink_fit", *sets, "contacts.fit.gap_offset=-0.002")
    grown = solve("shrink_fit", *sets, f"contacts.fit.gap_offset={offset}")
    assert_allclose(forces(grown)[-1], forces(at_once)[-1], rtol=1e-8)
    half = next(step for step in grown if step.time == 0.5)
    assert_allclose(half.contacts["fit"].normal_force, forces(at_once)[0][0] / 2, rtol=0.05)  # facets overlap a little
    for step in grown:
        energy = step.energy
        balance = energy.external - energy.stored - energy.compliance - sum(np.atleast_1d(energy.dissipation))
        assert abs(balance - energy.time_remainder) < 1e-9 * energy.stored


CYLINDER = 'shape = "cylinder", point = [0.0, -2.0], radius = 2.0'


@pytest.mark.parametrize(
    ("name", "sets", "plain", "height"),
    [
        ("half_disc", HALF_DISC, 'shape = "plane", point = [0.0, 0.0], normal = [0.0, 1.0]', "0*x"),
        ("half_disc", HALF_DISC, CYLINDER, "sqrt(4 - x**2) - 2"),
        ("axisymmetric", BALL, 'shape = "sphere", center = [0.0, -2.0], radius = 2.0', "sqrt(4 - x**2) - 2"),
        ("half_ball", BALL, 'shape = "sphere", center = [0, 0, -2], radius = 2.0', "sqrt(4 - x**2 - y**2) - 2"),
    ],
)
def test_a_graph_of_a_formula_acts_as_the_same_shape_with_a_name(
    name: str, sets: list[str], plain: str, height: str
) -> None:
    by_name, by_formula = (
        solve(name, *sets, f"obstacles.ground={{ {shape}, displacement = {{ y = 0.001 }} }}")
        for shape in (plain, f'shape = "graph", height = "{height}"')
    )
    assert_allclose(forces(by_formula), forces(by_name), rtol=1e-6, atol=1e-9)  # iterations end at the tolerance


def test_friction_by_place_is_that_of_each_place() -> None:
    """A block whose coefficient falls to zero at its left end slips there first; all mu p add up where all slips."""
    step = solve("block", 'contacts.base.friction.mu="0.1*x"', "geometry.mesh_size=0.5")[-1].contacts["base"]
    slipping = np.linalg.norm(step.slip_increment, axis=1) > 0
    assert_allclose(step.bound, 0.1 * step.points[:, 0] * step.pressure, atol=1e-9 * step.pressure.max())
    assert slipping[step.points[:, 0] < 0.5].all()


def test_friction_in_time_holds_at_the_end_of_each_step() -> None:
    for step in solve("block", "contacts.base.friction.mu=[[0, 0.1], [2, 0.3]]", "geometry.mesh_size=0.5"):
        base, mu = step.contacts["base"], 0.1 + 0.1 * step.time
        assert_allclose(base.bound, mu * base.pressure, atol=1e-12)


def wave(x: Array, y: Array | float = 0.0) -> Array:
    return np.asarray(0.1 * np.cos(x) * np.cos(0.5 * y))


@pytest.mark.parametrize("scattered", [False, True])
def test_a_map_of_two_axes_is_near_what_was_measured(scattered: bool) -> None:
    draw = np.random.default_rng(3)
    places = draw.uniform(-2, 2, (3000, 2)) if scattered else np.stack(np.meshgrid(*[np.linspace(-2, 2, 41)] * 2), -1)
    places = np.vstack(
        [places.reshape(-1, 2), [[-2, -2.01], [2, -2.01], [2.01, 2], [-2, 2.01]]][: 2 if scattered else 1]
    )
    measured = HeightMap(over=("x", "y"), rows=tuple((x, y, float(wave(x, y))) for x, y in places.tolist()))
    at = draw.uniform(-1.8, 1.8, (50, 3))
    assert_allclose(measured(at, "map"), wave(at[:, 0], at[:, 1]), atol=2e-4 if scattered else 1e-6)


def test_a_measured_profile_is_as_near_as_its_formula() -> None:
    x = np.linspace(-3, 3, 241)
    measured = Graph(height=HeightMap(over=("x",), rows=tuple(zip(x.tolist(), wave(x).tolist(), strict=True))))
    at = np.random.default_rng(1).uniform(-1, 1, (30, 2))
    formula = Graph(height="0.1*cos(x)")
    assert_allclose(measured.signed_gap(at), formula.signed_gap(at), atol=1e-6)
    assert_allclose(measured.normals(at), formula.normals(at), atol=1e-3)


MAPS: dict[str, list[tuple[float, ...]]] = {  # places of a plane, along x and y
    "line": [(10.0,), (14.0,)],
    "profile": [(10.0,), (11.0,), (14.0,)],
    "grid": [(10.0, 20.0), (10.0, 22.0), (14.0, 20.0), (14.0, 22.0)],
    "scattered": [(10.0, 20.0), (10.0, 22.0), (11.0, 20.5), (14.0, 20.0), (14.0, 22.0)],
}


@pytest.mark.parametrize("places", MAPS.values(), ids=MAPS)
def test_a_map_has_its_edge_and_nothing_beyond(places: list[tuple[float, ...]]) -> None:
    over = ("x", "y")[: len(places[0])]
    slopes, middle = np.array([2.0, -3.0])[: len(over)], np.array([12.0, 21.0])[: len(over)]
    measured = HeightMap(over=over, rows=tuple((*place, float(slopes @ place)) for place in places))
    within = np.array([*places, middle])
    assert_allclose(measured(within, "gap"), within @ slopes, rtol=1e-8)  # its edge by a rounded part of its width
    beyond = np.vstack([middle + side * np.diag([2.5, 1.5])[: len(over), : len(over)] for side in (-1, 1)])
    assert_array_equal(
        np.isnan(measured.heights(np.vstack([within, beyond]))), [False] * len(within) + [True] * len(beyond)
    )
    assert_allclose(measured.clipped(beyond), np.clip(beyond, [10.0, 20.0][: len(over)], [14.0, 22.0][: len(over)]))
    said = "at x = 9.5; its places are x 10 to 14$"
    if len(over) == 2:
        said = "at x = 9.5, y = 21; its places are x 10 to 14, y 20 to 22$"
    with pytest.raises(SceneError, match=f"^gap: the map has no height {said}"):
        measured(np.vstack([within, beyond]), "gap")
    edge, plain = Graph(height=measured), Graph(height=["2*x", "2*x - 3*y"][len(over) - 1])
    at = np.column_stack([within, within @ slopes])
    assert_allclose(edge.signed_gap(at), 0.0, atol=1e-7)
    assert_allclose(edge.normals(at), plain.normals(at), atol=1e-6)


GROWS = ((0.0, 0.0), (2.0, 4.0))
FIELDS: list[tuple[Any, dict[tuple[str, ...], Any], Any]] = [  # what changes in time; at x = 1 and 3, 0.5 s of 2 s
    (3, {}, 3.0),
    (GROWS, {("gap",): GROWS}, 1.0),
    ("x**2", {}, [1.0, 9.0]),
    ("x*t", {("gap",): "x*t"}, [0.5, 1.5]),
    *((HeightMap(over=("x",), rows=((0.0, 0.0), (4.0, 8.0)), plus=plus), changes, [2.0 + more, 6.0 + more])
      for plus, changes, more in [(0.25, {}, 0.25), (GROWS, {("gap", "plus"): GROWS}, 1.0)]),
]  # fmt: skip


@pytest.mark.parametrize(("field", "changes", "expected"), FIELDS)
def test_a_field_has_values_at_places_and_times(field: Any, changes: dict[Any, Any], expected: Any) -> None:
    found = values(field, "gap", np.array([[1.0, 7.0], [3.0, 7.0]]), 0.5, 2.0)
    assert_allclose(found, expected, rtol=1e-8)
    assert found.dtype == float
    assert in_time(field, "gap") == changes


def test_a_field_that_has_no_value_or_several_is_said() -> None:
    with pytest.raises(SceneError, match=r'^mu = "1/x": has no finite value at the point \(0, 5\) at t = 0.5$'):
        values("1/x", "mu", np.array([[1.0, 4.0], [0.0, 5.0]]), 0.5, 2.0)
    with pytest.raises(SceneError, match=r"^mu: the map has no height"):
        values(HeightMap(over=("x",), rows=((0.0, 0.0), (4.0, 8.0))), "mu", np.array([[5.0, 0.0]]), 0.5, 2.0)
    assert number(0.25) == 0.25
    with pytest.raises(AssertionError, match="`values`"):
        number("x")


def test_a_table_of_a_field_is_a_map_and_its_schema_lists_the_keys() -> None:
    table = TypeAdapter[Any](Annotated[HeightMap, FieldTable])
    keys = "{ csv, over, height, plus }, { over, rows, plus } or { csv, time, column }"
    assert table.json_schema() == {"type": "object", "description": keys}
    assert table.validate_python({"over": ["x"], "rows": GROWS}) == HeightMap(over=("x",), rows=GROWS)


READ: dict[str, tuple[str, str, Any]] = {  # the file, keys beside it; the map, or what is said
    "all columns": ("x,y,h\n0,1,5\n2,0,6\n0,3,7", "", (("x", "y"), (0, 1, 5), (2, 0, 6), (0, 3, 7))),
    "an axis": ("x,y,h\n0,1,5\n2,0,6", 'over = ["y"]', (("y",), (1, 5), (0, 6))),
    "another height": ("h,x\n5,0\n6,2", 'height = "h", plus = 0.5', (("x",), (0, 5), (2, 6))),
    "no column": ("\n1", "", r"\.over = \[\]: expected one or two of x, y, z, columns of m.csv"),
    "no row": ("x,h", "", r"\.csv = .*m.csv: has no rows below"),
    "one row": ("x,h\n0,1", "", r"\.rows: 1 places do not span x"),
    "no such axis": ("x,h\n0,1\n1,1", 'over = ["y"]', r"\.over.0 = y: m.csv has no such column"),
    "no such height": ("x,h\n0,1\n1,1", 'over = ["x"], height = "g"', r"\.height = g: m.csv has no such column"),
    "no name of a height": ("x,h\n0,1\n1,1", "height = 2", r"\.height = 2: expected a text, in quotes"),
    "no list of axes": ("x,h\n0,1\n1,1", "over = 2", r"\.over = \[2\]: expected one or two"),
    "misspelt": ("x,h\n0,1\n1,1", "pluss = 2.0", r"\.pluss: unknown key; did you mean plus\?"),
    "no axis": ("u,h\n0,1\n1,1", "hight = 'h'", r"\.hight: unknown key; did you mean height\?"),
}


@pytest.mark.parametrize(("text", "keys", "expected"), READ.values(), ids=READ)
def test_a_csv_file_is_the_map_written_out(text: str, keys: str, expected: Any, tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(text, encoding="utf-8")
    offset = f'contacts.base.gap_offset={{ csv = "{tmp_path}/m.csv"{keys and ", "}{keys} }}'
    if isinstance(expected, str):
        with pytest.raises(SceneError, match=f"contacts.base.gap_offset{expected}"):
            read("block", [offset])
        return
    over, *rows = expected
    known = HeightMap(over=over, rows=tuple(rows), plus=0.5 if "plus" in keys else 0.0)
    assert read("block", [offset]).contacts["base"].gap_offset == known


WRONG: dict[str, tuple[str, str]] = {
    "no file": ('{ csv = "none.csv" }', "gap_offset.csv = .*none.csv: no such file"),
    "no file in time": ('{ csv = "none.csv", time = "t", column = "u" }', "gap_offset.csv = .*none.csv: no such file"),
    "no name of a file": ("{ csv = 2 }", "gap_offset.csv = 2: expected a text, in quotes"),
    "unknown axis": ('{ over = ["q"], rows = [[0, 0], [1, 1]] }', r"gap_offset.over = \['q'\]: expected one or two"),
    "short row": ('{ over = ["x"], rows = [[0, 0], [1]] }', r"gap_offset.rows = \[1.0\]: expected rows of 2 numbers"),
    "one place": ('{ over = ["x"], rows = [[0, 0]] }', "gap_offset.rows: 1 places do not span x"),
    "no places": ('{ over = ["x"], rows = [] }', "gap_offset.rows: 0 places do not span x"),
    "a line": ('{ over = ["x", "y"], rows = [[0, 1, 0], [1, 2, 0], [2, 3, 0]] }', "rows: 3 places do not span x, y"),
    "a place twice": (
        '{ over = ["x"], rows = [[0, 0], [0, 1]] }',
        "gap_offset.rows = 2: rows; a place is listed twice",
    ),
    "back in time": (
        '{ over = ["x"], rows = [[0, 0], [1, 1]], plus = [[1, 0], [0, 0]] }',
        "gap_offset.plus = .*increase",
    ),
    "no table": ('[[0, 0], [1, "a"]]', "gap_offset = .*expected a number"),
    "a number as text": ("true", "gap_offset = true: expected a number"),
    "misspelt": ('{ ove = ["x"] }', "gap_offset.ove: unknown key; did you mean over"),
    "no formula": ('"foo*x"', r'gap_offset = "foo\*x": column 1: foo is not known'),
}


@pytest.mark.parametrize(("offset", "said"), WRONG.values(), ids=WRONG)
def test_a_wrong_field_is_refused_with_one_line(offset: str, said: str) -> None:
    with pytest.raises(SceneError, match=f"contacts.base.{said}" if "gap" in said else said):
        read("block", [f"contacts.base.gap_offset={offset}"])


OUTSIDE: dict[str, tuple[str, str]] = {
    "beyond the map": ("contacts.base.gap_offset={ over = ['x'], rows = [[1, 0], [2, 0]] }", "map has no height at x"),
    "infinite": ('contacts.base.gap_offset="1/x"', 'gap_offset = "1/x": has no finite value at the point'),
    "negative friction": ('contacts.base.friction.mu="0.1 - x"', "base.friction.mu = .*: must not be negative"),
    "other unknowns": ('obstacles.foundation={ shape = "graph", height = "0.1*t" }', "t: it is a formula of"),
    "a graph that ends": (
        'obstacles.foundation={ shape = "graph", height = { over = ["x"], rows = [[1, 0], [2, 0]] } }',
        "height: the map has no height at x",
    ),
    "a textbook method": ('contacts.base.friction.mu="0.1*x"', "takes one number for a side"),
}  # fmt: skip


@pytest.mark.parametrize("kind", OUTSIDE)
def test_a_field_without_a_value_where_it_is_asked_is_refused(kind: str, tmp_path: Path) -> None:
    change, said = OUTSIDE[kind]
    method = ['solver.method="regularised"'] if kind == "a textbook method" else []
    with pytest.raises(SceneError, match=said):
        stickslip.prepare(read("block", [change, *method]))


def test_a_script_replaces_a_field_by_a_number() -> None:
    script = stickslip.prepare(read("block", ['contacts.base.gap_offset="0.01*x"', "geometry.mesh_size=0.5"])).script()
    plain = stickslip.prepare(read("block", ["geometry.mesh_size=0.5"])).script()
    found = script.step(to=1.0, contacts={"base": {"gap_offset": 0.0}})
    assert_allclose(found.contacts["base"].normal_force, plain.step(to=1.0).contacts["base"].normal_force, rtol=1e-9)
