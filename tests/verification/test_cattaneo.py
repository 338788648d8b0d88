"""Two cylinders pressed and sheared: Hertz, Cattaneo, Mindlin, whichever side is the slave and however it is meshed."""

from dataclasses import replace

import numpy as np
import pytest

from stickslip.workflows.lab.verification.cases import cattaneo as cattaneo_case
from stickslip.workflows.lab.verification.cases.cattaneo import PAIRS, RATIO, Two, solve
from stickslip.workflows.lab.verification.check import failures

# tolerances are the case's own, with what was measured


@pytest.mark.parametrize("name", PAIRS)
def test_pressure_shear_and_stick_are_those_of_the_closed_form(name: str) -> None:
    assert not failures(cattaneo_case.figures(name, PAIRS[name]))


def test_uzawa_finds_them_too() -> None:
    loose = Two(order=1, ratio=RATIO, method="uzawa", tolerance=1e-7)
    assert not failures(cattaneo_case.figures("linear cells that do not match", loose))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["uzawa", "surface-uzawa"])
def test_other_methods_find_them_too_and_repeat(method: str) -> None:
    assert not failures(cattaneo_case.checks(method))


def test_slave_and_master_may_change_places() -> None:
    assert not failures(cattaneo_case.swapped())


def test_contact_alone_holds_a_pressed_cylinder_stiff_or_not() -> None:
    assert not failures(cattaneo_case.floats())


def test_nodes_against_segments_are_wrong_on_every_mesh_and_mortar_is_not() -> None:
    assert not failures(cattaneo_case.nodes_to_segments())


def test_turns_repeat() -> None:
    assert not failures(cattaneo_case.reversals())


def test_turns_repeat_where_bodies_are_not_condensed() -> None:
    assert not failures(cattaneo_case.reversals(replace(cattaneo_case.COARSE, method="surface-uzawa")))


def test_checks_notice_the_nodal_operator() -> None:
    assert failures(cattaneo_case.figures("nodal", Two(ratio=RATIO, operator="node-to-segment")))


def test_shear_is_not_that_of_full_slip() -> None:
    _, sheared = solve(Two())
    inside = np.abs(sheared.x) < 0.9 * sheared.exact.c
    assert np.all(np.abs(sheared.shear[inside]) < 0.9 * cattaneo_case.MU * sheared.face.pressure[inside])
