"""Two plates that a bolt clamps, drawn apart through a rigid remote point beyond the point where the joint opens.

A bolt that clamps two plates: bolt and plates as springs, in series while tightened, then side by side.
"""

from dataclasses import dataclass

from stickslip import Contact, Material, Scene, Steps, Support, TwoBlocks
from stickslip.solvers.effects.bolts import Bolt
from stickslip.solvers.effects.remote_points import RemotePoint
from stickslip.workflows.lab.verification.check import Check, close, problem
from stickslip.workflows.lab.verification.prepared import prepare, solver

E, HEIGHT = 1000.0, 1.0  # of each plate [Pa], [m]; lateral strain zero
BOLT, FORCE = 400.0, 3.0  # stiffness of the bolt [N/m], what it is tightened to [N]


@dataclass(frozen=True, kw_only=True)
class JointState:
    """The joint diagram."""

    tension: float  # of the bolt [N]
    clamped: float  # force between the plates [N]
    shortening: float  # of the bolt, by which it was tightened [m]


def state(tightened: float, load: float, area: float) -> JointState:
    """State of a joint tightened to a share of the force, that a load [N] then draws apart; area: of the plates [m²].

    With c = E A / (2 h) of both plates, a load adds k / (k + c) of itself to the bolt, until the joint opens.

    >>> state(1.0, 0.0, 2.0).clamped, state(1.0, 1e3, 2.0).tension
    (3.0, 1000.0)
    """
    plates = E * area / (2 * HEIGHT)
    preload = tightened * FORCE
    tension = max(preload + load * BOLT / (BOLT + plates), load)
    return JointState(tension=tension, clamped=tension - load, shortening=preload * (1 / BOLT + 1 / plates))


TOLERANCE = 1e-7  # the tolerance of an iterative method, 1e-11, times what bolt and plates differ in stiffness
LENGTH, WIDTH = 2.0, 0.5  # of the plates [m]
LOAD = 6.0  # at the end [N]


def scene(dim: int, method: str) -> Scene:
    """Tightened until 1 s, then drawn; the rigid lid does not turn."""
    up, turns = "xyz"[dim - 1], "xyz" if dim == 3 else "z"
    across = (0.0,) * (dim - 1)
    lid = RemotePoint(
        boundary="upper.top",
        point=(0.3, *across),
        coupling="rigid",
        force={up: ((1.0, 0.0), (2.0, LOAD))},  # type: ignore[dict-item]
        displacement=dict.fromkeys("xyz"[: dim - 1], 0.0),  # type: ignore[arg-type]
        rotation=dict.fromkeys(turns, 0.0),  # type: ignore[arg-type]
    )
    bolt = Bolt(
        head="upper.top", nut="lower.bottom", axis=(*across, 1.0), stiffness=BOLT, force=((1.0, FORCE),), held_from=1.0
    )
    foot = Support(boundary="lower.bottom", displacement=dict.fromkeys("xyz"[:dim], 0.0))  # type: ignore[arg-type]
    return Scene(
        model="3d" if dim == 3 else "plane strain",
        geometry=TwoBlocks(length=LENGTH, width=WIDTH if dim == 3 else None, height=HEIGHT, mesh_size=0.5),
        bodies={"upper": Material(E=E, nu=0.0), "lower": Material(E=E, nu=0.0)},
        contacts={"joint": Contact(surface="upper.bottom", against="lower.top")},
        supports={"foot": foot},
        steps=Steps(end=2.0, count=7),
        solver=solver(method, 1e-11),
        sections={"bolts": {"bolt": bolt}, "remote_points": {"lid": lid}},
    )


@problem("a bolt tightened, held, its joint drawn apart", slow=("surface-uzawa",))
def checks(method: str) -> list[Check]:
    """Tension, clamping force, shortening and the lid's motion, in 2D and 3D."""
    found = list[Check]()
    for dim in (2, 3):
        area = LENGTH * (WIDTH if dim == 3 else 1.0)
        for step in prepare(scene(dim, method)).steps():
            at = f"{dim}D, t = {step.time:g}"
            exact = state(min(step.time, 1.0), LOAD * max(step.time - 1.0, 0.0), area)
            moved = exact.tension / BOLT - exact.shortening
            tension, shortening = step.bolts["bolt"]
            clamped, lid = step.contacts["joint"].normal_force, step.remote_points["lid"].displacement[-1]
            found += [
                close(f"{at}: tension [N]", tension, exact.tension, TOLERANCE, FORCE),
                close(f"{at}: clamping force [N]", clamped, exact.clamped, TOLERANCE, FORCE),
                close(f"{at}: shortening [m]", shortening, exact.shortening, TOLERANCE, FORCE / BOLT),
                close(f"{at}: motion of the lid [m]", float(lid), moved, TOLERANCE, FORCE / BOLT),
                close(
                    f"{at}: external work [J]",
                    step.energy.external,
                    step.energy.stored + step.energy.contact,
                    TOLERANCE,
                    FORCE**2 / BOLT,
                ),
            ]
    return found
