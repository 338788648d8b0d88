"""Claims of the source on its method, and the functions that judge them by the measurements."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from stickslip.workflows.lab.studies.block_price.measure import (
    AS_EXACT,
    BLOCK,
    CONDENSED,
    EXACTLY,
    FACTORS,
    INEXACT,
    LIKE,
    REFERENCE,
    Q,
)
from stickslip.workflows.lab.studies.finding import (
    AS_MANY,
    Finding,
    Row,
    Rows,
    beside,
    between,
    chosen,
    different,
    done,
    enough,
    free_of_h,
    grouped,
    grows,
    mesh_of,
    said,
    slopes,
)

SAME = 0.02  # relative difference up to which two runs are the same iteration
AGREES = {"lam_max": 1e-4, "u_error": 1e-6}  # at a tolerance of 1e-8
SIDE_BY_SIDE = ("h", "mu", "c_n", "steps")


def factor_is_slow(rows: Rows) -> Finding:
    """On the finest mesh, conjugate gradients with multigrid take less time than a factor, for every Q."""
    cases, ratios, failed = {}, dict[str, float](), list[str]()
    for mesh, found in finest(rows["h"]).items():
        for q in Q:
            exact, inexact = (_one(found, f"{BLOCK}, {q}{kind}") for kind in ("", INEXACT))
            name = f"{mesh}, {q}"
            if exact is None and inexact is None:
                continue
            cases[name] = exact is None or (inexact is not None and inexact["seconds"] < exact["seconds"])
            if exact and inexact:
                ratios[name] = inexact["seconds"] / exact["seconds"]
            else:
                failed.append(f"{name}: {'the factor' if exact is None else 'conjugate gradients'}")
    return Finding(cases, f"seconds by conjugate gradients over seconds by a factor: {said(ratios)}{_and(failed)}")


def direct_is_slow(rows: Rows) -> Finding:
    """The fastest method without a factor takes less time than condensed-newton, which condenses by a factor."""
    cases, ratios = {}, dict[str, float]()
    for mesh, direct, best in _beside_the_reference(rows, INEXACT):
        cases[mesh] = best is not None and best["seconds"] < direct["seconds"]
        if best is not None:
            ratios[mesh] = best["seconds"] / direct["seconds"]
    return Finding(cases, f"seconds of the fastest inexact {BLOCK} over those of {REFERENCE}: {said(ratios)}")


def incomplete_is_free_of_h(rows: Rows) -> Finding:
    return _free_of_h(rows, [f"gram {factor}" for factor in FACTORS if factor != "complete"])


def complete_is_free_of_h(rows: Rows) -> Finding:
    return _free_of_h(rows, ["gram complete"])


def mass_grows(rows: Rows) -> Finding:
    found = slopes(rows["h"], "iterations", method=EXACTLY[0])
    return grows(found, f"slope against 1/h: {said(found)}")


def gram_saves_iterations(rows: Rows) -> Finding:
    return _gram_saves(rows, "iterations")


def gram_saves_seconds(rows: Rows) -> Finding:
    return _gram_saves(rows, "seconds")


def inexact_is_as_fast(rows: Rows) -> Finding:
    """As many outer iterations as with exact inner solves, mesh by mesh; one that fails has not."""
    cases, ratios, failed = dict[str, bool](), list[float](), list[str]()
    for q in Q:
        for mesh, found in meshes(rows["h"]).items():
            exact, inexact = (_one(found, f"{BLOCK}, {q}{kind}") for kind in ("", INEXACT))
            if exact is None:
                continue
            ratio = inexact["iterations"] / exact["iterations"] if inexact else None
            cases[q] = cases.get(q, True) and ratio is not None and ratio <= AS_MANY
            if ratio is None:
                failed.append(f"{q}, {mesh}")
            else:
                ratios.append(ratio)
    return Finding(cases, f"outer iterations over those with exact solves: {between(ratios)}{_and(failed)}")


def inexact_saves(rows: Rows) -> Finding:
    """Fewer conjugate gradient iterations than with inner solves to 1e-8."""
    cases, figures = {}, list[str]()
    for name, found in _inner(rows).items():
        wholes = [row for row in chosen(found, rule=AS_EXACT[0], share=AS_EXACT[1]) if done(row)]
        usuals = chosen(found, rule="elman-golub", share=0.3)
        if not wholes or not usuals:
            continue
        whole, usual = wholes[0], usuals[0]
        cases[name] = done(usual) and usual["linear_iterations"] < whole["linear_iterations"]
        if done(usual):
            figures.append(f"{name}: {usual['linear_iterations']} for {whole['linear_iterations']}")
    return Finding(cases, f"conjugate gradient iterations: {'; '.join(figures)}")


def any_delta(rows: Rows) -> Finding:
    """Every inner tolerance converges."""
    cases, failed = {}, list[str]()
    for name, found in _inner(rows).items():
        bad = [f"{row['rule']} {row['share']:g}" for row in found if not done(row)]
        cases[name] = not bad
        failed += [f"{name}, {each}" for each in bad]
    return Finding(cases, f"fails: {'; '.join(failed) or 'none'}")


def bound(rows: Rows) -> Finding:
    """Base glued, a linear problem: all runs below the bound converge, none above it."""
    glued = chosen(rows["alpha"], sticks=True)
    cases = {f"αλ₁/2 = {row['part']:g}": done(row) == (row["part"] < 1) for row in glued}
    kept = [row["part"] for row in glued if done(row)]
    lost = [row["part"] for row in glued if not done(row)]
    return Finding(cases, f"αλ₁/2 that converge: {between(kept)}; that do not: {between(lost, '.3g')}")


def bound_with_friction(rows: Rows) -> Finding:
    """With Coulomb's law: all runs below the bound converge."""
    slipping = [row | {"q": _q(row["method"])} for row in chosen(rows["alpha"], sticks=False)]
    return enough(slipping, "{q}, αλ₁/2 = {part:g}")


def condensing_saves(rows: Rows) -> Finding:
    """condensed-newton takes less time than every block-uzawa, mesh by mesh."""
    cases, figures = {}, list[str]()
    for mesh, direct, best in _beside_the_reference(rows, BLOCK):
        cases[mesh] = best is None or direct["seconds"] < best["seconds"]
        if best is not None:
            solves, seconds = (best[key] / direct[key] for key in ("volume_solves", "seconds"))
            figures.append(f"{mesh}, {direct['dofs']} unknowns: {solves:.0f} and {seconds:.2g} ({_q(best['method'])})")
    many = f"the fastest {BLOCK}, in multiples of the volume solves and of the seconds of {REFERENCE}"
    return Finding(cases, f"{many}: {'; '.join(figures)}")


def twins_agree(rows: Rows) -> Finding:
    """The condensed form of the same iteration takes as many iterations, and less time."""
    cases, ratios = {}, list[str]()
    for twin, method in LIKE.items():
        found, counts = (beside(rows["h"], method, twin, key).values() for key in ("seconds", "iterations"))
        if found:
            cases[f"{twin}: as many iterations"] = all(abs(ratio - 1) <= SAME for ratio in counts)
            cases[f"{twin}: less time"] = all(ratio > 1 for ratio in found)
            ratios.append(f"{method} over {twin}: iterations {between(counts, '.3g')}, seconds {between(found, '.2g')}")
    return Finding(cases, "; ".join(ratios))


def all_agree(rows: Rows) -> Finding:
    """All methods end at the same λ and u."""
    done_rows = [row for row in side_by_side(rows) if done(row) and row.get("u_error") is not None]
    cases, figures = {}, list[str]()
    for key, limit in AGREES.items():
        worst = max(done_rows, key=lambda row: float(row[key]), default=None)
        if worst is not None:
            name = {"lam_max": "λ", "u_error": "u"}[key]
            cases[name] = worst[key] <= limit
            figures.append(f"largest error of {name} {worst[key]:.1e} ({worst['method']}, {worst['dim']}D)")
    return Finding(cases, "; ".join(figures))


def always_converges(rows: Rows) -> Finding:
    """Every friction, stiffness, mesh and number of steps is solved within the time limit."""
    cases, failed = {}, list[str]()
    for method in different(side_by_side(rows), "method"):
        if method in CONDENSED:
            continue
        bad = [row for row in chosen(side_by_side(rows), method=method) if not done(row)]
        cases[method.removeprefix(f"{BLOCK}, ")] = not bad
        failed += [f"{_q(method)}: {len(bad)}" for _ in bad[:1]]
    return Finding(cases, f"measurements that fail or are stopped: {'; '.join(failed) or 'none'}")


def side_by_side(rows: Rows) -> list[Row]:
    """Rows of the tables that show all methods, each once."""
    keys = ("dim", "n", "method", "mu", "c_n", "steps")
    shown = (row for table in SIDE_BY_SIDE for row in rows[table])
    return [same[-1] for same in grouped(shown, lambda row: tuple(row[key] for key in keys)).values()]


def meshes(rows: Iterable[Row]) -> Mapping[str, list[Row]]:
    """Rows by mesh: "2D n = 8"."""
    return grouped(rows, mesh_of)


def finest(rows: Sequence[Row]) -> Mapping[str, list[Row]]:
    """Rows of the finest mesh of each dimension."""
    last = {dim: max(row["n"] for row in rows if row["dim"] == dim) for dim in different(rows, "dim")}
    return meshes([row for row in rows if row["n"] == last[row["dim"]]])


def _one(rows: Iterable[Row], method: str) -> Row | None:
    """The row of a method that converged."""
    return next((row for row in rows if row["method"] == method and done(row)), None)


def _beside_the_reference(rows: Rows, kind: str) -> Iterator[tuple[str, Row, Row | None]]:
    """Yield the reference on each mesh, and the fastest method whose name has a part; None if none converges."""
    for mesh, found in meshes(rows["h"]).items():
        solved = [row for row in found if kind in row["method"] and done(row)]
        if direct := _one(found, REFERENCE):
            yield mesh, direct, min(solved, key=lambda row: float(row["seconds"]), default=None)


def _free_of_h(rows: Rows, names: Sequence[str]) -> Finding:
    """The number of iterations with exact inner solves does not grow, between the two finest meshes that converge."""
    found = {
        f"{name}, {dim}": value
        for name in names
        for dim, value in slopes(rows["h"], "iterations", method=f"{BLOCK}, {name}").items()
    }
    return free_of_h(found, f"slope against 1/h: {said(found)}")


def _gram_saves(rows: Rows, key: str) -> Finding:
    """Less of it than with Q = W, on the finest mesh where both converge; exact inner solves."""
    shares = dict[str, float]()
    for dim in different(rows["h"], "dim"):
        for method in EXACTLY[1:]:
            found = beside(chosen(rows["h"], dim=dim), method, EXACTLY[0], key)
            shares |= {f"{mesh}, {_q(method)}": share for mesh, share in list(found.items())[-1:]}
    return Finding({name: share < 1 for name, share in shares.items()}, f"{key} over those with Q = W: {said(shares)}")


def _inner(rows: Rows) -> Mapping[str, list[Row]]:
    """Rows with inexact inner solves, by mesh and Q."""
    inexact = [row for row in rows["inner"] if row["method"].endswith(INEXACT)]
    return grouped(inexact, lambda row: f"{mesh_of(row)}, {_q(row['method']).removesuffix(INEXACT)}")


def _q(method: str) -> str:
    """
    >>> _q("block-uzawa, mass, inexact")
    'mass, inexact'
    """
    return method.removeprefix(f"{BLOCK}, ")


def _and(failed: Sequence[str]) -> str:
    return f"; fails: {'; '.join(failed)}" if failed else ""


def verdict(found: Finding) -> str:
    """The verdict; where few cases differ, these.

    >>> verdict(Finding({"2D": True, "3D": True, "glued": False}, ""))
    'holds, but not for glued'
    """
    lost = [case for case, true in found.cases.items() if not true]
    if lost and len(lost) < len(found.cases) - len(lost):
        return f"holds, but not for {'; '.join(lost)}"
    return found.verdict
