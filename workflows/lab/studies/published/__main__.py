"""Claims and measured values: `python -m stickslip.workflows.lab.studies.published [-o DIR]` writes DIR/published.md.

Every measurement is saved when it ends; one that exists is not repeated. Remove DIR to begin anew.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import matplotlib
import numpy as np
import typer
from matplotlib import colormaps
from matplotlib.figure import Figure

from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.formats.templates import render
from stickslip.workflows.lab.studies import finding
from stickslip.workflows.lab.studies.finding import Row, Rows, alike, chosen, different
from stickslip.workflows.lab.studies.published import claims
from stickslip.workflows.lab.studies.published.measurements import MEASURED, SMALL, Sizes, measurements
from stickslip.workflows.lab.studies.published.tangent import DIRECT

matplotlib.use("Agg")

DPI = 110
DASHES, MARKS = ("-", "--", ":", "-."), "os^vD"  # lines that lie on each other stay visible


def methods(rows: list[Row]) -> bytes:
    """Iterations and volume solves against n; 2D above, 3D below."""
    kinds = {"iterations": "iterations", "volume_solves": "volume solves"}
    dims = sorted(set(different(rows, "dim")))
    figure = Figure(figsize=(11, 4.2 * len(dims)), layout="constrained")
    axes = figure.subplots(len(dims), len(kinds), squeeze=False)
    for line, dim in zip(axes, dims, strict=True):
        for axis, (key, title) in zip(line, kinds.items(), strict=True):
            _lines(axis, chosen(rows, dim=dim), "method", "n", key)
            axis.set(title=f"{dim}D: {title}", xlabel="n, cells over the height")
    return _png(figure, axes)


def friction(rows: list[Row]) -> bytes:
    """Iterations against mu, on a scale that includes zero."""
    figure = Figure(figsize=(9, 5), layout="constrained")
    axes = figure.subplots(1, 1, squeeze=False)
    _lines(axes[0, 0], rows, "method", "mu", "iterations", "symlog")
    axes[0, 0].set(title="iterations", xlabel="mu")
    return _png(figure, axes)


def penalties(rows: list[Row]) -> bytes:
    """True and stated error."""
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.subplots(1, 1, squeeze=False)
    done = [row for row in rows if row.get("error")]
    told = [
        {"what": key, "omega": row["omega_factor"], "error": row[key]} for key in ("error", "stated") for row in done
    ]
    _lines(axes[0, 0], told, "what", "omega", "error")
    axes[0, 0].set(title="error of perturbed-lagrangian, energy norm", xlabel="ω h/E")
    return _png(figure, axes)


def spectra(rows: list[Row]) -> bytes:
    """Condition numbers against n, and all eigenvalues of the finest mesh beside their largest."""
    dims = sorted(set(different(rows, "dim")))
    figure = Figure(figsize=(13, 4.6 * len(dims)), layout="constrained")
    axes = figure.subplots(len(dims), 2, squeeze=False)
    for line, dim in zip(axes, dims, strict=True):
        found = chosen(rows, dim=dim)
        last = max(row["n"] for row in found)
        _lines(line[0], found, "metric", "n", "condition")
        line[0].set(title=f"{dim}D: condition number", xlabel="n, cells over the height")
        for row, colour in zip(chosen(found, n=last), _colours(different(found, "metric")), strict=True):
            values = np.array(row["values"])
            line[1].semilogy(np.linspace(0, 1, len(values)), values / values[-1], color=colour, label=row["metric"])
        line[1].set(title=f"{dim}D, n = {last}: eigenvalues beside the largest", xlabel="part of all of them")
    return _png(figure, axes)


def tangents(rows: list[Row]) -> bytes:
    """Iterations on the slip tangent against n in 2D and 3D, omega and mu; a line for each form of it."""
    forms = different(rows, "form")
    figure = Figure(figsize=(17, 4.4 * len(forms)), layout="constrained")
    axes = figure.subplots(len(forms), 4, squeeze=False)
    for line, form in zip(axes, forms, strict=True):
        found = [row for row in chosen(rows, form=form) if row["solver"] != DIRECT]
        for axis, (dim, key) in zip(line, ((2, "n"), (3, "n"), (2, "omega_factor"), (2, "mu")), strict=True):
            scale = "symlog" if key == "mu" else "log"
            _lines(axis, alike(chosen(found, dim=dim), key), "solver", key, "iterations", scale)
            axis.set(title=f"{form}, {dim}D", xlabel={"omega_factor": "ω h/E"}.get(key, key))
    return _png(figure, axes)


def _lines(axis: Any, rows: list[Row], kind: str, x: str, y: str, scale: str = "log") -> None:
    """One line for each kind; rows without a value are left out. The scale "symlog" includes zero."""
    kinds = different(rows, kind)
    axis.set_yscale("log")
    axis.set_xscale(scale, **({"linthresh": 0.1} if scale == "symlog" else {}))
    for i, (name, colour) in enumerate(zip(kinds, _colours(kinds), strict=True)):
        points = [(row[x], row[y]) for row in chosen(rows, **{kind: name}) if row.get(y)]
        if points:
            axis.plot(
                *zip(*points, strict=True),
                ls=DASHES[i % 4],
                marker=MARKS[i % 5],
                ms=5,
                mfc="none",
                color=colour,
                label=name,
            )
    at = sorted({row[x] for row in rows})
    axis.set_xticks(at, [f"{value:g}" for value in at])
    axis.minorticks_off()
    axis.grid(alpha=0.3)


def _colours(kinds: list[Any]) -> list[Any]:
    return [colormaps["tab20"](2 * i % 20 + i // 10) for i in range(len(kinds))]


def _png(figure: Figure, axes: Any) -> bytes:
    """Save as PNG, with one legend for all axes."""
    known = {
        label: line for axis in axes.ravel() for line, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    if known:
        figure.legend(known.values(), known.keys(), loc="outside lower center", ncols=4)
    png = io.BytesIO()
    figure.savefig(png, dpi=DPI)
    return png.getvalue()


PICTURES: Mapping[str, Callable[[list[Row]], bytes]] = {
    "h": methods,
    "mu": friction,
    "omega": penalties,
    "spectrum": spectra,
    "tangent": tangents,
}


def write_page(folder: Path, rows: Rows) -> Path:
    """DIR/published.md, a PNG for each picture and a CSV for each study; the path of the page."""
    for study, found in rows.items():
        write_aside(folder / f"{study}.csv", finding.csv_of(found).encode())
        if study in PICTURES and found:
            write_aside(folder / f"{study}.png", PICTURES[study](found))
    text = render(
        "lab/studies/templates/published.md",
        rows=rows,
        finding=finding,
        claims=claims,
        judged=lambda judge: finding.judged(judge(rows), judge(rows).verdict),
    )
    write_aside(folder / "published.md", text.encode())
    return folder / "published.md"


def measured(output: Path, sizes: Sizes) -> Rows:
    """All rows: those of an earlier run are read, the missing ones are measured."""
    return finding.collected(output, MEASURED, [(each.study, each.name, each.rows) for each in measurements(sizes)])


def main(
    output: Annotated[Path, typer.Option("-o", "--output", help="where the page goes")] = Path("results/published"),
    small: Annotated[bool, typer.Option("--small", help="coarse meshes, in a minute")] = False,
) -> None:
    """Measure the published methods and write the page."""
    logging.getLogger("stickslip.solvers").setLevel(logging.ERROR)  # a method that fails is a row, not a warning
    print(write_page(output, measured(output, SMALL if small else Sizes())))


if __name__ == "__main__":
    typer.run(main)
