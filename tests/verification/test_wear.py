"""Wear: columns, an annulus and a roller that slide and wear, against their implicit rule and published figures."""

from dataclasses import asdict, replace
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import sparse

import stickslip
from shared.audited import record_of
from shared.problems import on_floor
from stickslip import SLIP, STICK, Quantity, Scene, SceneError
from stickslip.geometry.arrays import Array
from stickslip.solvers.laws.friction import Cohesion, Coulomb, OrthotropicCoulomb, Stick, Tresca
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw, Trial
from stickslip.solvers.laws.normal import Compliance, Unilateral
from stickslip.solvers.laws.rate_dependent import RateDependent
from stickslip.solvers.laws.tangential_compliance import TangentialCompliance
from stickslip.solvers.laws.wear import Slide, Turned, Wear, Worn
from stickslip.solvers.results.audit import Audit, Auditor
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.stepping import halving
from stickslip.solvers.stepping.law_memory import LawMemory
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.run.warnings import wears_too_fast
from stickslip.workflows.scene_file.read import from_dict, read, to_dict, with_keys

E, NU, PRESS, K = 1000.0, 0.3, 0.01, 1e-4
M = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))  # of a confined column
WALLS = {name: {"boundary": f"block.{name}", "displacement": {"x": 0.0}} for name in ("left", "right")}


def column(steps: int, dim: int = 2, E: float = E, nu: float = NU, **tables: Any) -> Scene:
    """A unit column that its top presses in the first second by `PRESS`; in the second it slides, in so many steps."""
    walls = dict(WALLS)
    if dim == 3:
        walls |= {name: {"boundary": f"block.{name}", "displacement": {"y": 0.0}} for name in ("front", "back")}
    top = {"boundary": "block.top", "displacement": {"xyz"[dim - 1]: [[0, 0], [1, -PRESS]]}}
    whole = {
        "supports": walls | {"top": top},
        "steps": {"end": 2.0, "count": 2 * steps, "seconds": True},
        "solver": {"tolerance": 1e-12} | tables.pop("solver", {}),
    }
    sizes = {"length": 1.0, "height": 1.0, "mesh_size": tables.pop("mesh_size", 0.5)}
    return from_dict(on_floor(dim, sizes, {"E": E, "nu": nu}, tables.pop("base", {}), **whole | tables))


def solved(scene: Scene) -> tuple[list[stickslip.StepResult], Audit]:
    """Its steps, and the worst of their audits."""
    simulation = prepare(scene)
    steps = list(simulation.steps())
    auditor, records = Auditor(simulation.problem, simulation.mesh), [record_of(step) for step in steps]
    pairs = zip(steps, records, [None, *records], strict=False)
    audits = [auditor(record, before if step.substeps == 1 else None) for step, record, before in pairs]
    return steps, Audit(**{key: found or 0.0 for key, found in Audit.worst(audits).items()})


def sound(audit: Audit) -> None:
    assert max(asdict(audit).values()) < 1e-9


def rule(s: float, steps: int, k: float = K) -> float:
    """Pressure [Pa] of the column after so many implicit steps."""
    return M * PRESS / (1 + k * M * s / steps) ** steps


@pytest.mark.parametrize("method", ["condensed-newton", "surface-uzawa"])
@pytest.mark.parametrize(("s", "p"), [(1.0, 11.7766558), (5.0, 7.01775660), (20.0, 1.24076284)])
def test_a_column_wears_by_its_implicit_rule(s: float, p: float, method: str) -> None:
    base = {"slide": [[0, 0], [1, 0], [2, s]], "wear": {"k": K}}
    steps, audit = solved(column(10, base=base, solver={"method": method}))
    found = steps[-1].contacts["base"]
    assert_allclose(found.max_pressure, p, rtol=1e-8)
    assert_allclose(found.max_pressure, rule(s, 10), rtol=1e-9)
    assert_allclose([found.max_wear, found.worn_volume], PRESS - rule(s, 10) / M, rtol=1e-9)
    assert (found.status == SLIP).all()
    energy = steps[-1].energy
    assert_allclose(energy.external, energy.stored + energy.contact, rtol=1e-12)
    sound(audit)


def test_the_error_of_its_steps_is_stated() -> None:
    base = {"slide": [[0, 0], [1, 0], [2, 5.0]], "wear": {"k": K}}
    simulation = prepare(column(10, base=base))
    steps = list(simulation.steps())
    *_, errors = simulation.errors(steps)
    exact = M * PRESS * np.exp(-K * M * 5.0)
    for key, off in (
        ("max_pressure", abs(steps[-1].contacts["base"].max_pressure - exact)),
        ("max_wear", abs(steps[-1].contacts["base"].max_wear - (PRESS - exact / M))),
    ):
        stated = errors[Quantity("contacts", "base", key)].total
        assert 0.9 * off < stated < 1.3 * off


def test_a_path_back_and_forth_counts_and_shares_add_up() -> None:
    """3 m there and 2 m back; a speed of 5 m/s for a second is the same path; so is one that turns within a step."""
    there = {"slide": [[0, 0], [1, 0], [1.6, 3.0], [2, 1.0]], "wear": {"k": [0.25 * K, 0.75 * K]}}
    speed = {"slide_speed": [[0, 0], [1, 0], [1.0001, 5.0], [2, 5.0]], "wear": {"k": K}}
    turning = {"slide_speed": [[0, 0], [1, 0], [1.0001, 20.0], [2, -20.0]], "wear": {"k": K}}
    press = {"press": {"boundary": "block.top", "pressure": [[0, 0], [1, 2.0]]}}
    for base, path in ((there, 5.0), (speed, 5.0), (turning, 10.0)):
        steps, audit = solved(column(5, base=base, supports=WALLS, loads=press))
        assert_allclose(steps[-1].contacts["base"].max_wear, K * 2.0 * path, rtol=2e-4)
        sound(audit)


@pytest.mark.parametrize(
    ("wear", "far"),
    [
        ({"k": [[0.0, 1e-4], [4.0, 3e-4]]}, 2e-4 * 3.0),
        ({"k": [[0.0, 0.0], [3.0, 3e-4]], "by": "slip"}, (1.5e-4 + 3e-4) * 1.5),  # at the end of both steps
        ({"k": "1e-4*t"}, (1.5e-4 + 2e-4) * 1.5),
    ],
)
@pytest.mark.parametrize("friction", [{}, {"friction": {"law": "coulomb", "mu": 0.3}}])
def test_k_goes_by_pressure_slip_or_time(wear: dict[str, Any], far: float, friction: dict[str, Any]) -> None:
    base = {"slide": [[0, 0], [1, 0], [2, 3.0]], "wear": wear} | friction
    press = {"press": {"boundary": "block.top", "pressure": [[0, 0], [1, 2.0]]}}
    steps, audit = solved(column(2, base=base, supports=WALLS, loads=press))
    assert_allclose(steps[-1].contacts["base"].max_wear, 2.0 * far, rtol=1e-9)
    sound(audit)


@pytest.mark.parametrize("law", ["unilateral", "compliance"])
def test_a_column_under_a_force_wears_by_k_p_s_exactly(law: str) -> None:
    """In any number of steps; a compliant law changes nothing of it, and the body follows."""
    normal = {"law": law} | ({"c_n": 1e4, "m_n": 2.0} if law == "compliance" else {})
    base = {"slide": [[0, 0], [1, 0], [2, 3.0]], "wear": {"k": K}, "normal": normal}
    press = {"press": {"boundary": "block.top", "pressure": [[0, 0], [1, 2.0]]}}
    steps, audit = solved(column(2, base=base, supports=WALLS, loads=press))
    assert_allclose(steps[-1].contacts["base"].max_wear, K * 2.0 * 3.0, rtol=1e-9)
    assert steps[1].contacts["base"].max_wear == 0
    sound(audit)


def test_friction_turns_towards_the_sliding_out_of_the_plane() -> None:
    """A sheared column that slips by x in the plane and by s out of it bears mu p x / sqrt(x² + s²) there.

    Periodic sides make it uniform: the floor goes x_floor, the base follows by t / G.
    """
    mu, s, floor, G = 0.3, 0.02, 0.01, E / 2
    tables = {
        "periodic": {"walls": {"boundary": "block.right", "with": "block.left"}},
        "supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": [[0, 0], [1, -PRESS]]}}},
        "obstacles": {
            "floor": {
                "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0],
                "displacement": {"x": [[0, 0], [1, 0], [2, floor]]},
            }
        },
    }  # fmt: skip
    base = {"slide": [[0, 0], [1, 0], [2, s]], "friction": {"law": "coulomb", "mu": mu}}
    for wear in ({}, {"wear": {"k": 1e-4}}):
        steps, audit = solved(column(1, nu=0.0, base=base | wear, **tables))
        found, k = steps[-1].contacts["base"], wear["wear"]["k"] if wear else 0.0
        p, t = found.normal_force, found.tangential_force
        x = floor - t / G
        assert_allclose(t, mu * p * x / np.hypot(x, s), rtol=1e-9)
        assert_allclose(p, E * (PRESS - k * p * np.hypot(x, s)), rtol=1e-9)
        assert_allclose(found.dissipation, mu * p * np.hypot(x, s) + k * p**2 * np.hypot(x, s), rtol=1e-9)
        assert (found.status == SLIP).all()
        sound(audit)


@pytest.mark.parametrize("law", [Unilateral(), Compliance(c_n=3.0), Compliance(c_n=3.0, m_n=2.0)])
def test_a_point_that_wears_gives_by_k_times_its_slip(law: NormalLaw) -> None:
    worn, gamma = Worn(of=law, softness=np.array([0.0, 0.5, 2.0])), np.array([1.0, 2.0, 0.7])
    p_hat = np.array([3.0, 4.0, 5.0])
    p = worn.resolvent(p_hat, gamma)
    deep = law.penetration(p) + worn.softness * p
    assert_allclose(p + gamma * deep, p_hat, rtol=1e-12)
    assert_allclose(worn.penetration(p), deep)
    assert_array_equal(worn.energy(p), law.energy(p))  # what wears away stores nothing
    assert worn.at_quadrature == law.at_quadrature
    assert (worn.power == 1) is np.allclose(worn.penetration(2 * p), 2 * worn.penetration(p))
    assert worn.power in (None, 1)


def test_k_is_a_number_two_numbers_a_table_or_an_expression() -> None:
    points, table = np.array([[0.0, 1.0], [2.0, 3.0]]), ((1.0, 0.4), (3.0, 0.3))
    now: dict[str, Any] = {"time": 0.5, "end": 2.0, "pressed": np.array([1.0, 2.0]), "slid": np.array([3.0, 7.0])}
    for k, by, found in (
        (0.5, "pressure", [0.5, 0.5]),
        (0.0, "slip", [0.0, 0.0]),
        ((0.0, 0.75), "pressure", [0.75, 0.75]),
        ("x + t", "pressure", [0.5, 2.5]),
        ("0.1*x", "slip", [0.0, 0.2]),
        (table, "pressure", [0.4, 0.35]),
        (table, "slip", [0.3, 0.3]),
    ):
        wear = Wear(k=k, by=by)  # type: ignore[arg-type]
        assert_allclose(wear.rate(points, **now), found)
        assert [wear.asks_for(what) for what in ("pressure", "slip")] == [
            k == table and by == what for what in ("pressure", "slip")
        ]
    assert Wear(k="x").rate(np.zeros((0, 2)), **now).shape == (0,)
    with pytest.raises(SceneError, match=r'^wear\.k = "1 - x": must not be negative, in 1/Pa'):
        Wear(k="1 - x").rate(points, **now)
    with pytest.raises(SceneError, match=r'^wear\.k = "1/x": has no finite value'):
        Wear(k="1/x").rate(points, **now)


def test_k_times_pressure_may_stay_but_not_fall() -> None:
    Wear(k=((0.0, 0.4), (2.0, 0.2)))  # k p = 0.4 p - 0.1 p^2 is level at 2 Pa
    Wear(k=((0.0, 0.4), (2.0, 0.1)), by="slip")
    for table in (((0.0, 0.4), (2.0, 0.19)), ((1.0, 0.4), (2.0, 0.25)), ((0.0, 0.1), (1.0, 0.4), (2.0, 0.25))):
        with pytest.raises(SceneError, match=r"^k = \[\[.*\]\]: k p must not fall as the pressure p grows"):
            Wear(k=table)
    for k, said in (
        ((), r"^k = \[\]: a table needs at least one"),
        ((1.0, -2.0), r"^k = -2\.0: must not be negative, in 1/Pa"),
        (((1.0, 0.2), (1.0, 0.3)), r"^k = .*: its first column must increase"),
        ("q", r'^k = "q": column 1: q is not known'),
    ):
        with pytest.raises(SceneError, match=said):
            Wear(k=k)  # type: ignore[arg-type]


PATHS: list[tuple[Any, bool, list[float]]] = [  # given, whether it is a speed, path at 1, 1.5 and 3 s of 4 s
    (-4.0, False, [1.0, 1.5, 3.0]),
    (((1.0, 2.0), (2.0, -1.0)), False, [2.0, 3.5, 5.0]),
    (-2.0, True, [2.0, 3.0, 6.0]),
    (((0.0, 0.2), (2.0, 0.6)), True, [0.3, 0.525, 1.4]),
    (((0.0, 1.0), (1.0, 3.0), (2.0, 0.0)), True, [2.0, 2.0 + 1.125, 3.5]),
    (((0.0, -1.0), (2.0, 3.0)), True, [0.5, 0.25 + 1.0, 0.25 + 2.25 + 3.0]),  # it turns at half a second
]


@pytest.mark.parametrize(("given", "speed", "path"), PATHS)
def test_the_length_of_a_path_counts_there_and_back(given: Any, speed: bool, path: list[float]) -> None:
    slide, points = Slide(given=given, speed=speed), np.array([[2.0, 5.0], [3.0, 5.0]])
    assert_allclose([slide.travelled(time, 4.0) for time in (0.0, 1.0, 1.5, 3.0)], [0.0, *path])
    assert_allclose(slide.within(points, 3.0, 1.5, 4.0), path[2] - path[1])
    assert_allclose(replace(slide, turns=True).within(points, 1.5, 0.5, 4.0), (path[1] - path[0]) * points[:, 0])


def test_a_path_that_does_not_grow_but_by_rounding_is_at_rest() -> None:
    for far, moves in ((5.0, False), (5.0 + 1e-9, False), (5.0 + 1e-8, True)):
        slide = Slide(given=((0.0, 0.0), (1.0, 5.0), (2.0, far)), speed=False)
        assert (slide.within(np.ones((2, 2)), 2.0, 1.0, 2.0) > 0).tolist() == [moves] * 2


MEANS = sparse.csr_matrix([[0.5, 0.5, 0.0], [0.0, 0.25, 0.75], [0.0, 0.0, 1.0]])
PRESSED = np.array([1.0, 3.0, 5.0])  # [Pa]
TURN = 3e-8  # [rad]
RADII = np.array([[0.0, 9.0], [1.0, 9.0], [2.0, 9.0]])  # points [m]
TURNED: list[FrictionLaw] = [
    Coulomb(mu="(0.1 + 0.1*x)*t"),
    Cohesion(a=0.2, mu=0.1),
    Tresca(bound=2.0),
    TangentialCompliance(c_T=2.0),
]


def turned(of: FrictionLaw, normal: NormalLaw) -> Turned:
    """Friction of three points at the radii 0, 1, 2 m, that turn by TURN within the first second, and then rest."""
    slide = Slide(given=((0.0, 0.0), (1.0, TURN)), speed=False, turns=True)
    law = Turned(of=of, normal=normal, slide=slide).placed(RADII, 1.0, 2.0)
    assert isinstance(law, Turned)
    return law


@pytest.mark.parametrize("of", TURNED)
@pytest.mark.parametrize("size", [1e-6, 0.1, 0.9, 30.0])  # |t_hat| [Pa]
def test_slip_turns_friction_by_its_formula_and_has_its_derivatives(
    of: FrictionLaw, size: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stickslip.solvers.laws.wear.NEWTON_STEPS", 8)  # quadratic
    normal = Compliance(c_n=4.0) if isinstance(of, TangentialCompliance) else Unilateral()
    at, law, memory, gamma, h = (normal, 1.0, 2.0), turned(of, normal), np.zeros(3), np.array([2e7, 5e7, 1e7]), 1e-6
    whole, aside = size * np.array([1.0, 0.8, 1.2]), TURN / 2 * np.arange(3.0)
    now, s = law.within(memory, 0.5), law.limit(PRESSED, MEANS, *at)
    assert_allclose(s, of.placed(RADII, 1.0, 2.0).limit(PRESSED, MEANS, *at))

    def bound(size: Array, p: Array) -> Array:
        return now.dragged(p, MEANS, Trial(size, gamma)).bound

    found = now.dragged(PRESSED, MEANS, Trial(whole, gamma))
    slip = (whole - found.bound) / gamma
    assert_allclose(
        found.bound, np.append(min(whole[0], s[0]), (s * slip / np.hypot(slip, aside + 1e-99))[1:]), rtol=1e-8
    )
    slope = (bound(whole * (1 + h), PRESSED) - bound(whole * (1 - h), PRESSED)) / (2 * h * whole)
    assert_allclose(found.by_trial, slope, rtol=1e-5, atol=1e-8)
    for k, own in enumerate(np.eye(3) * h):
        slope = (bound(whole, PRESSED * (1 + own)) - bound(whole, PRESSED * (1 - own))) / (2 * h * PRESSED[k])
        assert_allclose(found.by_pressure.toarray()[:, k], slope, rtol=1e-5, atol=1e-8)
    assert_array_equal(now.limit(PRESSED, MEANS, *at), s)
    share = law.after(memory, slip, 0.5)
    ended = law.at(share)
    assert_allclose((share * s)[1:], found.bound[1:], rtol=1e-8)
    assert share[0] == 1
    assert_allclose(ended.limit(PRESSED, MEANS, *at), share * s)
    for k, e in enumerate(np.eye(3) * h):
        slope = (ended.limit(PRESSED + e, MEANS, *at) - ended.limit(PRESSED - e, MEANS, *at)) / (2 * h)
        assert_allclose(ended.limit_slope(PRESSED, MEANS, normal).toarray()[:, k], slope, atol=1e-8)
    work = law.work_aside(PRESSED, MEANS, share, 0.5)
    assert_allclose(work, s * aside**2 / np.maximum(np.hypot(slip, aside), 1e-99), rtol=1e-7, atol=1e-22)


def test_a_turned_law_is_that_of_its_friction_where_nothing_slides() -> None:
    soft = Compliance(c_n=4.0)
    for of, normal in ((TURNED[0], Unilateral()), (Tresca(bound=2.0), Unilateral()), (TURNED[-1], soft)):
        law, here, at = turned(of, normal), of.placed(RADII, 1.0, 2.0), (normal, 1.0, 2.0)
        assert replace(law, time=2.0).within(np.zeros(3), 1.0) is law.of
        for each in (law, law.at(np.ones(3)), law.within(np.zeros(3), 1.0)):
            assert each.lines(*at) == here.lines(*at)
            assert_allclose(each.limit(PRESSED, MEANS, *at), here.limit(PRESSED, MEANS, *at))
        assert not law.within(np.zeros(3), 1.0).homogeneous(*at)
        assert law.changes
        assert_allclose(replace(law, slide=Slide(given=0.6, speed=False, turns=True)).slid(0.5), [0.0, 0.15, 0.3])
        assert law.amplitudes() == here.amplitudes()
        assert not Turned.refuses_law(of)
    assert [turned(Coulomb(mu=mu), soft).resists() for mu in (0.0, 0.1)] == [False, True]
    across = OrthotropicCoulomb(mu_1=0.1, mu_2=0.2, axis=(1.0, 0.0, 0.0))
    for wrong in (across, Stick(), Coulomb(mu=0.3, k_T=1.0), RateDependent(mu="0.3 + V")):
        assert Turned.refuses_law(wrong)


@pytest.mark.parametrize(("dim", "normal"), [(2, {}), (3, {}), (2, {"normal": {"law": "compliance", "c_n": 1e8}})])
def test_the_contacts_own_slip_wears(dim: int, normal: dict[str, Any]) -> None:
    """The floor drags a column along by x a step, whose base follows by mu p / G: one equation a step.

    p = E (U - w), w += k p Δs, Δs = x - (mu / G) Δp, solved here by hand for each of three steps. A compliance that is
    as good as rigid is another law, at other points.
    """
    mu, k, steps, U, far = 0.2, 2e-3, 3, PRESS, 0.3
    G = E / 2
    floor = {
        "shape": "plane",
        "point": [0.0] * dim,
        "normal": [0.0] * (dim - 1) + [1.0],
        "displacement": {"x": [[0, 0], [1, 0], [2, far]]},
    }
    periodic = {"walls": {"boundary": "block.right", "with": "block.left"}}
    top = {
        "boundary": "block.top",
        "displacement": dict.fromkeys("xyz"[:dim], 0.0) | {"xyz"[dim - 1]: [[0, 0], [1, -U]]},
    }
    supports = {"top": top}
    if dim == 3:
        supports |= {name: {"boundary": f"block.{name}", "displacement": {"y": 0.0}} for name in ("front", "back")}
    tables = {"periodic": periodic, "supports": supports, "obstacles": {"floor": floor}}
    base = {"friction": {"law": "coulomb", "mu": mu}, "wear": {"k": k}} | normal
    found, audit = solved(column(steps, dim=dim, nu=0.0, base=base, mesh_size=1.0, **tables))
    p, w, dragged = E * U, 0.0, 0.0
    for step in found[steps:]:
        # p = E (U - w - k p (x - mu p / G + dragged)), the root near the last pressure
        a, b = E * k * mu / G, -(1 + E * k * (far / steps + dragged))
        now = (-b - np.sqrt(b * b - 4 * a * E * (U - w))) / (2 * a)
        w, dragged, p = w + k * now * (far / steps + dragged - mu * now / G), mu * now / G, now
        assert_allclose(step.contacts["base"].max_pressure, p, rtol=1e-4 if normal else 1e-9)
        assert_allclose(step.contacts["base"].max_wear, w, rtol=1e-4 if normal else 1e-9)
    sound(audit)


def test_turns_that_end_at_the_usual_tolerance_leave_a_sound_step() -> None:
    """What the last turn leaves of slip is not held against the stored depths; large wear is no moment."""
    top = {"x": [[0, 0], [1, 0], [2, 0.01]], "y": [[0, 0], [1, -PRESS]]}
    tables = {"supports": {"top": {"boundary": "block.top", "displacement": top}}, "solver": {"tolerance": 1e-8}}
    for k in (1e-3, 10.0):
        scene = column(3, base={"friction": {"law": "coulomb", "mu": 0.3}, "wear": {"k": k}}, **tables)
        steps, audit = solved(scene)
        assert bool(wears_too_fast(prepare(scene), steps)) == (k == 10.0)
        assert audit.fields < 1e-9
        assert audit.moment < 1e-3
        assert audit.penetration < 1e-6


def test_turns_that_do_not_end_say_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LawMemory, "_apart", lambda *_: 1.0)
    monkeypatch.setattr(halving, "HALVINGS", 0)
    base = {"friction": {"law": "coulomb", "mu": 0.3}, "wear": {"k": 1e-3}}
    with pytest.raises(stickslip.StepError, match="do not settle: friction weakens, or wears off, too fast;"):
        list(prepare(column(1, base=base, solver={"method": "condensed-newton"})).steps())


PAD = """SetFactory("OpenCASCADE");
Rectangle(1) = {0.5, 0, 0, 0.5, 0.1};
Physical Surface("pad") = {1};
Physical Curve("pad.bottom") = {1};
Physical Curve("pad.top") = {3};
"""


def annulus(folder: Path, turn: Any, steps: int, E: float, **contact: Any) -> Scene:
    """A pad from r = 0.5 to 1 under a rigid cover that a force of 1 N presses in a second, and that then turns."""
    (folder / "pad.geo").write_text(PAD)
    cover = {"shape": "plane", "point": [0.0, 0.1], "normal": [0.0, -1.0], "force": {"y": [[0, 0], [1, -1.0]]}}
    return from_dict(
        {
            "model": "axisymmetric",
            "geometry": {"file": str(folder / "pad.geo"), "mesh_size": 0.05},
            "bodies": {"pad": {"E": E, "nu": NU}},
            "obstacles": {"cover": cover},
            "contacts": {
                "face": {"surface": "pad.top", "against": "cover", "slide": turn, "wear": {"k": 0.01}} | contact
            },
            "supports": {"base": {"boundary": "pad.bottom", "displacement": {"y": 0.0}}},
            "steps": {"end": 2.0, "count": 2 * steps},
            "solver": {"tolerance": 1e-10},
        }
    )


def test_an_annulus_on_a_bed_of_springs_wears_as_computed_elsewhere(tmp_path: Path) -> None:
    """Approach and pressures after a turn by 1, of two integrators and 200 points (made for this project)."""
    bed = {"normal": {"law": "compliance", "c_n": 100.0}}
    steps, audit = solved(annulus(tmp_path, [[0, 0], [1, 0], [2, 1.0]], 60, 1e7, **bed))
    for step, at_a, at_b, approach in (
        (59, 0.424413182, 0.424413182, 0.004244132),
        (-1, 0.514338472, 0.362357149, 0.007511379),
    ):
        found = steps[step]
        r, p = found.contacts["face"].points[:, 0], found.contacts["face"].pressure
        assert_allclose([p[r.argmin()], p[r.argmax()]], [at_a, at_b], rtol=1e-3)
        assert_allclose(-found.obstacles["cover"].displacement[1], approach, rtol=1e-3)
    sound(audit)


def test_an_annulus_wears_until_its_pressure_is_one_by_r(tmp_path: Path) -> None:
    """Whatever the body: p = F / (2 pi (b - a) r), for wear is uniform then. Friction wears nothing more in the plane.

    Source: Galin & Goryacheva, J. Appl. Math. Mech. 41 (1977).
    """
    friction = {"friction": {"law": "coulomb", "mu": 0.3}}
    steps, audit = solved(annulus(tmp_path, [[0, 0], [1, 0], [2, 1e4]], 8, 20.0, **friction))
    face = steps[-1].contacts["face"]
    assert_allclose(face.pressure, 1 / (2 * np.pi * 0.5 * face.points[:, 0]), rtol=1e-3)
    # mu F r, r = 0.75 on the mean, and the work of the pressure on what wears, k F² / (2 pi (b - a))
    assert_allclose(face.dissipation / (1e4 / 8), 0.3 * 0.75 + 0.01 / np.pi, rtol=2e-3)
    sound(audit)


@pytest.mark.parametrize(
    ("contact", "said"),
    [
        ({"wear": {"k": -1.0}}, "k = -1.0: must not be negative"),
        ({"wear": {"k": [1.0, 2.0, 3.0]}}, "k = [1.0, 2.0, 3.0]: expected a number in 1/Pa, or two of them"),
        ({"wear": {"k": [[0.0, 1.0], [1.0, 0.4]]}}, "k p must not fall"),
        ({"wear": {"k": [[0.0, -1.0]]}}, "k = -1.0: k must not be negative"),
        ({"wear": {"k": 1.0}}, "needs friction or `slide`"),
        ({"slide": 1.0, "slide_speed": 1.0}, "leave it out, or `slide_speed`"),
        ({"slide": 1.0, "normal": {"law": "bilateral"}}, "needs surfaces that only press"),
        ({"slide": 1.0, "sliding": True}, "`sliding`, yet"),
        ({"slide": 1.0, "friction": {"law": "coulomb", "mu": 0.3, "k_T": 1.0}}, "friction.k_T = 1.0: does not turn"),
        ({"wear": {"k": 1.0}, "friction": {"law": "coulomb", "mu": 0.3, "k_T": 1.0}}, "has no slip that wears yet"),
        ({"slide": 1.0, "friction": {"law": "stick"}}, "does not turn to `slide` yet"),
        ({"slide": 1.0, "friction": {"law": "rate_dependent", "mu": "0.3 + V"}}, "does not turn to `slide` yet"),
        ({"slide_speed": 1.0}, "say that times are seconds"),
        ({"slide": [[1.0, 0.0], [0.5, 1.0]]}, "times must increase"),
    ],
)
def test_what_is_not_built_is_refused_in_a_line(contact: dict[str, Any], said: str) -> None:
    sizes = {"length": 1.0, "height": 1.0, "mesh_size": 0.5}
    with pytest.raises(SceneError) as refused:
        from_dict(on_floor(2, sizes, {"E": E, "nu": NU}, contact, supports=WALLS))
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_coefficient_without_a_value_is_named_with_its_contact() -> None:
    sizes = {"length": 1.0, "height": 1.0, "mesh_size": 0.5}
    pole = on_floor(2, sizes, {"E": E, "nu": NU}, {"slide": 1.0, "wear": {"k": "1/x"}}, supports=WALLS)
    with pytest.raises(SceneError, match=r'contacts\.base\.wear\.k = "1/x": has no finite value at the point \(0, 0\)'):
        list(prepare(from_dict(pole)).steps())


def test_wear_that_takes_off_all_within_rounding_names_k() -> None:
    sizes = {"length": 1.0, "height": 1.0, "mesh_size": 0.5}
    absurd = on_floor(2, sizes, {"E": E, "nu": NU}, {"slide": 1.0, "wear": {"k": 1e99}}, supports=WALLS)
    with pytest.raises(SceneError, match=r"wear\.k = 1e\+99: takes off all that presses within rounding, at most "):
        make_plan(from_dict(absurd))


@pytest.mark.parametrize("method", ["uzawa", "tangent-cg", "nsgs"])
def test_other_methods_refuse_wear(method: str) -> None:
    base = {"slide": 1.0, "wear": {"k": K}}
    with pytest.raises(SceneError, match=r"contacts\.base\.slide = true: .*no prescribed sliding, and no wear"):
        prepare(column(1, base=base, solver={"method": method}))


@pytest.mark.slow
def test_turns_that_circle_about_their_solution_come_to_it() -> None:
    """A roller so stiff that slip wears it off hundreds of times as fast as it unloads."""
    coarse = {"geometry.mesh_size": 11.2, "geometry.contact_mesh_size": 0.021, "steps.end": 4.0, "steps.count": 6}
    steps, audit = solved(with_keys(read("fretting_wear"), {"bodies.disc.E": 2.1e7} | coarse))
    assert all(step.substeps == 1 for step in steps)
    assert max(step.weakening for step in steps) > 100
    assert max(asdict(audit).values()) < 1e-7  # what the turns leave of a slip, times how much they enlarge it


def test_fretting_wears_until_only_what_sticks_presses() -> None:
    """So hard a case that a stroke wears off far more than the contact presses in: no pressure is left where it slips.

    Source: Popov, Sci. Rep. 4:3749 (2014): the stick part of a fretted contact stays, and carries all in the end.
    """
    strokes = [[0, 0], [1, 0], *([2.0 + k, 0.02 * (-1) ** k] for k in range(7))]
    scene = {
        "model": "plane strain",
        "geometry": {
            "builder": "half_disc",
            "radius": 8.0,
            "mesh_size": 2.0,
            "contact_mesh_size": 0.1,
            "contact_radius": 1.3,
        },
        "bodies": {"disc": {"E": 1000.0, "nu": NU}},
        "obstacles": {"ground": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        "contacts": {
            "pole": {
                "surface": "disc.arc",
                "against": "ground",
                "friction": {"law": "coulomb", "mu": 0.3},
                "wear": {"k": 0.5},
            }
        },
        "supports": {
            "top": {"boundary": "disc.top", "displacement": {"x": strokes, "y": [[0, 0], [1, -0.1]]}},
        },
        "steps": {"end": 8.0, "count": 8},
        "solver": {"tolerance": 1e-10},
    }
    steps, audit = solved(from_dict(scene))
    pole = steps[-1].contacts["pole"]
    assert (pole.status == STICK).any()
    assert pole.pressure[pole.status != STICK].max() < 1e-3 * pole.max_pressure
    assert pole.wear is not None
    assert pole.wear[pole.status == STICK].max() < 0.1 * pole.max_wear
    sound(audit)


HALF = """s = 0.45 * {c}; q = 0.8 * s; n = 2; // half of the rings around a square; one is the edge of stick
Point(1) = {{-s, 0, 0}}; Point(2) = {{s, 0, 0}}; Point(3) = {{q, q, 0}}; Point(4) = {{-q, q, 0}};
Point(5) = {{0, 0, 0}};
Line(1) = {{1, 2}}; Line(2) = {{2, 3}}; Line(3) = {{3, 4}}; Line(4) = {{4, 1}};
Transfinite Curve {{1, 3}} = 2 * n + 1; Transfinite Curve {{2, 4}} = n + 1;
Curve Loop(1) = {{1, 2, 3, 4}}; Plane Surface(1) = {{1}};
inner[] = {{2, 3, 4, 1}}; side[] = {{2, 3, 4}};
radius[] = {{{c}, {reach}, 240}}; cells[] = {{4, 3, 8}}; ratio[] = {{0.7, 1, 2.8}};
For k In {{0:2}}
  b = 100 * (k + 1); r = radius[k]; x = r / Sqrt(2);
  Point(b + 1) = {{r, 0, 0}}; Point(b + 2) = {{x, x, 0}}; Point(b + 3) = {{-x, x, 0}}; Point(b + 4) = {{-r, 0, 0}};
  For i In {{1:4}}
    Line(b + 10 + i) = {{inner[i - 1], b + i}};
    Transfinite Curve {{b + 10 + i}} = cells[k] + 1 Using Progression ratio[k];
    inner[i - 1] = b + i;
  EndFor
  For i In {{1:3}}
    Circle(b + i) = {{b + i, 5, b + i + 1}};
    Transfinite Curve {{b + i}} = (i == 2 ? 2 * n : n) + 1;
    Curve Loop(b + i) = {{b + 10 + i, b + i, -(b + 11 + i), -side[i - 1]}};
    Plane Surface(b + i) = {{b + i}};
    side[i - 1] = b + i;
  EndFor
EndFor
Transfinite Surface "*"; Recombine Surface "*";
one[] = {{}}; down[] = {{}};
For k In {{1:11}}
  one[] += 1; down[] += (2^k - 1) / (2^11 - 1);
EndFor
Extrude {{0, 0, -300}} {{ Surface {{:}}; Layers {{one[], down[]}}; Recombine; }}
v() = Volume {{:}}; Physical Volume("half") = v();
Physical Surface("half.contact") = {{1, 101, 102, 103, 201, 202, 203}};
m() = Surface In BoundingBox {{-241, -0.1, -301, 241, 0.1, 0.1}}; Physical Surface("half.middle") = m();
b() = Surface In BoundingBox {{-241, -0.1, -301, 241, 241, -299}}; Physical Surface("half.bottom") = b();
"""


@pytest.mark.slow
def test_a_fretted_ball_ends_with_the_stick_radius_and_the_force_of_its_closed_form(tmp_path: Path) -> None:
    """A rigid ball rubs on a half-space until only what sticks presses: c stays, p is 0 outside, F falls to that of c.

    The closed form knows no coupling of pressures and shear: nu = 0.49 and pressing without friction leave almost none
    (with nu = 0.3 c is 4.6 % less, half a cell, and F 0.5 %). R is ten times that of the published numbers and d and u0
    a tenth, for the same radii, as Hertz' theory asks for a / R small; the half-space is 240 of these wide.

    Source: Popov, Sci. Rep. 4:3749 (2014).
    """
    nu, mu, R, d, u0, strokes = 0.49, 0.3, 80.0, 0.012742, 1e-3, 14
    E_star, G_star = E / (1 - nu**2), 2 * E / (1 + nu) / (2 - nu)
    a, c = np.sqrt(R * d), np.sqrt(R * (d - G_star / (mu * E_star) * u0))
    (tmp_path / "half.geo").write_text(HALF.format(c=c, reach=1.25 * a))
    end = 1.0 + strokes
    there = [[0, 0], [1, 0], *([2.0 + k, u0 * (-1) ** k] for k in range(strokes))]
    ball = {
        "shape": "sphere",
        "center": [0.0, 0.0, R],
        "radius": R,
        "displacement": {"x": there, "z": [[0, 0], [1, -d]]},
    }
    face = {
        "surface": "half.contact",
        "against": "ball",
        "friction": {"law": "coulomb", "mu": [[0, 0], [1, 0], [1.001, mu], [end, mu]]},
        "wear": {"k": "0.3*min(1, max(0, 1e3*(t - 1)))"},
    }
    held = {"middle": {"y": 0.0}, "bottom": {"x": 0.0, "y": 0.0, "z": 0.0}}
    scene = {
        "model": "3d",
        "geometry": {"file": str(tmp_path / "half.geo"), "order": 2},
        "bodies": {"half": {"E": E, "nu": nu}},
        "obstacles": {"ball": ball},
        "contacts": {"face": face},
        "supports": {name: {"boundary": f"half.{name}", "displacement": motion} for name, motion in held.items()},
        "steps": {"end": end, "count": int(end)},
        "solver": {"tolerance": 1e-10},
    }
    steps, audit = solved(from_dict(scene))
    pressed, worn = steps[0].contacts["face"], steps[-1].contacts["face"]
    assert_allclose(2 * pressed.normal_force, 4 / 3 * E_star * np.sqrt(R) * d**1.5, rtol=0.006)  # 0.5 %: the cells
    assert_allclose(2 * worn.normal_force, 2 * E_star * (d * c - c**3 / (3 * R)), rtol=5e-3)  # worn off: 1.25 %
    r, cell = np.linalg.norm(worn.points[:, :2], axis=1), 0.08  # the last within c
    assert (worn.status[r < c - cell] == STICK).all()
    assert (worn.status[r > c + cell] != STICK).all()
    assert_allclose(np.sqrt(2 * worn.stick_area / np.pi), c, atol=0.25 * cell)
    assert worn.pressure[r > c + cell].max() < 0.01 * worn.max_pressure
    assert max(asdict(audit).values()) < 1e-7  # what the turns leave of wear is seen as a penetration


CLOCK = {"error": 1e-3, "smallest": 1e-6, "largest": 1.0}
WEAKENS = {"law": "slip_dependent", "mu": [[0, 0.5], [1, 0.3]]}


def cycled(repeat: float, far: float, error: float = 0.05, **tables: Any) -> Scene:
    """The column in two steps a cycle, in each of which it slides so far, under its drive or under 2 Pa."""
    base = {"slide": [[0, 0], [1, 0], [2, far]], "wear": {"k": K}} | tables.pop("base", {})
    scene = column(1, base=base, **tables)
    cycle = {"from": 1.0, "to": 2.0, "repeat": repeat, "error": error}
    return with_keys(scene, {"steps": {"end": 2.0, "count": 4, "cycle": cycle}})


@pytest.mark.parametrize("repeat", [2, 3, 1_000_000])
def test_a_cycle_under_a_force_wears_by_k_p_s_times_its_number(repeat: int) -> None:
    press = {"press": {"boundary": "block.top", "pressure": [[0, 0], [1, 2.0]]}}
    rubs = {"friction": {"law": "coulomb", "mu": 0.3}}
    steps, audit = solved(cycled(repeat, 5.0 / repeat, base=rubs, supports=WALLS, loads=press))
    base = steps[-1].contacts["base"]
    assert_allclose([base.max_wear, base.worn_volume], K * 2.0 * 5.0, rtol=1e-9)
    assert_allclose(steps[-1].energy.dissipation, 2.0 * (0.3 * 5.0 + base.max_wear), rtol=1e-9)
    assert_allclose(steps[-1].energy.external, steps[-1].energy.stored + steps[-1].energy.contact, rtol=1e-12)
    batches = steps[2].batches
    assert batches[-1].cycles == repeat - 1
    assert_allclose([b.max_wear for b in batches], [K * 2.0 * 5.0 * b.cycles / repeat for b in batches], rtol=1e-9)
    assert len(batches) < 4 + 2 * np.log(repeat) / np.log(4)  # nothing limits them but their growth
    sound(audit)


def test_cycles_of_a_held_column_go_by_batches_of_a_stated_error() -> None:
    simulation = prepare(cycled(10_000, 1e-3))
    steps = list(simulation.steps())
    cycles = np.diff([0.0, *(batch.cycles for batch in steps[2].batches), 1e4])
    found, exact = steps[-1].contacts["base"], M * PRESS * np.exp(-K * M * 10.0)
    assert_allclose(found.max_pressure, M * PRESS / np.prod(1 + K * M * 1e-3 * cycles / 2) ** 2, rtol=1e-9)
    assert abs(found.max_wear - (PRESS - exact / M)) < 0.05 * found.max_wear
    *_, errors = simulation.errors(steps)
    for key, off in (("max_pressure", found.max_pressure - exact), ("max_wear", found.max_wear - PRESS + exact / M)):
        stated = errors[Quantity("contacts", "base", key)].total
        assert stated is not None
        assert 0.9 * abs(off) < stated < 1.6 * abs(off)  # batches and steps are both halved: a quarter is left


def test_a_cycle_that_stands_for_itself_changes_nothing() -> None:
    one, plain = (
        list(prepare(scene).steps())
        for scene in (cycled(1, 3.0), with_keys(cycled(1, 3.0), {"steps": {"end": 2.0, "count": 4}}))
    )
    assert (one[-1].p == plain[-1].p).all()
    assert one[-1].contacts["base"].max_wear == plain[-1].contacts["base"].max_wear


@pytest.mark.parametrize(
    ("cycle", "tables", "said"),
    [
        ({"repeat": 1.5}, {}, r"steps\.cycle\.repeat = 1\.5: must be a whole number from 1 on"),
        ({"to": 1.0}, {}, r"steps\.cycle\.to = 1\.0: must be later than `from`"),
        ({"to": 3.0}, {}, r"steps\.cycle\.to = 3\.0: must not be later than the end, 2"),
        ({"error": 0.0}, {}, r"steps\.cycle\.error = 0\.0: must lie between 0 and 1"),
        ({"from": 0.5}, {}, r"supports\.top\.displacement\.y = changes: is not the same at both ends of steps\.cycle"),
        ({}, {"steps.clock": CLOCK, "steps.count": 1}, r"steps\.cycle = given: .*a clock follows each cycle by itself"),
        ({}, {"contacts.base.wear": None}, r"steps\.cycle = given: leave it out: no contact wears"),
        (
            {},
            {"contacts.base.slide": None, "contacts.base.friction": WEAKENS},
            r"contacts\.base\.friction\.law = slip_dependent: changes from cycle to cycle; leave out steps\.cycle",
        ),
    ],
)  # fmt: skip
def test_what_is_no_load_cycle_is_refused_in_a_line(cycle: dict[str, Any], tables: dict[str, Any], said: str) -> None:
    whole = to_dict(cycled(10, 1.0))
    whole["steps"]["cycle"] |= cycle
    for key, value in tables.items():
        *path, last = key.split(".")
        table = reduce(getitem, path, whole)
        table |= {last: value}
        if value is None:
            del table[last]
    with pytest.raises(SceneError, match=said) as refused:
        from_dict(whole)
    assert "\n" not in str(refused.value)
