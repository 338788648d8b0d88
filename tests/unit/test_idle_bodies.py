"""Floating bodies that nothing loads: obstacles push them, and where contact leaves them they stay."""

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.audited import record_of, stored_by
from shared.problems import surface_problem
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.laws.compliance import Compliance
from stickslip.solvers.newton import condensed_system
from stickslip.solvers.newton.active_set import linearise
from stickslip.solvers.newton.attempts import Start, closed, first_starts
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
LINEAR = {"law": "compliance", "c_n": 1e9, "m_n": 1.0}
COULOMB = {"law": "coulomb", "mu": 0.3}
UP_DOWN = [[0.0, 0.0], [1.0, 0.01], [2.0, -0.01]]
CLEAN = 1e-8


def block_on(floor: dict[str, Any], dim: int, contact: dict[str, Any], more: dict[str, Any]) -> dict[str, Any]:
    """A block without support or load on a floor."""
    up = [0.0] * (dim - 1) + [1.0]
    width = {"width": 1.0} if dim == 3 else {}
    return {
        "model": "3d" if dim == 3 else "plane strain",
        "geometry": {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5, "cells": "tensor"} | width,
        "bodies": {"block": {"E": 1e7, "nu": 0.3}},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0] * dim, "normal": up} | floor},
        "contacts": {"base": {"surface": "block.bottom", "against": "floor", "friction": COULOMB} | contact},
        "steps": {"end": 2.0, "count": 2},
    } | more


@pytest.mark.parametrize("contact", [{}, {"normal": LINEAR}, {"normal": LINEAR | {"m_n": 2.0}}, {"sliding": True}])
@pytest.mark.parametrize("dim", [2, 3])
def test_a_floor_that_rises_lifts_a_body_and_leaves_it_there(
    dim: int, contact: dict[str, Any], scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """Its other motions are nobody's: they are those of the step before, not what rounding makes of them."""
    axis = "xyz"[dim - 1]
    scene = scene_of(**block_on({"displacement": {axis: UP_DOWN}}, dim, contact, {}))
    for step in simulation_of(scene).steps():
        moved = record_of(step).displacement.reshape(-1, dim)
        assert_allclose(moved[:, :-1], 0.0, atol=1e-10)
        assert_allclose(moved[:, -1], 0.01, atol=1e-6)


def test_two_bodies_pressed_together_by_nothing_are_solved_to_rounding(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """Tractions are what a stiff law makes of the last digits of motions; pairs are searched while steps are cut."""
    scene = scene_of(
        model="3d",
        geometry={"builder": "two_blocks", "length": 2.0, "height": 0.5, "width": 0.5, "mesh_size": 0.5,
                  "lower_mesh_size": 0.4, "cells": "tensor"},
        bodies={"upper": {"E": 1e7, "nu": 0.3}, "lower": {"E": 5e6, "nu": 0.2}},
        obstacles={},
        contacts={"base": {"surface": "upper.bottom", "against": "lower.top", "normal": LINEAR, "friction": COULOMB,
                           "sliding": True}},
        supports={"bed": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0, "z": UP_DOWN}}},
        steps={"end": 2.0, "count": 2},
    )  # fmt: skip
    simulation = simulation_of(scene)
    audit = Auditor(simulation.problem, simulation.mesh)
    for step in simulation.steps():
        assert step.substeps == 1
        assert step.iterations < 20
        record = record_of(step)
        assert max(asdict(audit(replace(record, stored=stored_by(step)))).values()) < CLEAN
        assert np.abs(record.displacement).max() < 0.0101


@pytest.mark.parametrize("power", [1.0, 1.5, 3.0])
def test_a_body_that_is_released_rises_to_where_it_touches(
    power: float, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """By Newton's method alone the penetration of a power law would shrink by a factor, step for step."""
    law = LINEAR | {"c_n": 1e7 * 1e-3 ** (1 - power), "m_n": power}
    weight = {"boundary": "block.top", "pressure": [[0.0, 0.0], [1.0, 1e4], [2.0, 0.0]]}
    scene = scene_of(**block_on({}, 2, {"normal": law}, {"loads": {"weight": weight}}))
    simulation = simulation_of(scene)
    audit = Auditor(simulation.problem, simulation.mesh)
    pressed, released = simulation.steps()
    assert_allclose(record_of(pressed).p[:4], 1e4, rtol=0.2)
    assert released.iterations <= 2
    record = record_of(released)
    assert np.abs(record.displacement).max() < 1e-9
    for step in (pressed, released):
        assert max(asdict(audit(replace(record_of(step), stored=stored_by(step)))).values()) < CLEAN


def test_what_nothing_pushes_presses_relative_to_what_its_motion_would_cause(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """However stiff a law is, it excuses nothing."""
    floor = {"displacement": {"y": UP_DOWN}}
    problem = surface_problem(simulation_of(scene_of(**block_on(floor, 2, {"normal": LINEAR}, {}))))
    (rows,) = problem.cone.contacts
    stiff = replace(rows, normal=Compliance(c_n=1e25))
    problem = replace(problem, cone=AdmissibleSet((stiff,), problem.cone.time, problem.cone.end))
    n, p = problem.surface.normal_rows, np.zeros(len(problem.gap))
    for pull in (1e-9, 1e-3):
        p[:n] = -pull * problem.p_ref
        assert problem.natural_residual(p, problem.gap) == pytest.approx(pull, rel=1e-6)


@pytest.fixture
def lifted(scene_of: SceneOf, simulation_of: SimulationOf) -> SurfaceProblem:
    """The second step, in which the floor leaves the block."""
    scene = scene_of(**block_on({"displacement": {"y": UP_DOWN}}, 2, {}, {}))
    return surface_problem(simulation_of(scene))


def test_motions_that_nothing_resists_stay_if_nothing_pushes_along_them(lifted: SurfaceProblem) -> None:
    away, stood = np.full(len(lifted.gap), -1.0), np.random.default_rng(0).normal(size=lifted.surface.size)
    open_everywhere = linearise(lifted, away, lifted.gamma)
    p, u_c = condensed_system.solve(open_everywhere, stood)
    R = lifted.surface.R
    assert_array_equal(p, 0.0)
    assert_allclose(u_c, R @ (R.T @ stood), atol=1e-12)
    for mode in range(R.shape[1]):
        push = R[:, mode]
        load = replace(lifted.load, f_c=push, resultant=R.T @ push)
        with pytest.raises(np.linalg.LinAlgError):
            condensed_system.solve(replace(open_everywhere, problem=replace(lifted, load=load)), stood)


def test_what_nothing_pushes_starts_where_it_stood(lifted: SurfaceProblem) -> None:
    assert lifted.idle
    surface = lifted.surface
    lift = surface.R @ (surface.R.T @ np.tile([0.0, 0.02], surface.size // 2))
    problem = replace(lifted, u_before=lift)
    least = problem.scales.no_traction
    p = np.zeros(len(problem.gap))
    first = next(iter(first_starts(problem, p)))
    assert first.u_c is lift
    assert not first.in_equilibrium
    r = problem.relative_displacement(lift) - problem.gap
    assert np.all(np.abs(first.p_hat[: surface.normal_rows]) > least)
    assert_allclose(first.p_hat, np.where(np.abs(problem.gamma * r) > least, problem.gamma * r, 0.0))
    squeezed = problem.p_ref * np.ones(len(p))  # then its tractions tell more of what touches, and come first
    assert next(iter(first_starts(problem, squeezed))).p_hat[0] > 0 > first.p_hat[0]
    touching = replace(problem, offset=problem.offset - r)
    assert not Start.where_it_stood(touching, p).p_hat.any()
    pushed = replace(problem, load=replace(problem.load, resultant=np.ones(surface.R.shape[1])))
    assert not pushed.idle
    assert_allclose(next(iter(first_starts(pushed, p))).p_hat, closed(pushed))
