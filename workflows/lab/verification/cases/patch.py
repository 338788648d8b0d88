"""Patch test: two blocks with non-matching meshes transmit a uniform pressure, either side as slave, at any mesh ratio.

Each block is 1 m high. Driven, the top is pushed by .1 m at nu = 0: p = .1 / (1 / E_upper + 1 / E_lower), 1e5 Pa for
blocks alike, and the interface goes down by p / E_lower = .05 m. Loaded, p is what is applied, whatever nu is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np

from stickslip import Contact, Load, Material, Scene, Simulation, StepResult, Support, TwoBlocks
from stickslip.geometry.arrays import Array
from stickslip.solvers.method_registry import METHODS
from stickslip.workflows.lab.verification.check import TWO, Check, farthest, problem, within
from stickslip.workflows.lab.verification.prepared import solved, solver

E, NU, P, PUSH = 2e6, 0.3, 1e5, 0.1  # [Pa], -, [Pa], [m]
TOLERANCE = 1e-8  # order 2 too: a constant pressure is in every space, and its forces are integrated exactly
BALANCE = 1e-12  # of the larger sum of forces
RATIOS = {"1:1": (0.5, 0.5), "2:3": (0.5, 1 / 3), "1:20": (1.0, 0.05)}  # cells of the upper and lower block [m]
Operator = Literal["mortar", "node-to-segment", "node-to-face"]
CONTRAST = 1e6  # of the two stiffnesses


@dataclass(frozen=True, kw_only=True)
class Patch:
    """One pair of blocks."""

    dim: Literal[2, 3] = 2
    order: Literal[1, 2] = 1
    cells: Literal["simplex", "tensor"] = "simplex"
    ratio: str = "2:3"
    slave: Literal["upper", "lower"] = "upper"
    nodal: bool = False  # node-to-segment or node-to-face
    loaded: bool = False
    overlap: float = 0.0  # of the blocks as drawn, the top held where it is [m]
    contrast: float = 1.0  # E of the upper block over E of the lower one
    method: str = "condensed-newton"

    def __str__(self) -> str:
        kind = "loaded" if self.loaded else "driven"
        words = [f"{self.dim}D", f"order {self.order}", self.cells, self.ratio, f"slave {self.slave}", kind]
        words += [f"overlap {self.overlap:g} m"] * (self.overlap != 0)
        words += ["node by node"] * self.nodal + [f"contrast {self.contrast:g}"] * (self.contrast != 1)
        return ", ".join(words)

    @property
    def pressure(self) -> float:
        """The exact pressure [Pa]."""
        return P if self.loaded else (self.overlap or PUSH) / (1 / (E * self.contrast) + 1 / E)


def scene(patch: Patch) -> Scene:
    """Symmetric about its left, front and bottom sides, free on the others."""
    up: Literal["y", "z"] = "y" if patch.dim == 2 else "z"
    held: dict[Literal["x", "y", "z"], tuple[str, ...]] = {"x": ("upper.left", "lower.left"), up: ("lower.bottom",)}
    if patch.dim == 3:
        held["y"] = ("upper.front", "lower.front")
    supports = {
        side.replace(".", "_"): Support(boundary=side, displacement={axis: 0.0})
        for axis, sides in held.items()
        for side in sides
    }
    if not patch.loaded:
        supports["top"] = Support(boundary="upper.top", displacement={up: 0.0 if patch.overlap else -PUSH})
    nu = NU if patch.loaded else 0.0
    master = {"upper": "lower.top", "lower": "upper.bottom"}[patch.slave]
    slave = {"upper": "upper.bottom", "lower": "lower.top"}[patch.slave]
    operator: Operator = {2: "node-to-segment", 3: "node-to-face"}[patch.dim] if patch.nodal else "mortar"  # type: ignore[assignment]
    return Scene(
        model="plane strain" if patch.dim == 2 else "3d",
        geometry=_blocks(patch),
        bodies={"upper": Material(E=E * patch.contrast, nu=nu), "lower": Material(E=E, nu=nu)},
        contacts={
            "joint": Contact(
                surface=slave, against=master, operator=operator, search_distance=2 * patch.overlap or None
            )
        },
        supports=supports,
        loads={"top": Load(boundary="upper.top", pressure=P)} if patch.loaded else {},
        solver=solver(patch.method, 1e-12),
    )


def _blocks(patch: Patch) -> TwoBlocks:
    upper, lower = RATIOS[patch.ratio]
    if patch.dim == 2:
        return TwoBlocks(
            length=2.0,
            gap=-patch.overlap,
            height=1.0,
            mesh_size=upper,
            lower_mesh_size=lower,
            order=patch.order,
            cells=patch.cells,
        )
    # cells grow away from the interface, and are 1:5 along y at order 2: the same along both would take minutes
    return TwoBlocks(
        length=1.0,
        gap=-patch.overlap,
        width=0.25 if patch.order == 2 and patch.ratio == "1:20" else 1.0,
        height=1.0,
        mesh_size=5 * upper,
        contact_mesh_size=upper,
        lower_mesh_size=5 * lower,
        order=patch.order,
        cells=patch.cells,
    )


@dataclass(frozen=True)
class Joint:
    """State of the interface."""

    pressure: Array  # (n,) at the slave's nodes [Pa]
    axial: Array  # (cells,) normal stress along the last axis [Pa]
    down: Array  # displacement along it of the lower block's nodes at the interface [m]
    unbalance: float  # sum of the forces on both blocks over the sum on one


def solve(patch: Patch) -> Joint:
    """Its only step."""
    simulation, (step,) = solved(scene(patch))
    master = simulation.system.contacts[0].master
    assert master is not None
    lower = simulation.system.contacts[0].surface if patch.slave == "lower" else master
    last = patch.dim - 1
    return Joint(
        step.contacts["joint"].pressure, step.stress[:, last, last], step.displacement[lower.input, last],
        unbalance(simulation, step),
    )  # fmt: skip


def unbalance(simulation: Simulation, step: StepResult) -> float:
    """Defect of action = reaction of the nodal forces, over all contacts between bodies."""
    worst = 0.0
    for c, p_n, t in zip(simulation.system.contacts, *simulation.stepper.split(step.p), strict=True):
        slave, master = np.split(c.nodal_forces(p_n, t), [len(c.surface.nodes)])
        size = np.linalg.norm(slave.sum(axis=0))
        worst = max(worst, float(np.linalg.norm(slave.sum(axis=0) + master.sum(axis=0)) / size))
    return worst


def figures(patch: Patch) -> list[Check]:
    """Mortar: uniform to 1e-8. Node-to-facet operators: not uniform; the error is reported."""
    found, p = solve(patch), patch.pressure
    balance = Check(f"{patch}: forces on both blocks", found.unbalance, 0.0, BALANCE, relative=False)
    worst = farthest(found.pressure, p)
    off = nodal_error(patch)
    if off:
        return [balance, within(f"{patch}: p is off by", abs(worst / p - 1), *off)]
    checks = [
        balance,
        Check(f"{patch}: p [Pa]", worst, p, TOLERANCE, relative=True),
        Check(f"{patch}: axial stress [Pa]", farthest(found.axial, -p), -p, TOLERANCE, relative=True),
    ]
    if not patch.loaded:
        down = -p / E
        checks.append(Check(f"{patch}: interface [m]", farthest(found.down, down), down, TOLERANCE, relative=True))
    return checks


def nodal_error(patch: Patch) -> tuple[float, float] | None:
    """Allowed error of the worst pressure, as measured over orders and cells; 0 where it must be uniform.

    A slave node's force goes to the corners of the one facet that it meets, as if its share of the area lay there. That
    is right where the nodes of the coarser side are nodes of the finer slave; tetrahedra are no grid in space.
    """
    nested = patch.ratio == "1:1" or (patch.ratio, patch.slave) == ("1:20", "lower")
    grids = patch.dim == 2 or patch.cells == "tensor"
    if not patch.nodal or (nested and grids):
        return None
    if (patch.ratio, patch.slave) == ("1:20", "lower"):
        return 1e-4, 0.01  # many nodes on each facet: .0004 and .005
    if patch.ratio == "1:20":
        return (0.4, 0.7) if patch.dim == 2 else (0.7, 1.0)  # .47 to .61; .75 to .95
    return (0.05, 0.2) if patch.dim == 2 else (0.1, 0.45)  # .09 to .17; .13 to .41


PATCHES = [
    Patch(dim=dim, order=order, cells=cells, ratio=ratio, slave=slave)  # type: ignore[arg-type]
    for dim, order, cells, ratio, slave in product((2, 3), (1, 2), ("simplex", "tensor"), RATIOS, ("upper", "lower"))
]
LOADED = [replace(patch, loaded=True) for patch in PATCHES]
NODAL = [replace(patch, nodal=True) for patch in PATCHES]
CONTRASTS = [
    Patch(dim=dim, ratio="2:3", slave=slave, contrast=contrast, loaded=loaded)  # type: ignore[arg-type]
    for dim, slave, contrast, loaded in product((2, 3), ("upper", "lower"), (CONTRAST, 1 / CONTRAST), (False, True))
]
# More than a cell, .5 and .33 m, and farther than contact is looked for by default.
OVERLAPS = [
    Patch(dim=dim, cells=cells, slave=slave, overlap=0.75)  # type: ignore[arg-type]
    for dim, cells, slave in product((2, 3), ("simplex", "tensor"), ("upper", "lower"))
]


@problem("two blocks, meshes of 1:1 to 1:20: a uniform pressure goes over", methods=TWO, slow=TWO)
def checks(method: str) -> list[Check]:
    """All of them; a block that only the other one holds needs a method for floating bodies.

    Uzawa's tolerance is on p: at a contrast of 1e6 what is left of it moves the soft block by 1e-6 of its way.
    """
    patches = PATCHES + NODAL + CONTRASTS + OVERLAPS + LOADED
    return [
        check
        for patch in patches
        if METHODS[method].WORKS_WITH.floating or not (patch.loaded or patch.contrast != 1)
        for check in figures(replace(patch, method=method))
    ]
