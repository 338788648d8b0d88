"""stickslip report, output.report: a run on one page; tests/browser opens it in a browser."""

import hashlib
import json
import re
import shutil
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose

import stickslip
from shared.command import Call, assert_said, ended, output_of, result
from shared.histories import SMALL
from stickslip.geometry.errors import MachineError
from stickslip.workflows.formats.hdf5 import LINE, read_arrays, write_arrays
from stickslip.workflows.formats.marker import RESULT, USER_BLOCK, certify, mark
from stickslip.workflows.formats.plus_minus import plus_minus
from stickslip.workflows.formats.results import read_results
from stickslip.workflows.formats.steps import read_step, step_files
from stickslip.workflows.pictures.report_page import page
from stickslip.workflows.pictures.report_view import PIECES, skin, unpacked
from stickslip.workflows.run.folder import work_of
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import read

HOSTILE = '</title></script><script>alert("$title")</script><img src=x onerror=alert(1)>'
ALONE = {"meta", "img", "input", "br", "path", "circle"}  # elements without an end, as we write them
Edit = Callable[[dict[str, Any]], None]


class Page(HTMLParser):
    """The elements of a page; each is to be closed in its turn."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.text: dict[str, str] = {}  # by element
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        said = dict(attrs)
        self.ids += [said["id"] or ""] if "id" in said else []
        self.links += [value or "" for name, value in attrs if name in ("href", "src", "action", "data")]
        assert not any(name.startswith("on") for name in said)
        if tag not in ALONE:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in ALONE

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text[self.open[-1] if self.open else ""] = self.text.get(self.open[-1] if self.open else "", "") + data


def model_in(text: str) -> Any:
    """The data of the view that a page holds."""
    found = re.search(r'<script type="application/json" id="model">(.*?)</script>', text, re.DOTALL)
    return json.loads(found[1])


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of two bodies, three steps, with pictures and a title that attacks the page."""
    folder = tmp_path_factory.mktemp("done") / "out"
    words = [*SMALL, "output.pictures=true", "output.report=true", f"title={json.dumps(HOSTILE)}", "steps.count=3"]
    run(read("two_blocks", words), folder)
    return folder


def change(folder: Path, content: dict[str, Any]) -> None:
    """Let result.json say something else, as if its run had."""
    (folder / RESULT).write_text(json.dumps(content))
    certify(folder, RESULT)


@pytest.fixture
def copied(done: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(done, tmp_path / "copied"))


def test_a_run_that_is_asked_for_it_makes_a_page_with_all_parts(done: Path) -> None:
    text = (done / "report.html").read_text()
    shown = Page(text)
    assert len(shown.ids) == len(set(shown.ids))
    assert set(shown.ids) >= {"summary", "view", "scene", "curves", "forces", "pictures", "cost", "audit", "canvas"}
    assert text.count("<img") == len(list(done.glob("*.png"))) > 2
    assert all(link.startswith(("#", "data:image/png;base64,")) for link in shown.links)
    assert "default-src 'none'" in text
    assert "Copyright 2010-2024 Three.js Authors" in text


def test_a_title_that_attacks_is_only_shown(done: Path) -> None:
    shown = Page((done / "report.html").read_text())
    assert HOSTILE in shown.text["h1"]
    assert HOSTILE in shown.text["title"]
    assert "alert(" not in shown.text["script"]


def test_the_page_states_the_numbers_with_their_errors(done: Path) -> None:
    text = (done / "report.html").read_text()
    for step in result(done)["steps"]:
        (contact,) = step["contacts"].values()
        force = plus_minus(contact["normal_force"], contact["error"]["normal_force"]["mesh"])
        assert f">{force}" in text, "with the digits of its largest error"
        assert "±" in force


def test_the_page_says_what_its_forces_are_of(copied: Path) -> None:
    assert "Forces are those of a metre of thickness; they act" in page(read_results(copied))
    content = result(copied)
    content["scene"]["geometry"]["symmetric"] = True
    change(copied, content)
    shown = read_results(copied)
    assert "of a metre of thickness of the modelled half; they act" in page(shown)
    assert (shown.unit("N m"), shown.unit("N")) == ("N m/m", "N/m")


def test_the_view_holds_the_numbers_of_the_steps(done: Path) -> None:
    shown, steps = model_in((done / "report.html").read_text()), result(done)["steps"]
    assert set(shown["bodies"]) == set(result(done)["scene"]["bodies"])
    assert [frame["time"] for frame in shown["frames"]] == [step["time"] for step in steps]
    (contact,) = shown["contacts"]
    points = unpacked(shown["points"]).reshape(-1, 3)
    for frame, step, path in zip(shown["frames"], steps, step_files(done).values(), strict=True):
        values, stored = frame["contacts"][contact["name"]], read_step(path)
        assert_allclose(
            unpacked(values["pressure"]).max(), step["contacts"][contact["name"]]["max_pressure"], rtol=1e-6
        )
        assert_allclose(unpacked(values["status"]), stored.contacts[contact["name"]].status)
        moved, scale = unpacked(frame["displacement"]).reshape(-1, 3), frame["displacement"]["scale"]
        assert_allclose(moved, stored.displacement, atol=0.51 * scale)  # every node of a plane body is on its skin
        assert_allclose(unpacked(frame["stress"]), stored.von_mises, atol=0.51 * frame["stress"]["scale"])
    surface = read_results(done).mesh[f"contacts/{contact['name']}/points"]
    assert_allclose(points[unpacked(contact["nodes"])], surface, atol=1e-6)
    middle = points[unpacked(shown["faces"]).reshape(-1, shown["width"]), 1].mean(axis=1)
    upper = unpacked(shown["owners"]) == shown["bodies"].index("upper")
    assert middle[upper].min() > 0 > middle[~upper].max()
    assert not set(unpacked(contact["nodes"])) & set(unpacked(shown["faces"]).reshape(len(upper), -1)[~upper].ravel())


@pytest.mark.parametrize("nodes", [4, 8])
def test_the_skin_of_a_solid_is_its_boundary(nodes: int) -> None:
    """Two tetrahedra share a face, two hexahedra too: it is inside."""
    cells = {4: [[0, 1, 2, 3], [1, 2, 3, 4]], 8: [[*range(8)], [4, 5, 6, 7, 8, 9, 10, 11]]}[nodes]
    faces, owners = skin(np.array(cells), solid=True)
    assert len(faces) == {4: 6, 8: 10}[nodes]
    shared = set(cells[0]) & set(cells[1])
    assert not any(set(face) == shared for face in faces.tolist())
    assert all(set(face) <= set(cells[owner]) for face, owner in zip(faces.tolist(), owners, strict=True))


@pytest.mark.parametrize(("kind", "cut"), PIECES.items())
def test_pieces_of_a_facet_use_all_its_nodes(kind: tuple[bool, int], cut: tuple[tuple[int, ...], ...]) -> None:
    assert {node for piece in cut for node in piece} == set(range(kind[1]))


def test_pictures_of_a_user_are_left_out(copied: Path) -> None:
    (copied / "mine.png").write_bytes(b"mine")
    assert read_results(copied).pictures == tuple(sorted(set(copied.glob("*.png")) - {copied / "mine.png"}))


def test_what_is_not_there_is_left_out(copied: Path) -> None:
    for path in [*copied.glob("*.png"), *copied.glob("steps/*"), copied / "fields.h5", copied / "run.log"]:
        path.unlink()
    content = result(copied)
    for key in ("audit", "verdict", "counters", "seconds", "warnings", "choice", "plan"):
        del content[key]
    change(copied, content)
    shown = Page(page(read_results(copied)))
    assert {"summary", "forces", "scene", "curves"} <= set(shown.ids)
    assert not {"view", "pictures", "audit", "canvas"} & set(shown.ids)


READERS = {  # of the files of a run, with the words of their commands
    RESULT: (["report"], ["compare", "copied"], ["extract", "--point=0.1,0.1"]),
    "steps/000002.h5": (["report"], ["extract", "--point=0.1,0.1"]),
    "fields.h5": (["report"], ["extract", "--point=0.1,0.1"]),
    "deformed.png": (["report"],),
    "steps.csv": (),  # by `load(folder).columns` alone
}


@pytest.mark.parametrize("how", ["cut", "changed", "swapped", "foreign"])
@pytest.mark.parametrize("name", READERS)
def test_what_the_run_has_not_left_is_refused_by_all_who_read_it(
    name: str, how: str, copied: Path, stopped: Path, call: Call
) -> None:
    path, content = copied / name, (copied / name).read_bytes()
    if how == "cut":
        path.write_bytes(content[: len(content) // 2])
    elif how == "changed":
        path.write_bytes(content[:-40] + bytes([content[-40] ^ 1]) + content[-39:])
    elif how == "swapped":
        shutil.copy(copied / ("steps/000001.h5" if path.suffix == ".h5" else "history.csv"), path)
    else:
        shutil.copy(stopped / ("steps.csv" if path.suffix == ".png" else name), path)
    said = {
        "cut": "damaged.* cut short",
        "changed": "damaged|changed",
        "swapped": "is not that file: it is what .*was",
    }
    pattern = rf"{re.escape(name)}: .*({said.get(how, 'of another one|changed after the run')})"
    for first, *words in READERS[name]:
        code, _, err = call(first, str(copied), *words)
        assert (code, err.count("\n")) == (4, 1), err
        assert re.search(pattern, err)
    if path.suffix != ".png":
        with pytest.raises(MachineError, match=pattern):
            _ = (*stickslip.load(copied).steps, stickslip.load(copied).columns)


def test_files_that_are_missing_are_said(copied: Path, call: Call) -> None:
    for name in ("steps/000002.h5", "steps.csv", "history.png"):
        (copied / name).unlink()
    _, err = ended(call("report", str(copied)))
    assert err.splitlines() == [
        f"stickslip: {copied}: files of 1 of 4 steps are lost; not told",
        f"stickslip: {copied}: history.png, steps.csv: lost; not told",
    ]
    loaded = stickslip.load(copied)
    assert [step.time for step in loaded.steps.kept()] == [loaded.times[0], *loaded.times[2:]]
    with pytest.raises(MachineError, match=r"000002\.h5: cannot be read: No such file"):
        _ = loaded.steps[1]
    (copied / "fields.h5").unlink()
    (copied / "fields.h5").mkdir()
    assert_said(call("report", str(copied)), 4, "fields.h5: cannot be read: Is a directory")
    (copied / RESULT).unlink()
    assert_said(call("report", str(copied)), 4, "result.json: cannot be read: No such file")


def test_results_without_checksums_are_read_with_a_line(copied: Path, call: Call) -> None:
    """As earlier versions have left them: what is no whole file is refused all the same."""
    mark(copied, sha256={})
    change(copied, result(copied) | {"sentence": "as an earlier version"})
    line = f"stickslip: {copied}: has no checksums, as results of earlier versions: read as it is\n"
    for words in (["report"], ["compare", str(copied)], ["extract", "--point=0.1,0.1"]):
        code, _, err = call(words[0], str(copied), *words[1:])
        assert (code, err) == (0, line * (1 + (words[0] == "compare")))
    mark(copied, sha256={})
    shutil.copy(copied / "steps/000001.h5", copied / "steps/000002.h5")
    assert "000002.h5: is not that step: it is step 1" in call("report", str(copied))[2]
    (copied / RESULT).write_text('{"status": "conv')
    assert_said(call("report", str(copied)), 4, "result.json: damaged or cut short: it is no table of JSON")


@pytest.mark.parametrize("kind", ["external", "virtual", "link"])
def test_numbers_that_lie_in_another_file_are_refused(kind: str, copied: Path, tmp_path: Path, call: Call) -> None:
    """Whoever makes such a file can give it a checksum, too."""
    path, secret = copied / "fields.h5", tmp_path / "secret"
    secret.write_bytes(bytes(80))
    with h5py.File(tmp_path / "of_others.h5", "w") as file:
        file["x"] = np.zeros(10)
    write_arrays(path, read_arrays(path)[0], {})
    with h5py.File(path, "r+") as file:
        if kind == "external":
            file.create_dataset("more", (10,), np.float64, external=[(str(secret), 0, 80)])
        elif kind == "link":
            file["more"] = h5py.ExternalLink(str(tmp_path / "of_others.h5"), "x")
        else:
            layout = h5py.VirtualLayout((10,), np.float64)
            layout[:] = h5py.VirtualSource(str(tmp_path / "of_others.h5"), "x", shape=(10,))
            file.create_virtual_dataset("more", layout)
    content = path.read_bytes()
    sums = LINE.format(bytes=hashlib.sha256(content[USER_BLOCK:]).hexdigest(), arrays="0" * 64)
    path.write_bytes(sums.encode().ljust(USER_BLOCK, b"\0") + content[USER_BLOCK:])
    certify(copied)
    assert_said(call("report", str(copied)), 4, "fields.h5: more has its numbers in another file")
    assert_said(call("fclib", str(path)), 2, "fields.h5: more has its numbers in another file: not supported")


def test_a_run_that_was_killed_has_a_page(copied: Path, call: Call, folder: Path) -> None:
    (copied / "result.json").unlink()
    copied.rename(work_of(folder / "out"))
    out = output_of(call("report", "out", "-o", "page.html"))
    assert "page.html" in out
    text = (folder / "page.html").read_text()
    assert "not ended" in text
    assert "results “out”" in text
    assert len(model_in(text)["frames"]) == len(step_files(work_of(folder / "out"))) > 2
    assert {"summary", "view", "curves", "forces"} <= set(Page(text).ids)


def test_results_may_be_in_the_folder(copied: Path, done: Path, call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(copied / "steps")
    assert call("report", "..")[::2] == (0, "")
    assert call("compare", "..", str(done))[::2] == (0, "")
    monkeypatch.chdir(copied)
    assert call("report", ".") == (0, "wrote report.html\n", "")
    assert call("report", "/")[::2] == (
        2,
        "stickslip: /: holds no results of a run, neither result.json nor begun.json\n",
    )


def test_a_killed_run_may_be_that_of_the_working_folder(
    copied: Path, call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (copied / "result.json").unlink()
    copied.rename(work_of(folder / "out"))
    (folder / "out").mkdir()
    monkeypatch.chdir(folder / "out")
    assert call("report", ".", "-o", "page.html") == (0, "wrote page.html\n", "")
    assert "not ended" in Path("page.html").read_text()


def test_an_interrupted_run_has_a_page(stopped: Path, call: Call) -> None:
    assert call("report", str(stopped))[0] == 0
    text = (stopped / "report.html").read_text()
    assert '<b class="badge doubt">interrupted</b>' in text
    assert len(model_in(text)["frames"]) == 2
    assert call("report", str(stopped))[0] == 0, "once more"


def test_without_steps_a_page_says_so(copied: Path) -> None:
    change(copied, result(copied) | {"steps": []})
    assert "no step was solved" in page(read_results(copied))


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda content: content.update(format=7), "format 7"),
        (lambda content: content.update(steps=[3]), "not results that this version can read"),
    ],
)
def test_results_of_another_version_are_refused(copied: Path, call: Call, edit: Edit, said: str) -> None:
    content = result(copied)
    edit(content)
    change(copied, content)
    assert_said(call("report", str(copied)), 2, said)


def test_a_folder_without_results_is_refused(folder: Path, call: Call, done: Path) -> None:
    (folder / "empty").mkdir()
    (folder / "file").touch()
    for words in (["missing"], ["empty"], ["file"], [str(done), "-o", "empty"]):
        assert_said(call("report", *words), 2, words[-1])


def test_two_runs_are_laid_side_by_side(done: Path, call: Call, folder: Path) -> None:
    changed = ["contacts.joint.friction.mu=0.9", "steps.count=2"]
    run(read("two_blocks", [*SMALL, f"title={json.dumps(HOSTILE)}", *changed]), folder / "other")
    out = output_of(call("compare", str(done), "other", "-o", "both.html"))
    text = (folder / "both.html").read_text()
    Page(text)
    assert "<script>alert" not in text
    first, second = (result(place)["steps"][-1]["contacts"] for place in (done, folder / "other"))
    for said in (out, text):
        assert "steps.count" in said
        assert "0.9" in said
        for contacts in (first, second):
            (contact,) = contacts.values()
            assert plus_minus(contact["normal_force"], contact["error"]["normal_force"]["mesh"]) in said
    cells = [[cell.strip() for cell in row.split("│")] for row in out.splitlines() if "│" in row]
    rows = {name: others for _, name, *others, _ in cells}
    assert rows["time [s]"][:3] == ["2", "2", "0"]
    assert rows["steps"] == ["4", "2", "0.50"]


def test_a_run_beside_itself_differs_in_nothing(done: Path, call: Call) -> None:
    out, _ = ended(call("compare", str(done), str(done)))
    assert "Asked differently" not in out
    assert "no" not in [cell.strip() for row in out.splitlines() for cell in row.split("│")]


def test_newtons_are_not_compared_with_newtons_per_metre(done: Path, call: Call, folder: Path) -> None:
    words = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.5", "output.pictures=false"]
    run(read("cube", words), folder / "solid")
    out, _ = ended(call("compare", str(done), "solid"))
    cells = [[cell.strip() for cell in row.split("│")] for row in out.splitlines() if "│" in row]
    rows = {name: others for _, name, *others, _ in cells}
    assert rows["elastic energy [J/m or J]"][2:] == ["–"] * 3


def test_what_cannot_be_compared_is_refused(copied: Path, done: Path, call: Call) -> None:
    change(copied, result(copied) | {"steps": []})
    for words in ([str(done), "missing"], [str(done), str(copied)], [str(done), str(done), "-o", str(done)]):
        assert_said(call("compare", *words), 2, alone=False)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("half_space", ["steps.count=2"]),
        ("half_ball", ["geometry.mesh_size=0.3", "geometry.contact_mesh_size=0.06", "steps.count=2"]),
    ],
)
def test_obstacles_are_in_the_view_and_move(name: str, words: list[str], tmp_path: Path) -> None:
    coarse = ["output.pictures=false", "output.error=false", *words]
    run(read(name, coarse), tmp_path / "out")
    view = model_in(page(read_results(tmp_path / "out")))
    (obstacle,), solid = view["obstacles"], name == "half_ball"
    points, pieces = unpacked(obstacle["points"]).reshape(-1, 3), unpacked(obstacle["pieces"])
    assert pieces.max() < len(points)
    distance = np.abs(points[:, 2]) if solid else np.abs(np.linalg.norm(points[:, :2] - [0, 2], axis=1) - 2)
    assert distance.max() < 1e-3
    motion = unpacked(view["frames"][-1]["obstacles"][obstacle["name"]]).reshape(4, 3)
    last = result(tmp_path / "out")["steps"][-1]["obstacles"][obstacle["name"]]["displacement"]
    if solid:
        assert_allclose(motion, 0.0)
    else:  # it turns by 0.005 about its axis through (0, 2)
        assert_allclose(motion[0] + motion[1:] @ [0, 2, 0], [*last, 0.0], atol=1e-6)
        assert_allclose(motion[1:3, :2], [[0, -0.005], [0.005, 0]], atol=1e-9)
