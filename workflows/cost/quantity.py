"""Which numbers of the last step are studied: those asked for, else the usual ones of every contact."""

from __future__ import annotations

from collections.abc import Sequence

from stickslip.geometry.arrays import ROUNDING
from stickslip.geometry.errors import SceneError, nearest
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.cost.run_record import Run

USUAL = ("max_pressure", "normal_force", "tangential_force")


def check(asked: Sequence[str], scene: Scene) -> None:
    """Refuse names that no quantity of the scene has.

    Raises:
        SceneError: with the nearest name.
    """
    known = scene.quantities()
    for name in asked:
        if name not in known:
            raise SceneError(f"--quantity {name}: no such quantity; {nearest(name, known)}")
    if not asked and not scene.contacts:
        raise SceneError("contacts: there is none; name what to look at by --quantity, for example energy.stored")


def chosen(asked: Sequence[str], scene: Scene, runs: Sequence[Run]) -> tuple[str, ...]:
    """Names to study: first those with an exact value in the scene; of the usual ones those that are not zero."""
    if asked:
        return tuple(dict.fromkeys(asked))
    usual = [f"{contact}.{key}" for contact in scene.contacts for key in USUAL]
    largest = {key: max((_size(f"{c}.{key}", runs) for c in scene.contacts), default=0.0) for key in USUAL}
    pushed = largest["normal_force"]
    # relative to the largest of its kind: smaller numbers count as zero
    least = {"max_pressure": 0.0, "normal_force": ROUNDING * pushed, "tangential_force": ROUNDING * pushed}
    alive = [name for name in usual if _size(name, runs) > least[name.rpartition(".")[2]]]
    return tuple(dict.fromkeys([*scene.exact.values, *alive]))


def _size(name: str, runs: Sequence[Run]) -> float:
    return max((abs(run.quantities[name]) for run in runs if run.converged), default=0.0)
