"""What the history decides: the branch that it reaches, and where a closing point begins to slip."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip import StepResult, read, steps
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.stepping.touch import Way

SPRINGS = {0.0451863064206929: [-0.975070012221757, 0.221897434112842],
           4.20481369357931: [0.221897434112842, 0.975070012221757]}  # stiffness and direction  # fmt: skip
PARTICLE = """
model = "plane strain"
geometry = {{ builder = "block", length = 1.0, height = 1.0, mesh_size = 0.5 }}
bodies.block = {{ E = 1e5, nu = 0.3 }}
obstacles.floor = {{ shape = "plane", point = [0.0, 0.0], normal = [0.0, 1.0] }}
contacts.base = {{ surface = "block.bottom", against = "floor", friction = {{ law = "coulomb", mu = {mu} }} }}
steps = {{ end = 3.0, count = {count} }}
output.error = false
springs = {{ {springs} }}
[remote_points.handle]
boundary = "block.top"
point = [0.5, 1.0]
coupling = "rigid"
rotation.z = 0.0
force = {{ x = {x}, y = [[0, 0], [1, -1.0]] }}
"""
SOLID = """
model = "3d"
geometry = {{ builder = "block", length = 1.0, width = 1.0, height = 1.0, mesh_size = 1.0 }}
bodies.block = {{ E = 1e5, nu = 0.3 }}
obstacles.floor = {{ shape = "plane", point = [0.0, 0.0, 0.0], normal = [0.0, 0.0, 1.0] }}
contacts.base = {{ surface = "block.bottom", against = "floor", friction = {{ law = "coulomb", mu = {mu} }} }}
steps = {{ end = 3.0, count = {count} }}
output.error = false
springs = {{ {springs}, across = {{ at = "block.top", stiffness = 1.0, direction = [0, 1, 0] }} }}
[remote_points.handle]
boundary = "block.top"
point = [0.5, 0.5, 1.0]
coupling = "rigid"
rotation = {{ x = 0.0, y = 0.0, z = 0.0 }}
force = {{ x = {x}, z = [[0, 0], [1, -1.0]] }}
"""
WAVE = """
For i In {0:40}
  x = -0.5 + i / 40; Point(i + 1) = {x, 0.001 * (1 - Cos(2 * Pi * x)), 0, 0.02};
EndFor
Spline(1) = {1:41};
Point(1001) = {0.5, 2, 0, 0.3}; Point(1002) = {-0.5, 2, 0, 0.3};
Line(2) = {41, 1001}; Line(3) = {1001, 1002}; Line(4) = {1002, 1};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1}; Periodic Curve {2} = {-4};
Physical Surface("wave") = {1}; Physical Curve("wave.bottom") = {1}; Physical Curve("wave.right") = {2};
Physical Curve("wave.top") = {3}; Physical Curve("wave.left") = {4};
"""
HALF_SPACE = """
model = "plane strain"
geometry = {{ file = "wave.geo", order = 2 }}
bodies.wave = {{ E = 1e4, nu = 0.4999 }}
obstacles.floor = {{ shape = "plane", point = [0.0, 0.0], normal = [0.0, 1.0] }}
contacts.base = {{ surface = "wave.bottom", against = "floor", friction = {{ law = "coulomb", mu = 0.4 }} }}
periodic.sides = {{ boundary = "wave.right", with = "wave.left" }}
loads.top = {{ boundary = "wave.top", force = {{ x = {x}, y = -20.0 }} }}
steps = {{ end = 1.0, count = {count} }}
output.error = false
"""
LEG = """
lean = {lean}; Point(1) = {{0, 0, 0, 0.15}}; Point(2) = {{1, 0, 0, 0.15}}; Point(3) = {{lean + 0.25, 4, 0, 0.15}};
Point(4) = {{lean, 4, 0, 0.15}}; Line(1) = {{1, 2}}; Line(2) = {{2, 3}}; Line(3) = {{3, 4}}; Line(4) = {{4, 1}};
Curve Loop(1) = {{1, 2, 3, 4}}; Plane Surface(1) = {{1}}; Physical Surface("leg") = {{1}};
Physical Curve("leg.bottom") = {{1}}; Physical Curve("leg.right") = {{2}}; Physical Curve("leg.top") = {{3}};
Physical Curve("leg.left") = {{4}};
"""
LEANING = """
model = "plane strain"
geometry.file = "leg.geo"
bodies.leg = {{ E = 1.0, nu = 0.3 }}
obstacles.floor = {{ shape = "plane", point = [0.0, 0.0], normal = [0.0, 1.0] }}
contacts.base = {{ surface = "leg.bottom", against = "floor", friction = {{ law = "coulomb", mu = {mu} }} }}
supports.top = {{ boundary = "leg.top", displacement = {{ x = {x}, y = {y} }} }}
loads.right = {{ boundary = "leg.right", traction = {right} }}
loads.left = {{ boundary = "leg.left", traction = {left} }}
output.error = false
"""
PAD = """
model = "{model}"
geometry = {{ builder = "block", length = 2.0, {width}height = 1.0, mesh_size = 0.5 }}
bodies.block = {{ E = 1.0, nu = 0.0 }}
obstacles.floor = {{ shape = "plane", point = [0.0, 0.0, {level}], normal = [0.0, 0.0, 1.0] }}
contacts.base = {{ surface = "block.bottom", against = "floor", friction = {{ law = "coulomb", mu = {mu} }} }}
supports.top = {{ boundary = "block.top", displacement = {{ x = 0.02, {up} = -0.01 }} }}
steps = {{ end = 1.0, count = {count} }}
output.error = false
"""


def solved(folder: Path, text: str, geometry: str = "") -> list[StepResult]:
    (folder / "scene.toml").write_text(text)
    if geometry:
        (folder / ("wave.geo" if "wave" in geometry else "leg.geo")).write_text(geometry)
    return list(steps(read(folder / "scene.toml")))


@pytest.mark.parametrize("count", [3, 7, 30])
@pytest.mark.parametrize(
    ("mu", "x"),
    [
        (0.5, "[[0, 0], [1, 0], [2, -0.3], [3, -0.4]]"),
        (2.0, "[[0, 0], [1, 0], [2, -0.3], [3, -1.8]]"),
        (2.0, "[[0, 0], [1, 0], [1.5, -0.6], [2, -1.2], [2.5, -1.5], [3, -1.8]]"),
        (2.0, "[[0, 0], [1, 0], [2, 1.5], [3, -1.8]]"),
    ],
)
def test_a_particle_sticks_until_its_friction_is_spent(mu: float, x: str, count: int, tmp_path: Path) -> None:
    """Klarbring's: it could as well be in the air, or slip; where a load turns does not matter."""
    springs = ", ".join(
        f's{k} = {{ at = "block.top", stiffness = {s}, direction = {d} }}' for k, (s, d) in enumerate(SPRINGS.items())
    )
    found = solved(tmp_path, PARTICLE.format(mu=mu, x=x, springs=springs, count=count))
    last = found[-1]
    for step in found:
        assert step.contacts["base"].normal_force == pytest.approx(min(step.time, 1.0), rel=1e-3)
        assert step.jump is None
    assert last.contacts["base"].tangential_force == pytest.approx(0.4 if mu == 0.5 else 1.8, rel=1e-3)
    assert last.unique == "several"
    assert min(one["base"] for one in last.other_solutions) == 0.0


def test_a_particle_in_space_sticks_as_well(tmp_path: Path) -> None:
    springs = ", ".join(
        f's{k} = {{ at = "block.top", stiffness = {s}, direction = {[d[0], 0, d[1]]} }}'
        for k, (s, d) in enumerate(SPRINGS.items())
    )
    x = "[[0, 0], [1, 0], [2, -0.3], [3, -1.8]]"
    *_, last = solved(tmp_path, SOLID.format(mu=2.0, x=x, springs=springs, count=3))
    assert last.contacts["base"].tangential_force == pytest.approx(1.8, rel=1e-3)
    assert last.unique == "several"


def test_what_no_solution_goes_on_from_jumps(tmp_path: Path) -> None:
    """The particle leaves the floor where its friction is spent: the energy set free is neither stored nor rubbed."""
    springs = ", ".join(
        f's{k} = {{ at = "block.top", stiffness = {s}, direction = {d} }}' for k, (s, d) in enumerate(SPRINGS.items())
    )
    found = solved(tmp_path, PARTICLE.format(mu=0.5, x="[[0, 0], [1, 0], [3, -0.7]]", springs=springs, count=15))
    (jump,) = (k for k, step in enumerate(found) if step.jump is not None)
    before, after = found[jump - 1], found[jump]
    assert (before.contacts["base"].normal_force > 0.9, after.contacts["base"].normal_force) == (True, 0.0)
    assert before.contacts["base"].tangential_force < 0.5 < 0.7 / 2 * (after.time - 1)
    assert after.substeps > 1  # it was looked for in between
    assert after.jump == pytest.approx(after.energy.time_remainder - before.energy.time_remainder, rel=0.05)
    assert after.jump > 0


def test_an_edge_that_neither_sticks_nor_slips_lets_go() -> None:
    """With mu of 200 a point at the edge has no state between that in which it sticks and that in which it is open."""
    words = ["geometry.mesh_size=0.0035", "contacts.joint.friction.mu=200", "steps.count=6", "output.error=false"]
    *_, step = steps(read("lap_joint", words))
    assert step.time == pytest.approx(2.0)


@pytest.mark.parametrize(("lean", "mu"), [(1.0, 0.4), (1.3, 0.33)])
def test_a_leaning_leg_has_several_answers(lean: float, mu: float, tmp_path: Path) -> None:
    """One of them slips everywhere under a uniform pressure, for loads that are made so."""
    nu, p, slip = 0.3, 1e-5, 5e-5
    lame, G = nu / (1 + nu) / (1 - 2 * nu), 0.5 / (1 + nu)
    e, c = -p / (lame + 2 * G), -mu * p / G
    stress = np.array([[lame * e, G * c], [G * c, (lame + 2 * G) * e]])
    sides = {"right": np.array([4.0, 0.75 - lean]), "left": np.array([-4.0, lean])}
    pulls = {name: (stress @ n / np.linalg.norm(n)).tolist() for name, n in sides.items()}
    text = LEANING.format(mu=mu, x=4 * c - slip, y=4 * e, **pulls)
    (step,) = solved(tmp_path, text, LEG.format(lean=lean))
    met = [step.contacts["base"].normal_force, *(one["base"] for one in step.other_solutions)]
    assert step.unique == "several"
    assert min(abs(force - p) for force in met) < 1e-4 * p


def ratio(step: StepResult, inside: float) -> Any:
    """t / (mu p) at the points with more than a part of the largest pressure."""
    base = step.contacts["base"]
    on = base.pressure > inside * base.max_pressure
    return np.abs(base.traction[on, 0]) / (0.4 * base.pressure[on])


@pytest.mark.parametrize(("part", "count"), [(0.5, 1), (0.5, 8), (0.25, 3)])
def test_loads_in_proportion_do_not_slip(part: float, count: int, tmp_path: Path) -> None:
    """Every point has the same part of its friction; near the edge the mesh is felt, on average it is not."""
    *_, step = solved(tmp_path, HALF_SPACE.format(x=part * 0.4 * 20.0, count=count), WAVE)
    assert_allclose(np.median(ratio(step, 0.05)), part, atol=0.01)
    assert_allclose(ratio(step, 0.98), part, atol=0.01)
    assert step.contacts["base"].dissipation_total < 1e-3 * step.energy.stored


@pytest.mark.parametrize("model", ["plane strain", "3d"])
@pytest.mark.parametrize(("mu", "count"), [(2.0, 1), (2.0, 3), (0.2, 1)])
def test_a_pad_slips_from_where_it_falls(model: str, mu: float, count: int, tmp_path: Path) -> None:
    """Half way down it touches: from there on it is sheared by .01, or slips."""
    solid = model == "3d"
    text = PAD.format(
        model=model, width="width = 1.0, " if solid else "", level=-0.005, up="z" if solid else "y", mu=mu, count=count
    )
    if not solid:
        text = text.replace("[0.0, 0.0, -0.005]", "[0.0, -0.005]").replace("[0.0, 0.0, 1.0]", "[0.0, 1.0]")
    *_, step = solved(tmp_path, text)
    base, traction = step.contacts["base"], min(0.5 * 0.01, mu * 0.005)
    middle = np.argmin(np.abs(base.points[:, 0] - 1.0))  # the sides bend with the shear
    assert base.pressure.mean() == pytest.approx(0.005, rel=0.2)
    assert abs(base.traction[middle, 0]) == pytest.approx(traction, rel=0.1)
    slipped = (0.01 - traction / 0.5) * traction * base.contact_area
    assert base.dissipation_total == pytest.approx(slipped, rel=0.1, abs=1e-9)


def test_what_rounding_leaves_of_a_motion_along_a_floor_closes_nothing() -> None:
    """A pad that only friction holds along y: the normals have 1e-17 of that motion, and all of its fall."""
    motions = np.array([[1e-17, 1.0], [-3e-17, 0.9], [1.0, 0.0]])  # along the floor, and down
    surface = SimpleNamespace(N=np.eye(3), R=motions)
    way = Way(cast(SurfaceProblem, SimpleNamespace(surface=surface)), np.zeros(3), np.zeros(3), 1e-8)
    assert_allclose(way._motions, [[0.0, 1.0], [0.0, 0.9], [1.0, 0.0]], rtol=0, atol=0)
