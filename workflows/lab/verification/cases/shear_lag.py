"""The shear-lag strip: 100 x 2 cells, pulled, released, pushed and pulled again."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.integrate import trapezoid

from stickslip.geometry.arrays import Array
from stickslip.geometry.builders.cuboid import Block
from stickslip.geometry.obstacles.plane import Plane
from stickslip.solvers.laws.friction import Coulomb, Tresca
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw
from stickslip.solvers.laws.normal import Bilateral, Unilateral
from stickslip.solvers.method_registry import Solver
from stickslip.solvers.results.step_result import SLIP, ContactState, StepResult
from stickslip.solvers.scene.contact import Contact
from stickslip.solvers.scene.loads import Load, Support
from stickslip.solvers.scene.material import Material
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Steps
from stickslip.workflows.lab.verification.check import Check, within
from stickslip.workflows.lab.verification.closed_forms import shear_lag
from stickslip.workflows.lab.verification.closed_forms.shear_lag import FORCE, HEIGHT, STRIP
from stickslip.workflows.lab.verification.cycles import CYCLES, accounted, repeats
from stickslip.workflows.lab.verification.prepared import prepare

N = 100  # cells along the strip
COARSE = 25  # for slow methods: a thin strip on its bed is a hard case for all but Newton's method
PULLS = (FORCE, 0.0, -FORCE, FORCE)
HELD = Bilateral()
TRESCA = Tresca(bound=((0.0, shear_lag.BOUND),))  # a bare number would be ramped over the history
COULOMB = Coulomb(mu=shear_lag.BOUND / shear_lag.PRESSURE)


def scene(
    method: str,
    pulls: tuple[float, ...] = PULLS,
    normal: NormalLaw = HELD,
    friction: FrictionLaw = TRESCA,
    n: int = N,
) -> Scene:
    """The strip on y = 0, its left end pulled outward by pulls[k] [N/m] at t = k + 1."""
    times = [float(k + 1) for k in range(len(pulls))]
    pulling = tuple((t, -F / HEIGHT) for t, F in zip(times, pulls, strict=True))
    return Scene(
        title="Strip pulled along a frictional bed",
        model="plane strain",
        geometry=Block(length=shear_lag.LENGTH, height=HEIGHT, mesh_size=shear_lag.LENGTH / n),
        bodies={"block": Material(E=shear_lag.E, nu=0.0)},
        obstacles={"bed": Plane(point=(0.0, 0.0), normal=(0.0, 1.0))},
        contacts={"base": Contact(surface="block.bottom", against="bed", normal=normal, friction=friction)},
        supports={"wall": Support(boundary="block.right", displacement={"x": 0.0})},
        loads={
            "end": Load(boundary="block.left", traction=(pulling, 0.0)),
            "top": Load(boundary="block.top", pressure=((0.0, shear_lag.PRESSURE),)),
        },
        steps=Steps(end=times[-1], count=len(pulls)),
        # surface-uzawa: u of a slender body is a small difference of what its forces cause, right to 1e-10 or so
        solver=Solver(method=method, tolerance=1e-10 if method == "surface-uzawa" else 1e-12),
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
        """Where slip of pull k ends [m]."""
        return float(self.x[self.bases[k].status == SLIP].max(initial=0.0))


@lru_cache
def solve(
    method: str,
    pulls: tuple[float, ...] = PULLS,
    normal: NormalLaw = HELD,
    friction: FrictionLaw = TRESCA,
    n: int = N,
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
    there = shear_lag.pulled(STRIP, FORCE)
    back = shear_lag.let_go(STRIP, FORCE)
    # a strip is no bar, it shears over its height: 100, 200, 400 cells give 4.50310, 4.50328, 4.50331e-3 m and 1.79650,
    # 1.79613, 1.79602e-3 J. The mesh makes 5e-5 and 3e-4, the model .07, .14 and .22 %
    return [
        Check("pulled: displacement [m]", out, there.displacement, 1e-3, relative=True),
        Check("let go: displacement [m]", unloaded, there.displacement - back.displacement, 2e-3, relative=True),
        Check(
            "pulled to pulled: dissipation [J]",
            loop,
            2 * shear_lag.let_go(STRIP, 2 * FORCE).dissipation,
            3e-3,
            relative=True,
        ),
        # slip ends one height before the bar's, less or more, as far as cells can tell
        within("pulled: slip ends at [m]", answer.slipping(0), there.slip_length - HEIGHT - 1 / N, there.slip_length),
        within("let go: slip ends at [m]", answer.slipping(1), back.slip_length - HEIGHT - 1 / N, back.slip_length),
        # same cells; how the displacement is averaged over the end, bottom to top .3 %, is not the same
        Check("pulled: displacement, other program [m]", out, shear_lag.FE.pulled, 1e-4, relative=True),
        Check("let go: displacement, other program [m]", unloaded, shear_lag.FE.unloaded, 1e-4, relative=True),
        Check("pulled to pulled: dissipation, other program [J]", loop, shear_lag.FE.loop, 5e-5, relative=True),
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
    loop = 2 * shear_lag.let_go(STRIP, 2 * FORCE).dissipation
    for k, loss in enumerate(np.diff(answer.losses[:: len(turn)]), start=1):
        # as in `figures`: a monotone path may be taken in any number of steps
        found.append(Check(f"{name}, cycle {k}: loop area [J]", loss, loop, 3e-3, relative=True))
        if n == N:
            at = f"{name}, cycle {k}: loop area, other program [J]"
            found.append(Check(at, loss, shear_lag.FE.loop, 5e-5, relative=True))
    return found


def coulomb(method: str, normal: NormalLaw = Unilateral()) -> list[Check]:  # noqa: B008
    """Coulomb's bound follows the pressure, which the eccentric pull moves towards the end."""
    answer = solve(method, normal=normal, friction=COULOMB)
    out, _, pushed, _ = answer.tips
    exact = [shear_lag.with_coulomb(STRIP, F, COULOMB.mu, HEIGHT).displacement for F in (FORCE, -FORCE)]
    pressed = min(float(base.pressure.min()) for base in answer.bases)
    return [
        # as without Coulomb, a strip is no bar: 100, 200 cells give 4.42872, 4.42868e-3 m
        Check("Coulomb, pulled: displacement [m]", out, exact[0], 1e-3, relative=True),
        Check("Coulomb, pushed: displacement [m]", -pushed, exact[1], 1e-3, relative=True),
        # the other program's has 4 digits
        Check(
            "Coulomb, pulled: displacement, other program [m]", out, shear_lag.FE.pulled_coulomb, 2e-4, relative=True
        ),
        within("Coulomb: least pressure [Pa]", pressed, 0.1, 1.0),  # nothing lifts off
    ]


def checks(method: str) -> list[Check]:
    """All of them; nothing but the bed holds the strip up, which a method must be able to solve."""
    if method != "condensed-newton":
        return cycled(method, n=COARSE)
    return figures(method) + cycled(method) + cycled(method, COULOMB, Unilateral(), COARSE) + coulomb(method)
