"""Claims of sections 1 and 4 of the source: Newton-Raphson on contact elements, and its linear systems."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from stickslip.workflows.lab.studies.published.finding import (
    FREE_OF_H,
    Claim,
    Finding,
    Row,
    Rows,
    between,
    chosen,
    different,
    said,
    slope,
)
from stickslip.workflows.lab.studies.published.tangent import CLASSICAL, DIRECT, PLAIN, RELAXED, STABILISED

SYMMETRIC = 1e-12  # asymmetry due to rounding
GROWS = 0.5  # log-log slope above which a quantity counts as growing
OFF = 1e-6  # relative error above which rounding has spoilt a solution
FIRST_ORDER = 0.1  # tolerance of a slope of -1
SQUARABLE = 1e-7  # smallest residual whose square is above rounding
CONSTANT = 100.0  # of quadratic convergence, residuals relative to p_ref
SPOILT = 1e-3  # relative error above which a solution is useless
FEW = 100  # iterations


def quadratic(rows: Rows) -> Finding:
    """Newton converges quadratically: the last step above rounding squares the residual, up to a constant."""
    cases, steps = {}, list[str]()
    for row in chosen(rows["newton"], status="converged"):
        steps_of = [pair for pair in pairwise(row["history"]) if pair[0] >= SQUARABLE]
        if not steps_of:
            continue
        before, last = steps_of[-1]
        cases[f"{row['dim']}D"] = last <= CONSTANT * before**2
        steps.append(f"{row['dim']}D {before:.1e} -> {last:.1e}")
    return Finding(cases, f"residual in the last step: {'; '.join(steps)}")


def first_order(rows: Rows) -> Finding:
    found = slope(rows["omega"], "omega_factor", "error")
    if found is None:
        return Finding({}, "")
    return Finding({"the error falls like 1/ω": abs(found + 1) < FIRST_ORDER}, f"slope {found:.3f}")


def stated(rows: Rows) -> Finding:
    """The stated error is not less than the true one."""
    done = chosen(rows["omega"], status="converged")
    cases = {f"ω h/E = {row['omega_factor']:g}": row["stated"] >= row["error"] for row in done}
    times = {f"{row['omega_factor']:g}": row["stated"] / row["error"] for row in done}
    return Finding(cases, f"stated beside true: {said(times)}")


def unsymmetric(rows: Rows) -> Finding:
    """The tangent is unsymmetric wherever a point slips."""
    direct = sorted(chosen(_direct(rows), form="displacements"), key=lambda row: float(row["mu"]))
    found = {f"mu = {row['mu']:g}": row["unsymmetry"] for row in direct}
    return Finding({mu: value > SYMMETRIC for mu, value in found.items()}, f"|K - Kᵀ|/|K|: {said(found)}")


def ill_conditioned(rows: Rows) -> Finding:
    """The condition number of the tangent grows."""
    found = {}
    for form in different(_direct(rows), "form"):
        direct = chosen(_direct(rows), form=form)
        for dim in sorted(set(different(direct, "dim"))):
            found[f"{form}, against n in {dim}D"] = slope(_alike(chosen(direct, dim=dim), "n"), "n", "condition")
        found[f"{form}, against ω"] = slope(_alike(direct, "omega_factor"), "omega_factor", "condition")
    known = {name: value for name, value in found.items() if value is not None}
    return Finding({name: value > GROWS for name, value in known.items()}, f"slope: {said(known)}")


def direct_is_slow(rows: Rows) -> Finding:
    """An incomplete factorisation is faster than MUMPS on the finest mesh."""
    cases, figures = {}, list[str]()
    for name, found in _finest(rows).items():
        fill = chosen(found, solver=DIRECT)[0]["fill"]
        timed = [r for r in found if r["solver"] != DIRECT and r.get("ratio")]
        best = min(timed, key=lambda r: r["ratio"], default=None)
        cases[name] = best is not None and best["ratio"] < 1
        told = "nothing else converges"
        if best is not None:
            told = f"{best['solver']} takes {best['ratio']:.2g} of its time, to an error of {best['error']:.0e}"
        figures.append(f"{name}: {told}, its factor has {fill:.2g} times the entries of K")
    return Finding(cases, "; ".join(figures))


def direct_is_wrong(rows: Rows) -> Finding:
    """Rounding spoils the solution of the direct solver."""
    done = [row for row in _direct(rows) if row.get("error") is not None]
    cases = {_where(row): row["error"] > OFF for row in done}
    worst = max((row["error"] for row in done), default=0.0)
    left = max((row["residual"] for row in done), default=0.0)
    return Finding(cases, f"largest error {worst:.1e}, residual {left:.1e}")


def classical_is_slow(rows: Rows) -> Finding:
    """More than a hundred iterations on the finest mesh, or no convergence."""
    cases, figures = {}, list[str]()
    for name, found in _finest(rows).items():
        (row,) = chosen(found, solver=CLASSICAL)
        count = row["iterations"] if row["status"] == "converged" else None
        cases[name] = count is None or count > FEW
        figures.append(f"{name}: {row['status'] if count is None else count}")
    return Finding(cases, f"Gauss-Seidel: {'; '.join(figures)}")


def relaxed(rows: Rows) -> Finding:
    return _better(rows, RELAXED)


def stabilised(rows: Rows) -> Finding:
    return _better(rows, STABILISED)


def ilu_is_free_of_h(rows: Rows) -> Finding:
    """Iterations of every preconditioned GMRES, displacements as unknowns."""
    tangents = chosen(rows["tangent"], form="displacements")
    found = {}
    for solver in different(tangents, "solver"):
        for dim in sorted(set(different(tangents, "dim"))):
            value = slope(_alike(chosen(tangents, solver=solver, dim=dim), "n"), "n", "iterations")
            if value is not None and "ILU" in solver:
                found[f"{solver}, {dim}D"] = value
    return Finding({name: abs(value) < FREE_OF_H for name, value in found.items()}, f"slope: {between(found.values())}")


def ilu_stands_penalties(rows: Rows) -> Finding:
    """No more iterations for large omega than for small ones, and a solution as exact as its residual of 1e-8."""
    cases, figures = {}, list[str]()
    for form in different(rows["tangent"], "form"):
        found = _alike(chosen(rows["tangent"], form=form, solver=PLAIN), "omega_factor")
        counts = [row["iterations"] if row["status"] == "converged" else np.inf for row in found]
        if len(counts) > 1:
            errors = [row["error"] or np.inf for row in found]
            cases[form] = max(counts) < np.inf and counts[-1] <= counts[0] and max(errors) < SPOILT
            told = (f"{count:g} (error {error:.0e})" for count, error in zip(counts, errors, strict=True))
            figures.append(f"{form}: {', '.join(told)}")
    return Finding(cases, f"iterations of {PLAIN} to a residual of 1e-8, ω growing: {'; '.join(figures)}")


def _better(rows: Rows, kind: str) -> Finding:
    """It converges wherever ILU(0) does, and all these solves together take fewer iterations."""
    cases, figures = {}, list[str]()
    for form in different(rows["tangent"], "form"):
        found = chosen(rows["tangent"], form=form)
        plain = {_where(row): row for row in chosen(found, solver=PLAIN, status="converged")}
        total = sum(row["iterations"] for row in plain.values())
        for solver in [s for s in different(found, "solver") if s.startswith(kind)]:
            own = [r for r in chosen(found, solver=solver, status="converged") if _where(r) in plain]
            lost, count = len(plain) - len(own), sum(row["iterations"] for row in own)
            name = f"{solver.removeprefix('GMRES, ')}, {form}"
            cases[name] = bool(plain) and not lost and count < total
            figures.append(f"{name}: {f'{lost} of {len(plain)} fail' if lost else f'{count} for {total}'}")
    return Finding(cases, f"iterations beside those of ILU(0): {'; '.join(figures)}")


def _direct(rows: Rows) -> list[Row]:
    return [row for row in chosen(rows["tangent"], solver=DIRECT) if "condition" in row]


def _where(row: Row) -> str:
    return f"{row['dim']}D n = {row['n']}, mu = {row['mu']:g}, ω h/E = {row['omega_factor']:g}, {row['form']}"


def _alike(rows: list[Row], key: str) -> list[Row]:
    """Rows that differ in one key only (the other parameters have their most frequent values), by rising key."""
    others = [k for k in ("dim", "n", "mu", "omega_factor") if k != key]
    kinds: dict[tuple[float, ...], dict[float, Row]] = {}
    for row in rows:
        kinds.setdefault(tuple(row[k] for k in others), {})[row[key]] = row
    best = max(kinds.values(), key=len, default={})
    return [best[value] for value in sorted(best)]


def _finest(rows: Rows) -> dict[str, list[Row]]:
    """All solvers on the largest system of each dimension and form that was solved by MUMPS."""
    found = {}
    for form in different(_direct(rows), "form"):
        for dim in sorted(set(different(_direct(rows), "dim"))):
            last = max(chosen(_direct(rows), dim=dim, form=form), key=lambda row: int(row["n"]), default=None)
            if last is not None:
                same = {key: last[key] for key in ("dim", "n", "mu", "omega_factor", "form")}
                found[f"{dim}D n = {last['n']}, {form}"] = chosen(rows["tangent"], **same)
    return found


TANGENT = (
    Claim("(4.4)-(4.5)", "Newton-Raphson on the perturbed Lagrangian converges quadratically in the end", quadratic),
    Claim("(4.3)", "the perturbed Lagrangian leads to contact itself as ω grows, in first order", first_order),
    Claim("(4.3)", "the error that perturbed-lagrangian states is no less than its true one", stated),
    Claim("§1", "the systems are nonsymmetric", unsymmetric),
    Claim(
        "§1", "the systems are ill-conditioned, the more the finer the mesh or the stiffer the springs", ill_conditioned
    ),
    Claim("§1", "direct methods are not efficient: GMRES with an incomplete factor is faster", direct_is_slow),
    Claim("§1", "ill-conditioning spoils the solutions of direct methods", direct_is_wrong),
    Claim("§1", "classical iterative methods converge badly", classical_is_slow),
    Claim("[5]", "relaxed ILU is better than ILU(0)", relaxed),
    Claim("[5]", "stabilised ILU is better than ILU(0)", stabilised),
    Claim("§1, [5]", "incomplete factors make GMRES's iterations independent of the mesh size", ilu_is_free_of_h),
    Claim("§1, [5]", "incomplete factors stand large penalties", ilu_stands_penalties),
)
