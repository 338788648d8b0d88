"""Work-precision diagram with stated errors: `python -m stickslip.workflows.lab.benchmarks.work_precision` draws it.

A ready scene whose exact value is known is solved on finer and finer meshes. The error that each run states of one
number, from that run alone, is drawn beside the true one, over the seconds that it took on one core, estimate included;
forms are compiled before.
"""

from __future__ import annotations

import os
import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from stickslip import Builder, Quantity, Scene, SceneError, prepare, read
from stickslip.solvers.results.step_result import total_errors, values
from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.cost.pictures import BAND, log_log
from stickslip.workflows.pictures.sheet import CURVES, INK, PALE, Sheet

os.environ.update(ONE_THREAD)  # before the first operation that would start them

FACTORS = (4.0, 2.0, 1.0, 0.5, 0.25)  # of the scene's mesh sizes
NAMES = {"stated": "stated by the run", "true": "true", "corrected": "of the corrected number"}
STYLES: dict[str, dict[str, Any]] = {
    "stated": {"color": CURVES[1], "marker": "s"},
    "true": {"color": CURVES[0], "marker": "o"},
    "corrected": {"color": CURVES[2], "marker": "^", "linewidth": 0.9, "linestyle": (0, (4, 2))},
}


@dataclass(frozen=True)
class Point:
    """One run, and its errors relative to the exact value."""

    unknowns: int
    seconds: float
    stated: float
    true: float
    corrected: float  # of the number with most of the mesh's error removed

    def __str__(self) -> str:
        shares = ", ".join(f"{word} {100 * getattr(self, key):.2g} %" for key, word in NAMES.items())
        return f"{self.unknowns} unknowns, {self.seconds:.2f} s: {shares}"


def point(scene: Scene, name: str) -> Point:
    """Solve a scene; `name` is one of its contacts' numbers, whose exact value the scene knows."""
    began = clock.perf_counter()
    simulation = prepare(scene)
    steps = list(simulation.steps())
    *_, errors = simulation.errors(steps)
    stated = total_errors(steps[-1], errors)[name]
    seconds = clock.perf_counter() - began
    exact, contact, number = scene.exact.values[name], *name.split(".")
    corrected = errors[Quantity("contacts", contact, number)].corrected
    return Point(
        unknowns=simulation.system.constraints.free_total,
        seconds=seconds,
        stated=stated / abs(exact),
        true=abs(values(steps[-1])[name] / exact - 1),
        corrected=np.nan if corrected is None else abs(float(corrected) / exact - 1),
    )


def points(scene: Scene, name: str, factors: Sequence[float], say: Callable[[str], None]) -> Iterator[Point]:
    """Runs on all meshes; the first one is solved twice, for its forms."""
    if name not in scene.exact.values:
        raise SceneError(f"exact.values.{name}: the scene does not know it")
    if not isinstance(scene.geometry, Builder):
        raise SceneError("geometry.file: the sizes of its mesh are not those of the scene")
    scenes = [replace(scene, geometry=scene.geometry.refined(factor)) for factor in factors]
    point(scenes[0], name)
    for each in scenes:
        found = point(each, name)
        say(str(found))
        yield found


def draw(path: Path, scene: Scene, name: str, found: Sequence[Point]) -> Path:
    """Draw the errors over the seconds.

    Raises:
        MachineError: the disk is full.
    """
    sheet = Sheet(7.0, 4.3, dpi=130)
    axes = sheet.axes(0.85, 0.6, 5.85, 2.75)
    log_log(axes)
    seconds = [p.seconds for p in found]
    curves = {key: [getattr(p, key) for p in found] for key in NAMES}
    for key, errors in curves.items():
        axes.plot(seconds, errors, label=NAMES[key], markersize=5, **{"linewidth": 1.4} | STYLES[key])
    for p in found:
        place = (p.seconds, max(p.stated, p.true))
        text = f"{p.unknowns:,} unknowns".replace(",", " ")
        axes.annotate(text, place, (4, 5), textcoords="offset points", fontsize=7, color=PALE)
    smallest, largest = (bound([e for errors in curves.values() for e in errors]) for bound in (min, max))
    low = min(smallest, scene.exact.accuracy or smallest) / 2
    axes.set_ylim(low, 3 * largest)
    axes.set_xlim(min(seconds) / 1.3, 2.2 * max(seconds))
    if scene.exact.accuracy > low:
        axes.axhspan(low, scene.exact.accuracy, color=BAND, zorder=0)
        text = "grey: accuracy of the exact value"
        axes.text(0.01, 0.02, text, transform=axes.transAxes, va="bottom", fontsize=7, color=PALE)
    axes.yaxis.set_major_formatter(lambda value, _: f"{100 * value:g} %")
    axes.tick_params(which="both", color=PALE)
    axes.set_xlabel("seconds on one core, estimate of the error included", fontsize=9, color=INK)
    axes.set_ylabel(f"error of {name}", fontsize=9, color=INK)
    axes.legend(loc="lower right", bbox_to_anchor=(1.01, 1.0), ncols=3, fontsize=8, frameon=False, borderpad=0.2)
    caption = f"{name} = {scene.exact.values[name]:.6g} ({scene.exact.source})"
    sheet.head(scene.title, caption, 0.85)
    return sheet.save(path)


def main(
    scene: Annotated[str, typer.Argument(help="ready scene or file, with [exact] values")] = "raous",
    number: Annotated[str, typer.Argument(help="number of a contact, one of these values")] = "base.tangential_force",
    output: Annotated[Path, typer.Option("-o", help="picture to write")] = Path("docs/howto/work_precision.png"),
) -> None:
    """Solve, print a line for each mesh, and draw."""
    known = read(scene)
    found = list(points(known, number, FACTORS, print))
    print(draw(output, known, number, found))


if __name__ == "__main__":
    typer.run(main)
