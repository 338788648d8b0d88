"""All methods, and the assembled block system, agree on the ready scenes wherever they are applicable."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from shared.cases import often
from shared.failures import failures
from stickslip import Coulomb, Scene, SceneError, read
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.lab.verification.cases import agreement as agreement_case
from stickslip.workflows.lab.verification.cases.agreement import ALL, REFERENCE, SCENES, Answer
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import READY

UZAWA = ("uzawa", "inexact-uzawa", "nonlinear-uzawa", "gram-uzawa")
OTHERS = [(name, method) for name in SCENES for method in ALL if method != REFERENCE]
PAIRS = [pair for pair in OTHERS if agreement_case.fits(*pair)]


@pytest.mark.parametrize("method", agreement_case.SLOW)
def test_methods_agree_on_the_cube(method: str) -> None:
    """On all scenes they are compared by test_cases."""
    assert not failures(agreement_case.compared("cube", method))


def test_only_what_the_table_refuses_is_left_out() -> None:
    """`regularised` between bodies, and where contact alone holds a body all that need supports."""
    left_out = {pair for pair in OTHERS if pair not in PAIRS}
    between = [name for name in SCENES if name.startswith(("cylinders", "shrink"))]
    need_supports = [method for method in ALL if not METHODS[method].WORKS_WITH.floating]
    assert set(UZAWA) <= set(need_supports)
    assert left_out == {(name, "regularised") for name in between} | {
        ("shrink_fit", method) for method in need_supports
    }


@pytest.mark.parametrize("method", ["surface-uzawa", "regularised"])
def test_another_coefficient_of_friction_is_not_taken_for_it(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    true = agreement_case.scene

    def slippery(name: str, by: str, **solver: Any) -> Scene:
        made = true(name, by, **solver)
        worn = replace(made.contacts["base"], friction=Coulomb(mu=0.3 * (1 + 1e-4)))
        return replace(made, contacts={"base": worn}) if by == method else made

    agreement_case.solve.cache_clear()
    monkeypatch.setattr(agreement_case, "scene", slippery)
    try:
        failed = failures(agreement_case.compared("cube", method))
    finally:
        agreement_case.solve.cache_clear()
    for quantity in ("forces", "resultants", "displacements"):
        assert any(quantity in sentence for sentence in failed)
    assert method == "surface-uzawa" or any("energy norm of its error over that stated" in line for line in failed)


def test_a_limit_takes_the_first_orders_away() -> None:
    levels = np.array([0.1, 0.03, 0.01])
    found = [{"u": np.array([3.0 + 2.0 * h, -1.0 + 5.0 * h - 7.0 * h**2])} for h in levels]
    assert np.allclose(agreement_case.limit(levels, found)["u"], [3.0, -1.0], rtol=1e-13)


BALLS = {"half_ball", "spheres"}  # of order 1: those of order 2 take half a minute
STEPS = 4  # at most, beside the times that a scene lists
TOLERANCE = 1e-13  # of the residual
AGREEMENT = 1e-8  # of u in the energy norm, and of the tractions of all rows
QUICK = {"block", "foundation", "sliding", "spheres"}


def by(method: str, name: str, **keys: Any) -> Scene:
    scene = read(name, ["geometry.order=1"] if name in BALLS else [])
    scene = replace(scene, steps=replace(scene.steps, count=min(scene.steps.count, STEPS)))
    return replace(scene, solver=replace(scene.solver, method=method, tolerance=TOLERANCE, **keys))


@cache
def refusal(name: str) -> str:
    """The line that refuses a scene; empty: it is solved."""
    try:
        make_plan(by("block-uzawa", name))
    except SceneError as error:
        return str(error)
    return ""


NAMES = sorted(path.stem for path in READY.glob("*.toml"))
SOLVED = """
axisymmetric block cad_part crack cube cylinders fault foundation fretting half_ball half_disc raous ring shaft sliding
spheres split_clamp spring_slider stick_slip two_blocks
""".split()  # noqa: SIM905  easier to read as words


def answer(scene: Scene) -> Answer:
    simulation = prepare(scene)
    return Answer(simulation, tuple(simulation.steps()))


def off(name: str, **keys: Any) -> tuple[float, float]:
    """Largest difference from condensed-newton: of u in the energy norm, and of tractions; both relative."""
    found, expected = answer(by("block-uzawa", name, **keys)), answer(by("condensed-newton", name))
    pairs = zip(found.steps, expected.steps, strict=True)
    tractions = max(np.abs(mine.p - theirs.p).max() / np.abs(theirs.p).max() for mine, theirs in pairs)
    return max(found.energy_norm(expected)), float(tractions)


@pytest.mark.parametrize("name", [pytest.param(n, marks=[] if n in QUICK else pytest.mark.slow) for n in SOLVED])
def test_ready_scenes_have_the_answer_of_the_condensed_methods(name: str) -> None:
    assert max(off(name)) < AGREEMENT


@pytest.mark.parametrize("name", often(SOLVED, sorted(QUICK)[::2]))
def test_newton_on_the_nest_has_it_too(name: str) -> None:
    assert max(off(name, outer="ksp")) < AGREEMENT


def test_all_others_are_refused() -> None:
    assert [name for name in NAMES if not refusal(name)] == SOLVED


LACKS = ("held by contact alone", "by a force", "no prescribed sliding, and no wear", "no graph", "one contact a side")


@pytest.mark.parametrize("name", [name for name in NAMES if name not in SOLVED])
def test_what_it_cannot_solve_is_refused_in_one_line_for_what_it_lacks(name: str) -> None:
    said = refusal(name)
    assert "use condensed-newton" in said
    assert "\n" not in said
    assert any(word in said for word in LACKS)
