"""The page: verdicts, then the measurements side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from stickslip.geometry.dolfinx_versions import DOLFINX
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.lab.studies.block_price.cases import AS_EXACT, EXACT, METHODS, REFERENCE, TOLERANCE
from stickslip.workflows.lab.studies.block_price.verdicts import CLAIMS, done
from stickslip.workflows.lab.studies.published.finding import Finding, Row, Rows, chosen, different, slopes
from stickslip.workflows.lab.studies.published.tables import judged, markdown, pivot

NAME = "block_uzawa_price.md"
BUSY = 0.9  # share of a core below which seconds are not those of the method alone
INTRODUCTION = f"""# The price of the method as published

`block-uzawa` is the method of N. Pop, *On the inexact Uzawa methods for saddle point problems arising from contact
problem* (1999): Uzawa's iteration on the assembled blocks of the volume and of λ. The condensed methods
(`condensed-newton`, `surface-uzawa`, `gram-uzawa`, `uzawa`) solve the same problem on the contact surface alone. This
page lays them side by side on the same meshes, and says what the measurements show of the source's claims. No number
and no verdict is typed by hand:
`python -m stickslip.workflows.lab.studies.block_price --page docs/{NAME}` writes the page.

**Scenes.** `block` (2D, 4 m x 2 m) and `cube` (3D, 1 m), E = 1 Pa, quadrilaterals and hexahedra, n cells over the
height, so that h = height / n. The top is pressed down, then dragged sideways. If nothing else is said: unilateral
contact, Coulomb's friction with mu = 0.3, two steps, tolerance {TOLERANCE:g}.

**Methods.** `mass`: Q = W, no preconditioner. `gram`: Q from the Cholesky factor of the volume's Gram matrix of H1:
complete, with a drop tolerance of 1e-3, or without fill (`ic0`). Inner solves are exact (MUMPS, one factor for all), or
`inexact`: conjugate gradients with multigrid, stopped at 0.3 of the outer residual.

**Columns.** Numbers are those of all steps together. *For λ₁*: further volume solves that find the step size
α = 1.5/λ₁; other volume solves do not include them. *CG*: inner conjugate gradient iterations. *Prepare*: factorise or
set up multigrid, and what the method prepares; meshing and assembly of the stiffness are not in it. *Ratio*: prepare
and iterate, divided by the time of `{REFERENCE}` for the same problem. *Errors* are those at the end, against
`{REFERENCE}` at tolerance {EXACT:g} on the same mesh: of λ at the nodes where s > 0, the largest one and the root of
the mean square, weighted with the nodes' areas; of u in the energy norm, relative. Memory is not measured here, but by
`python -m stickslip.workflows.lab.benchmarks.price`."""
SECTIONS: Mapping[str, tuple[str, str]] = {
    "h": ("Against the mesh size", "Two steps, mu = 0.3."),
    "mu": ("Against friction", "Two steps."),
    "c_n": (
        "Against the normal compliance",
        "p_n = c_n (u_n - g)_+, c_n in E/L, L the height: from weak to stiff. With compliance F is not linear, and "
        "every step of its Newton iteration is a volume solve.",
    ),
    "steps": ("One big step, or two", "Pressed and dragged in one step, beside the same in two."),
    "alpha": (
        "The bound on α",
        "Iterations, exact inner solves. Glued: bilateral contact that never slips, so that nothing is projected.",
    ),
    "inner": (
        "Against the inner tolerance",
        "elman-golub: relative to the outer residual; bramble-pasciak-vassilev: to the residual at the start of the "
        f"inner solve, {AS_EXACT[1]:g} standing for an exact one.",
    ),
}
HEADS = ("method", "iterations", "volume solves", "for λ₁", "CG", "prepare [s]", "iterate [s]", "ratio")
ERRORS = ("λ, largest", "λ, mean", "u")


def write_page(path: Path, rows: Rows) -> Path:
    """Write the page; its path."""
    parts = [INTRODUCTION, conditions(rows), "## What the measurements say", verdicts(rows)]
    for table, (title, words) in SECTIONS.items():
        parts += [f"## {title}", words, *TABLES[table](rows[table])]
    write_aside(path, ("\n\n".join(parts) + "\n").encode())
    return path


def verdicts(rows: Rows) -> str:
    """Every claim with its verdict and the numbers behind it."""
    return judged(CLAIMS, rows, verdict)


def verdict(found: Finding) -> str:
    """The verdict; where few cases differ, these.

    >>> verdict(Finding({"2D": True, "3D": True, "glued": False}, ""))
    'holds, but not for glued'
    """
    lost = [case for case, true in found.cases.items() if not true]
    if lost and len(lost) < len(found.cases) - len(lost):
        return f"holds, but not for {'; '.join(lost)}"
    return found.verdict


def conditions(rows: Rows) -> str:
    """How the page was measured, and whether something else used the core."""
    measured = [row for table in rows.values() for row in table if done(row)]
    wall = sum(row["wall"] for row in measured)
    share = sum(row["cpu"] for row in measured) / wall if wall else 1.0
    words = (
        f"**Conditions.** dolfinx {DOLFINX}, one process, one thread; runs under half a second are the best of three."
    )
    if share < BUSY:
        words += f" The machine was busy: the runs got {share:.0%} of a core. Read seconds with care; counts are exact."
    return words


def table(rows: Sequence[Row], beside: Sequence[Row], heads: Mapping[str, Callable[[Row], str]]) -> Iterator[str]:
    """All columns of the rows; a row without an answer says why, below.

    Args:
        beside: rows among which those of the reference are.
        heads: further columns on the left.
    """
    lines, notes = [], list[str]()
    for row in rows:
        left = [*(cell(row) for cell in heads.values()), row["method"]]
        if done(row):
            lines.append([*left, *_numbers(row, beside)])
            continue
        stopped = row["status"].startswith("stopped")
        lines.append([*left, row["status"] if stopped else "fails", *[""] * (len(HEADS) + len(ERRORS) - 2)])
        if not stopped:
            notes.append(f"* {', '.join(left)} fails: {row['status']}")
    yield markdown([*heads, *HEADS, *ERRORS], lines)
    if notes:
        yield "\n".join(notes)


def _numbers(row: Row, beside: Sequence[Row]) -> list[str]:
    same = {key: row[key] for key in ("dim", "n", "mu", "c_n", "steps", "sticks")}
    reference = [other for other in chosen(beside, method=REFERENCE, **same) if done(other)]
    ratio = f"{row['seconds'] / reference[0]['seconds']:.3g}" if reference else ""
    counts = [str(row[key]) for key in ("iterations", "volume_solves", "for_lambda_1", "linear_iterations")]
    times = [f"{row[key]:.2g}" for key in ("prepare", "iterate")]
    return [*counts, *times, ratio, *(_error(row[key]) for key in ("lam_max", "lam_l2", "u_error"))]


def _error(value: float) -> str:
    """
    >>> _error(2.34e-7), _error(0.0)
    ('2e-07', '0')
    """
    return f"{value:.0e}" if value else "0"


def _by_mesh(rows: list[Row]) -> Iterator[str]:
    yield "Iterations; in the last columns the slope of log(iterations) against log(1/h) between the two finest meshes:"
    grown = {method: slopes(rows, "iterations", method=method) for method in different(rows, "method")}
    shown = [row | {"column": f"{row['dim']}D n = {row['n']}", "cell": _iterations(row)} for row in rows]
    for dim in different(rows, "dim"):
        column = f"{dim}D slope"
        for method, by_dim in grown.items():
            slope = f"{by_dim[f'{dim}D']:.2f}" if f"{dim}D" in by_dim else ""
            shown.append({"method": method, "column": column, "cell": slope})
    yield pivot(shown, lambda r: [r["method"]], lambda r: r["column"], lambda r: r["cell"], ["method"])
    for dim, n in dict.fromkeys((row["dim"], row["n"]) for row in rows):
        found = chosen(rows, dim=dim, n=n)
        size = next((f", {r['dofs']} unknowns, {r['points']} nodes that can touch" for r in found if done(r)), "")
        yield f"### {dim}D, n = {n}{size}"
        yield from table(found, rows, {})


def _by(key: str, show: Callable[[Row], str]) -> Callable[[list[Row]], Iterator[str]]:
    def shown(rows: list[Row]) -> Iterator[str]:
        for dim, n in dict.fromkeys((row["dim"], row["n"]) for row in rows):
            found = chosen(rows, dim=dim, n=n)
            yield f"### {dim}D, n = {n}"
            values = different(found, key)
            in_order = sorted(found, key=lambda row: (METHODS.index(row["method"]), values.index(row[key])))
            yield from table(in_order, rows, {key.replace("_", " ") if key != "c_n" else "c_n L/E": show})

    return shown


def _by_alpha(rows: list[Row]) -> Iterator[str]:
    def line(row: Row) -> list[str]:
        return [row["method"], "glued" if row["sticks"] else f"mu = {row['mu']:g}"]

    yield pivot(rows, line, lambda r: f"αλ₁/2 = {r['part']:g}", _iterations, ["method", "base"])


def _by_inner(rows: list[Row]) -> Iterator[str]:
    def rule(row: Row) -> str:
        return row["rule"] if "inexact" in row["method"] else "exact"

    def share(row: Row) -> str:
        return f"{row['share']:g}" if "inexact" in row["method"] else ""

    for dim, n in dict.fromkeys((row["dim"], row["n"]) for row in rows):
        yield f"### {dim}D, n = {n}"
        yield from table(chosen(rows, dim=dim, n=n), rows, {"rule": rule, "tolerance": share})


def _iterations(row: Row) -> str:
    if done(row):
        return str(row["iterations"])
    return "stopped" if row["status"].startswith("stopped") else "fails"


TABLES: Mapping[str, Callable[[list[Row]], Iterator[str]]] = {
    "h": _by_mesh,
    "mu": _by("mu", lambda row: f"{row['mu']:g}"),
    "c_n": _by("c_n", lambda row: f"{row['c_n']:g}"),
    "steps": _by("steps", lambda row: str(row["steps"])),
    "alpha": _by_alpha,
    "inner": _by_inner,
}
