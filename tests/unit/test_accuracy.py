"""A run to an accuracy: rounds of finer meshes and steps, what they have reached, what is foreseen."""

import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose

from shared.cases import every_nth
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh_sizes import GROWTH, SizeField, adapted, volumes
from stickslip.solvers.results.step_result import ErrorParts, Errors, Quantity, StepResult, names_of
from stickslip.solvers.scene.record import STRESSES
from stickslip.solvers.simulation.simulation import Seconds, prepare
from stickslip.workflows.accuracy.goals import Standing, standings
from stickslip.workflows.accuracy.level import AIM, ALIKE, FINEST, GAIN, Level, Move, Round, next_move
from stickslip.workflows.accuracy.rounds import Rounds, _in_vain, _lowered, aiming, parsed
from stickslip.workflows.cost.foresee import (
    ASKED,
    Coarse,
    Known,
    coarse_versions,
    foresee,
    learnt,
    price,
    rows,
    seconds_of,
    trend,
)
from stickslip.workflows.cost.run_record import RATIO
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read


def grid(n: int) -> tuple[Any, Any]:
    """Points and triangles of the unit square."""
    x = np.linspace(0, 1, n + 1)
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    lower, upper = np.stack([first, first + 1, first + n + 2]), np.stack([first, first + n + 2, first + n + 1])
    return points, np.concatenate([lower.T, upper.T])


def test_equal_errors_scale_all_sizes_alike() -> None:
    points, cells = grid(8)
    error = np.sqrt(volumes(points, cells))
    half = adapted(points, cells, error, 0.5).sizes
    assert_allclose(half, 0.5 * adapted(points, cells, error, 1.0).sizes, rtol=1e-12)
    assert_allclose(adapted(points, cells, error, 1.0).sizes, (0.5 / 64 / (np.sqrt(3) / 4)) ** 0.5, rtol=1e-6)


def test_sizes_are_small_where_the_error_is_large() -> None:
    points, cells = grid(8)
    middle = points[cells].mean(axis=1)
    found = adapted(points, cells, np.exp(-5 * np.linalg.norm(middle, axis=1)), 0.5).sizes
    far = np.linalg.norm(points, axis=1)
    assert found[np.argmin(far)] < 0.5 * found[np.argmax(far)]


def test_sizes_grow_no_faster_than_cells_can() -> None:
    points, cells = grid(8)
    sizes = np.ones(len(points))
    sizes[0] = 0.01
    found = SizeField(points, cells, sizes).smooth().sizes
    assert_allclose(found[:9], 0.01 + GROWTH * points[:9, 0], rtol=1e-12)
    assert (found <= sizes).all()


@pytest.mark.parametrize(
    ("name", "sets"),
    [
        ("half_disc", ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.5"]),
        ("half_ball", ["geometry.mesh_size=0.4", "geometry.contact_mesh_size=0.4"]),
    ],
)
def test_curved_sides_have_the_sizes_beside_them(name: str, sets: list[str]) -> None:
    """They bulge beyond the straight facets of the mesh before, where it has no cells."""
    scene = read(name, [*sets, "geometry.order=1", "output.error=false"])
    mesh = prepare(scene).data
    away = np.linalg.norm(mesh.points, axis=1)  # from the pole
    again = prepare(scene, sizes=SizeField(mesh.points, mesh.cells, 0.03 + GROWTH * away)).system.contacts[0].surface
    middles = again.points[again.facets].mean(axis=1)
    edges = np.linalg.norm(again.points[again.facets[:, 1]] - again.points[again.facets[:, 0]], axis=1)
    assert (edges < 2 * (0.03 + GROWTH * np.linalg.norm(middles, axis=1))).all()


@pytest.mark.parametrize("name", ["block", "two_blocks", "cylinders", "half_ball"])
def test_gmsh_meshes_with_the_sizes_it_is_given(name: str) -> None:
    sets = ["geometry.order=1", "output.error=false"]
    sizes = {"half_ball": (0.3, 0.1), "cylinders": (2.0, 0.12)}.get(name, ())
    sets += [f"geometry.{key}={size}" for key, size in zip(("mesh_size", "contact_mesh_size"), sizes, strict=False)]
    scene = read(name, sets)
    mesh = prepare(scene).data
    size = float(np.median(volumes(mesh.points, mesh.cells) ** (1 / mesh.points.shape[1])))
    field = SizeField(mesh.points, mesh.cells, np.full(len(mesh.points), 2 * size))
    again = prepare(scene, sizes=field).data
    assert 0.5 < len(again.cells) / field.cell_count() < 1.6
    assert again.bodies == mesh.bodies


SECONDS = Seconds(mesh=1.0, assemble=0.1, prepare=0.1, iterate=0.2, error=0.1)


def goal(mesh: float, time_step: float, asked: float = 0.01) -> Standing:
    return Standing("base.normal_force", asked, 1.0, mesh, time_step, 0.0)


def test_the_next_round_refines_what_is_off() -> None:
    mesh = next_move([goal(0.02, 0.0)], 2, 2)
    assert mesh.enough
    assert mesh.splits == 1
    assert mesh.error(goal(0.02, 0.0)) <= AIM * 0.01
    steps = next_move([goal(0.001, 0.02)], 2, 2)
    assert (steps.finer, steps.splits, steps.enough) == (1.0, 4, True)
    both = next_move([goal(0.02, 0.0), goal(0.0, 0.02)], 2, 2)
    assert both.finer < 1 < both.splits


def test_what_does_not_fit_gives_way_to_a_smaller_move() -> None:
    goals = [goal(0.05, 0.0)]
    best = next_move(goals, 2, 2)
    assert best.enough
    smaller = next_move(goals, 2, 2, fits=lambda move: move.cells(2) < best.cells(2) / 2)
    assert 1 < smaller.cells(2) < best.cells(2) / 2
    assert not smaller.enough
    assert next_move(goals, 2, 2, fits=lambda move: False) is None
    assert next_move(goals, 2, 2, fits=lambda move: move.cells(2) < 1.1) is None  # hardly better


def test_a_smaller_tolerance_is_a_move() -> None:
    loose = replace(goal(1e-3, 0.0), rest=0.02)
    move = next_move([loose], 2, 2)
    assert (move.finer, move.splits, move.enough) == (1.0, 1, True)
    assert next_move([replace(loose, rest=0.0, law=0.02)], 2, 2) is None  # of the contact law nothing lowers it


def test_the_price_has_a_part_that_does_not_grow() -> None:
    """A second of libraries and compiled forms is no second of a finer mesh."""
    seconds = Seconds(assemble=1.0, prepare=1.0, iterate=0.1)
    fine = Move(0.25, 1)
    assert fine.price(seconds, 2) > 10 * fine.price(seconds, 2, grows=0.05)
    assert fine.price(seconds, 2, grows=0.05) > sum(vars(seconds).values())


@pytest.mark.parametrize("dim", [2, 3])
def test_where_no_round_is_enough_errors_fall_by_almost_as_much_as_they_can(dim: int) -> None:
    found = next_move([goal(10.0, 1e-4)], 2, dim)
    assert not found.enough
    assert found.error(goal(10.0, 0.0)) <= ALIKE * FINEST[dim] ** 2 * 10.0
    assert found.splits == 1  # more steps would lower nothing


def test_a_contact_of_few_nodes_is_refined_whatever_its_errors(tmp_path: Path) -> None:
    """Half a ball that touches with few of its nodes: what is stated of their error need not be true."""
    sets = ["geometry.mesh_size=0.2", "geometry.contact_mesh_size=0.2", "steps.count=1", "output.pictures=false"]
    rounds = Rounds(aiming(read("half_ball", sets), ["pole.normal_force=40%"], None), lambda line: None)
    rounds(tmp_path / "out", Watch())
    first, second = rounds.done
    assert first.met
    assert second.met
    assert second.level.sizes is not None


def test_order_2_comes_where_a_finer_mesh_of_order_1_would_be_dearer() -> None:
    far = next_move([goal(1.0, 0.0)], 2, 2, (1, 2))
    assert (far.order, far.raises) == (2, True)
    assert far.error(goal(1.0, 0.0)) == pytest.approx(far.finer**2 / GAIN)
    near = next_move([goal(0.011, 0.0)], 2, 2, (1, 2))
    assert (near.order, near.raises) == (1, False)
    later = next_move([goal(0.02, 0.0)], 2, 2, (2,))
    assert (later.order, later.raises) == (2, False)
    assert later.cells(2) == pytest.approx(1 / later.finer)  # the energy error falls as h²


def test_rounds_of_order_2_refine_the_contact(tmp_path: Path) -> None:
    """Block of Raous: the energy of the error sits at a held corner, that of the friction force at the contact."""
    sets = ["geometry.mesh_size=0.005", "output.pictures=false", "steps.count=2"]
    rounds = Rounds(aiming(read("raous", sets), ["base.tangential_force=0.1%"], None), lambda line: None)
    outcome, content = rounds(tmp_path / "out", Watch())
    assert outcome.status == "converged"
    assert [one.level.order for one in rounds.done][:2] == [1, 2]
    assert rounds.done[-1].level.order == 2
    assert rounds.done[-1].unknowns < 3400  # a fifth of what a mesh of one size needs
    exact = 1.4054e6  # converged figure of an independent program
    assert abs(content["steps"][-1]["contacts"]["base"]["tangential_force"] / exact - 1) < 0.001


def test_ctrl_c_between_two_rounds_is_obeyed_and_the_rounds_go_on_from_there(tmp_path: Path) -> None:
    coarse = ["geometry.mesh_size=1.0", "geometry.contact_mesh_size=0.5", "output.pictures=false"]
    scene = aiming(read("block", coarse), ["base.normal_force=1%"], None)

    def press(line: str) -> None:
        if line.startswith("round 1: "):
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        Rounds(scene, press)(tmp_path / "out", Watch())
    said = list[str]()
    outcome, content = Rounds(scene, said.append)(tmp_path / "out", Watch(), resume=True)
    assert said[0] == "1 finished rounds are taken over"
    assert outcome.status == "converged"
    assert len(content["accuracy"]["rounds"]) > 1


def test_rounds_end_before_memory_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stickslip.workflows.accuracy.rounds.available", lambda: 1_000_000)
    scene = aiming(
        read("raous", ["geometry.mesh_size=0.005", "output.pictures=false"]), ["base.normal_force=0.1%"], None
    )
    rounds = Rounds(scene, lambda line: None)
    rounds._before -= 1e9  # as if the first round took so much
    outcome, content = rounds(tmp_path / "out", Watch())
    assert outcome.status == "inaccurate"
    assert "the next round would take about" in outcome.sentence
    assert len(rounds.done) == 1
    assert content["steps"]


def test_stresses_at_probes_are_goals_by_component() -> None:
    stress = Quantity("probes", "tip", "stress")
    assert [name for name, _ in names_of(stress, np.zeros(6))] == [f"probe.tip.stress.{ij}" for ij in STRESSES]
    assert names_of(Quantity("supports", "top", "moment"), 1.0) == [("support.top.moment.z", None)]


def test_order_2_is_in_vain_where_it_comes_no_closer() -> None:
    def one(order: Literal[1, 2], mesh: float) -> Round:
        return Round(Level(order=order), [Standing("N", asked=0.01, value=1.0, mesh=mesh, time_step=0.0, rest=0.0)])

    assert _in_vain([one(1, 0.1), one(2, 0.02), one(2, 0.03)])
    assert not _in_vain([one(1, 0.1), one(2, 0.03), one(2, 0.02)])
    assert not _in_vain([one(1, 0.01), one(2, 0.03)])
    lowered = _lowered(Level(order=2, factor=0.5), MPI.COMM_SELF)
    assert (lowered.order, lowered.highest, lowered.factor) == (1, 1, 0.25)


def test_the_price_grows_with_cells_and_steps() -> None:
    cheap, fine, long = (Move(*move, enough=True).price(SECONDS, 2) for move in ((1.0, 1), (0.5, 1), (1.0, 8)))
    assert cheap == pytest.approx(1.5)
    assert fine > 4 * cheap
    assert cheap < long < 3.7


def test_long_histories_make_steps_dear() -> None:
    assert Move(1.0, 2).work(2, 2) < Move(0.84, 1).work(2, 2)
    assert Move(1.0, 2).work(100, 2) > Move(0.84, 1).work(100, 2)


def test_a_level_changes_mesh_steps_and_tolerance_only() -> None:
    scene = read("half_disc")
    found = Level(factor=0.5, splits=2, tolerance=1e-10).scene(scene)
    assert (found.geometry.order, found.steps.count, found.solver.tolerance) == (1, 2 * scene.steps.count, 1e-10)
    assert found.geometry.contact_mesh_size == pytest.approx(0.005)
    assert found.contacts == scene.contacts


def test_goals_of_the_command_line_join_those_of_the_scene() -> None:
    scene = read("block", ['accuracy.goals={"base.normal_force"=0.01}'])
    found = aiming(scene, ["base.stick_area=5%"], 30.0)
    assert found.accuracy.goals == {"base.normal_force": 0.01, "base.stick_area": 0.05}
    assert found.accuracy.budget == 30.0
    assert aiming(scene, [], None) is scene


@pytest.mark.parametrize(
    ("goals", "budget", "said"),
    [
        (["base.normal_force"], None, "expected NAME=1%"),
        (["base.normal_force=x%"], None, "expected NAME=1%"),
        (["base.normal_force=100%"], None, "must lie between 0 and 1"),
        (["base.nothing=1%"], None, "no such quantity"),
        ([], 10.0, "nothing to spend it on"),
        (["base.normal_force=1%"], -1.0, "must be positive"),
    ],
)
def test_wrong_goals_are_refused(goals: list[str], budget: float | None, said: str) -> None:
    with pytest.raises(SceneError, match=said):
        aiming(read("block"), goals, budget)


def test_parsed_goals() -> None:
    assert parsed(["a.b=1%", "c.d=0.2"]) == {"a.b": 0.01, "c.d": 0.2}


def test_standings_take_the_parts_relative_to_the_number() -> None:
    simulation = prepare(read("block", ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25"]))
    steps = list(simulation.steps())
    errors = simulation.errors(steps)[-1]
    force, vector = standings({"base.normal_force": 0.1, "support.top.force.x": 0.2}, steps[-1], errors)
    parts = errors[Quantity("contacts", "base", "normal_force")]
    assert force.reached == pytest.approx(parts.total / force.value)
    assert vector.mesh == pytest.approx(errors[Quantity("supports", "top", "force")].mesh[0] / vector.value)
    with pytest.raises(SceneError, match="grows without end"):
        standings({"base.max_pressure": 0.1}, steps[-1], errors)
    (grows,) = standings({"base.max_pressure": 0.1}, steps[-1], errors, coarse=True)
    assert not grows.met
    assert "grows so far" in str(grows)
    dear = {key: replace(parts, time_step=None, dear={"time_step": 3.0}) for key, parts in errors.items()}
    (lacks,) = standings({"base.normal_force": 0.1}, steps[-1], dear)
    assert (lacks.met, lacks.lacks, lacks.price) == (False, "the time steps", 3.0)
    unknown = {key: ErrorParts() for key in errors}
    with pytest.raises(SceneError, match="by the mesh, the time steps"):
        standings({"base.normal_force": 0.1}, steps[-1], unknown)


SIZES = ["geometry.mesh_size=0.4", "geometry.contact_mesh_size=0.2"]
DOWN = "supports.top.displacement={x=0.0, y=[[0, 0], [1, -0.1]]}"


def solved(*words: str) -> tuple[StepResult, Errors]:
    """The last step of a block, and its errors."""
    simulation = prepare(read("block", [*SIZES, *words]))
    steps = list(simulation.steps())
    return steps[-1], simulation.errors(steps)[-1]


@pytest.mark.parametrize(
    ("name", "cells"),
    every_nth(
        2, ["base.tangential_force", "support.top.force.x", "obstacle.foundation.force.x"], ["tensor", "simplex"]
    ),
)
def test_what_rounding_or_a_mesh_without_symmetry_leaves_is_0(name: str, cells: str) -> None:
    """A block pressed straight down: no force acts sideways."""
    step, errors = solved(DOWN, f"geometry.cells={cells!r}")
    with pytest.raises(SceneError, match=rf"accuracy\.goals\.{name}: is 0 at the end \(.*e-.*counts as that\)"):
        standings({name: 0.01}, step, errors)
    assert standings({"base.normal_force": 0.01}, step, errors)


@pytest.mark.parametrize(
    ("small", "accepted"),
    [
        ({"max_penetration": 1e-7}, True),  # of a stiff surface, beside a displacement of .1
        ({"max_penetration": 1e-17}, False),
        ({"dissipation_total": 1e-6}, True),  # of partial slip, beside a stored energy of .01
        ({"normal_force": 1e-5}, True),  # of a contact that hardly bears, beside a force of .2
        ({"tangential_force": 1e-3}, True),
        ({"tangential_force": 1e-5}, False),
    ],
)
def test_small_numbers_that_do_not_cancel_out_are_goals(small: dict[str, float], accepted: bool) -> None:
    step, errors = solved()
    contacts: dict[str, Any] = {"base": replace(step.contacts["base"], **small)}
    step = replace(step, contacts=contacts)
    goals = {f"base.{key}": 0.01 for key in small}
    if accepted:
        assert [goal.value for goal in standings(goals, step, errors)] == list(small.values())
    else:
        with pytest.raises(SceneError, match="is 0 at the end"):
            standings(goals, step, errors)


NAME = "base.normal_force"


def made_up(level: int, mesh: float, time_step: float = 0.0, setup: float | None = None) -> Coarse:
    cells = RATIO ** (2 * level)
    known = {NAME: Known(1.0, mesh, time_step)}
    return Coarse(level, int(1000 * cells), 2, 0.1 + cells if setup is None else setup, 0.01 + 0.1 * cells, known)


def test_errors_follow_the_observed_power_and_seconds_the_cells() -> None:
    found = [made_up(level, 0.1 * RATIO ** (-1.3 * level)) for level in range(-4, 3)]
    assert trend(found, NAME)(6) == pytest.approx(0.1 * RATIO ** (-1.3 * 6))
    one = price(found, NAME, 0.01, dim=2)
    level = np.log(10) / (1.3 * np.log(RATIO))  # a tenth of the error at level 0
    assert one.factor == pytest.approx(RATIO**-level, rel=0.2)
    assert one.seconds == pytest.approx(1.2 / one.factor**2, rel=0.3)
    assert one.splits == 1
    assert one.between[0] < one.seconds < one.between[1]


def test_an_error_that_changes_its_sign_is_no_luck() -> None:
    errors = {-4: 0.1, -3: 0.08, -2: 1e-5, -1: 0.05, 0: 0.04}
    lucky = [made_up(level, error) for level, error in errors.items()]
    plain = [made_up(level, error if error > 1e-3 else 0.05) for level, error in errors.items()]
    assert trend(lucky, NAME)(4) == trend(plain, NAME)(4)


def test_steps_are_split_where_they_are_what_is_wrong() -> None:
    found = [made_up(level, 1e-5, time_step=0.018) for level in (-4, -3, -2)]
    one = price(found, NAME, 0.01, dim=2)
    assert (one.splits, one.factor) == (2, RATIO**4)


def test_what_is_unsure_or_beyond_all_is_said() -> None:
    found = [made_up(level, 0.02 * RATIO ** (-1.0 * level)) for level in (-4, -3, -2)]
    (row,) = rows(found, dim=2)
    wide = [each.between[1] / each.between[0] for each in row.prices if each]
    assert wide[0] < wide[1] < wide[2]
    assert wide[0] < 10
    (surer,) = rows(found, 2, off=0.01)
    assert surer.prices[2].between[1] < row.prices[2].between[1]
    endless = [replace(one, numbers={NAME: Known(1.0, why_not="grows")}) for one in found]
    assert rows(endless, 2)[0].prices == (None,) * len(ASKED)
    assert price([made_up(-4, 1e-9, time_step=1e9)], NAME, 0.1, 2) is None


def test_errors_cost_no_more_than_their_budget_pays_for() -> None:
    """Of small runs ten seconds, of large ones as many as the run takes."""
    coarse = [replace(made_up(level, 0.1), error=5.0 * RATIO ** (2 * level)) for level in range(-4, 1)]
    found = {level: seconds_of(coarse, level, 1, 2) for level in (0, 2, 8)}
    runs = {level: seconds_of([replace(one, error=0.0) for one in coarse], level, 1, 2) for level in found}
    assert [found[level] - runs[level] for level in found] == pytest.approx([5.0, 10.0, runs[8]], rel=0.1)


@pytest.mark.parametrize("content", [None, "", "{", "[]", '{"2d": 3}', '{"2d": [NaN, "x", null, 0.2]}'])
def test_what_was_learnt_may_be_lost(content: str | None, tmp_path: Path) -> None:
    file = tmp_path / "prices.json"
    if content is not None:
        file.write_text(content)
    found = [made_up(level, 0.1) for level in range(-4, 1)]
    alone = learnt(found, 2, file)
    worse = [*found[:-1], replace(found[-1], setup=4 * found[-1].setup)]  # the last one took longer than was foretold
    assert learnt(worse, 2, file) > alone
    assert learnt(found, 2, file) > alone
    assert learnt(found[:1], 3, file) < alone + 0.1  # of other dimensions nothing is known
    assert [path.name for path in tmp_path.iterdir()] == ["prices.json"]
    assert learnt(found, 2, tmp_path / "nowhere" / "prices.json") == pytest.approx(alone, rel=0.3)


def test_the_block_is_as_accurate_as_was_foreseen() -> None:
    """Coarser versions are enough to tell with which mesh an error of .2 % is reached."""
    scene = read("block", ["output.pictures=false"])
    found = [one for one, _ in zip(coarse_versions(scene, 60.0), range(3), strict=False)]
    assert [one.level for one in found] == [-4, -3, -2]
    one = price(found, NAME, 0.002, dim=2)
    shape = replace(scene.geometry.refined(one.factor), order=1)
    simulation = prepare(replace(scene, geometry=shape))
    steps = list(simulation.steps())
    errors = {str(key): parts for key, parts in simulation.errors(steps)[-1].items()}
    reached = errors[f"contacts.{NAME}"].total / steps[-1].contacts["base"].normal_force
    assert 0.5 < reached / 0.002 < 1.5


def test_scenes_without_a_size_or_a_contact_are_refused() -> None:
    scene = read("block")
    with pytest.raises(SceneError, match="there is none, and of its numbers the prices are told"):
        foresee(replace(scene, contacts={}))
