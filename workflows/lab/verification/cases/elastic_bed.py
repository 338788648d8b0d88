"""A column that nothing but springs and contact holds: its state is uniform, so that any mesh is exact.

A column without lateral strain on springs, pressed by a plate that comes down, and sheared at its top and sides.
"""

from dataclasses import dataclass

from stickslip import Block, Contact, Load, Material, Plane, Scene, Steps
from stickslip.solvers.effects.springs import ElasticSupport
from stickslip.workflows.lab.verification.check import Check, close, farthest, problem
from stickslip.workflows.lab.verification.prepared import prepare, solver

E, HEIGHT, GAP = 1000.0, 1.0, 1e-3  # [Pa], [m], [m] between plate and top
NORMAL, TANGENTIAL = 500.0, 300.0  # of the springs [Pa/m]
DOWN, SHEAR = 6e-3, 0.5  # of the plate [m], of the tractions [Pa]


@dataclass(frozen=True, kw_only=True)
class BedState:
    """Column and springs in series; the shear modulus is E / 2, nu being zero."""

    p: float  # pressure of the plate [Pa]
    settlement: float  # of the base [m]
    along: float  # displacement of the top by shear [m]
    stored: float  # energy of column and springs per area [J/m²]


def state(down: float, shear: float) -> BedState:
    """State under a plate that comes down by `down` [m], and under a uniform shear stress [Pa].

    >>> state(GAP + 0.003, 0.0).p  # 3 mm go into 1 / 500 + 1 / 1000
    1.0
    """
    p = max(0.0, down - GAP) / (1 / NORMAL + HEIGHT / E)
    along = shear * (1 / TANGENTIAL + HEIGHT / (E / 2))
    return BedState(p=p, settlement=p / NORMAL, along=along, stored=(p * max(0.0, down - GAP) + shear * along) / 2)


TOLERANCE = 1e-8  # the tolerance of an iterative method, 1e-11, times what springs and column differ in stiffness


def scene(dim: int, method: str) -> Scene:
    """Side 1 m; the plate is smooth."""
    up = "xyz"[dim - 1]
    across = (0.0,) * (dim - 1)
    tractions = {"top": (SHEAR, *across), "right": (*across, SHEAR), "left": (*across, -SHEAR)}
    return Scene(
        model="3d" if dim == 3 else "plane strain",
        geometry=Block(length=1.0, width=1.0 if dim == 3 else None, height=HEIGHT, mesh_size=0.5),
        bodies={"block": Material(E=E, nu=0.0)},
        obstacles={
            "plate": Plane(
                point=(*across, HEIGHT + GAP),
                normal=(*across, -1.0),
                displacement={up: -DOWN},  # type: ignore[dict-item]
            )
        },
        contacts={"top": Contact(surface="block.top", against="plate")},
        loads={side: Load(boundary=f"block.{side}", traction=traction) for side, traction in tractions.items()},
        steps=Steps(count=3),
        solver=solver(method, 1e-11),
        sections={
            "elastic_support": {"bed": ElasticSupport(boundary="block.bottom", normal=NORMAL, tangential=TANGENTIAL)}
        },
    )


@problem("a column that only springs hold, pressed and sheared")
def checks(method: str) -> list[Check]:
    """Pressure, displacement of base and top, and both energies, in 2D and 3D."""
    found = list[Check]()
    for dim in (2, 3):
        simulation = prepare(scene(dim, method))
        height = simulation.data.points[:, dim - 1]
        for step in simulation.steps():
            exact, at = state(DOWN * step.time, SHEAR * step.time), f"{dim}D, t = {step.time:g}"
            pressure, moved = step.contacts["top"].pressure, step.displacement
            settled, along = -moved[height < 1e-9, dim - 1], moved[height > HEIGHT - 1e-9, 0]
            work = exact.stored
            found += [
                close(f"{at}: p [Pa]", farthest(pressure, exact.p), exact.p, TOLERANCE, 1.0),
                close(f"{at}: settlement [m]", farthest(settled, exact.settlement), exact.settlement, TOLERANCE, GAP),
                close(f"{at}: shear of the top [m]", farthest(along, exact.along), exact.along, TOLERANCE, GAP),
                close(f"{at}: stored energy [J]", step.energy.stored, work, TOLERANCE, work),
                close(f"{at}: external work [J]", step.energy.external, work + step.energy.contact, TOLERANCE, work),
            ]
    return found
