"""No constant is absolute: in mm, N, MPa every scene takes the same iterations to the same answers."""

from collections.abc import Iterator
from dataclasses import is_dataclass
from typing import Any, get_type_hints

import numpy as np
import pytest
from numpy.testing import assert_allclose

import stickslip
from shared.failures import failures
from shared.problems import on_floor
from stickslip import ContactState, Key, read
from stickslip.geometry.keys import Choice, Noun
from stickslip.solvers.laws.pressure_dependent import PressureDependent
from stickslip.solvers.laws.slip_dependent import SlipDependent
from stickslip.solvers.method_registry import METHODS
from stickslip.workflows.lab.verification.cases import units as units_case
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.lab.verification.units import Units, convert, in_millimetres
from stickslip.workflows.scene_file.read import from_dict, to_dict

MM = Units(length=1000.0, force=1.0, plane=False)


@pytest.mark.parametrize("name", list(units_case.SCENES)[::3])  # test_cases: all of them
def test_millimetres_give_the_same_iterations_and_answers(name: str) -> None:
    assert not failures(units_case.compared(name, "condensed-newton"))


def test_a_file_in_millimetres_is_the_same_in_a_scene_in_metres_and_in_one_in_millimetres() -> None:
    assert not failures(units_case.from_step("condensed-newton"))


def test_places_and_heights_of_a_map_are_converted_alike() -> None:
    rows = [
        read("profile").obstacles["floor"].height.rows,
        in_millimetres(read("profile")).obstacles["floor"].height.rows,
    ]
    assert_allclose(np.array(rows[1]), 1000.0 * np.array(rows[0]))


def test_surfaces_as_stiff_as_steel_are_the_same_in_millimetres() -> None:
    """A block that nothing but friction holds: the bound by its penetration is .3 of the pressure on it."""
    normal, friction = {"law": "compliance", "c_n": 1e13}, {"law": "compliance", "c_T": 3e17, "m_T": 2.0}
    pressed = {side: {"boundary": f"block.{side}", "pressure": p} for side, p in (("top", 1e8), ("left", 1e6))}
    sizes, laws = {"length": 0.1, "height": 0.05, "mesh_size": 0.025}, {"normal": normal, "friction": friction}
    block = on_floor(2, sizes, {"E": 2.1e11}, laws, loads=pressed)
    assert not failures(units_case.in_both("block of steel", from_dict(block)))


def test_scenes_that_uzawa_cannot_solve_are_told_apart() -> None:
    assert METHODS["condensed-newton"].WORKS_WITH.floating
    assert not METHODS["uzawa"].WORKS_WITH.floating
    assert set(units_case.FLOATING + units_case.GRADED) < set(units_case.SCENES)


def test_checks_notice_numbers_that_were_not_converted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(units_case, "in_millimetres", lambda scene: scene)
    checks = units_case.compared("column 3D, m = 2", "condensed-newton")
    assert len(failures(checks)) == 3  # [m], [Pa], [J]: a newton is one, and an iteration is one, in both


@pytest.mark.parametrize(
    ("unit", "factor"),
    # 1 t = 1000 kg, 1 MPa = 1 N/mm²
    [("m", 1e3), ("N", 1), ("Pa", 1e-6), ("kg/m³", 1e-12), ("m/s²", 1e3), ("s", 1), ("-", 1), ("J", 1e3), ("1/K", 1)],
)
def test_units_have_the_factors_of_any_table_of_units(unit: str, factor: float) -> None:
    assert_allclose(MM.factor(unit), factor, rtol=1e-15)


def test_plane_models_count_force_and_energy_per_millimetre_of_thickness() -> None:
    plane = Units(length=1000.0, force=1.0, plane=True)
    assert_allclose([plane.factor("N"), plane.factor("J"), plane.factor("Pa")], [1e-3, 1.0, 1e-6], rtol=1e-15)


def test_compliance_takes_its_exponent_from_its_own_law() -> None:
    law = stickslip.Compliance(c_n=1.0, m_n=2.5)
    assert_allclose(MM.factor("Pa/m^m_n", law), 1e-6 / 1000.0**2.5, rtol=1e-14)


def test_scene_is_converted_in_every_corner_and_stays_a_scene() -> None:
    metres = read("foundation", ["probes.corner.point=[0.0,1.0]", "contacts.base.gap_offset=1e-4"])
    mm = in_millimetres(metres)
    base, block = mm.contacts["base"], mm.bodies["block"]
    assert isinstance(base.normal, stickslip.Compliance)
    assert base.gap_offset == 0.1
    assert_allclose([base.normal.c_n, block.E, block.density], [1.0, 10.0, 2.4e-9], rtol=1e-12)
    assert mm.probes["corner"].point == (0.0, 1000.0)
    assert mm.obstacles["foundation"].displacement == {"x": ((0.0, 0.0), (1.0, 0.0), (2.0, 10.0))}
    assert mm.sections["gravity"].acceleration == (0.0, ((0.0, 0.0), (1.0, -9810.0)))
    assert (mm.steps, mm.solver, mm.model, mm.supports["wall"]) == (
        *(metres.steps, metres.solver, metres.model),
        metres.supports["wall"],  # held at 0, in any unit
    )
    assert from_dict(to_dict(mm)) == mm


def nouns(family: type[Any] = Noun) -> Iterator[type[Any]]:
    for kind in family.__subclasses__():
        yield kind
        yield from nouns(kind)


@pytest.mark.parametrize("noun", [n for n in nouns() if is_dataclass(n) and n is not Choice], ids=lambda n: n.__name__)
def test_every_key_has_a_unit_that_can_be_converted(noun: type[Any]) -> None:
    class Exponent:
        m_n, m_T = 2.0, 1.5

    for hint in get_type_hints(noun, include_extras=True).values():
        for key in getattr(hint, "__metadata__", ()):
            if isinstance(key, Key):
                assert MM.factor(key.unit, Exponent) > 0


def test_tables_have_both_columns_converted() -> None:
    law = PressureDependent(mu=((0.0, 0.4), (2e6, 0.3)))
    assert convert(law, MM).mu == ((0.0, 0.4), (2.0, 0.3))
    assert convert(SlipDependent(mu=((0.5, 0.4),)), MM).mu == ((500.0, 0.4),)


SIZES = ["geometry.mesh_size=0.3", "geometry.lower_mesh_size=0.4", "geometry.contact_mesh_size=0.15"]


def joint(E: float) -> ContactState:
    """Two blocks of the same stiffness [Pa], moved: forces are proportional to it."""
    simulation = prepare(read("two_blocks", [*SIZES, f"bodies.upper.E={E}", f"bodies.lower.E={E}"]))
    *_, last = simulation.steps()
    return last.contacts["joint"]


@pytest.mark.parametrize("E", [1e-24, 1e-16, 1e24])
def test_forces_are_proportional_to_the_stiffness_of_all_bodies(E: float) -> None:
    found, one = joint(E), joint(1.0)
    assert_allclose(found.force / E, one.force, rtol=1e-9)
    assert_allclose(found.pressure / E, one.pressure, rtol=0, atol=1e-8 * one.max_pressure)
