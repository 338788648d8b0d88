"""Derivatives of all numbers of a step by numbers of the scene, and what uncertain inputs leave in them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import validate
from numpy.testing import assert_allclose

from shared.problems import on_floor, scene_of, two_blocks
from shared.ranks import mpirun
from shared.solved import coarse
from stickslip import Scene, SceneError, prepare
from stickslip.geometry.arrays import Array
from stickslip.solvers.accuracy.areas import MovingEdges
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.results.step_result import (
    ErrorParts,
    Quantity,
    Slope,
    StepResult,
    number_of,
    quantities,
    slope_columns,
    told,
    uncertainty,
)
from stickslip.solvers.scene.parameters import Sensitivity, scaled
from stickslip.solvers.simulation import sensitivity as neighbours_of
from stickslip.solvers.simulation.checkpoint import Checkpoints
from stickslip.solvers.stepping.stepper import Stepper
from stickslip.workflows.commands.sensitivity import sensitivity
from stickslip.workflows.formats.results import error_budget
from stickslip.workflows.lab.verification.prepared import solved
from stickslip.workflows.pictures.tornado import draw_tornado, swings
from stickslip.workflows.run.result import result_schema
from stickslip.workflows.scene_file.read import from_dict, read, with_keys
from stickslip.workflows.sweep.true_runs import TrueRuns

EXACT = {"solver": {"tolerance": 1e-12, "surface": "condensed"}}
COULOMB = {"law": "coulomb", "mu": 0.3}
DRAG = {"x": [[0, 0], [1, 0], [2, 0.05]], "y": [[0, 0], [1, -0.1]]}
TIP = {"probes": {"tip": {"point": [2.0, 1.0]}}}
SLACK = {"at": "block.right", "stiffness": 0.1, "direction": [1.0, 0.0], "acts": "tension"}
COLUMN = {"builder": "block", "length": 1.0, "height": 1.0, "mesh_size": 0.5, "cells": "tensor"}
E, NU, MU = "bodies.block.E", "bodies.block.nu", "contacts.base.friction.mu"
BETWEEN = {E: 0.1, NU: "1 %", MU: 0.03}
RINGS = """
model = "plane strain"
geometry = { builder = "rings", inner_radius = 1.0, radius = 2.0, outer_radius = 3.0, interference = 1e-3, angle = 90, \
mesh_size = 0.5, inner_mesh_size = 0.4, cells = "tensor", order = 2 }
bodies = { inner = { E = 2e5, nu = 0.3 }, outer = { E = 1e5, nu = 0.25 } }
contacts.fit = { surface = "outer.inside", against = "inner.outside" }
supports.one = { boundary = "inner.x_axis", displacement.y = 0.0 }
supports.two = { boundary = "inner.y_axis", displacement.x = 0.0 }
supports.three = { boundary = "outer.x_axis", displacement.y = 0.0 }
supports.four = { boundary = "outer.y_axis", displacement.x = 0.0 }
uncertainty = { "bodies.inner.E" = "10 %", "bodies.outer.E" = "10 %", "geometry.interference" = 3e-5 }
sensitivity.parameters = ["bodies.inner.nu", "bodies.outer.nu"]
"""


def dragged(dim: int = 2, **tables: Any) -> Scene:
    """A block pressed, then drawn until a part of it slips."""
    top = DRAG if dim == 2 else {"x": DRAG["x"], "y": 0.01, "z": DRAG["y"]}
    base = {"friction": COULOMB} | tables.pop("base", {})
    return scene_of(dim, base=base, top=top, steps={"end": 2.0, "count": 2}, **EXACT | tables)


def pressed_ball() -> Scene:
    """An axisymmetric block of order 2 under pressure, on an elastic foundation."""
    tables = on_floor(2, {"mesh_size": 0.5, "order": 2}, {}, {"normal": {"law": "compliance", "c_n": 9.0, "m_n": 1.5}})
    tables |= {"model": "axisymmetric", "loads": {"top": {"boundary": "block.top", "pressure": 0.1}}} | EXACT
    return from_dict(tables)


SCENES: dict[str, tuple[Scene, tuple[str, ...]]] = {
    "order 1": (
        dragged(**TIP),
        ("bodies.block.E", "bodies.block.nu", "contacts.base.friction.mu", "supports.top.displacement.x"),
    ),
    "points that close": (
        dragged(geometry={"order": 2}, base={"gap_offset": 0.02}),
        ("bodies.block.nu", "contacts.base.friction.mu", "contacts.base.gap_offset", "supports.top.displacement.y"),
    ),
    "friction that slip weakens": (
        dragged(base={"friction": {"law": "static_kinetic", "mu_s": 0.4, "mu_k": 0.3, "slip_length": 0.2}}),
        ("bodies.block.E", "contacts.base.friction.mu_s", "contacts.base.friction.slip_length"),
    ),
    "bolts": (
        read("lap_joint", ["solver.tolerance=1e-12", "steps.count=2", "geometry.mesh_size=0.005"]),
        ("bodies.upper.E", "contacts.joint.friction.mu", "bolts.bolt.force", "bolts.bolt.stiffness"),
    ),
    "axisymmetric": (pressed_ball(), ("bodies.block.E", "contacts.base.normal.c_n", "loads.top.pressure")),
    "3D": (dragged(3), ("bodies.block.nu", "contacts.base.friction.mu", "supports.top.displacement.y")),
    "order 2 in 3D, springs before slip": (
        dragged(3, geometry={"order": 2, "mesh_size": 1.0}, base={"friction": COULOMB | {"k_T": 9.0}}),
        ("bodies.block.E", "contacts.base.friction.k_T", "contacts.base.friction.mu"),
    ),
    "tied": (
        two_blocks(
            2, {"x": 0.02, "y": -0.1}, {"normal": {"law": "tied"}}, probes={"tip": {"point": [1.0, 0.25]}}, **EXACT
        ),
        ("bodies.lower.E", "bodies.upper.nu", "supports.top.displacement.x", "geometry.height"),
    ),
    "points that slide": (
        two_blocks(
            2,
            {"x": [[0, 0], [1, 0], [2, 0.3]], "y": [[0, 0], [1, -0.05]]},
            {"friction": COULOMB, "sliding": True},
            steps={"end": 2.0, "count": 2},
            **EXACT,
        ),
        ("bodies.lower.E", "contacts.joint.friction.mu", "supports.top.displacement.x"),
    ),
    "points that slide in 3D": (
        two_blocks(
            3,
            {"x": [[0, 0], [1, 0.3]], "y": [[0, 0], [1, 0.1]], "z": [[0, 0], [1, -0.05]]},
            {"friction": COULOMB, "sliding": True},
            geometry={"mesh_size": 0.5, "lower_mesh_size": 0.5},
            **EXACT,
        ),
        ("bodies.upper.nu", "supports.top.displacement.y"),
    ),
    "a body that friction holds": (
        from_dict(
            on_floor(2, {"mesh_size": 0.5}, {"density": 0.01}, {"friction": {"law": "coulomb", "mu": 0.6}})
            | {
                "loads": {"side": {"boundary": "block.left", "pressure": 0.02}},
                "gravity": {"acceleration": [0.0, -9.81]},
            }
            | TIP
            | EXACT
        ),
        ("bodies.block.density", "gravity.acceleration.y", "loads.side.pressure", "bodies.block.E"),
    ),
}
READY = {
    "cylinders": ("bodies.upper.E", "contacts.line.friction.mu", "supports.top.displacement.x"),
    "foundation": ("bodies.block.E", "contacts.base.friction.mu", "obstacles.foundation.displacement.x"),
    "ring": ("bodies.ring.E", "contacts.outside.friction.mu", "obstacles.plate.displacement.y"),
    "shaft": ("bodies.ring.E", "contacts.bore.friction.mu", "obstacles.shaft.displacement.y"),
    "sphere": ("bodies.disc.E", "obstacles.plane.force.y"),
    "two_blocks": ("bodies.upper.E", "contacts.joint.friction.mu", "supports.top.displacement.x"),
}
SCENES |= {name: (read(name, [*coarse(name), "solver.tolerance=1e-12"]), keys) for name, keys in READY.items()}


def numbers(scene: Scene, edges: Sequence[MovingEdges] = ()) -> tuple[list[dict[Quantity, Any]], list[MovingEdges]]:
    """The numbers of each step, with areas that have moved beside edges; and these, by default their own."""
    simulation, steps = solved(replace(scene, sensitivity=Sensitivity()))
    if any(pair.sliding for pair in scene.contacts.values()):  # weights are those of other pairs at each step
        by_weights = {"contact_area", "stick_area", "slip_area", "mean_pressure"}
        return [{key: x for key, x in quantities(step).items() if key.quantity not in by_weights} for step in steps], []
    every = edges or [MovingEdges(simulation.system.contacts, step) for step in steps]
    return [quantities(step) | each(step) for step, each in zip(steps, every, strict=True)], [*every]


SIZE = 1e-5  # of a number, by which it differs: the sets do not change
Numbers = list[dict[Quantity, Any]]


@cache
def beside(name: str) -> tuple[Numbers, dict[str, tuple[Numbers, Numbers]]]:
    """The numbers of a scene, and for each of its keys those of the scenes on both sides, whatever form is tested."""
    scene, keys = SCENES[name]
    own, edges = numbers(scene)
    below, above = ({key: numbers(scaled(scene, key, 1 + size), edges)[0] for key in keys} for size in (-SIZE, SIZE))
    return own, {key: (below[key], above[key]) for key in keys}


ITERATIVE = ("order 1", "bolts", "3D", "points that slide", "a body that friction holds", "sphere", "shaft")


@pytest.mark.parametrize(("name", "form"), [*((name, "") for name in SCENES), *((n, "matrix-free") for n in ITERATIVE)])
def test_derivatives_are_the_differences_of_two_runs(name: str, form: str) -> None:
    scene, keys = SCENES[name]
    asking = replace(scene, sensitivity=Sensitivity(parameters=keys))
    simulation, steps = solved(with_keys(asking, {"solver.surface": form} if form else {}))
    assert isinstance(simulation.stepper.surface, CondensedSurface) != bool(form)
    (own, sides), known = beside(name), scene.parameters()
    for key in keys:
        below, above = sides[key]
        for step, mine, low, high in zip(steps, own, below, above, strict=True):
            assert len(step.sensitivity) > 20
            units = {number_of(quantity).unit: [] for quantity in mine}
            for quantity, value in mine.items():
                units[number_of(quantity).unit].append(np.abs(value).max())
            units["m"] += [np.abs(step.w).max(), step.u_ref]
            units.setdefault("N m", []).append(
                max(units["N"]) * simulation.system.extent
            )  # it is small beside its parts
            for quantity, value in mine.items():
                slope = step.sensitivity.get(str(quantity), {}).get(key, Slope()).value
                if slope is not None and not np.isnan(value).any():  # an edge of a point that just sticks, by rounding
                    true = (high[quantity] - low[quantity]) / (2 * SIZE * known[key])
                    floor = 5e-7 * max(units[number_of(quantity).unit]) / abs(known[key])
                    assert_allclose(slope, true, rtol=2e-6, atol=floor, err_msg=f"{quantity} by {key}")


def touching(size: float) -> Scene:
    """A confined column that just touches the foundation, moved by `size` [m] more."""
    held = {side: {"boundary": f"block.{side}", "displacement": {"x": 0.0}} for side in ("left", "right")}
    top = {"top": {"boundary": "block.top", "displacement": {"y": -0.1 - size}}}
    base = {"surface": "block.bottom", "against": "foundation", "gap_offset": 0.1}
    return scene_of(geometry=COLUMN, contacts={"base": base}, supports=held | top, **EXACT)


def test_a_point_at_its_bound_has_two_sides() -> None:
    key, stiffness = "supports.top.displacement.y", 0.7 / (1.3 * 0.4)  # (1 - nu) / ((1 + nu) (1 - 2 nu)) E / height
    _, (step,) = solved(replace(touching(0.0), sensitivity=Sensitivity(parameters=(key, "bodies.block.E"))))
    slope = step.sensitivity["contacts.base.normal_force"][key]
    assert slope.value is None
    assert_allclose([slope.below, slope.above], [-stiffness, 0.0], atol=1e-6)  # a smaller y presses
    assert step.sensitivity["contacts.base.normal_force"]["bodies.block.E"].value == pytest.approx(0.0, abs=1e-9)
    _, (further,) = solved(touching(1e-6))
    assert further.contacts["base"].normal_force == pytest.approx(1e-6 * stiffness, rel=1e-6)


def at_the_bound(dim: int) -> Scene:
    """A sheared layer, periodic along it, whose tangential traction is that of its friction bound at the end."""
    limit = 0.3 * 0.1 * 0.7 / (1.3 * 0.4) * 2.6  # mu p H / G with p = M U / H
    down = {"x": limit, "y": -0.1} if dim == 2 else {"x": limit, "y": 0.0, "z": -0.1}
    layers = {"one": {"boundary": "block.left", "with": "block.right"}}
    layers |= {"two": {"boundary": "block.front", "with": "block.back"}} if dim == 3 else {}
    return scene_of(
        dim, COLUMN | ({"width": 1.0} if dim == 3 else {}), {"friction": COULOMB}, down, periodic=layers, **EXACT
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_points_at_the_bound_of_friction_stick_on_one_side_and_slip_on_the_other(dim: int) -> None:
    key, mu = "supports.top.displacement.x", "contacts.base.friction.mu"
    _, (step,) = solved(replace(at_the_bound(dim), sensitivity=Sensitivity(parameters=(key, mu))))
    slopes = step.sensitivity["contacts.base.tangential_force"]
    assert slopes[key].value is None
    assert_allclose([slopes[key].below, slopes[key].above], [1 / 2.6, 0.0], atol=1e-5)  # G / H sticks
    normal = step.contacts["base"].normal_force
    assert_allclose([slopes[mu].below, slopes[mu].above], [normal, 0.0], atol=1e-5)  # a larger mu is not used
    slip = step.sensitivity["contacts.base.dissipation"][mu]
    assert slip.below == pytest.approx(-(normal**2) * 0.3 * 2.6, rel=1e-4)  # t times the slip mu p H / G
    assert slip.above == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("count", [1, 8])
def test_a_worn_column_loses_pressure_by_its_coefficient_of_wear(count: int) -> None:
    held = {side: {"boundary": f"block.{side}", "displacement": {"x": 0.0}} for side in ("left", "right")}
    top = {"boundary": "block.top", "displacement": {"y": [[0, 0], [1, -0.01]]}}
    base = {
        "surface": "block.bottom",
        "against": "foundation",
        "wear": {"k": 1e-4},
        "slide": [[0, 0], [1, 0], [2, 5.0]],
    }
    body, key = {"block": {"E": 1000.0, "nu": 0.3}}, "contacts.base.wear.k"
    scene = scene_of(
        geometry=COLUMN,
        bodies=body,
        contacts={"base": base},
        supports=held | {"top": top},
        steps={"end": 2.0, "count": 2 * count},
        **EXACT,
    )
    *_, step = solved(replace(scene, sensitivity=Sensitivity(parameters=(key,))))[1]
    worn = 1346.15384615 * 1e-4 * 5.0  # M k s / H; an implicit step leaves 1 / (1 + worn / count) of the pressure
    slope = step.sensitivity["contacts.base.normal_force"][key].value * 1e-4 / step.contacts["base"].normal_force
    assert slope == pytest.approx(-worn / (1 + worn / count), rel=1e-6)
    assert slope == pytest.approx(-worn, abs=worn**2 / count)  # of infinitely short ones


@pytest.fixture(scope="module")
def rings(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, StepResult]:
    """Lamé's shrink fit, with uncertain moduli and interference."""
    path = tmp_path_factory.mktemp("rings") / "rings.toml"
    path.write_text(RINGS)
    scene = read(path)
    return scene, solved(scene)[1][0]


def test_the_shrink_fit_has_lames_derivatives(rings: tuple[Scene, StepResult]) -> None:
    scene, step = rings
    known, contact = scene.parameters(), step.contacts["fit"]
    slopes = step.sensitivity["contacts.fit.mean_pressure"]
    found = {key: slope.value * known[key] / contact.mean_pressure for key, slope in slopes.items()}
    lame = {"bodies.inner.E": 0.170020121, "bodies.inner.nu": 0.117706237, "bodies.outer.E": 0.829979879}
    lame |= {"bodies.outer.nu": -0.015090543, "geometry.interference": 1.0}  # complex step of Lamé's formulas
    assert_allclose([found[key] for key in lame], [*lame.values()], atol=2.5e-3)  # of the mesh
    assert slopes["bodies.inner.E"].value > 0


def test_uncertain_inputs_add_up_by_the_law_of_propagation(rings: tuple[Scene, StepResult]) -> None:
    scene, step = rings
    stated = told(step, {Quantity("contacts", "fit", "mean_pressure"): ErrorParts(mesh=0.3)})["contacts"]["fit"]
    found = stated["uncertainty"]["mean_pressure"]
    assert found["inputs"] / step.contacts["fit"].mean_pressure == pytest.approx(0.08988, rel=1e-3)
    assert_allclose([found["shares"][key] for key in scene.uncertainty], [0.0358, 0.8528, 0.1114], atol=5e-4)
    assert found["combined"] == pytest.approx(np.hypot(found["inputs"], 0.3 / np.sqrt(3)))
    assert stated["uncertainty"]["normal_force"]["combined"] is None  # its own error is not known
    row = slope_columns(step)
    assert row["fit.mean_pressure.uncertainty"] == pytest.approx(found["inputs"])
    assert (
        row["fit.mean_pressure.sensitivity.bodies.inner.E"] == stated["sensitivity"]["mean_pressure"]["bodies.inner.E"]
    )


@pytest.mark.slow
def test_what_inputs_leave_is_what_five_hundred_true_runs_leave(rings: tuple[Scene, StepResult]) -> None:
    coarse = {"geometry.mesh_size": 1.0, "geometry.inner_mesh_size": 1.0, "geometry.order": 1}
    scene = with_keys(replace(rings[0], sensitivity=Sensitivity(), uncertainty={}), coarse)
    rng, count, found = np.random.default_rng(7), 500, list[float]()
    for draw in rng.standard_normal((count, 3)):
        run = scene
        for key, size, x in zip(rings[0].uncertainty, (0.1, 0.1, 0.03), draw, strict=True):
            run = scaled(run, key, 1 + size * x)
        found.append(solved(run)[1][0].contacts["fit"].mean_pressure)
    assert np.std(found, ddof=1) / np.mean(found) == pytest.approx(0.08988, rel=2 / np.sqrt(2 * (count - 1)))


def test_correlations_add_up_or_cancel(rings: tuple[Scene, StepResult]) -> None:
    scene, step = rings
    slopes = step.sensitivity["contacts.fit.mean_pressure"]
    one, two = parts = "bodies.inner.E", "bodies.outer.E"
    alike = with_keys(scene, {"uncertainty.correlations": [[one, two, 1.0]]}).covariance
    sizes = {key: np.sqrt(alike[key][key]) * slopes[key].value for key in alike}
    found = uncertainty(slopes, alike, None)
    both, rest = sum(sizes[key] for key in parts), sizes["geometry.interference"]
    assert found["inputs"] == pytest.approx(np.hypot(both, rest))
    assert found["shares"][one] == pytest.approx(sizes[one] * both / (both**2 + rest**2))
    assert sum(found["shares"].values()) == pytest.approx(1.0)
    apart = uncertainty(
        {"a": Slope(1.0), "b": Slope(1.0)}, {"a": {"a": 1.0, "b": -1.0}, "b": {"a": -1.0, "b": 1.0}}, None
    )
    assert apart["inputs"] == 0.0


def test_two_sides_and_none_are_said(rings: tuple[Scene, StepResult]) -> None:
    sides, none = Slope.of(1.0, 3.0, 0.1), Slope()
    assert sides.plain == {"below": 1.0, "above": 3.0}
    assert uncertainty({"a": sides}, {"a": {"a": 4.0}}, None)["inputs"] == pytest.approx(np.sqrt(20))
    assert uncertainty({"a": none}, {"a": {"a": 4.0}}, None) == {"inputs": None, "combined": None, "shares": None}
    assert Slope.of(1.0, 1.0 + 1e-9, 0.0).plain == pytest.approx(1.0)
    step = told(rings[1], None)
    assert step["contacts"]["fit"]["sensitivity"]["contact_area"]["bodies.inner.E"] is None  # it has no edge
    defined = {key: result_schema()[key] for key in ("$schema", "$defs")}
    validate(step["contacts"], defined | result_schema()["$defs"]["StepRecord"]["properties"]["contacts"])


def test_it_is_told_how_long_neighbours_take(monkeypatch: pytest.MonkeyPatch) -> None:
    left, true = list[float | None](), neighbours_of._pair

    def pair(scene: Scene, stepper: Stepper, *given: Any) -> Any:
        left.append(stepper.system.counters.clock.left)
        return true(scene, stepper, *given)

    monkeypatch.setattr(neighbours_of, "_pair", pair)
    prepare(replace(dragged(), sensitivity=Sensitivity(parameters=("bodies.block.E", "contacts.base.friction.mu"))))
    assert left[0] is None
    assert left[-1] is not None


def test_a_scene_that_asks_for_none_does_nothing_more() -> None:
    scene = dragged()
    simulation, steps = solved(scene)
    asking, told_too = solved(replace(scene, sensitivity=Sensitivity(parameters=("contacts.base.friction.mu",))))
    assert simulation.stepper.neighbours is None
    assert not steps[0].sensitivity
    assert "sensitivity" not in told(steps[0], None)["contacts"]["base"]
    own = told(told_too[0], None)["contacts"]["base"]
    assert own["sensitivity"]["normal_force"].keys() == {"contacts.base.friction.mu"}
    assert "uncertainty" not in own  # of inputs, of which the scene names none
    assert not any("sensitivity" in column for column in slope_columns(steps[0]))
    assert simulation.counters.error_solves < asking.counters.error_solves
    assert simulation.counters.volume_solves == asking.counters.volume_solves


@pytest.mark.parametrize("sliding", [False, True])
def test_a_run_goes_on_from_a_checkpoint_with_its_neighbours(sliding: bool) -> None:
    scene = replace(
        dragged(base={"sliding": sliding}), sensitivity=Sensitivity(parameters=("contacts.base.friction.mu",))
    )
    first, other = solved(scene)[0], prepare(replace(scene, output=replace(scene.output, error=False)))
    begun = prepare(first.scene)
    next(begun.steps())
    assert begun.reported is not None
    state, _ = Checkpoints(other.stepper).put_back(Checkpoints(begun.stepper).take(begun.reported), None)
    (resumed,) = other.steps(done=1, state=state)
    (_, whole) = first.steps()
    for quantity, slopes in whole.sensitivity.items():
        for key, slope in slopes.items():
            assert_allclose(_array(resumed.sensitivity[quantity][key]), _array(slope), rtol=1e-6, atol=1e-9)


def _array(slope: Slope) -> Array:
    return np.array(np.nan if slope.value is None else slope.value, float)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"sensitivity.parameters": ["contacts.base.friction.nu"]}, "no such number in the scene"),
        ({"sensitivity.parameters": ["obstacles.foundation.point.x"]}, "is 0, which has no size to vary it by"),
        ({"sensitivity.parameters": ["geometry.mesh_size"]}, "says how the scene is solved"),
        ({"uncertainty": {"bodies.block.E": "x %"}}, 'a positive number or "3 %"'),
        ({"uncertainty": {"bodies.block.E": -1.0}}, "expected one standard deviation"),
        ({"uncertainty": {"correlations": 1.0}}, "expected .*CORRELATION"),
        ({"uncertainty": BETWEEN | {"correlations": [[E, E, 0.5]]}}, "expected two numbers"),
        ({"uncertainty": BETWEEN | {"correlations": [[E, MU, 1.5]]}}, "a correlation from -1 to 1"),
        ({"uncertainty": BETWEEN | {"correlations": [[E, "bodies.block.G", 0.5]]}}, "no number with an uncertainty"),
        ({"uncertainty": BETWEEN | {"correlations": [[E, MU, 0.9], [E, NU, 0.9], [MU, NU, -0.9]]}}, "negative eigenv"),
        ({"uncertainty": {"bodies.block.E": True}}, "expected a number, or a text$"),
        (
            {"uncertainty": {"bodies": {"block": {"E": "3 %"}}}},
            "expected a number, or a text; write a key with dots in",
        ),
        ({"uncertainty": {"bodies.block.E": "inf %"}}, "expected one standard deviation"),
        ({"uncertainty": {"bodies.block.E": "1e200 %"}}, "expected one standard deviation"),
    ],
)
def test_what_is_no_parameter_is_refused(keys: Mapping[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        with_keys(dragged(), keys)


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"solver": {"method": "regularised"}}, "the contact laws as they are"),
        ({"springs": {"rope": SLACK}}, "springs that act in one way, as springs.rope"),
        ({"base": {"normal": {"law": "compliance", "c_n": 9.0, "m_n": 2.0}}}, "gives a contact other points"),
    ],
)
def test_what_has_no_derivative_yet_is_refused_with_the_reason(tables: dict[str, Any], words: str) -> None:
    scene = dragged(**tables)
    key = "contacts.base.normal.m_n" if "compliance" in str(tables) else "bodies.block.E"
    with pytest.raises(SceneError, match=words):
        prepare(replace(scene, sensitivity=Sensitivity(parameters=(key,))))


def test_a_periodic_twin_is_no_edge_of_what_touches() -> None:
    """All of the fit touches and sticks: its areas have no derivatives, rather than those of rounding."""
    key = "bodies.inner.E"
    scene = read("sector", [*coarse("sector")])
    *_, step = solved(replace(scene, sensitivity=Sensitivity(parameters=(key,))))[1]
    for area in ("contact_area", "stick_area", "slip_area"):
        assert step.sensitivity[f"contacts.fit.{area}"][key] == Slope()
    assert step.sensitivity["contacts.fit.normal_force"][key].value is not None


def test_a_node_that_another_radius_gives_to_the_other_roller_is_refused() -> None:
    scene = read("three_point_bending", [*coarse("three_point_bending")])
    with pytest.raises(SceneError, match=r"obstacles\.left\.radius: another value gives a contact other points"):
        prepare(replace(scene, sensitivity=Sensitivity(parameters=("obstacles.left.radius",))))


def test_all_are_the_numbers_that_have_a_size() -> None:
    scene = replace(dragged(), sensitivity=Sensitivity(parameters="all"))
    simulation, _ = solved(scene)
    assert simulation.stepper.neighbours is not None
    assert isinstance(simulation.stepper.surface, CondensedSurface)
    assert {"bodies.block.E", "contacts.base.friction.mu"} < {*simulation.stepper.neighbours.sizes}
    assert "contacts.base.gap_offset" not in simulation.stepper.neighbours.sizes  # it is 0


def rows(printed: str) -> dict[str, float]:
    """Derivatives by number, of a table."""
    cells = (line.split("│") for line in printed.splitlines() if line.count("│") > 2)
    return {by.strip(): float(value) for _, by, value, *_ in cells}


def test_derivatives_of_an_answer_in_doubt_say_so(capsys: pytest.CaptureFixture[str]) -> None:
    coarse = [
        "geometry.mesh_size=1.0",
        "geometry.contact_mesh_size=1.0",
        "supports.top.displacement.y=[[0, 0], [1, -0.6]]",
    ]
    with pytest.raises(SystemExit, match=r"^1$"):
        sensitivity("block", quantity=["base.normal_force", "energy.time_remainder"], override=coarse)
    alone, said = capsys.readouterr()
    assert "stickslip: doubtful: " in said
    assert "bodies.block.E" in alone
    assert "energy.time_remainder = " in alone  # which has no error, and no derivatives


def test_two_ranks_print_the_derivatives_of_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["two_blocks", "--set", "geometry.mesh_size=0.5", "--set", "geometry.contact_mesh_size=0.2"]
    words += ["--set", "geometry.lower_mesh_size=0.5", "--set", "solver.tolerance=1e-12", "--quantity", "energy.stored"]
    with pytest.raises(SystemExit, match=r"^0$"):
        sensitivity(words[0], quantity=["energy.stored"], override=words[2:-2:2])
    alone, said = capsys.readouterr()
    assert "energy.stored = " in alone
    assert " ± " in alone
    assert said.startswith("meshing and preparing ...")
    alone_rows, done = rows(alone), mpirun(2, ["sensitivity", *words], tmp_path)
    assert done.returncode == 0, done.stderr
    (first, *_), both = alone_rows, rows(done.stdout)
    assert first == "supports.top.displacement.y"  # what it depends on most
    assert both.keys() == alone_rows.keys()
    assert_allclose([*both.values()], [alone_rows[key] for key in both], rtol=1e-5)


def test_true_runs_tell_where_the_linear_answer_lies() -> None:
    covariance = {"a": {"a": 4.0, "b": 2.0}, "b": {"a": 2.0, "b": 4.0}}
    straight = TrueRuns(covariance, {"a": ({"N": 8.0}, {"N": 12.0}), "b": ({"N": 9.0}, {"N": 11.0})})
    assert_allclose(straight.spread("N", 10.0), np.sqrt(7.0) * np.array([-1, 1]))  # slopes 1 and 1/2
    assert not straight.doubts("N", 10.0, np.sqrt(7.0))
    assert straight.doubts("N", 10.0, 1.0)
    bent = TrueRuns({"a": {"a": 4.0}}, {"a": ({"N": 8.0}, {"N": 10.0})})  # a larger one changes nothing
    assert_allclose(bent.spread("N", 10.0), [-2.0, 0.0])
    assert bent.doubts("N", 10.0, 1.4)
    assert not TrueRuns({"a": {"a": 1.0}}, {"a": ({"N": 5.0}, {"N": 5.0})}).doubts("N", 5.0, 0.0)


@pytest.mark.slow
def test_the_command_checks_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.5", f'uncertainty={{"{E}"="3 %","{MU}"=0.01}}']
    with pytest.raises(SystemExit, match="0"):
        sensitivity("block", ["energy.stored"], tmp_path / "t.png", tmp_path / "runs", override=words)
    assert "by derivatives" in capsys.readouterr().out
    assert (tmp_path / "t.png").stat().st_size > 10_000
    assert len([*(tmp_path / "runs").glob("*/*/result.json")]) == 4


def test_swings_are_those_of_a_deviation_or_a_percent(rings: tuple[Scene, StepResult], tmp_path: Path) -> None:
    scene, step = rings
    found = swings(step, scene.parameters())["fit.mean_pressure"]
    assert next(iter(found)) == "bodies.outer.E"
    low, high = found["bodies.outer.E"]
    assert high == pytest.approx(-low) == pytest.approx(0.083 * step.contacts["fit"].mean_pressure, rel=5e-3)
    assert found["bodies.inner.nu"][1] == pytest.approx(0.00118 * step.contacts["fit"].mean_pressure, rel=5e-2)
    assert draw_tornado(tmp_path / "t.png", step, scene.parameters(), "rings")
    bare = replace(step, sensitivity={})
    assert draw_tornado(tmp_path / "none.png", bare, scene.parameters(), "rings") is None


def test_the_budget_tells_parts_and_inputs(rings: tuple[Scene, StepResult]) -> None:
    scene, step = rings
    pressure = Quantity("contacts", "fit", "max_pressure")
    last = told(step, {pressure: ErrorParts(mesh=0.3, iteration=1e-9)})
    head, rows = error_budget({"scene": {"model": "plane strain"}, "steps": [last]})
    assert head == ("number", "±", "mesh", "inputs, k = 1", "with inputs, k = 1")
    known = {row[0]: row for row in rows}
    assert known["fit largest pressure [Pa]"][2] == "0.3"
    assert known["elastic energy [J/m]"][2] == "–"
    assert error_budget({"steps": []})[1] == []
    assert scene.covariance


def test_a_script_has_the_derivatives_of_its_history() -> None:
    key, away = "supports.top.displacement.x", {"x": 0.04, "y": -0.1}
    script = prepare(replace(dragged(), sensitivity=Sensitivity(parameters=(key, MU)))).script()
    first = script.step(to=1.0, supports={"top": {"x": 0.0, "y": -0.1}})
    assert key not in first.sensitivity["contacts.base.tangential_force"]  # nothing has moved along x
    step = script.step(to=2.0, supports={"top": away})
    _, repeated = solved(replace(script.scene, sensitivity=Sensitivity(parameters=(key, MU))))
    for by, slope in step.sensitivity["contacts.base.tangential_force"].items():
        assert slope.value == pytest.approx(
            repeated[-1].sensitivity["contacts.base.tangential_force"][by].value, rel=1e-5
        )
    changed = script.step(to=3.0, contacts={"base": {"mu": 0.5}})
    assert not changed.sensitivity
