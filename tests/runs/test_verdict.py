"""A result says whether it may be trusted: its verdict, its warnings, its sentences are true."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from petsc4py import PETSc

from shared.command import COARSE, READY_NAMES, Spoken, assert_one_line, assert_said, ended, result
from shared.drawn import FACES, draw, scene_data, write_hinge
from shared.histories import PUSHED, RUN_FOUR, SMALL, assert_same, unchanged
from stickslip.geometry.errors import MachineError, SceneError
from stickslip.solvers.interface import factorised
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.simulation.plan import warnings
from stickslip.workflows.commands.cli import LONGEST, shortened
from stickslip.workflows.formats.steps import step_name
from stickslip.workflows.run.folder import BEGUN, RESULT
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict, read

Call = Callable[..., Spoken]
NUMBERS = {
    *("equilibrium", "rounding", "supports", "penetration", "negative_pressure", "cone", "complementarity"),
    *("dissipation", "fields", "moment", "numbers", "files"),
}


def sets(*overrides: str) -> list[str]:
    return [f"--set={word}" for word in (*overrides, "output.pictures=false")]


BALL = sets("geometry.order=1", "geometry.mesh_size=0.3", "geometry.contact_mesh_size=0.06", "steps.count=2")


def warned(call: Call, folder: Path, *words: str) -> list[str]:
    """Warnings in result.json of a run that ends with exit code 0; the terminal and the log say the same."""
    _, err = ended(call("run", *words, "-o", "out"))
    content = result(folder / "out")
    log = (folder / "out" / "run.log").read_text()
    for line in content["warnings"]:
        assert line in " ".join(err.split())
        assert f"WARNING {line}" in log
    assert (content["status"], content["sentence"]) == ("converged", "")
    shutil.rmtree(folder / "out")
    return list(content["warnings"])


def test_a_sound_run_has_a_verdict_and_no_warning(call: Call, folder: Path) -> None:
    many = "--set=steps.count=16"  # two leave a large error in the dissipation, which is said
    assert warned(call, folder, "block", *COARSE, many) == []
    call("run", "block", *COARSE, many, "-o", "out")
    verdict = result(folder / "out")["verdict"]
    assert set(verdict["limits"]) == set(result(folder / "out")["audit"]) == NUMBERS
    assert (verdict["passed"], verdict["shared"]) == ([], [])


def test_an_answer_whose_pairs_do_not_settle_is_doubtful(
    call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stickslip.solvers.stepping.pairs.slid_since", lambda *given: 1.0)
    coarse = sets("geometry.mesh_size=0.5", "geometry.lower_mesh_size=0.4", "steps.count=2", 'output.error="rough"')
    code, _, err = call("run", "sliding", *coarse, "-o", "out")
    assert code == 1
    said = "the pairs of a sliding contact change from search to search at t = 1"
    assert f"stickslip: doubtful: {said}" in err
    assert not any(said in warning for warning in result(folder / "out")["warnings"])  # once is enough
    assert result(folder / "out")["status"] == "doubtful"


def test_a_wrong_answer_is_doubtful_and_all_written(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    true = Coulomb.limit
    with monkeypatch.context() as patch:
        patch.setattr(Coulomb, "limit", lambda self, *given: 1.5 * true(self, *given))
        code, _, err = call("run", "block", *COARSE, "-o", "out")
    assert code == 1
    said = " ".join(err.split())
    assert "stickslip: doubtful: the audit finds that cone is 5.0e-01 in step 1 (t = 1), more than 1.0e-05" in said
    content = result(folder / "out")
    assert content["status"] == "doubtful"
    assert content["sentence"].startswith("the audit finds that cone is 5.0e-01 in step 1")
    assert content["verdict"]["passed"][0].startswith("cone is")
    names = {path.name for path in (folder / "out").iterdir()}
    assert {"result.json", "run.log", "steps.csv", "fields.xdmf", "steps"} <= names
    code, _, err = call("run", "block", *COARSE, "-o", "out", "--resume")  # nothing is left to solve
    assert (code, "doubtful" in err) == (1, True)
    assert call("run", "block", *COARSE, "-o", "other", "--set=output.audit=false")[0] == 0
    assert result(folder / "other")["verdict"] is None


WRONG = {"a body far too stiff for its weight": ("strip", ["bodies.strip.E=1e18"], "equilibrium is")}


@pytest.mark.parametrize(("scene", "overrides", "words"), WRONG.values(), ids=WRONG)
def test_answers_that_were_seen_wrong(scene: str, overrides: list[str], words: str, call: Call, folder: Path) -> None:
    _, err = ended(call("run", scene, *sets(*overrides), "-o", "out"), 1)
    assert words in " ".join(err.split())


@pytest.mark.parametrize(
    ("scene", "overrides"),
    [
        ("half_ball", [*BALL, *sets("contacts.pole.friction.mu=1e-3")]),
        ("cube", sets("geometry.mesh_size=0.125", "contacts.base.friction.mu=1e-5")),
    ],
)
def test_little_friction_is_judged_by_the_tolerance_of_all_tractions(
    scene: str, overrides: list[str], call: Call, folder: Path
) -> None:
    ended(call("run", scene, *overrides, *sets("solver.tolerance=1e-4", "output.error=false"), "-o", "out"))


def test_a_far_motion_does_not_cry_wolf(call: Call, folder: Path) -> None:
    wall = "supports.wall.displacement={x=[[0, 0], [1, 5]]}"
    said = warned(call, folder, "foundation", *sets("geometry.mesh_size=0.25", wall))
    assert not [line for line in said if "doubtful" in line or "rounding" in line], said


MISUSE = {
    "a slip beyond a facet": (
        ["two_blocks", *sets("geometry.contact_mesh_size=0.2", "geometry.mesh_size=0.3", "geometry.lower_mesh_size=0.4",
                             "supports.top.displacement={x=[[0,0],[1,0],[2,0.5]],y=[[0,0],[1,-0.05]]}")],
        r"contacts.joint: slips by up to 0.4",
    ),
    "a body that turns": (
        ["block", *COARSE, "--set=supports.top.displacement={x=[[0, 0], [1, 0], [2, 0.4]], y=[[0, 0], [1, -0.1]]}",
         "--set=contacts.base.friction.mu=2.0"],
        "bodies turn by up to 0.",
    ),
    "few points that did touch": (
        ["sphere", *sets("geometry.contact_mesh_size=0.008")],
        "contacts.pole: only 4 points touch, on 1 whole facets",
    ),
    "a peak of the mesh": (
        ["half_ball", *BALL],
        "contacts.pole: the maximum pressure stands 12% above",
    ),
    "order 1 on a curved side": (
        ["shrink_fit", *sets("geometry.order=1", "geometry.mesh_size=0.6", "geometry.inner_mesh_size=0.45")],
        "contacts.fit: flat facets cut up to",
    ),
    "elements that lock": (
        ["half_ball", *BALL, *sets("bodies.ball.nu=0.49", "bodies.ball.formulation=displacement")],
        "the mean stress jumps between cells by",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("words", "said"), MISUSE.values(), ids=MISUSE)
def test_misuse_is_named_after_the_solve(words: list[str], said: str, call: Call, folder: Path) -> None:
    assert any(line.startswith(said) for line in warned(call, folder, *words)), said


def test_a_given_gap_is_not_that_of_flat_facets(call: Call, folder: Path) -> None:
    words, _ = MISUSE["order 1 on a curved side"]
    lines = warned(call, folder, *words, "--set=contacts.fit.gap=-1e-3")
    assert not [line for line in lines if "flat facets" in line]


def test_warnings_of_before_the_solve_stand_in_the_file_too(call: Call, folder: Path) -> None:
    lines = warned(call, folder, "block", *COARSE, "--set=bodies.block={E=1.0,nu=0.495,formulation='displacement'}")
    assert any(line.startswith("bodies.block.nu = 0.495: displacements of order 1 lock") for line in lines)


def test_a_long_slide_on_a_plane_or_with_sliding_is_no_misuse(call: Call, folder: Path) -> None:
    far = "supports.top.displacement={x=[[0,0],[1,0],[2,1.0]],y=[[0,0],[1,-0.02]]}"
    assert not any("slips" in line for line in warned(call, folder, "block", *COARSE, f"--set={far}"))
    assert warned(call, folder, "sliding", *sets("geometry.mesh_size=0.2")) == []


def test_each_side_slave_of_the_other_is_refused(call: Call, folder: Path) -> None:
    back = 'contacts.back={surface="lower.top", against="upper.bottom", normal={law="tied"}}'
    assert_said(
        call("run", "two_blocks", f"--set={back}"),
        2,
        "contacts.back has the same two sides exchanged: both would carry the pressure; keep one",
    )
    assert not list(folder.iterdir())


def test_a_step_of_another_run_is_refused(call: Call, folder: Path) -> None:
    """The same mesh and times, another friction: only the step itself can tell."""
    words = [f"--set={word}" for word in (*SMALL, "output.error=false")]
    for name, mu in (("one", 0.3), ("other", 0.5)):
        assert call("run", "block", *words, f"--set=contacts.base.friction.mu={mu}", "-o", name)[0] == 0
    shutil.copy(folder / "other" / step_name(2), folder / "one" / step_name(2))
    (folder / "one").rename(folder / ".one.running")  # as a run that was killed leaves it
    (folder / ".one.running" / "result.json").unlink()
    _, err = ended(call("run", "block", *words, "--set=contacts.base.friction.mu=0.3", "-o", "one", "--resume"), 4)
    assert "steps/000002.h5: is a step of another run; nothing is resumed, nothing was changed" in " ".join(err.split())


@pytest.mark.parametrize("tiny", ["1e-302", "'1e-170*t'"])
def test_motions_whose_squares_are_zero_are_refused(tiny: str, call: Call, folder: Path) -> None:
    """The forces had no work. No folder is left, and results that were there are."""
    assert call(*RUN_FOUR)[0] == 0
    with unchanged(folder):
        _, err = ended(call(*RUN_FOUR, f"--set=supports.top.displacement={{x=0.0,y={tiny}}}"), 2)
        assert_one_line(err)
        assert re.search("y = 1e-302: must be 0, or from|motions of about .*e-17[01] .* squares are 0 or infinite", err)


SOFT = "--set=bodies.block.nu=0.4999"
ALONE = "--set=bodies.block.formulation=displacement"
LOCKS = "warning: bodies.block.nu = 0.4999: displacements of order 1 lock"


def flat(text: str) -> str:
    """Without the line breaks of a narrow terminal."""
    return " ".join(text.split())


def test_plan_and_run_warn_of_linear_elements_that_lock(call: Call, folder: Path) -> None:
    out, _ = ended(call("plan", "block", SOFT, ALONE))
    assert LOCKS in flat(out)
    said = [*warnings(read("block", [SOFT[6:], ALONE[6:]]))]
    assert json.loads(call("plan", "block", "--json", SOFT, ALONE)[1])["warnings"] == said
    _, err = ended(call("run", "block", "-o", "out", SOFT, ALONE, *COARSE))
    assert LOCKS in flat(err)
    assert "WARNING bodies.block.nu = 0.4999" in (folder / "out" / "run.log").read_text()


@pytest.mark.parametrize(
    "override", ["bodies.block.nu=0.48", "geometry.order=2", "model='plane stress'", "bodies.block.formulation='auto'"]
)
def test_no_warning_where_nothing_locks(override: str) -> None:
    assert warnings(read("block", [SOFT[6:], ALONE[6:]]))
    assert warnings(read("block", [SOFT[6:], ALONE[6:], override])) == ()


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("x=[[5, 1]]", "supports.top.displacement.x: its table goes on up to t = 5, past steps.end = 2; what"),
        (
            "x=[[0, 0], [3, 1]], y=[[0, 0], [4, 1], [6, 0.5]]",
            "supports.top.displacement.y: its table goes on up to t = 6, past steps.end = 2, as 2 tables do; what",
        ),
        ("x=[[0, 0], [2, 1]], y=0.1", None),
        ("x=[[0, 0], [1, 0.1], [9, 0.1]]", None),  # nothing happens any more
    ],
)
def test_a_table_that_goes_on_after_the_end_is_said(table: str, said: str | None, call: Call) -> None:
    word = f"supports.top.displacement={{{table}}}"
    assert [line[: len(said or "")] for line in warnings(read("block", [word]))] == ([said] if said else [])
    code, out, _ = call("plan", "block", "--set", word)
    assert (code, f"warning: {said}" in flat(out)) == (0, said is not None)


@pytest.mark.parametrize("name", READY_NAMES)
def test_ready_scenes_are_warned_of_nothing(name: str) -> None:
    assert warnings(read(name)) == tuple(line for line in warnings(read(name)) if "mu falls by" in line)


def test_bodies_that_nothing_loads_are_doubted(call: Call, folder: Path) -> None:
    still = "--set=supports.top.displacement={x=0, y=0}"
    code, _, err = call("run", "block", "-o", "out", still, *COARSE)
    assert (code, "warning: nothing loads or moves the bodies" in flat(err)) == (0, True), err
    assert any("nothing loads" in line for line in result(folder / "out")["warnings"])


def test_displacements_that_are_not_small_are_doubted(call: Call, folder: Path) -> None:
    """A block 2 m high, pressed by 1.8 m; or moved by 10 m as a whole, together with its foundation."""
    coarse = ("--set", "geometry.mesh_size=0.5", "--set", "geometry.contact_mesh_size=0.5", *COARSE[2:])
    pressed = "supports.top.displacement={x=0, y=[[0, 0], [1, -1.8]]}"
    _, err = ended(call("run", "block", *coarse, "--set", pressed))
    assert "warning: displacements differ by up to 0.4" in flat(err)  # 1.8 and more, of the diagonal 20^(1/2)
    assert "displacements differ" in (folder / "results" / "block" / "run.log").read_text()
    moved = ("--set", "supports.top.displacement={x=10, y=0}", "--set", "obstacles.foundation.displacement={x=10}")
    for overrides in ((), moved):
        assert "displacements differ" not in call("run", "block", *coarse, *overrides)[2]


@pytest.mark.parametrize("keeps", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_steps_that_leave_a_large_error_are_doubted(keeps: bool, call: Call, folder: Path) -> None:
    """And the number of steps that is asked for keeps what it promises."""
    coarse = ["--set=geometry.mesh_size=0.3", "--set=geometry.contact_mesh_size=0.03", "--set=geometry.order=1"]
    coarse += [f"--set={word}" for word in (*PUSHED, "steps.count=10")]
    words = ["run", "half_disc", *coarse, "--set=output.pictures=false"]
    silent = ["--set=output.error=false", "--set=steps.count=1"]
    _, err = ended(call(*words, "-o", "few"))
    said = re.search(
        r"warning: the time steps leave an error of about (\d+)% in the (?:dissipation|\w+ area) of contacts.pole; use "
        r"steps.count = (\d+)",
        flat(err),
    )
    assert said[0][9:] in result(folder / "few")["warnings"]
    assert "the time steps leave" not in call(*words, "-o", "silent", *silent)[2]
    if not keeps:
        return
    call(*words, "-o", "many", f"--set=steps.count={said[2]}")
    few, many = (result(folder / name)["steps"][-1] for name in ("few", "many"))
    before, after = (step["contacts"]["pole"] for step in (few, many))
    assert after["error"]["dissipation_total"]["time_step"] < 0.05 * after["dissipation_total"]
    true = abs(before["dissipation_total"] - after["dissipation_total"])
    assert 0.7 * true < before["error"]["dissipation_total"]["time_step"] < 3 * true


@pytest.mark.parametrize("pressure", [-0.001, 0.0])
def test_a_curved_contact_that_is_pulled_or_unloaded_ends(pressure: float, call: Call, folder: Path) -> None:
    (folder / "pulled.toml").write_text(
        'model = "plane strain"\n[geometry]\nbuilder = "ring"\ninner_radius = 1.0\nouter_radius = 1.5\nangle = 90\n'
        "mesh_size = 0.25\ncontact_mesh_size = 0.2\n[bodies.ring]\nE = 1.0\nnu = 0.3\n[obstacles.shaft]\n"
        'shape = "cylinder"\npoint = [0.0, 0.0]\nradius = 1.0\n[contacts.bore]\nsurface = "ring.inner"\n'
        'against = "shaft"\nnormal = { law = "bilateral" }\n[supports.x_axis]\nboundary = "ring.x_axis"\n'
        'displacement = { y = 0.0 }\n[supports.y_axis]\nboundary = "ring.y_axis"\ndisplacement = { x = 0.0 }\n'
        f'[loads.pull]\nboundary = "ring.outer"\npressure = {pressure}\n[output]\npictures = false\nerror = false\n'
    )
    _, err = ended(call("run", "pulled.toml"))
    assert "curved" not in err


PIECES = """
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 2};
Rectangle(2) = {1, 0, 0, 1, 2};
"""
IN_ONE = """
Physical Surface("block") = {1, 2};
Physical Curve("block.bottom") = Curve In BoundingBox {-0.1, -0.1, -1, 2.1, 0.1, 1};
Physical Curve("block.top") = Curve In BoundingBox {-0.1, 1.9, -1, 2.1, 2.1, 1};
"""
SEAM = 'Physical Curve("block.seam") = Curve In BoundingBox {0.9, -0.1, -1, 1.1, 2.1, 1};\n'


@pytest.mark.parametrize(
    ("drawing", "warned"),
    [
        (PIECES + IN_ONE, True),
        (PIECES + "Coherence;" + IN_ONE, False),
        (PIECES.replace("1, 0, 0, 1, 2", "1.1, 0, 0, 0.9, 2") + IN_ONE, False),
        (PIECES + IN_ONE + SEAM, False),  # may be a contact
    ],
)
def test_a_body_whose_pieces_only_seem_to_hold_is_warned_of(drawing: str, warned: bool, tmp_path: Path) -> None:
    (tmp_path / "b.geo").write_text(drawing)
    _, content = run(from_dict(scene_data(tmp_path / "b.geo", mesh_size=0.5)), tmp_path / "out")
    said = "body block is in pieces: 3 pairs of nodes lie at the same place"  # five, with those of bottom and top
    assert any(said in line for line in content["warnings"]) == warned, content["warnings"]


@pytest.mark.parametrize(
    ("units", "length_unit", "warned"),
    [("SI", None, True), ("SI", "m", False), ("SI", "mm", False), ("mm-N-MPa", None, False)],
)
def test_a_step_file_taken_in_another_unit_than_gmsh_gives_is_warned_of(
    units: str, length_unit: str | None, warned: bool, tmp_path: Path
) -> None:
    data = scene_data(draw(tmp_path / "b.step"), 3, "part", mesh_size=0.5, names=FACES, length_unit=length_unit)
    said = 'box, read in m, is 4 x 2 x 2 m: write length_unit = "mm", or "m" if that is meant'
    assert any(said in warning for warning in warnings(from_dict(data | {"units": units}))) == warned


TILTED = """
model = "plane strain"
geometry = { builder = "two_blocks", length = 1.0, height = 0.25, lower_length = 2.0, mesh_size = 0.25 }
bodies = { upper = { E = 1e6, nu = 0.3 }, lower = { E = 1e8, nu = 0.3 } }
loads.top = { boundary = "upper.top", traction = [0.0, -400.0] }
steps = { end = 2.0, count = 4 }

[contacts.base]
surface = "upper.bottom"
against = "lower.top"
friction = { law = "coulomb", mu = 0.1 }

[remote_points.base]
boundary = "lower.bottom"
point = [0.0, -0.5]
coupling = "rigid"
displacement = { x = 0.0, y = 0.0 }
rotation = { z = [[0, 0], [1, 0.02]] }

[springs.pull]
at = "upper.right"
stiffness = 2e4
direction = [1.0, 0.0]
displacement = [[[0, 0], [1, 0], [2, 0.01]], 0.0]
"""


def test_sides_that_turn_by_a_part_of_mu_are_doubted(call: Call, folder: Path) -> None:
    """A block pulled up a slope of .02 rad, to which its foundation turns: N (mu + .02) / (1 - .02 mu) in truth."""
    (folder / "tilted.toml").write_text(TILTED)
    pulls = {}
    for sliding in ("false", "true"):
        bare = ("--set=output.error=false", "--set=output.pictures=false", f"--set=contacts.base.sliding={sliding}")
        code, _, err = call("run", "tilted.toml", "-o", sliding, *bare)
        step = result(folder / sliding)["steps"][-1]
        assert (code, "contacts.base: its sides turn by 20% of mu" in flat(err)) == (0, sliding == "false"), err
        pulls[sliding] = step["springs"]["pull"]["force"][0]
    assert pulls["false"] == pytest.approx(40.0, rel=1e-6)
    assert pulls["true"] == pytest.approx(400 * 0.12 / (1 - 0.002), rel=2e-3)


@pytest.mark.parametrize("carries", [True, False])
def test_a_support_at_a_point_that_carries_is_doubted(carries: bool, call: Call, folder: Path) -> None:
    """Two points under a block; or one beside a side that carries, which holds it along the side alone."""
    held = {
        True: "supports={a={point=[0.0,2.0],displacement={x=0,y=0}},b={point=[4.0,2.0],displacement={y=-0.01}}}",
        False: "supports={a={point=[0.0,2.0],displacement={x=0}},b={boundary='block.top',displacement={y=-0.01}}}",
    }
    smooth = "--set=contacts.base={surface='block.bottom',against='foundation'}"
    words = ["--set=geometry.mesh_size=0.5", "--set=geometry.contact_mesh_size=0.5", "--set=output.error=false", smooth]
    code, _, err = call("run", "block", "-o", "out", *words, f"--set={held[carries]}")
    assert (code, "a point carries" in flat(err)) == (0, carries), err


def test_steps_that_are_gone_are_not_said_to_be_kept(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def lose(self: object, step: StepResult) -> None:
        if step.time == 1.0:
            shutil.rmtree(folder / ".out.running")

    monkeypatch.setattr("stickslip.workflows.run.terminal.Reporter._step", lose)
    _, err = ended(call(*RUN_FOUR), 4)
    assert_one_line(err)
    assert ".out.running: is gone, and with it the steps so far" in err
    assert "kept" not in err
    assert "--resume" not in err


def test_lost_beginning_does_not_send_in_a_circle(call: Call, stopped: Path) -> None:
    (stopped / BEGUN).unlink()
    with unchanged(stopped):
        code, _, err = call(*RUN_FOUR)
        assert (code, "--resume" in err, f"without its {BEGUN}" in err) == (2, False, True)
        assert_one_line(err)
        assert_said(call(*RUN_FOUR, "--resume"), 4, f"{BEGUN}: is lost")


@pytest.mark.parametrize("content", [None, "", "{", "[]", "[" * 100_000, "\0" * 100])
def test_result_that_is_lost_or_damaged_does_not_block_sound_steps(
    content: str | None, call: Call, stopped: Path, whole: Path
) -> None:
    (stopped / RESULT).unlink()
    if content is not None:
        (stopped / RESULT).write_text(content)
    assert call(*RUN_FOUR, "--resume")[0] == 0
    assert_same(stopped, whole)


@pytest.mark.parametrize("status", ["converged", "doubtful"])
def test_result_that_was_edited_is_not_believed(status: str, call: Call, stopped: Path, whole: Path) -> None:
    text = (stopped / RESULT).read_text()
    (stopped / RESULT).write_text(text.replace('"status": "interrupted"', f'"status": "{status}"'))
    _, err = ended(call(*RUN_FOUR, "--resume"))
    assert "out/result.json: was changed after the run; the steps decide" in err
    assert_same(stopped, whole)


def test_edited_result_without_steps_is_left_alone(call: Call, stopped: Path) -> None:
    (stopped / RESULT).write_text('{"status": "converged"}')
    shutil.rmtree(stopped / "steps")
    with unchanged(stopped):
        assert_said(call(*RUN_FOUR, "--resume"), 4, "was changed after the run, and its steps are gone")


NAMES = [step_name(1), step_name(2), BEGUN, RESULT, "run.log", "fields.h5", "history.csv"]
KINDS = ["pipe", "device", "folder"]
OFTEN = {(step_name(1), "pipe"), (RESULT, "device"), ("run.log", "folder")}


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    ("name", "kind"),
    [  # each kind of each file when there is time
        pytest.param(name, kind, marks=[] if (name, kind) in OFTEN else pytest.mark.slow)
        for name in NAMES
        for kind in KINDS
    ],
)
def test_what_is_no_file_is_not_read_for_ever(name: str, kind: str, call: Call, stopped: Path) -> None:
    path = stopped / name
    path.unlink()
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    for words in (["--resume"], []):
        code, _, err = call(*RUN_FOUR, *words)
        assert code in (0, 2, 4), err
        assert "Traceback" not in err
        if code:
            assert_one_line(err)
        assert os.path.lexists(path)


def test_refusals_are_short_lines_that_keep_beginning_and_end() -> None:
    text = "bodies.block.E = " + "9" * 100_000 + ": must be positive"
    assert len(shortened(text, LONGEST)) == LONGEST < 300
    assert shortened(text).startswith("bodies.block.E = ")
    assert shortened(text).endswith(": must be positive")
    assert shortened("short") == "short"


@pytest.mark.parametrize(
    "words",
    [
        ["run", "x" * 100_000],
        ["run", "block", f"--set=title={'x' * 100_000}", "--set=nothing=1"],
        ["run", "block", f"--set={'x' * 100_000}=1"],
        ["x" * 100_000],
        ["new", "x" * 100_000],
        ["verify", "x" * 100_000],
        ["fclib", "x" * 100_000],
        ["cost", "block", "--quantity", "x" * 100_000],
        ["mesh", "block", "-o", "x" * 100_000],
    ],
)
def test_endless_words_are_not_echoed(words: list[str], call: Call) -> None:
    code, _, err = call(*words)
    assert code in (2, 4)
    assert_one_line(err)


def _factorised(*pivots: float) -> None:
    K = PETSc.Mat().createAIJ((len(pivots), len(pivots)), nnz=1)
    K.setUp()
    for row, pivot in enumerate(pivots):
        K.setValue(row, row, pivot)
    K.assemble()
    factorised.FactorisedVolume(K, np.zeros(0, np.int32), Counters())


def test_mechanism_is_not_reported_as_too_little_memory() -> None:
    with pytest.raises(SceneError, match="stiffness of the bodies is singular: part of a body moves") as found:
        _factorised(1.0, 0.0, 1.0)
    assert (found.value.exit_code, "memory" in str(found.value)) == (2, False)
    _factorised(1.0, 1.0, 1.0)


def test_mechanism_is_refused_and_named_before_anything_is_factorised(call: Call, folder: Path) -> None:
    scene = write_hinge(folder)
    assert_said(
        call("run", str(scene), "-q", "-o", "out"),
        2,
        "a part of the mesh that no contact touches can turn about (1, 1), where it hangs on the rest",
    )
    assert not (folder / "out").exists()
    held = "--set=supports.right={boundary='block.right',displacement={x=0.0,y=0.0}}"
    assert call("run", str(scene), "-q", "-o", "out", held) == (0, "", "")


def test_too_little_memory_is_called_so(monkeypatch: pytest.MonkeyPatch) -> None:
    for word, numbers in (("SINGULAR", ()), ("NO_MEMORY", (-10, -40))):
        monkeypatch.setattr(factorised, word, numbers)
    with pytest.raises(MachineError, match="too little memory to factorise the bodies") as found:
        _factorised(0.0)
    assert found.value.exit_code == 4
