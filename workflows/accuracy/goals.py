"""Goals of accuracy after a round: the number of each, and the parts of its error relative to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import ROUNDING, SLIGHT
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results import step_result
from stickslip.solvers.scene.record import Value

WORDS = {"mesh": "the mesh", "time_step": "the time steps", "law": "the contact law", "iteration": "the iteration"}


@dataclass(frozen=True)
class Standing:
    """One goal after a round; errors are relative to the number, a part that is not known is as large as that."""

    name: str
    asked: float
    value: float
    mesh: float  # geometry included
    time_step: float
    rest: float  # iteration, linear solver
    law: float = 0.0
    grows: bool = False  # as the mesh is refined; on a coarse one that shows little
    lacks: str = ""  # parts that were left out for their price
    price: float = 0.0  # of these, times the run

    @property
    def reached(self) -> float:
        """The whole error."""
        return self.mesh + self.time_step + self.rest + self.law

    @property
    def met(self) -> bool:
        return self.reached <= self.asked and self.known

    @property
    def known(self) -> bool:
        """Whether all parts are."""
        return not (self.grows or self.lacks)

    def __str__(self) -> str:
        off = "grows so far" if self.grows else f"± {percent(self.reached)}" if self.known else "± not known"
        return f"{self.name} {self.value:.5g} {off} (asked {percent(self.asked)})"


def percent(share: float) -> str:
    """A relative error in words.

    >>> percent(0.0123), percent(0.00012), percent(1.2e-7)
    ('1.2 %', '0.012 %', '1.2e-05 %')
    """
    return f"{100 * share:.2g} %"


def standings(
    goals: Mapping[str, float], step: step_result.StepResult, errors: step_result.Errors, coarse: bool = False
) -> list[Standing]:
    """All goals at a step.

    Args:
        coarse: whether the mesh may be too coarse to tell that a number grows without end.

    Raises:
        SceneError: the error of one is not known, or it has none, or it is 0 or next to nothing.
    """
    known = step_result.quantities(step)
    flat = {name: (key, axis) for key, value in known.items() for name, axis in step_result.names_of(key, value)}
    numbers = step_result.values(step)
    found = []
    for name, asked in goals.items():
        if name not in flat:
            raise SceneError(f"accuracy.goals.{name}: its error is not estimated; name another number")
        key, axis = flat[name]
        parts, value = errors[key], numbers[name]
        grows = parts.converges is False
        if grows and not coarse:
            raise SceneError(
                f"accuracy.goals.{name}: grows without end as the mesh is refined, at a corner or the end of a punch; "
                "name another number"
            )
        unknown = [part for part in WORDS if getattr(parts, part) is None and not (grows and part == "mesh")]
        missing = ", ".join(WORDS[part] for part in unknown)
        if not set(unknown) <= (parts.dear or {}).keys():
            raise SceneError(f"accuracy.goals.{name}: its error by {missing} is not known for this scene")
        least = _least(key, known)
        if abs(value) <= least:
            near = f" ({value:.2g}; up to {least:.2g} counts as that)" if value else ""
            raise SceneError(f"accuracy.goals.{name}: is 0 at the end{near}, so a relative error says nothing of it")
        share = {part: _at(getattr(parts, part), axis) / abs(value) for part in step_result.PARTS}
        share |= dict.fromkeys((*unknown, *["mesh"] * grows), 1.0)
        found.append(
            Standing(
                name=name,
                asked=asked,
                value=value,
                mesh=share["mesh"] + share["geometry"],
                time_step=share["time_step"],
                rest=share["iteration"] + share["linear_solver"],
                law=share["law"],
                grows=grows,
                lacks=missing,
                price=sum((parts.dear or {}).get(part, 0.0) for part in unknown),
            )
        )
    return found


def _least(key: step_result.Quantity, known: Mapping[step_result.Quantity, Value]) -> float:
    """Return the size up to which a number is what rounding, or a mesh without symmetry, leaves of 0.

    What can cancel out is compared with its vector, friction with the force of its contact. Areas, pressures, works and
    the like are small only where little happens: beside rounding.
    """
    unit = step_result.number_of(key).unit
    largest = max(
        float(np.abs(value).max()) for other, value in known.items() if step_result.number_of(other).unit == unit
    )
    whole = known[key._replace(quantity="force")] if key.quantity == "tangential_force" else known[key]
    cancels = np.ndim(whole) == 1
    # of its vector: a smaller component is not what a relative error is asked of, it may as well be 0
    # of the largest number of its kind: a smaller one is 0
    return max(ROUNDING * largest, SLIGHT * float(np.linalg.norm(whole)) if cancels else 0.0)


def _at(part: Value | None, axis: int | None) -> float:
    found = np.asarray(0.0 if part is None else part, float)
    return float(found if axis is None else found[axis])
