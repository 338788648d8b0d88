"""What a scene does not contain costs nothing."""

from dataclasses import replace
from pathlib import Path

import pytest

from shared.solved import ZERO, Solved, coarse, solve
from stickslip.solvers.scene.loads import Support
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.run.terminal import Reporter
from stickslip.workflows.scene_file.read import read


@pytest.fixture(scope="module")
def with_everything() -> Scene:
    """Gravity, compliance, friction; no error of a body without loads, whose scale is rounding."""
    return read("foundation", [*coarse("foundation"), "output.error=false"])


def test_contact_without_friction_has_no_tangential_unknowns(tmp_path: Path) -> None:
    block = read("block", coarse("block"))
    rubbing = solve(block, tmp_path / "with").result
    bare = replace(block, contacts={"base": replace(block.contacts["base"], friction=None)})
    smooth = solve(bare, tmp_path / "without").result
    assert rubbing["counters"]["unknowns"]["tangential"] > 0
    assert smooth["counters"]["unknowns"]["tangential"] == 0
    assert smooth["counters"]["unknowns"]["normal"] == rubbing["counters"]["unknowns"]["normal"]
    assert smooth["counters"]["forms"] <= rubbing["counters"]["forms"]
    for step in smooth["steps"]:
        base = step["contacts"]["base"]
        assert base["tangential_force"] == base["dissipation"] == 0
    assert {row["effect"] for row in rubbing["plan"] if row["on"]} - {
        row["effect"] for row in smooth["plan"] if row["on"]
    } == {"friction"}


def test_scene_without_contact_condenses_and_searches_nothing(tmp_path: Path) -> None:
    block = read("block", coarse("block"))
    supports = {**block.supports, "base": Support(boundary="block.bottom", displacement={"y": 0.0})}
    plain = solve(replace(block, contacts={}, obstacles={}, supports=supports), tmp_path / "out")
    counters = plain.result["counters"]
    assert (counters["schur_size"], counters["searches"]) == (0, 0)
    assert counters["unknowns"]["normal"] == counters["unknowns"]["tangential"] == 0
    assert plain.result["contact_points"] == 0
    assert counters["factorisations"] == 1  # for both steps
    assert counters["volume_solves"] == sum(step["volume_solves"] for step in plain.result["steps"])
    assert all(step["iterations"] == 0 for step in plain.result["steps"])  # linear: nothing to iterate
    assert not list(plain.folder.glob("contact_*"))
    assert [row["effect"] for row in plain.result["plan"] if row["on"]] == ["quasistatic"]
    assert all(step["contacts"] == {} and step["audit"]["equilibrium"] <= ZERO for step in plain.result["steps"])


def test_audit_finds_nothing_in_a_body_that_moves_as_a_whole(tmp_path: Path) -> None:
    block = read("block", coarse("block"))
    moved = solve(
        replace(block, contacts={}, obstacles={}), tmp_path / "out"
    )  # its top moves it, nothing else holds it
    assert max(moved.result["audit"].values()) <= ZERO


def test_each_pair_of_bodies_is_searched_once_and_rigid_obstacles_never(solved: Solved) -> None:
    pairs = [c for c in solved.scene.contacts.values() if c.against not in solved.scene.obstacles]
    searches = solved.result["counters"]["searches"]
    if any(c.sliding for c in pairs):
        assert searches > len(solved.result["steps"]) * len(pairs)
    else:
        assert searches == len(pairs)


def test_volume_is_prepared_once_whatever_the_number_of_steps(tmp_path: Path) -> None:
    block = read("block", [*coarse("block"), "steps.count=6"])
    counters = solve(block, tmp_path / "out").result["counters"]
    assert counters["factorisations"] == 1


def test_each_effect_taken_away_takes_its_forms_along(with_everything: Scene, tmp_path: Path) -> None:
    def forms(scene: Scene, name: str) -> int:
        return int(solve(scene, tmp_path / name).result["counters"]["forms"])

    light = replace(with_everything, sections={})
    held = {"wall": read("block").supports["top"]}
    free = replace(light, contacts={}, obstacles={}, supports=held, exact=replace(light.exact, values={}))
    counted = [forms(with_everything, "everything"), forms(light, "no gravity"), forms(free, "no contact")]
    assert counted[0] > counted[1] >= counted[2] > 0  # gravity is a form; a rigid obstacle is matrix rows, not forms


def test_an_audit_that_is_left_out_compiles_nothing_and_is_null(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    block = read("block", coarse("block"))
    audited = solve(block, tmp_path / "with").result

    def built(*_: object) -> None:
        raise AssertionError("an auditor was built")

    monkeypatch.setattr("stickslip.workflows.run.audit.Auditor", built)
    silent = solve(replace(block, output=replace(block.output, audit=False)), tmp_path / "without").result
    assert silent["counters"].pop("forms") < audited["counters"].pop("forms")
    assert silent["counters"] == audited["counters"]
    assert {step["audit"] for step in silent["steps"]} == set(silent["audit"].values()) == {None}
    assert silent["audit"].keys() == audited["audit"].keys()
    for result in (audited, silent):
        Reporter(quiet=False, verbose=False).table(result)
    shown = capsys.readouterr().out
    assert shown.count("audit (relative defects): equilibrium") == 1
    assert shown.count("audit: left out, output.audit = false") == 1
