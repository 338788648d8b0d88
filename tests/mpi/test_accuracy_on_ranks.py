"""The rounds towards an accuracy are the same on any number of ranks."""

import json
from pathlib import Path

from shared.ranks import mpirun

WORDS = ["run", "block", "--set=geometry.mesh_size=0.5", "--set=geometry.contact_mesh_size=0.5"]
WORDS += ["--set=output.pictures=false", "--accuracy=base.normal_force=0.3%", "-q"]


def test_ranks_take_the_same_rounds(tmp_path: Path) -> None:
    rounds = []
    for ranks in (1, 2):
        ended = mpirun(ranks, [*WORDS, "-o", f"on_{ranks}"], tmp_path)
        assert ended.returncode == 0, ended.stderr
        rounds.append(json.loads((tmp_path / f"on_{ranks}" / "result.json").read_text())["accuracy"]["rounds"])
    assert len(rounds[0]) > 1
    assert [one["unknowns"] for one in rounds[0]] == [one["unknowns"] for one in rounds[1]]
