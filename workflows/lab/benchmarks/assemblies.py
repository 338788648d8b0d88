"""A collection of assemblies: `python -m stickslip.workflows.lab.benchmarks.assemblies` writes docs/assemblies.md.

Bodies have room to move, and friction alone keeps some of them from turning: a pin in a clevis, a ball in its socket,
links of a chain, stones without mortar. One core, one thread, CPU seconds; a price is that of preparation and
iterations over one linear solve of the same bodies with their contact nodes held.
"""

from __future__ import annotations

import json
import os
import time as clock
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, field
from functools import partial
from itertools import pairwise, product
from pathlib import Path
from typing import Annotated, Any

import typer

from stickslip import Counters, Scene, StickslipError, prepare
from stickslip.solvers.parallel.counters import Clock
from stickslip.solvers.results.linear_reference import linear_reference
from stickslip.solvers.results.step_result import Quantity, StepResult, quantities
from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.formats.templates import render
from stickslip.workflows.lab.benchmarks.own_process import apart, kept
from stickslip.workflows.scene_file.proposal import assembly, scene_text
from stickslip.workflows.scene_file.read import from_dict

os.environ.update(ONE_THREAD)  # before the first operation that would start them

SHAPES = Path(__file__).with_name("assembly_shapes.py")
PAGE = Path(__file__).resolve().parents[3] / "docs" / "assemblies.md"
DRAWN = Path("/usr/share/doc/gmsh-doc/doc/gmsh/demos/api/as1-tu-203.stp.gz")  # of Debian's package gmsh-doc
KEPT = Path("results/assemblies")
STORED = Quantity("energy", "", "stored")
ONCE, AFTER = ((1.0, 1.0), (2.0, 1.2), (3.0, 0.9)), ((1.0, 0.0), (2.0, 1.0), (3.0, 0.8))  # times, and parts of the load
STEEL = {"E": 210e3, "nu": 0.3}  # [MPa]
Table = dict[str, Any]
Side = tuple[str, float] | tuple[float, ...]  # axis that it lies across and where [mm], or a box


def box(side: Side, far: float = 1e4) -> Table:
    """Return what selects a side: a box, that around a plane is thin."""
    if len(side) > 2:
        return {"box": side}
    axis, at = side
    return {"box": [at + s * 1e-2 if name == axis else s * far for s in (-1, 1) for name in "xyz"]}


@dataclass(frozen=True, kw_only=True)
class Assembly:
    """What a scene adds to a shape [mm, N, MPa]; forces of plane ones are per mm.

    Attributes:
        bodies: how many of a name there are.
        held: side of a body where it is held.
        guided: side where it cannot move along its normal.
        loaded: side that the force acts on.
        force: by component [N].
        bolts: body, places +-x and +-y, heights of the ends of the shank, tension [N]; the first step tightens them.
        sizes: of cells [mm], and of cells where bodies are close.
        coarse: factor on the sizes of coarse copies.
        plane: whether it is of two dimensions.
        soft: materials of what is not steel.
        contact: what the table of contact has more.
        more: other tables of the scene.
    """

    bodies: Mapping[str, int]
    held: Mapping[str, Side]
    guided: Mapping[str, Side] = field(default_factory=dict)
    loaded: Mapping[str, Side] = field(default_factory=dict)
    force: tuple[float, ...] = ()
    bolts: Mapping[str, Any] = field(default_factory=dict)
    sizes: tuple[float, float]
    coarse: float
    plane: bool = False
    soft: Mapping[str, Table] = field(default_factory=dict)
    contact: Table = field(default_factory=dict)
    more: Table = field(default_factory=dict)

    def table(self, kind: str) -> Table:
        """Return the scene as data."""
        bodies = {f"{name}_{k}" if n > 1 else name: name for name, n in self.bodies.items() for k in range(1, n + 1)}
        sides = {f"{body}.{place}": box(side) for place in PLACES for body, side in getattr(self, place).items()}
        times = AFTER if self.bolts else ONCE
        force = [[[time, part * value] for time, part in times] for value in self.force]
        fixed = {"held": dict.fromkeys("xy" if self.plane else "xyz", 0.0), "guided": {"normal": 0.0}}
        named = {name.replace(".", "_"): (name, name.split(".")[1]) for name in sides}
        return {
            "title": f"Assembly {kind}",
            "model": "plane strain" if self.plane else "3d",
            "units": "mm-N-MPa",
            "geometry": {"file": str(SHAPES), "parameters": {"kind": kind}, "names": sides}
            | dict(zip(("mesh_size", "contact_mesh_size"), self.sizes, strict=True)),
            "bodies": {name: self.soft.get(of, STEEL) for name, of in bodies.items()},
            "contacts": {"any": {"between": "all"} | self.contact},
            "supports": {
                key: {"boundary": side, "displacement": fixed[place]}
                for key, (side, place) in named.items()
                if place in fixed
            },
            "loads": {
                key: {"boundary": side, "force": force} for key, (side, place) in named.items() if place == "loaded"
            },
            "bolts": bolts(**self.bolts) if self.bolts else {},
            "steps": {"end": times[-1][0], "count": len(times)},
        } | self.more


def bolts(body: str, places: tuple[float, float], shank: tuple[float, float], force: float) -> Table:
    """Return the table of four bolts along z, see `Assembly`."""
    pulled = {"force": [[1.0, force]], "held_from": 1.0}
    return {
        f"{body}_{k}": {"body": f"{body}_{k}", "shank": [[*place, z] for z in shank]} | pulled
        for k, place in enumerate(product(*((-x, x) for x in places)), start=1)
    }


PLACES = ("held", "guided", "loaded")
WRITTEN = tomllib.loads(SHAPES.with_name("assemblies.toml").read_text(encoding="utf-8"))
ASSEMBLIES: Mapping[str, Assembly] = {name: Assembly(**table) for name, table in WRITTEN.items()}
NAMES = (*ASSEMBLIES, "as1")


def as1() -> Table:
    """Return the assembly of 18 solids in Debian's gmsh-doc, as `stickslip new --from` proposes it, and a pull."""
    proposed = tomllib.loads(scene_text(assembly(DRAWN, "mm", None), DRAWN))
    pull = {"pull": {"boundary": "l_bracket.front", "force": [[[1.0, 0.0], [2.0, 800.0], [3.0, 640.0]], 0.0, 0.0]}}
    return proposed | {"loads": pull, "steps": {"end": 3.0, "count": 3}}


@dataclass(frozen=True)
class Case:
    """An assembly as it is to be solved."""

    name: str
    mu: float = 0.2  # coefficient of friction
    coarser: float = 1.0  # factor on the sizes of cells
    order: int = 1  # of the elements
    method: str = "auto"
    error: bool = False  # whether errors are estimated

    def path(self, folder: Path) -> Path:
        """Where its measurement is kept."""
        return folder / f"{'_'.join(map(str, astuple(self)))}.json"

    def row(self, folder: Path) -> str:
        """A row of the table, from what is kept."""
        found = Work(**json.loads(self.path(folder).read_text(encoding="utf-8")))
        name = self.name if self.coarser == 1 else f"{self.name}, order {self.order}, mu {self.mu:g}"
        return f"| {' | '.join([name, *found.cells])} |"

    def scene(self) -> Scene:
        """What is solved."""
        table = as1() if self.name == "as1" else ASSEMBLIES[self.name].table(self.name)
        for contact in table["contacts"].values():
            contact["friction"] = {"law": "coulomb", "mu": self.mu}
        geometry = table["geometry"]
        for key in {"mesh_size", "contact_mesh_size"} & set(geometry):
            geometry[key] *= self.coarser
        geometry["order"] = self.order
        asked = {"solver": {"method": self.method}, "output": {"pictures": False, "error": self.error}}
        return from_dict(table | asked, DRAWN.parent)


def copies(names: Sequence[str]) -> Iterator[Case]:
    """Yield the coarse copies of assemblies, of both orders and with three coefficients of friction."""
    for name, order, mu in product(names, (1, 2), (0.0, 0.1, 0.5)):
        yield Case(name, mu, ASSEMBLIES[name].coarse if name in ASSEMBLIES else 4.0, order)


@dataclass(frozen=True)
class Work:
    """What the steps of one assembly took; empty where there is none."""

    unknowns: int = 0
    rows: int = 0
    iterations: Sequence[int] = ()  # of each step
    seconds: Sequence[float] = ()  # CPU [s] of preparation, and of each step
    unit: float = 0.0  # CPU [s] of one linear solve; 0: shorter than the clock tells
    error: float | None = None  # stated of the elastic energy, relative to it
    told: str = ""  # why it ended

    @property
    def cells(self) -> list[str]:
        """Those of a row in words."""
        first, *others = map(str, self.iterations or ("",))
        costs = (sum(self.seconds[:2]), max(self.seconds[2:], default=0.0)) if self.unit else ()
        prices = [f"{seconds / self.unit:.1f}" for seconds in costs] or ["", ""]
        ended = self.told.replace("|", "/") or ("" if self.error is None else f"{100 * self.error:.2g} %")
        sizes = [str(self.unknowns), str(self.rows)]
        return [*sizes, first, " ".join(others), *prices, f"{sum(self.seconds):.1f}", ended]


def measure(case: Case) -> Table:
    """Solve one of the assemblies; what is refused, and what has no solution, tells so."""
    counters = Counters()
    counters.clock = Clock(now=clock.process_time)
    steps, told, stated = list[StepResult](), "", None
    try:
        simulation = prepare(case.scene(), counters=counters)
        marks = [simulation.seconds.iterate]
        for step in simulation.steps():
            steps.append(step)
            marks.append(simulation.seconds.iterate)
        if case.error:
            estimates = simulation.estimates(steps)
            estimates.solve(estimates.choose())
            total, value = estimates.errors[-1][STORED].total, quantities(steps[-1])[STORED]
            stated = None if total is None else float(total / value)
    except StickslipError as failed:
        told = f"{type(failed).__name__}: {failed}"
    if not steps:
        return asdict(Work(told=told))
    found = Work(
        unknowns=simulation.system.constraints.free_total,
        rows=len(steps[-1].p),
        iterations=[step.iterations for step in steps],
        seconds=[simulation.seconds.prepare, *(after - before for before, after in pairwise(marks))],
        unit=linear_reference(simulation.system, now=clock.process_time).seconds,
        error=stated,
        told=told,
    )
    return asdict(found)


def main(
    names: Annotated[list[str] | None, typer.Argument(help="assemblies [all]")] = None,
    coarse: Annotated[bool, typer.Option(help="coarse copies, of both orders, with mu 0, .1 and .5; no page")] = False,
    method: Annotated[str, typer.Option(help="of solution")] = "auto",
    mu: Annotated[float, typer.Option(help="coefficient of friction")] = 0.2,
    folder: Annotated[Path, typer.Option("-o", "--output", help="where measurements are kept")] = KEPT,
) -> None:
    """Measure what is missing, print a row each, and write the page of all that is kept."""
    folder.mkdir(parents=True, exist_ok=True)
    chosen, kind = names or NAMES, partial(Case, mu=mu, method=method, error=True)
    for case in copies(chosen) if coarse else map(kind, chosen):
        kept(case.path(folder), partial(apart, measure, case))
        print(case.row(folder), flush=True)
    if not coarse:
        rows = [case.row(folder) for case in map(kind, NAMES) if case.path(folder).exists()]
        write_aside(PAGE, render("lab/benchmarks/templates/assemblies.md", rows=rows, mu=mu).encode())


if __name__ == "__main__":
    typer.run(main)
