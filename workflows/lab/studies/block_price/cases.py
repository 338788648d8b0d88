"""The measurements: scenes, methods and tables, each table with one thing varied from a base case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from stickslip.geometry.builders.cuboid import Block
from stickslip.solvers.classical.gram_uzawa import Gram
from stickslip.solvers.laws.bilateral import Bilateral
from stickslip.solvers.laws.compliance import Compliance
from stickslip.solvers.laws.friction import Coulomb, Stick
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Steps
from stickslip.workflows.scene_file.read import read

Mesh = tuple[int, int]  # dimension, n
Axis = Literal["x", "y", "z", "normal"]
Table = tuple[tuple[float, float], ...]  # time, value
TOLERANCE, EXACT = 1e-8, 1e-12  # of the methods, and of the reference
HEIGHT = {2: 2.0, 3: 1.0}  # m, of the ready scenes `block` and `cube`; E = 1 Pa
PRESSED: Mapping[int, Mapping[Axis, float]] = {2: {"y": -0.1}, 3: {"z": -0.05}}  # m
DRAGGED: Mapping[int, Mapping[Axis, float]] = {2: {"x": 0.05}, 3: {"x": 0.02, "y": 0.01}}  # m
REFERENCE, BLOCK, INEXACT = "condensed-newton", "block-uzawa", ", inexact"
CONDENSED = (REFERENCE, "surface-uzawa", "gram-uzawa", "uzawa")
FACTORS = ("complete", "drop", "ic0")
Q = ("mass", *(f"gram {factor}" for factor in FACTORS))
EXACTLY = tuple(f"{BLOCK}, {each}" for each in Q)
METHODS = (*CONDENSED, *EXACTLY, *(name + INEXACT for name in EXACTLY))
LIKE = {"uzawa": f"{BLOCK}, mass", "gram-uzawa": f"{BLOCK}, gram complete"}  # the same iteration, not condensed


def solver_keys(method: str) -> dict[str, Any]:
    """Keys of [solver] that a name of METHODS stands for.

    >>> solver_keys("block-uzawa, mass, inexact")
    {'method': 'block-uzawa', 'preconditioner': 'mass', 'inner_solves': 'inexact'}
    """
    if method in CONDENSED:
        return {"method": method}
    _, preconditioner, *rest = method.split(", ")
    found: dict[str, Any] = {"method": BLOCK, "preconditioner": preconditioner.split(" ")[0]}
    found["inner_solves"] = "inexact" if rest else "exact"
    if preconditioner != "mass":
        found["gram"] = Gram(factor=preconditioner.split(" ")[1])  # type: ignore[arg-type]
    return found


@dataclass(frozen=True, kw_only=True)
class Case:
    """One measurement: a mesh of n cells over the height, a contact, and a method."""

    dim: int
    n: int
    method: str
    mu: float = 0.3
    c_n: float | None = None  # normal compliance in E/L, L the height; None: unilateral contact
    steps: int = 2  # 1: pressed and dragged in one step
    sticks: bool = False  # the base is glued: bilateral contact that never slips, a linear problem
    part: float | None = None  # of the bound 2 / lambda_1 on alpha; None: the default
    rule: str = "elman-golub"
    share: float = 0.3  # inner tolerance

    @property
    def name(self) -> str:
        """Name of its file."""
        return "_".join(f"{key}-{value}" for key, value in asdict(self).items()).replace(" ", "-").replace(",", "")

    @property
    def problem(self) -> Case:
        """The same problem for the reference."""
        return Case(
            **{key: getattr(self, key) for key in ("dim", "n", "mu", "c_n", "steps", "sticks")}, method=REFERENCE
        )

    def scene(self, tolerance: float = TOLERANCE, lambda_1: float | None = None) -> Scene:
        """The ready scene `block` or `cube`, changed.

        Args:
            lambda_1: largest eigenvalue that `part` refers to, where Q = W.
        """
        ready = read("block" if self.dim == 2 else "cube")
        size = HEIGHT[self.dim] / self.n
        assert isinstance(ready.geometry, Block)
        at_contact = size if self.dim == 2 else None
        geometry = replace(ready.geometry, mesh_size=size, contact_mesh_size=at_contact, cells="tensor")
        contact = replace(ready.contacts["base"], friction=Coulomb(mu=self.mu))
        if self.c_n is not None:
            contact = replace(contact, normal=Compliance(c_n=self.c_n / HEIGHT[self.dim]))
        if self.sticks:
            contact = replace(contact, normal=Bilateral(), friction=Stick())
        last = float(self.steps)
        start: Table = ((0.0, 0.0), (last - 1, 0.0)) if self.steps > 1 else ((0.0, 0.0),)
        moved: dict[Axis, Table] = {axis: ((0.0, 0.0), (1.0, value)) for axis, value in PRESSED[self.dim].items()}
        moved |= {axis: (*start, (last, value)) for axis, value in DRAGGED[self.dim].items()}
        keys = solver_keys(self.method) | {"tolerance": tolerance}
        if keys["method"] == BLOCK:
            keys |= {"inner_rule": self.rule, "inner_tolerance": self.share}
        if self.part is not None:
            keys |= {"alpha": self.part * 2 / lambda_1} if lambda_1 else {"relaxation": 2 * self.part}
        return replace(
            ready,
            geometry=geometry,
            contacts={"base": contact},
            supports={"top": replace(ready.supports["top"], displacement={**moved})},
            steps=Steps(end=last, count=self.steps),
            solver=replace(ready.solver, **keys),
            probes={},
        )


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """Meshes and parameters of each table."""

    meshes: tuple[Mesh, ...] = ((2, 8), (2, 16), (2, 32), (3, 4), (3, 8), (3, 16))
    at: tuple[Mesh, ...] = ((2, 16), (3, 4))  # of the tables that do not vary h
    methods: tuple[str, ...] = METHODS
    mu: tuple[float, ...] = (0.05, 0.3, 1.0)
    c_n: tuple[float, ...] = (0.1, 10.0, 1e3)
    parts: tuple[float, ...] = (0.25, 0.5, 0.75, 0.9, 0.99, 1.02, 1.1)
    bound_at: Mesh = (2, 8)
    inner_at: tuple[Mesh, ...] = ((2, 16), (3, 4))
    inner: tuple[tuple[str, float], ...] = (
        ("elman-golub", 0.01),
        ("elman-golub", 0.1),
        ("elman-golub", 0.3),
        ("elman-golub", 0.6),
        ("bramble-pasciak-vassilev", 0.3),
        ("bramble-pasciak-vassilev", 0.01),
        ("bramble-pasciak-vassilev", 1e-8),
    )


SMALL = Sizes(
    meshes=((2, 4), (2, 8), (3, 2), (3, 4)),
    methods=tuple(name for name in METHODS if "drop" not in name),
    at=((2, 4),),
    mu=(0.3, 1.0),
    c_n=(1e3,),
    parts=(0.5, 0.9, 1.1),
    bound_at=(2, 4),
    inner_at=((2, 4),),
    inner=(("elman-golub", 0.3), ("bramble-pasciak-vassilev", 1e-8)),
)
AS_EXACT = ("bramble-pasciak-vassilev", 1e-8)  # inner solves that stand for exact ones, in conjugate gradients


def tables(sizes: Sizes) -> Mapping[str, list[Case]]:
    """The cases of every table; those of one problem stand together. A case may be in several tables."""
    found: dict[str, list[Case]] = {"h": [], "mu": [], "c_n": [], "steps": [], "alpha": [], "inner": []}
    for dim, n in sizes.meshes:
        found["h"] += [Case(dim=dim, n=n, method=method) for method in sizes.methods]
    for dim, n in sizes.at:
        for mu in sizes.mu:
            found["mu"] += [Case(dim=dim, n=n, method=method, mu=mu) for method in sizes.methods]
        for c_n in sizes.c_n:
            found["c_n"] += [Case(dim=dim, n=n, method=method, c_n=c_n) for method in sizes.methods]
        for steps in (2, 1):
            found["steps"] += [Case(dim=dim, n=n, method=method, steps=steps) for method in sizes.methods]
    dim, n = sizes.bound_at
    for sticks in (True, False):
        for part in sizes.parts:
            found["alpha"].append(Case(dim=dim, n=n, method=EXACTLY[0], sticks=sticks, part=part))
    for part in sizes.parts:  # beyond the bound, a relaxation is refused
        if part < 1:
            found["alpha"].append(Case(dim=dim, n=n, method=EXACTLY[1], part=part))
    for dim, n in sizes.inner_at:
        for method in EXACTLY[:2]:
            found["inner"].append(Case(dim=dim, n=n, method=method))
            for rule, share in sizes.inner:
                found["inner"].append(Case(dim=dim, n=n, method=method + INEXACT, rule=rule, share=share))
    return found
