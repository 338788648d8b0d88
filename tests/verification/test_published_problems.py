"""Published problems with several solutions, none, or that depend on the path: small scenes of ours."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from verification.test_path_dependence import HALF_SPACE, WAVE, solved
from verification.test_triangle import CLEARANCE, K, scene_of

from shared.cases import slow
from stickslip import NoEquilibriumError
from stickslip.workflows.lab.verification.prepared import prepare

MU, LOAD = 0.4, 20.0  # of the wavy half-space
FULL = np.pi * 1e4 / (1 - 0.4999**2) * 1e-3  # mean pressure that closes it (Westergaard)
SLOPE = """
model = "plane strain"
geometry = {{ builder = "block", length = 1.0, height = 1.0, mesh_size = 0.5 }}
bodies.block = {{ E = 1e5, nu = 0.3 }}
obstacles.slope = {{ shape = "plane", point = [0.0, 0.0], normal = [0.0, 1.0] }}
contacts.base = {{ surface = "block.bottom", against = "slope", friction = {{ law = "coulomb", mu = 0.5 }} }}
springs.rope = {{ at = "block.top", stiffness = 1.0, direction = [1, 0] }}
steps = {{ end = 3.0, count = 3 }}
output.error = false
[remote_points.handle]
boundary = "block.top"
point = [0.5, 1.0]
coupling = "rigid"
rotation.z = 0.0
force = {{ x = [[0, 0], [1, 0.2], [2, {most}], [3, 0.2]], y = [[0, 0], [1, -1.0]] }}
"""
CYCLES = """
model = "plane strain"
geometry = {{ builder = "block", length = 2.0, height = 1.0, mesh_size = 0.25 }}
bodies.block = {{ E = 1.0, nu = 0.3 }}
obstacles.floor = {{ shape = "plane", point = [0.0, 0.0], normal = [0.0, 1.0] }}
contacts.base = {{ surface = "block.bottom", against = "floor", friction = {{ law = "coulomb", mu = 0.3 }} }}
supports.top = {{ boundary = "block.top", displacement = {{ x = {x}, y = [[0, 0], [1, -0.05]] }} }}
steps = {{ end = 18, count = 18 }}
output.error = false
"""
LADDER = """
import numpy as np
def build(model, parameters):
    c, s = np.cos({angle}), np.sin({angle})
    place = lambda a, b: (a * c - b * s, a * s + b * c, 0)
    corners = [model.geo.addPoint(*place(a, b), 0.1) for a, b in ((0, 0), (4, 0), (4, 0.2), (0, 0.2))]
    lines = [model.geo.addLine(corners[k], corners[(k + 1) % 4]) for k in range(4)]
    face = model.geo.addPlaneSurface([model.geo.addCurveLoop(lines)])
    model.geo.synchronize()
    model.setPhysicalName(2, model.addPhysicalGroup(2, [face]), "ladder")
    for name, line in zip(("below", "head", "above", "foot"), lines):
        model.setPhysicalName(1, model.addPhysicalGroup(1, [line]), f"ladder.{{name}}")
"""
LEANS = """
model = "plane strain"
geometry.file = "ladder.py"
bodies.ladder = {{ E = 1e6, nu = 0.3, density = 1.0 }}
obstacles.floor = {{ shape = "plane", point = [0.0, 0.0], normal = [0.0, 1.0] }}
obstacles.wall = {{ shape = "plane", point = [{wall}, 0.0], normal = [-1.0, 0.0] }}
contacts.foot = {{ surface = "ladder.foot", against = "floor", friction = {{ law = "coulomb", mu = {mu} }} }}
contacts.head = {{ surface = "ladder.head", against = "wall", friction = {{ law = "coulomb", mu = {mu} }} }}
gravity.acceleration = [0.0, -1.0]
output.error = false
"""
LAYER = """
model = "plane strain"
geometry = {{ builder = "block", length = 8.0, height = 1.0, mesh_size = 0.25 }}
bodies.block = {{ E = 1.0, nu = 0.3 }}
obstacles.bed = {{ shape = "plane", point = [0.0, 0.0], normal = [0.0, 1.0] }}
contacts.base = {{ surface = "block.bottom", against = "bed" }}
supports.middle = {{ point = [4.0, 1.0], displacement = {{ x = 0.0 }} }}
loads.press = {{ boundary = "block.top", pressure = "{size} * max(0, 1 - 2 * abs(x - 4))" }}
output.error = false
"""


@pytest.mark.parametrize("first", [1.0, 0.2])
def test_loads_that_vary_both_slip_by_their_order(first: float, tmp_path: Path) -> None:
    """Pressed, then pulled, it slips from the edge to where a load less by Q / mu would reach; pressed by a part, then
    by both in proportion below mu, no point slips.
    """
    text = HALF_SPACE.format(x=f"[[0, 0], [1, 0], [2, {0.5 * MU * LOAD}]]", count=8).replace("end = 1.0", "end = 2.0")
    text = text.replace("y = -20.0", f"y = [[0, 0], [1, {-first * LOAD}], [2, {-LOAD}]]")
    *_, last = solved(tmp_path, text, WAVE)
    base, stuck = last.contacts["base"], LOAD / 2 if first == 1.0 else LOAD
    assert_allclose(base.contact_area / 2, half_width(LOAD), rtol=0.01)
    assert_allclose(base.stick_area / 2, half_width(stuck), rtol=0.02)
    assert (base.dissipation_total > 1e-3 * last.energy.stored) == (first == 1.0)


def half_width(load: float) -> float:
    """Westergaard's contact of a wave of length 1 [m]."""
    return float(np.arcsin(np.sqrt(load / FULL)) / np.pi)


@pytest.mark.parametrize(("most", "rests"), [(0.2, 0.0), (1.0, 0.5), (-0.6, -0.1)])
def test_a_block_on_a_slope_rests_where_its_path_leaves_it(most: float, rests: float, tmp_path: Path) -> None:
    """On a rope, with .2 of its weight along the slope at the end; what it slips before is what friction .5 leaves."""
    *_, last = solved(tmp_path, SLOPE.format(most=most))
    assert_allclose(last.displacement[:, 0].mean(), rests, atol=1e-4)
    assert_allclose(last.contacts["base"].tangential_force, abs(0.2 - rests), atol=1e-4)


def test_a_steady_cycle_depends_on_what_came_before(tmp_path: Path) -> None:
    """With coupling: sheared by more at first, the same cycle dissipates five times as much, turn for turn."""
    found = []
    for first in (0.0, 0.04):
        x = [[0, 0], [1, 0], [2, first], *([3 + k, 0.03 * (-1) ** k] for k in range(16))]
        history = solved(tmp_path, CYCLES.format(x=x))
        total = np.array([step.contacts["base"].dissipation_total for step in history])
        assert {step.unique for step in history} == {"proved"}
        assert_allclose(total[-1] - total[-3], total[-3] - total[-5], rtol=0.01)
        found.append(total[-1] - total[-3])
    assert_allclose(found[1] / found[0], 5.5, rtol=0.05)


@pytest.mark.parametrize("angle", [0.7, *slow(1.0)])
def test_a_ladder_stands_from_the_friction_of_statics_on(angle: float, tmp_path: Path) -> None:
    """Both ends slip at the least coefficient; above it how much the wall bears is not for statics to say."""
    (tmp_path / "ladder.py").write_text(LADDER.format(angle=angle))
    least = grip(angle)
    (step,) = solved(tmp_path, LEANS.format(mu=1.05 * least, wall=4 * np.cos(angle)))
    forces = step.contacts["foot"].force + step.contacts["head"].force
    assert_allclose(forces, [0.0, 0.8], atol=1e-8)
    assert step.unique == "not proved"
    with pytest.raises(NoEquilibriumError, match="contact and friction cannot balance the loads"):
        solved(tmp_path, LEANS.format(mu=0.95 * least, wall=4 * np.cos(angle)))


def grip(angle: float) -> float:
    """Least coefficient at which a ladder that leans at an angle stands: H, its thrust, is mu times the weight less
    mu H, and of moments about its foot weight times w is H (h + mu a).
    """
    c, s = np.cos(angle), np.sin(angle)
    a, h, w = 4 * c, 4 * s, 2 * c - 0.1 * s
    return float(max(np.roots([a - w, h, -w])))


def test_a_receding_contact_has_its_extent_at_any_load(tmp_path: Path) -> None:
    small, large = (solved(tmp_path, LAYER.format(size=size))[0].contacts["base"] for size in (1e-3, 1e-2))
    assert small.contact_area == large.contact_area < 4.0
    assert_allclose(10 * small.max_pressure, large.max_pressure, rtol=1e-9)


@pytest.mark.parametrize(
    ("law", "unique"),
    [
        ("", "proved"),
        (', friction = { law = "coulomb", mu = 0.3 }', "proved"),
        (', friction = { law = "coulomb", mu = 2.0 }', "not proved"),
        (', friction = { law = "tresca", bound = 0.01 }', "not proved"),
        (', normal = { law = "compliance", c_n = 1.0 }, friction = { law = "coulomb", mu = 0.3 }', "not proved"),
    ],
)
def test_one_solution_is_proved_of_little_friction_alone(law: str, unique: str, tmp_path: Path) -> None:
    text = CYCLES.format(x=0.03).replace("end = 18, count = 18", "count = 1").replace("[[0, 0], [1, -0.05]]", "-0.02")
    (step,) = solved(tmp_path, text.replace(', friction = { law = "coulomb", mu = 0.3 }', law))
    assert step.unique == unique


@pytest.mark.parametrize("angle", [-170.0, -160.0, -145.0])
def test_answers_of_one_node_appear_and_vanish_with_the_load(angle: float, tmp_path: Path) -> None:
    """One, three, one, as the load turns; each is found, and no other."""
    load = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    (step,) = prepare(scene_of(3.0, tmp_path, [load.tolist()], floor=CLEARANCE)).steps()
    met = [step.contacts["tip"].normal_force, *(one["tip"] for one in step.other_solutions)]
    assert_allclose(sorted(met), sorted(2 * np.array(answers(load, 3.0))), atol=2e-6)
    assert step.unique == ("several" if len(met) > 1 else "not proved")


def answers(load: np.ndarray, mu: float) -> list[float]:
    """Normal reaction of each state of the free node, by cases."""
    found = [0.0] * bool(np.linalg.solve(K, load)[1] >= 0)
    found += [-load[1]] * bool(abs(load[0]) <= -mu * load[1])
    for sign in (1, -1):
        slip, reaction = np.linalg.solve([[K[0, 0], sign * mu], [K[1, 0], -1]], load)
        found += [reaction] * bool(reaction >= 0 and sign * slip >= 0)
    return found
