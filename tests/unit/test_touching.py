"""Pairs of sides that touch, found before any volume is meshed: their area and gap are those of the exact shapes."""

import tracemalloc
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.assemblies import outline_of, pinned, stacked
from shared.cases import slow
from stickslip.geometry.errors import GeometryError
from stickslip.geometry.user_files.outline import Facets, fit
from stickslip.geometry.user_files.touching import Pair, Side, joined, touching
from stickslip.workflows.scene_file.proposal import proposed_law, slaves


@pytest.mark.parametrize("gap", [2e-3, -2e-3])
def test_a_cube_on_a_plate_touches_it_with_its_bottom(gap: float) -> None:
    """The cube is the smaller side; negative gaps are overlaps."""
    outline = outline_of(lambda occ: stacked(occ, gap))
    (pair,) = touching(outline, 3)
    assert (pair.one.body, pair.other.body, pair.kind, pair.exact) == ("part_2", "part", "plane", True)
    assert_allclose(pair.area, 1.0, rtol=1e-9)
    assert_allclose(pair.gap, gap, atol=1e-9)
    assert_allclose(pair.points[:, 2], 1 + gap, atol=1e-9)


def test_a_larger_gap_is_found_within_a_larger_distance() -> None:
    outline = outline_of(lambda occ: stacked(occ, 0.1))
    assert touching(outline, 3) == []
    (pair,) = touching(outline, 3, within=0.11)
    assert_allclose(pair.fit, 0.1, rtol=1e-9)


def test_bodies_that_share_an_edge_only_are_no_pair() -> None:
    def steps(occ: Any) -> None:
        occ.addBox(0, 0, 0, 1, 1, 1)
        occ.addBox(1, 0, 1, 1, 1, 1)

    assert touching(outline_of(steps), 3) == []


@pytest.mark.parametrize("clearance", [*slow(0.0), 5e-4])
def test_the_gap_of_a_pin_in_a_hole_is_the_difference_of_the_radii(clearance: float) -> None:
    """Facets of 16 to the circle are 4 mm from it."""
    pairs = touching(outline_of(lambda occ: pinned(occ, clearance)), 3)
    assert {(p.one.body, p.other.body, p.kind) for p in pairs} == {
        ("part", "part_2", "plane"),
        ("part", "part_3", "cylinder"),
        ("part_2", "part_3", "cylinder"),
    }
    round_ones = [pair for pair in pairs if pair.kind == "cylinder"]
    for pair in round_ones:
        assert pair.exact
        assert_allclose(pair.fit, clearance, atol=1e-7)  # OpenCASCADE's own tolerance
        assert_allclose(pair.area, 2 * np.pi * 0.2 * 0.4, rtol=0.02)  # of facets
        assert_allclose(np.linalg.norm(pair.points[:, :2] - 0.5, axis=1), 0.2, atol=1e-7)
    assert round_ones[0].other is round_ones[1].other  # the pin has one side, which meets both holes


def test_a_hole_split_into_halves_is_one_side() -> None:
    outline = outline_of(pinned)
    (hole,) = [p.one for p in touching(outline, 3) if p.kind == "cylinder" and p.one.body == "part"]
    half = [Facets(k, "", c, None, ("part",)) for k, c in enumerate(np.array_split(hole.faces[0].corners, 2))]
    whole = [face for face in outline.entities if face is not hole.faces[0]]
    changed = replace(outline, entities=(*whole, *half))
    sides = {p.one.numbers for p in touching(changed, 3) if p.kind == "cylinder" and p.one.body == "part"}
    assert sides == {(0, 1)}


def test_a_ball_on_a_plate_is_of_another_kind() -> None:
    def ball(occ: Any) -> None:
        occ.addBox(-2, -2, -1, 4, 4, 1)
        occ.addSphere(0, 0, 1, 1)

    (pair,) = touching(outline_of(ball), 3, within=0.02)
    assert pair.kind == "other"
    assert not pair.exact
    assert 0 < pair.area < 4 * np.pi * 2 * 0.02  # a cap of that height has 2 pi R h; facets of 16 to the circle
    assert np.linalg.norm(pair.points[:, :2], axis=1).max() < 0.5


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_ball_that_touches_a_plate_is_found_wherever_its_nodes_lie(turn: float) -> None:
    """Reach is 3 % of the distance from the pole to the next node; a cap of that height has an area of 2 pi R h."""

    def ball(occ: Any) -> None:
        occ.addBox(-10, -10, -4, 20, 20, 4)
        occ.rotate([(3, occ.addSphere(0, 0, 5, 5))], 0, 0, 5, 1, 0.5, 0, turn)

    outline = outline_of(ball)
    (pair,) = touching(outline, 3)
    reach = 1e-3 * np.linalg.norm([20, 20, 14])
    assert (pair.one.body, pair.kind, pair.exact) == ("part_2", "other", False)
    assert pair.gap[0] == 0.0
    assert pair.accuracy < 2e-3 * 5  # twice the error of quadratic facets whose edges are .6 R long
    assert_allclose(pair.gap[1], reach, rtol=0.2)  # the largest one of samples
    assert_allclose(pair.area, 2 * np.pi * 5 * reach, rtol=0.2)  # by samples
    (touched,) = touching(outline, 3, within=1e-9 if turn == 0 else pair.accuracy)
    assert touched.gap[0] == 0.0


@pytest.mark.parametrize("gap", [0.01, -0.01])
def test_the_gap_under_a_ball_is_that_of_its_pole(gap: float) -> None:
    def ball(occ: Any) -> None:
        occ.addBox(-10, -10, -4, 20, 20, 4)
        occ.rotate([(3, occ.addSphere(0, 0, 5 + gap, 5))], 0, 0, 5 + gap, 1, 0.5, 0, 0.7)

    (pair,) = touching(outline_of(ball), 3)
    assert_allclose(pair.gap[0], gap, atol=pair.accuracy)
    assert pair.accuracy < 0.9 * abs(gap)


def test_a_cylinder_lies_on_a_plate_along_a_line() -> None:
    def roller(occ: Any) -> None:
        occ.addBox(-10, -10, -4, 20, 20, 4)
        occ.rotate([(3, occ.addCylinder(-8, 0, 3, 16, 0, 0, 3))], 0, 0, 3, 1, 0, 0, 0.1)

    (pair,) = touching(outline_of(roller), 3)
    reach = 1e-3 * np.linalg.norm([20, 20, 10])
    assert pair.gap[0] == 0.0
    assert_allclose(pair.area, 16 * 2 * np.sqrt(2 * 3 * reach), rtol=0.2)  # a strip, by samples


def test_bodies_that_meet_in_a_point_of_a_mesh_are_a_pair() -> None:
    """Without CAD nothing is known but facets: of a distance of 0 they have a corner, and no area."""

    def ball(occ: Any) -> None:
        occ.addBox(-10, -10, -4, 20, 20, 4)
        occ.addSphere(0, 0, 5, 5)

    outline = outline_of(ball)
    meshed = replace(
        outline, entities=tuple(replace(face, between=None, bulge=None, off=0.0) for face in outline.entities)
    )
    (pair,) = touching(meshed, 3, within=0.0)
    assert (pair.area, pair.gap) == (0.0, (0.0, 0.0))
    assert_allclose(pair.points, np.zeros_like(pair.points), atol=1e-9)


@pytest.mark.parametrize("height", [4.0, 10.0])
def test_a_crowned_roller_in_a_bore_is_no_cylinder(height: float) -> None:
    """A band of a sphere, one row of facets high: their corners lie on a cylinder, the face does not."""

    def barrel(occ: Any) -> None:
        outer, bore = (occ.addCylinder(0, 0, -height / 2, 0, 0, height, r) for r in (45, 30))
        occ.cut([(3, outer)], [(3, bore)])
        ball, band = occ.addSphere(0, 0, 0, 30), occ.addCylinder(0, 0, -height / 2, 0, 0, height, 40)
        occ.intersect([(3, ball)], [(3, band)])

    (pair,) = touching(outline_of(barrel), 3)
    assert {pair.one.form.kind, pair.other.form.kind} == {"cylinder", "other"}
    assert not pair.exact
    assert pair.gap[0] == 0.0
    assert pair.accuracy < 2e-4 * 30


def test_a_shallow_cap_is_no_plane() -> None:
    """Its corners lie on the rim alone."""

    def boss(occ: Any) -> None:
        stud, ball = occ.addCylinder(0, 0, 0, 0, 0, 1, 0.3), occ.addSphere(0, 0, 3, 3)
        occ.intersect([(3, stud)], [(3, ball)])

    cap = min(outline_of(boss).entities, key=lambda face: face.centre[2])
    rim = np.linalg.norm(cap.corners[..., :2], axis=2).max(axis=1) > 0.29
    assert fit(cap.corners[rim], 3, cap.between).kind == "other"
    assert fit(cap.corners, 3).size == pytest.approx(0.6, rel=0.05)


def test_forms_of_many_nodes_need_memory_in_proportion() -> None:
    x, y = np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 1, 60))
    square = np.stack([x, y, 0 * x], axis=-1)
    facets = np.stack([square[:-1, :-1], square[:-1, 1:], square[1:, 1:]], axis=2).reshape(-1, 3, 3)
    tracemalloc.start()
    try:
        form = fit(facets, 3)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert form.kind == "plane"
    assert_allclose(form.axis, [0, 0, 1], atol=1e-12)
    assert peak < 20 * facets.nbytes  # a square matrix of the nodes has 400 times as much


def test_the_sag_of_facets_is_relative_to_their_size() -> None:
    ball = outline_of(lambda occ: occ.addSphere(0, 0, 0, 1))
    sags = [Side.of("part", outline.entities, 3).sag for outline in (ball, ball.times(1e-12, 3))]
    assert_allclose(sags[1], 1e-12 * sags[0], rtol=1e-6)


def test_plane_models_pair_lines_and_arcs() -> None:
    def shaft(occ: Any) -> None:
        occ.cut([(2, occ.addDisk(0, 0, 0, 2, 2))], [(2, occ.addDisk(0, 0, 0, 1.001, 1.001))])
        occ.addDisk(0, 0, 0, 1, 1)
        occ.addRectangle(2.5, 0, 0, 1, 1)
        occ.addRectangle(3.5, 0.5, 0, 1, 1)

    arc, line = touching(outline_of(shaft, 2), 2)
    assert (arc.kind, line.kind) == ("cylinder", "plane")
    assert_allclose(arc.fit, 1e-3, rtol=1e-4)
    assert_allclose([line.area, line.fit], [0.5, 0.0], rtol=0.05, atol=1e-9)  # half an edge, by samples


def test_bodies_that_share_a_face_are_joined_there() -> None:
    def glued(occ: Any) -> None:
        stacked(occ)
        occ.fragment([(3, 1)], [(3, 2)])

    outline = outline_of(glued)
    assert touching(outline, 3) == []
    ((bodies, faces),) = joined(outline).items()
    assert (set(bodies), len(faces)) == ({"part", "part_2"}, 1)


def test_sides_that_the_file_names_keep_their_names() -> None:
    (pair,) = touching(outline_of(stacked, names={"lid": ["part_2"], "lid.foot": ["face 11"]}), 3)
    assert (pair.one.name, pair.one.body, pair.other.name) == ("lid.foot", "lid", "")


@pytest.mark.parametrize(
    ("names", "says"),
    [
        ({"lid": ["part_3"]}, 'names."lid": expected names that the file gives to bodies, not "part_3"; did you mean'),
        ({"lid": {"box": [0, 0, 0, 1, 1, 1]}}, 'names."lid": expected names'),
        ({"Lid": ["part"]}, 'names."Lid": a body\'s name is made of a-z'),
        ({"part": ["part_2"]}, 'names."part": the file has another body of this name'),
        ({"a": ["part"], "b": ["part"]}, 'names."b": part is a already'),
    ],
)
def test_wrong_names_of_bodies_are_refused(names: Any, says: str) -> None:
    with pytest.raises(GeometryError) as caught:
        outline_of(stacked, names=names)
    assert says in str(caught.value)


def test_several_bodies_can_be_made_one() -> None:
    outline = outline_of(stacked, names={"whole": ["part", "part_2"]})
    assert list(outline.bodies) == ["whole"]
    assert touching(outline, 3) == []


# --- proposals


@dataclass(frozen=True, eq=False)
class Sized:
    """What a side is to the choice of slaves."""

    area: float


def pair_of(one: Any, other: Any, kind: str = "plane", gap: float = 0.0) -> Pair:
    fake: Any = SimpleNamespace
    return fake(one=one, other=other, kind=kind, exact=True, fit=gap)


def test_nuts_are_tied_to_what_they_are_screwed_on_and_welds_to_all() -> None:
    def body(name: str) -> Any:
        return SimpleNamespace(body=name, form=SimpleNamespace(radius=1.0))

    alone: Any = SimpleNamespace(pairs=[])
    nut, bolt, plate = body("locknut_2"), body("bolt"), body("plate")
    assert proposed_law(pair_of(nut, bolt, "cylinder"), alone)[0] == "tied"
    assert proposed_law(pair_of(nut, plate, "plane"), alone)[0] == "unilateral"
    assert proposed_law(pair_of(bolt, plate, "cylinder"), alone)[0] == "unilateral"
    assert proposed_law(pair_of(nut, bolt, "cylinder", gap=1e-3), alone)[0] == "unilateral"  # a hole that is too wide
    assert proposed_law(pair_of(body("weld_3"), plate), alone)[0] == "tied"


def test_each_side_is_the_slave_of_one_pair_and_small_ones_come_first() -> None:
    pin, *holes = (Sized(a) for a in (9.0, 1.0, 2.0, 3.0))
    assert slaves([pair_of(hole, pin) for hole in holes]) == holes
    beams, posts = [[Sized(1.0) for _ in range(n)] for n in (2, 3)]
    lattice = slaves([pair_of(beam, post) for beam in beams for post in posts])  # 6 pairs of 5 sides
    chosen = [id(side) for side in lattice if side is not None]
    assert (len(chosen), len(set(chosen)), lattice.count(None)) == (5, 5, 1)


def test_no_pair_has_no_slave() -> None:
    assert slaves([]) == []
