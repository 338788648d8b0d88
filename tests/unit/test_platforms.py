"""Figures of the same meshes on several platforms are compared, and a difference is noticed."""

import json
from pathlib import Path

import numpy as np
import pytest

from stickslip.workflows.lab.benchmarks import platforms


def test_figures_repeat_and_a_difference_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(platforms, "SCENES", ["block"])
    monkeypatch.setattr(platforms, "TIMED", "block")
    assert [platforms.main(tmp_path, name) for name in ("first", "second")] == [0, 0]
    found = json.loads((tmp_path / "second.json").read_text(encoding="utf-8"))
    force = found["figures"]["block"]["force"]
    for wrong in (force[0] + 1e-8 * max(force), np.nan):
        found["figures"]["block"]["force"] = [wrong, *force[1:]]
        (tmp_path / "third.json").write_text(json.dumps(found), encoding="utf-8")
        assert platforms.main(tmp_path) == 1
    assert "largest difference from first: nan" in capsys.readouterr().out
