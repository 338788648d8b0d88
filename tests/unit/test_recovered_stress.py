"""The estimate of the mesh's error: against exact errors, zero where the mesh is exact, absent where nobody asks."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import every_nth
from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.dolfinx_versions import ufl
from stickslip.solvers.results.recovered_stress import RecoveredStress
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.lab.verification.cases import manufactured as case
from stickslip.workflows.lab.verification.cases.manufactured import LAWS, MU
from stickslip.workflows.lab.verification.prepared import accepted
from stickslip.workflows.scene_file.read import read

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
PRESSED = {"top": {"boundary": "block.top", "displacement": {"y": -0.1}}}


def stated_over_true(law: Any, order: int, n: int) -> float:
    """In the energy norm, for the manufactured solution on n x n x 2 triangles."""
    system, field = case.loaded(case.scene(law, "condensed-newton", order, n, MU, case.AWAY), law)
    (step,) = accepted(system)
    u = dx.fem.Function(system.space)
    dx.fill(u, step.state.u.array)
    off = ufl.inner(system.weak.stress(u - field, "block"), system.weak.strain(u - field))  # 2D: eps_zz = 0
    points, weights = dx.reference_rule("triangle", case.DEGREE)
    values = dx.CellExpression(off, points, system.mesh.domain)(np.arange(2 * n**2))
    true = np.sqrt(np.einsum("cqi,q->", values, weights) / n**2)
    return float(RecoveredStress(system)(step.state.u, step.state.initial).size / true)


@pytest.mark.parametrize("law", LAWS)
def test_linear_cells_state_the_error_of_a_smooth_field(law: Any) -> None:
    coarse, fine = (abs(stated_over_true(law, 1, n) - 1) for n in (4, 16))
    assert coarse < 0.05
    assert fine < 0.01  # asymptotically exact


@pytest.mark.parametrize("law", LAWS)
def test_quadratic_cells_state_it_too(law: Any) -> None:
    assert all(0.85 < stated_over_true(law, 2, n) < 1.15 for n in (4, 16))


@pytest.mark.parametrize(
    ("model", "cells", "order"),
    every_nth(2, ["plane strain", "plane stress", "axisymmetric", "3d"], ["simplex", "tensor"], [1, 2]),
)
def test_a_uniform_stress_has_no_error(
    model: str, cells: str, order: int, scene_of: SceneOf, estimating: SimulationOf
) -> None:
    dim = 3 if model == "3d" else 2
    shape = {"cells": cells, "order": order, "mesh_size": 0.5}
    supports = {"top": {"boundary": "block.top", "displacement": {"xyz"[dim - 1]: -0.1}}}
    held = {"left": ["x"], "front": ["y"]} if dim == 3 else {} if model == "axisymmetric" else {"left": ["x"]}
    for side, axes in held.items():
        supports[side] = {"boundary": f"block.{side}", "displacement": dict.fromkeys(axes, 0.0)}
    base = {"surface": "block.bottom", "against": "foundation"}
    simulation = estimating(scene_of(dim, shape, model=model, contacts={"base": base}, supports=supports))
    (step,) = simulation.steps()
    assert_allclose(step.mesh_error, 0.0, atol=1e-12)
    stress = np.abs(step.stress[:, dim - 1, dim - 1])
    assert_allclose(step.stress_error, 0.0, atol=1e-11 * stress.max())
    assert stress.min() > 0.05


@pytest.mark.parametrize(("name", "words"), [
    ("axisymmetric", ["geometry.mesh_size=0.2", "geometry.contact_mesh_size=0.1", "geometry.order=1",
                       "steps.count=4"]),
    ("cube", ["geometry.mesh_size=0.25"]),
    pytest.param("cylinders", ["geometry.mesh_size=1.0", "geometry.contact_mesh_size=0.1",
                               "geometry.lower_mesh_size=1.3"], marks=pytest.mark.slow),
])  # fmt: skip
def test_it_falls_with_the_mesh(name: str, words: list[str], estimating: SimulationOf) -> None:
    """And belongs to bodies: a jump of the stress from one to the next is no error."""
    halved = [f"{key}={float(value) / 2}" for key, value in (word.split("=") for word in words if "size" in word)]
    errors = []
    for words_ in (words, [*words, *halved]):
        (*_, last) = estimating(read(name, words_)).steps()
        errors.append(last.mesh_error)
    assert 1.4 < errors[0] / errors[1] < 2.3


def test_what_nobody_asks_for_costs_nothing(scene_of: SceneOf, estimating: SimulationOf) -> None:
    tables = {"contacts": {"base": {"surface": "block.bottom", "against": "foundation"}}, "supports": PRESSED}
    tables["supports"]["left"] = {"boundary": "block.left", "displacement": {"x": 0.0}}  # type: ignore[index]
    asked, silent = (estimating(scene_of(**tables, output={"error": on})) for on in (True, False))
    (one,), (other,) = asked.steps(), silent.steps()
    assert asked.seconds.error > 0
    assert silent.seconds.error == 0
    assert np.isnan(other.mesh_error)
    assert not len(other.stress_error)
    assert len(one.stress_error) == len(asked.data.cells)
