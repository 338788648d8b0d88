"""The ready scene `block`, in two steps and in one: pressed and shifted together from u = 0.

Both methods must agree, and on a partly sticking state: a Newton iteration that cycles ends in full slip.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Literal

import numpy as np

from solvers.effects.friction import Coulomb
from solvers.nouns.scene import Scene
from solvers.nouns.stepping import Solver, Steps
from solvers.nouns.support import Support
from solvers.simulation import prepare
from solvers.step_result import StepResult
from workflows.scene import read
from workflows.verification.check import Check, within

History = Literal["two steps", "one step"]
HISTORIES: tuple[History, ...] = ("two steps", "one step")
REFERENCE = "condensed-newton"  # what the other methods are compared with
MU = 0.3
LENGTH = 4.0  # of the base [m]
AGREEMENT = 1e-6  # tolerance 1e-11 times the condition of Coulomb friction on this mesh, and digits to spare


def scene(method: str, history: History, mu: float = MU) -> Scene:
    """The ready scene; in one step, its final displacement of the top is reached in proportion."""
    ready = read("block")
    base = replace(ready.contacts["base"], friction=Coulomb(mu=mu))
    changed = replace(ready, contacts={"base": base}, solver=Solver(method=method, tolerance=1e-11))
    if history == "two steps":
        return changed
    tables = ready.supports["top"].displacement
    final = {axis: table[-1][1] for axis, table in tables.items() if isinstance(table, tuple)}
    top = Support(boundary="block.top", displacement=final)
    return replace(changed, supports={"top": top}, steps=Steps(end=1.0, count=1))


@lru_cache
def solve(method: str, history: History, mu: float = MU) -> StepResult:
    """The last step."""
    *_, last = prepare(scene(method, history, mu)).steps()
    return last


def stuck(method: str, history: History, mu: float = MU) -> list[Check]:
    """Part of the base sticks, and friction is within its bound."""
    base = solve(method, history, mu).contacts["base"]
    # partial slip: neither full slip, where a cycling Newton iteration ends, nor full stick
    found = [within(f"{history}: stick area [m]", base.stick_area, 0.5, LENGTH)]
    found.append(within(f"{history}: friction over mu F_n", base.tangential_force / (MU * base.normal_force), 0.1, 1.0))
    return found


def agree(history: History, method: str, other: str = REFERENCE) -> list[Check]:
    """Two methods that share nothing but the surface problem: forces and displacements."""
    a, b = solve(method, history), solve(other, history)
    apart = np.abs(a.displacement - b.displacement).max() / np.abs(b.displacement).max()
    name, mine, theirs = f"{history}, against {other}", a.contacts["base"], b.contacts["base"]
    return [
        Check(f"{name}: displacement, relative", float(apart), 0.0, AGREEMENT, relative=False),
        Check(f"{name}: normal force [N]", mine.normal_force, theirs.normal_force, AGREEMENT, relative=True),
        Check(f"{name}: friction [N]", mine.tangential_force, theirs.tangential_force, AGREEMENT, relative=True),
        Check(f"{name}: dissipation [J]", mine.dissipation_total, theirs.dissipation_total, AGREEMENT, relative=True),
    ]


def checks(method: str, mu: float = MU) -> list[Check]:
    """All of them; with mu = 0 nothing sticks."""
    found = [check for history in HISTORIES for check in stuck(method, history, mu)]
    if method != REFERENCE:
        found += [check for history in HISTORIES for check in agree(history, method)]
    return found
