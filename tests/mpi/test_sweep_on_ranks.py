"""A sweep under mpirun: the ranks but the first solve members, each as a run of its own."""

from pathlib import Path

from shared.command import COARSE, result, table
from shared.ranks import mpirun


def test_ranks_are_the_workers(tmp_path: Path) -> None:
    words = ["sweep", "block", *COARSE, "contacts.base.friction.mu=[0.1, 0.3]", "-o", "out"]
    ended = mpirun(3, words, tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert sorted(line.split()[0] for line in ended.stdout.splitlines() if "converged" in line) == ["1/2", "2/2"]
    assert len(table(tmp_path / "out" / "sweep.csv")) == 2
    assert result(tmp_path / "out" / "mu=0.3")["ranks"] == 1
