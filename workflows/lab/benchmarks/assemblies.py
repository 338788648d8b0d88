"""Newton iterations on assemblies: `python -m stickslip.workflows.lab.benchmarks.assemblies` prints a row each.

Bodies have room to move, and friction alone keeps some of them from turning: a pin in a clevis, a ball in its socket, a
wedge, two rings pressed into each other.
"""

from __future__ import annotations

import os
import tempfile
import time as clock
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from stickslip import Scene, prepare, read
from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.lab.benchmarks.own_process import silence

os.environ.update(ONE_THREAD)  # before the first operation that would start them

FIXED = "displacement = { x = 0.0, y = 0.0, z = 0.0 }\n"
SHAPES = Path(__file__).parent / "templates" / "assemblies"


@dataclass(frozen=True, kw_only=True)
class Assembly:
    """A gmsh script, and what is added to it: lines of a scene [mm, N, MPa]."""

    bodies: tuple[str, ...]
    held: tuple[str, ...]  # sides
    loaded: str  # side
    force: tuple[float, float, float]  # [N]
    size: float  # of cells [mm]
    gap: float = 0.0  # [mm] of the exact shapes

    def scene(self, name: str, folder: Path, mu: float = 0.2, coarser: float = 1.0, order: int = 1) -> Scene:
        """The scene, written into a folder.

        Args:
            name: of the script.
            folder: where scene and script are written.
            mu: coefficient of friction.
            coarser: factor on the size of cells.
            order: of the elements.
        """
        (folder / f"{name}.geo").write_bytes((SHAPES / f"{name}.geo").read_bytes())
        steel = "\n".join(f"{body} = {{ E = 210e3, nu = 0.3 }}" for body in self.bodies)
        held = "".join(f'[supports.side_{k}]\nboundary = "{side}"\n{FIXED}' for k, side in enumerate(self.held))
        load = ", ".join(f"{axis} = {value!r}" for axis, value in zip("xyz", self.force, strict=True))
        path = folder / f"{name}.toml"
        path.write_text(
            f"""title = "Assembly {name}"
model = "3d"
units = "mm-N-MPa"
[geometry]
file = "{name}.geo"
order = {order}
size = {self.size * coarser!r}
[bodies]
{steel}
[contacts.any]
between = "all"
friction = {{ law = "coulomb", mu = {mu!r} }}
gap = {self.gap!r}
{held}[loads.force]
boundary = "{self.loaded}"
force = {{ {load} }}
[solver]
method = "condensed-newton"
[output]
pictures = false
error = false
""",
            encoding="utf-8",
        )
        return read(path)


ASSEMBLIES: Mapping[str, Assembly] = {
    "clevis": Assembly(
        bodies=("lug", "clevis", "pin"),
        held=("clevis.end",),
        loaded="lug.end",
        force=(10e3, 0.0, 0.0),
        size=5.0,
        gap=0.02,
    ),
    "ball": Assembly(
        bodies=("socket", "ball"),
        held=("socket.bottom",),
        loaded="ball.top",
        force=(150.0, 0.0, -3e3),
        size=2.2,
        gap=0.05,
    ),
    "wedge": Assembly(
        bodies=("wedge", "block", "wall"),
        held=("wall.back", "block.back"),
        loaded="wedge.top",
        force=(0.0, -2e3, 0.0),
        size=4.0,
    ),
    "rings": Assembly(
        bodies=("inner", "outer"), held=("outer.foot",), loaded="inner.top", force=(0.0, 0.0, -1e3), size=4.0, gap=-0.02
    ),
}


@dataclass(frozen=True)
class Work:
    """What the steps of one assembly took."""

    name: str
    rows: int
    iterations: tuple[int, ...]  # of each step
    seconds: float

    def __str__(self) -> str:
        return f"{self.name:8} {self.rows:6} {' '.join(map(str, self.iterations)):>12} {self.seconds:8.1f}"


def measure(name: str, mu: float = 0.2, coarser: float = 1.0, order: int = 1) -> Work:
    """Solve one of the assemblies; see `Assembly.scene`."""
    with tempfile.TemporaryDirectory() as folder:
        simulation = prepare(ASSEMBLIES[name].scene(name, Path(folder), mu, coarser, order))
        began = clock.process_time()
        steps = [(len(step.p), step.iterations) for step in simulation.steps()]
    return Work(name, steps[-1][0], tuple(count for _, count in steps), clock.process_time() - began)


def table(names: list[str], mu: float, coarser: float, order: int) -> Iterator[str]:
    """The report."""
    yield f"{'':8} {'rows':>6} {'iterations':>12} {'seconds':>8}"
    for name in names:
        yield str(measure(name, mu, coarser, order))


def main(
    names: Annotated[list[str] | None, typer.Argument(help="assemblies [all]")] = None,
    mu: Annotated[float, typer.Option(help="coefficient of friction")] = 0.2,
    coarser: Annotated[float, typer.Option(help="factor on the size of cells")] = 1.0,
    order: Annotated[int, typer.Option(help="of the elements")] = 1,
) -> None:
    """Print rows, iterations and seconds of assemblies."""
    silence()
    for line in table(names or list(ASSEMBLIES), mu, coarser, order):
        print(line, flush=True)


if __name__ == "__main__":
    typer.run(main)
