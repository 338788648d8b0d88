"""Former results are kept as NAME.1, where only former ones of NAME are replaced: another run may have that name."""

import json
from pathlib import Path

import pytest

from shared.command import Call, assert_one_line, result
from shared.disks import killed_at
from stickslip.geometry.errors import FolderError
from stickslip.workflows.formats.marker import mark, marker_of
from stickslip.workflows.run.folder import OF_MEMBER, RESULT, ResultsFolder


def working(place: Path, text: str, former: str = ".1") -> ResultsFolder:
    """A run whose results are complete, but not in their place."""
    folder = ResultsFolder(place, former)
    work = folder.start()
    for name in (RESULT, "begun.json"):
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
    code, out, err = call("run", "block", "-q", "-o", "mu0", *["--resume"] * stopped)
    assert (code, out) == (2, "")
    assert "mu0.1: is not known to hold former results of mu0; move it away, " in err
    assert_one_line(err)
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
    """The next run puts both in their places."""
    last, again = 0, True
    while again:
        last += 1
        place = tmp_path / f"{last}" / "out"
        place.parent.mkdir()
        finished(place, "older")
        finished(place, "old")
        if notes:
            (place / "notes.txt").write_text("mine")
        new = working(place, "new")
        again = killed_at(last, tmp_path, new.finish)
        new.release()
        now = ResultsFolder(place)
        if (now.work / RESULT).exists():
            now.finish()
        assert (said(place), said(place.with_name("out.1"))) == ("new", "old"), last
        now.refuse_to_replace()
    assert last > 5
