"""Sliding that is prescribed along a rigid plane: a periodic column that is dragged, sheared and worn, by formulas."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from verification.test_wear import solved, sound

from shared.problems import on_floor
from stickslip import Cylinder, Plane, Scene, SceneError, Sphere
from stickslip.workflows.scene_file.read import from_dict

E, NU, PRESS, MU = 1000.0, 0.3, 0.01, 0.3
M, G = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
P = M * PRESS  # pressure [Pa] of the column before it slides
BACK = MU * P / G  # so far friction shears it [m]
COULOMB = {"friction": {"law": "coulomb", "mu": MU}}


def column(dim: int, base: dict[str, Any], end: float = 2.0, count: int = 2, **tables: Any) -> Scene:
    """A unit column, the same all along the floor; its top, which is held aside, presses it in the first second."""
    up, sides = "xyz"[dim - 1], [("left", "right"), ("front", "back")][: dim - 1]
    top = dict.fromkeys("xy"[: dim - 1], 0.0) | {up: [[0, 0], [1, -PRESS]]}
    whole = {
        "supports": {"top": {"boundary": "block.top", "displacement": top}},
        "periodic": {one: {"boundary": f"block.{one}", "with": f"block.{other}"} for one, other in sides},
        "steps": {"end": end, "count": count},
        "solver": {"tolerance": 1e-12},
    }
    sizes = {"length": 1.0, "height": 1.0, "mesh_size": 0.5}
    return from_dict(on_floor(dim, sizes, {"E": E, "nu": NU}, COULOMB | base, **whole | tables))


@pytest.mark.parametrize("worn", [0.0, 5e-3])
def test_a_column_that_is_dragged_wears_by_its_own_slip_and_the_way(worn: float) -> None:
    """Over a step its base follows by its shear, so that it slips by the way less what that shear grows by."""
    far, steps = 0.2, 5
    wear = {"wear": {"k": worn}} if worn else {}
    found, audit = solved(column(2, {"slide": {"x": [[0, 0], [1, 0], [2, far]]}} | wear, count=2 * steps))
    p, back = P, 0.0
    for _ in range(steps):

        def slip(now: float, back: float = back) -> float:
            return far / steps - MU * now / G + back

        def off(now: float, p: float = p) -> float:
            return now * (1 + worn * M * slip(now)) - p

        p = float(brentq(off, 0.0, P, xtol=1e-15)) if worn else P
        back = MU * p / G
    base, energy = found[-1].contacts["base"], found[-1].energy
    assert_allclose(base.pressure, p, rtol=1e-8)
    assert_allclose(base.traction, [[-MU * p, 0.0]] * len(base.traction), rtol=1e-8, atol=1e-8)
    assert_allclose(base.slip[:, 0], far - back, rtol=1e-8)
    assert_allclose(energy.external, energy.stored + energy.contact, rtol=1e-10)
    if worn:
        assert_allclose(base.max_wear, PRESS - p / M, rtol=1e-7)
    else:
        assert_allclose(base.dissipation_total, MU * P * (far - BACK), rtol=1e-8)
    sound(audit)


def test_what_the_body_follows_sticks() -> None:
    (*_, step), audit = solved(column(2, {"slide": {"x": [[0, 0], [1, 0], [2, BACK / 2]]}}))
    base = step.contacts["base"]
    assert base.stick_area == base.contact_area
    assert_allclose(base.traction[:, 0], -G * BACK / 2, rtol=1e-8)
    assert_allclose(base.slip, 0.0, atol=1e-12)
    sound(audit)


@pytest.mark.parametrize("method", ["auto", "uzawa"])
def test_a_plate_that_is_dragged_in_space_has_friction_against_the_way(method: str) -> None:
    """Along, then across: there friction turns from one way to the other, by the sum of the way and what it let go."""
    far = 0.02
    slide = {"x": [[0, 0], [1, 0], [2, far]], "y": [[0, 0], [2, 0], [3, far]]}
    found, audit = solved(column(3, {"slide": slide}, 3.0, 3, solver={"tolerance": 1e-12, "method": method}))
    along, across = (step.contacts["base"].traction / (MU * P) for step in found[1:])
    assert_allclose(along, [[-1.0, 0.0, 0.0]] * len(along), atol=1e-7)
    turned = np.array([BACK, far, 0.0]) / np.hypot(BACK, far)
    assert_allclose(across, [-turned] * len(across), atol=1e-7)
    sound(audit)


def test_an_obstacle_that_goes_the_other_way_does_the_same() -> None:
    way = [[0, 0], [1, 0], [1.5, 0.05], [2, 0.02]]
    back = {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}}
    back["floor"]["displacement"] = {"x": [[t, -x] for t, x in way]}  # type: ignore[assignment]
    one, other = (solved(scene)[0] for scene in (column(2, {"slide": {"x": way}}), column(2, {}, obstacles=back)))
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        assert_allclose(a.contacts["base"].slip, b.contacts["base"].slip, atol=1e-14)
        assert_allclose([a.energy.external, a.energy.dissipated], [b.energy.external, b.energy.dissipated], rtol=1e-12)
    assert_allclose(one[-1].obstacles["floor"].displacement, 0.0)


def test_planes_and_cylinders_are_alike_along_themselves() -> None:
    plane = Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 1.0, 1.0))
    rod = Cylinder(point=(0.0, 0.0, 0.0), axis=(0.0, 2.0, 0.0), radius=1.0)
    ball = Sphere(center=(0.0, 0.0, 0.0), radius=1.0)
    ways = 1e-6 * np.array([[3.0, 1.0, -1.0], [0.0, -2.0, 0.0], [0.0, 0.0, 0.0]])
    assert [plane.alike_along(way) for way in ways] == [True, False, True]
    assert [rod.alike_along(way) for way in ways] == [False, True, True]
    assert [ball.alike_along(way) for way in ways] == [False, False, True]
    assert not Cylinder(point=(0.0, 0.0), radius=1.0).alike_along(np.array([1.0, 0.0]))


@pytest.mark.parametrize(
    ("dim", "change", "said"),
    [
        (2, {"slide": {"y": 1.0}}, r"slide = \[0.0, 1.0\]: only along a rigid plane, or the axis of a rigid cylinder"),
        (2, {"slide": {"z": 1.0}}, "slide.z = given: is no direction in which this model can slide"),
        (3, {"slide": 1.0}, "no direction out of the plane in 3D; give slide = "),
        (2, {"slide": {"x": 1.0}, "slide_speed": 1.0}, "leave it out, or `slide_speed`"),
        (2, {"slide": {"x": [[1, 0], [0, 1]]}}, "slide.x = .*times must increase"),
        (2, {"slide": {"x": 1.0}, "wear": {"k": 1.0}, "friction": None}, "needs friction or `slide` out of the plane"),
    ],
)
def test_ways_that_are_not_built_are_refused_in_a_line(dim: int, change: dict[str, Any], said: str) -> None:
    base = {key: value for key, value in (COULOMB | change).items() if value is not None}
    with pytest.raises(SceneError, match=said):
        from_dict(on_floor(dim, {"mesh_size": 0.5}, {"E": E, "nu": NU}, base))


def test_a_body_is_no_side_to_slide_along() -> None:
    tables = on_floor(2, {"mesh_size": 0.5}, {"E": E, "nu": NU}, {})
    face = {"surface": "upper.bottom", "against": "lower.top", "slide": {"x": 1.0}} | COULOMB
    bodies = {name: {"E": E, "nu": NU} for name in ("upper", "lower")}
    blocks = {"builder": "two_blocks", "length": 1.0, "height": 1.0, "mesh_size": 0.5}
    with pytest.raises(SceneError, match=r"contacts\.face\.slide = .*only along a rigid plane"):
        from_dict(tables | {"geometry": blocks, "bodies": bodies, "contacts": {"face": face}, "obstacles": {}})
