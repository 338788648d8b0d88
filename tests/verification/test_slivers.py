"""Cells of aspect 1000 change neither the answers nor, by much, the iterations."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.solvers.method_registry import METHODS
from stickslip.workflows.lab.verification.cases import slivers as slivers_case
from stickslip.workflows.lab.verification.cases.slivers import ASPECT, CELLS, SCENES, squeezed
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.prepared import system_of

HELD = [name for name, thin in SCENES.items() if not thin.floating]


@pytest.mark.parametrize("name", SCENES)
def test_closed_forms_hold_on_thin_cells(name: str) -> None:
    assert not failures(slivers_case.thin(name, "condensed-newton"))


@pytest.mark.parametrize("name", HELD)
def test_uzawa_does_not_mind_thin_cells_either(name: str) -> None:
    assert not METHODS["uzawa"].WORKS_WITH.floating
    assert not failures(slivers_case.thin(name, "uzawa"))


def test_cells_are_as_thin_as_they_are_said_to_be() -> None:
    base = system_of(slivers_case.block("condensed-newton"), squeezed).contacts[0]
    lengths = np.diff(np.sort(base.surface.points[:, 0]))
    # between planes 1e-3 of a cell and a whole cell apart
    assert_allclose([lengths.min(), lengths.max()], [1 / CELLS / ASPECT, 2 / CELLS - 1 / CELLS / ASPECT], rtol=1e-9)


def test_checks_notice_another_pressure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slivers_case, "PRESSURE", 7.0)
    block = slivers_case.block("condensed-newton")
    monkeypatch.setattr(slivers_case, "PRESSURE", 7.001)
    monkeypatch.setitem(SCENES, "other", slivers_case.Thin(lambda method: block, slivers_case.uniform))  # type: ignore[arg-type]
    assert len(failures(slivers_case.thin("other", "condensed-newton"))) == 3
