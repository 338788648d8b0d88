"""Two blocks on each other: a uniform pressure goes over whatever the meshes are, by mortar, not node by node."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from shared.cases import every_nth
from stickslip.geometry.errors import SceneError
from stickslip.workflows.lab.verification.cases import patch as patch_case
from stickslip.workflows.lab.verification.cases.patch import (
    CONTRASTS,
    LOADED,
    NODAL,
    OVERLAPS,
    PATCHES,
    Patch,
    figures,
    scene,
    solve,
)
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.prepared import prepare

FAST = [patch for patch in PATCHES + LOADED if patch.dim == 2 or patch.ratio != "1:20"]
SLOW = [patch for patch in PATCHES + LOADED if patch not in FAST]
UNFIT = [patch for patch in NODAL if patch.order == 1 and patch.ratio != "1:1"]


@pytest.mark.parametrize("patch", every_nth(5, [p for p in FAST if p.ratio != "1:1"]), ids=str)
def test_mortar_carries_a_uniform_pressure_over(patch: Patch) -> None:
    assert not failures(figures(patch))


@pytest.mark.slow
@pytest.mark.parametrize("patch", [*SLOW, *(p for p in FAST if p.ratio == "1:1")], ids=str)
def test_mortar_carries_it_over_in_space_at_a_twentieth_and_on_equal_meshes(patch: Patch) -> None:
    assert not failures(figures(patch))


@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_mortar_carries_it_over_in_space_at_a_twentieth(slave: str) -> None:
    assert not failures(figures(Patch(dim=3, ratio="1:20", slave=slave)))  # type: ignore[arg-type]


@pytest.mark.parametrize("patch", CONTRASTS, ids=str)
def test_block_a_million_times_stiffer_changes_nothing_on_either_side(patch: Patch) -> None:
    assert not failures(figures(patch))


@pytest.mark.parametrize("patch", OVERLAPS, ids=str)
def test_blocks_drawn_more_than_a_cell_inside_each_other_press_apart(patch: Patch) -> None:
    assert not failures(figures(patch))


@pytest.mark.parametrize("dim", [2, 3])
def test_overlap_out_of_reach_is_refused_with_a_way_out(dim: Literal[2, 3]) -> None:
    deep = scene(Patch(dim=dim, overlap=0.75))
    with pytest.raises(SceneError, match=r"contacts.joint: nothing of upper.bottom faces .* set search_distance"):
        prepare(replace(deep, contacts={"joint": replace(deep.contacts["joint"], search_distance=0.7)}))


@pytest.mark.parametrize("patch", [p for p in UNFIT if p.dim == 2 or p.ratio != "1:20"], ids=str)
def test_node_by_node_is_off_by_what_is_said(patch: Patch) -> None:
    assert not failures(figures(patch))


@pytest.mark.slow
@pytest.mark.parametrize("patch", [p for p in NODAL if p not in UNFIT or (p.dim == 3 and p.ratio == "1:20")], ids=str)
def test_node_by_node_on_the_other_meshes(patch: Patch) -> None:
    assert not failures(figures(patch))


def test_uzawa_carries_it_over_too() -> None:
    assert not failures(figures(Patch(ratio="1:20", method="uzawa")))


def test_checks_notice_a_gap_between_the_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    apart = scene(Patch())
    joint = replace(apart.contacts["joint"], gap_offset=1e-6)
    monkeypatch.setattr(patch_case, "scene", lambda patch: replace(apart, contacts={"joint": joint}))
    assert len(failures(figures(Patch()))) == 3  # all but the balance


def test_forces_are_balanced_where_pressures_are_not_uniform() -> None:
    found = solve(Patch(dim=3, ratio="2:3", nodal=True))
    assert np.ptp(found.pressure) > 0.1 * patch_case.P
    assert found.unbalance <= patch_case.BALANCE
