"""The verdicts of the study of the published methods: rows with the opposite outcome turn them round."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stickslip.workflows.lab.studies.published import claims as c
from stickslip.workflows.lab.studies.published.contact import PLAIN
from stickslip.workflows.lab.studies.published.finding import HOLDS, HOLDS_NOT, UNKNOWN, Finding, Row, Rows
from stickslip.workflows.lab.studies.published.measurements import MEASURED
from stickslip.workflows.lab.studies.published.page import CLAIMS, claims

EMPTY: Rows = {name: [] for name in MEASURED}


def part(value: float, measured: float, exact: bool = True) -> Row:
    inner = "exact" if exact else "inexact"
    return {"C": "0", "inner": inner, "exact": exact, "part": value, "measured": measured, "theory": 0.98}


def mesh(n: int, **more: Any) -> Row:
    return {"dim": 2, "n": n, "status": "converged"} | more


def counted(method: str, *iterations: int) -> list[Row]:
    return [mesh(4 * 2**i, method=method, iterations=count) for i, count in enumerate(iterations)]


def spectra(metric: str, *conditions: float) -> Rows:
    return {"spectrum": [mesh(4 * 2**i, metric=metric, condition=c) for i, c in enumerate(conditions)]}


def inner(iterations: int) -> Rows:
    keys = {"method": "inexact-uzawa", "inner_rule": "elman-golub", "inner_tolerance": 0.3}
    counts = {"iterations": iterations, "linear_iterations": 5, "volume_solves": 10}
    return {"inner": [mesh(4, **keys, **counts)], "h": counted("uzawa", 100)}


def falling(*factors: float) -> Rows:
    history = np.cumprod(np.repeat([1.0, *factors], 20)).tolist()
    return {"chen": [mesh(4, outer_metric="jacobian", iterations=len(history), history=history)]}


def system(solver: str, n: int = 8, **more: Any) -> Row:
    found = {
        "mu": 0.3,
        "omega_factor": 1e3,
        "form": "displacements",
        "solver": solver,
        "iterations": 10,
        "ratio": 1.0,
        "error": 1e-6,
    }
    about: Row = {
        "condition": 1e5,
        "unsymmetry": 0.1,
        "fill": 3.0,
        "error": 1e-10,
        "residual": 1e-15,
        "iterations": None,
    }
    return mesh(n) | found | (about if solver == c.DIRECT else {}) | more


def systems(*found: Row) -> Rows:
    return {"tangent": list(found)}


def two(solver: str, key: str, **values: tuple[Any, Any]) -> Rows:
    """Two systems that differ in n or ω."""
    at = (8, 16) if key == "n" else (1e2, 1e4)
    return systems(*(system(solver, **{key: at[i]}, **{name: v[i] for name, v in values.items()}) for i in (0, 1)))


def bounded(below: str, above: str, friction: str) -> Rows:
    found = [{"friction": friction, "part": 0.9, "status": below}, {"friction": friction, "part": 1.1, "status": above}]
    return {"step": found, "linear": []}


def springs(*errors: float, stated: float = 1.0) -> Rows:
    rows = [{"omega_factor": 10.0 ** (i + 1), "status": "converged", "error": e} for i, e in enumerate(errors)]
    return {"omega": [row | {"stated": stated} for row in rows]}


def ended(key: str, status: str) -> Rows:
    return {key: [mesh(8, method="uzawa", mu=0.3, iterations=3) | {"status": status}]}


OK, BAD = "converged", "the iterations ran out"
RELAXED, STABILISED = f"{c.RELAXED}0.9", f"{c.STABILISED}0.01"
FLIPS: list[tuple[Callable[[Rows], Finding], Rows, Rows]] = [
    (c.bound, {"linear": [part(0.99, 0.98), part(1.01, 1.02)], "step": []}, {"linear": [part(0.99, 1.02)], "step": []}),
    (c.bound, bounded(OK, BAD, "stick"), bounded(OK, OK, "stick")),
    (c.bound_with_friction, bounded(OK, OK, "coulomb"), bounded(BAD, OK, "coulomb")),
    (c.richardson, {"linear": [part(0.99, 0.981)]}, {"linear": [part(0.99, 0.9)]}),
    (c.inexact_bound, {"linear": [part(0.9, 0.99, False)]}, {"linear": [part(0.9, 1.01, False)]}),
    (c.inexact_contact, inner(105), inner(120)),
    (c.superlinear, falling(0.9, 0.4), falling(0.9, 0.9)),
    (c.condition_grows, spectra(PLAIN, 10, 20, 40), spectra(PLAIN, 10, 11, 10)),
    (c.gram_is_free_of_h, spectra("volume, complete", 9.4, 9.5), spectra("volume, complete", 9.4, 12)),
    (c.gram_iterations, {"h": counted("gram-uzawa", 80, 82)}, {"h": counted("gram-uzawa", 80, 120)}),
    (
        c.gram_saves,
        {"h": [*counted("gram-uzawa", 50), *counted("uzawa", 100)]},
        {"h": [*counted("gram-uzawa", 150), *counted("uzawa", 100)]},
    ),
    (c.any_friction, ended("mu", OK), ended("mu", BAD)),
    (c.given_friction, ended("given", OK), ended("given", BAD)),
    (c.quadratic, {"newton": [mesh(4, history=[1, 1e-4, 1e-7])]}, {"newton": [mesh(4, history=[1, 1e-4, 1e-5])]}),
    (c.first_order, springs(1e-1, 1e-2), springs(1e-1, 3e-2)),
    (c.stated, springs(0.9, 0.1), springs(1.1, 1.2)),
    (c.unsymmetric, systems(system(c.DIRECT)), systems(system(c.DIRECT, unsymmetry=1e-17))),
    (
        c.ill_conditioned,
        two(c.DIRECT, "n", condition=(1e5, 4e5)),
        two(c.DIRECT, "n", condition=(1e5, 1.1e5)),
    ),
    (
        c.direct_is_slow,
        systems(system(c.DIRECT), system(c.INCOMPLETE, ratio=0.5)),
        systems(system(c.DIRECT), system(c.INCOMPLETE, ratio=2.0)),
    ),
    (c.direct_is_wrong, systems(system(c.DIRECT, error=1e-3)), systems(system(c.DIRECT))),
    (
        c.classical_is_slow,
        systems(system(c.DIRECT), system(c.CLASSICAL, status="diverged")),
        systems(system(c.DIRECT), system(c.CLASSICAL)),
    ),
    (
        c.relaxed,
        systems(system(c.INCOMPLETE), system(RELAXED, iterations=9)),
        systems(system(c.INCOMPLETE), system(RELAXED, iterations=11)),
    ),
    (
        c.stabilised,
        systems(system(c.INCOMPLETE), system(STABILISED, iterations=9)),
        systems(system(c.INCOMPLETE), system(STABILISED, status="broke down")),
    ),
    (c.ilu_is_free_of_h, two(c.INCOMPLETE, "n", iterations=(20, 20)), two(c.INCOMPLETE, "n", iterations=(20, 40))),
    (
        c.ilu_stands_penalties,
        two(c.INCOMPLETE, "omega_factor", iterations=(20, 19)),
        two(c.INCOMPLETE, "omega_factor", iterations=(20, 30)),
    ),
    (
        c.ilu_stands_penalties,
        two(c.INCOMPLETE, "omega_factor", error=(1e-6, 1e-4)),
        two(c.INCOMPLETE, "omega_factor", error=(1e-6, 1e-2)),
    ),
    (
        c.quadratic,
        {"newton": [mesh(4, history=[1e-5, 1e-11, 1e-16])]},
        {"newton": [mesh(4, history=[1e-5, 2e-7, 1e-9])]},
    ),
]


@pytest.mark.parametrize(("judge", "so", "otherwise"), FLIPS, ids=lambda x: getattr(x, "__name__", ""))
def test_a_verdict_follows_from_the_rows(judge: Callable[[Rows], Finding], so: Rows, otherwise: Rows) -> None:
    assert judge({**EMPTY, **so}).verdict == HOLDS
    assert judge({**EMPTY, **otherwise}).verdict == HOLDS_NOT


def test_every_claim_is_tried_both_ways_and_none_is_decided_without_rows() -> None:
    assert {claim.judge for claim in CLAIMS} == {judge for judge, *_ in FLIPS}
    assert {claim.judge(EMPTY).verdict for claim in CLAIMS} == {UNKNOWN}
    assert claims(EMPTY).count(UNKNOWN) == len(CLAIMS)


def test_a_claim_that_holds_in_some_cases_says_in_which() -> None:
    both: Rows = {**EMPTY, "mu": [*ended("mu", OK)["mu"], *({"method": "other", **ended("mu", BAD)["mu"][0]},)]}
    both["mu"][1]["method"] = "other"
    assert c.any_friction(both).verdict == "holds only for uzawa"
