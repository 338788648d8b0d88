"""`stickslip fclib`: problems in, a line each and copies with solutions out."""

import json
import os
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.command import Call
from shared.discrete import ONE, local, random_problem, write
from stickslip.solvers.interface.discrete import discrete_problem, residual
from stickslip.workflows.formats.fclib import read_problem

PLACE = "FCLIB_PROBLEMS"  # environment variable: a folder with problems of the public collection
UNSOLVABLE = local(np.diag([0.0, 1.0]), np.array([-1.0, 0.0]), np.array([0.3]))  # u_n = -1 whatever r is


def public_problems() -> list[Path]:
    folder = os.environ.get(PLACE, "")
    return sorted(Path(folder).glob("*.hdf5")) if folder else []


@pytest.fixture
def files(folder: Path) -> list[str]:
    q, _, _ = ONE["slips"]
    write(folder / "one.hdf5", local(np.eye(3), np.array(q), np.array([0.5])))
    write(folder / "six.hdf5", local(*random_problem(0)))
    return ["one.hdf5", "six.hdf5"]


def test_each_problem_has_its_line_and_its_copy(call: Call, folder: Path, files: list[str]) -> None:
    before = [(folder / name).read_bytes() for name in files]
    code, out, err = call("fclib", *files, "-o", "out", "--json", "figures.json")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].split()[:4] == ["problem", "d", "contacts", "rank"]
    assert lines[1].split()[:4] == ["one", "3", "1", "3/3"]
    assert lines[2].split()[:4] == ["six", "3", "6", "9/18"]
    assert lines[3].startswith("auto: 2 of 2 solved")
    assert [(folder / name).read_bytes() for name in files] == before
    with h5py.File(folder / "out" / "one.hdf5") as file:
        _, r, u = ONE["slips"]
        assert_allclose(file["solution/r"][()], r, atol=1e-8)
        assert_allclose(file["solution/u"][()], u, atol=1e-8)
        assert file["solution"].attrs["status"] == "solved"
    content = json.loads((folder / "figures.json").read_text())
    assert content == json.loads((folder / "out" / "fclib.json").read_text())
    assert [entry["contacts"] for entry in content["problems"]] == [1, 6]
    assert all(entry["results"][0]["residual"] <= 1e-8 for entry in content["problems"])


def test_methods_are_compared(call: Call, folder: Path, files: list[str]) -> None:
    code, out, _ = call("fclib", *files, "-o", "out", "--method", "nsgs", "--method", "condensed-newton")
    assert code == 0
    assert "share of the problems" in out
    assert (folder / "out" / "profile.png").read_bytes().startswith(b"\x89PNG")
    content = json.loads((folder / "out" / "fclib.json").read_text())
    assert [result["method"] for result in content["problems"][0]["results"]] == ["nsgs", "condensed-newton"]
    assert content["solved"] == {"nsgs": 2, "condensed-newton": 2}
    assert content["profile"]["shares"]["nsgs"][-1] == 1.0


def test_every_method_can_be_asked_for_at_once(call: Call, folder: Path, files: list[str]) -> None:
    code, _, _ = call("fclib", files[0], "-o", "out", "--method", "all", "--tolerance", "1e-4")
    assert code == 0
    methods = [r["method"] for r in json.loads((folder / "out" / "fclib.json").read_text())["problems"][0]["results"]]
    assert methods == ["auto", "condensed-newton", "surface-uzawa", "uzawa", "nsgs"]


def test_what_is_not_solved_is_said(
    call: Call, folder: Path, files: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stickslip.solvers.stepping.discrete_chain.TURNS", (("nsgs", 50, "from r = 0"),))
    write(folder / "none.hdf5", UNSOLVABLE)
    code, out, _ = call("fclib", "none.hdf5", *files, "-o", "out")
    assert code == 3
    assert "NOT SOLVED" in out.splitlines()[1]
    with h5py.File(folder / "out" / "none.hdf5") as file:
        assert file["solution"].attrs["status"] == "not solved"
        assert file["solution"].attrs["residual"] > 0.1
    result = json.loads((folder / "out" / "fclib.json").read_text())["problems"][0]["results"][0]
    assert result["solved"] is False


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["none.hdf5"], r"none.hdf5: cannot be read"),
        (["one.hdf5", "text.hdf5"], "text.hdf5: not an HDF5 file"),
        (["one.hdf5", "--tolerance", "0"], "--tolerance 0: must lie between 0 and 1"),
        (["one.hdf5", "--tolerance", "nan"], "--tolerance nan: must lie between 0 and 1"),
        (["one.hdf5", "--method", "gram-uzawa"], "--method gram-uzawa: needs the bodies"),
        (["one.hdf5", "--method", "nsg"], "--method nsg: no such method; did you mean nsgs?"),
        (["one.hdf5", "sub/one.hdf5"], "one.hdf5: two files of this name"),
        (["one.hdf5", "-o", "foreign"], "foreign: is not the result of a run and not empty"),
        ([], "Missing parameter: files"),
    ],
)
def test_bad_input_is_refused_with_one_line(
    call: Call, folder: Path, files: list[str], words: list[str], line: str
) -> None:
    (folder / "text.hdf5").write_text("text")
    (folder / "foreign").mkdir()
    (folder / "foreign" / "mine.txt").write_text("mine")
    (folder / "sub").mkdir()
    write(folder / "sub" / "one.hdf5", local(np.eye(3), np.ones(3), np.array([0.5])))
    before = sorted(str(path) for path in folder.rglob("*"))
    code, out, err = call("fclib", *words)
    assert (code, out) == (2, "")
    assert err.startswith("stickslip: ")
    assert err.count("\n") == 1
    assert line in err
    assert sorted(str(path) for path in folder.rglob("*")) == before


def test_a_former_result_is_kept_and_its_files_are_not_read_from_there(
    call: Call, folder: Path, files: list[str]
) -> None:
    assert call("fclib", *files, "-o", "out")[0] == 0
    assert call("fclib", files[0], "-o", "out")[0] == 0
    assert sorted(path.name for path in (folder / "out").glob("*.hdf5")) == ["one.hdf5"]
    assert sorted(path.name for path in (folder / "out.1").glob("*.hdf5")) == files
    for place in ("out", "out.1"):
        code, _, err = call("fclib", f"{place}/one.hdf5", "-o", "out")
        assert code == 2
        assert "which is replaced; choose another folder with -o" in err


def test_report_in_the_folder_is_where_it_was_asked_for(call: Call, folder: Path, files: list[str]) -> None:
    """It is the user's: it goes along with the results, and later runs keep it."""
    for names in (files, files[:1]):
        assert call("fclib", *names, "-o", "out", "--json", "out/figures.json")[::2] == (0, "")
        assert len(json.loads((folder / "out" / "figures.json").read_text())["problems"]) == len(names)
    for former in ("out.1", "out.3"):  # of the first report there is out.2
        assert call("fclib", *files, "-o", "out")[0] == 0
        assert len(json.loads((folder / former / "figures.json").read_text())["problems"]) == 1


def test_report_that_cannot_be_written_takes_no_solution_with_it(call: Call, folder: Path, files: list[str]) -> None:
    code, _, err = call("fclib", *files, "-o", "out", "--json", "none/figures.json")
    assert (code, err) == (4, "stickslip: none/figures.json: cannot be written: No such file or directory\n")
    assert sorted(path.name for path in (folder / "out").glob("*.hdf5")) == files


def test_an_error_leaves_nothing(call: Call, folder: Path, files: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("stickslip.workflows.commands._fclib.write_solved", fails)
    assert call("fclib", *files, "-o", "out")[0] == 130
    assert sorted(path.name for path in folder.iterdir()) == files


@pytest.mark.slow
@pytest.mark.skipif(not public_problems(), reason=f"{PLACE} names no folder with problems of the public collection")
@pytest.mark.parametrize("path", public_problems(), ids=lambda path: path.stem)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-8])
def test_public_problems_are_solved_by_the_default(call: Call, folder: Path, path: Path, tolerance: float) -> None:
    """The answer in the copy is judged by the file's own numbers."""
    code, _, _ = call("fclib", str(path), "-o", "out", "--tolerance", str(tolerance))
    assert code == 0
    stored = read_problem(path)
    problem = discrete_problem(stored.W, stored.q, stored.mu)
    with h5py.File(folder / "out" / path.name) as file:
        r = file["solution/r"][()] / problem.scales[0]
        u = file["solution/u"][()] / problem.scales[1]
    assert_allclose(u, problem.surface.matrix @ r + problem.q, atol=1e-10 * max(1.0, np.abs(r).max()))
    assert residual(r, u, problem.mu) <= tolerance * (1 + 1e-6)
