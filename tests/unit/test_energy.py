"""Energy over histories: what is put in is stored or left at the contact, in every step. What contact remembers."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.problems import SceneOf, SimulationOf
from stickslip.solvers.results.step_result import OPEN, SLIP
from stickslip.solvers.scene.record import Energy

BALANCE = 1e-8  # DESIGN's, relative to the largest term so far
COULOMB = {"law": "coulomb", "mu": 0.3}
BASE = {"surface": "block.bottom", "against": "foundation", "friction": COULOMB}
PLANE = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
CLAMPED = {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0}}}
PRESS = [[0, 0], [1, -0.05]]
TO_AND_FRO = [[1, 0], [2, 0.06], [3, -0.06], [4, 0.0]]


def history(
    foundation: dict[str, Any] | None = None, contact: dict[str, Any] | None = None, **tables: Any
) -> dict[str, Any]:
    """Four seconds in eight steps."""
    foundation = foundation or {}
    whole = foundation if "shape" in foundation else PLANE | foundation
    scene = {"obstacles": {"foundation": whole}, "contacts": {"base": BASE | (contact or {})}}
    return scene | {"supports": CLAMPED, "steps": {"end": 4.0, "count": 8}} | tables


def drawn(**displacement: Any) -> dict[str, Any]:
    return {"top": {"boundary": "block.top", "displacement": displacement}}


ROLLER = {"shape": "cylinder", "point": [1.0, -5.0], "radius": 5.0}
WEIGHT = {"bodies": {"block": {"E": 1.0, "nu": 0.3, "density": 1.0}}}
HISTORIES: dict[str, dict[str, Any]] = {
    "support": history(supports=drawn(x=TO_AND_FRO, y=PRESS)),
    "obstacle that is moved": history({"displacement": {"x": TO_AND_FRO, "y": [[0, 0], [1, 0.05]]}}),
    "obstacle that a force drives": history(
        {"force": {"y": [[0, 0], [1, 0.1], [4, 0.02]]}, "displacement": {"x": TO_AND_FRO}}
    ),
    "obstacle that turns": history(
        ROLLER
        | {
            "displacement": {"y": [[0, 0], [1, 0.05]]},
            "rotation": {"point": [1.0, -5.0], "angle": [[1, 0], [2, 0.01], [4, -0.01]]},
        }
    ),
    "gravity": history(
        supports={},
        gravity={"acceleration": [[[1, 0], [2, 0.02], [3, -0.02], [4, 0.0]], [[0, 0], [1, -0.1]]]},
        **WEIGHT,
    ),
    "loads": history(
        supports={},
        loads={
            "lid": {"boundary": "block.top", "pressure": [[0, 0], [1, 0.1], [4, 0.05]]},
            "side": {"boundary": "block.right", "traction": [[[1, 0], [2, 0.01], [3, -0.01]], 0.0]},
            "other": {"boundary": "block.left", "force": [0.0, [[2, 0], [3, 0.01], [4, -0.01]]]},
        },
    ),
    "Tresca's bound in time": history(
        contact={
            "normal": {"law": "bilateral"},
            "friction": {"law": "tresca", "bound": [[0, 0.01], [2, 0.005], [3, 0.02], [4, 0.0]]},
        },
        supports=drawn(x=TO_AND_FRO, y=PRESS),
    ),
    "compliance, k_T": history(
        contact={"normal": {"law": "compliance", "c_n": 4.0, "m_n": 1.5}, "friction": COULOMB | {"k_T": 2.0}},
        supports=drawn(x=TO_AND_FRO, y=PRESS),
    ),
    "interference": history(contact={"gap_offset": -0.02}, supports=drawn(x=TO_AND_FRO, y=0.0)),
    "loaded from the start": history(supports=drawn(x=TO_AND_FRO, y=[[0, -0.05], [4, -0.03]])),
    "lifted and set down": history(supports=drawn(x=TO_AND_FRO, y=[[0, 0], [1, -0.05], [2.5, 0.01], [4, -0.05]])),
    "contact that slides": history(ROLLER, {"sliding": True}, supports=drawn(x=[[1, 0], [2, 0.5], [4, -0.5]], y=PRESS)),
    "rolled far by a rigid motion": history(supports=drawn(x=[[1, 0], [2, 4.0], [4, -4.0]], y=PRESS)),
}
PAIR: dict[str, Any] = {
    "geometry": {"builder": "two_blocks", "length": 4.0, "lower_length": 1.0, "height": 0.5, "mesh_size": 0.2,
                 "lower_mesh_size": 0.25, "offset": -1.0},
    "bodies": {"upper": {"E": 1e3, "nu": 0.3}, "lower": {"E": 1.0, "nu": 0.3}},
    "obstacles": {},
    "supports": {
        "drive": {
            "boundary": "upper.top", "displacement": {"x": [[1, 0], [3, 0.8], [4, 0.4]], "y": [[0, 0], [1, -0.02]]},
        },
        "bed": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0}},
    },
    "steps": {"end": 4.0, "count": 8},
}  # fmt: skip


def pair(sliding: bool) -> dict[str, Any]:
    """A stiff block drawn across a soft one."""
    joint = {"surface": "lower.top", "against": "upper.bottom", "friction": COULOMB, "sliding": sliding}
    return PAIR | {"contacts": {"joint": joint}}


def imbalance(energies: list[Energy]) -> float:
    """Largest over the steps, of the totals and of each step's share; beside the largest term so far."""
    terms = np.array([[0.0, 0.0, 0.0], *([e.external, e.stored, e.contact] for e in energies)])
    scale = np.maximum.accumulate(np.abs(terms).max(axis=1))[1:]
    return float(np.max(np.abs(terms[1:] @ [1, -1, -1]) / scale))


@pytest.mark.parametrize("name", HISTORIES)
def test_balance_closes_in_every_step(name: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    steps = list(simulation_of(scene_of(**HISTORIES[name])).steps())
    assert len(steps) >= 8
    assert imbalance([step.energy for step in steps]) <= BALANCE
    for before, step in pairwise(steps):  # friction takes, it never gives
        assert step.energy.dissipated >= before.energy.dissipated - 1e-12 * steps[-1].energy.dissipated
    assert steps[-1].energy.dissipated > 0
    assert any(SLIP in step.contacts["base"].status for step in steps)


@pytest.mark.parametrize("sliding", [False, True])
def test_balance_closes_between_bodies(sliding: bool, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    steps = list(simulation_of(scene_of(**pair(sliding))).steps())
    assert imbalance([step.energy for step in steps]) <= BALANCE
    assert steps[-1].energy.dissipated > 0


@pytest.mark.parametrize(
    "solver",
    [
        {"method": "surface-uzawa", "surface": "matrix-free"},
        {"method": "uzawa"},
        {"method": "inexact-uzawa"},
        {"method": "nonlinear-uzawa"},
        {"method": "gram-uzawa"},
        {"method": "perturbed-lagrangian"},
        {"method": "regularised"},
    ],
    ids=lambda solver: solver["method"],
)
def test_balance_closes_whatever_the_method(
    solver: dict[str, Any], scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """A method that leaves the laws approximate still leaves the bodies in equilibrium."""
    turned = HISTORIES["support"] | {"steps": {"end": 3.0, "count": 3}, "geometry": {"mesh_size": 0.5}}
    steps = list(simulation_of(scene_of(**turned, solver=solver)).steps())
    assert imbalance([step.energy for step in steps]) <= BALANCE


def test_balance_closes_over_substeps(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    tables = HISTORIES["lifted and set down"] | {"steps": {"end": 4.0, "count": 1}}
    few = {"method": "condensed-newton", "max_iterations": 3}
    steps = list(simulation_of(scene_of(**tables, solver=few)).steps())
    assert max(step.substeps for step in steps) > 1
    assert imbalance([step.energy for step in steps]) <= BALANCE


def test_remainder_in_time_falls_with_the_step(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """First order: friction works at the end of a step, pressure and tractions change within it."""
    drive = drawn(x=[[1, 0], [2, 0.1], [4, -0.1]], y=[[0, 0], [1, -0.02], [4, -0.1]])  # pressed on while it slips
    counts, remainders = np.array([16, 32, 64]), []
    for count in counts:
        scene = scene_of(**history(supports=drive, steps={"end": 4.0, "count": int(count)}))
        *_, last = simulation_of(scene).steps()
        assert last.energy.compliance == 0.0
        remainders.append(abs(last.energy.time_remainder))
    rate = np.polyfit(np.log(counts), np.log(remainders), 1)[0]
    assert abs(rate + 1) < 0.15


def test_contact_that_opens_forgets_its_traction_but_not_how_far_it_slid(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """Pressed and sheared, lifted off, moved back in the air, pressed again: as on the first day, but for the slip."""
    drive = {
        "x": [[1, 0], [2, 0.04], [3, 0.04], [4, 0.01]],
        "y": [[0, 0], [1, -0.05], [2, -0.05], [3, 0.02], [4, 0.02], [5, -0.05]],
    }
    base = {"base": BASE | {"friction": {"law": "coulomb", "mu": 0.3}}}
    scene = scene_of(contacts=base, supports=drawn(**drive), steps={"end": 5.0, "count": 5})
    pressed, sheared, lifted, moved, again = (s.contacts["base"] for s in simulation_of(scene).steps())
    assert sheared.tangential_force > 0.1 * sheared.normal_force
    for open_ in (lifted, moved):
        assert set(open_.status) == {OPEN}
        assert_array_equal(open_.pressure, 0.0)
        assert_array_equal(open_.traction, 0.0)
        assert open_.dissipation == pytest.approx(0.0, abs=1e-15)
    assert np.abs(sheared.slip).max() > 0.01
    # as far as the lid has come and gone: what the points slid in the air counts as well
    back = again.slip[:, 0] - pressed.slip[:, 0]
    assert_allclose(back, 0.01, atol=1e-10)
    assert_allclose(again.pressure, pressed.pressure, rtol=1e-8)
    assert_allclose(again.traction, pressed.traction, atol=1e-8 * pressed.max_pressure)
    assert again.dissipation_total > sheared.dissipation_total > pressed.dissipation_total
