"""Whatever a user keeps in or beside a results folder survives: only files that a run has listed move or go."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from shared.cases import slow
from shared.command import Call, result
from shared.disks import killed_at
from shared.histories import FOUR, SMALL, Stop, assert_same, names_in
from stickslip.geometry.errors import FolderError
from stickslip.workflows.formats.own_files import MARKER, PART, SIGNATURE, claim, foreign, listed, mark
from stickslip.workflows.formats.steps import step_name
from stickslip.workflows.run.folder import ResultsFolder
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

SCENE = [*SMALL, "steps.count=2", "output.error=false"]
WORDS = ["run", "block", "-q", "-o", "out", *(f"--set={word}" for word in SCENE)]
OWN = {  # of the user
    "notes.txt": "mine",
    "steps/000002 copy.h5": "mine",
    "learnt/mine.bin": "mine",
    "vtu/mine.vtu": "mine",
    "thoughts/on/friction.md": "mine",
    ".hidden.part": "mine",
    "steps/.000009.h5.part": "mine",
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a run."""
    folder = tmp_path_factory.mktemp("whole") / "out"
    run(read("block", SCENE), folder)
    return folder


@pytest.fixture
def done(folder: Path, whole: Path) -> Path:
    return Path(shutil.copytree(whole, folder / "out"))


def keep(folder: Path) -> None:
    """Files of the user, and an empty folder."""
    for name, text in OWN.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    (folder / "empty").mkdir()


def assert_kept(folder: Path) -> None:
    assert {name: (folder / name).read_text() for name in OWN} == OWN
    assert (folder / "empty").is_dir()


def test_files_and_folders_of_the_user_stay_where_they_are(call: Call, done: Path, whole: Path) -> None:
    keep(done)
    for _ in range(3):
        assert call(*WORDS) == (0, "", "")
        assert_kept(done)
        assert names_in(done) - set(OWN) == names_in(whole)
    old = done.with_name("out.1")
    assert names_in(old) == names_in(whole)
    assert result(old)["steps"] == result(done)["steps"] == result(whole)["steps"]
    assert sorted(path.name for path in done.parent.iterdir()) == ["out", "out.1"]


def test_files_of_the_user_in_earlier_results_stay_there(call: Call, done: Path, whole: Path) -> None:
    assert call(*WORDS)[0] == 0
    old = done.with_name("out.1")
    keep(old)
    for _ in range(2):
        assert call(*WORDS) == (0, "", "")
        assert_kept(old)
        assert names_in(done) == names_in(old) - set(OWN) == names_in(whole)


def test_files_that_the_user_names_in_a_results_folder_stay_there(call: Call, done: Path) -> None:
    """Also where the program has written them: a scene, pages, the table of a sweep."""
    made = [
        ("new", "block", "out/mine.toml"),
        ("report", "out", "-o", "out/page.html"),
        ("compare", "out", "out", "-o", "out/alike.html"),
        ("sweep", "block", *WORDS[5:], "contacts.base.friction.mu=[0.2]", "-q", "-o", "out"),
    ]
    for words in made:
        assert call(*words)[0] == 0
    texts = {name: (done / name).read_bytes() for name in ("mine.toml", "page.html", "alike.html", "sweep.csv")}
    assert call("report", "out")[0] == 0
    for _ in range(2):
        assert call(*WORDS) == (0, "", "")
        assert {name: (done / name).read_bytes() for name in texts} == texts
        assert not (done / "report.html").exists()  # it shows what the folder has held before


@pytest.mark.parametrize("linked", ["out", "out.1", ".out.running"])
def test_links_to_folders_are_followed_and_kept(linked: str, call: Call, folder: Path, whole: Path) -> None:
    link, place = folder / linked, folder / "elsewhere" / "place"
    place.mkdir(parents=True)
    link.symlink_to(place)
    for _ in range(3):
        assert call(*WORDS) == (0, "", "")
        assert (link.is_symlink(), link.resolve()) == (True, place)
        assert names_in((folder / "out").resolve()) == names_in(whole)
    assert names_in(place) == ({MARKER} if linked == ".out.running" else names_in(whole))


def test_link_that_leads_nowhere_yet_is_followed(call: Call, folder: Path, whole: Path) -> None:
    (folder / "out").symlink_to("disk/out")
    assert call(*WORDS) == (0, "", "")
    assert (folder / "out").is_symlink()
    assert names_in(folder / "disk" / "out") == names_in(whole)


@pytest.mark.parametrize("linked", ["out", "out.1", ".out.running"])
@pytest.mark.parametrize("log", [True, False])
def test_foreign_folders_are_refused_and_left_alone(linked: str, log: bool, call: Call, folder: Path) -> None:
    """Also one with a file that has the name of ours, as version 0.1 has taken for enough."""
    foreign_one = folder / "foreign"
    foreign_one.mkdir()
    (foreign_one / ("run.log" if log else "data")).write_text("mine")
    (folder / linked).symlink_to(foreign_one)
    code, _, err = call(*WORDS)
    assert (code, err.count("\n"), len(err) < 300) == (2, 1, True)
    assert ("earlier version of stickslip" if log else "is not the result of a run") in err
    assert names_in(foreign_one) == {"run.log" if log else "data"}
    assert (folder / linked).is_symlink()


@pytest.mark.parametrize("words", [[], ["--resume"]])
def test_results_of_an_earlier_version_are_not_touched(words: list[str], call: Call, done: Path) -> None:
    """They have no list of files: what to do is said."""
    (done / MARKER).unlink()
    before = {name: (done / name).read_bytes() for name in names_in(done)}
    code, _, err = call(*WORDS, *words)
    assert (code, err.count("\n")) == (2, 1)
    assert "an earlier version of stickslip made it" in err
    assert "move it away, or choose another folder with -o" in err
    assert {name: (done / name).read_bytes() for name in names_in(done)} == before


@pytest.mark.parametrize("name", ["steps", "fields.xdmf", MARKER])
def test_link_in_place_of_a_file_of_the_run_is_named(name: str, call: Call, done: Path, folder: Path) -> None:
    shutil.move(done / name, folder / "elsewhere")
    (done / name).symlink_to(folder / "elsewhere")
    before = names_in(folder)
    code, _, err = call(*WORDS)
    assert (code, err.count("\n")) == (2, 1)
    assert f"out/{name}: is a link, or no file or folder, where a run has made one" in err
    assert names_in(folder) == before


def test_file_of_the_user_in_the_way_is_named_and_the_results_wait(call: Call, done: Path, whole: Path) -> None:
    """As a picture of one's own where the earlier run has drawn none."""
    (done / "vtu").mkdir()
    (done / "vtu" / "000001.vtm").write_text("mine")
    code, _, err = call(*WORDS, "--set=output.vtu=true")
    assert (code, err.count("\n")) == (2, 1)
    assert "out/vtu/000001.vtm: is not of a run, and in the way" in err
    assert (done / "vtu" / "000001.vtm").read_text() == "mine"
    (done / "vtu" / "000001.vtm").rename(done / "mine.vtm")
    assert call(*WORDS, "--set=output.vtu=true", "--resume")[0] == 0
    assert (done / "vtu" / "000001.vtm").read_text().startswith("<?xml")
    assert result(done)["steps"] == result(whole)["steps"]


@pytest.mark.parametrize(
    "name", ["../precious", "a/../../precious", "\0", None, *slow("/etc/precious", "..", ".", "", 3)]
)
def test_list_that_was_changed_names_nothing_outside(name: Any, call: Call, done: Path, folder: Path) -> None:
    (folder / "precious").write_text("mine")
    with (done / MARKER).open("a") as file:
        file.write(json.dumps(name) + "\n")
    assert call(*WORDS)[0] == call(*WORDS)[0] == 0
    assert (folder / "precious").read_text() == "mine"


@pytest.mark.parametrize("content", [SIGNATURE[:20], "", "mine\n", "\0" * 100])
def test_folder_whose_mark_is_not_ours_is_foreign(content: str, call: Call, done: Path) -> None:
    (done / MARKER).write_text(content)
    before = names_in(done)
    assert call(*WORDS)[0] == 2
    assert names_in(done) == before


@pytest.mark.parametrize("source", ["../..", "../other", "/", "."])
def test_list_that_says_its_files_come_from_elsewhere_is_refused(source: str, call: Call, done: Path) -> None:
    other = done.with_name("other")
    shutil.copytree(done, other)
    with (done / MARKER).open("a") as file:
        file.write(json.dumps({"moving from": source}) + "\n")
    before = names_in(done.parent)
    code, _, err = call(*WORDS)
    assert (code, err.count("\n")) == (2, 1)
    assert names_in(done.parent) == before


# crashes while files move one by one


def _results(place: Path, text: str) -> ResultsFolder:
    folder = ResultsFolder(place)
    work = folder.start()
    for name in ("result.json", "steps/000001.h5", "begun.json"):
        claim(work / name)
        (work / name).parent.mkdir(exist_ok=True)
        (work / name).write_text(f'{{"status": "{text}"}}')
    return folder


def test_crash_at_any_moment_of_moving_is_made_good_by_the_next_run(tmp_path: Path) -> None:
    last, crashed = 0, True
    while crashed:
        last += 1
        place = tmp_path / f"{last}" / "out"
        place.parent.mkdir()
        _results(place, "old").finish()
        (place / "steps" / "notes.txt").write_text("mine")
        new = _results(place, "new")
        crashed = killed_at(last, tmp_path, new.finish)
        new.release()
        now = ResultsFolder(place)
        assert (place / "steps" / "notes.txt").read_text() == "mine"
        where = {folder: (folder / "result.json").exists() for folder in now.replaced}
        for folder, there in where.items():  # whole or not at all
            if folder.exists():
                names = {name for name in names_in(folder) if not name.endswith("notes.txt")} - {MARKER, PART}
                assert names == ({"result.json", "steps/000001.h5", "begun.json", "run.log"} if there else set())
        found = [result(f)["status"] for f, there in where.items() if there]
        assert "new" in found
        assert set(found) <= {"new", "old"}
    assert last > 10


def test_half_moved_results_are_resumed(call: Call, done: Path, whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep(done)
    with monkeypatch.context() as patch:
        patch.setattr(
            "stickslip.workflows.run.folder.move_own", lambda *rest, **options: (_ for _ in ()).throw(OSError(28, "no"))
        )
        assert call(*WORDS)[0] == 4
    assert call(*WORDS, "--resume")[0] == 0
    assert_kept(done)
    for name in OWN:
        (done / name).unlink()
    for name in ("empty", "thoughts/on", "thoughts", "learnt", "vtu"):
        (done / name).rmdir()
    assert_same(done, whole)


def test_two_runs_are_told_apart_while_files_move(folder: Path) -> None:
    first = _results(folder / "out", "old")
    with pytest.raises(FolderError, match="process is writing it"):
        ResultsFolder(folder / "out").start()
    first.finish()


def test_what_is_made_is_listed_before_it_is_there(folder: Path) -> None:
    """A run that is killed leaves no file that a later one would take for the user's."""
    listed_late = []

    def look(step: object) -> None:
        listed_late.extend(foreign(folder / ".out.running"))

    scene = read("block", [*SCENE, "output.vtu=true", "output.fclib=true", "output.pictures=true"])
    run(scene, folder / "out", Watch(on_step=look))
    assert listed_late == []
    assert list(foreign(folder / "out")) == []


def test_names_are_any_that_a_disk_has(folder: Path) -> None:
    mark(folder)
    odd = ['"', "a\nb", os.fsdecode(b"\xff"), "ü", " ", "\\"]
    for name in odd:
        claim(folder / name)
    assert listed(folder) == tuple(odd)


def test_files_of_the_user_stay_when_a_stopped_run_goes_on(folder: Path) -> None:
    scene = read("block", FOUR)
    run(scene, folder / "out", Watch(on_step=Stop(2)))
    keep(folder / "out")
    run(scene, folder / "out", Watch(on_step=Stop(1)), resume=True)
    assert_kept(folder / "out")
    assert run(scene, folder / "out", resume=True)[0].status == "converged"
    assert_kept(folder / "out")
    assert (folder / "out" / step_name(4)).exists()
