"""The page of the price benchmark: pictures and tables in one HTML file."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.lab.benchmarks.peers.page import section
from stickslip.workflows.lab.benchmarks.price_run import COUNTED, REFERENCE

matplotlib.use("Agg")


Run = dict[str, Any]
COLOURS = {
    "auto": "black", "condensed-newton": "tab:blue", "surface-uzawa": "tab:red", "uzawa": "tab:orange",
    "regularised": "tab:green",
}  # fmt: skip
LINES = {1e-4: "--", 1e-8: "-"}
BARS = {(2, 1e-8): ((64, 512), 1.5), (3, 1e-4): ((24, 64), 2.0), (3, 1e-8): ((24, 64), 2.5)}  # targets
LIKE = ("dim", "n", "cells", "bodies")  # what a case must have in common with its linear reference
STYLE = "body{font:15px sans-serif;max-width:75em;margin:2em auto} img{max-width:100%} table{border-collapse:collapse} "
STYLE += "td,th{border:1px solid #bbb;padding:.2em .6em;text-align:right}"
INTRODUCTION = """
A block (2D) and a cube (3D) with n cells over the height, pressed onto a rigid plane (mu = 0.3) and shifted.
Price: CPU seconds of preparation and of both steps over those of one linear elastic solve of the same mesh with the
contact surface fixed, set-up and solution by the fastest of MUMPS, CG + BoomerAMG and CG + GAMG to 1e-8, in the same
process. Medians of the ratios where short runs are repeated. One core. Memory: the process's peak over that of a
process that assembles and solves the linear problem alone, by the fastest of the three.
Solves: iterations of conjugate gradients, each with a multigrid cycle, in both steps over those of one linear solve to
1e-8 by CG + BoomerAMG; own solves: over those of one to the case's own tolerance. Grey: what is aimed at.
Growth: the slope of log(solves) against log(n), of volume solves where no iterations are counted, 0 where the mesh does
not matter; of one body of quadrilaterals or hexahedra.
"""
COLUMNS = {
    "n": "d", "dofs": "", "cells": "", "bodies": "d", "method": "", "surface": "", "tolerance": "g", "price": ".2f",
    "further": ".2f", "seconds": ".3g", "reference": ".3g", "iterations": "d", "volume_solves": "d",
    "linear_iterations": "d", "solves": ".2f", "own_solves": ".2f",
    "memory": ".2f", "residual": ".1e",
}  # fmt: skip


def write_page(folder: Path, runs: list[Run], peers: Sequence[Run] = ()) -> Path:
    """Write DIR/price.html and DIR/price.png, with the rows of other programs; the path of the page."""
    rows = [_row(run, runs) for run in runs if run["case"]["method"] != REFERENCE]
    png = io.BytesIO()
    picture(rows).savefig(png, dpi=110)
    write_aside(folder / "price.png", png.getvalue())
    tables = "".join(
        f"<h2>{dim}D</h2>{_section([row for row in rows if row['dim'] == dim])}{section(dim, peers)}" for dim in (2, 3)
    )
    shown = f'<img alt="prices against n" src="data:image/png;base64,{base64.b64encode(png.getvalue()).decode()}">'
    title = "The price of friction"
    head = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
    page = f"{head}<h1>{title}</h1><p>{INTRODUCTION}</p>{shown}{tables}</html>"
    write_aside(folder / "price.html", page.encode())
    return folder / "price.html"


def growth(rows: list[Run]) -> dict[tuple[str, str, float], float]:
    """Slope of log(solves) against log(n), by method, form of the bodies and tolerance; of one dimension.

    Volume solves stand for them where no iterations are counted.
    """
    counts: dict[tuple[str, str, float], dict[int, float]] = {}
    for row in rows:
        count = row["price"] and (row.get("solves") or row["volume_solves"])
        if count:
            counts.setdefault((row["method"], row["surface"], row["tolerance"]), {})[row["n"]] = count
    return {
        kind: float(np.polyfit(np.log(list(known)), np.log(list(known.values())), 1)[0])
        for kind, known in counts.items()
        if len(known) > 1
    }


def _plain(row: Run) -> bool:
    """Whether it is of one body of quadrilaterals or hexahedra: what curves and growth are made of."""
    return bool(row["cells"] == "tensor" and row["bodies"] == 1)


def _section(rows: list[Run]) -> str:
    """How the counts grow, then every run."""
    lines = [
        f"<tr><td>{method}<td>{surface}<td>{tolerance:g}<td>{slope:.2f}"
        for (method, surface, tolerance), slope in growth([row for row in rows if _plain(row)]).items()
    ]
    head = "<tr><th>method<th>surface<th>tolerance<th>growth"
    return f"<table>{head}{''.join(lines)}</table><br>{_table(rows)}"


def _table(rows: list[Run]) -> str:
    """All runs as a table; rows without a price give the reason."""
    lines = ["<tr>" + "".join(f"<th>{key.replace('_', ' ')}" for key in COLUMNS) + "</tr>"]
    for row in rows:
        known = {key: row.get(key) for key in COLUMNS}
        cells = "".join(f"<td>{'' if v is None else format(v, COLUMNS[k])}" for k, v in known.items())
        because = "" if row["price"] else f"<td>{html.escape(row['status'])}"
        lines.append(f"<tr>{cells}{because}</tr>")
    return f"<table>{''.join(lines)}</table>"


def _row(run: Run, runs: list[Run]) -> Run:
    """One row of the table."""
    case = run["case"]
    row = dict(case) | {"status": run["status"], "dofs": run.get("dofs", ""), "price": None}
    if run.get("price") is None:
        return row
    steps = run["steps"][:2]
    alone = [
        r["memory"]
        for r in runs
        if r["case"]["method"] == REFERENCE and "memory" in r and all(r["case"][k] == case[k] for k in LIKE)
    ]
    cycles = sum(step["linear_iterations"] for step in steps)

    def solves(reference: Run | None) -> float | None:
        count = reference and (reference.get("solvers", {}).get(COUNTED) or {}).get("iterations")
        return cycles / count if cycles and count else None

    return row | {
        "solves": solves(run["reference"]),
        "own_solves": solves(run.get("own")),
        "price": run["price"],
        "further": run["further_price"],
        "seconds": run["two_steps"],
        "reference": run["reference_seconds"],
        "memory": run["memory"] / alone[0] if alone else None,
        "residual": max(step["residual"] for step in steps),
        **{key: sum(step[key] for step in steps) for key in ("iterations", "volume_solves", "linear_iterations")},
    }


def picture(rows: list[Run]) -> Figure:
    """Price, further step, volume solves, linear iterations and memory against n, log-log; 2D above, 3D below."""
    figure = Figure(figsize=(17, 8), layout="constrained")
    kinds: tuple[tuple[str, Callable[[Run], Any]], ...] = (
        ("price of two steps", lambda r: r["price"]),
        ("price of a further step", lambda r: r["further"]),
        ("volume solves", lambda r: r["volume_solves"]),
        ("linear iterations", lambda r: r["linear_iterations"] or None),
        ("memory", lambda r: r["memory"]),
    )
    axes = figure.subplots(2, len(kinds))
    for line, dim in zip(axes, (2, 3), strict=True):
        for axis, (title, value) in zip(line, kinds, strict=True):
            for method, colour in COLOURS.items():
                for tolerance, style in LINES.items():
                    chosen = [
                        (r["n"], value(r))
                        for r in filter(_plain, rows)
                        if (r["dim"], r["method"], r["tolerance"]) == (dim, method, tolerance) and r["price"]
                    ]
                    chosen = [(n, v) for n, v in chosen if v]
                    if chosen:
                        wide = 2.5 if method == "auto" else 1.5
                        axis.loglog(
                            *zip(*chosen, strict=True), style, marker="o", ms=4, lw=wide, color=colour,
                            label=f"{method}, {tolerance:g}",
                        )  # fmt: skip
            for (of, tolerance), (reach, bar) in BARS.items():
                if of == dim and title == "price of two steps":
                    axis.plot(reach, [bar, bar], LINES[tolerance], color="grey", lw=6, alpha=0.4)
            sizes = sorted({r["n"] for r in rows if r["dim"] == dim})
            axis.set(title=f"{dim}D: {title}", xlabel="n, cells over the height")
            axis.set_xticks(sizes, [str(n) for n in sizes])
            if axis.has_data():
                axis.set_yscale("log")
                axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
                axis.yaxis.set_major_formatter("{x:g}")
            axis.minorticks_off()
            axis.grid(alpha=0.3)
    known = {label: line for axis in axes[:, 0] for line, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    if known:
        figure.legend(known.values(), known.keys(), loc="outside lower center", ncols=5)
    return figure
