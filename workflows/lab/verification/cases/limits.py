"""Blocks that friction holds up to a known time: every step before it is solved, no step after it.

A block on the ground that friction and weight hold up to a known time: pushed, lifted, tipped, unloaded, shaken.

A rigid block of length L and height H presses on the ground with N and is pushed at mid-height with F: it rests while
F <= mu N and F H / 2 <= N L / 2. An elastic one, small displacements, rests as long: of its shape only L and H enter.
A force that grows by straight lines crosses its limit at one time, and from then on there is no equilibrium.

Source: statics.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from stickslip import Block, Contact, Coulomb, Load, Material, NoEquilibriumError, Plane, Scene, StepResult, Steps
from stickslip.workflows.lab.verification.check import FLOATING, Check, accounted, problem, within
from stickslip.workflows.lab.verification.prepared import prepare, solver

Table = tuple[tuple[float, float], ...]
END = 4.0  # [s]


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Forces on a block by time, and the time at which equilibrium ends."""

    length: float  # [m]
    height: float  # [m]
    mu: float
    press: Table  # N on top, negative: lifting [N]
    push: Table  # F on the left side [N]

    @property
    def time(self) -> float:
        """The first time at which what is left, mu N - |F|, N or (N L - |F| H) / 2, crosses zero [s].

        >>> round(Limit(length=2.0, height=1.0, mu=0.5, press=STEADY, push=((0.0, 0.0), (4.0, 1.0))).time, 12)
        2.0
        """
        times = sorted({t for t, _ in (*self.press, *self.push)} | {END})
        for before, after in pairwise(times):
            crossed = [
                before + (after - before) * a / (a - b)
                for a, b in zip(self._left(before), self._left(after), strict=True)
                if b < 0
            ]
            if crossed:
                return min(crossed)
        raise ValueError("these loads are held to the end")

    def pressed(self, time: float) -> float:
        """N [N]."""
        return _at(self.press, time)

    def pushed(self, time: float) -> float:
        """F [N]."""
        return _at(self.push, time)

    def _left(self, time: float) -> tuple[float, ...]:
        """Linear between the listed times; both senses of the push are told apart."""
        N, F = self.pressed(time), self.pushed(time)
        slide, tip = self.mu * N, N * self.length / self.height
        return slide - F, slide + F, N, tip - F, tip + F


def _at(table: Table, time: float) -> float:
    """Straight between the entries, constant beyond."""
    return float(np.interp(time, [t for t, _ in table], [force for _, force in table]))


STEADY: Table = ((0.0, 1.0),)
NONE: Table = ((0.0, 0.0),)
LIMITS: Mapping[str, Limit] = {
    "pushed": Limit(length=2.0, height=1.0, mu=0.5, press=STEADY, push=((0.0, 0.0), (END, 0.7))),
    "tipped": Limit(length=1.0, height=2.0, mu=2.0, press=STEADY, push=((0.0, 0.0), (END, 0.7))),
    "lifted": Limit(length=2.0, height=1.0, mu=0.5, press=((0.0, 1.0), (END, -0.3)), push=NONE),
    "pushed, then let go": Limit(
        length=2.0, height=1.0, mu=0.5, press=((0.0, 1.0), (1.0, 1.0), (END, 0.1)), push=((0.0, 0.0), (1.0, 0.3))
    ),
    "shaken": Limit(
        length=2.0, height=1.0, mu=0.5, press=STEADY,
        push=((0.0, 0.0), (0.5, 0.25), (1.5, -0.35), (2.5, 0.45), (END, -0.8)),
    ),
}  # fmt: skip


STEPS = 8
E, NU = 100.0, 0.3
NEAR = END / STEPS / 128  # a step is halved eight times: how close to the limit it comes [s], and a factor of 2
TOLERANCE = 1e-9  # of the forces, and the solver's 1e-11 of the pressure


def scene(method: str, limit: Limit) -> Scene:
    """A block that only the ground holds."""
    L, H = limit.length, limit.height
    return Scene(
        model="plane strain",
        geometry=Block(length=L, height=H, mesh_size=0.25, cells="tensor"),
        bodies={"block": Material(E=E, nu=NU)},
        obstacles={"ground": Plane(point=(0.0, 0.0), normal=(0.0, 1.0))},
        contacts={"base": Contact(surface="block.bottom", against="ground", friction=Coulomb(mu=limit.mu))},
        loads={
            "press": Load(boundary="block.top", traction=(0.0, tuple((t, -N / L) for t, N in limit.press))),
            "push": Load(boundary="block.left", traction=(tuple((t, F / H) for t, F in limit.push), 0.0)),
        },
        steps=Steps(end=END, count=STEPS),
        solver=solver(method, 1e-11),
    )


def reached(scene: Scene) -> tuple[list[StepResult], bool]:
    """The solved steps, and whether it is proved that the next one has no equilibrium."""
    steps: list[StepResult] = []
    try:
        for step in prepare(scene).steps():
            steps.append(step)
    except NoEquilibriumError:
        return steps, True
    return steps, False


def held(method: str, name: str, limit: Limit) -> list[Check]:
    """The last good substep lies just before the limit, and the ground carries the loads there."""
    steps, proved = reached(scene(method, limit))
    last, base = steps[-1], steps[-1].contacts["base"]
    bears = [-limit.pushed(last.time), limit.pressed(last.time)]
    times = [step.time for step in steps[:-1]]
    wanted = [t for t in np.linspace(0.0, END, STEPS + 1) if t < limit.time and t not in times]
    return [
        Check(f"{name}: ends as one without equilibrium (1: yes)", float(proved), 1.0, 0.0, relative=False),
        within(f"{name}: last time reached [s]", last.time, limit.time - NEAR, limit.time),
        Check(f"{name}: times before it that are missing", len(wanted), 0, 0, relative=False),
        Check(f"{name}: force off what is put on [N]", np.abs(base.force - bears).max(), 0.0, TOLERANCE, False),
        *accounted(name, steps),
    ]


@problem("blocks that friction holds up to a known time, statics", methods=FLOATING, slow=("surface-uzawa",))
def checks(method: str) -> list[Check]:
    """All of them, with a method that can solve bodies held by contact alone."""
    return [check for name, limit in LIMITS.items() for check in held(method, name, limit)]
