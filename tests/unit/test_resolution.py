"""Elements of both sides across the part that touches, and errors that are not small where there is less than one."""

from collections.abc import Callable

import pytest

from stickslip.solvers.accuracy.errors import BLIND, elements_touched, unresolved
from stickslip.solvers.results.step_result import Quantity
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.lab.verification.closed_forms import hertz
from stickslip.workflows.run.doubts import doubts
from stickslip.workflows.run.mesh_report import report_mesh
from stickslip.workflows.scene_file.read import from_dict

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
LOAD, RADII, E, NU = 500.0, (0.01, 0.1), 210e6, 0.3
EXACT = hertz.cylinder(LOAD, 1 / sum(1 / r for r in RADII), hertz.plane_strain(E, NU) / 2)


def rollers(order: int, lower: float, swap: bool = False) -> Scene:
    """A roller on a larger one, with elements of 3e-5 m at the pole; those of the larger one have `lower` [m]."""
    sides = ["lower.arc", "upper.arc"] if swap else ["upper.arc", "lower.arc"]
    return from_dict({
        "model": "plane strain",
        "geometry": {
            "builder": "cylinders", "radius": RADII[0], "lower_radius": RADII[1], "symmetric": True, "order": order,
            "mesh_size": 0.01 * 3e-5 / lower, "lower_mesh_size": 0.01,
            "contact_mesh_size": 3e-5, "contact_radius": 4e-4,
        },
        "bodies": {"upper": {"E": E, "nu": NU}, "lower": {"E": E, "nu": NU}},
        "contacts": {"pole": {"surface": sides[0], "against": sides[1]}},
        "supports": {
            "axis": {"boundary": "upper.axis", "displacement": {"x": 0.0}},
            "axis2": {"boundary": "lower.axis", "displacement": {"x": 0.0}},
            "base": {"boundary": "lower.base", "displacement": {"y": 0.0}},
        },
        "loads": {"top": {"boundary": "upper.top", "force": [0.0, -LOAD / 2]}},
    })  # fmt: skip


@pytest.mark.parametrize(("order", "swap"), [(1, False), pytest.param(2, False, marks=pytest.mark.slow), (2, True)])
def test_an_unresolved_contact_is_warned_of_and_its_errors_are_not_small(
    order: int, swap: bool, estimating: SimulationOf
) -> None:
    simulation = estimating(rollers(order, lower=1.5e-3, swap=swap))
    (step,) = simulation.steps()
    (found,), (rows,) = simulation.errors([step]), simulation.system.contacts
    contact = step.contacts["pole"]
    assert unresolved(rows, contact)
    for name, true in (("max_pressure", EXACT.p0), ("contact_area", EXACT.a)):
        value, error = getattr(contact, name), found[Quantity("contacts", "pole", name)].total
        assert error is not None
        assert error >= max(value, 0.7 * abs(value - true))
    force = found[Quantity("contacts", "pole", "normal_force")].total
    assert force is not None
    assert force < 0.1 * contact.normal_force  # that is the load
    warning, *_ = doubts(simulation, [step])
    assert "too few for the maximum pressure; refine geometry.lower_mesh_size" in warning
    assert ("elements of lower.arc across" in warning) is not swap


def test_a_side_of_two_elements_is_warned_of_alone(estimating: SimulationOf) -> None:
    simulation = estimating(rollers(2, lower=1e-4))
    (step,) = simulation.steps()
    (found,), (rows,) = simulation.errors([step]), simulation.system.contacts
    own, other = elements_touched(rows, step.contacts["pole"])
    assert own == pytest.approx(EXACT.a / 3e-5, rel=0.15)
    assert other == pytest.approx(EXACT.a / 1e-4, rel=0.25)
    error = found[Quantity("contacts", "pole", "max_pressure")].total
    assert error is not None
    assert 0.7 * abs(step.contacts["pole"].max_pressure - EXACT.p0) < error < 0.02 * EXACT.p0
    assert f"has only {other:.2g} elements of lower.arc across" in next(doubts(simulation, [step]))


@pytest.mark.parametrize("dim", [2, 3])
def test_elements_of_flat_sides_are_counted(dim: int, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    aside = dict.fromkeys("xyz"[: dim - 1], 0.0)
    scene = scene_of(
        dim,
        {"builder": "two_blocks", "mesh_size": 0.25, "lower_mesh_size": 1.0, "cells": "tensor", "length": 1.0},
        bodies={"upper": {"E": 1.0, "nu": 0.0}, "lower": {"E": 1.0, "nu": 0.0}},
        obstacles={},
        contacts={"joint": {"surface": "upper.bottom", "against": "lower.top"}},
        supports={
            "bed": {"boundary": "lower.bottom", "displacement": {**aside, "xyz"[dim - 1]: 0.0}},
            "top": {"boundary": "upper.top", "displacement": {**aside, "xyz"[dim - 1]: -0.1}},
        },
    )  # fmt: skip
    simulation = simulation_of(scene)
    (step,) = simulation.steps()
    (rows,) = simulation.system.contacts
    assert elements_touched(rows, step.contacts["joint"]) == pytest.approx((4.0, 1.0))
    assert BLIND < 1  # one element that is covered wholly is no unresolved contact
    assert not unresolved(rows, step.contacts["joint"])
    assert not list(doubts(simulation, [step]))
    report = report_mesh(scene, simulation.mesh, 0, [rows]).contacts["joint"]
    assert (report.elements_across, report.other_elements_across) == (4, 1)
    assert report.other_size == pytest.approx(4.0)
