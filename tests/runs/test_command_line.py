"""What a user types, what comes back, and what stands in the folder afterwards."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from shared.command import BUILT, COARSE, READY_NAMES, Call, result, table
from shared.disks import make_full
from shared.histories import SMALL
from stickslip import VERSION
from stickslip.workflows import commands as rooms
from stickslip.workflows.commands.cli import FIRST, commands
from stickslip.workflows.scene_file.read import READY, read

# --- what it says about itself


def test_help_names_what_is_built_and_each_command_explains_itself(call: Call) -> None:
    code, out, err = call("--help")
    assert (code, err) == (0, "")
    listed = re.findall(r"^  ([a-z]+) +\w", out.partition("Commands:")[2], re.MULTILINE)
    assert set(listed) == BUILT
    for name in listed:
        code, out, err = call(name, "--help")
        assert (code, err) == (0, "")
        assert ("--resume" in out) == (name in ("run", "cost", "verify"))


def test_a_command_is_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A function with the name of its file; it is listed behind the usual ones."""
    (tmp_path / "greeted.py").write_text("def greeted() -> None:\n    pass\n\n\ndef other() -> None:\n    pass\n")
    monkeypatch.setattr(rooms, "__path__", [*rooms.__path__, str(tmp_path)])
    assert list(commands()) == [*FIRST.split(), "extract", "greeted"]


@pytest.mark.parametrize("name", sorted(BUILT))
def test_every_command_of_the_help_has_its_code(name: str, call: Call) -> None:
    """Commands import what they need when they are called, so a missing module shows only then."""
    words = {
        "run": ["block", "-q", *COARSE],
        "plan": ["block"],
        "mesh": ["block"],
        "contacts": ["block"],
        "cost": ["block", "--budget", "0"],
        "sweep": ["block", "steps.count=[0]"],
        "verify": ["no such case"],
        "new": ["block"],
    }
    code, _, err = call(name, *words.get(name, []))
    refused = dict.fromkeys(("contacts", "cost", "sweep", "fclib", "report", "compare", "extract"), (2,))
    assert code in {"verify": (1, 2), **refused}.get(name, (0,))
    assert "Traceback" not in err


def test_no_command_shows_the_help(call: Call) -> None:
    assert call()[:2] == (0, call("--help")[1])


def test_version(call: Call) -> None:
    assert call("--version") == (0, f"{VERSION}\n", "")


@pytest.mark.parametrize("words", [["runn", "block"], ["run"], ["run", "block", "--frob"], ["plan", "block", "more"]])
def test_wrong_words_are_refused_with_one_line(words: list[str], call: Call, folder: Path) -> None:
    code, out, err = call(*words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("stickslip: ")
    assert not list(folder.iterdir())


# --- scenes, new


def test_scenes_lists_every_ready_scene_with_its_title(call: Call) -> None:
    code, out, err = call("scenes")
    assert (code, err) == (0, "")
    assert out.splitlines() == [f"{name:<12} {read(name).title}" for name in READY_NAMES]


@pytest.mark.parametrize("name", READY_NAMES)
def test_new_copies_a_ready_scene_that_reads_back_the_same(name: str, call: Call, folder: Path) -> None:
    code, out, err = call("new", name, "mine.toml")
    assert (code, err) == (0, "")
    assert "mine.toml" in out
    assert read(folder / "mine.toml") == read(name)


def test_new_names_its_file_after_the_scene_and_never_overwrites(call: Call, folder: Path) -> None:
    assert call("new", "block")[0] == 0
    (folder / "block.toml").write_text("mine now")
    code, _, err = call("new", "block")
    assert (code, err.count("\n")) == (2, 1)
    assert "block.toml" in err
    assert (folder / "block.toml").read_text() == "mine now"


def test_new_refuses_a_name_that_hides_a_ready_scene(call: Call, folder: Path) -> None:
    for words in (("block", "cube"), ("cube", "--from", "none.step")):
        code, _, err = call("new", *words)
        assert (code, err) == (
            2,
            "stickslip: cube: expected a name that ends in .toml, for the scene that is written\n",
        )
    assert not list(folder.iterdir())


def test_a_disk_that_refuses_a_new_scene_is_none_of_the_user_s_mistakes(call: Call, folder: Path) -> None:
    (folder / "file").touch()
    code, _, err = call("new", "block", "file/mine.toml")
    assert (code, err) == (4, "stickslip: file/mine.toml: cannot be written: Not a directory\n")


def test_a_full_disk_leaves_no_part_of_a_new_scene(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_full(monkeypatch)
    code, _, err = call("new", "block", "mine.toml")
    assert (code, "No space left on device" in err) == (4, True)
    assert not [*folder.iterdir()]


def test_new_refuses_an_unknown_scene_and_a_missing_folder(call: Call, folder: Path) -> None:
    code, _, err = call("new", "blok")
    assert (code, err) == (2, "stickslip: blok: no such ready scene; did you mean block?\n")
    code, _, err = call("new", "block", "nowhere/mine.toml")
    assert (code, err.count("\n")) == (2, 1)
    assert not list(folder.iterdir())


# --- plan


def test_plan_says_effects_reasons_method_and_times_and_writes_nothing(call: Call, folder: Path) -> None:
    code, out, err = call("plan", "block")
    assert (code, err) == (0, "")
    for said in (
        "contacts.base.friction",
        "plane strain",
        "method auto",
        "2 steps at t = 1, 2",
        read("block").title,
    ):
        assert said in out
    assert not list(folder.iterdir())


def test_plan_for_scripts_agrees_with_the_run(call: Call, folder: Path) -> None:
    code, out, err = call("plan", "block", "--mesh", "--json", *COARSE)
    assert (code, err) == (0, "")
    plan = json.loads(out)
    assert call("run", "block", "-q", "-o", "out", *COARSE)[0] == 0
    done = result(folder / "out")
    assert plan["effects"] == done["plan"]
    assert plan["method"] == "auto"
    assert plan["mesh"]["method"] == done["method"]
    assert plan["mesh"]["choice"] == done["choice"]
    assert plan["times"] == [step["time"] for step in done["steps"]]
    assert plan["mesh"]["displacement_unknowns"] == done["dofs"]
    assert plan["mesh"]["contacts"]["base"]["normal_points"] == done["contact_points"]
    assert plan["mesh"]["contacts"]["base"]["area"] == pytest.approx(4.0, rel=1e-12)  # length of the block


def test_plan_counts_the_mesh(call: Call) -> None:
    override = ["--set=geometry.mesh_size=0.5", "--set=geometry.cells='tensor'"]
    plan = json.loads(call("plan", "cube", "--mesh", "--json", *override)[1])
    assert (plan["mesh"]["cells"], plan["mesh"]["nodes"]) == (8, 27)
    assert plan["mesh"]["displacement_unknowns"] == 3 * (27 - 9)  # the top is held in x, y and z
    assert plan["mesh"]["contacts"]["base"]["normal_points"] == 9


# --- run


def test_quiet_run_is_silent(call: Call, folder: Path) -> None:
    assert call("run", "block", "-q", *COARSE) == (0, "", "")
    assert result(folder / "results" / "block")["status"] == "converged"  # the default folder


def test_run_says_where_the_results_are_and_verbose_says_each_iteration(call: Call, folder: Path) -> None:
    code, out, err = call("run", "block", "-v", "-o", "out", *COARSE)
    assert code == 0
    assert read("block").title in out
    assert "results in out" in out
    rows = table(folder / "out" / "history.csv")
    assert len(re.findall(r"iteration \d+ +residual", err)) == len(rows)
    quieter = call("run", "block", "-o", "out", *COARSE)
    assert quieter[0] == 0
    assert "iteration 1 " not in quieter[2]


def test_set_overrides_numbers_words_and_tables(call: Call, folder: Path) -> None:
    more = ["--set", "solver.method=uzawa", "--set", "contacts.base.friction.mu=0.1", "--set", "title=A new title"]
    assert call("run", "block", "-q", "-o", "out", *COARSE, *more)[0] == 0
    done = result(folder / "out")
    assert done["method"] == "uzawa"
    assert done["scene"]["contacts"]["base"]["friction"] == {"law": "coulomb", "mu": 0.1}
    assert done["scene"]["title"] == "A new title"
    assert done["steps"][-1]["contacts"]["base"]["tangential_force"] > 0  # mu = 0.1: it slips more, and still rubs


def test_second_run_keeps_the_first_one_aside(call: Call, folder: Path) -> None:
    for nu in (0.1, 0.2, 0.3):
        assert call("run", "block", "-q", "-o", "out", *COARSE, f"--set=bodies.block.nu={nu}")[0] == 0
    assert sorted(path.name for path in folder.iterdir()) == ["out", "out.1"]
    assert result(folder / "out")["scene"]["bodies"]["block"]["nu"] == 0.3
    assert result(folder / "out.1")["scene"]["bodies"]["block"]["nu"] == 0.2


def test_foreign_folder_in_the_place_of_the_old_results_is_kept(call: Call, folder: Path) -> None:
    (folder / "out.1").mkdir()
    (folder / "out.1" / "chapter.tex").write_text("years of work")
    code, _, err = call("run", "block", "-q", "-o", "out", *COARSE)
    assert (code, err.count("\n")) == (2, 1)
    assert [path.name for path in folder.iterdir()] == ["out.1"]


def test_wrong_scene_leaves_earlier_results_alone(call: Call, folder: Path) -> None:
    assert call("run", "block", "-q", "-o", "out", *COARSE)[0] == 0
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert call("run", "block", "-q", "-o", "out", "--set", "bodies.block.nu=0.7")[0] == 2
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_slash_at_the_end_of_the_folder_means_nothing(call: Call, folder: Path) -> None:
    assert call("run", "block", "-q", "-o", "out/", *COARSE)[0] == 0
    assert sorted(path.name for path in folder.iterdir()) == ["out"]


def test_output_here_is_refused_or_solved_but_never_lost(call: Call, folder: Path) -> None:
    (folder / "mine.toml").write_text((READY / "block.toml").read_text())
    code, _, err = call("run", "mine.toml", "-q", "-o", ".", *COARSE)
    assert (code, err.count("\n")) == (2, 1), err
    assert (folder / "mine.toml").exists()


def test_every_second_step_is_shown_and_all_are_stored(call: Call, folder: Path) -> None:
    assert call("run", "block", "-q", "-o", "out", *COARSE, "--set=steps.count=5", "--set=output.every=2")[0] == 0
    shown = re.findall(r"steps/(\d+)\.h5:/displacement", (folder / "out" / "fields.xdmf").read_text())
    assert [int(index) for index in shown] == [2, 4, 6]  # t = 0.4, 0.8, (1), 1.2, 1.6, 2: six times, and the last
    assert len(list((folder / "out" / "steps").glob("*.h5"))) == 6


def test_a_run_prints_its_result_for_scripts(call: Call, folder: Path) -> None:
    code, out, err = call("run", "block", "-o", "out", "--json", *(f"--set={word}" for word in SMALL))
    assert code == 0
    assert json.loads(out) == result(folder / "out")
    assert "unknown displacements" in err
    code, out, _ = call("run", "block", "-o", "out", "--json", "--set=bodies.block.nu=2")
    assert (code, out) == (2, "")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("stickslip sch", {"schema"}),
        ("stickslip run hal", {"half_ball", "half_disc", "half_space"}),
        ("stickslip plan m", {"mine.toml", "models/"}),
        ("stickslip run ./m", set()),
        ("stickslip run block --re", {"--resume"}),
    ],
)
def test_a_shell_completes_commands_scenes_and_options(
    words: str, expected: set[str], folder: Path, environment: dict[str, str]
) -> None:
    (folder / "mine.toml").touch()
    (folder / "models").mkdir()
    asked = {"_STICKSLIP_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)}
    program = "import sys; sys.argv[0] = 'stickslip'; from stickslip.workflows.commands.start import main; main()"
    line, variables = [sys.executable, "-c", program], environment | asked
    done = subprocess.run(line, cwd=folder, env=variables, capture_output=True, text=True, check=False)
    assert (set(done.stdout.split()), done.stderr) == (expected, "")
