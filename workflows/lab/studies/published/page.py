"""The page of the published methods: claims with verdicts, then a table and a picture for every study."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.lab.studies.published.claims import TANGENT, UZAWA
from stickslip.workflows.lab.studies.published.finding import (
    Claim,
    Row,
    Rows,
    chosen,
    csv_of,
    different,
    judged,
    markdown,
    pivot,
)
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
            _lines(axis, _varying(chosen(found, dim=dim), key), "solver", key, "iterations", scale)
            axis.set(title=f"{form}, {dim}D", xlabel={"omega_factor": "ω h/E"}.get(key, key))
    return _png(figure, axes)


def _varying(rows: list[Row], key: str) -> list[Row]:
    """Rows in which only the key varies; mesh, mu and omega have their most frequent values."""
    others = [k for k in ("n", "mu", "omega_factor") if k != key]
    kinds: dict[tuple[float, ...], list[Row]] = {}
    for row in rows:
        kinds.setdefault(tuple(row[k] for k in others), []).append(row)
    best = max(kinds.values(), key=lambda found: len({row[key] for row in found}), default=[])
    return sorted(best, key=lambda row: float(row[key]))


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


CLAIMS: tuple[Claim, ...] = (*UZAWA, *TANGENT)
INTRODUCTION = """# The published methods, measured

N. Pop, *On the inexact Uzawa methods for saddle point problems arising from contact problem* (1999), what it claims and
what its references stand for there, on the ready scenes `block` (2D) and `cube` (3D), n cells over the height, pressed
onto a rigid plane and dragged. `python -m stickslip.workflows.lab.studies.published` computes everything below;
verdicts follow from the rows by code. The source names no GMRES: it lists [5] H. C. Elman, *Relaxed and stabilised
incomplete factorizations for non-self-adjoint linear systems*, BIT 29 (1989), for systems that are nonsymmetric; what
is claimed under [5] is what that reference is about, not a sentence of the source."""
SECTIONS: Mapping[str, tuple[str, str]] = {
    "h": (
        "Against h",
        "Both steps to 1e-6, mu = 0.3: iterations / volume solves / inner conjugate gradients where there are any.",
    ),
    "mu": (
        "Against friction",
        "The same on one mesh, dragged the farther the larger mu, so that a part of the base slips; empty where the "
        "method failed, see the CSV for its words.",
    ),
    "given": (
        "Given friction",
        "uzawa, each problem of given friction solved before its bounds are renewed (`outer`).",
    ),
    "inner": (
        "Against the inner tolerance",
        "Iterations / volume solves / inner iterations. Of nonlinear-uzawa every Newton step of its compliant faces is "
        "a volume solve.",
    ),
    "chen": (
        "The outer metric of nonlinear Uzawa",
        "Natural residuals of the last step to 1e-11, compliance and given friction: Q_k = W (points), or "
        "Q_k = B V_k⁻¹ Bᵀ (jacobian), V_k the generalised Jacobian of the bodies with their compliant faces.",
    ),
    "omega": (
        "Against the penalties of the perturbed Lagrangian",
        "True error against condensed-newton on the same mesh, and the one that is stated: relative, energy norm. "
        "Penalties in E/h. The condition number is that of W⁻¹(B K_B⁻¹Bᵀ − K_C), K_C = −W/ω.",
    ),
    "newton": ("Newton's last iterations", "Natural residuals of the last step to 1e-11; ω is led up level by level."),
    "linear": (
        "Linear saddle points",
        "Factor of an iteration by theory / as measured; `worst residual` is the least favourable δ_k that the rule "
        "allows.",
    ),
    "step": ("The bound on α for contact", "Iterations of uzawa from random tractions to 1e-10, first step."),
    "spectrum": (
        "Condition numbers and spectra",
        "Q⁻¹ B K_B⁻¹ Bᵀ, all of the base of a 4 x 2 (x 2) m block sticking: largest beside smallest eigenvalue, in "
        "brackets the factor's entries beside IC(0)'s.",
    ),
    "tangent": (
        "The slip tangent",
        "K = K_B + ΣK_C of perturbed-lagrangian at the end of the drag, with the forces eliminated or not (4.5): "
        "iterations to 1e-8, seconds of set-up and solution beside those of MUMPS in the same process, fill, relative "
        "error of the solution. Relaxed: part of the dropped fill that is added to the diagonal, 1: modified ILU; "
        "that sum is formed in Python and not timed. Stabilised: every diagonal entry raised by that part before.",
    ),
}


def write_page(folder: Path, rows: Rows) -> Path:
    """DIR/published.md, a PNG for each picture and a CSV for each study; the path of the page."""
    for study, found in rows.items():
        write_aside(folder / f"{study}.csv", csv_of(found).encode())
    parts = [INTRODUCTION, "## Claims", claims(rows)]
    for study, (title, words) in SECTIONS.items():
        parts += [f"## {title}", words]
        if study in PICTURES and rows[study]:
            write_aside(folder / f"{study}.png", PICTURES[study](rows[study]))
            parts.append(f"![{title}]({study}.png)")
        parts += list(TABLES[study](rows[study]))
    write_aside(folder / "published.md", ("\n\n".join(parts) + "\n").encode())
    return folder / "published.md"


def claims(rows: Rows) -> str:
    """Every claim with its verdict and figure."""
    return judged(CLAIMS, rows, lambda found: found.verdict)


def _mesh(row: Row) -> str:
    return f"{row['dim']}D n = {row['n']}"


def _counts(row: Row) -> str:
    if row["status"] != "converged":
        return ""
    inner = f" / {row['linear_iterations']}" if row["linear_iterations"] else ""
    return f"{row['iterations']} / {row['volume_solves']}{inner}"


def _by_method(rows: list[Row]) -> Iterator[str]:
    yield pivot(rows, lambda r: [r["method"]], _mesh, _counts, ["method"])


def _by_mu(rows: list[Row]) -> Iterator[str]:
    yield pivot(rows, lambda r: [r["method"]], lambda r: f"mu = {r['mu']:g}", _counts, ["method"])


def _by_inner(rows: list[Row]) -> Iterator[str]:
    yield pivot(
        rows,
        lambda r: [r["method"], r["inner_rule"]],
        lambda r: f"{r['inner_tolerance']:g}",
        _counts,
        ["method", "rule"],
    )


def _by_omega(rows: list[Row]) -> Iterator[str]:
    lines = [
        [f"{r['omega_factor']:g}", str(r["iterations"]), *(f"{r[key]:.2e}" for key in ("error", "stated", "condition"))]
        if r["status"] == "converged"
        else [f"{r['omega_factor']:g}", r["status"], "", "", ""]
        for r in rows
    ]
    yield markdown(["ω h/E", "iterations", "true error", "stated error", "condition"], lines)


def _histories(rows: list[Row]) -> Iterator[str]:
    lines = [
        [f"{_mesh(r)} {r.get('outer_metric', '')}", ", ".join(f"{x:.1e}" for x in r.get("history", [])[-6:])]
        for r in rows
    ]
    yield markdown(["", "last residuals"], lines)


def _by_part(rows: list[Row]) -> Iterator[str]:
    def factors(row: Row) -> str:
        return f"{row['theory']:.3f} / {row['measured']:.3f}"

    yield pivot(rows, lambda r: [r["C"], r["inner"]], lambda r: f"αλ₁/2 = {r['part']:g}", factors, ["C", "inner solve"])


def _by_step(rows: list[Row]) -> Iterator[str]:
    def ended(row: Row) -> str:
        return str(row["iterations"]) if row["status"] == "converged" else f"residual {row['residual']:.0e}"

    yield pivot(rows, lambda r: [r["friction"]], lambda r: f"αλ₁/2 = {r['part']:g}", ended, ["friction"])


def _by_metric(rows: list[Row]) -> Iterator[str]:
    def shown(row: Row) -> str:
        fill = f" ({row['fill']:.2f})" if row["fill"] else ""
        return f"{row['condition']:.4g}{fill}"

    yield pivot(rows, lambda r: [r["metric"]], _mesh, shown, ["Q"])
    extremes = pivot(rows, lambda r: [r["metric"]], _mesh, lambda r: f"{r['least']:.2g}, {r['largest']:.2g}", ["Q"])
    yield "Extreme eigenvalues, in the units of each metric:"
    yield extremes


def _by_solver(rows: list[Row]) -> Iterator[str]:
    for form in dict.fromkeys(row["form"] for row in rows):
        found = chosen(rows, form=form)
        yield f"### Unknowns: {form}"
        yield pivot(found, lambda r: [r["solver"]], _system, _solve, ["solver"])
        direct = [row for row in found if "condition" in row]
        kept = {_system(row): row for row in direct}
        yield markdown(
            ["system", "unknowns", "sliding", "|K - Kᵀ|/|K|", "condition, 1-norm"],
            [
                [where, str(r["dofs"]), f"{r['sliding']:.0%}", f"{r['unsymmetry']:.2g}", f"{r['condition']:.1e}"]
                for where, r in kept.items()
            ],
        )


def _system(row: Row) -> str:
    return f"{_mesh(row)}, mu {row['mu']:g}, ω {row['omega_factor']:g}"


def _solve(row: Row) -> str:
    if row.get("ratio") is None:
        return row["status"] if isinstance(row["status"], str) else ""
    count = f"{row['iterations']}, " if row["iterations"] is not None else ""
    return f"{count}{row['ratio']:.2g}x, fill {row['fill']:.2g}, error {row['error']:.0e}"


TABLES: Mapping[str, Callable[[list[Row]], Iterator[str]]] = {
    "h": _by_method,
    "mu": _by_mu,
    "given": _by_mu,
    "inner": _by_inner,
    "chen": _histories,
    "omega": _by_omega,
    "newton": _histories,
    "linear": _by_part,
    "step": _by_step,
    "spectrum": _by_metric,
    "tangent": _by_solver,
}
