"""Friction that gives before it slips, or is bounded by the penetration: audit, energy, admissible tractions."""

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import record_of
from shared.cases import every_nth
from stickslip.solvers.classical.uzawa import Uzawa
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.results.step_result import SLIP, STICK
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.system.system import System

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
METHODS = ("condensed-newton", "uzawa")
LAWS: dict[str, dict[str, Any]] = {
    "coulomb": {"friction": {"law": "coulomb", "mu": 0.15, "k_T": 4.0}},
    "tresca": {"friction": {"law": "tresca", "bound": [[0, 0.01]], "k_T": 4.0}, "normal": {"law": "bilateral"}},
    "penetration": {
        "friction": {"law": "compliance", "c_T": 30.0, "m_T": 2.0},
        "normal": {"law": "compliance", "c_n": 40.0, "m_n": 1.5},
    },
    "penetration, k_T": {
        "friction": {"law": "compliance", "c_T": 0.8, "m_T": 1.0, "k_T": 4.0},
        "normal": {"law": "compliance", "c_n": 40.0, "m_n": 1.5},
    },
}


def rubbed(
    scene_of: SceneOf, law: str, method: str, count: int = 4, dim: int = 2, geometry: dict[str, Any] | None = None
) -> Scene:
    """A block pressed, then its top driven there, back and there again; in 3D also across."""
    drive = {"x": [[1, 0], [2, 0.06], [3, -0.06], [4, 0.06]], "xyz"[dim - 1]: [[0, 0], [1, -0.08]]}
    if dim == 3:
        drive["y"] = [[2, 0], [3, 0.06]]
    return scene_of(
        dim,
        geometry,
        contacts={"base": {"surface": "block.bottom", "against": "foundation"} | LAWS[law]},
        supports={"top": {"boundary": "block.top", "displacement": drive}},
        steps={"end": 4.0, "count": count},
        solver={"method": method, "tolerance": 1e-10},
    )


@pytest.mark.parametrize(("law", "method"), every_nth(2, LAWS, METHODS))
def test_history_is_audited_clean_and_its_energy_is_all_there(
    law: str, method: str, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    check_history(simulation_of(rubbed(scene_of, law, method)))


@pytest.mark.parametrize(("law", "shape"), every_nth(3, LAWS, [(2, {"order": 2}), (3, {}), (3, {"cells": "tensor"})]))
def test_so_it_is_in_3d_and_at_order_2(
    law: str, shape: tuple[int, dict[str, Any]], scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    dim, geometry = shape
    check_history(simulation_of(rubbed(scene_of, law, "condensed-newton", dim=dim, geometry=geometry)))


def check_history(simulation: Simulation) -> None:
    audit = Auditor(simulation.problem, simulation.mesh)
    seen: set[int] = set()
    for step in simulation.steps():
        assert max(asdict(audit(record_of(step))).values()) < 1e-8  # solver.tolerance is 1e-10
        energy = step.energy
        assert_allclose(energy.external, energy.stored + energy.contact, rtol=1e-8)
        assert step.contacts["base"].dissipation >= -1e-10 * energy.external
        seen |= set(step.contacts["base"].status.tolist())
    assert seen >= {SLIP, STICK}
    assert energy.dissipated > 0.01 * energy.stored


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
def test_slip_is_what_the_give_leaves(law: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """The audit counts slip from w - t/k_T: with the whole displacement a stuck point would seem to slip."""
    scene = rubbed(scene_of, law, "condensed-newton", count=32)
    simulation = simulation_of(scene)
    steps = {step.time: step for step in simulation.steps()}
    (place,) = simulation.stepper.cone.places
    before, after = steps[2.0], steps[2.125]  # where the drive turns back
    expected = (before.w - before.p / 4.0)[place.tangential]  # k_T = 4 Pa/m
    assert_allclose(after.reference[place.tangential], expected, atol=1e-15)
    assert np.any(after.contacts["base"].status == STICK)
    audit = Auditor(resolve(scene), simulation.mesh)
    assert audit(record_of(after)).complementarity < 1e-8
    assert audit(replace(record_of(after), reference=before.w)).complementarity > 1e-3


@pytest.mark.parametrize("law", LAWS)
def test_time_remainder_falls_with_the_step(law: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    remainders, loops = [], []
    for count in (16, 32):
        *_, last = simulation_of(rubbed(scene_of, law, "condensed-newton", count)).steps()
        remainders.append(abs(last.energy.time_remainder) / last.energy.dissipated)
        loops.append(last.energy.dissipated)
    assert remainders[1] < 0.7 * remainders[0]  # first order: a half
    assert remainders[1] < 0.1


@pytest.mark.parametrize(("law", "relaxation"), every_nth(2, LAWS, [0.3, 1.9]))
def test_every_step_of_uzawa_is_admissible(
    law: str, relaxation: float, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    simulation = simulation_of(rubbed(scene_of, law, "uzawa"))
    stepper = simulation.stepper
    problem = stepper.reach(stepper.start(), 1.0, lambda row: None).problem
    (place,) = problem.cone.places
    for max_it in (1, 2, 5, 20):
        p = Uzawa(relaxation=relaxation, rtol=1e-14, max_it=max_it)(problem, np.zeros(problem.cone.size)).p
        s = problem.cone.bound(place, p[place.normal])
        t = p[place.tangential].reshape(-1, place.components)
        assert np.all(np.linalg.norm(t, axis=1) <= s * (1 + 1e-15))
        assert np.all(p[place.normal] >= 0) or place.rows.normal.sides == 2
        assert np.any(t) or max_it == 1  # the first step sees bodies that move down as a whole, and do not widen yet


def test_bound_is_integrated_exactly(scene_of: SceneOf, system_of: Callable[[Scene], System]) -> None:
    """A penetration of (2 + x) m, to the fifth: the quadrature of the pressure would not do."""
    laws = {"normal": {"law": "compliance", "c_n": 40.0}, "friction": {"law": "compliance", "c_T": 3.0, "m_T": 5.0}}
    top = {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0}}
    contact = {"surface": "block.bottom", "against": "foundation"} | laws
    (rows,) = system_of(scene_of(contacts={"base": contact}, supports={"top": top})).contacts
    u = np.zeros_like(rows.surface.points)
    u[:, 1] = -(2.0 + rows.surface.points[:, 0])
    assert rows.friction is not None
    s = rows.friction.limit(40.0 * (rows.N_n @ u.ravel()), rows.average, rows.normal, 1.0, 1.0)
    assert_allclose(rows.W_t @ s, 3.0 * (4.0**6 - 2.0**6) / 6, rtol=1e-13)  # block from x = 0 to 2 m


@pytest.mark.parametrize("friction", [{}, {"friction": {"law": "coulomb", "mu": 0.0}}])
def test_nothing_sticks_without_friction(
    friction: dict[str, Any], scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """Pressed between its symmetry planes no point of the base moves sideways: no slip, but no stick either."""
    scene = scene_of(
        contacts={"base": {"surface": "block.bottom", "against": "foundation"} | friction},
        supports={
            "top": {"boundary": "block.top", "displacement": {"y": -0.01}},
            "left": {"boundary": "block.left", "displacement": {"x": 0.0}},
            "right": {"boundary": "block.right", "displacement": {"x": 0.0}},
        },
    )
    (step,) = simulation_of(scene).steps()
    base = step.contacts["base"]
    assert base.max_slip < 1e-12
    assert (base.stick_area, base.slip_area) == (0.0, base.contact_area)
    assert_allclose(base.contact_area, 2.0)
