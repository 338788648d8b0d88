"""Bolts: the joint diagram of bolt and plates, the lap joint that slips, every model, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.quantities import values
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.scene_file.read import from_dict
from stickslip.workflows.verification.prepared import prepare

E, K, SHORTER, MU = 1000.0, 400.0, 0.01, 0.2
AREA = {"plane strain": 2.0, "3d": 1.0, "axisymmetric": np.pi * 4.0}


def joint(model: str = "plane strain", order: int = 1, bolt: dict[str, Any] | None = None, **tables: Any) -> Scene:
    """Two plates 2 x 1 (x 0.5), nu = 0, on a foot that carries no force along the bolt while it is tightened."""
    up = [0.0, 0.0, 1.0] if model == "3d" else [0.0, 1.0]
    own = {"head": "upper.top", "nut": "lower.bottom", "axis": up, "stiffness": K, "shortening": [[1.0, SHORTER]]}
    across = {"3d": {"left": "x", "front": "y"}, "plane strain": {"left": "x"}, "axisymmetric": {}}[model]
    sides = {
        f"{body}_{side}": {"boundary": f"{body}.{side}", "displacement": {axis: 0.0}}
        for body in ("lower", "upper")
        for side, axis in across.items()
    }
    plates = {"builder": "two_blocks", "length": 2.0, "height": 1.0, "mesh_size": 0.5, "order": order}
    foot = {"boundary": "lower.bottom", "displacement": {"z" if model == "3d" else "y": 0.0}}
    data = {
        "model": model,
        "geometry": plates | ({"width": 0.5} if model == "3d" else {}),
        "bodies": {"upper": {"E": E, "nu": 0.0}, "lower": {"E": E, "nu": 0.0}},
        "supports": sides | {"foot": foot},
        "contacts": {"joint": {"surface": "upper.bottom", "against": "lower.top"}},
        "bolts": {"b": own | (bolt or {})},
    }
    return from_dict(data | tables)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("model", [*AREA])
def test_bolt_and_plates_share_a_load_until_the_joint_opens(model: str, order: int) -> None:
    """F0 = k s c / (k + c); a load A adds A k / (k + c) to the bolt up to A = F0 (1 + k / c), from there all."""
    plates = E * AREA[model] / 2
    preload = K * SHORTER * plates / (K + plates)
    opens = preload * (1 + K / plates)
    pull = [0.0] * (model == "3d") + [0.0, [[1.0, 0.0], [2.0, 2.1 * opens / AREA[model]]]]
    loads = {"pull": {"boundary": "upper.top", "traction": pull}}
    simulation = prepare(joint(model, order, loads=loads, steps={"end": 2.0, "count": 8}))
    for step in simulation.steps():
        tightened, load = min(step.time, 1.0), 2.1 * opens * max(step.time - 1.0, 0.0)
        tension = max(tightened * preload + load * K / (K + plates), load)
        assert_allclose(step.bolts["b"], (tension, tightened * SHORTER), rtol=1e-8)
        assert_allclose(values(step)["bolt.b.tension"], tension, rtol=1e-8)
        assert_allclose(step.contacts["joint"].normal_force, tension - load, atol=1e-8 * preload)
        energy = step.energy
        assert energy.external == pytest.approx(energy.stored + energy.contact, abs=1e-10 * preload * SHORTER)
        assert max(audit(simulation, step).values()) < 1e-8


def test_a_lap_joint_slips_at_mu_times_the_tension() -> None:
    """One face of friction: n mu P, n = 1."""
    friction = {"joint": {"surface": "upper.bottom", "against": "lower.top", "friction": {"law": "coulomb", "mu": MU}}}
    supports = {
        "foot": {"boundary": "lower.bottom", "displacement": {"y": 0.0}},
        "held": {"boundary": "lower.left", "displacement": {"x": 0.0}},
        "drawn": {"boundary": "upper.right", "displacement": {"x": [[1.0, 0.0], [2.0, 0.004]]}},
    }
    simulation = prepare(joint(contacts=friction, supports=supports, steps={"end": 2.0, "count": 8}))
    *_, stuck, _, _, last = simulation.steps()
    contact = last.contacts["joint"]
    assert contact.stick_area == 0.0
    assert stuck.contacts["joint"].stick_area > 0.0
    assert_allclose(last.supports["drawn"].force[0], MU * last.bolts["b"].tension, rtol=1e-6)
    assert_allclose(contact.normal_force, last.bolts["b"].tension, rtol=1e-8)
    assert max(audit(simulation, last).values()) < 1e-8


@pytest.mark.parametrize(
    ("bolt", "message"),
    [
        ({"head": "upper.tp"}, r"bolts\.b\.head = upper\.tp: no such side; did you mean upper\.top"),
        ({"nut": "lower.botom"}, r"bolts\.b\.nut = lower\.botom: no such side"),
        ({"nut": "upper.top"}, r"bolts\.b\.nut = upper\.top: a bolt has two different ends"),
        ({"axis": [0.0, 0.0]}, r"bolts\.b\.axis = \[0\.0, 0\.0\]: must not be zero"),
        ({"axis": [1.0]}, r"bolts\.b\.axis = \[1\.0\]: expected 2 components"),
        ({"stiffness": -1.0}, r"bolts\.b\.stiffness = -1\.0: must be positive, in N/m"),
        ({"shortening": "t"}, r'bolts\.b\.shortening = "t": expected a number'),
        ({"torque": 1.0}, r"bolts\.b\.torque: unknown key"),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(bolt: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        joint(bolt=bolt)


def test_a_bolt_is_along_the_axis_of_symmetry() -> None:
    with pytest.raises(SceneError, match=r"bolts\.b\.axis = \[1\.0, 0\.0\]: an axisymmetric model has bolts along"):
        joint("axisymmetric", bolt={"axis": [1.0, 0.0]})
