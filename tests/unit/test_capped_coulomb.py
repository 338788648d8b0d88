"""Friction law capped_coulomb: Coulomb's below its cap, Tresca's at it."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import sparse

from shared.audited import record_of
from shared.cases import every_nth
from stickslip.geometry.errors import SceneError
from stickslip.solvers.laws.capped_coulomb import CappedCoulomb
from stickslip.solvers.laws.compliance import Compliance
from stickslip.solvers.laws.law import NormalLaw
from stickslip.solvers.laws.unilateral import Unilateral
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.results.step_result import SLIP, STICK
from stickslip.solvers.scene.contact import Contact
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.stepping.stepper import StepError
from stickslip.workflows.lab.verification.cases import sheared_column
from stickslip.workflows.lab.verification.cases.sheared_column import K_T, PRESSURE, E, bases, compare, scene
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

MU, TOP = 0.3, sheared_column.TOP
NORMAL: list[NormalLaw] = [Unilateral(), Compliance(c_n=4.0, m_n=2.0)]
SHARES = sparse.csr_matrix([[0.7, 0.5, -0.2, 0.0], [0.0, -0.1, 0.4, 0.7]])  # dual functions are negative somewhere
NOW: dict[str, Any] = {"average": SHARES, "time": 1.0, "end": 1.0}


@pytest.mark.parametrize("normal", NORMAL)
def test_bound_is_that_of_coulomb_and_no_more_than_the_cap(normal: NormalLaw) -> None:
    p = np.array([1.0, 4.0, 9.0, 0.0])  # averages 0.9 and 3.2
    for s_max, expected in ((2.0, [0.45, 1.6]), (1.0, [0.45, 1.0]), (0.4, [0.4, 0.4])):
        assert_allclose(CappedCoulomb(mu=0.5, s_max=s_max).limit(p, normal=normal, **NOW), expected, rtol=1e-15)
    assert_array_equal(CappedCoulomb(mu=0.5, s_max=1.0).limit(-p, normal=normal, **NOW), 0.0)  # what pulls has none


@pytest.mark.parametrize("normal", NORMAL)
@pytest.mark.parametrize("s_max", [2.0, 1.0, 0.4])
def test_slope_of_the_bound_is_its_derivative(s_max: float, normal: NormalLaw) -> None:
    law, h = CappedCoulomb(mu=0.5, s_max=s_max), 1e-6
    for p in (np.array([1.0, 4.0, 9.0, 0.0]), np.array([-1.0, -4.0, 9.0, 1.0])):
        at = [[law.limit(p + sign * h * e, normal=normal, **NOW) for e in np.eye(4)] for sign in (1, -1)]
        slope = (np.array(at[0]) - np.array(at[1])).T / (2 * h)
        found = law.limit_slope(p, SHARES, normal).toarray()
        assert_allclose(found, slope, atol=1e-9)  # linear but at the kinks: eps / h


@pytest.mark.parametrize("normal", NORMAL)
def test_lines_are_the_bound_from_both_sides(normal: NormalLaw) -> None:
    law, alone = CappedCoulomb(mu=0.3, s_max=2.0), sparse.identity(50, format="csr")
    p = np.linspace(0.0, 20.0, 50)
    cap, below, above = law.lines(normal, 1.0, 1.0)
    s = law.limit(p, alone, normal, 1.0, 1.0)
    assert np.all(np.minimum(cap, below * p) <= s * (1 + 1e-15))
    assert np.all(s <= np.minimum(cap, above * p) * (1 + 1e-15))
    assert {np.isclose(cap, s.max()).item(), np.isclose(above, (s[1:] / p[1:]).max()).item()} == {True}


def test_nonsense_is_refused_by_key() -> None:
    for data, sentence in (
        ({"mu": -0.1, "s_max": 1.0}, r"mu = -0\.1: must not be negative"),
        ({"mu": 0.1, "s_max": 0.0}, r"s_max = 0\.0: must be positive, in pascal"),
        ({"mu": 0.1, "s_max": 1.0, "k_T": -1.0}, r"k_T = -1\.0: must be positive, in Pa/m"),
    ):
        with pytest.raises(SceneError, match=sentence):
            CappedCoulomb(**data)


@pytest.mark.parametrize(
    ("method", "cap", "k_T"),
    every_nth(2, ["condensed-newton", "uzawa", "surface-uzawa"], [(2.0, 2.0), (5.0, 3.0)], [None, K_T]),
)
def test_sheared_column_slips_at_the_cap_or_at_mu_p(method: str, cap: tuple[float, float], k_T: float | None) -> None:
    s_max, bound = cap
    law = CappedCoulomb(mu=MU, s_max=s_max, k_T=k_T)
    states = bases(scene(dim=2, method=method, E=E, friction=law, path=TOP[:, None]))
    exact = replace(sheared_column.COLUMN, bound=bound, k_T=k_T or np.inf)
    assert not failures(compare("capped", states, PRESSURE, exact, TOP))  # traction, slip, dissipation: within 1e-9
    assert_allclose(states[2].tangential_force, bound, rtol=1e-9)  # steady slip over 1 m: 2 or 3 N
    assert np.all(states[1].status == STICK)
    assert np.all(states[2].status == SLIP)
    assert failures(compare("without the law", states, PRESSURE, replace(exact, bound=1.1 * bound), TOP))


def test_without_friction_the_column_fails() -> None:
    states = bases(
        scene(dim=2, method="condensed-newton", E=E, friction=CappedCoulomb(mu=0.0, s_max=2.0), path=TOP[:, None])
    )
    checks = compare("smooth", states, PRESSURE, replace(sheared_column.COLUMN, bound=2.0), TOP)
    assert {check.name for check in checks if check.passed} == {
        "smooth: pressure [Pa]",
        "smooth, top at +1 mm (move 1): dissipation so far [J]",  # a move that only sticks dissipates nothing either
    }


@pytest.mark.parametrize("dim", [2, 3])
def test_a_block_is_capped_where_it_presses_hard_and_follows_mu_p_where_it_does_not(dim: int) -> None:
    """Bent by the drag, one end presses harder: both branches of the law at once, audited."""
    mu, s_max, up = 0.3, 0.03, "xyz"[dim - 1]
    width = {"width": 1.0} if dim == 3 else {}
    drive = {"x": [[0, 0], [1, 0], [2, 0.2]], up: [[0, 0], [1, -0.08]]}
    data = {
        "model": "plane strain" if dim == 2 else "3d",
        "geometry": {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.25} | width,
        "bodies": {"block": {"E": 1.0, "nu": 0.3}},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}},
        "contacts": {
            "base": {
                "surface": "block.bottom", "against": "floor",
                "friction": {"law": "capped_coulomb", "mu": mu, "s_max": s_max},
            }
        },
        "supports": {"top": {"boundary": "block.top", "displacement": drive}},
        "steps": {"end": 2.0, "count": 4},
        "solver": {"tolerance": 1e-11},
    }  # fmt: skip
    simulation = prepare(from_dict(data))
    audit = Auditor(simulation.problem, simulation.mesh)
    for step in simulation.steps():
        record = record_of(step)
        assert max(asdict(audit(record)).values()) < 1e-9
    base = step.contacts["base"]
    capped, slipping = mu * base.pressure > s_max, base.status == SLIP
    traction = np.linalg.norm(base.traction, axis=1)
    assert min(np.sum(capped & slipping), np.sum(~capped & slipping)) > 2
    assert_allclose(traction[slipping], np.minimum(mu * base.pressure, s_max)[slipping], rtol=1e-9)


def test_a_floating_block_rests_below_the_cap_and_there_is_no_equilibrium_beyond_it() -> None:
    """Pressed by 0.2 Pa over 2 m: mu p = 0.06 Pa, a cap of 0.05 Pa holds 0.1 N."""

    def plan(force: float) -> str | None:
        data = {
            "model": "plane strain",
            "geometry": {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5},
            "bodies": {"block": {"E": 1.0, "nu": 0.3}},
            "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
            "contacts": {
                "base": {
                    "surface": "block.bottom", "against": "floor",
                    "friction": {"law": "capped_coulomb", "mu": MU, "s_max": 0.05},
                }
            },
            "loads": {
                "press": {"boundary": "block.top", "pressure": 0.2},
                "pull": {"boundary": "block.bottom", "traction": [force / 2.0, 0.0]},
            },
        }  # fmt: skip
        found = from_dict(data)
        make_plan(found)
        try:
            *_, step = prepare(found).steps()
        except StepError as error:
            return str(error)
        assert_allclose(step.contacts["base"].force[0], -force, rtol=1e-8)
        return None

    assert plan(0.098) is None
    assert "contact and friction cannot balance the loads" in (plan(0.102) or "")


def test_contact_takes_it_and_no_friction_is_what_resists_not() -> None:
    law = CappedCoulomb(mu=0.3, s_max=1.0)
    assert Contact(surface="block.bottom", against="floor", friction=law).tangential is law
    assert law.resists()
    assert not CappedCoulomb(mu=0.0, s_max=1.0).resists()
