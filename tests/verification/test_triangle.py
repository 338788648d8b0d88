"""One node on a plane with much friction: up to three answers; one of them is found, and the others are said.

Reference: one P1 triangle, two corners clamped; Coulomb's law by cases on K u + r = f, r in the cone.
"""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import often, slow
from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Solution, Status
from stickslip.solvers.newton import path
from stickslip.solvers.newton.attempts import Start
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.stepping.state import State
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.run.warnings import doubts
from stickslip.workflows.scene_file.read import from_dict

DRAWN = """
def build(model, parameters):
    corners = [model.geo.addPoint(x, y, 0) for x, y in ((0, 0), (0.5, 0.732739), (-0.5, 1.267261))]
    lines = [model.geo.addLine(corners[a], corners[b]) for a, b in ((0, 1), (1, 2), (2, 0))]
    face = model.geo.addPlaneSurface([model.geo.addCurveLoop(lines)])
    model.geo.synchronize()
    for line in lines:
        model.mesh.setTransfiniteCurve(line, 2)
    model.mesh.setTransfiniteSurface(face)
    sides = {"corner.low": [lines[0], lines[2]], "corner.high": [lines[1]]}
    model.setPhysicalName(2, model.addPhysicalGroup(2, [face]), "corner")
    for name, parts in sides.items():
        model.setPhysicalName(1, model.addPhysicalGroup(1, parts), name)
"""
LOW = np.hypot(0.5, 0.732739) + np.hypot(0.5, 1.267261)  # lengths of the two lower sides
K = np.array([[0.3846154, 0.2569820], [0.2569820, 0.7280220]])  # of the free node, E = 1, nu = 0.3, plane strain
LOAD = np.array([-1.0, -0.6])
OPEN = (-2.681854, 0.122507)  # displacement
STICK = (1.0, 0.6)  # reaction
SLIP = (-2.070766, 0.203552, 0.067851)  # u_t, reaction
CLEARANCE = 0.3663695  # of the node's weighted gap above a plane at its own height: the plane is that much higher
UNIQUE = 1.4966630  # below this coefficient there is one answer, whatever the load


def answer(mu: float, folder: Path, path: list[list[float]]) -> tuple[np.ndarray, np.ndarray]:
    """Displacement of the free node and the reaction on it at the end of a path of loads on it."""
    simulation = prepare(scene_of(mu, folder, path))
    *_, step = simulation.steps()
    free = int(np.argmin(np.linalg.norm(simulation.data.points, axis=1)))
    return step.displacement[free], step.contacts["tip"].force


def scene_of(mu: float, folder: Path, path: list[list[float]], floor: float = 0.0) -> Scene:
    file = folder / "triangle.py"
    file.write_text(DRAWN)
    times = np.arange(len(path)) + 1.0
    # half of what is spread over a side goes to either end: the free node gets half of all
    traction = [[[0.0, 0.0], *([t, 2 * f[i] / LOW] for t, f in zip(times, path, strict=True))] for i in (0, 1)]
    return from_dict(
        {
            "model": "plane strain",
            "geometry": {"file": str(file)},
            "bodies": {"corner": {"E": 1.0, "nu": 0.3}},
            "supports": {"clamp": {"boundary": "corner.high", "displacement": {"x": 0.0, "y": 0.0}}},
            "obstacles": {"floor": {"shape": "plane", "point": [0.0, floor], "normal": [0.0, 1.0]}},
            "contacts": {
                "tip": {"surface": "corner.low", "against": "floor", "friction": {"law": "coulomb", "mu": mu}}
            },
            "loads": {"pull": {"boundary": "corner.low", "traction": traction}},
            "steps": {"end": float(times[-1]), "count": len(path)},
        }
    )


def reactions() -> np.ndarray:
    """Reaction of each listed answer, from the listed figures: K u = f + r."""
    return np.array([[0.0, 0.0], STICK, SLIP[1:]])


def test_listed_answers_satisfy_equilibrium_and_coulombs_law() -> None:
    u_of = np.linalg.solve(K, (LOAD + reactions()).T).T
    assert_allclose(u_of, [OPEN, [0.0, 0.0], [SLIP[0], 0.0]], atol=5e-6)
    assert_allclose(SLIP[1] / SLIP[2], 3.0, rtol=1e-4)
    assert STICK[0] / STICK[1] < 3.0
    assert_allclose(K[0, 0] / K[0, 1], UNIQUE, rtol=1e-6)  # slip: r_n (1 - mu K_tn / K_tt) = what the load leaves


@pytest.mark.parametrize("path", [
    [[-1.0, -0.6]],
    [[0.0, -0.6], [-1.0, -0.6]],  # pressed first
    [[-1.0, 0.0], [-1.0, -0.6]],  # dragged first
    *slow([[-0.25, -0.15], [-0.5, -0.3], [-1.0, -0.6]], [[1.0, 0.5], [-1.0, -0.6]]),
])  # fmt: skip
def test_with_much_friction_what_is_found_is_one_of_the_answers(path: list[list[float]], tmp_path: Path) -> None:
    """The load path moves where slip is counted from, so for a stuck node its displacement says nothing."""
    u, reaction = answer(3.0, tmp_path, path)
    assert_allclose(K @ u - LOAD, reaction, atol=1e-6)
    assert abs(reaction[0]) <= 3.0 * reaction[1] * (1 + 1e-8)
    assert u[1] >= -1e-9
    assert min(u[1], reaction[1]) <= 1e-9
    if len(path) == 1:
        assert np.abs(reactions() - reaction).max(axis=1).min() <= 2e-6


@pytest.mark.parametrize("mu", [0.0, 1.4, *slow(0.5)])
def test_below_the_threshold_the_node_leaves_the_plane(mu: float, tmp_path: Path) -> None:
    u, reaction = answer(mu, tmp_path, [[-1.0, -0.6]])
    assert_allclose(u, OPEN, atol=2e-6)  # as many digits as are listed, and those of K
    assert_allclose(reaction, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    "case", often([(0.5, 0), (1.1, 0), (1.4, 0), (1.6, 0), (3.0, 2), (10.0, 2)], [(1.4, 0), (1.6, 0), (3.0, 2)])
)
def test_the_three_answers_are_met_and_told(case: tuple[float, int], tmp_path: Path) -> None:
    """Below mu = 1 / 0.6 the node of this load cannot stick: with 1.6 there is one answer as well."""
    mu, others = case
    simulation = prepare(scene_of(mu, tmp_path, [[-1.0, -0.6]], floor=CLEARANCE))
    (step,) = simulation.steps()
    tip, pressures = step.contacts["tip"], [one["tip"] for one in step.other_solutions]
    assert len(pressures) == others
    told = [said for said in doubts(simulation, [step]) if "several solutions" in said]
    assert len(told) == (others > 0)
    if others:  # the pressure acts on the clamped halves of the sides too: twice the node's share
        slip = (STICK[1] - K[0, 1] / K[0, 0] * STICK[0]) / (1 - mu * K[0, 1] / K[0, 0])
        assert_allclose(sorted([tip.normal_force, *pressures]), [0.0, 2 * slip, 2 * STICK[1]], atol=2e-6)
        assert f"{pressures[0]:.4g} " in told[0] or f"{pressures[0]:.4g}," in told[0]


WAYS = {  # loads up to the state before, and now; the reaction that they lead to, and whether it jumps
    "stuck": ([(0.0, -0.6), (-1.0, -0.6)], STICK, False),
    "let go": ([(0.0, -0.6), (-1.0, -0.6), (-2.0, -0.6)], (0.0, 0.0), True),
    "open": ([(-1.0, 0.0), (-1.0, -0.3)], (0.0, 0.0), False),
}


@cache
def last_of(floor: float, *loads: tuple[float, float]) -> tuple[SurfaceProblem, State]:
    """The problem of the last of some loads, and the state before."""
    with TemporaryDirectory() as folder:
        stepper = prepare(scene_of(3.0, Path(folder), [list(load) for load in loads], floor)).stepper
    state = stepper.start()
    for time in range(1, len(loads)):
        state = stepper.reach(state, float(time), lambda row: None).state
    return stepper.posed(state, float(len(loads)))[0], state


@pytest.mark.parametrize("way", WAYS)
def test_the_answer_that_the_state_before_leads_to_is_the_one_of_growing_loads(
    way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever one is found; a node that sticks lets go where no answer goes on from there."""
    loads, reaction, jumps = WAYS[way]
    problem, state = last_of(CLEARANCE, *loads)
    answer = 2 * np.array([reaction[1], -reaction[0]]) / problem.surface.W  # twice the node's share, see above

    def led_to(p: Array, w: Array) -> tuple[Start | None, bool]:
        none = np.zeros(problem.surface.size)
        found = Solution(p=p, w=w, u_c=none, status=Status.CONVERGED, residual=0.0, history=())
        return path.continued(problem, state.p, state.w, found)

    wrong = 0 * answer + 0.1, problem.gap + (-10.0 if answer.any() else 10.0)  # open instead of closed, or closed
    end, fell = led_to(*wrong)
    assert end is not None
    assert fell is jumps
    assert_allclose(end.p, answer, atol=1e-5)
    assert led_to(end.p, problem.relative_displacement(end.u_c)) == (None, jumps)
    unloaded: tuple[Any, str, Any] = (SurfaceProblem, "p_ref", 0.0)
    for where, name, value in ((path, "MOST", len(answer) - 1), (path, "proved", lambda problem: True), unloaded):
        with monkeypatch.context() as patch:
            patch.setattr(where, name, value)
            assert led_to(*wrong) == (None, False)
    monkeypatch.setattr(path, "MOST", len(answer))
    assert led_to(*wrong)[0] is not None


def test_no_path_is_followed_to_an_answer_in_the_piece_of_the_state() -> None:
    """Open before and now: what is found is taken as it is, were it wrong."""
    problem, state = last_of(CLEARANCE - 0.2, (0.0, -0.01), (0.0, -0.02))
    for by, led in ((0.0, False), (2.0, True)):  # as if it were closed
        w, none = by * problem.gap, np.zeros(problem.surface.size)
        found = Solution(p=0 * w + 1e-3, w=w, u_c=none, status=Status.CONVERGED, residual=0.0, history=())
        assert (path.continued(problem, state.p, state.w, found)[0] is not None) is led
