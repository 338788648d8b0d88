"""Large sliding: blocks drawn across others and along planes, whose meshes do not match."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import every_nth
from shared.problems import on_floor
from stickslip import Quantity, Simulation, StepResult
from stickslip.solvers.simulation.simulation import prepare as estimating
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

CELL, MU = 0.25, 0.3
FORCE = 100.0 * 0.005 / 0.5  # E strain, on a side of 1 m: the sliding block is 1e7 times as stiff, nu = 0


def drawn(slave: str, operator: str, order: int, friction: dict[str, Any], law: dict[str, Any]) -> Simulation:
    """The upper, rigid block pressed down, then drawn in x."""
    sides = {"upper": "upper.bottom", "lower": "lower.top"}
    other = "lower" if slave == "upper" else "upper"
    contact = {"surface": sides[slave], "against": sides[other], "operator": operator, "sliding": True, "normal": law}
    scene = from_dict(
        {
            "model": "plane strain",
            "geometry": {
                "builder": "two_blocks",
                "length": 4.0,
                "lower_length": 1.0,
                "height": 0.5,
                "mesh_size": CELL * 2 / 3,
                "lower_mesh_size": CELL,
                "offset": -1.0,
                "order": order,
            },
            "bodies": {"upper": {"E": 1e9, "nu": 0.0}, "lower": {"E": 100.0, "nu": 0.0}},
            "contacts": {"joint": contact | friction},
            "supports": {
                "drive": {
                    "boundary": "upper.top",
                    "displacement": {"x": [[0, 0], [1, 0], [2, 5 * CELL]], "y": [[0, 0], [1, -0.005]]},
                },
                "base": {"boundary": "lower.bottom", "displacement": {"y": 0.0}},
                "pin": {"point": [2.0, -0.5], "displacement": {"x": 0.0}},
            },
            "steps": {"end": 2.0, "count": 12},
        }
    )
    return prepare(scene)


def slide(slave: str, operator: str, order: int, friction: dict[str, Any], law: dict[str, Any]) -> list[StepResult]:
    """Results while it slides."""
    return [step for step in drawn(slave, operator, order, friction, law).steps() if step.time > 1.0]


@pytest.mark.parametrize(
    ("order", "slave", "friction"),
    every_nth(2, [1, 2], ["upper", "lower"], [{}, {"friction": {"law": "coulomb", "mu": MU}}]),
)
def test_force_does_not_feel_the_cells_that_pass(slave: str, order: int, friction: dict[str, Any]) -> None:
    steps = slide(slave, "mortar", order, friction, {"law": "unilateral"})
    forces = np.array([step.contacts["joint"].normal_force for step in steps])
    assert len(forces) >= 6
    assert_allclose(forces, FORCE, rtol=1e-6)  # the stiffness of the upper block: 1e-7
    assert np.ptp(forces) <= 1e-6 * FORCE
    for step in steps:
        energy = step.energy  # 1e9 Pa moved by a metre, which leaves no rounding: it is a rigid motion
        assert_allclose(energy.external, energy.stored + energy.contact, rtol=0, atol=1e-12)
    if friction and slave == "lower":  # all of it is covered, at every step
        assert_allclose([s.contacts["joint"].tangential_force for s in steps], MU * forces, rtol=1e-6)
        assert steps[-1].contacts["joint"].max_slip > 4.5 * CELL


WEAKENS = {"law": "static_kinetic", "mu_s": MU, "mu_k": 0.2, "slip_length": 2 * CELL}


@pytest.mark.parametrize("law", [WEAKENS, {"law": "slip_dependent", "mu": [[0, MU], [2 * CELL, 0.2]]}], ids=str)
def test_what_slid_far_remembers_its_slip(law: dict[str, Any]) -> None:
    """Pairs are searched anew at every step: each point of the lower block keeps its path of slip, and so its mu."""
    steps = slide("lower", "mortar", 1, {"friction": law}, {"law": "unilateral"})
    ratios = [step.contacts["joint"].tangential_force / step.contacts["joint"].normal_force for step in steps]
    drawn_by = np.array([(step.time - 1.0) * 5 * CELL for step in steps])
    # all slips as far as the rigid block is drawn, less what the layer is sheared, 2 (1 + nu) tau h / E
    sheared = 2 * np.array(ratios) * FORCE * 0.5 / 100.0
    expected = MU + (0.2 - MU) * np.minimum((drawn_by - sheared) / (2 * CELL), 1.0)
    assert_allclose(ratios, expected, rtol=0.01)
    assert ratios[-1] == pytest.approx(0.2, rel=1e-6)
    assert drawn_by[-1] > 2 * drawn_by[0]


def test_a_point_that_moves_in_the_air_keeps_its_static_friction() -> None:
    """Lifted, carried along by five slip lengths, put down again and dragged a little: mu is still mu_s."""
    drive = {"x": [[0, 0], [1, 0], [2, 0], [3, 0.5], [4, 0.5], [5, 0.51]]}
    drive["y"] = [[0, 0], [1, -0.01], [2, 0.01], [3, 0.01], [4, -0.01]]
    law = {"law": "static_kinetic", "mu_s": MU, "mu_k": 0.2, "slip_length": 0.1}
    tables = on_floor(
        2,
        {"mesh_size": 0.5},
        {"nu": 0.0},
        {"friction": law},
        supports={"top": {"boundary": "block.top", "displacement": drive}},
        steps={"end": 5.0, "count": 5},
    )
    for sliding in (False, True):
        tables["contacts"]["base"]["sliding"] = sliding
        pressed, lifted, carried, put_down, dragged = prepare(from_dict(tables)).steps()
        base = dragged.contacts["base"]
        assert not lifted.contacts["base"].contact_area
        assert np.linalg.norm(carried.memory["base"]) < 1e-12
        assert put_down.contacts["base"].normal_force == pytest.approx(pressed.contacts["base"].normal_force, rel=1e-9)
        slipped = base.slip_increment[:, 0].min()  # in this step alone
        assert 0 < slipped < 0.01
        mu = base.tangential_force / base.normal_force
        assert MU - (MU - 0.2) * 0.01 / 0.1 < mu < MU


def test_force_of_nodes_on_segments_swings_with_the_cells() -> None:
    steps = slide("lower", "node-to-segment", 1, {}, {"law": "unilateral"})
    forces = np.array([step.contacts["joint"].normal_force for step in steps])
    assert np.ptp(forces) <= 0.05 * FORCE


@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_compliance_slides_too(slave: str) -> None:
    steps = slide(slave, "mortar", 1, {}, {"law": "compliance", "c_n": 1e4})
    # two springs in series: the block, 100 Pa / 0.5 m, and the surface
    expected = 0.005 / (0.5 / 100.0 + 1e-4)
    assert_allclose([step.contacts["joint"].normal_force for step in steps], expected, rtol=1e-6)


def test_pairs_are_searched_again_but_bodies_not_prepared_again() -> None:
    simulation = drawn("lower", "mortar", 1, {}, {"law": "unilateral"})
    steps = list(simulation.steps())
    assert simulation.counters.searches > len(steps)
    assert simulation.counters.factorisations == 1


def test_a_rigid_roller_presses_as_hard_wherever_it_is_drawn() -> None:
    roller = {"shape": "cylinder", "point": [2.0, 2.0], "radius": 1.0}
    roller["displacement"] = {"x": [[0, 0], [1, 0], [2, 1.0]], "y": [[0, 0], [1, -0.02]]}
    contact = {"surface": "block.top", "against": "roller", "sliding": True}
    data = {
        "model": "plane strain",
        "geometry": {"builder": "block", "length": 5.0, "height": 1.0, "mesh_size": 0.1, "contact_mesh_size": 0.05},
        "bodies": {"block": {"E": 1.0, "nu": 0.3}},
        "obstacles": {"roller": roller},
        "contacts": {"track": contact},
        "supports": {"base": {"boundary": "block.bottom", "displacement": {"x": 0.0, "y": 0.0}}},
        "steps": {"end": 2.0, "count": 2},
    }
    pressed, moved = prepare(from_dict(data)).steps()
    force = pressed.contacts["track"].normal_force
    assert force > 0
    assert_allclose(moved.contacts["track"].normal_force, force, rtol=0.02)  # 10 cells touch, 20 passed; ends 1.5 m off
    *_, smoothed = prepare(from_dict(data | {"solver": {"method": "regularised"}})).steps()
    assert_allclose(smoothed.contacts["track"].normal_force, moved.contacts["track"].normal_force, rtol=2e-3)


MU_PULLED, N = 0.4, 1000.0
BOUND = 300.0  # [Pa], of the laws whose bound jumps where surfaces part
COULOMB = {"law": "coulomb", "mu": MU_PULLED}


def pulled(dim: int, geometry: dict[str, Any], m_n: float, friction: dict[str, Any]) -> Any:
    """Pressed down, then pulled by more than mu N; the pull tilts it, and a spring behind it takes the rest."""
    away = {"y": 0.0} if dim == 2 else {"z": 0.0}
    tables = on_floor(
        dim,
        {"length": 1.0, "height": 0.5, "mesh_size": 0.25} | geometry,
        {"E": 1e7},
        {"normal": {"law": "compliance", "c_n": 1e7, "m_n": m_n}, "friction": friction},
        loads={
            "press": {"boundary": "block.top", "pressure": [[0, 0], [1, N]]},
            "pull": {"boundary": "block.top", "traction": {"x": [[1, 0], [2, 600]]} | away},
        },
        springs={"behind": {"at": "block.right", "stiffness": [1e4] + [0.0] * (dim - 1)}},
        probes={"middle": {"point": [0.5] * dim}},
        steps={"end": 2.0, "count": 4},
    )
    return from_dict(tables)


def last(simulation: Simulation) -> StepResult:
    *_, step = simulation.steps()
    return step


@pytest.mark.parametrize("m_n", [1.0, 2.0])
@pytest.mark.parametrize(
    "geometry", [{}, {"mesh_size": 0.1}, {"cells": "tensor"}, {"order": 2}, {"order": 2, "mesh_size": 0.1}], ids=str
)
def test_friction_is_mu_times_the_normal_force(geometry: dict[str, Any], m_n: float) -> None:
    base = last(prepare(pulled(2, geometry, m_n, COULOMB))).contacts["base"]
    assert 0 < base.slip_area == base.contact_area < 1  # all of it slides, part of the base has lifted
    assert_allclose(base.tangential_force, MU_PULLED * N, rtol=1e-9)
    assert np.all(base.bound >= 0)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    "law", [{"law": "tresca", "bound": [[0, BOUND], [2, BOUND]]}, {"law": "cohesion", "a": BOUND, "mu": 0.0}], ids=str
)
def test_a_bound_without_pressure_holds_on_the_area_that_touches(law: dict[str, Any], order: int) -> None:
    """The area is that of the quadrature points that press: no whole nodes, which would be half a facet more."""
    (rows,) = prepare(pulled(2, {"order": order}, 1.0, law)).system.contacts
    for count in range(len(rows.W_n) + 1):
        p = np.where(np.arange(len(rows.W_n)) < count, N, 0.0)
        s = rows.friction.limit(p, rows.average, rows.normal, 1.0, 2.0)
        assert_allclose(rows.W_t @ s, BOUND * rows.W_n[:count].sum(), rtol=1e-12)


@pytest.mark.parametrize("geometry", [{}, {"mesh_size": 0.125}, {"order": 2}], ids=str)
def test_it_slides_straight_on(geometry: dict[str, Any]) -> None:
    """Triangles without symmetry do not turn it out of the plane y = 1/2, in which all forces act."""
    simulation = estimating(pulled(3, geometry, 1.0, COULOMB))
    steps = list(simulation.steps())
    step = steps[-1]
    u, base = step.probes["middle"].displacement, step.contacts["base"]
    assert u[0] > 0.02  # [m]
    assert abs(u[1]) < 1e-4 * u[0]
    assert_allclose(base.tangential_force, MU_PULLED * N, rtol=2e-6)  # slip turns a little as the block is strained
    if geometry.get("order") != 2:
        parts = simulation.errors(steps)[-1][Quantity("probes", "middle", "displacement")]
        stated, corrected = parts.mesh, parts.corrected
        assert stated is not None
        assert 0.5 < np.asarray(stated)[1] / abs(u[1]) < 5
        assert abs(np.asarray(corrected)[1]) < 1e-4 * u[0]
