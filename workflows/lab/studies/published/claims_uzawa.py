"""Claims of sections 1 and 5 of the source: bound on alpha, inexact inner solves, Gram matrix as preconditioner."""

from __future__ import annotations

from stickslip.workflows.lab.studies.gram import READINGS
from stickslip.workflows.lab.studies.published.finding import (
    FREE_OF_H,
    Claim,
    Finding,
    Rows,
    between,
    chosen,
    different,
    said,
    slopes,
)
from stickslip.workflows.lab.studies.published.spectrum import PLAIN

SAME = 0.01  # difference below which two factors count as equal
GROWS = 0.5  # log-log slope above which a quantity counts as growing with 1/h
AS_MANY = 1.1  # ratio up to which two numbers of iterations count as equal


def bound(rows: Rows) -> Finding:
    """Without projection the bound is sharp: all runs below it converge, none above it."""
    cases, figures = {}, dict[str, float]()
    for C in different(rows["linear"], "C"):
        exact = chosen(rows["linear"], C=C, exact=True)
        cases[f"C = {C}"] = all((row["measured"] < 1) == (row["part"] < 1) for row in exact)
        figures |= {f"C = {C}, αλ₁/2 = {r['part']:g}: factor": r["measured"] for r in exact if 0.9 < r["part"] < 1.1}
    sticking = chosen(rows["step"], friction="stick")
    if sticking:
        cases["block, sticking"] = all((row["status"] == "converged") == (row["part"] < 1) for row in sticking)
    return Finding(cases, said(figures, ".3g"))


def bound_with_friction(rows: Rows) -> Finding:
    """With Coulomb friction the source proves nothing; runs below the bound should converge."""
    coulomb = chosen(rows["step"], friction="coulomb")
    cases = {f"αλ₁/2 = {row['part']:g}": row["status"] == "converged" for row in coulomb if row["part"] < 1}
    beyond = [f"{row['part']:g}" for row in coulomb if row["part"] > 1 and row["status"] == "converged"]
    return Finding(cases, f"beyond the bound it still converges at αλ₁/2 = {', '.join(beyond) or 'none'}: not sharp")


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
        cases[name] = row["status"] == "converged" and row["iterations"] <= AS_MANY * exact[0]["iterations"]
        cost += [row["linear_iterations"] / row["volume_solves"]] if row["status"] == "converged" else []
    return Finding(cases, f"CG iterations an inner solve: {between(cost)}")


def condition_grows(rows: Rows) -> Finding:
    found = slopes(rows["spectrum"], "condition", metric=PLAIN)
    return Finding({dim: value > GROWS for dim, value in found.items()}, f"slope against n: {said(found)}")


def gram_is_free_of_h(rows: Rows) -> Finding:
    """The condition number does not depend on h: every choice of the Gram matrix, every factor."""
    found = {
        f"{reading}, {dim}": value
        for reading in READINGS
        for dim, value in slopes(rows["spectrum"], "condition", metric=reading).items()
    }
    return Finding({name: abs(value) < FREE_OF_H for name, value in found.items()}, f"slope: {said(found)}")


def gram_iterations(rows: Rows) -> Finding:
    found = slopes(rows["h"], "iterations", method="gram-uzawa")
    plain = slopes(rows["h"], "iterations", method="uzawa")
    cases = {dim: abs(value) < FREE_OF_H for dim, value in found.items()}
    return Finding(cases, f"slope against n: {said(found)}; of uzawa: {said(plain)}")


def gram_saves(rows: Rows) -> Finding:
    """Fewer iterations than without, mesh by mesh."""
    cases, shares = {}, dict[str, float]()
    for row in chosen(rows["h"], method="gram-uzawa", status="converged"):
        plain = chosen(rows["h"], method="uzawa", dim=row["dim"], n=row["n"], status="converged")
        if plain:
            name = f"{row['dim']}D n = {row['n']}"
            shares[name] = row["iterations"] / plain[0]["iterations"]
            cases[name] = shares[name] < 1
    return Finding(cases, f"iterations beside uzawa's: {said(shares)}")


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
    cases = {f"mu = {row['mu']:g}": row["status"] == "converged" for row in rows["given"]}
    counts = {f"mu = {row['mu']:g}": row["iterations"] for row in rows["given"] if "iterations" in row}
    return Finding(cases, f"iterations: {said(counts, 'd')}")


def any_friction(rows: Rows) -> Finding:
    """Every coefficient of friction, method by method."""
    cases, failed = {}, list[str]()
    for method in different(rows["mu"], "method"):
        bad = [f"{r['mu']:g}" for r in chosen(rows["mu"], method=method) if r["status"] != "converged"]
        cases[method] = not bad
        failed += [f"{method} at mu = {', '.join(bad)}"] if bad else []
    return Finding(cases, f"fails: {'; '.join(failed) or 'none'}")


UZAWA = (
    Claim("§5, remarks", "Uzawa converges if and only if 0 < α < 2/λ₁", bound),
    Claim("§5, remarks", "0 < α < 2/λ₁ is enough with Coulomb's law and a projection", bound_with_friction),
    Claim("(5.4)-(5.5)", "Uzawa is Richardson's iteration on B K_B⁻¹Bᵀ − K_C", richardson),
    Claim("abstract, (1.2)", "A⁻¹ may be incomplete: the bound on α stays", inexact_bound),
    Claim("(1.2)", "inexact inner solves cost no outer iterations", inexact_contact),
    Claim("(1.3), [3]", "nonlinear Uzawa is superlinear (compliance, given friction)", superlinear),
    Claim("§5, end", "the condition number of B K_B⁻¹Bᵀ grows as h falls", condition_grows),
    Claim("§1", "an incomplete factor of the Gram matrix makes it independent of the mesh size", gram_is_free_of_h),
    Claim("§1, (5.6)", "preconditioned Uzawa takes as many iterations on any mesh (complete factor)", gram_iterations),
    Claim("§5, end", "the preconditioner overcomes the slow convergence", gram_saves),
    Claim("§5", "contact with any friction is solved (all methods)", any_friction),
    Claim("§3", "friction can be approximated by problems of given friction", given_friction),
)
