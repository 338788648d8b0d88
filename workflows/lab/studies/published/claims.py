"""Claims of the source, and the functions that judge them by measured rows.

Sections 1 and 5: bound on alpha, inexact inner solves, Gram matrix as preconditioner. Sections 1 and 4: Newton-Raphson
on contact elements, and its linear systems.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from stickslip.workflows.lab.studies.finding import (
    AS_MANY,
    Finding,
    Row,
    Rows,
    alike,
    beside,
    between,
    chosen,
    different,
    done,
    enough,
    free_of_h,
    grows,
    said,
    slope,
    slopes,
)
from stickslip.workflows.lab.studies.gram import READINGS
from stickslip.workflows.lab.studies.published.contact import PLAIN
from stickslip.workflows.lab.studies.published.tangent import CLASSICAL, DIRECT, INCOMPLETE, RELAXED, STABILISED

SYMMETRIC = 1e-12  # asymmetry due to rounding
OFF = 1e-6  # relative error above which rounding has spoilt a solution
FIRST_ORDER = 0.1  # tolerance of a slope of -1
SQUARABLE = 1e-7  # smallest residual whose square is above rounding
CONSTANT = 100.0  # of quadratic convergence, residuals relative to p_ref
SPOILT = 1e-3  # relative error above which a solution is useless
FEW = 100  # iterations
SAME = 0.01  # difference below which two factors count as equal


def bound(rows: Rows) -> Finding:
    """Without projection the bound is sharp: all runs below it converge, none above it."""
    cases, figures = {}, dict[str, float]()
    for C in different(rows["linear"], "C"):
        exact = chosen(rows["linear"], C=C, exact=True)
        cases[f"C = {C}"] = all((row["measured"] < 1) == (row["part"] < 1) for row in exact)
        figures |= {f"C = {C}, αλ₁/2 = {r['part']:g}: factor": r["measured"] for r in exact if 0.9 < r["part"] < 1.1}
    sticking = chosen(rows["step"], friction="stick")
    if sticking:
        cases["block, sticking"] = all((done(row)) == (row["part"] < 1) for row in sticking)
    return Finding(cases, said(figures, ".3g"))


def bound_with_friction(rows: Rows) -> Finding:
    """With Coulomb friction the source proves nothing; runs below the bound should converge."""
    found = enough(chosen(rows["step"], friction="coulomb"), "αλ₁/2 = {part:g}")
    return replace(found, figure=f"{found.figure}: not sharp")


def richardson(rows: Rows) -> Finding:
    """The factor is max |1 - alpha lambda|."""
    cases, worst = {}, 0.0
    for C in different(rows["linear"], "C"):
        off = [abs(row["measured"] - row["theory"]) for row in chosen(rows["linear"], C=C, exact=True)]
        cases[f"C = {C}"] = max(off) < SAME
        worst = max(worst, *off)
    return Finding(cases, f"measured and max |1 - αλ| differ by {worst:.1e} at most")


def inexact_bound(rows: Rows) -> Finding:
    """The same bound with inexact solves delta_k: every rule should converge at every fraction below 1."""
    inexact = [row for row in rows["linear"] if not row["exact"] and row["part"] < 1]
    cases = {
        rule: all(row["measured"] < 1 for row in chosen(inexact, inner=rule)) for rule in different(inexact, "inner")
    }
    bad = [row for row in inexact if not row["measured"] < 1]
    least = min((row["part"] for row in bad), default=None)
    figure = f"diverges from αλ₁/2 = {least:g} on" if least is not None else "none diverges"
    worst = max((row["measured"] for row in inexact), default=0.0)
    return Finding(cases, f"{figure}; largest factor {worst:.3g}")


def inexact_contact(rows: Rows) -> Finding:
    """As many outer iterations as with exact inner solves, on the block with friction."""
    cases, cost = {}, list[float]()
    for row in chosen(rows["inner"], method="inexact-uzawa"):
        exact = chosen(rows["h"], method="uzawa", dim=row["dim"], n=row["n"])
        if not exact or "iterations" not in exact[0]:
            continue
        name = f"{row['inner_rule']} {row['inner_tolerance']:g}"
        cases[name] = done(row) and row["iterations"] <= AS_MANY * exact[0]["iterations"]
        cost += [row["linear_iterations"] / row["volume_solves"]] if done(row) else []
    return Finding(cases, f"CG iterations an inner solve: {between(cost)}")


def condition_grows(rows: Rows) -> Finding:
    found = slopes(rows["spectrum"], "condition", metric=PLAIN)
    return grows(found, f"slope against n: {said(found)}")


def gram_is_free_of_h(rows: Rows) -> Finding:
    """The condition number does not depend on h: every choice of the Gram matrix, every factor."""
    by_reading = {reading: slopes(rows["spectrum"], "condition", metric=reading) for reading in READINGS}
    found = {f"{reading}, {dim}": value for reading, by_dim in by_reading.items() for dim, value in by_dim.items()}
    return free_of_h(found, f"slope: {said(found)}")


def gram_iterations(rows: Rows) -> Finding:
    found, plain = (slopes(rows["h"], "iterations", method=method) for method in ("gram-uzawa", "uzawa"))
    return free_of_h(found, f"slope against n: {said(found)}; of uzawa: {said(plain)}")


def gram_saves(rows: Rows) -> Finding:
    """Fewer iterations than without, mesh by mesh."""
    shares = beside(rows["h"], "gram-uzawa", "uzawa", "iterations")
    return Finding({mesh: share < 1 for mesh, share in shares.items()}, f"iterations beside uzawa's: {said(shares)}")


def superlinear(rows: Rows) -> Finding:
    """Superlinear: the contraction in the last tenth of the iterations is below half of that in the second tenth."""
    cases, figures = {}, dict[str, float]()
    for row in chosen(rows["chen"], status="converged"):
        r = row["history"]
        tenth = max(len(r) // 10, 1)
        first = 0 if len(r) < 20 else tenth
        early, late = (r[first + tenth] / r[first]) ** (1 / tenth), (r[-1] / r[-1 - tenth]) ** (1 / tenth)
        name = {"points": "Q_k = W", "jacobian": "Q_k = B V_k⁻¹Bᵀ"}[row["outer_metric"]]
        cases[name] = late < early / 2
        figures[f"{name}, {row['iterations']} iterations"] = late
    return Finding(cases, f"contraction towards the end: {said(figures)}")


def given_friction(rows: Rows) -> Finding:
    """The fixed point of problems with given friction."""
    cases = {f"mu = {row['mu']:g}": done(row) for row in rows["given"]}
    counts = {f"mu = {row['mu']:g}": row["iterations"] for row in rows["given"] if "iterations" in row}
    return Finding(cases, f"iterations: {said(counts, 'd')}")


def any_friction(rows: Rows) -> Finding:
    """Every coefficient of friction, method by method."""
    cases, failed = {}, list[str]()
    for method in different(rows["mu"], "method"):
        bad = [f"{r['mu']:g}" for r in chosen(rows["mu"], method=method) if not done(r)]
        cases[method] = not bad
        failed += [f"{method} at mu = {', '.join(bad)}"] if bad else []
    return Finding(cases, f"fails: {'; '.join(failed) or 'none'}")


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
            found[f"{form}, against n in {dim}D"] = slope(alike(chosen(direct, dim=dim), "n"), "n", "condition")
        found[f"{form}, against ω"] = slope(alike(direct, "omega_factor"), "omega_factor", "condition")
    known = {name: value for name, value in found.items() if value is not None}
    return grows(known, f"slope: {said(known)}")


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
        count = row["iterations"] if done(row) else None
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
            value = slope(alike(chosen(tangents, solver=solver, dim=dim), "n"), "n", "iterations")
            if value is not None and "ILU" in solver:
                found[f"{solver}, {dim}D"] = value
    return free_of_h(found, f"slope: {between(found.values())}")


def ilu_stands_penalties(rows: Rows) -> Finding:
    """No more iterations for large omega than for small ones, and a solution as exact as its residual of 1e-8."""
    cases, figures = {}, list[str]()
    for form in different(rows["tangent"], "form"):
        found = alike(chosen(rows["tangent"], form=form, solver=INCOMPLETE), "omega_factor")
        counts = [row["iterations"] if done(row) else np.inf for row in found]
        if len(counts) > 1:
            errors = [row["error"] or np.inf for row in found]
            cases[form] = max(counts) < np.inf and counts[-1] <= counts[0] and max(errors) < SPOILT
            told = (f"{count:g} (error {error:.0e})" for count, error in zip(counts, errors, strict=True))
            figures.append(f"{form}: {', '.join(told)}")
    return Finding(cases, f"iterations of {INCOMPLETE} to a residual of 1e-8, ω growing: {'; '.join(figures)}")


def _better(rows: Rows, kind: str) -> Finding:
    """It converges wherever ILU(0) does, and all these solves together take fewer iterations."""
    cases, figures = {}, list[str]()
    for form in different(rows["tangent"], "form"):
        found = chosen(rows["tangent"], form=form)
        plain = {_where(row): row for row in chosen(found, solver=INCOMPLETE, status="converged")}
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
