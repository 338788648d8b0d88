"""`stickslip plan SCENE --cost`: prices in a table and in JSON."""

import json
from collections.abc import Iterable

import pytest

import stickslip.workflows.cost.foresee
from shared.command import Call, assert_said, ended
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.cost.foresee import ASKED, Coarse, Price, Row
from stickslip.workflows.cost.progress import print_prices

SMALL = ["--set=geometry.mesh_size=0.4", "--set=geometry.contact_mesh_size=0.2"]


@pytest.fixture(autouse=True)
def one_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """For the coarse versions of a scene; those of a test's first command serve the others."""
    limited, kept = stickslip.workflows.cost.foresee.coarse_versions, list[Coarse]()

    def versions(scene: Scene, seconds: float) -> Iterable[Coarse]:
        kept.extend(() if kept else limited(scene, 1.0))
        return kept

    monkeypatch.setattr(stickslip.workflows.cost.foresee, "coarse_versions", versions)


def test_prices_are_told(call: Call) -> None:
    out, err = ended(call("plan", "block", *SMALL, "--cost"))
    assert err.startswith("solving coarse versions, ")
    assert "unknowns, 2 steps: " in err
    assert "base.dissipation_total" in out
    assert "base.max_pressure: grows without end" in out
    assert "by the trend of coarse versions" in out
    assert "0.1 %: the time to an error so small" in out.splitlines()[-1]
    out, _ = ended(call("plan", "block", *SMALL, "--cost", "--json"))
    rows = {row["name"]: row for row in json.loads(out)["cost"]}
    first, *_, last = rows["base.normal_force"]["prices"]
    assert (first["asked"], last["asked"]) == (0.1, 0.001)
    assert first["factor"] > last["factor"]
    assert rows["base.normal_force"]["value"] == pytest.approx(0.243, rel=0.05)


def test_days_are_not_counted(capsys: pytest.CaptureFixture[str]) -> None:
    prices = tuple(
        Price(asked, seconds, 1.0, 1, (seconds / 3, 3 * seconds))
        for asked, seconds in zip(ASKED, (60.0, 8e4, 9e4), strict=True)
    )
    print_prices([Row("base.normal_force", 1.0, 0.1, prices)])
    row = next(line for line in capsys.readouterr().out.splitlines() if "normal_force" in line)
    assert [cell.strip() for cell in row.split("│")[4:-1]] == [
        "60 s (20 s to 180 s)",
        "22 h (7 h to 3 days)",
        "more than a day",
    ]


def test_ranks_are_refused(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    _, err = ended(call("plan", "block", *SMALL, "--cost"), 2)
    assert "start it without mpirun" in err


def test_a_scene_without_a_mesh_size_is_refused(call: Call) -> None:
    assert_said(call("plan", "block", "--cost", "--set=contacts={}"), 2, alone=False)
