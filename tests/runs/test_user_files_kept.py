"""A run keeps the files of its user, and takes its own former ones away."""

from __future__ import annotations

import errno
import json
import os
import shutil
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from shared.cases import slow
from shared.command import Call, assert_said, result
from shared.disks import killed_at
from shared.histories import FOUR, SMALL, Stop, assert_same, names_in, unchanged
from stickslip.geometry.errors import FolderError, MachineError
from stickslip.workflows.formats.marker import HEAD, MARKER, PART, declare, foreign, mark, marker_of
from stickslip.workflows.formats.steps import step_name
from stickslip.workflows.run.folder import OF_MEMBER, RESULT, ResultsFolder
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

SCENE = [*SMALL, "steps.count=2", "output.error=false"]
WORDS = ["run", "block", "-q", "-o", "out", *(f"--set={word}" for word in SCENE)]
OWN = {  # of the user
    "notes.txt": "mine",
    "steps/000002 copy.h5": "mine",
    "steps/000001_notes.txt": "mine",
    "steps/000002.bak": "mine",
    "steps/.000002.bak.part": "mine",
    "learnt/000001.old.bin": "mine",
    "vtu/000009.old.vtu": "mine",
    "learnt/mine.bin": "mine",
    "vtu/mine.vtu": "mine",
    "thoughts/on/friction.md": "mine",
    ".hidden.part": "mine",
    "contact_mine.csv": "time,remark\n9,late\nsoon,none\n",
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


def test_files_of_the_user_go_along_with_the_results_and_are_never_removed(call: Call, done: Path, whole: Path) -> None:
    keep(done)
    for former in ("out.1", "out.2", "out.2"):
        assert call(*WORDS) == (0, "", "")
        assert_kept(done.with_name(former))
        assert names_in(done) == names_in(whole)
        assert result(done.with_name(former))["steps"] == result(done)["steps"] == result(whole)["steps"]
    assert names_in(done.with_name("out.1")) == names_in(whole)
    assert sorted(path.name for path in done.parent.iterdir()) == ["out", "out.1", "out.2"]


def test_files_of_the_user_in_former_results_keep_these(call: Call, done: Path, whole: Path) -> None:
    assert call(*WORDS)[0] == 0
    keep(done.with_name("out.1"))
    (done.with_name("out.2")).write_text("the name is taken")
    for _ in range(2):
        assert call(*WORDS) == (0, "", "")
        assert_kept(done.with_name("out.3"))
        assert names_in(done) == names_in(done.with_name("out.1")) == names_in(whole)


def test_files_that_the_user_names_in_a_results_folder_are_kept(call: Call, done: Path) -> None:
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
    for former in ("out.1", "out.2"):
        assert call(*WORDS) == (0, "", "")
        assert {name: (done.with_name(former) / name).read_bytes() for name in texts} == texts


def test_a_page_beside_the_results_is_the_runs_unless_it_was_there_or_named(call: Call, done: Path) -> None:
    for _ in range(3):
        assert call("report", "out")[0] == call("report", "out")[0] == call(*WORDS)[0] == 0
    assert sorted(path.name for path in done.parent.iterdir()) == ["out", "out.1"]
    assert call("report", "out", "-o", "out/report.html")[0] == call("report", "out")[0] == 0
    assert [path.name for path in foreign(done)] == ["report.html"]


def test_a_link_to_the_results_is_followed_and_kept(call: Call, folder: Path, whole: Path) -> None:
    link, place = folder / "out", folder / "elsewhere" / "place"
    place.mkdir(parents=True)
    link.symlink_to(place)
    for _ in range(3):
        assert call(*WORDS) == (0, "", "")
        assert (link.is_symlink(), link.resolve()) == (True, place)
        assert names_in(place) == names_in(whole)
    assert sorted(path.name for path in place.parent.iterdir()) == ["place", "place.1"]


@pytest.mark.parametrize("linked", ["out.1", ".out.running"])
def test_links_in_the_way_of_results_are_named(linked: str, call: Call, folder: Path) -> None:
    (folder / "elsewhere").mkdir()
    (folder / linked).symlink_to(folder / "elsewhere")
    code, _, err = call(*WORDS)
    assert (code, err) == (2, f"stickslip: {linked}: is a link in the way of results; remove it\n")


@pytest.mark.parametrize("at", ["out", "out.1"])
def test_a_mounted_disk_is_refused(at: str, call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / at).mkdir()
    monkeypatch.setattr("os.path.ismount", lambda path: Path(path).name == at)
    assert_said(call(*WORDS), 2, f"-o out: a disk is mounted at {at}, and no rename replaces it; name a folder in it")


def test_former_results_stay_until_the_new_ones_stand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a full disk, and on one of a container that renames no folder; not on one that may only be read."""
    place = tmp_path / "out"
    for text in ("older", "old"):
        finished(place, text)
    new, real = working(place, "new"), {act: getattr(os, act) for act in ("replace", "rename")}
    for act, number in (("replace", errno.ENOSPC), ("rename", errno.EXDEV), ("replace", errno.EROFS)):

        def refused(source: Path, target: Path, act: str = act, number: int = number) -> None:
            if source.is_relative_to(place):
                raise OSError(number, "no")
            real[act](source, target)

        with monkeypatch.context() as patch:
            patch.setattr(os, act, refused)
            with nullcontext() if number == errno.EROFS else pytest.raises(MachineError):
                new.finish()
        assert said(place.with_name("out.1")) == ("old" if number == errno.EROFS else "older")
    assert (said(place), sorted(path.name for path in tmp_path.iterdir())) == ("new", ["out", "out.1"])


def test_results_are_not_gone_on_with_where_another_run_is_at_work(tmp_path: Path) -> None:
    """Nor are they replaced."""
    finished(tmp_path / "out", "old")
    other = working(tmp_path / "out", "new")
    with pytest.raises(FolderError, match="process is writing it"):
        ResultsFolder(tmp_path / "out").start()
    resumed = ResultsFolder(tmp_path / "out")
    with pytest.raises(FolderError, match="process is writing it"):
        resumed.take_up(resumed.place)
    assert (said(tmp_path / "out"), said(other.work)) == ("old", "new")


def test_link_that_leads_nowhere_yet_is_followed(call: Call, folder: Path, whole: Path) -> None:
    (folder / "out").symlink_to("disk/out")
    assert call(*WORDS) == (0, "", "")
    assert (folder / "out").is_symlink()
    assert names_in(folder / "disk" / "out") == names_in(whole)


@pytest.mark.parametrize("name", ["out", "out.1", ".out.running"])
@pytest.mark.parametrize("log", [True, False])
def test_foreign_folders_are_refused_and_left_alone(name: str, log: bool, call: Call, folder: Path) -> None:
    """Also one with a file that has the name of ours, as version 0.1 has taken for enough."""
    foreign_one = folder / name
    foreign_one.mkdir()
    (foreign_one / ("run.log" if log else "data")).write_text("mine")
    code, _, err = call(*WORDS)
    assert (code, err.count("\n"), len(err) < 300) == (2, 1, True)
    assert ("earlier version of stickslip" if log else "is not the result of a run") in err
    assert ("and former results of out would be kept there" in err) == (name == "out.1" and not log)
    assert names_in(folder) == {f"{name}/{'run.log' if log else 'data'}"}


@pytest.mark.parametrize("words", [[], ["--resume"]])
def test_results_of_an_earlier_version_are_not_touched(words: list[str], call: Call, done: Path) -> None:
    """They have no list of files: what to do is said."""
    (done / MARKER).unlink()
    before = {name: (done / name).read_bytes() for name in names_in(done)}
    assert_said(
        call(*WORDS, *words),
        2,
        "an earlier version of stickslip made it",
        "move it away, or choose another folder with -o",
    )
    assert {name: (done / name).read_bytes() for name in names_in(done)} == before


@pytest.mark.parametrize("name", ["steps", "fields.xdmf", MARKER])
def test_link_in_place_of_a_file_of_the_run_is_named(name: str, call: Call, done: Path, folder: Path) -> None:
    shutil.move(done / name, folder / "elsewhere")
    (done / name).symlink_to(folder / "elsewhere")
    with unchanged(folder):
        assert_said(call(*WORDS), 2, f"out/{name}: is a link, or no file or folder, where a run has made one")


def test_file_of_the_user_in_the_way_is_named_when_a_stopped_run_goes_on(folder: Path) -> None:
    """As a picture of one's own where the run has drawn none before it was stopped."""
    run(read("block", FOUR), folder / "out", Watch(on_step=Stop(2)))
    (folder / "out" / "deformed.png").write_text("mine")
    drawn = read("block", [*FOUR, "output.pictures=true"])
    with pytest.raises(FolderError, match=r"deformed\.png: is no file of this run, and in its way; move it away"):
        run(drawn, folder / "out", resume=True)
    mine = folder / ".out.running" / "deformed.png"
    assert mine.read_text() == "mine"
    mine.rename(folder / "mine.png")
    assert run(drawn, folder / "out", resume=True)[0].status == "converged"
    assert (folder / "out" / "deformed.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "name", ["../precious", "a/../../precious", "\0", None, *slow("/etc/precious", "..", ".", "", 3)]
)
def test_list_that_was_changed_names_nothing_outside(name: Any, call: Call, done: Path, folder: Path) -> None:
    (folder / "precious").write_text("mine")
    (done / MARKER).write_text(f"{HEAD}{json.dumps({'names': [name], 'sha256': {}, 'former': ''})}\n")
    assert call(*WORDS)[0] == call(*WORDS)[0] == call(*WORDS)[0] == 0
    assert (folder / "precious").read_text() == "mine"


@pytest.mark.parametrize("content", [HEAD[:20], "", "mine\n", "\0" * 100])
def test_folder_whose_mark_is_not_ours_is_foreign(content: str, call: Call, done: Path) -> None:
    (done / MARKER).write_text(content)
    with unchanged(done):
        assert call(*WORDS)[0] == 2


@pytest.mark.parametrize("said", ["", "{", "[]", '{"names": 3}', '{"names": [], "sha256": {}, "former": 3}'])
def test_where_the_mark_names_nothing_every_file_is_the_users(said: str, call: Call, done: Path) -> None:
    (done / MARKER).write_text(f"{HEAD}{said}\n")
    before = names_in(done)
    for former in ("out.1", "out.2"):
        assert call(*WORDS)[0] == 0
        assert names_in(done.with_name(former)) == before


def test_results_that_cannot_be_moved_are_put_in_their_place_by_resume(
    call: Call, done: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(done)
    with monkeypatch.context() as patch:
        patch.setattr(
            "stickslip.workflows.run.folder.sync_folder", lambda *rest: (_ for _ in ()).throw(OSError(28, "no"))
        )
        patch.setattr(ResultsFolder, "_clear", lambda *rest: (_ for _ in ()).throw(OSError(28, "no")))
        assert call(*WORDS)[0] == 4
    assert call(*WORDS, "--resume")[0] == 0
    assert_kept(done.with_name("out.1"))
    assert_same(done, whole)


def test_what_is_made_is_declared_before_it_is_there(folder: Path) -> None:
    """A run that is killed leaves no file that a later one would take for the user's."""
    declared_late = []

    def look(step: object) -> None:
        declared_late.extend(foreign(folder / ".out.running"))

    scene = read("block", [*SCENE, "output.vtu=true", "output.fclib=true", "output.pictures=true"])
    run(scene, folder / "out", Watch(on_step=look))
    assert declared_late == []
    assert list(foreign(folder / "out")) == []


def test_names_are_any_that_a_disk_has(folder: Path) -> None:
    odd = ['"', "a\nb", os.fsdecode(b"\xff"), "ü", " ", "\\"]
    mark(folder)
    declare(folder, odd)
    assert marker_of(folder).names == tuple(odd)


def test_files_of_the_user_stay_when_a_stopped_run_goes_on(folder: Path) -> None:
    scene = read("block", FOUR)
    run(scene, folder / "out", Watch(on_step=Stop(2)))
    keep(folder / "out")
    run(scene, folder / "out", Watch(on_step=Stop(1)), resume=True)
    assert_kept(folder / "out")
    assert run(scene, folder / "out", resume=True)[0].status == "converged"
    assert_kept(folder / "out")
    assert (folder / "out" / step_name(4)).exists()


def working(place: Path, text: str, former: str = ".1") -> ResultsFolder:
    """A run whose results are complete, but not in their place."""
    folder = ResultsFolder(place, former)
    work = folder.start()
    for name in (RESULT, "begun.json", step_name(1)):
        (work / name).parent.mkdir(exist_ok=True)
        (work / name).write_text(json.dumps({"status": text}))
    folder.certify()
    return folder


def finished(place: Path, text: str, former: str = ".1") -> None:
    working(place, text, former).finish()


def said(place: Path) -> str:
    return str(result(place)["status"])


@pytest.mark.parametrize("stopped", [False, True])
def test_results_of_another_run_are_refused_before_anything_is_solved(stopped: bool, call: Call, folder: Path) -> None:
    finished(folder / "mu0", "zero")
    if stopped:
        working(folder / "mu0", "zero again").release()
    finished(folder / "mu0.1", "a tenth")
    assert_said(
        call("run", "block", "-q", "-o", "mu0", *["--resume"] * stopped),
        2,
        "mu0.1: is not known to hold former results of mu0; move it away, ",
    )
    assert (said(folder / "mu0"), said(folder / "mu0.1")) == ("zero", "a tenth")
    assert sorted(path.name for path in folder.iterdir()) == [".mu0.running"] * stopped + ["mu0", "mu0.1"]


def test_former_results_are_replaced_and_know_of_whom_they_are(tmp_path: Path) -> None:
    for text in ("first", "second", "third"):
        finished(tmp_path / "out", text)
    assert (said(tmp_path / "out"), said(tmp_path / "out.1")) == ("third", "second")
    assert (marker_of(tmp_path / "out").former, marker_of(tmp_path / "out.1").former) == ("", "out")


def test_files_of_a_user_beside_former_results_do_not_make_them_those_of_another_run(tmp_path: Path) -> None:
    finished(tmp_path / "out", "first")
    (tmp_path / "out" / "notes.txt").write_text("mine")
    finished(tmp_path / "out", "second")
    (tmp_path / "out.1" / "notes.txt").write_text("mine too")
    finished(tmp_path / "out", "third")
    assert (said(tmp_path / "out.1"), marker_of(tmp_path / "out.1").former) == ("second", "out")
    assert (said(tmp_path / "out.2"), (tmp_path / "out.2" / "notes.txt").read_text()) == ("first", "mine too")


def test_former_results_of_an_earlier_version_are_refused(tmp_path: Path) -> None:
    """They do not say of whom they are."""
    for text in ("first", "second"):
        finished(tmp_path / "out", text)
    mark(tmp_path / "out.1", former="")
    with pytest.raises(FolderError, match=r"out\.1: is not known to hold former results of out"):
        ResultsFolder(tmp_path / "out").start()
    (tmp_path / "out.1").rename(tmp_path / "older")
    finished(tmp_path / "out", "third")
    assert (said(tmp_path / "out.1"), said(tmp_path / "older")) == ("second", "first")


def test_nothing_is_refused_where_nothing_would_be_replaced(tmp_path: Path) -> None:
    finished(tmp_path / "mu0.1", "a tenth")
    finished(tmp_path / "mu0", "zero")
    assert (said(tmp_path / "mu0"), said(tmp_path / "mu0.1")) == ("zero", "a tenth")


def test_run_that_has_ended_meanwhile_is_not_replaced_and_the_results_wait(tmp_path: Path) -> None:
    finished(tmp_path / "mu0", "zero")
    again = working(tmp_path / "mu0", "zero again")
    finished(tmp_path / "mu0.1", "a tenth")
    with pytest.raises(FolderError, match=r"mu0\.1: .*; move it away, and go on with --resume"):
        again.finish()
    assert (said(tmp_path / "mu0"), said(tmp_path / "mu0.1")) == ("zero", "a tenth")
    (tmp_path / "mu0.1").rename(tmp_path / "tenth")
    again.finish()
    assert (said(tmp_path / "mu0"), said(tmp_path / "mu0.1")) == ("zero again", "zero")


def test_former_results_that_are_gone_on_with_are_former_ones_no_more(tmp_path: Path) -> None:
    for text in ("first", "second"):
        finished(tmp_path / "out", text)
    resumed = ResultsFolder(tmp_path / "out.1")
    resumed.take_up(resumed.place)
    resumed.finish()
    assert (said(tmp_path / "out.1"), marker_of(tmp_path / "out.1").former) == ("first", "")
    with pytest.raises(FolderError, match="is not known"):
        ResultsFolder(tmp_path / "out").start()


def test_members_of_a_sweep_keep_former_results_where_no_member_can_be(tmp_path: Path) -> None:
    for text in ("first", "second"):
        for name in ("mu=0.1", "mu=0"):
            finished(tmp_path / name, f"{text} {name}", OF_MEMBER)
    found = {path.name: said(path) for path in tmp_path.iterdir()}
    assert found == {
        name + end: f"{t} {name}" for name in ("mu=0", "mu=0.1") for end, t in (("", "second"), ("~1", "first"))
    }


@pytest.mark.parametrize("notes", [False, True])
def test_crash_at_any_moment_loses_neither_the_new_results_nor_the_former_ones(notes: bool, tmp_path: Path) -> None:
    """Each is whole, wherever it stands, and the next run puts both in their places."""
    last, again = 0, True
    while again:
        last += 1
        place = tmp_path / f"{last}" / "out"
        place.parent.mkdir()
        finished(place, "older")
        finished(place, "old")
        if notes:
            (place / "steps" / "notes.txt").write_text("mine")
        new = working(place, "new")
        again = killed_at(last, tmp_path, new.finish)
        new.release()
        now = ResultsFolder(place)
        found = {said(each): names_in(each) for each in now.replaced if (each / RESULT).exists()}
        assert {"new", "old"} <= found.keys() <= {"new", "old", "older"}
        whole = {RESULT, "begun.json", step_name(1), "run.log"}
        assert all(found[each] - {MARKER, PART, "steps/notes.txt"} == whole for each in ("new", "old"))
        assert [path.read_text() for path in place.parent.rglob("notes.txt")] == ["mine"] * notes
        if (now.work / RESULT).exists():
            now.finish()
        assert (said(place), said(place.with_name("out.1"))) == ("new", "old"), last
        now.refuse_to_replace()
    assert last > 5
