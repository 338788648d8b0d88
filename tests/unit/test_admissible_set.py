"""Admissible tractions, and discrete problems of many points that obey them."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import sparse

from shared.discrete import ONE, random_problem
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError
from stickslip.solvers.classical.nsgs import colours
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.contact.rows import Fields
from stickslip.solvers.interface.discrete import DiscreteProblem, discrete_problem, project_cone, residual
from stickslip.solvers.iteration import Status
from stickslip.solvers.laws.friction import CappedCoulomb, Coulomb, OrthotropicCoulomb, Stick, Tresca
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw
from stickslip.solvers.laws.normal import Bilateral, Compliance, Tied, Unilateral
from stickslip.solvers.laws.rate_dependent import RateDependent
from stickslip.solvers.laws.tangential_compliance import TangentialCompliance
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.stepping.discrete_chain import refuse_unusable, solve, usable

Laws = tuple[NormalLaw, FrictionLaw | None]
SOFT = Compliance(c_n=4.0)


@cache
def rows_of(points: int, dim: int) -> Any:
    size = points * dim
    (rows,) = discrete_problem(sparse.identity(size, format="csr"), np.ones(size), np.ones(points)).cone.contacts
    return rows


def cone(*contacts: tuple[int, int, NormalLaw, FrictionLaw | None], time: float = 0.5) -> AdmissibleSet:
    """Contacts of so many points, in so many dimensions, with these laws; the last time is 1."""
    return AdmissibleSet(tuple(replace(rows_of(m, d), normal=n, friction=f) for m, d, n, f in contacts), time, 1.0)


def test_normal_rows_come_first_then_the_tangential_ones_of_each_contact() -> None:
    both = cone((2, 3, Unilateral(), None), (4, 3, Unilateral(), Coulomb(mu=0.3, k_T=2.0)))
    spans = [(place.normal.start, place.normal.stop, place.tangential.start, place.tangential.stop)
             for place in both.places]  # fmt: skip
    assert spans == [(0, 2, 6, 10), (2, 6, 10, 18)]
    assert both.size == 18
    assert [place.components for place in both.places] == [2, 2]
    assert [place.rows.friction for place in both.with_friction()] == [Coulomb(mu=0.3, k_T=2.0)]
    assert_array_equal(both.softness, np.repeat([0.0, 0.5], [10, 8]))
    assert both.carrying.all()
    later = both.at(0.8)
    assert (later.time, later.end, later.contacts) == (0.8, 1.0, both.contacts)


HOMOGENEOUS: Mapping[str, tuple[Laws, bool]] = {
    "unilateral": ((Unilateral(), None), True),
    "bilateral": ((Bilateral(), None), True),
    "tied": ((Tied(), None), True),
    "compliance": ((SOFT, None), True),
    "compliance, m_n = 1.5": ((Compliance(c_n=4.0, m_n=1.5), None), False),
    "coulomb": ((Unilateral(), Coulomb(mu=0.3, k_T=2.0)), True),
    "tresca": ((Unilateral(), Tresca(bound=1.0)), False),
    "capped": ((Unilateral(), CappedCoulomb(mu=0.3, s_max=0.1)), False),
    "stick": ((Unilateral(), Stick()), True),
    "penetration": ((SOFT, TangentialCompliance(c_T=1.0)), True),
    "penetration, m_T = 2": ((SOFT, TangentialCompliance(c_T=1.0, m_T=2.0)), False),
}


@pytest.mark.parametrize(("laws", "expected"), HOMOGENEOUS.values(), ids=HOMOGENEOUS)
def test_laws_in_proportion_are_known(laws: Laws, expected: bool) -> None:
    """As they say; and if so, twice the trial has twice the projection."""
    found, gamma = cone((2, 3, *laws), (3, 3, Unilateral(), None)), np.linspace(0.5, 2.0, 15)
    assert found.homogeneous is expected
    assert cone((3, 3, Unilateral(), None), (2, 3, *laws)).homogeneous is expected  # whichever comes first
    trial = np.random.default_rng(0).normal(size=15) * 3
    twice, once = found.project(2 * trial, gamma), found.project(trial, gamma)
    assert np.allclose(twice, 2 * once) is expected


@pytest.mark.parametrize("pascal", [1.0, 1e-6])
def test_so_they_are_in_every_unit_of_pressure(pascal: float) -> None:
    """Stiff surfaces, whose penetrations at 1 Pa and at 2 Pa both are next to nothing in metres."""
    straight, curved = Compliance(c_n=1e13 * pascal), Compliance(c_n=1e16 * pascal, m_n=2.0)
    bounds = [TangentialCompliance(c_T=3e17 * pascal, m_T=m_T) for m_T in (1.0, 2.0)]
    laws = product([straight, curved], [None, Coulomb(mu=0.3), *bounds])
    found = [cone((2, 3, *each)).homogeneous for each in laws]
    assert found == [True, True, True, False, *4 * [False]]
    assert [s.homogeneous(n, 1.0, 1.0) for n in (straight, curved) for s in bounds] == [True, False, False, True]


def test_what_a_new_compliant_law_does_not_say_is_not_assumed() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Cushion(Compliance):
        power = NormalLaw.power

    assert not cone((2, 3, Cushion(c_n=4.0), None)).homogeneous


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("k_T", [None, 2.0])
@pytest.mark.parametrize("by_rate", [False, True])
@pytest.mark.parametrize("normal", [Unilateral(), SOFT, Bilateral()])
def test_solutions_of_laws_are_fixed_points_without_residual(
    normal: NormalLaw, by_rate: bool, k_T: float | None, dim: int
) -> None:
    """A point that is open, one that sticks, one that slips, beside a contact without friction."""
    table = ((0.0, 0.48), (0.7 / 0.5, 0.5), (7.0 / 0.5, 0.68))  # 0.5 at 0.7 m in 0.5 s
    law = RateDependent(mu=table, k_T=k_T).within(np.zeros(3), 0.5)
    both = cone((1, dim, Unilateral(), None), (3, dim, normal, law if by_rate else Coulomb(mu=0.5, k_T=k_T)))
    n, (_, place) = 4, both.places
    p, r = np.zeros(both.size), np.zeros(both.size)
    p[:n], r[:n] = [2.0, 0.0, 4.0, 6.0], [0.0, -1.0, 0.0, 0.0]
    if normal.sides == 2:
        r[1] = 0.0
    t, slip = p[place.tangential].reshape(3, dim - 1), r[place.tangential].reshape(3, dim - 1)
    way = np.array([1.0]) if dim == 2 else np.array([0.6, -0.8])
    t[1], t[2], slip[2] = 1.9 * way, 3.0 * way, 0.7 * way
    p[place.tangential], r[place.tangential] = t.ravel(), slip.ravel()
    r[place.tangential] += p[place.tangential] * (0.0 if k_T is None else 1 / k_T)
    if normal is SOFT:
        r[2:n] = p[2:n] / 4.0
    gamma = np.linspace(0.5, 2.0, n)
    gamma = np.concatenate([gamma, np.ones(dim - 1), np.repeat(gamma[1:], dim - 1)])
    assert_allclose(both.project(p + gamma * r, gamma), p, atol=1e-14)
    for each in (gamma, 1.5):
        assert_allclose(both.natural_residual(p, r, each), 0.0, atol=1e-14)
    assert_allclose(both.bound(place, p[place.normal]), (0.48 if by_rate else 0.5) * p[place.normal])
    open_slip = r.copy()
    open_slip[place.tangential][: dim - 1] = 5.0  # nothing resists where it is open
    assert_allclose(both.natural_residual(p, open_slip, gamma), 0.0, atol=1e-14)


@pytest.mark.parametrize(
    ("p", "r", "expected"),
    [
        ((-1.0, 0.0), (-1.0, 0.0), (-1.0, 0.0)),  # suction
        ((1.0, 0.0), (-0.25, 0.0), (0.5, 0.0)),  # pressure across a gap
        ((2.0, 0.0), (0.5, 0.0), (-1.0, 0.0)),  # penetration
        ((2.0, 1.5), (0.0, 0.0), (0.0, 0.5)),  # beyond the bound, 1
        ((2.0, 0.5), (0.0, 0.1), (0.0, -0.2)),  # slip below the bound
        ((2.0, 1.0), (0.0, 0.5), (0.0, 0.0)),  # slip at the bound
        ((2.0, 1.0), (0.0, -1.0), (0.0, 2.0)),  # slip against the traction
    ],
)
def test_residual_is_the_traction_that_is_wrong(p: Any, r: Any, expected: Any) -> None:
    found = cone((1, 2, Unilateral(), Coulomb(mu=0.5)))
    assert_allclose(found.natural_residual(np.array(p), np.array(r), 2.0), expected, atol=1e-15)


def test_give_and_energy_are_those_of_the_springs() -> None:
    found = cone((2, 3, SOFT, Coulomb(mu=0.5, k_T=2.0)))
    p: Array = np.array([8.0, 0.0, 1.0, -2.0, 0.0, 3.0])
    assert_allclose(found.give(p), [2.0, 0.0, 0.5, -1.0, 0.0, 1.5])
    assert_allclose(found.energy(p), [8.0, 0.0, 0.25, 1.0, 0.0, 2.25])


def test_bounds_follow_the_time() -> None:
    found = cone((2, 2, Unilateral(), Tresca(bound=4.0)))
    (place,) = found.places
    at: Callable[[AdmissibleSet], Array] = lambda cone: cone.bound(place, np.array([1.0, 0.0]))  # noqa: E731
    assert_array_equal(at(found), [2.0, 0.0])  # half way to the end
    assert_array_equal(at(found.at(0.25)), [1.0, 0.0])
    slope = cone((2, 2, Unilateral(), Coulomb(mu=0.4))).bound_slope(place, np.array([1.0, 0.0]))
    assert_array_equal(slope.toarray(), 0.0)  # of the block's own law
    maps = dict.fromkeys(("to_nodes", "to_points", "to_tangential"), sparse.identity(2))
    fields = Fields(gap_offset=((0.0, 1.0), (1.0, 3.0)), law=None, points=np.zeros((2, 2)), end=1.0, **maps)
    rows = replace(place.rows, fields=fields, time=0.5)
    (later,) = AdmissibleSet((rows,), 0.5, 1.0).at(1.0).contacts
    assert_array_equal(later.gap - rows.gap, 1.0)  # from 2 m to 3 m


def test_a_point_gives_its_bound_to_the_nodes_that_it_stands_for() -> None:
    found = cone((1, 3, SOFT, None), (2, 3, Unilateral(), Coulomb(mu=0.5)))
    place = found.places[1]
    p = np.array([9.0, 4.0, 2.0, *(7.0, 7.0), 1.0, 0.0, 0.0, 1.0])
    assert_allclose(found.bound_at_nodes(place, p), [2.0, 1.0])
    share = sparse.csr_matrix([[0.25, 0.75], [0.75, 0.25]])
    shared = replace(place, rows=replace(place.rows, share_t=share))
    at_points = [0.25 * 2.0 + 0.75 * 1.0, 0.75 * 2.0 + 0.25 * 1.0]  # its mean pressure is that of these nodes, too
    assert_allclose(found.bound_at_nodes(shared, p), share.T @ at_points)


def test_along_and_across_grooves_it_is_that_of_the_direction_of_the_traction() -> None:
    law = OrthotropicCoulomb(mu_1=0.2, mu_2=0.5, axis=(1.0, 0.0, 0.0))
    found = cone((3, 3, Unilateral(), law))
    (place,) = found.places
    tangents = law.directions(np.tile(np.eye(3)[:2], (3, 1, 1)), np.ones((3, 2), dtype=bool))
    turned = replace(place, rows=replace(place.rows, tangents=tangents))
    p = np.array([4.0, 2.0, 1.0, *(1.0, 0.0), *(0.0, 1.0), *(0.0, 0.0)])  # the last one has no direction
    assert_allclose(found.bound_at_nodes(turned, p), [0.2 * 4.0, 0.5 * 2.0, 0.5 * 1.0])


def test_each_contact_presses_or_pulls_by_its_own_law() -> None:
    both = cone((1, 2, Bilateral(), Coulomb(mu=0.5)), (1, 2, Unilateral(), Coulomb(mu=0.5)))
    p, r = np.array([-1.0, -1.0, 0.0, 0.0]), np.array([0.25, 0.0, 0.0, 0.0])
    assert_allclose(both.natural_residual(p, r, 2.0), [-0.5, -1.0, 0.0, 0.0])


def test_a_direction_without_multiplier_carries_nothing() -> None:
    (rows,) = cone((2, 3, Unilateral(), Coulomb(mu=0.5))).contacts
    found = AdmissibleSet((replace(rows, free=np.array([[False, True], [True, True]])),), 1.0, 1.0)
    assert_array_equal(found.carrying, [True, True, False, True, True, True])
    p = np.array([4.0, 4.0, 9.0, 1.0, 0.5, 0.5])
    expected = np.array([4.0, 4.0, 0.0, 1.0, 0.5, 0.5])
    assert_allclose(found.project(p, np.ones(6)), expected)
    assert_allclose(found.natural_residual(p, np.zeros(6), 1.0), p - expected)


def test_slopes_of_bounds_are_those_of_their_laws() -> None:
    for normal, friction in ((SOFT, TangentialCompliance(c_T=1.0, m_T=2.0)), (Unilateral(), Coulomb(mu=0.4))):
        found = cone((2, 2, normal, friction))
        (place,) = found.places
        p, h = np.array([1.0, 3.0]), 1e-6
        columns = [(found.bound(place, p + h * e) - found.bound(place, p - h * e)) / (2 * h) for e in np.eye(2)]
        assert_allclose(found.bound_slope(place, p).toarray(), np.stack(columns, axis=1), atol=1e-9)


METHODS_USED = ("auto", "condensed-newton", "surface-uzawa", "uzawa", "nsgs")


def problem_of(W: Any, q: Any, mu: Any) -> DiscreteProblem:
    return discrete_problem(sparse.csr_matrix(W), np.asarray(q, float), np.asarray(mu, float))


def laws(r: Any, u: Any, mu: Any, dim: int) -> Iterator[float]:
    """How far r and u are from each of Coulomb's laws, written down one by one."""
    for (r_n, *r_T), (u_n, *u_T), m in zip(r.reshape(-1, dim), u.reshape(-1, dim), mu, strict=True):
        slip, traction = np.linalg.norm(u_T), np.linalg.norm(r_T)
        yield max(-r_n, 0.0)
        yield max(-u_n, 0.0)
        yield abs(r_n * u_n)
        yield max(traction - m * r_n, 0.0)
        yield abs(np.dot(u_T, r_T) + m * r_n * slip)


@pytest.mark.parametrize("method", METHODS_USED)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("case", ONE)
def test_one_contact_has_its_closed_form(case: str, dim: int, method: str) -> None:
    """Scaled by 4 and 10, and turned into the plane, so that nothing is 1 by chance."""
    q, r, u = (np.array(values) for values in ONE[case])
    if dim == 2:
        q, r, u = (np.array([x[0], x[1] + x[2]]) for x in (q, r, u))
        if case == "sticks":
            r[1] = -q[1]
    problem = problem_of(4 * np.eye(dim), 10 * q, [0.5])
    found = solve(problem, method, 1e-10)
    assert found.solved
    assert_allclose(problem.reactions(found.solution.p), 10 / 4 * r, atol=1e-8)
    assert_allclose(problem.velocities(found.solution.p), 10 * u, atol=1e-8)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("method", "dim"), [("auto", 2), ("auto", 3), ("nsgs", 2), ("nsgs", 3)])
def test_rank_deficient_problems_satisfy_each_law(seed: int, method: str, dim: int) -> None:
    W, q, mu = random_problem(seed, dim=dim)
    problem = problem_of(W, q, mu)
    found = solve(problem, method, 1e-11)
    assert found.solved
    r, u = problem.reactions(found.solution.p), problem.velocities(found.solution.p)
    assert_allclose(u, W @ r + q, atol=1e-12 * np.abs(W).max())
    sizes = max(np.abs(r).max(), 1.0) * max(np.abs(q).max(), 1.0)
    assert max(laws(r, u, mu, dim)) < 1e-8 * sizes


def test_each_contact_has_its_own_coefficient() -> None:
    """Two equal contacts, pulled alike: the one with less friction slips, by what is missing."""
    problem = problem_of(np.eye(4), [-1.0, -0.5, -1.0, -0.5], [0.2, 0.6])
    for method in METHODS_USED:
        found = solve(problem, method, 1e-10)
        assert_allclose(problem.reactions(found.solution.p), [1.0, 0.2, 1.0, 0.5], atol=1e-8)


def test_a_coupled_pair_moves_as_computed_by_hand() -> None:
    """u_n1 = r1 + r2/2 - 1, u_n2 = r1/2 + r2 - 1 without friction: both press with 2/3."""
    W = np.kron(np.array([[1.0, 0.5], [0.5, 1.0]]), np.diag([1.0, 1.0]))
    problem = problem_of(W, [-1.0, 0.0, -1.0, 0.0], [0.0, 0.0])
    found = solve(problem, "auto", 1e-12)
    assert_allclose(problem.reactions(found.solution.p), [2 / 3, 0.0, 2 / 3, 0.0], atol=1e-10)


def test_the_residual_is_that_of_the_cone() -> None:
    """Nearest points of the cone, against a search over its boundary."""
    random = np.random.default_rng(2)
    x, mu = random.normal(size=(40, 3)), random.uniform(0.1, 2.0, 40)
    found = project_cone(x, mu)
    angle, height = np.meshgrid(np.linspace(0, 2 * np.pi, 721), np.linspace(0, 4, 401))
    for point, near, m in zip(x, found, mu, strict=True):
        assert np.linalg.norm(near[1:]) <= m * near[0] + 1e-12
        edge = np.stack([height, m * height * np.cos(angle), m * height * np.sin(angle)], axis=-1)
        nearest = np.linalg.norm(edge - point, axis=-1).min()
        inside = np.linalg.norm(point[1:]) <= m * point[0]
        assert np.linalg.norm(near - point) == pytest.approx(0.0 if inside else nearest, abs=2e-3)
    r, u = np.array([1.0, 0.3, 0.0]), np.array([0.0, -0.5, 0.0])  # slips although below its bound
    assert residual(r, u, np.array([0.5])) > 0.1


def test_the_scaled_problem_is_the_same_problem() -> None:
    W, q, mu = random_problem(1)
    problem = problem_of(W, q, mu)
    assert problem.surface.matrix.diagonal().max() == pytest.approx(1.0)
    assert np.linalg.norm(problem.q) == pytest.approx(1.0)
    p = np.random.default_rng(0).normal(size=len(q))
    assert_allclose(problem.velocities(p), W @ problem.reactions(p) + q, rtol=1e-10)
    w = problem.relative_displacement(problem.contact_displacement(p))
    N = problem.surface.N
    assert_allclose(-(N.T @ w) * problem.units[1], problem.velocities(p), rtol=1e-10)
    assert_array_equal((N @ np.arange(18.0))[:6], np.arange(0.0, 18.0, 3.0))  # normal rows first


def test_only_the_symmetric_part_counts() -> None:
    W, q, mu = random_problem(3)
    skew = np.triu(np.full_like(W, 1e-3), 1)
    one, other = problem_of(W + skew - skew.T, q, mu), problem_of(W, q, mu)
    assert_allclose(one.surface.flexibility, other.surface.flexibility, atol=1e-14)


@pytest.mark.parametrize("W", [np.zeros((4, 4)), np.diag([1.0, 1.0, 0.0, 0.0])])
def test_contacts_that_move_nothing_are_no_trap(W: Any) -> None:
    problem = problem_of(W, [0.5, 0.1, 0.5, 0.0], [0.3, 0.3])
    found = solve(problem, "auto", 1e-10)
    assert found.solved
    assert_allclose(problem.velocities(found.solution.p), [0.5, 0.1, 0.5, 0.0], atol=1e-10)


def test_without_q_there_is_nothing_to_do() -> None:
    problem = problem_of(np.eye(4), np.zeros(4), [0.3, 0.3])
    assert_array_equal(problem.reactions(solve(problem, "auto", 1e-10).solution.p), np.zeros(4))


@pytest.mark.parametrize("method", ["auto", "nsgs", "condensed-newton"])
def test_what_has_no_solution_is_not_called_solved(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """u_n = -1 whatever r is."""
    monkeypatch.setattr("stickslip.solvers.stepping.discrete_chain.MAX_IT", 200)
    monkeypatch.setattr(
        "stickslip.solvers.stepping.discrete_chain.TURNS", (("nsgs", 50, "x"), ("condensed-newton", 50, "x"))
    )
    found = solve(problem_of(np.diag([0.0, 1.0]), [-1.0, 0.0], [0.3]), method, 1e-8)
    assert not found.solved
    assert found.solution.residual > 0.1


def test_a_later_method_goes_on_from_the_best_point(monkeypatch: pytest.MonkeyPatch) -> None:
    W, q, mu = random_problem(5)
    turns = (("nsgs", 3, "best"), ("nsgs", 100000, "best"))
    monkeypatch.setattr("stickslip.solvers.stepping.discrete_chain.TURNS", turns)
    monkeypatch.setattr("stickslip.solvers.stepping.discrete_chain.BEST", "best")
    together = solve(problem_of(W, q, mu), "auto", 1e-8)
    alone = solve(problem_of(W, q, mu), "nsgs", 1e-8)
    assert together.solved
    assert abs(together.iterations - alone.iterations) <= 10  # the residual is measured every few sweeps


def test_contacts_of_one_colour_do_not_touch() -> None:
    random = np.random.default_rng(4)
    blocks = random.random((20, 20)) < 0.15
    W = sparse.csr_matrix(np.kron(blocks | blocks.T | np.eye(20, dtype=bool), np.ones((3, 3))))
    found = colours(W, 3)
    assert sorted(np.concatenate(found)) == list(range(20))
    for members in found:
        rows = (members[:, None] * 3 + np.arange(3)).ravel()
        part = W[rows][:, rows].toarray().reshape(len(members), 3, len(members), 3)
        assert not part.any(axis=(1, 3))[~np.eye(len(members), dtype=bool)].any()


def test_sweeps_say_how_they_ended() -> None:
    W, q, mu = random_problem(5)
    problem = problem_of(W, q, mu)
    start = np.zeros(len(q))

    def sweeps(**settings: Any) -> Any:
        prepared = METHODS["nsgs"](**settings).discrete(problem.surface)
        assert prepared is not None
        return prepared(problem, start, lambda step: None)

    short = sweeps(rtol=1e-12, max_it=7)
    assert (short.status, short.iterations) == (Status.MAX_IT, 7)
    assert not start.any()
    assert short.residual == problem.natural_residual(short.p, short.w)
    assert sweeps(rtol=1e-6, max_it=10000).status is Status.CONVERGED


def proximal(problem: DiscreteProblem, **settings: Any) -> Any:
    prepared = METHODS["condensed-newton"](**settings).discrete(problem.surface)
    assert prepared is not None
    return prepared(problem, np.zeros(len(problem.q)), lambda step: None)


@pytest.mark.parametrize("seed", range(4))
def test_a_fixed_point_of_the_regular_problem_is_a_solution(seed: int) -> None:
    W, q, mu = random_problem(seed)
    problem = problem_of(W, q, mu)
    p = solve(problem, "auto", 1e-12).solution.p
    near = problem.regular(p, 0.1)
    w = near.relative_displacement(near.contact_displacement(p))
    assert near.natural_residual(p, w) < 1e-11
    assert np.linalg.eigvalsh(near.surface.flexibility).min() > 0.099
    assert np.linalg.eigvalsh(problem.surface.flexibility).min() < 1e-12
    other = near.relative_displacement(near.contact_displacement(0 * p))
    assert near.natural_residual(0 * p, other) > 0.01


@pytest.mark.parametrize("seed", range(6))
def test_newton_passes_singular_systems_by_proximal_points(seed: int) -> None:
    problem = problem_of(*random_problem(seed, contacts=12, bodies=14))
    found = proximal(problem, rtol=1e-9, max_it=2000)
    assert found.status is Status.CONVERGED
    assert found.residual <= 1e-9
    assert [step.iteration for step in found.history] == sorted(step.iteration for step in found.history)


def test_proximal_points_end_with_their_iterations() -> None:
    problem = problem_of(*random_problem(0, contacts=12, bodies=14))
    found = proximal(problem, rtol=1e-9, max_it=3)
    assert found.status is Status.STALLED
    assert found.residual == min(step.residual for step in found.history)


def test_methods_that_need_bodies_are_refused() -> None:
    assert usable() == METHODS_USED
    for name in set(METHODS) - set(METHODS_USED):
        with pytest.raises(SceneError, match=f"--method {name}: needs the bodies.*auto, condensed-newton"):
            refuse_unusable(name)
    with pytest.raises(SceneError, match=r"--method ngs: no such method; did you mean nsgs\?"):
        refuse_unusable("ngs")
