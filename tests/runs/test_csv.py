"""A value in time from a CSV file: the answers and the hash of the table written out, and its changes are noticed."""

from pathlib import Path

import pytest

from shared.command import COARSE, Call, assert_said, result
from stickslip.workflows.scene_file.read import READY, from_dict, read, to_dict

DOWN = "y = [[0, 0], [1, -0.1]]"
FROM_CSV = 'y = { csv = "data/down.csv", time = "t", column = "u_y" }'
ROWS = [(0.25 * k, -0.025 * k) for k in range(5)]
WORDS = (*COARSE, "--set=steps.count=1", "-q", "-o")


def csv_of(rows: list[tuple[float, float]]) -> str:
    return "\n".join(["note,u_y,t", *(f"x,{value!r},{time!r}" for time, value in rows)])


@pytest.fixture
def scene(folder: Path) -> Path:
    """A scene that moves as a file says, in a folder beside the working folder's own."""
    text = (READY / "block.toml").read_text(encoding="utf-8")
    assert DOWN in text
    (folder / "scenes" / "data").mkdir(parents=True)
    (folder / "scenes" / "data" / "down.csv").write_text(csv_of(ROWS))
    (folder / "scenes" / "read.toml").write_text(text.replace(DOWN, FROM_CSV))
    written = f"y = {[list(row) for row in ROWS]}"
    (folder / "scenes" / "written.toml").write_text(text.replace(DOWN, written))
    return folder / "scenes" / "read.toml"


def test_the_scene_is_that_with_the_table_written_out(scene: Path) -> None:
    found, written = read(scene), read(scene.with_name("written.toml"))
    assert found == written
    assert found.supports["top"].displacement["y"] == tuple(ROWS)
    assert from_dict(to_dict(found)) == written  # without the file


def test_answers_and_hash_are_those_of_the_table_and_a_change_is_refused(scene: Path, folder: Path, call: Call) -> None:
    assert call("run", str(scene), *WORDS, "out")[0] == 0
    assert call("run", str(scene.with_name("written.toml")), *WORDS, "written")[0] == 0
    one, other = result(folder / "out"), result(folder / "written")
    assert one["scene"]["hash"] == other["scene"]["hash"]
    assert [s["contacts"] for s in one["steps"]] == [s["contacts"] for s in other["steps"]]
    times = [step["time"] for step in one["steps"]]
    assert times == [time for time, _ in ROWS[1:]] + [2.0]

    data = scene.parent / "data" / "down.csv"
    data.write_text(data.read_text().replace("x,", "y,"))  # a column that is not read
    assert call("run", str(scene), *WORDS, "out", "--resume")[0] == 0
    data.write_text(csv_of([*ROWS[:3], (0.75, -0.08), *ROWS[4:], (1.5, -0.1), (1.6, -0.1), (1.7, -0.1)]))
    assert_said(
        call("run", str(scene), *WORDS, "out", "--resume"),
        2,
        "--resume: supports.top.displacement.y, row 3 was [0.75, -0.075",
        "in out, and is [0.75, -0.08]",
    )
