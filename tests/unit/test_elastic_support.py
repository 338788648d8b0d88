"""Springs under a side: what they hold and what they do not, rigid motions, joints with supports, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit
from shared.cases import every_nth
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.step_result import Quantity, StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan, planned
from stickslip.solvers.simulation.simulation import prepare as with_errors
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

K, E = 500.0, 1000.0
NORMAL, WHOLE = {"normal": K}, {"normal": K, "tangential": K}


def scene(model: str = "plane strain", bed: dict[str, Any] = WHOLE, side: str = "bottom", **tables: Any) -> Scene:
    """A block 2 x 1 on springs."""
    data = {
        "model": model,
        "geometry": {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5},
        "bodies": {"block": {"E": E, "nu": 0.0, "density": 1.0}},
        "elastic_support": {"bed": {"boundary": f"block.{side}", **bed}},
    }
    return from_dict(data | tables)


def test_a_floating_block_needs_springs_in_every_direction() -> None:
    assert planned(scene()).rigid_modes.shape == (3, 0)
    assert planned(scene("axisymmetric", NORMAL)).rigid_modes.shape == (1, 0)
    with pytest.raises(SceneError, match=r"supports: nothing resists the translation along x"):
        make_plan(scene(bed=NORMAL))
    with pytest.raises(SceneError, match=r"supports: nothing resists the translation along y"):
        make_plan(scene(bed={"tangential": K}))
    (row,) = (row for row in make_plan(scene()) if row.effect == "elastic_support")
    assert (row.on, row.because) == (True, "elastic_support.bed")


def test_what_springs_leave_free_is_held_by_contact_and_friction() -> None:
    """A floor on springs beside it: the motion along x is left to friction, and costs no spring."""
    tables: dict[str, Any] = {
        "obstacles": {
            "lid": {"shape": "plane", "point": [0.0, 1.0], "normal": [0.0, -1.0], "displacement": {"y": -0.03}}
        },
        "contacts": {"top": {"surface": "block.top", "against": "lid", "friction": {"law": "coulomb", "mu": 0.5}}},
        "loads": {"push": {"boundary": "block.right", "traction": [-0.5, 0.0]}},
    }
    found = scene(bed=NORMAL, **tables)
    assert planned(found).rigid_modes.shape == (3, 1)
    simulation = prepare(found)
    (step,) = simulation.steps()
    assert_allclose(step.contacts["top"].force, [0.5, -2.0 * 0.03 / (1 / K + 1 / E)], rtol=1e-8)
    assert max(audit(simulation, step).values()) < 1e-8
    assert step.energy.external == pytest.approx(step.energy.stored + step.energy.contact, rel=1e-8)


def test_springs_carry_the_weight() -> None:
    gravity = {"gravity": {"acceleration": [3.0, -2.0]}}
    simulation = prepare(scene(**gravity))
    (step,) = simulation.steps()
    base = np.flatnonzero(simulation.data.points[:, 1] < 1e-9)
    base = base[np.argsort(simulation.data.points[base, 0])]
    u = step.displacement[base]
    mean = (u[1:] + u[:-1]).mean(axis=0) / 2  # of equal facets
    assert_allclose(mean, [3.0 / K, -2.0 / K], rtol=1e-10)
    bed = step.elastic_support["bed"]
    assert_allclose(bed.force, [-6.0, 4.0], rtol=1e-10)
    assert_allclose(bed.moment, 1.0 * 4.0 + 0.5 * 6.0, rtol=1e-10)
    assert step.energy.external == pytest.approx(step.energy.stored, rel=1e-10)
    assert max(audit(simulation, step).values()) < 1e-10


def test_a_rigid_motion_that_supports_prescribe_strains_the_springs_that_resist_it() -> None:
    lid = {"lid": {"boundary": "block.top", "displacement": {"x": 0.01, "y": 0.0}}}
    for bed, resisted in ((NORMAL, False), (WHOLE, True)):
        simulation = prepare(scene(bed=bed, supports=lid))
        (step,) = simulation.steps()
        assert step.energy.stored == pytest.approx(step.energy.external, rel=1e-9, abs=1e-15)
        assert (step.energy.stored > 1e-6) == resisted
        assert max(audit(simulation, step).values()) < 1e-9


@pytest.mark.parametrize(
    ("bed", "side", "message"),
    [
        (WHOLE, "botom", r"elastic_support\.bed\.boundary = block\.botom: no such side; did you mean"),
        ({}, "bottom", r"elastic_support\.bed\.normal = 0\.0: springs need a stiffness"),
        ({"normal": -1.0}, "bottom", r"elastic_support\.bed\.normal = -1\.0: must not be negative"),
        ({"normal": 1e-8, "tangential": K}, "bottom", r"elastic_support\.bed = 1e-08: too soft beside the bodies"),
        ({"stiffness": K}, "bottom", r"elastic_support\.bed\.stiffness: unknown key"),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(bed: dict[str, float], side: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        make_plan(scene(bed=bed, side=side))


@pytest.mark.parametrize("form", ["condensed", "matrix-free"])
def test_springs_that_hardly_hold_do_not_hide_what_sticks(form: str) -> None:
    """Without contact the block would move by a kilometre: statuses are judged by the tractions that there are."""
    tables: dict[str, Any] = {
        "bodies": {"block": {"E": 2.1e11, "nu": 0.3}},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        "contacts": {
            "base": {"surface": "block.bottom", "against": "floor", "friction": {"law": "coulomb", "mu": 0.3}}
        },
        "loads": {
            "top": {"boundary": "block.top", "pressure": "1e6*(1+x)"},
            "side": {"boundary": "block.left", "pressure": 4e5},
        },
        "solver": {"surface": form},
    }
    weak = {"normal": 1e3, "tangential": 1e3}
    (held,) = prepare(scene(bed=weak, side="top", **tables)).steps()
    (free,) = prepare(scene(bed=weak, side="top", **(tables | {"elastic_support": {}}))).steps()
    assert held.p_ref > 1e6 * free.p_ref
    for key in ("contact_area", "stick_area", "slip_area"):
        assert getattr(held.contacts["base"], key) == getattr(free.contacts["base"], key)
    assert free.contacts["base"].slip_area > 0


def bedded(model: str, mesh_size: float = 0.5, order: int = 1, **tables: Any) -> StepResult:
    """A block on springs, pressed beside its middle by a lid with friction; the last of two steps."""
    up, width = ("z", {"width": 1.0}) if model == "3d" else ("y", {})
    point, normal = ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]) if model == "3d" else ([0.0, 1.0], [0.0, -1.0])
    shape = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": mesh_size, "order": order} | width
    pressed: dict[str, Any] = {up: [[1, -0.03], [2, -0.03]]}
    data: dict[str, Any] = {
        "geometry": shape,
        "bodies": {"block": {"E": E, "nu": 0.3, "density": 1.0}},
        "obstacles": {"lid": {"shape": "plane", "point": point, "normal": normal, "displacement": pressed}},
        "contacts": {"top": {"surface": "block.top", "against": "lid", "friction": {"law": "coulomb", "mu": 0.2}}},
        "steps": {"end": 2.0, "count": 2},
    }
    if model != "axisymmetric":
        pressed["x"] = [[1, 0], [2, 0.02]]
        data["loads"] = {"push": {"boundary": "block.right", "pressure": [[1, 0], [2, 2.0]]}}
    bed = WHOLE if model != "axisymmetric" else NORMAL
    *_, last = with_errors(scene(model, bed, **(data | tables))).steps()
    return last


@pytest.mark.parametrize(("model", "order"), every_nth(2, ["plane strain", "axisymmetric", "3d"], [1, 2]))
def test_what_springs_exert_is_in_balance(model: str, order: int) -> None:
    """As it is, and with bubbles: with the contact, and the pressure on the right side."""
    last = bedded(model, order=order)
    bed, top = last.elastic_support["bed"], last.contacts["top"]
    push = np.zeros(len(bed.force))
    push[0] = -2.0 if model != "axisymmetric" else 0.0
    size = top.normal_force
    assert_allclose(bed.force + top.force + push, 0.0, atol=1e-7 * size)
    turned = -push[0] / 2 if model == "plane strain" else push[0] * np.array([0.0, 0.5, -0.5]) if model == "3d" else 0.0
    assert_allclose(bed.moment + top.moment + turned, 0.0, atol=1e-7 * size)
    if order == 1:
        for key, loads, most in (("force", push, 1e-3), ("moment", turned, 2e-3)):
            names = (str(Quantity(*of, key)) for of in (("elastic_support", "bed"), ("contacts", "top")))
            assert_allclose(sum(np.asarray(last.corrected[name]) for name in names) + loads, 0.0, atol=most * size)


def test_its_error_is_stated() -> None:
    """A wall carries a part: how much is not a matter of balance."""
    wall = {"wall": {"boundary": "block.left", "displacement": {"x": 0.0, "y": 0.0, "z": 0.0}}}
    found, fine = bedded("3d", 0.5, supports=wall), bedded("3d", 0.25, order=2, supports=wall)
    for key in ("force", "moment"):
        name = str(Quantity("elastic_support", "bed", key))
        own, true = (getattr(step.elastic_support["bed"], key) for step in (found, fine))
        stated, corrected = (np.asarray(part) for part in (found.errors[name].mesh, found.corrected[name]))
        assert 0.8 < np.linalg.norm(stated) / np.linalg.norm(own - true) < 2.5
        assert np.linalg.norm(corrected - true) < 0.5 * np.linalg.norm(own - true)
