"""A run whose audit passes a limit ends as doubtful, with everything written; misuse is named, also in the files."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from shared.command import COARSE, Spoken, result
from shared.histories import RUN_FOUR, SMALL
from stickslip.solvers.laws.friction import Coulomb
from stickslip.workflows.formats.steps import step_name

Call = Callable[..., Spoken]
NUMBERS = {
    "equilibrium",
    "rounding",
    "supports",
    "penetration",
    "negative_pressure",
    "cone",
    "complementarity",
    "dissipation",
    "fields",
}


def sets(*overrides: str) -> list[str]:
    return [f"--set={word}" for word in (*overrides, "output.pictures=false")]


BALL = sets("geometry.order=1", "geometry.mesh_size=0.3", "geometry.contact_mesh_size=0.06", "steps.count=2")


def warned(call: Call, folder: Path, *words: str) -> list[str]:
    """Warnings in result.json of a run that ends with exit code 0; the terminal and the log say the same."""
    code, _, err = call("run", *words, "-o", "out")
    assert code == 0, err
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


def test_a_wrong_answer_is_doubtful_and_everything_is_written(
    call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    code, _, _ = call("run", "block", *COARSE, "-o", "other", "--set=output.audit=false")
    assert code == 0
    assert result(folder / "other")["verdict"] is None


WRONG = {
    "a body far too stiff for its weight": ("strip", ["bodies.strip.E=1e18"], "equilibrium is"),
}


@pytest.mark.parametrize(("scene", "overrides", "words"), WRONG.values(), ids=WRONG)
def test_answers_that_were_seen_wrong(scene: str, overrides: list[str], words: str, call: Call, folder: Path) -> None:
    code, _, err = call("run", scene, *sets(*overrides), "-o", "out")
    assert code == 1, err
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
    code, _, err = call("run", scene, *overrides, *sets("solver.tolerance=1e-4", "output.error=false"), "-o", "out")
    assert code == 0, err


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
    code, out, err = call("run", "two_blocks", f"--set={back}")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert "contacts.back has the same two sides exchanged: both would carry the pressure; keep one" in err
    assert not list(folder.iterdir())


def test_a_step_of_another_run_is_refused(call: Call, folder: Path) -> None:
    """The same mesh and times, another friction: only the step itself can tell."""
    words = [f"--set={word}" for word in (*SMALL, "output.error=false")]
    for name, mu in (("one", 0.3), ("other", 0.5)):
        assert call("run", "block", *words, f"--set=contacts.base.friction.mu={mu}", "-o", name)[0] == 0
    shutil.copy(folder / "other" / step_name(2), folder / "one" / step_name(2))
    (folder / "one").rename(folder / ".one.running")  # as a run that was killed leaves it
    (folder / ".one.running" / "result.json").unlink()
    code, _, err = call("run", "block", *words, "--set=contacts.base.friction.mu=0.3", "-o", "one", "--resume")
    assert code == 4
    assert "steps/000002.h5: is a step of another run; nothing is resumed, nothing was changed" in " ".join(err.split())


def test_motions_whose_squares_are_zero_are_audited(call: Call, folder: Path) -> None:
    tiny = [f"--set=supports.top.displacement.{axis}={value}" for axis, value in (("x", "1e-302"), ("y", "-1e-302"))]
    assert call(*RUN_FOUR, *tiny)[0] in (0, 1)
    assert result(folder / "out")["audit"]["dissipation"] == 0.0
