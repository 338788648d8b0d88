"""Friction between nodes: a block on a turning table, whose moment is in the books."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse import csr_matrix

from stickslip.solvers.accuracy.bubble_rows import BetweenNodes
from stickslip.solvers.results.step_result import SLIP, Quantity
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.workflows.scene_file.read import from_dict

MU, SIDE, FORCE = 0.3, 0.1, 5000.0
MOMENT = MU * FORCE * SIDE * (np.sqrt(2) + np.log(1 + np.sqrt(2))) / 6  # of even pressure on a square
TURN = [[1, 0], [2, 0.02]]
EVEN = [[1, -1e-5]]
BLOCK = {"builder": "block", "length": SIDE, "width": SIDE, "height": 0.02, "mesh_size": 0.02, "cells": "tensor"}
TABLE = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}
TURNED = TABLE | {"rotation": {"angle": TURN, "point": [SIDE / 2, SIDE / 2, 0.0], "axis": [0, 0, 1]}}


def turning(friction: dict[str, Any] | None = None, **tables: Any) -> Simulation:
    data: dict[str, Any] = {
        "model": "3d",
        "geometry": BLOCK,
        "bodies": {"block": {"E": 1e9, "nu": 0.0}},
        "obstacles": {"table": TURNED},
        "contacts": {
            "base": {
                "surface": "block.bottom",
                "against": "table",
                "friction": friction or {"law": "coulomb", "mu": MU},
            }
        },
        "supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0, "z": EVEN}}},
        "steps": {"end": 2.0, "count": 2},
    }
    return prepare(from_dict(data | tables))


ALONG, ACROSS = 0.3, 0.1
ELLIPSE = {"law": "orthotropic_coulomb", "mu_1": ALONG, "mu_2": ACROSS, "axis": [1, 0, 0]}


def moment_of_ellipse() -> float:
    """Its power over the turning: the mean of the friction along each point's way, times its distance."""
    nodes, weights = np.polynomial.legendre.leggauss(200)
    x, y = np.meshgrid(nodes * SIDE / 2, nodes * SIDE / 2)
    return FORCE * float(weights @ np.hypot(ALONG * y, ACROSS * x) @ weights) / 4


@pytest.mark.parametrize("form", ["condensed", "matrix-free"])
@pytest.mark.parametrize("order", [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("friction", "true"), [(None, MOMENT), (ELLIPSE, moment_of_ellipse())])
def test_the_moment_of_a_turning_table_has_the_error_that_is_stated(
    friction: dict[str, Any] | None, true: float, order: int, form: str
) -> None:
    *_, last = turning(friction, geometry=BLOCK | {"order": order}, solver={"surface": form}).steps()
    moment, support = (Quantity(*of, "moment") for of in (("obstacles", "table"), ("supports", "top")))
    found, corrected, stated = (
        last.obstacles["table"].moment[2],
        last.corrected[str(moment)],
        last.errors[str(moment)].mesh,
    )
    assert isinstance(corrected, np.ndarray)
    assert isinstance(stated, np.ndarray)
    assert abs(corrected[2] - true) < 0.05 * abs(found - true) + 4e-4 * true  # the pressure is not quite even
    assert 0.9 < stated[2] / abs(found - true) < 3
    assert_allclose(last.errors[str(support)].mesh, stated, rtol=1e-3, atol=1e-3 * stated[2])


def test_the_dissipation_has_it_too() -> None:
    *_, last = turning().steps()
    number = str(Quantity("contacts", "base", "dissipation_total"))
    stated, corrected, work = last.errors[number].mesh, last.corrected[number], MOMENT * TURN[-1][1]
    true = last.contacts["base"].dissipation_total - work
    assert abs(corrected - work) < 0.4 * true  # the block gives way a little
    assert stated is not None
    assert 0.9 < stated / true < 3


def test_nothing_is_added_where_all_slip_has_one_direction() -> None:
    moved = TABLE | {"displacement": {"x": [[1, 0], [2, 0.01]]}}
    simulation = turning(obstacles={"table": moved})
    *_, last = simulation.steps()
    c = last.contacts["base"]
    (rows,) = simulation.system.contacts
    assert rows.quadrature is not None
    between = BetweenNodes.of(rows, rows.quadrature(5))
    assert between is not None
    assert c.slip_area > 0
    assert between.added(c.status == SLIP, c.bound, c.slip_increment) is None
    middle = [SIDE / 2, SIDE / 2, 0.0]
    wheel = np.cross([0.0, 0.0, 1.0], c.points - middle)
    sizes = np.linalg.norm(wheel, axis=1, keepdims=True)
    added = between.added(c.bound > 0, c.bound, wheel)
    assert added is not None
    moment = np.cross(c.points - middle, added[0])[:, 2].sum()
    assert -1 < moment / (c.weight * c.bound * sizes[:, 0]).sum() < 0  # slip between nodes is shorter than theirs
    assert added[1] < 0


def test_both_sides_feel_it_in_balance() -> None:
    """A block on a block, whose top turns."""
    shape = {"builder": "two_blocks", "length": 1.0, "width": 1.0, "height": 0.4, "lower_height": 0.3}
    simulation = turning(
        geometry=shape | {"mesh_size": 0.25, "lower_mesh_size": 0.3},
        bodies={name: {"E": 1e9, "nu": 0.0} for name in ("upper", "lower")},
        obstacles={},
        contacts={
            "base": {"surface": "upper.bottom", "against": "lower.top", "friction": {"law": "coulomb", "mu": MU}}
        },
        supports={"floor": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0, "z": 0.0}}},
        remote_points={
            "top": {
                "boundary": "upper.top",
                "point": [0.5, 0.5, 0.4],
                "coupling": "rigid",
                "displacement": {"x": 0.0, "y": 0.0, "z": [[1, -1e-5]]},
                "rotation": {"x": 0.0, "y": 0.0, "z": [[1, 0], [2, 1e-4]]},
            }
        },
    )
    *_, last = simulation.steps()
    assert last.contacts["base"].slip_area > 0
    names = ("contacts", "base"), ("supports", "floor"), ("remote_points", "top")
    contact, floor, top = (last.corrected[str(Quantity(*name, "moment"))][2] for name in names)  # type: ignore[index]
    moment = last.contacts["base"].moment[2]
    assert abs(contact - moment) > 1e-3 * abs(moment)
    assert_allclose(contact, floor, rtol=1e-6)
    assert_allclose(top, -floor, rtol=0.01)


def test_nothing_pushes_an_obstacle_that_a_force_drives() -> None:
    """A table that a force presses against the block may turn it; one that a force pulls along keeps its balance."""
    (rows,) = turning().system.contacts
    assert rows.quadrature is not None
    pulled, pressed = (BetweenNodes.of(rows, rows.quadrature(5), axes) for axes in ([0], [2]))
    assert pulled is not None
    assert pressed is not None
    away = rows.surface.points - [0.3 * SIDE, 0.4 * SIDE, 0.0]
    wheel = np.cross([0.0, 0.0, 1.0], away)
    bound = np.ones(len(wheel))
    assert pulled.added(bound > 0, bound, wheel) is None
    assert pressed.added(bound > 0, bound, wheel) is not None


def test_slip_of_rounding_has_no_direction() -> None:
    """All sticks on a side that bends: one node's weight is negative, and along the other's side nothing moves."""
    between = BetweenNodes(
        relative=csr_matrix(np.eye(2)),
        measures=np.array([np.diag([1.0, 0.0]), np.diag([0.0, 1.0])]),
        phi=csr_matrix([[1.1], [-0.1]]),
        weights=np.ones(1),
        around=None,
        driven=(),
    )
    assert between.added(np.zeros(2, bool), np.ones(2), np.array([[0.0, 0.0], [0.0, 1e-18]])) is None
