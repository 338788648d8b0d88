"""An error in what solver and audit share is seen by the audit: its laws, gaps and forces are written a second time."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from shared.audited import record_of, stored_by
from shared.cases import slow
from shared.problems import SceneOf, SimulationOf
from stickslip import Bilateral, Compliance, FrictionLaw, Obstacle, Plane, Scene, TangentialCompliance, Tied, Unilateral
from stickslip.geometry.obstacles.round import Cylinder, Round, Sphere
from stickslip.solvers.contact import partners
from stickslip.solvers.contact.coupling import rigid_coupling
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.laws.friction import CappedCoulomb, Cohesion, Coulomb, OrthotropicCoulomb, Stick, Tresca
from stickslip.solvers.laws.pressure_dependent import PressureDependent
from stickslip.solvers.laws.rate_and_state import RateAndState, RateAndStateByPoint
from stickslip.solvers.laws.rate_dependent import RateDependent
from stickslip.solvers.laws.slip_dependent import SlipDependent, StaticKinetic
from stickslip.solvers.laws.wear import Slide, Turned, Wear
from stickslip.solvers.results import closed_formulas
from stickslip.solvers.results.audit import Audit, Auditor
from stickslip.solvers.results.verdict import limits, passed
from stickslip.solvers.simulation.resolve import resolve
from stickslip.workflows.lab.verification.prepared import prepare

FLAT = {"foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}}
BALL = {"foundation": {"shape": "cylinder", "point": [1.0, -4.0], "radius": 4.0}}
SOFT = {"law": "compliance", "c_n": 4.0, "m_n": 1.5}


def dragged(scene_of: SceneOf, friction: Any, normal: Any = None, obstacles: Any = None) -> Scene:
    laws = {"friction": friction} | ({"normal": normal} if normal else {})
    return scene_of(
        obstacles=obstacles or FLAT,
        base=laws,
        top={"x": 0.05, "y": -0.1},
    )


def judged(scene: Scene) -> tuple[Audit, tuple[str, ...], tuple[str, ...]]:
    """The audit of the last step, what passes its limit, and what has no second formula."""
    simulation = prepare(scene)
    (step,) = simulation.steps()
    auditor = Auditor(resolve(scene), simulation.mesh)
    audit = auditor(replace(record_of(step), stored=stored_by(step)))
    over = passed([audit], [step.time], [step.law_error], scene.solver.tolerance)
    return audit, tuple(over), auditor.shared


def scaled(kind: type, name: str, factor: float, patch: pytest.MonkeyPatch) -> None:
    true = getattr(kind, name)
    patch.setattr(kind, name, lambda self, *given: factor * true(self, *given))


def wrong_gap(patch: pytest.MonkeyPatch) -> None:
    def coupling(*given: Any) -> Any:
        found = rigid_coupling(*given)
        points = found.points
        return replace(
            found, gap=found.gap + 0.01, points=lambda degree: replace(points(degree), gap=points(degree).gap + 0.01)
        )

    patch.setattr(partners, "rigid_coupling", coupling)


def wrong_distance(kind: type, patch: pytest.MonkeyPatch) -> None:
    true = kind.distance
    patch.setattr(kind, "distance", lambda self, x, sqrt: true(self, x, sqrt) + 0.01)


def wrong_modulus(patch: pytest.MonkeyPatch) -> None:
    true = WeakForms._stress
    patch.setattr(WeakForms, "_stress", lambda self, *words: 1.3 * true(self, *words))


def wrong_compliance(patch: pytest.MonkeyPatch) -> None:
    """1.3 times as stiff in all that it answers."""
    true = Compliance.__getattribute__
    patch.setattr(Compliance, "pressure", lambda self, d: 1.3 * self.c_n * np.maximum(d, 0) ** self.m_n)
    for name in ("penetration", "resolvent", "stiffness", "energy"):
        method = getattr(Compliance, name)
        stiffer = lambda self, *given, method=method: method(  # noqa: E731
            Compliance(c_n=1.3 * true(self, "c_n"), m_n=self.m_n), *given
        )
        patch.setattr(Compliance, name, stiffer)


COULOMB, TRESCA = {"law": "coulomb", "mu": 0.3}, {"law": "tresca", "bound": 0.01}
Patch = Callable[[pytest.MonkeyPatch], None]
MUTANTS: dict[str, tuple[dict[str, Any], Patch, str]] = {
    "mu x 1.5": ({"friction": COULOMB}, lambda p: scaled(Coulomb, "limit", 1.5, p), "cone"),
    "mu x 0.7": ({"friction": COULOMB}, lambda p: scaled(Coulomb, "limit", 0.7, p), "complementarity"),
    "Tresca's bound x 1.5": ({"friction": TRESCA}, lambda p: scaled(Tresca, "limit", 1.5, p), "cone"),
    "gap + .01 in the rows": ({"friction": COULOMB}, wrong_gap, "penetration"),
    "gap + .01, compliant": ({"friction": COULOMB, "normal": SOFT}, wrong_gap, "penetration"),
    "a plane's distance": ({"friction": COULOMB}, lambda p: wrong_distance(Plane, p), "penetration"),
    "a cylinder's distance": (
        {"friction": COULOMB, "obstacles": BALL},
        lambda p: wrong_distance(Round, p),
        "penetration",
    ),
    "modulus x 1.3 in the form": ({"friction": COULOMB}, wrong_modulus, "equilibrium"),
    "compliance x 1.3": ({"friction": COULOMB, "normal": SOFT}, wrong_compliance, "penetration"),
}


@pytest.mark.parametrize(("scene", "wrong", "name"), MUTANTS.values(), ids=MUTANTS)
def test_an_error_in_shared_code_makes_the_answer_doubtful(
    scene: dict[str, Any], wrong: Patch, name: str, scene_of: SceneOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = dragged(scene_of, **scene)
    audit, over, shared = judged(made)
    assert not over, audit
    assert not shared
    wrong(monkeypatch)
    audit, over, _ = judged(made)
    assert any(sentence.startswith(name) for sentence in over), audit


def test_what_has_no_second_formula_is_named(scene_of: SceneOf, monkeypatch: pytest.MonkeyPatch) -> None:
    made = dragged(scene_of, COULOMB)
    monkeypatch.setattr(closed_formulas, "Coulomb", Tresca)  # as if Coulomb's law were in a file of one's own
    monkeypatch.setattr(closed_formulas, "Plane", Sphere)
    audit, over, shared = judged(made)
    assert not over, audit
    assert shared == ("obstacles.foundation: gap", "contacts.base.friction")


SOFT_LAW = Compliance(c_n=3.0)


def by_state(**numbers: Any) -> RateAndStateByPoint:
    """At four points, with a from 0.01 to 0.2, so that the exponential is small and beyond all digits."""
    law = RateAndState(f0=0.6, a=0.1, b=0.2, Dc=0.5, V0=0.3, **numbers)
    return RateAndStateByPoint(of=law, a=np.array([0.1, 0.1, 0.2, 0.01]), b=np.full(4, 0.2), Dc=np.full(4, 0.5))


LAWS: dict[str, tuple[FrictionLaw, Any]] = {
    "coulomb": (Coulomb(mu=0.3), Unilateral()),
    "capped": (CappedCoulomb(mu=0.3, s_max=0.5), Unilateral()),
    "tresca": (Tresca(bound=((0.5, 0.2), (2.0, 0.8))), Unilateral()),
    "tresca, bilateral": (Tresca(bound=0.4), Bilateral()),
    "tresca, tied": (Tresca(bound=0.4), Tied()),
    "stick": (Stick(), Unilateral()),
    "cohesion": (Cohesion(a=0.2, mu=0.3), Unilateral()),
    "cohesion, bilateral": (Cohesion(a=0.2, mu=0.3), Bilateral()),
    "by pressure": (PressureDependent(mu=((0.1, 0.3), (0.4, 0.25), (2.0, 0.5))), Unilateral()),
    "by slip": (SlipDependent(mu=((0.1, 0.3), (0.4, 0.1), (2.0, 0.5))), Unilateral()),
    "by rate": (RateDependent(mu=((0.1, 0.3), (0.4, 0.4), (2.0, 0.5))), Unilateral()),
    "static, kinetic": (StaticKinetic(mu_s=0.4, mu_k=0.3, slip_length=0.5), Unilateral()),
    "orthotropic": (OrthotropicCoulomb(mu_1=0.2, mu_2=0.5, axis=(1.0, 0.0, 0.0)), Unilateral()),
    "compliance": (TangentialCompliance(c_T=2.0, m_T=1.5), Compliance(c_n=3.0, m_n=2.0)),
    "tresca, compliant": (Tresca(bound=0.4), Compliance(c_n=3.0)),
    "by rate, radiating": (RateDependent(mu=((0.1, 0.3), (0.4, 0.4)), damping=0.7), Unilateral()),
    "by rate, an expression": (RateDependent(mu="0.2 + 0.1*V"), Unilateral()),
    "turned": (Turned(of=Tresca(bound=0.4), normal=SOFT_LAW, slide=Slide(given=1.0, speed=True)), SOFT_LAW),
    "rate and state": (by_state(), Unilateral()),
    "rate and state, radiating": (by_state(damping=0.7), Unilateral()),
}


@pytest.mark.parametrize(("friction", "normal"), LAWS.values(), ids=LAWS)
def test_both_formulas_of_a_bound_agree(friction: FrictionLaw, normal: Any) -> None:
    p, average = (
        np.array([-1.0, 0.0, 0.5, 4.0]),
        np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0.5, 0.5, 0], [0, 0, 0.2, 0.8]]),
    )
    p = np.maximum(p, 0.0) if normal.at_quadrature else p
    memory = np.array([0.0, 0.2, 1.0, 7.0])
    if isinstance(friction, RateAndStateByPoint):
        memory = np.column_stack([[0.0, 0.5, -0.3, 1.0], memory])
    found = closed_formulas.bound(friction, normal, p, average, 0.7, 2.0, memory)
    np.testing.assert_allclose(found, friction.at(memory).limit(p, average, normal, 0.7, 2.0))


POINTS = np.array([[0.5, 1.0], [2.0, 3.0], [1.0, 0.0], [4.0, 0.5]])
SLIDES = [
    *(Slide(given=0.6, speed=speed, turns=turns) for speed in (False, True) for turns in (False, True)),
    Slide(given=((0.0, 1.0), (2.0, -3.0)), speed=False),
    *(Slide(given=((0.0, a), (2.0, b)), speed=True) for a, b in ((0.4, 0.8), (0.8, -2.2), (-0.8, 2.2), (0.0, 0.0))),
    Slide(given=((0.0, 0.5), (1.0, 0.0), (2.0, 0.0)), speed=True),
]


@pytest.mark.parametrize("slide", SLIDES)
def test_both_formulas_of_a_slide_agree(slide: Slide) -> None:
    for time, step in ((1.0, 0.25), (1.0, 1.0), (2.0, 1.0)):
        found = closed_formulas.slid(slide, POINTS, time, step, 2.0)
        np.testing.assert_allclose(found, slide.within(POINTS, time, step, 2.0), rtol=1e-13)
    np.testing.assert_array_equal(closed_formulas.slid(None, POINTS, 1.0, 1.0, 2.0), np.zeros(4), strict=True)


@pytest.mark.parametrize(
    "law",
    [
        LAWS["by slip"][0],
        LAWS["static, kinetic"][0],
        LAWS["by rate"][0],
        *(by_state(evolution=evolution) for evolution in ("aging", "slip")),
        *(Turned(of=Coulomb(mu=0.3), normal=Unilateral(), slide=s).placed(POINTS, 1.0, 2.0) for s in SLIDES[1:6]),
        Turned(of=Coulomb(mu=0.3), normal=Unilateral(), slide=SLIDES[-1]).placed(POINTS, 2.0, 2.0),
    ],
)
def test_both_formulas_of_what_is_remembered_agree(law: FrictionLaw) -> None:
    before = np.array([0.0, 0.2, 1.0, 7.0])
    if isinstance(law, RateAndStateByPoint):
        before = np.column_stack([[0.3, 0.5, -0.3, 1.0], before])
    for slip in map(np.array, ([0.3, 0.0, 1e-17, 5.0], [1e-16, 1e-15, 1e-12, 1e-200])):
        found = closed_formulas.remembered(law, before, slip, 0.25)
        np.testing.assert_allclose(found, law.after(before, slip, 0.25), rtol=1e-13)


@pytest.mark.parametrize("law", [Coulomb(mu=0.3), LAWS["turned"][0], LAWS["by rate"][0], by_state()])
def test_what_jumps_or_is_nowhere_or_remembers_nothing_has_no_second_formula(law: FrictionLaw) -> None:
    assert closed_formulas.remembered(law, np.zeros((4, 2)), np.ones(4), 0.0) is None


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"k": 0.25}, 0.25),
        ({"k": (0.25, 0.5)}, 0.75),
        ({"k": ((0.0, 1.0), (2.0, 3.0))}, [1.0, 1.5]),
        ({"k": ((0.0, 1.0), (2.0, 3.0)), "by": "slip"}, [2.0, 3.0]),
        ({"k": "x + t"}, [1.5, 3.0]),
    ],
)
def test_wear_goes_by_pressure_slip_or_place(keys: dict[str, Any], expected: Any) -> None:
    found = closed_formulas.worn_rate(Wear(**keys), POINTS[:2], 1.0, 2.0, np.array([-1.0, 0.5]), np.array([1.0, 5.0]))
    np.testing.assert_allclose(found, expected)


def test_supports_move_in_time_and_place(scene_of: SceneOf) -> None:
    problem = resolve(scene_of(obstacles=FLAT, base={"friction": COULOMB}, top={"x": "0.1*x*t", "y": -0.1}))
    for axis, expected in (("x", 0.1 * POINTS[:, 0] * 0.5), ("y", np.full(4, -0.05))):
        found = closed_formulas.prescribed(problem, "top", axis, POINTS, 0.5)  # type: ignore[arg-type]
        np.testing.assert_allclose(found, expected)


def test_both_formulas_of_a_penetration_agree() -> None:
    p, law = np.array([-1.0, 0.0, 0.75, 12.0]), Compliance(c_n=3.0, m_n=2.0)
    found = closed_formulas.penetration(law, p)
    assert found is not None
    np.testing.assert_allclose(found, [0.0, 0.0, 0.5, 2.0], rtol=1e-14, atol=0)
    np.testing.assert_allclose(closed_formulas.pressure(law, found), np.maximum(p, 0.0), rtol=1e-13)
    np.testing.assert_allclose(closed_formulas.stored_energy(law, p), law.energy(np.maximum(p, 0.0)), atol=1e-15)
    for rigid in (Unilateral(), Bilateral(), Tied()):
        assert np.array_equal(closed_formulas.penetration(rigid, p), np.zeros(4))
        assert np.array_equal(closed_formulas.stored_energy(rigid, p), np.zeros(4))
        assert closed_formulas.pressure(rigid, p) is None


def test_a_law_of_a_file_of_ones_own_has_no_second_formula() -> None:
    class Own(Unilateral):
        pass

    p, alone = np.ones(1), np.eye(1)
    assert closed_formulas.penetration(Own(), p) is None
    assert closed_formulas.stored_energy(Own(), p) is None
    of = TangentialCompliance(c_T=1.0)
    for law in (of, Turned(of=of, normal=Own(), slide=SLIDES[0])):
        assert closed_formulas.bound(law, Own(), p, alone, 1.0, 1.0, p) is None


@pytest.mark.parametrize(
    ("table", "time", "expected"),
    [
        (((0.0, 3.0), (1.0, 5.0)), 0.0, 3.0),
        (((0.0, 3.0), (1.0, 5.0)), 0.5, 4.0),
        (((1.0, 2.0), (3.0, 4.0)), 0.5, 1.0),  # from zero
        (((1.0, 0.0), (3.0, 4.0)), 0.5, 0.0),
        (((0.0, 1.0), (1.0, 2.0), (2.0, 7.0)), 1.0, 2.0),
        (((0.0, 1.0), (1.0, 2.0), (2.0, 7.0)), 5.0, 7.0),  # constant after the last
    ],
)
def test_tables_are_read_between_lines(table: Any, time: float, expected: float) -> None:
    assert closed_formulas.in_time(table, time, 5.0) == expected


@pytest.mark.parametrize("inside", [False, True])
def test_both_formulas_of_a_gap_agree(inside: bool) -> None:
    from stickslip.geometry.obstacles.cone import Cone

    x = np.random.default_rng(1).normal(size=(40, 3))
    obstacles: list[Obstacle] = [
        Plane(point=(0.1, 0.2, 0.3), normal=(1.0, -2.0, 0.5)),
        Sphere(center=(0.1, 0.2, 0.3), radius=0.7, inside=inside),
        Cylinder(point=(0.1, 0.2, 0.3), axis=(1.0, 1.0, 0.0), radius=0.7, inside=inside),
        Cone(apex=(0.1, 0.2, 0.3), axis=(0.0, 1.0, 1.0), half_angle=35.0, inside=inside),
    ]
    for obstacle in obstacles:
        np.testing.assert_allclose(closed_formulas.gap(obstacle, x), obstacle.signed_gap(x), atol=1e-13)


def test_limits_follow_the_tolerance_and_what_a_method_states() -> None:
    assert limits(1e-8).cone == 1e-5
    assert limits(1e-4).cone == pytest.approx(3e-3)
    assert limits(1e-8, law_error=1e-3).cone == pytest.approx(0.03)
    assert limits(1e-8, law_error=1.0).cone == 0.1
    assert limits(1e-4).supports == limits(1e-8).supports
    assert limits(1e-8).equilibrium == 1e-6
    assert limits(1e-6).equilibrium == pytest.approx(3e-5)
    assert limits(1e-8, rounding=1e-5).equilibrium == pytest.approx(1e-4)
    assert limits(1e-8, rounding=1.0).equilibrium == pytest.approx(1e-2)  # what is noise is no excuse


def test_the_worst_step_is_named() -> None:
    zero = Audit(**dict.fromkeys(vars(limits(1e-8)), 0.0))
    audits = [zero, replace(zero, cone=2e-3), replace(zero, cone=1e-3, supports=np.nan)]
    found = tuple(passed(audits, [1.0, 2.0, 3.0], [0.0] * 3, 1e-8))
    assert [sentence.split()[0] for sentence in found] == ["supports", "cone"]
    assert "cone is 2.0e-03 in step 2 (t = 2), more than 1.0e-05: try a smaller solver.tolerance" in found[1]
    some = tuple(passed([None, None, *audits], [1.0, 2.0, 3.0, 4.0, 5.0], [0.0] * 5, 1e-8))  # of some there is none
    assert "in step 4 (t = 4)" in some[1]


def test_each_number_has_its_own_advice() -> None:
    bad = Audit(**dict.fromkeys(vars(limits(1e-8)), 1.0))
    found = {line.split(" is ")[0]: line.split(": ", 1)[1] for line in passed([bad], [1.0], [0.0], 1e-8)}
    assert {name for name, advice in found.items() if "please report it" in advice} == {
        "moment",
        "supports",
        "fields",
        "numbers",
        "files",
    }
    assert {name for name, advice in found.items() if "units" in advice} == {"equilibrium", "rounding"}


def test_what_passes_its_limit_is_said_and_no_more() -> None:
    zero = Audit(**dict.fromkeys(vars(limits(1e-8)), 0.0))
    for share, over in ((0.99, 0), (1.0, 0), (1.01, 1)):
        suction = replace(zero, negative_pressure=share * limits(1e-8).negative_pressure)
        found = tuple(passed([suction], [1.0], [0.0], 1e-8))
        assert len(found) == over
    assert found[0].startswith("negative pressure is 1.0e-05 in step 1 (t = 1), more than 1.0e-05")
    assert not tuple(passed([None], [1.0], [0.0], 1e-8))
    rough = replace(zero, cone=0.02, equilibrium=5e-5, rounding=1e-5)
    assert not tuple(passed([rough], [1.0], [1e-3], 1e-8))  # as the method states, and rounding decides
    assert not tuple(passed([replace(zero, cone=2e-3)], [1.0], [0.0], 1e-4))  # as the tolerance allows
    with pytest.raises(ValueError, match="shorter"):
        tuple(passed([zero, zero], [1.0, 2.0], [0.0], 1e-8))


@pytest.mark.parametrize("nu", [*slow(0.3), 0.4])
def test_the_second_energy_gives_the_first_forces(nu: float, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """In every model, at both orders, on every shape of cell: equilibrium is met to rounding."""
    for overrides in ({"model": "plane stress"}, {"geometry": {"order": 2}}, {"geometry": {"cells": "tensor"}}):
        scene = dragged(scene_of, COULOMB)
        made = scene_of(
            bodies={"block": {"E": 1.0, "nu": nu}},
            base={"friction": COULOMB},
            top=dict(scene.supports["top"].displacement),
            **overrides,
        )
        audit, over, _ = judged(made)
        assert audit.equilibrium < 1e-11
        assert not over
