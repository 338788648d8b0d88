"""Floating bodies settle: springs hold their rigid motions where they are, soften as they follow, and come to nothing.

Bodies that have room travel much farther than they deform, and residuals hardly see it: a link of a chain that lacks
1e-4 of its balance may turn by its own thickness. With springs to where they are bodies move as far as these give. Each
problem is solved to a slight residual, from there the springs, ten times as soft, hold the bodies where they have come
to. It is Euler's implicit method for the motion of bodies in a viscous fluid, with steps that grow; where one is too
long, because contact changes too much, it is made shorter, and the next ones grow less.

Source: Rockafellar, SIAM J. Control Optim. 14 (1976), of proximal points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from stickslip.geometry.arrays import LAST_DIGITS, SLIGHT, Array
from stickslip.solvers.iteration import QUICK, Iterate, Stall
from stickslip.solvers.newton.active_set import ActiveSet
from stickslip.solvers.newton.attempts import ATTEMPT, FIRM, Attempts, Start


class OnSprings(Attempts):
    """Attempts at a problem with springs on the rigid motions: what these carry is out of balance, and does not count.

    Attributes:
        settled: the iterate at which contact is solved to a slight residual; None: there is none yet.
    """

    settled: Iterate | None = None

    def __init__(self, attempts: Attempts, level: float, rest: Array) -> None:
        """
        Args:
            attempts: at the problem without springs.
            level: stiffness of the springs, in series with ones as stiff as the bodies, relative to these [-].
            rest: displacement (c,) [m] at which they have no force.
        """
        super().__init__(replace(attempts.problem, touch=None), attempts.bodies, SLIGHT, attempts.max_it)
        self.attempts, self.level, self.rest = attempts, level, rest

    def judged(self, number: int, p: Array, w: Array, u: Array) -> Iterate:
        return Iterate(number, self.problem.natural_residual(p, w), p, w, u)

    def solved(self, laws: ActiveSet, p: Array, u: Array, weight: float) -> tuple[Array, Array]:
        return self.bodies.solve(laws.proximal(p, weight, self.problem.gamma, self.level), p, self.rest)

    def settling(self, start: Start, number: int) -> Iterator[Iterate]:
        """Iterates up to the one that is `settled`, or up to where they stall, as they are without springs.

        Args:
            start: where to begin.
            number: of the iteration there.
        """
        stalls = Stall(QUICK // 3, number)
        for x in self.iterates(start, FIRM[0], number):
            yield self.attempts.judged(x.number, x.p, x.w, x.u_c)
            if x.residual <= SLIGHT:
                self.settled = x
            if self.settled or stalls(x.number, x.residual):
                return


def settled(attempts: Attempts, start: Start, most: int = 2 * ATTEMPT) -> Iterator[Start]:
    """Where floating bodies are, and come to, each time that they hardly change on softer springs, and at last.

    Args:
        attempts: those so far.
        start: where the bodies are.
        most: iterations, about.
    """
    if not attempts.problem.surface.floating:
        return
    yield start
    assert attempts.best is not None
    level, begun = 10 * FIRM[0] * min(1.0, attempts.best.residual), attempts.last
    last, factor = begun, 100.0
    while last < begun + most and LAST_DIGITS < level < 1:
        held = OnSprings(attempts, level, start.u_c)
        attempts.follows = False  # where points touch is told by bodies in balance
        attempts.run(held.settling(start, last))
        attempts.follows, number = True, attempts.last
        if attempts.over:
            return
        took, last = number - last, number
        if held.settled is None:
            level, factor = level * 10, 3.0
            continue
        start = replace(Start.at(attempts.problem, held.settled.p, held.settled.u_c), in_equilibrium=False)
        level /= min(factor, 10.0) if took > 2 else factor
        factor = min(factor * 3, 100.0)
        if took == 1:
            yield start
            last = attempts.last
    yield start
