"""The shear-lag strip: 100 x 2 cells, pulled, released, pushed and pulled again.

Shear-lag strip: a bar pulled along a frictional bed slips from its end inwards; slip remains after unloading.

A bar of stiffness E A lies on a bed that carries a shear force of at most q per length. Its end is pulled with F, less
than q times its length. The bar force falls by q per length where it slips, so it slips over F / q, and the end moves
by F² / (2 E A q). When the force falls again by dF the shear changes by 2 q where it slips back: the same law at twice
the scale (Masing). Forces and works are per metre of thickness in plane models.

Source: equilibrium, derived here. FE was computed for this project by an independent program.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.integrate import trapezoid

from stickslip import Block, Contact, Coulomb, Load, Material, Plane, Scene, Solver, Steps, Support, Tresca
from stickslip.geometry.arrays import Array
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw
from stickslip.solvers.laws.normal import Bilateral, Unilateral
from stickslip.solvers.results.step_result import SLIP, ContactState, StepResult
from stickslip.workflows.lab.verification.check import CYCLES, FLOATING, Check, accounted, problem, repeats, within
from stickslip.workflows.lab.verification.prepared import prepare

LENGTH, HEIGHT = 1.0, 0.02  # [m]
E = 1000.0  # [Pa]; nu = 0
PRESSURE = 1.0  # on top [Pa]
BOUND = 0.5  # of the shear traction [Pa]
FORCE = 0.3  # of the end, out, in, out again [N/m]


@dataclass(frozen=True, kw_only=True)
class Strip:
    """A bar on a bed that resists by friction alone."""

    EA: float  # [N]
    q: float  # bound of the shear force per length [N/m]


STRIP = Strip(EA=E * HEIGHT, q=BOUND)


@dataclass(frozen=True, kw_only=True)
class Pull:
    """Result of a monotone change of the end's force."""

    displacement: float  # of the end, in the direction of the change [m]
    slip_length: float  # [m]
    dissipation: float  # [J]


# by another finite element program on 100 x 2 cells of this strip in plane strain: displacement of the end at FORCE and
# back at 0 [m], dissipation from FORCE to -FORCE and back [J]; at FORCE with mu = BOUND / PRESSURE, no fixed bound [m]
FE = {"pulled": 4.5029e-3, "unloaded": 2.2471e-3, "loop": 1.7965e-3, "Coulomb": 4.428e-3}


def pulled(strip: Strip, F: float) -> Pull:
    """From an untouched strip; slip at x from the end is q (l - x)² / (2 E A) with l = F / q, and q times it is lost.

    >>> state = pulled(STRIP, 0.3)
    >>> round(state.displacement, 12), round(state.slip_length, 12), round(state.dissipation, 12)
    (0.0045, 0.6, 0.00045)
    """
    EA, q = strip.EA, strip.q
    return Pull(displacement=F**2 / (2 * EA * q), slip_length=F / q, dissipation=F**3 / (6 * EA * q))


def let_go(strip: Strip, dF: float) -> Pull:
    """Changes when the force then falls by dF, at most twice what it was.

    >>> round(let_go(STRIP, 0.3).slip_length, 12)
    0.3
    """
    half = pulled(strip, dF / 2)
    return Pull(displacement=2 * half.displacement, slip_length=half.slip_length, dissipation=2 * half.dissipation)


def with_coulomb(strip: Strip, F: float, mu: float, height: float) -> Pull:
    """Pulled at mid-height, friction at the base: each length of the bar is turned by the couple q height / 2.

    It is constant where the bar slips, so it is carried by a force q height / 2 on the bed at the pulled end, and one
    upwards where slip ends. There mu times as much friction takes that part of F at once; where it pushes (F < 0) the
    force is upwards at the end, and F is the larger.
    """
    return pulled(strip, abs(F - mu * strip.q * height / 2))


N = 100  # cells along the strip
COARSE = 25  # for slow methods: a thin strip on its bed is a hard case for all but Newton's method
PULLS = (FORCE, 0.0, -FORCE, FORCE)
HELD = Bilateral()
TRESCA = Tresca(bound=((0.0, BOUND),))  # a bare number would be ramped over the history
COULOMB = Coulomb(mu=BOUND / PRESSURE)


def scene(
    method: str, pulls: tuple[float, ...] = PULLS, normal: NormalLaw = HELD, friction: FrictionLaw = TRESCA, n: int = N
) -> Scene:
    """The strip on y = 0, its left end pulled outward by pulls[k] [N/m] at t = k + 1."""
    times = [float(k + 1) for k in range(len(pulls))]
    pulling = tuple((t, -F / HEIGHT) for t, F in zip(times, pulls, strict=True))
    return Scene(
        model="plane strain",
        geometry=Block(length=LENGTH, height=HEIGHT, mesh_size=LENGTH / n),
        bodies={"block": Material(E=E, nu=0.0)},
        obstacles={"bed": Plane(point=(0.0, 0.0), normal=(0.0, 1.0))},
        contacts={"base": Contact(surface="block.bottom", against="bed", normal=normal, friction=friction)},
        supports={"wall": Support(boundary="block.right", displacement={"x": 0.0})},
        loads={
            "end": Load(boundary="block.left", traction=(pulling, 0.0)),
            "top": Load(boundary="block.top", pressure=((0.0, PRESSURE),)),
        },
        steps=Steps(end=times[-1], count=len(pulls)),
        # surface-uzawa: u of a slender body is a small difference of what its forces cause, right to 1e-10 or so
        solver=Solver(method=method, tolerance=1e-10 if method == "surface-uzawa" else 1e-11),
    )


@dataclass(frozen=True)
class Answer:
    """State of the strip after each pull."""

    steps: tuple[StepResult, ...]
    tips: Array  # (pulls,) outward displacement of the end, mean over its height [m]
    x: Array  # (n,) abscissae of the base's nodes [m]

    @property
    def bases(self) -> list[ContactState]:
        return [step.contacts["base"] for step in self.steps]

    @property
    def losses(self) -> Array:
        """Dissipation so far (pulls,) [J/m]."""
        return np.array([base.dissipation_total for base in self.bases])

    def slipping(self, k: int) -> float:
        """End of the slip of pull k [m]."""
        return float(self.x[self.bases[k].status == SLIP].max(initial=0.0))


@lru_cache
def solve(
    method: str, pulls: tuple[float, ...] = PULLS, normal: NormalLaw = HELD, friction: FrictionLaw = TRESCA, n: int = N
) -> Answer:
    """All pulls. Bodies are condensed: iterative solves of so slender a strip reach 1e-8, and no further."""
    simulation = prepare(scene(method, pulls, normal, friction, n))
    points = simulation.data.points
    end = np.flatnonzero(np.isclose(points[:, 0], 0.0, atol=1e-9))
    end = end[np.argsort(points[end, 1])]
    steps = tuple(step for step in simulation.steps() if step.time > 0)  # the pressure on top is there from the start
    tips = [-trapezoid(step.displacement[end, 0], points[end, 1]) / HEIGHT for step in steps]
    return Answer(steps, np.array(tips), simulation.data.surfaces["base"][0][:, 0])


def figures(method: str, friction: FrictionLaw = TRESCA) -> list[Check]:
    """Pulled, released, pushed and pulled again: against the bar, and against another finite element program."""
    answer = solve(method, friction=friction)
    out, unloaded, pushed, again = answer.tips
    loop = answer.losses[3] - answer.losses[0]
    there = pulled(STRIP, FORCE)
    back = let_go(STRIP, FORCE)
    # a strip is no bar, it shears over its height: 100, 200, 400 cells give 4.50310, 4.50328, 4.50331e-3 m and 1.79650,
    # 1.79613, 1.79602e-3 J. The mesh makes 5e-5 and 3e-4, the model .07, .14 and .22 %
    return [
        Check("pulled: displacement [m]", out, there.displacement, 1e-3, relative=True),
        Check("let go: displacement [m]", unloaded, there.displacement - back.displacement, 2e-3, relative=True),
        Check("pulled to pulled: dissipation [J]", loop, 2 * let_go(STRIP, 2 * FORCE).dissipation, 3e-3, relative=True),
        # slip ends one height before the bar's, less or more, as far as cells can tell
        within("pulled: slip ends at [m]", answer.slipping(0), there.slip_length - HEIGHT - 1 / N, there.slip_length),
        within("let go: slip ends at [m]", answer.slipping(1), back.slip_length - HEIGHT - 1 / N, back.slip_length),
        # same cells; how the displacement is averaged over the end, bottom to top .3 %, is not the same
        Check("pulled: displacement, other program [m]", out, FE["pulled"], 1e-4, relative=True),
        Check("let go: displacement, other program [m]", unloaded, FE["unloaded"], 1e-4, relative=True),
        Check("pulled to pulled: dissipation, other program [J]", loop, FE["loop"], 5e-5, relative=True),
        # the bound does not depend on the sense: as exact as the solver
        Check("pushed over pulled", pushed / out, -1.0, 1e-8, relative=True),
        Check("pulled again over pulled", again / out, 1.0, 1e-8, relative=True),
    ]


def cycled(method: str, friction: FrictionLaw = TRESCA, normal: NormalLaw = HELD, n: int = N) -> list[Check]:
    """Many reversals, with a stop halfway on each path: the same states in each cycle, and the bar's dissipation."""
    turn = (0.0, -FORCE, 0.0, FORCE)
    answer = solve(method, (FORCE, *turn * CYCLES), normal, friction, n)
    name = f"{n} cells, {type(friction).__name__}"
    found = repeats(name, answer.steps[1:], len(turn)) + accounted(name, answer.steps)
    if friction != TRESCA:
        return found
    loop = 2 * let_go(STRIP, 2 * FORCE).dissipation
    for k, loss in enumerate(np.diff(answer.losses[:: len(turn)]), start=1):
        # as in `figures`: a monotone path may be taken in any number of steps
        found.append(Check(f"{name}, cycle {k}: loop area [J]", loss, loop, 3e-3, relative=True))
        if n == N:
            at = f"{name}, cycle {k}: loop area, other program [J]"
            found.append(Check(at, loss, FE["loop"], 5e-5, relative=True))
    return found


def coulomb(method: str, normal: NormalLaw = Unilateral()) -> list[Check]:  # noqa: B008
    """Coulomb's bound follows the pressure, which the eccentric pull moves towards the end."""
    answer = solve(method, normal=normal, friction=COULOMB)
    out, _, pushed, _ = answer.tips
    exact = [with_coulomb(STRIP, F, COULOMB.coefficient_now, HEIGHT).displacement for F in (FORCE, -FORCE)]
    pressed = min(float(base.pressure.min()) for base in answer.bases)
    return [
        # as without Coulomb, a strip is no bar: 100, 200 cells give 4.42872, 4.42868e-3 m
        Check("Coulomb, pulled: displacement [m]", out, exact[0], 1e-3, relative=True),
        Check("Coulomb, pushed: displacement [m]", -pushed, exact[1], 1e-3, relative=True),
        # the other program's has 4 digits
        Check("Coulomb, pulled: displacement, other program [m]", out, FE["Coulomb"], 2e-4, relative=True),
        within("Coulomb: least pressure [Pa]", pressed, 0.1, 1.0),  # nothing lifts off
    ]


@problem("a strip slips from its end: partial slip, hysteresis", methods=FLOATING)
def checks(method: str) -> list[Check]:
    """All of them; nothing but the bed holds the strip up, which a method must be able to solve."""
    if method != "condensed-newton":
        return cycled(method, n=COARSE)
    return figures(method) + cycled(method) + cycled(method, COULOMB, Unilateral(), COARSE) + coulomb(method)
