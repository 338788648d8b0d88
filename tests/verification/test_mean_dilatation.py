"""Nearly incompressible bodies: nothing locks, in any model, order and cell; what is compressible stays as it was."""

from dataclasses import asdict, replace
from typing import Any, Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.audited import record_of, stored_by
from stickslip.geometry.shape import Model
from stickslip.solvers.results.audit import Audit, Auditor
from stickslip.solvers.simulation.plan import make_plan, warnings
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.lab.verification.cases.hertz import Touch
from stickslip.workflows.lab.verification.cases.rubber import heated, off
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

AUTO: dict[str, Any] = {}
ALONE = {"formulation": "displacement"}


@pytest.mark.parametrize(
    ("model", "order", "cells", "within"),
    [
        ("plane strain", 1, 16, 0.01),
        ("plane strain", 2, 16, 0.01),
        ("axisymmetric", 1, 16, 0.01),
        ("axisymmetric", 2, 16, 0.003),
        pytest.param("3d", 1, 8, 0.06, marks=pytest.mark.slow),  # at nu = .3: .033
        pytest.param("3d", 2, 5, 0.015, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("nu", [0.4999, pytest.param(0.5, marks=pytest.mark.slow)])
def test_round_bodies_press_as_hertz_says(
    nu: float, model: Model, order: Literal[1, 2], cells: int, within: float
) -> None:
    assert off(Touch(model=model, order=order, cells=float(cells), nu=nu)) < within


def block(nu: float, dim: int = 2, cells: str = "simplex", order: int = 1, h: float = 0.125, **body: Any) -> Simulation:
    """A block of 2 m by 1 m whose top is bonded to a plate that presses it on a plane, with friction."""
    up, width = "xyz"[dim - 1], {"width": 1.0} if dim == 3 else {}
    held = dict.fromkeys("xyz"[:dim], 0.0) | {up: -0.01}
    return prepare(
        from_dict(
            {
                "model": "plane strain" if dim == 2 else "3d",
                "geometry": {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": h, "order": order}
                | width | {"cells": cells},
                "bodies": {"block": {"E": 1.0, "nu": nu} | body},
                "obstacles": {"floor": {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}},
                "contacts": {
                    "base": {
                        "surface": "block.bottom", "against": "floor", "friction": {"law": "coulomb", "mu": 0.3}
                    }
                },
                "supports": {"top": {"boundary": "block.top", "displacement": held}},
                "probes": {"middle": {"point": [0.93] * (dim - 1) + [0.41]}},
                "solver": {"tolerance": 1e-10},
            }
        )
    )  # fmt: skip


def audited(simulation: Simulation) -> tuple[Any, Audit]:
    (step,) = simulation.steps()
    record = replace(record_of(step), stored=stored_by(step))
    return step, Auditor(simulation.problem, simulation.mesh)(record)


@pytest.mark.parametrize("dim", [2, 3])
def test_all_cells_and_orders_resist_alike_and_the_audit_agrees(dim: int) -> None:
    """At order 1 and cells of an eighth (3D: a quarter) of the height, forces are within 5 (3D: 9) %."""
    nu, found = {2: 0.4999, 3: 0.5}[dim], []
    for cells, order in (("simplex", 2), ("tensor", 2), ("simplex", 1), ("tensor", 1)):
        step, audit = audited(block(nu, dim, cells, order, h=0.125 if dim == 2 else 0.25))
        assert max(asdict(audit).values()) < 1e-7
        found.append(step.contacts["base"].normal_force)
    assert_allclose(found, found[0], rtol=0.05 if dim == 2 else 0.09)
    locked = audited(block(0.4999, dim, "simplex", h=0.125 if dim == 2 else 0.25, **ALONE))[0]
    assert locked.contacts["base"].normal_force > 5 * found[0]


def test_without_locking_both_formulations_are_near_and_ordinary_bodies_are_as_they_were() -> None:
    ordinary, alone = (audited(block(0.3, order=2, **body))[0] for body in (AUTO, ALONE))
    assert_array_equal(ordinary.displacement, alone.displacement)
    mean = audited(block(0.3, order=2, formulation="mean-dilatation"))[0]
    assert_allclose(mean.contacts["base"].normal_force, ordinary.contacts["base"].normal_force, rtol=2e-3)
    assert_allclose(mean.probes["middle"].stress, ordinary.probes["middle"].stress, atol=2e-3 * 0.02)
    assert np.abs(mean.displacement - ordinary.displacement).max() > 1e-6


def test_the_plan_names_the_bodies_and_what_locks_is_warned_of() -> None:
    def row(scene: Any) -> tuple[bool, str]:
        (found,) = (row for row in make_plan(scene) if row.effect == "mean_dilatation")
        return found.on, found.because

    soft, ordinary, alone = (
        block(nu, h=0.5, **body).scene for nu, body in ((0.4999, AUTO), (0.3, AUTO), (0.4999, ALONE))
    )
    assert row(soft) == (True, "bodies.block.nu = 0.4999")
    assert not row(ordinary)[0]
    assert not row(alone)[0]
    assert not row(replace(soft, model="plane stress"))[0]
    assert [len(warnings(each)) for each in (soft, ordinary, alone)] == [0, 0, 1]


@pytest.mark.parametrize("sides", [("left", "right", "top"), ()])
def test_rubber_between_supports_that_heats_presses_by_its_bulk_modulus(sides: tuple[str, ...]) -> None:
    simulation, step, checks = heated(0.499, sides)
    assert not failures(checks)
    record = replace(record_of(step), stored=stored_by(step))
    assert max(asdict(Auditor(simulation.problem, simulation.mesh)(record)).values()) < 1e-9
