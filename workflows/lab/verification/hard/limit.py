"""Loads close to a limit: gravity turned sideways, to a share of the angle at which floating bodies cease to rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stickslip.geometry.amplitude import value_at
from stickslip.geometry.errors import StickslipError
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.stepping.stepper import NoEquilibriumError
from stickslip.workflows.lab.verification.hard.tables import Tables, copied, scene_of
from stickslip.workflows.lab.verification.prepared import prepare

STEEPEST = 2.0  # of the vertical component; bodies that rest even there have no limit
HALVINGS = 14  # of the bracket


def sideways(share: float, tables: Tables) -> Tables | None:
    """After its end, gravity also grows sideways, to this share of its vertical component; None without gravity."""
    if "gravity" not in tables:
        return None
    end, acceleration = tables["steps"]["end"], tables["gravity"]["acceleration"]
    down = value_at(_tuple(acceleration[-1]), end, end)
    acceleration[0] = [[0.0, 0.0], [end, 0.0], [2 * end, share * abs(down)]]
    tables["steps"] = {"end": 2 * end, "count": 2 * tables["steps"]["count"]}
    return tables


def near_limit(factor: float, tables: Tables) -> Tables | None:
    """`sideways` to this factor of its limit, which is bracketed by limit analysis; None if there is none."""
    steepest = sideways(STEEPEST, copied(tables))
    if steepest is None or not resolve(scene_of(tables)).rigid_modes.shape[1] or not _falls(steepest):
        return None
    low, high = 0.0, STEEPEST
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        trial = sideways(middle, copied(tables))
        assert trial is not None
        low, high = (low, middle) if _falls(trial) else (middle, high)
    return sideways(factor * (low if factor < 1 else high), tables)


def _falls(tables: Tables) -> bool:
    """Whether it is proved that the bodies cannot rest under the loads of the end; one iteration is enough."""
    gravity = tables["gravity"]["acceleration"]
    end = tables["steps"]["end"]
    tables["gravity"]["acceleration"] = [value_at(_tuple(a), end, end) for a in gravity]
    tables["steps"] = {"end": end, "count": 1}
    scene = scene_of(tables)
    try:
        list(prepare(replace(scene, solver=replace(scene.solver, max_iterations=1))).steps())
    except NoEquilibriumError:
        return True
    except StickslipError:
        return False
    return False


def _tuple(value: float | list[list[float]]) -> float | tuple[tuple[float, float], ...]:
    return float(value) if np.isscalar(value) else tuple((t, v) for t, v in value)  # type: ignore[union-attr,arg-type]
