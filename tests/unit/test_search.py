"""Which side faces which: the search along lines, the slave of a pair, and sides of solids that touch."""

import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from shared.assemblies import outline_of, pinned, stacked
from shared.audited import record_of, stored_by
from shared.cases import every_nth, slow
from stickslip import GeometryError, Scene, SceneError, StepResult
from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.surfaces import search
from stickslip.geometry.surfaces.search import Pairing, intersect, orthogonal_frames, pair
from stickslip.geometry.surfaces.surface import Surface
from stickslip.geometry.user_files.outline import Facets, fit
from stickslip.geometry.user_files.touching import Pair, Side, joined, touching
from stickslip.solvers.results.audit import Auditor
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.proposal import proposed_law, slaves
from stickslip.workflows.scene_file.read import from_dict
from stickslip.workflows.writers.tables import steps_row

Map = Callable[[Array], Array]
KINDS = [(shape, degree) for shape in ("interval", "triangle", "quadrilateral") for degree in (1, 2)]
DIM = {"interval": 1, "triangle": 2, "quadrilateral": 2}


def image(shape: str, degree: int, cells: int, mapping: Map) -> Surface:
    """The surface that `mapping` makes of the unit interval or square; the outward normal is up for the identity."""
    dim = DIM[shape]
    corner, turn = np.zeros((1, dim)), np.array([np.eye(dim)])
    if shape == "triangle":
        corner, turn = np.array([[0.0, 0.0], [1.0, 1.0]]), np.array([np.eye(2), -np.eye(2)])
    grid = np.stack(np.meshgrid(*[np.arange(cells)] * dim, indexing="ij"), axis=-1).reshape(-1, 1, 1, dim)
    at = grid + corner[:, None] + dx.reference_nodes(shape, degree) @ turn
    nodes, rows = np.unique(np.rint(degree * at).astype(int).reshape(-1, dim), axis=0, return_inverse=True)
    points = mapping(nodes / (degree * cells))
    facets = rows.reshape(len(grid) * len(corner), -1)
    outward = np.full(len(facets), -1.0 if dim == 1 else 1.0)
    number = np.arange(len(points))
    return Surface(shape, degree, number, number, points, facets, outward, axisymmetric=False)


def flat(height: float) -> Map:
    return lambda u: np.column_stack([u, np.full(len(u), height)])


def cap(radius: float) -> Map:
    """A part of the circle or sphere around the origin, 90 degrees wide."""

    def mapping(u: Array) -> Array:
        v = np.column_stack([2 * u - 1, np.ones(len(u))])
        return np.asarray(radius * v / np.linalg.norm(v, axis=1, keepdims=True))

    return mapping


def rough(height: float, seed: int, shift: float = 0.02) -> Map:
    """Random heights over a grid that is shifted at random."""

    def mapping(u: Array) -> Array:
        inside = np.random.default_rng(seed)
        moved = u + inside.uniform(-shift, shift, u.shape)
        return np.column_stack([moved, inside.uniform(-height, height, len(u))])

    return mapping


def both(first: Surface, second: Surface) -> Surface:
    """Two surfaces of a kind as one."""
    n = len(first.points) + len(second.points)
    return replace(
        first,
        nodes=np.arange(n),
        input=np.arange(n),
        points=np.concatenate([first.points, second.points]),
        facets=np.concatenate([first.facets, second.facets + len(first.points)]),
        outward=np.concatenate([first.outward, second.outward]),
    )


def unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def down(m: int, dim: int) -> Array:
    return np.tile(np.append(np.zeros(dim - 1), -1.0), (m, 1))


def random_lines(m: int, dim: int, height: float, seed: int = 0) -> tuple[Array, Array]:
    """Points in the unit box, mostly over the master; directions mostly down."""
    inside = np.random.default_rng(seed)
    points = np.column_stack([inside.uniform(-0.1, 1.1, (m, dim - 1)), inside.uniform(-height, height, m)])
    return points, unit(np.column_stack([inside.uniform(-0.6, 0.6, (m, dim - 1)), -np.ones(m)]))


def assert_on_the_lines(found: Pairing, points: Array, directions: Array, master: Surface) -> None:
    met = found.facet >= 0
    place = found.weights(master) @ master.points
    assert_allclose(place[met], (points + np.where(met, found.gap, 0)[:, None] * directions)[met], atol=1e-7)


def brute_force(points: Array, directions: Array, master: Surface, reach: float) -> tuple[Array, NDArray[np.bool_]]:
    """Smallest |gap| over all facets (m,), and which facets have it (m, f)."""
    m, f = len(points), len(master.facets)
    i, j = np.repeat(np.arange(m), f), np.tile(np.arange(f), m)
    met, _, gap = intersect(master, j, points[i], directions[i], orthogonal_frames(directions)[i])
    size = np.where(met & (np.abs(gap) <= reach), np.abs(gap), np.inf).reshape(m, f)
    least = size.min(axis=1)
    return least, np.isfinite(size) & (size <= least[:, None] + 1e-12)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
@pytest.mark.parametrize("gap", [0.3, 0.0, -0.3])  # facets are 0.1 long: overlaps of several
def test_gap_over_a_plane_is_the_height_along_the_direction(shape: str, degree: int, gap: float) -> None:
    master = image(shape, degree, 10, flat(0.0))
    inside = np.random.default_rng(3)
    points = np.column_stack([inside.uniform(0.3, 0.7, (50, DIM[shape])), np.full(50, gap)])
    directions = unit(np.column_stack([inside.uniform(-0.5, 0.5, (50, DIM[shape])), -np.ones(50)]))
    found = pair(points, directions, master, 1.0)
    assert_allclose(found.gap, gap / -directions[:, -1], atol=1e-12)
    assert_on_the_lines(found, points, directions, master)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_gap_to_a_circle_or_sphere_has_the_order_of_the_facets(shape: str, degree: int) -> None:
    inside = np.random.default_rng(5)
    rays = unit(np.column_stack([inside.uniform(-0.5, 0.5, (200, DIM[shape])), np.ones(200)]))
    start = inside.uniform(0.7, 1.3, 200)  # overlaps and openings of several facets
    errors = []
    for cells in (8, 16):
        master = image(shape, degree, cells, cap(1.0))
        found = pair(start[:, None] * rays, -rays, master, 1.0)
        errors.append(np.abs(found.gap - (start - 1)).max())
        assert_on_the_lines(found, start[:, None] * rays, -rays, master)
    # interpolation: h^2 and h^3; a chord c has the sagitta c^2 / 8, chords are 2/8 long, diagonals sqrt(2) times that
    assert np.log2(errors[0] / errors[1]) > degree + 0.8
    assert errors[0] < ((2 / 8) ** 2 * DIM[shape] / 8 if degree == 1 else 1e-3)


@pytest.mark.parametrize(("kind", "height"), every_nth(2, KINDS, [0.02, 0.3]))
def test_search_agrees_with_all_facets(kind: tuple[str, int], height: float, monkeypatch: pytest.MonkeyPatch) -> None:
    shape, degree = kind
    monkeypatch.setattr(search, "CHUNK", 70)  # several blocks
    dim = DIM[shape] + 1
    master = image(shape, degree, 60 if dim == 2 else 7, rough(height, seed=1))
    points, directions = random_lines(300, dim, height=0.4)
    for reach in (0.2, np.inf):
        found = pair(points, directions, master, reach)
        least, which = brute_force(points, directions, master, reach)
        met = np.isfinite(least)
        assert 20 < np.count_nonzero(met) < 300
        assert_array_equal(found.facet >= 0, met)
        assert_allclose(np.abs(found.gap), least, atol=1e-8)
        assert which[met, found.facet[met]].all()


@pytest.mark.parametrize("shape", ["interval", "triangle", "quadrilateral"])
def test_graded_master_is_searched_in_all_its_sizes(shape: str) -> None:
    # facets from 1 to 1e-6 of the side
    master = image(shape, 1, 30, lambda u: np.column_stack([u**4, np.zeros(len(u))]))
    at = np.geomspace(1e-6, 0.999, 400)
    points = np.column_stack([*[at] * DIM[shape], np.full(400, 0.1)])
    assert_allclose(pair(points, down(400, master.dim), master, 1.0).gap, 0.1)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
@pytest.mark.parametrize("gap", [1e-3, -0.4, 50.0])
def test_lines_through_nodes_and_edges_meet_a_facet(shape: str, degree: int, gap: float) -> None:
    # a graph without folds, whose lines meet it once; turned, so that no coordinate of an edge is exact
    master = image(shape, degree, 9, rough(0.02, seed=2, shift=0.005))
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.eye(master.dim)
    turn[np.ix_([0, -1], [0, -1])] = [[c, -s], [s, c]]
    nodes = master.points[master.facets].reshape(-1, master.dim)
    direction = down(len(nodes), master.dim)
    found = pair(
        (nodes - gap * direction) @ turn.T, direction @ turn.T, replace(master, points=master.points @ turn.T), 60.0
    )
    assert (found.facet >= 0).all()
    assert_allclose(found.gap, gap, atol=1e-6)
    of_node = [set(np.flatnonzero((master.facets == j).any(axis=1)).tolist()) for j in master.facets.ravel()]
    assert all(facet == min(of) for facet, of in zip(found.facet.tolist(), of_node, strict=True))


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_far_side_of_a_thin_plate_is_never_met(shape: str, degree: int) -> None:
    # 0.01 thick: the far face is nearer to a point 0.007 deep
    top, bottom = image(shape, degree, 8, flat(0.0)), image(shape, degree, 8, flat(-0.01))
    plate = both(replace(bottom, outward=-bottom.outward), top)
    points = np.full((5, plate.dim), 0.4)
    points[:, -1] = [0.1, 0.0, -0.007, -0.01, -0.3]
    found = pair(points, down(5, plate.dim), plate, 1.0)
    assert (found.facet >= len(bottom.facets)).all()
    assert_allclose(found.gap, points[:, -1], atol=1e-12)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_lines_beside_or_along_the_master_or_out_of_reach_meet_nothing(shape: str, degree: int) -> None:
    master = image(shape, degree, 5, flat(0.0))
    points = np.full((4, master.dim), 0.5)
    points[:, -1] = 0.2
    points[0, 0] = 1.001
    directions = down(4, master.dim)
    directions[1] = np.eye(master.dim)[0]
    directions[2] *= -1
    found = pair(points, directions, master, 0.1999)
    assert_array_equal(found.facet, -1)
    assert_array_equal(found.gap, np.inf)
    assert found.weights(master).nnz == 0
    assert_array_equal(pair(points, directions, master, 0.2001).facet >= 0, [False, False, False, True])


@pytest.mark.parametrize("shape", ["interval", "triangle", "quadrilateral"])
def test_points_far_beyond_reach_meet_nothing(shape: str) -> None:
    master = image(shape, 1, 5, flat(0.0))
    points = np.full((2, master.dim), 0.5)
    points[:, -1] = [1e3, -1e3]
    assert_array_equal(pair(points, down(2, master.dim), master, 0.1).facet, -1)
    assert_allclose(pair(points, down(2, master.dim), master, np.inf).gap, points[:, -1])


def test_of_two_layers_the_nearer_is_met_whichever_side_the_point_is() -> None:
    layers = both(image("triangle", 1, 6, flat(0.0)), image("triangle", 1, 6, flat(1.0)))
    points = np.array([[0.4, 0.3, 0.4], [0.4, 0.3, 0.6], [0.4, 0.3, 3.0], [0.4, 0.3, -3.0]])
    assert_allclose(pair(points, down(4, 3), layers, 5.0).gap, [0.4, -0.4, 2.0, -3.0], atol=1e-12)


def test_long_lines_close_to_a_wall_end() -> None:
    # a point whose line runs along 2000 facets that do not face it, to the floor
    wall = image("interval", 1, 2000, lambda u: np.column_stack([np.zeros(len(u)), u]))
    floor = image("interval", 1, 10, flat(0.0))
    found = pair(np.array([[1e-4, 0.9]]), np.array([[0.0, -1.0]]), both(wall, floor), np.inf)
    assert_array_equal(found.facet, [2000])
    assert_allclose(found.gap, 0.9)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_order_of_points_and_facets_does_not_matter(shape: str, degree: int) -> None:
    master = image(shape, degree, 9, rough(0.1, seed=4))
    points, directions = random_lines(200, master.dim, height=0.4)
    found = pair(points, directions, master, 1.0)
    inside = np.random.default_rng(6)
    rows, facets = inside.permutation(200), inside.permutation(len(master.facets))
    turned = pair(points[rows], directions[rows], replace(master, facets=master.facets[facets]), 1.0)
    assert_array_equal(np.append(facets, -1)[turned.facet], found.facet[rows])
    assert_allclose(turned.gap, found.gap[rows])


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_millimetres_and_metres_meet_the_same_facets(shape: str, degree: int) -> None:
    master = image(shape, degree, 9, rough(0.1, seed=7))
    points, directions = random_lines(200, master.dim, height=0.4)
    points = np.concatenate([points, master.points - 0.1 * down(1, master.dim)])
    directions = np.concatenate([directions, down(len(master.points), master.dim)])
    metres = pair(points, directions, master, 1.0)
    millimetres = pair(1e3 * points, directions, replace(master, points=1e3 * master.points), 1e3)
    assert_array_equal(millimetres.facet, metres.facet)
    assert_allclose(millimetres.gap, 1e3 * metres.gap)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_weights_are_the_masters_basis(shape: str, degree: int) -> None:
    # a field of the basis' own degree is met exactly on a plane
    master = image(shape, degree, 6, flat(0.0))
    points, directions = random_lines(100, master.dim, height=0.1)
    found = pair(points, directions, master, 1.0)
    met = found.facet >= 0
    weights = found.weights(master)
    assert weights.shape == (100, len(master.points))
    assert_allclose(weights.sum(axis=1).A1, met, atol=1e-12)
    at = points + np.where(met, found.gap, 0)[:, None] * directions
    field = master.points[:, 0] ** degree
    assert_allclose((weights @ field)[met], at[met, 0] ** degree, atol=1e-7)


def test_no_points_meet_nothing() -> None:
    found = pair(np.zeros((0, 3)), np.zeros((0, 3)), image("triangle", 1, 2, flat(0.0)), 1.0)
    assert found.facet.shape == (0,)


JOINT = {"surface": "upper.bottom", "against": "lower.top", "friction": {"law": "coulomb", "mu": 0.3}}
AS_WRITTEN, EXCHANGED = ("upper.bottom", "lower.top"), ("lower.top", "upper.bottom")


def pair_of_blocks(upper: float = 1.0, lower: float = 1.0, contacts: Any = None, **joint: Any) -> Scene:
    """Two blocks of these moduli [Pa], pressed and dragged."""
    return from_dict(
        {
            "model": "plane strain",
            "geometry": {"builder": "two_blocks", "length": 2.0, "height": 0.5, "mesh_size": 0.25},
            "bodies": {"upper": {"E": upper, "nu": 0.3}, "lower": {"E": lower, "nu": 0.3}},
            "obstacles": {"lid": {"shape": "plane", "point": [0.0, 1.0], "normal": [0.0, -1.0]}},
            "contacts": {"joint": JOINT | joint} | (contacts or {}),
            "supports": {
                "bed": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0}},
                "top": {"boundary": "upper.top", "displacement": {"x": 0.04, "y": -0.05}},
            },
        }
    )


@pytest.mark.parametrize(
    ("upper", "lower", "expected"),
    [
        (1.0, 1.0, AS_WRITTEN),
        (10.0, 1.0, AS_WRITTEN),  # not by more than ten times
        (10.1, 1.0, EXCHANGED),
        (1.0, 1e6, AS_WRITTEN),
        (1e6, 1.0, EXCHANGED),
    ],
)
def test_the_much_softer_body_carries_the_tractions(upper: float, lower: float, expected: tuple[str, str]) -> None:
    assert pair_of_blocks(upper, lower).slave_and_master("joint") == expected


@pytest.mark.parametrize(("slave", "expected"), [("surface", AS_WRITTEN), ("against", EXCHANGED)])
@pytest.mark.parametrize("upper", [1e-6, 1.0, 1e6])
def test_who_asks_for_a_side_gets_it(upper: float, slave: str, expected: tuple[str, str]) -> None:
    assert pair_of_blocks(upper, slave=slave).slave_and_master("joint") == expected


def test_a_node_is_paired_as_it_is_written() -> None:
    assert pair_of_blocks(1e6, operator="node-to-segment").slave_and_master("joint") == AS_WRITTEN
    assert pair_of_blocks(1e6, operator="mortar").slave_and_master("joint") == EXCHANGED


def test_a_side_with_two_contacts_stays_the_master() -> None:
    with_lid = {"lid": {"surface": "lower.top", "against": "lid"}}
    scene = pair_of_blocks(1e6, contacts=with_lid)
    assert scene.slave_and_master("joint") == AS_WRITTEN
    assert scene.slave_and_master("lid") == ("lower.top", None)
    elsewhere = {"lid": {"surface": "lower.right", "against": "lid"}}
    assert pair_of_blocks(1e6, contacts=elsewhere).slave_and_master("joint") == EXCHANGED


def test_an_obstacle_never_carries_them() -> None:
    with_lid = {"lid": {"surface": "upper.top", "against": "lid"}}
    assert pair_of_blocks(1e6, contacts=with_lid).slave_and_master("lid") == ("upper.top", None)
    with pytest.raises(SceneError, match=r"contacts\.lid\.slave = against: an obstacle is no slave"):
        pair_of_blocks(contacts={"lid": {"surface": "upper.top", "against": "lid", "slave": "against"}})


def solved(scene: Scene) -> StepResult:
    (step,) = prepare(scene).steps()
    return step


@pytest.mark.parametrize(("upper", "rtol"), [(1.0, 0.02), (20.0, 0.05)])  # coarse meshes; they match, corners differ
def test_resultants_act_on_the_surface_that_is_written(upper: float, rtol: float) -> None:
    one, other = (solved(pair_of_blocks(upper, slave=slave)) for slave in ("surface", "against"))
    first, second = one.contacts["joint"], other.contacts["joint"]
    for step, contact in ((one, first), (other, second)):
        push, lift = contact.force
        assert lift > 0  # pressed downwards, the upper block is held up
        assert push < 0  # and is held back against the drag
        assert_allclose(contact.force, -np.array(step.supports["top"].force), rtol=1e-6)
    assert_allclose(first.force, second.force, rtol=rtol)
    assert_allclose(first.moment, second.moment, rtol=rtol)
    assert_allclose(first.normal_force, second.normal_force, rtol=rtol)


@pytest.mark.parametrize("joint", [{}, {"slave": "against"}, {"sliding": True}], ids=str)
def test_signs_are_those_of_the_surface_whichever_body_is_softer(joint: dict[str, Any]) -> None:
    """The upper block, `surface`, is drawn to the right: it slips there, and friction holds it back."""
    for upper in (5.0, 20.0):  # the program exchanges the roles of the second, if nobody says otherwise
        scene = pair_of_blocks(upper, **joint)
        simulation = prepare(scene)
        (step,) = simulation.steps()
        face, row = step.contacts["joint"], steps_row(1, scene, step)
        assert row["joint.force.x"] < 0 < row["joint.slip.x"]
        # where it slides, normals are those of the bent sides
        assert_allclose(
            face.weight @ face.traction, [face.force[0], 0.0], atol=1e-9 if not scene.pairs["joint"].sliding else 5e-3
        )
        assert row["joint.tangential_force.x"] == pytest.approx((face.weight @ face.traction)[0], rel=1e-12)
        assert_allclose(face.slip, face.slip_increment, atol=1e-15)
        assert_allclose(face.traction, -face.bound[:, None] * face.lam, atol=1e-12)
        audit, record = Auditor(simulation.problem, simulation.mesh), record_of(step)
        assert audit(replace(record, stored=stored_by(step))).fields < 1e-9
        turned = replace(face, traction=-face.traction, lam=-face.lam)
        stored = stored_by(replace(step, contacts={"joint": turned}))
        assert audit(replace(record, stored=stored)).fields > 0.1


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
    for one in round_ones:
        assert one.exact
        assert_allclose(one.fit, clearance, atol=1e-7)  # OpenCASCADE's own tolerance
        assert_allclose(one.area, 2 * np.pi * 0.2 * 0.4, rtol=0.02)  # of facets
        assert_allclose(np.linalg.norm(one.points[:, :2] - 0.5, axis=1), 0.2, atol=1e-7)
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


def ball_on_a_plate(occ: Any, gap: float = 0.0, turn: float = 0.0) -> None:
    """Radius 5 m; the pole of its parametrisation is turned."""
    occ.addBox(-10, -10, -4, 20, 20, 4)
    occ.rotate([(3, occ.addSphere(0, 0, 5 + gap, 5))], 0, 0, 5 + gap, 1, 0.5, 0, turn)


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_ball_that_touches_a_plate_is_found_wherever_its_nodes_lie(turn: float) -> None:
    """Reach is 3 % of the distance from the pole to the next node; a cap of that height has an area of 2 pi R h."""
    outline = outline_of(lambda occ: ball_on_a_plate(occ, 0.0, turn))
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
    (pair,) = touching(outline_of(lambda occ: ball_on_a_plate(occ, gap, 0.7)), 3)
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
    outline = outline_of(ball_on_a_plate)
    faces = tuple(replace(face, between=None, bulge=None, off=0.0) for face in outline.entities)
    (pair,) = touching(replace(outline, entities=faces), 3, within=0.0)
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
    assert fit(cap.corners[rim], 3, cap.between, spheres=True).kind == "sphere"
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
    (own,) = touching(outline, 3)  # its parts touch
    assert (own.one.body, own.other.body) == ("whole", "whole")


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
    assert len(set(map(id, lattice))) == 5  # one of them is that of two pairs


def test_no_pair_has_no_slave() -> None:
    assert slaves([]) == []
