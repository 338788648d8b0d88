"""Temperatures of bodies and in space: bars that bend freely or are held, a cylinder, two bodies that grow together.

Source: S. Timoshenko & J. N. Goodier, Theory of Elasticity, sections 149 to 154.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from stickslip import Scene, Simulation, StepResult
from stickslip.workflows.lab.verification.check import ONE, Check, close, problem
from stickslip.workflows.lab.verification.prepared import solved
from stickslip.workflows.scene_file.read import from_dict

E, NU, ALPHA, SLOPE = 200.0, 0.3, 1e-3, 20.0  # [Pa], [-], [1/K], [K/m]
RUBBER = 0.4999  # Poisson's ratio of bodies whose dilatation is averaged
WARM = 2.0  # of the lower of two bodies [K]
APART = 2e-3  # of two bodies [m]
PINNED: dict[str, dict[str, tuple[list[float], str]]] = {
    "plane stress": {"a": ([0.0, 0.0], "xy"), "b": ([0.0, 1.0], "x")},
    "3d": {"a": ([0.0, 0.0, 0.0], "xyz"), "b": ([0.0, 0.0, 1.0], "xy"), "c": ([0.0, 1.0, 0.0], "x")},
}
Solved = tuple[Simulation, list[StepResult], list[Check]]


def scene(model: str, temperature: Any, order: int = 2, nu: float = NU, **tables: Any) -> Scene:
    """A bar 4 x 1 (x 1)."""
    shape = {"builder": "block", "length": 4.0, "height": 1.0, "mesh_size": 0.5, "order": order}
    heat = temperature if isinstance(temperature, dict) else {"temperature": temperature}
    data = {
        "model": model,
        "geometry": shape | ({"width": 1.0} if model == "3d" else {}),
        "bodies": {"block": {"E": E, "nu": nu}},
        "thermal": {"block": {"expansion": ALPHA} | heat},
    }
    return from_dict(data | tables)


def bent(model: str, nu: float = NU) -> Solved:
    """A free bar whose temperature is linear bends into a circle without stress: u_h = alpha g (h² - x² (- y²)) / 2."""
    pins = {n: {"point": at, "displacement": dict.fromkeys(axes, 0.0)} for n, (at, axes) in PINNED[model].items()}
    up = "z" if model == "3d" else "y"
    simulation, (step,) = solved(scene(model, f"{SLOPE}*{up}", nu=nu, supports=pins))
    x, h = simulation.data.points[:, 0], simulation.data.points[:, -1]
    across = simulation.data.points[:, 1] if model == "3d" else 0 * x
    along, rise = ALPHA * SLOPE * x * h, ALPHA * SLOPE * (h**2 - x**2 - across**2) / 2
    stress, off = np.abs(step.stress).max(), step.displacement[:, [0, -1]] - np.stack([along, rise], axis=1)
    return simulation, [step], [
        close(f"bent freely, {model}, nu = {nu:g}: largest stress [Pa]", stress, 0.0, 1e-9, E * ALPHA * SLOPE),
        close(f"bent freely, {model}, nu = {nu:g}: displacement [m]", np.abs(off).max(), 0.0, 1e-8, np.abs(rise).max()),
    ]  # fmt: skip


def held(order: int) -> Solved:
    """Between walls, nu = 0: -E alpha times the mean temperature, which follows its history."""
    walls = {side: {"boundary": f"block.{side}", "displacement": {"x": 0.0}} for side in ("left", "right")}
    walls["foot"] = {"boundary": "block.bottom", "displacement": {"y": 0.0}}
    heat = {"temperature": f"{SLOPE}*x**2", "history": [[1.0, 1.0], [2.0, -0.5]]}
    tables: dict[str, Any] = {
        "supports": walls,
        "bodies": {"block": {"E": E, "nu": 0.0}},
        "steps": {"end": 2.0, "count": 2},
    }
    simulation, steps = solved(scene("plane strain", heat, order, **tables))
    found = []
    for step, factor in zip(steps, (1.0, -0.5), strict=True):
        exact = -E * ALPHA * SLOPE * 16 / 3 * factor
        name = f"held, order {order}, t = {step.time:g}"
        found.append(close(f"{name}: force [N]", step.supports["right"].force[0], exact, 1e-9, E * ALPHA))
    return simulation, steps, found


def cylinder(nu: float = NU, order: int = 2) -> Solved:
    """Between plates, T = g r²: sigma_r = E alpha g (b² - r²) / (4 (1 - nu)).

    In the middles of cells 12 % (order 1) and .15 % (2) of the largest off, with averaged dilatations 14 and .05 %.
    """
    plates = {side: {"boundary": f"block.{side}", "displacement": {"y": 0.0}} for side in ("top", "bottom")}
    shape = {"builder": "block", "length": 1.0, "height": 0.25, "mesh_size": 0.0625, "order": order}
    simulation, (step,) = solved(scene("axisymmetric", f"{SLOPE}*x**2", nu=nu, supports=plates, geometry=shape))
    r = simulation.data.points[simulation.data.cells[:, :3], 0].mean(axis=1)
    exact = E * ALPHA * SLOPE * (1 - r**2) / (4 * (1 - nu))
    off = np.abs(step.stress[:, 0, 0] - exact).max()
    name = f"cylinder, order {order}, nu = {nu:g}: radial stress [Pa]"
    return simulation, [step], [close(name, off, 0.0, {1: 0.2, 2: 2e-3}[order], exact.max())]


def together() -> Solved:
    """Two bodies, each with a temperature of its own, grow until they touch; nu = 0."""
    tables: dict[str, Any] = {
        "geometry": {"builder": "two_blocks", "length": 1.0, "height": 1.0, "mesh_size": 0.25},
        "bodies": {"upper": {"E": E, "nu": 0.0}, "lower": {"E": E, "nu": 0.0}},
        "supports": {
            "foot": {"boundary": "lower.bottom", "displacement": {"y": 0.0}},
            "head": {"boundary": "upper.top", "displacement": {"y": 0.0}},
            **{b: {"boundary": f"{b}.left", "displacement": {"x": 0.0}} for b in ("lower", "upper")},
        },
        "contacts": {"joint": {"surface": "upper.bottom", "against": "lower.top", "gap_offset": APART}},
        "thermal": {
            "upper": {"expansion": ALPHA, "temperature": f"{SLOPE}*y"},
            "lower": {"expansion": ALPHA, "temperature": WARM},
        },
    }
    simulation, (step,) = solved(scene("plane strain", 0.0, **tables))
    pressure = E / 2 * (ALPHA * SLOPE / 2 + ALPHA * WARM - APART)
    force = step.contacts["joint"].normal_force
    return simulation, [step], [close("two bodies: contact force [N]", force, pressure, 5e-3, pressure)]


def problems() -> Iterator[Solved]:
    """All of them."""
    yield from map(bent, PINNED)
    yield from map(held, (1, 2))
    yield bent("3d", RUBBER)
    yield from (cylinder(nu, order) for nu in (NU, RUBBER) for order in (1, 2))
    yield together()


@problem("temperatures in space and by body: bars, a cylinder, a gap", methods=ONE)
def checks(method: str) -> list[Check]:
    """Their checks, by one method."""
    return [check for *_, found in problems() for check in found]
