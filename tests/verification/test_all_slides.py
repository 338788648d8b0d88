"""A block that slides as a whole on a compliant base: friction is mu N, though the edge of contact crosses facets."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.solvers.results.step_result import Quantity, StepResult
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.simulation.simulation import prepare as estimating
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

MU, N = 0.4, 1000.0
BOUND = 300.0  # [Pa], of the laws whose bound jumps where surfaces part
COULOMB = {"law": "coulomb", "mu": MU}


def pulled(dim: int, geometry: dict[str, Any], m_n: float, friction: dict[str, Any]) -> Any:
    """Pressed down, then pulled by more than mu N; the pull tilts it, and a spring behind it takes the rest."""
    sizes = {"length": 1.0, "height": 0.5, "mesh_size": 0.25} | ({"width": 1.0} if dim == 3 else {})
    away = {"y": 0.0} if dim == 2 else {"z": 0.0}
    return from_dict(
        {
            "model": "plane strain" if dim == 2 else "3d",
            "geometry": {"builder": "block"} | sizes | geometry,
            "bodies": {"block": {"E": 1e7, "nu": 0.3}},
            "obstacles": {"floor": {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}},
            "contacts": {
                "base": {
                    "surface": "block.bottom",
                    "against": "floor",
                    "normal": {"law": "compliance", "c_n": 1e7, "m_n": m_n},
                    "friction": friction,
                }
            },
            "loads": {
                "press": {"boundary": "block.top", "pressure": [[0, 0], [1, N]]},
                "pull": {"boundary": "block.top", "traction": {"x": [[1, 0], [2, 600]]} | away},
            },
            "springs": {"behind": {"at": "block.right", "stiffness": [1e4] + [0.0] * (dim - 1)}},
            "probes": {"middle": {"point": [0.5] * dim}},
            "steps": {"end": 2.0, "count": 4},
        }
    )


def last(simulation: Simulation) -> StepResult:
    *_, step = simulation.steps()
    return step


@pytest.mark.parametrize("m_n", [1.0, 2.0])
@pytest.mark.parametrize(
    "geometry",
    [{}, {"mesh_size": 0.1}, {"cells": "tensor"}, {"order": 2}, {"order": 2, "mesh_size": 0.1}],
    ids=str,
)
def test_friction_is_mu_times_the_normal_force(geometry: dict[str, Any], m_n: float) -> None:
    base = last(prepare(pulled(2, geometry, m_n, COULOMB))).contacts["base"]
    assert 0 < base.slip_area == base.contact_area < 1  # all of it slides, part of the base has lifted
    assert_allclose(base.tangential_force, MU * N, rtol=1e-9)
    assert np.all(base.bound >= 0)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    "law", [{"law": "tresca", "bound": [[0, BOUND], [2, BOUND]]}, {"law": "cohesion", "a": BOUND, "mu": 0.0}], ids=str
)
def test_a_bound_without_pressure_holds_on_the_area_that_touches(law: dict[str, Any], order: int) -> None:
    """The area is that of the quadrature points that press: no whole nodes, which would be half a facet more."""
    (rows,) = prepare(pulled(2, {"order": order}, 1.0, law)).system.contacts
    assert rows.friction is not None
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
    assert_allclose(base.tangential_force, MU * N, rtol=2e-6)  # slip turns a little as the block is strained
    if geometry.get("order") != 2:
        stated = simulation.errors(steps)[-1][Quantity("probes", "middle", "displacement")].mesh
        assert stated is not None
        # with the default cells the drift that is left happens to be that of the run: .23
        assert (0.5 if geometry else 0.2) < np.asarray(stated)[1] / abs(u[1]) < 5
        assert abs(np.asarray(step.corrected[str(Quantity("probes", "middle", "displacement"))])[1]) < abs(u[1])
