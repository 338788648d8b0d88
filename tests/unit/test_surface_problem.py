"""The surface problem: the same problem in another unit, forces out of balance, what counts as defect."""

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from petsc4py import PETSc

from shared.problems import surface_problem, times
from stickslip.geometry.arrays import CLOSE, LAST_DIGITS
from stickslip.solvers.interface.problem import PART, SurfaceProblem
from stickslip.solvers.iteration import Solution
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.parallel.replicated import sum_of_sizes
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

COULOMB = {"law": "coulomb", "mu": 0.4}
DRIVEN = {"supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.06, "y": -0.1}}}}
PULLED = {"loads": {"pull": {"boundary": "block.top", "traction": [0.02, -0.1]}}}
SOFT, STIFF = ({"law": "compliance", "c_n": c_n, "m_n": 2.0} for c_n in (20.0, 1e6))


@cache
def _problem(normal: str, friction: str, floating: bool) -> SurfaceProblem:
    normals = {"unilateral": {"law": "unilateral"}, "bilateral": {"law": "bilateral"}, "soft": SOFT, "stiff": STIFF}
    frictions: dict[str, Any] = {"coulomb": COULOMB, "tresca": {"law": "tresca", "bound": 0.02}}
    scene = {
        "model": "plane strain",
        "geometry": {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.25},
        "bodies": {"block": {"E": 1.0, "nu": 0.3}},
        "obstacles": {"foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        "contacts": {"base": {"surface": "block.bottom", "against": "foundation", "normal": normals[normal],
                              "friction": frictions[friction]}},
    }  # fmt: skip
    return surface_problem(prepare(from_dict(scene | (PULLED if floating else DRIVEN))))


def problem_of(normal: str = "unilateral", friction: str = "coulomb", floating: bool = False) -> SurfaceProblem:
    """A block pressed and dragged, by its top or, floating, by tractions."""
    return _problem(normal, friction, floating)


def scaled(problem: SurfaceProblem, factor: float) -> SurfaceProblem:
    """Loads, gaps and motions multiplied."""
    return replace(
        problem,
        load=times(problem.load, factor),
        offset=factor * problem.offset,
        gap=factor * problem.gap,
        force=factor * problem.force,
    )


def solved(problem: SurfaceProblem) -> Solution:
    return CondensedNewton(rtol=1e-13)(problem, np.zeros(len(problem.gap)))


def test_bodies_that_have_flown_away_pull_at_nothing() -> None:
    """Whatever the last digits of such a motion are, a pressure below zero is a defect."""
    problem = problem_of(floating=True)
    pulling, apart = np.full(len(problem.gap), -problem.p_ref), np.full(len(problem.gap), -1e16 * problem.u_ref)
    assert problem.natural_residual(pulling, apart) > 0.5


@pytest.mark.parametrize("offset", range(8))
def test_a_sum_of_sizes_does_not_depend_on_where_memory_lies(offset: int) -> None:
    memory = np.zeros(1008)
    values = np.random.default_rng(0).standard_normal(1000)
    memory[offset : offset + 1000] = values
    vector = PETSc.Vec().createWithArray(memory[offset : offset + 1000], comm=PETSc.COMM_SELF)
    assert sum_of_sizes(vector) == float(np.abs(values).sum())


@pytest.mark.parametrize("floating", [False, True])
def test_loads_in_proportion_are_the_same_problem(floating: bool) -> None:
    problem = problem_of(floating=floating)
    tenth = scaled(problem, 0.1)
    assert_allclose(tenth.p_ref, 0.1 * problem.p_ref)
    assert problem.is_scaled(tenth)
    assert tenth.is_scaled(problem)
    assert problem.is_scaled(problem)
    assert_allclose(solved(tenth).p, 0.1 * solved(problem).p, atol=1e-12 * problem.p_ref)


@pytest.mark.parametrize("name", ["gap", "offset"])
def test_a_problem_with_a_gap_or_motion_of_its_own_is_another_one(name: str) -> None:
    problem = problem_of()
    for size, same in ((1e-12, True), (1e-6, False)):
        moved = replace(problem, **{name: getattr(problem, name) + size * problem.u_ref})
        assert problem.is_scaled(moved) is same
        assert moved.is_scaled(problem) is same


def test_a_load_of_another_shape_is_another_problem() -> None:
    problem = problem_of(floating=True)
    free = problem.load.free.copy()
    free[0] += 0.1 * np.abs(free).max()
    assert not problem.is_scaled(replace(problem, load=replace(problem.load, free=free)))


def test_other_pairs_are_another_problem() -> None:
    """Sliding contact searches them in each substep; their number may differ."""
    problem = problem_of()
    for N in (problem.surface.N[:-1], 1.001 * problem.surface.N):
        surface = copy(problem.surface)
        surface.N = N
        assert not problem.is_scaled(replace(problem, surface=surface))
    surface = copy(problem.surface)
    surface.N = problem.surface.N.copy()
    assert problem.is_scaled(replace(problem, surface=surface))


@pytest.mark.parametrize(("normal", "friction"), [("soft", "coulomb"), ("unilateral", "tresca")])
def test_laws_out_of_proportion_are_never_the_same_problem(normal: str, friction: str) -> None:
    problem = problem_of(normal, friction)
    assert not problem.is_scaled(scaled(problem, 0.1))


def test_nothing_is_no_scale_of_anything() -> None:
    problem = problem_of()
    nothing = scaled(problem, 0.0)
    assert nothing.p_ref == 0
    assert not problem.is_scaled(nothing)
    assert not nothing.is_scaled(problem)
    assert nothing.natural_residual(np.zeros(len(problem.gap)), nothing.offset) == 0.0


def test_forces_out_of_balance_count_on_bodies_that_float() -> None:
    problem = problem_of(floating=True)
    found = solved(problem)
    assert problem.imbalance(found.p) < 1e-13
    assert problem.imbalance(np.zeros_like(found.p)) == pytest.approx(1.0)  # the load alone
    assert problem_of().imbalance(np.zeros(len(problem.gap))) == 0.0  # supports hold
    f = problem.load.resultant
    more = problem.imbalance(1.5 * found.p)  # half of the load too much, relative to all forces that act on the modes
    acting = np.abs(problem.surface.R).T @ np.abs(problem.surface.forces(1.5 * found.p))
    assert more == pytest.approx(0.5 * np.abs(f).sum() / max(acting.sum(), np.abs(f).sum()), rel=1e-9)
    assert scaled(problem, 0.0).imbalance(np.zeros_like(found.p)) == 0.0


def test_rounding_of_motions_is_no_defect() -> None:
    """A common motion of a kilometre leaves its last digits in w; more than these is a defect all the same."""
    problem = problem_of()
    far = replace(problem, gap=problem.gap + 1e3)
    found = solved(problem)
    last = LAST_DIGITS * 1e3
    shaken = found.w + 1e3 + 0.5 * last * np.where(np.arange(len(found.w)) % 2, 1.0, -1.0)
    assert np.abs(far.cone.natural_residual(found.p, shaken - far.gap, far.weight)).max() > 0
    assert np.abs(far.defect(found.p, shaken)).max() == 0.0
    wrong = far.defect(found.p, shaken + 3 * last)
    assert np.abs(wrong).max() == pytest.approx(2.5 * last * problem.weight.max(), rel=0.5)
    assert problem.defect(found.p, found.w + 1e-6).max() <= 0.0
    assert problem.defect(found.p, found.w + 1e-6).min() < 0.0  # closed rows lack pressure


def test_defects_are_relative_to_the_largest_traction() -> None:
    problem = problem_of()
    found = solved(problem)
    off = found.w + 1e-3
    defect = np.abs(problem.defect(found.p, off)).max()
    assert problem.natural_residual(found.p, off) == pytest.approx(defect / np.abs(found.p).max())
    assert problem.scales.of_tractions(np.zeros_like(found.p)) == pytest.approx(CLOSE * problem.p_ref)
    assert problem.scales.of_tractions(-2 * problem.p_ref * np.ones_like(found.p)) == pytest.approx(2 * problem.p_ref)


def test_a_volume_solve_may_err_by_what_the_residual_does_not_see(monkeypatch: pytest.MonkeyPatch) -> None:
    """Relative to u_ref, or to the motion that the tractions cause if that is smaller; by default not at all."""
    problem, errors = problem_of(), list[float]()
    under = type(problem.surface).under
    monkeypatch.setattr(
        type(problem.surface), "under", lambda self, load, p, error: errors.append(error) or under(self, load, p, error)
    )
    p = np.ones(len(problem.gap))
    problem.contact_displacement(p)
    problem.contact_displacement(0 * p, 1e-3)
    problem.contact_displacement(1e-4 * problem.p_ref * p, 1e-3)
    assert_allclose(errors, [0.0, 1e-3 * problem.u_ref, 1e-7 * problem.p_ref / problem.weight.max()])


def test_pressure_off_a_stiff_law_is_a_defect_though_the_bodies_hardly_feel_it() -> None:
    """The motion is that of the law but for a little: pressures are 20 % off it, which the natural map does not see."""
    problem = problem_of("stiff")
    found, n = solved(problem), problem.surface.normal_rows
    (place,) = problem.cone.places
    closed = found.p[:n] > 0.1 * found.p[:n].max()
    assert np.abs(problem.defect(found.p, found.w)).max() < 1e-10 * np.abs(found.p).max()
    more = found.p.copy()
    more[:n] *= 1.2
    seen = problem.defect(more, found.w)[:n]
    law = place.rows.normal
    off = law.stiffness(more[:n], more[:n]) * ((found.w - problem.gap)[:n] - law.penetration(more[:n]))
    natural = problem.cone.natural_residual(more, found.w - problem.gap, problem.weight)[:n]
    expected = np.maximum(PART * np.abs(off), np.abs(natural))
    assert_allclose(np.abs(seen)[closed], expected[closed], rtol=1e-3)
    assert np.any(PART * np.abs(off)[closed] > np.abs(natural)[closed])


def test_the_scale_of_motion_is_that_of_the_load_without_contact() -> None:
    problem = problem_of()
    w, n = problem.relative_displacement(problem.load.free), problem.surface.normal_rows
    assert problem.u_ref == pytest.approx(max(w[:n].max(), (w - problem.gap)[:n].max()))
    away = replace(problem, offset=problem.offset - 10 * np.eye(1, len(w), 0)[0])
    assert away.u_ref == pytest.approx(problem.u_ref)  # opening sets no scale
    pulled = replace(problem_of("bilateral"), offset=away.offset)
    assert pulled.u_ref > 9  # unless contact resists it
    slide = replace(problem, offset=problem.offset + np.where(np.arange(len(w)) < n, 0.0, 50.0))
    assert slide.u_ref == pytest.approx(problem.u_ref)  # nor does a long slide


def test_displacement_under_tractions_is_one_volume_solve() -> None:
    problem = problem_of()
    p, before = solved(problem).p, problem.volume_solves
    u_c = problem.contact_displacement(p)
    assert problem.volume_solves == before + 1
    S = problem.surface.S  # type: ignore[attr-defined]
    assert_allclose(S @ u_c, problem.load.f_c - problem.surface.forces(p), atol=1e-10)
    assert_allclose(problem.project(-p, 2.0), problem.cone.project(-p, np.full(len(p), 2.0)))


def test_iterative_volume_solves_are_as_accurate_as_tractions_need(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, asked = problem_of(), []
    keep: Callable[..., Any] = lambda load, p, error=0.0: asked.append(error) or p  # noqa: E731
    monkeypatch.setattr(problem.surface, "under", keep)
    problem.contact_displacement(np.zeros(len(problem.gap)), 0.1)
    problem.contact_displacement(np.full(len(problem.gap), 1e-3 * problem.p_ref), 0.1)
    scales = [problem.u_ref, 1e-3 * problem.p_ref / problem.weight.max()]
    assert_allclose(asked, [0.1 * scales[0], 0.1 * min(scales)])


def test_small_problems_are_judged_as_large_ones() -> None:
    problem, tiny = problem_of(), scaled(problem_of(), 1e-8)
    p, w = solved(problem).p, solved(problem).w + 1e-9 * problem.u_ref
    assert tiny.natural_residual(1e-8 * p, 1e-8 * w) == pytest.approx(problem.natural_residual(p, w), rel=1e-3)
    assert not tiny.is_scaled(replace(tiny, gap=tiny.gap + 1e-6 * tiny.u_ref))
