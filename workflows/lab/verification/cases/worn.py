"""A column that slides out of the plane and wears, by its implicit rule; a roller that does, by boundary elements.

The top of a confined column is held once it is pressed by U: p = M (U - w) / H, and w grows by k p Δs with the pressure
at the end of a step, so that n steps leave p = p_0 / (1 + k M s / (n H))^n.

Source: Archard, J. Appl. Phys. 24 (1953); of the roller 161 boundary elements in 4000 steps, made for this project.
"""

from __future__ import annotations

from stickslip import Block, Contact, HalfDisc, Load, Material, Plane, Scene, StepResult, Steps, Support, Wear
from stickslip.workflows.lab.verification.cases.column import constrained_modulus
from stickslip.workflows.lab.verification.check import FLOATING, ONE, Check, problem
from stickslip.workflows.lab.verification.prepared import prepare, solver

E, NU, U, K = 1000.0, 0.3, 0.01, 1e-4
FLOOR = Plane(point=(0.0, 0.0), normal=(0.0, 1.0))


def _last(scene: Scene) -> StepResult:
    *_, last = prepare(scene).steps()
    return last


def _sides(body: str, surface: str, s: float, k: float) -> Contact:
    slide = ((0.0, 0.0), (1.0, 0.0), (2.0, s))
    return Contact(surface=f"{body}.{surface}", against="floor", slide=slide, wear=Wear(k=k))


@problem("columns that slide and wear, against their implicit rule", FLOATING)
def worn_column(method: str) -> list[Check]:
    found, M, steps = list[Check](), constrained_modulus(E, NU), 10
    for s in (1.0, 5.0, 20.0):
        walls = {name: Support(boundary=f"block.{name}", displacement={"x": 0.0}) for name in ("left", "right")}
        top = Support(boundary="block.top", displacement={"y": ((0.0, 0.0), (1.0, -U))})
        scene = Scene(
            model="plane strain",
            geometry=Block(length=1.0, height=1.0, mesh_size=0.5),
            bodies={"block": Material(E=E, nu=NU)},
            obstacles={"floor": FLOOR},
            contacts={"base": _sides("block", "bottom", s, K)},
            supports=walls | {"top": top},
            steps=Steps(end=2.0, count=2 * steps),
            solver=solver(method, 1e-12),
        )
        base, p = _last(scene).contacts["base"], M * U / (1 + K * M * s / steps) ** steps
        found.append(Check(f"pressure after {s:g} m [Pa]", base.max_pressure, p, 1e-9, relative=True))
        found.append(Check(f"worn depth after {s:g} m [m]", base.max_wear or 0.0, U - p / M, 1e-9, relative=True))
    return found


@problem("a roller that slides on a plane and wears, against boundary elements", ONE)
def worn_roller(method: str) -> list[Check]:
    found = list[Check]()
    for steps, off in ((5, 0.049), (10, 0.022), (20, 0.0105)):
        scene = Scene(
            model="plane strain",
            geometry=HalfDisc(radius=8.0, mesh_size=2.0, contact_mesh_size=0.1, contact_radius=2.2),
            bodies={"disc": Material(E=200.0, nu=NU)},
            obstacles={"floor": FLOOR},
            contacts={"pole": _sides("disc", "arc", 2e4, 2e-6)},
            supports={"top": Support(boundary="disc.top", displacement={"x": 0.0})},
            loads={"press": Load(boundary="disc.top", pressure=((0.0, 0.0), (1.0, 0.625)))},
            steps=Steps(end=2.0, count=2 * steps),
            solver=solver(method, 1e-10),
        )
        pole = _last(scene).contacts["pole"]
        p = 2.9706 * (1 + off)
        found.append(Check(f"largest pressure in {steps} steps [Pa]", pole.max_pressure, p, 0.003, relative=True))
        found.append(Check(f"worn volume in {steps} steps [m²]", pole.worn_volume or 0.0, 0.4, 1e-9, relative=True))
    return found
