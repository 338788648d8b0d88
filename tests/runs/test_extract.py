"""`extract` reads at any point what a probe would have told there."""

import csv
from pathlib import Path

import pytest

from shared.command import COARSE, Call, assert_refused, output_of, table

QUICK = [*COARSE, "--set=output.audit=false", "-q"]
PLACES = {  # a corner, a node inside that several cells share, and points within a cell and on a curved face
    "block": (["geometry.order=2", "steps.count=3"], [(0.0, 2.0), (0.5, 0.5), (0.31, 0.77)]),
    "half_ball": (
        ["geometry.order=1", "geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25", "steps.count=1"],
        [(0.0, 0.0, 0.0), (0.11, 0.13, 0.29)],
    ),
}


@pytest.mark.parametrize("name", PLACES)
def test_a_point_tells_what_a_probe_tells(name: str, call: Call, folder: Path) -> None:
    settings, points = PLACES[name]
    probes = [f"--set=probes.p{k}.point={list(x)}" for k, x in enumerate(points)]
    assert call("run", name, *QUICK, *(f"--set={word}" for word in settings), *probes, "-o", "out")[0] == 0
    asked = [word for x in points for word in ("--point", ",".join(map(str, x)))]
    out = output_of(call("extract", "out", *asked))
    found = list(csv.DictReader(out.splitlines()))
    told = [row for row in table(folder / "out/probes.csv") if row["probe"] in {f"p{k}" for k in range(len(points))}]
    assert len(found) == len(told) >= len(points)
    largest = max(abs(float(row[key])) for row in told for key in row if key.startswith("stress"))
    for row, probe in zip(found, told, strict=True):
        at = tuple(float(row.pop(axis)) for axis in "xyz"[: len(points[0])])
        assert at == points[int(probe.pop("probe")[1:])]
        assert row.keys() == probe.keys()
        near = 0.5 if name == "block" else 1e-12  # of order 2 a probe has the stress of the displacement
        for key in row:
            rough = near * largest if key.startswith("stress") else 0.0
            assert float(row[key]) == pytest.approx(float(probe[key]), rel=1e-12, abs=rough)

    assert call("extract", "out", *asked, "-o", "new/points.csv") == (0, "wrote new/points.csv\n", "")
    assert (folder / "new/points.csv").read_text() == out


def test_only_steps_with_fields_are_told(call: Call) -> None:
    """Those of every second of .4, .8, 1, 1.2, 1.6, 2, where the load has a corner at 1."""
    light = ["--set=output.step_files=every", "--set=output.every=2", "--set=steps.count=5"]
    assert call("run", "block", *QUICK, *light, "-o", "out")[0] == 0
    _, out, _ = call("extract", "out", "--point=0.5,0.5")
    assert [row["time"] for row in csv.DictReader(out.splitlines())] == ["0.8", "1.2", "2.0"]


def test_steps_whose_files_are_lost_are_said(call: Call, folder: Path) -> None:
    assert call("run", "block", *QUICK, "-o", "out")[0] == 0
    (folder / "out/steps/000001.h5").unlink()
    code, out, err = call("extract", "out", "--point=0.5,0.5")
    assert (code, [row["time"] for row in csv.DictReader(out.splitlines())]) == (0, ["2.0"])
    assert err == "stickslip: out: files of 1 of 2 steps are lost; not told\n"


def test_what_cannot_be_told_is_refused_with_one_line(call: Call, folder: Path) -> None:
    (folder / "foreign").mkdir()
    assert call("run", "block", *QUICK, "-o", "out")[0] == 0
    before = sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
    for words, line in {
        ("out", "--point=5,5"): "--point 5,5: lies outside the bodies",
        ("out", "--point", "nan,1"): "--point nan,1: lies outside the bodies",
        ("out", "--point", "-1,1"): "--point -1,1: lies outside the bodies",
        ("out", "--point=1"): "--point 1: expected x,y, 2 numbers",
        ("out", "--point=.5,.5,0"): "--point .5,.5,0: expected x,y, 2 numbers",
        ("out", "--point=a,b"): "--point a,b: expected x,y, 2 numbers",
        ("out",): "Missing parameter: point",
        ("out", "--point=.5,.5", "-o", "foreign"): "foreign: is a folder; name a file",
        ("out", "--point=.5,.5", "-o", "out/result.json"): "out/result.json: is a file of that run",
        ("out", "--point=.5,.5", "-o", "out/steps.csv"): "out/steps.csv: is a file of that run",
        ("foreign", "--point=1,1"): "foreign: holds no results of a run",
        ("nowhere", "--point=1,1"): "nowhere: no such folder",
    }.items():
        assert_refused(call("extract", *words), line, folder, before)
