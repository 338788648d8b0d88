"""Nearly incompressible bodies: Hertz' pressures at nu = .4999 with order 1, and rubber that heats between walls."""

from __future__ import annotations

import numpy as np

from stickslip import Simulation, StepResult
from stickslip.geometry.shape import Model
from stickslip.workflows.lab.verification.cases import hertz as case
from stickslip.workflows.lab.verification.check import ONE, Check, close, problem
from stickslip.workflows.lab.verification.prepared import prepare, solved
from stickslip.workflows.scene_file.read import from_dict

NU = 0.4999
FREE, E = 1e-3, 2.0  # strain without stress, Young's modulus [Pa] of the rubber that heats
CELLS = 16.0  # in the half width of the contact


def off(touch: case.Touch) -> float:
    """Root mean square error of the pressures within .9 a by Hertz' peak, at the computed force."""
    simulation, (step,) = solved(case.scene(touch))
    face, points = step.contacts["face"], simulation.data.surfaces["face"].points
    exact = touch.exact(face.normal_force / case.SHARE[touch.model])
    r = np.linalg.norm(points[:, :-1], axis=1)
    inside = r < 0.9 * exact.a
    error = face.pressure - exact.p0 * np.sqrt(np.maximum(1 - (r / exact.a) ** 2, 0.0))
    return float(np.sqrt(np.mean(error[inside] ** 2))) / exact.p0


def heated(nu: float, sides: tuple[str, ...]) -> tuple[Simulation, StepResult, list[Check]]:
    """Held on all sides, p = 3 K e for a free strain e; held nowhere it has no stress, although its volume changes."""
    held = {side: {"boundary": f"block.{side}", "displacement": {"normal": 0.0}} for side in sides}
    foot = {"foot": {"point": [0.0, 0.0], "displacement": {"x": 0.0}}}
    simulation = prepare(
        from_dict(
            {
                "model": "plane strain" if sides else "axisymmetric",
                "geometry": {"builder": "block", "length": 1.0, "height": 1.0, "mesh_size": 0.25},
                "bodies": {"block": {"E": E, "nu": nu}},
                "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
                "contacts": {"base": {"surface": "block.bottom", "against": "floor", "normal": {"law": "bilateral"}}},
                "supports": held or foot,
                "thermal": {"block": {"expansion": 1e-5, "temperature": FREE / 1e-5}},
            }
        )
    )
    (step,) = simulation.steps()
    pressure = E / (1 - 2 * nu) * FREE if sides else 0.0
    name, stress = f"heated, {'held' if sides else 'free'}", step.stress + pressure * np.eye(3)
    touching = np.abs(step.contacts["base"].pressure - pressure).max()
    return simulation, step, [
        close(f"{name}: stress beside -3 K e [Pa]", float(np.abs(stress).max()), 0.0, 1e-9, E),
        close(f"{name}: pressure beside it [Pa]", float(touching), 0.0, 1e-9, E),
    ]  # fmt: skip


@problem("nearly incompressible: Hertz at nu = .4999, heat", methods=ONE)
def checks(method: str) -> list[Check]:
    """Hertz in two models, and the rubber, with one method."""
    found = [check for sides in (("left", "right", "top"), ()) for check in heated(0.499, sides)[2]]
    models: tuple[Model, ...] = ("plane strain", "axisymmetric")
    for model in models:
        error = off(case.Touch(model=model, order=1, cells=CELLS, nu=NU))
        found.append(close(f"{model}, nu = {NU}: pressures off Hertz', rms [-]", error, 0.0, 0.01, 1.0))
    return found
