"""The table of applicability: every cell runs and finds what condensed-newton finds, or is refused, of need."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest

from shared.cells import FORMS, MODELS, REFERENCE, Cell, largest, reference, refused, solved, whole
from stickslip import FrictionLaw, NormalLaw
from stickslip.solvers.contact.pairing import OPERATORS
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.methods.method import RIGID
from stickslip.solvers.stepping import halving as stepping
from stickslip.workflows.lab.verification.cases.agreement import Answer

TOLERANCE = 1e-9
SAME = 1e-6  # that, times the condition of friction, and digits to spare
COARSE = 0.01  # regularised, compliance with friction: the bound is that of nodes, which costs with the mesh size
AXIS = 0.06  # regularised, a ball under the axis: of two nodes that touch one is on the axis; with finer cells .001
ROUNDED = 1.05  # the error that a law states is measured, too
ENOUGH = 400  # iterations of a step; none of these cells takes more
EVERY = 197  # a prime: the sample takes each method through laws, operators, models and more by turns
CELLS = [cell for method in METHODS for model in MODELS for cell in whole(method, model)]
OPEN = {"normal": None, "friction": None, "operators": None, "k_T": True, "floating": True, "driven": True}


def wrong(cell: Cell, limit: int = 10000) -> str | None:
    """What is wrong with what it finds, if anything is."""
    scene = cell.scene(TOLERANCE)
    simulation, steps = solved(replace(scene, solver=replace(scene.solver, max_iterations=limit)))
    expected = reference(replace(cell, method=REFERENCE), TOLERANCE)
    if steps[-1].law_error:  # in the energy norm, by what each step states of itself
        round_ = cell.model == "axisymmetric" and cell.more == "sliding"
        mesh = COARSE if cell.normal == "compliance" else AXIS if round_ else 0.0  # what vanishes with its size
        mesh *= cell.method == "regularised"
        apart = Answer(simulation, tuple(steps)).energy_norm(Answer(simulation, tuple(expected)))
        both = zip(steps, expected, strict=True)
        stated = [ROUNDED * step.law_error + step.iteration_error + other.iteration_error for step, other in both]
        found = [(off, max(allowed, TOLERANCE, mesh)) for off, allowed in zip(apart, stated, strict=True)]
        off, allowed = max(found, key=lambda each: each[0] - each[1])
    else:
        off, allowed = largest(steps, expected), SAME
    return None if off <= allowed else f"{cell}: {off:.1e} off, {allowed:.1e} allowed"


@contextmanager
def opened(cell: Cell, patch: pytest.MonkeyPatch) -> Iterator[None]:
    """The table without what refuses the cell."""
    method = METHODS[cell.method]
    fields = {"matrix_free": True, "condensed": True} if cell.more in FORMS else OPEN
    with patch.context() as now:
        now.setattr(method, "WORKS_WITH", replace(method.WORKS_WITH, **fields))
        now.setattr(stepping, "HALVINGS", 0)
        yield


def judged(cell: Cell, patch: pytest.MonkeyPatch) -> str | None:
    sentence = refused(cell)
    if sentence is None:
        try:
            return wrong(cell)
        except Exception as error:
            return f"{cell}: not refused, and {type(error).__name__}: {error}"
    if "\n" in sentence or f"solver.method = {cell.method}" not in sentence or "use " not in sentence:
        return f"{cell}: refused by {sentence!r}"
    with opened(cell, patch):
        try:
            runs = wrong(cell, ENOUGH) is None
        except Exception:
            runs = False
    return f"{cell}: refused, and would run" if runs else None


def test_a_cell_that_is_refused_without_need_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = Cell("surface-uzawa")
    assert judged(cell, monkeypatch) is None
    table = METHODS[cell.method].WORKS_WITH
    monkeypatch.setattr(METHODS[cell.method], "WORKS_WITH", replace(table, friction=()))
    assert judged(cell, monkeypatch) == f"{cell}: refused, and would run"


@pytest.mark.parametrize("cell", CELLS[::EVERY], ids=str)
def test_sample(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    assert judged(cell, monkeypatch) is None


@pytest.mark.parametrize("method", ["surface-uzawa", "tangent-cg"])
def test_a_body_that_falls_does_not_jump(method: str) -> None:
    """The least load moves it all the way, however short the step: cut steps would have slip of another history."""
    cell = Cell(method, model="plane strain", more="floating")
    assert wrong(cell) is None
    for step in reference(replace(cell, method=REFERENCE), TOLERANCE):
        assert step.substeps == 1


def test_places_of_touch_that_go_to_and_fro_settle() -> None:
    """Of five points four or five close, by turns: the places of the others depend on which."""
    assert wrong(Cell("nsgs", model="3d", more="sliding")) is None


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("method", METHODS)
def test_every_cell(method: str, model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert [s for cell in whole(method, model) if (s := judged(cell, monkeypatch))] == []


@pytest.mark.parametrize("operator", ["rigid", "mortar"])
def test_cells_are_in_earnest(operator: str) -> None:
    """A part sticks and a part slips; without friction the answer is another; on the obstacle a part lifts off."""
    cell = Cell(REFERENCE, operator=operator)
    steps, smooth = reference(cell, TOLERANCE), reference(replace(cell, friction=None), TOLERANCE)
    last = steps[-1].contacts["base"]
    assert last.stick_area > 0
    assert last.slip_area > 0
    assert largest(steps, smooth) > 0.1
    if operator == "rigid":
        assert last.contact_area < 0.7 < steps[0].contacts["base"].contact_area


def test_whole_has_every_law_and_operator() -> None:
    for law in NormalLaw.kinds:
        assert any(cell.normal == law.law for cell in CELLS)
    for law in FrictionLaw.kinds:
        assert any(cell.friction == law.law for cell in CELLS)
    assert {cell.operator for cell in CELLS} == {RIGID, *OPERATORS}
    assert {cell.method for cell in CELLS[::EVERY]} == set(METHODS)
