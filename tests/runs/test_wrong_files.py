"""What is no scene is refused with one line, all mistakes of one are said at once, and nobody's files are touched."""

import re
from pathlib import Path

import pytest

from shared.command import COARSE, Call, assert_refused
from stickslip.workflows.scene_file.read import READY, read


@pytest.mark.parametrize(
    ("text", "pattern"),
    [
        ("model = 'plane strain\n", r"scene\.toml: not valid TOML: Expected"),
        ("title = 'a'\ntitle = 'b'\n", r"scene\.toml: not valid TOML: .*line 2"),
        ("", r"scene\.toml: .*missing"),
        ("model = '3d'\n[geometry]\nbuilder = 'block'", r"scene\.toml:2: geometry\.[a-z_]+: missing"),
        ("a = " + "[" * 40 + "]" * 40, r"scene\.toml:1: a\.0\.0.*: tables and lists more than 20 deep"),
    ],
    ids=["quote left open", "key twice", "empty", "little", "nested"],
)
def test_file_that_is_no_scene_is_refused(text: str, pattern: str, call: Call, folder: Path) -> None:
    (folder / "scene.toml").write_text(text)
    assert_refused(call("run", "scene.toml", "-q"), pattern, folder, ["scene.toml"])


def test_bytes_that_are_no_text_are_refused(call: Call, folder: Path) -> None:
    (folder / "scene.toml").write_bytes(b"title = '\xff\xfe'")
    assert_refused(call("run", "scene.toml", "-q"), r"scene\.toml: is not a text file", folder, ["scene.toml"])


def test_missing_file_is_refused_with_the_nearest_ready_scene(call: Call, folder: Path) -> None:
    assert_refused(
        call("run", "blok", "-q"), r"blok: no such file, nor a ready scene; did you mean block\?", folder, []
    )


def test_folder_in_place_of_a_file_is_refused(call: Call, folder: Path) -> None:
    (folder / "mine").mkdir()
    assert_refused(call("run", "mine", "-q"), r"mine: is a folder; name a scene file", folder, ["mine"])


def test_a_folder_of_results_does_not_hide_the_ready_scene(call: Call, folder: Path) -> None:
    (folder / "block").mkdir()
    assert call("plan", "block")[0] == 0


def test_error_names_the_scene_file(call: Call, folder: Path) -> None:
    text = (READY / "block.toml").read_text().replace("nu = 0.3", "nu = 0.7")
    (folder / "mine.toml").write_text(text)
    assert_refused(call("run", "mine.toml", "-q"), r"mine\.toml:\d+: bodies\.block\.nu = 0\.7", folder, ["mine.toml"])


def test_mark_that_editors_put_in_front_is_no_mistake(call: Call, folder: Path) -> None:
    text = "\ufeff" + (READY / "block.toml").read_text()
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    assert read(folder / "mine.toml") == read("block")
    (folder / "mine.toml").write_text(text.replace("nu = 0.3", "nu = 0.7"), encoding="utf-8")
    assert_refused(call("run", "mine.toml", "-q"), r"mine\.toml:\d+: bodies\.block\.nu = 0\.7", folder, ["mine.toml"])


MISTAKES = {  # in the ready scene `block` -> what is said of it
    ("title = ", "titel = "): r"titel: unknown key; did you mean title\?",
    ("height = 2.0", "height = -2.0"): r"geometry\.height = -2\.0: must be positive",
    ("E = 1.0", 'E = "steel"'): r'bodies\.block\.E = "steel": expected a number',
    ("nu = 0.3", ""): r"bodies\.block\.nu: missing",
    ("surface = ", "surfce = "): r"contacts\.base\.surfce: unknown key; did you mean surface\?",
    ("mu = 0.3", "mu = 0.3, eta = 2"): r"contacts\.base\.friction\.eta: unknown key",
    ("[1, 0], [2, 0.05]", "[1], [2, 0.05]"): r"supports\.top\.displacement\.x\.1 = \[1\]: expected a pair",
    ("count = 2", "count = 2.5"): r"steps\.count = 2\.5: expected a whole number",
}
UNKNOWN_NAMES = {
    ("block.bottom", "block.botom"): r"contacts\.base\.surface = block\.botom: no such side",
    ('"foundation"', '"foundatoin"'): r"contacts\.base\.against = foundatoin: no such obstacle or side",
    ('"block.top"', '"block.tp"'): r"supports\.top\.boundary = block\.tp: no such side",
}


@pytest.mark.parametrize("mistakes", [MISTAKES, UNKNOWN_NAMES])
def test_all_mistakes_are_said_at_once_with_their_lines(
    mistakes: dict[tuple[str, str], str], call: Call, folder: Path
) -> None:
    text = (READY / "block.toml").read_text()
    expected = []
    for (right, wrong), said in mistakes.items():
        assert text.count(right) == 1
        line = 1 + text[: text.index(right)].count("\n")
        text = text.replace(right, wrong)
        lacks = "missing" in said  # then it is the line of the table
        expected.append((line - 2 if lacks else line, said))
    (folder / "mine.toml").write_text(text)
    code, _, err = call("plan", "mine.toml")
    assert code == 2
    found = err.splitlines()
    assert len(found) == len(expected), err
    for one, (line, said) in zip(found, sorted(expected), strict=True):
        assert re.match(rf"stickslip: mine\.toml:{line}: {said}", one), one


def test_a_key_of_set_has_no_line(call: Call, folder: Path) -> None:
    (folder / "mine.toml").write_text((READY / "block.toml").read_text().replace("nu = 0.3", "nu = 0.7"))
    _, _, err = call("plan", "mine.toml", "--set", "bodies.block.nu=0.8")
    assert err.startswith("stickslip: mine.toml: bodies.block.nu = 0.8: ")


def test_foreign_folder_is_not_written_to(call: Call, folder: Path) -> None:
    (folder / "thesis").mkdir()
    (folder / "thesis" / "chapter.tex").write_text("years of work")
    spoken = call("run", "block", "-q", "-o", "thesis", *COARSE)
    assert_refused(spoken, r"thesis: .*choose another folder with -o", folder, ["thesis", "thesis/chapter.tex"])
    assert (folder / "thesis" / "chapter.tex").read_text() == "years of work"


def test_a_geometry_file_is_no_scene(call: Call, folder: Path) -> None:
    (folder / "x.step").write_text("ISO-10303-21;")
    said = r"x\.step: is a geometry file; for a scene: stickslip new --from x\.step$"
    assert_refused(call("run", "x.step", "-q"), said, folder, ["x.step"])


def test_overrides_add_a_whole_noun(call: Call, folder: Path) -> None:
    keys = ("boundary=block.left", "pressure=.1")
    assert call("plan", "block", *(f"--set=loads.side.{key}" for key in keys))[0] == 0


def test_file_in_place_of_the_results_folder_is_not_overwritten(call: Call, folder: Path) -> None:
    (folder / "out").write_text("mine")
    spoken = call("run", "block", "-q", "-o", "out", *COARSE)
    assert_refused(spoken, r"out: .*choose another folder with -o", folder, ["out"])
    assert (folder / "out").read_text() == "mine"
