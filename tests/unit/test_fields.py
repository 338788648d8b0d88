"""Gap offsets, coefficients of friction and obstacles by formula and by measured heights."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import stickslip
from stickslip import StepResult, read
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError
from stickslip.geometry.field import HeightMap
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
    assert_allclose(measured(at), wave(at[:, 0], at[:, 1]), atol=2e-4 if scattered else 1e-6)


def test_a_measured_profile_is_as_near_as_its_formula() -> None:
    x = np.linspace(-3, 3, 241)
    measured = Graph(height=HeightMap(over=("x",), rows=tuple(zip(x.tolist(), wave(x).tolist(), strict=True))))
    at = np.random.default_rng(1).uniform(-1, 1, (30, 2))
    formula = Graph(height="0.1*cos(x)")
    assert_allclose(measured.signed_gap(at), formula.signed_gap(at), atol=1e-6)
    assert_allclose(measured.normals(at), formula.normals(at), atol=1e-3)


def test_a_csv_file_is_the_map_written_out(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("x,y\n0,0\n4,-0.001\n", encoding="utf-8")
    for keys in ("", ', over = ["x"]', ', height = "y"'):
        scene = read("block", [f'contacts.base.gap_offset={{ csv = "{tmp_path}/m.csv"{keys} }}'])
        assert scene.contacts["base"].gap_offset == HeightMap(over=("x",), rows=((0.0, 0.0), (4.0, -0.001)))


WRONG: dict[str, tuple[str, str]] = {
    "no file": ('{ csv = "none.csv" }', "gap_offset.csv = .*none.csv: no such file"),
    "unknown axis": ('{ over = ["q"], rows = [[0, 0], [1, 1]] }', r"gap_offset.over = \['q'\]: expected one or two"),
    "short row": ('{ over = ["x"], rows = [[0, 0], [1]] }', r"gap_offset.rows = \[1.0\]: expected rows of 2 numbers"),
    "one place": ('{ over = ["x"], rows = [[0, 0]] }', "gap_offset.rows: 1 places do not span x"),
    "a place twice": ('{ over = ["x"], rows = [[0, 0], [0, 1]] }', "a place is listed twice"),
    "misspelt": ('{ ove = ["x"] }', "gap_offset.ove: unknown key; did you mean over"),
    "no formula": ('"foo*x"', "column 1: foo is not known"),
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
