"""Effects that are off: estimates against the column's closed forms, and against small computations of each effect."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad

from stickslip import Scene
from stickslip.geometry.arrays import Array
from stickslip.workflows.formats.neglect_table import HEAD, largest_neglected, neglect_lines, neglect_rows
from stickslip.workflows.formats.results import error_budget
from stickslip.workflows.lab.verification.cases.neglect import CURVED, FAR, said
from stickslip.workflows.lab.verification.prepared import solved
from stickslip.workflows.run.neglect import GRAVITY, Neglected
from stickslip.workflows.scene_file.read import from_dict, read

E, NU, U = 1000.0, 0.3, 0.01
M, G, K = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU)), E / (3 * (1 - 2 * NU))
P = M * U  # pressure of the column


def column(press: str = "moved", **tables: Any) -> Scene:
    """A confined column of unit size on a floor, its top moved by U, or pressed by as much as that asks for."""
    walls = {name: {"boundary": f"block.{name}", "displacement": {"x": 0.0}} for name in ("left", "right")}
    moved = {"top": {"boundary": "block.top", "displacement": {"y": -U}}}
    data = {
        "model": "plane strain",
        "geometry": {"builder": "block", "length": 1.0, "height": 1.0, "mesh_size": 0.5, "cells": "tensor"},
        "bodies": {"block": {"E": E, "nu": NU}},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        "contacts": {"base": {"surface": "block.bottom", "against": "floor"}},
        "supports": walls | (moved if press == "moved" else {}),
        "loads": {} if press == "moved" else {"press": {"boundary": "block.top", "pressure": P}},
        "solver": {"tolerance": 1e-12},
    }
    return from_dict(data | tables)


def at(row: Neglected) -> float:
    """The value at which a main number changes by 1 %."""
    (value,) = row.reaches.values()
    return value


def of(force: float, energy: float) -> float:
    """The largest relative change of the column's numbers."""
    return max(abs(force / P - 1), abs(energy / (P * U / 2) - 1))


@pytest.mark.parametrize("on", ["thermal", "gravity"])
def test_what_a_column_changes_by_is_exact_to_first_order(on: str) -> None:
    """Half of the weight rests on the base of a column that is held at both ends."""
    last, report = said(column(bodies={"block": {"E": E, "nu": NU, "density": 1e-4}}))
    if on == "gravity":
        tables: dict[str, Any] = {
            "bodies": {"block": {"E": E, "nu": NU, "density": 1e-4}}, "gravity": {"acceleration": [0.0, -GRAVITY]},
        }  # fmt: skip
        change = report["gravity"].changes["base.normal_force"]
    else:
        strain = at(report["thermal expansion"])
        tables = {"thermal": {"block": {"expansion": strain, "temperature": 1.0}}}
        change = 0.005 * P  # the energy changes by twice as large a part
    (after,) = solved(column(**tables))[1]
    assert_allclose(after.contacts["base"].normal_force - last.contacts["base"].normal_force, change, rtol=1e-9)


def test_a_load_alone_gives_the_force_and_the_weight_adds_all_of_itself() -> None:
    _, report = said(column("pressed", bodies={"block": {"E": E, "nu": NU, "density": 1e-4}}))
    assert_allclose(report["gravity"].changes["base.normal_force"], 1e-4 * GRAVITY, rtol=1e-9)
    assert not report["thermal expansion"].reaches  # it moves freely
    assert said(column())[1]["thermal expansion"].reaches


def test_wear_is_that_of_the_column() -> None:
    """dp/p = k M s / H."""
    slide = {"surface": "block.bottom", "against": "floor", "slide": [[0, 0], [1, 0], [2, 3.0]]}
    press = column().supports | {}
    tables = {"contacts": {"base": slide}, "steps": {"end": 2.0, "count": 2}}
    held = column(**tables)
    assert press.keys() == held.supports.keys()
    top = {"y": [[0, 0], [1, -U]]}
    walls = {name: {"boundary": f"block.{name}", "displacement": {"x": 0.0}} for name in ("left", "right")}
    tables["supports"] = walls | {"top": {"boundary": "block.top", "displacement": top}}
    k = at(said(column(**tables))[1]["wear"])
    assert_allclose(k * M * 3.0, 0.005, rtol=1e-9)  # the energy changes by twice as large a part


def test_yielding_against_the_confined_column() -> None:
    """sigma = K eps + 2 Y / 3 beyond yield, without hardening."""
    Y = at(said(column())[1]["yielding"])
    true = of(K * U + 2 * Y / 3, K * U**2 / 2 + Y**2 / (6 * G))
    assert 0 < Y < 2 * G * U
    assert 0.3 < 0.01 / true < 3


def test_creep_against_the_relaxing_column() -> None:
    """Deviators relax at the rate 3 G A, by ds/dt = 2 G de/dt - 3 G A s, while the top moves for a second."""
    A = at(said(column())[1]["creep"])
    left = quad(lambda t: np.exp(-3 * G * A * (1 - t)), 0.0, 1.0)[0]
    true = of(U * (K + 4 * G / 3 * left), U**2 / 2 * (K + 4 * G / 3 * left**2))
    assert 0.3 < 0.01 / true < 3


def test_friction_heat_against_the_heated_column() -> None:
    """p = (M U / H) / (1 - V / V_c), V_c = 2 k / (beta mu H), beta = expansion E / (1 - 2 nu)."""
    mu, V = 0.3, 2.0
    slides = {"surface": "block.bottom", "against": "floor", "slide_speed": V, "friction": {"law": "coulomb", "mu": mu}}
    by = at(said(column(contacts={"base": slides}, steps={"seconds": True, "end": 1.0}))[1]["friction heat"])
    force = P / (1 - V * by * E / (1 - 2 * NU) * mu / 2)
    assert 0.3 < 0.01 / of(force, P * U / 2 * (force / P) ** 2) < 3


def struck(density: float) -> float:
    """Largest part by which the base's force is off that at rest, of its last one: waves in the column, explicit."""
    n, force, t = 100, list[tuple[float, float]](), 0.0
    step = 0.5 / (n * np.sqrt(M / density))
    u, v = np.zeros(n + 1), np.zeros(n + 1)
    while t < 1.0:
        stress: Array = M * n * np.diff(u)
        v[1:-1] += step * np.diff(stress) * n / density
        u += step * v
        t += step
        u[-1] = -U * t
        force.append((-stress[0], P * t))
    return max(abs(found - rest) for found, rest in force) / P


def test_inertia_against_waves_in_the_column() -> None:
    bodies = {"block": {"E": E, "nu": NU, "density": 10.0}}
    row = said(column(bodies=bodies, steps={"seconds": True, "end": 1.0}))[1]["inertia"]
    assert row.number is not None
    assert 0.3 < row.number / struck(10.0) < 3
    assert "seconds" in next(iter(said(column(bodies=bodies))[1]["inertia"].reaches))
    lacking = said(column())[1]["inertia"]
    assert "steps.seconds" in lacking.says
    assert 0.3 < 0.01 / struck(at(lacking)) < 3


def test_cylinders_that_slide_past_each_other_part_by_the_square_of_their_way() -> None:
    """By s² / 4 R: the mean of what both sides fall away by, where the contact goes half of the way back."""
    last, report = said(read("cylinders", [*CURVED, FAR]))
    found = report["sliding search"].changes["line.normal_force"] / last.contacts["line"].normal_force
    assert found == pytest.approx(0.3**2 / (4 * 8.0) / 0.1845, rel=0.3)  # of forces in proportion to the depth
    assert report["sliding search"].where is not None


def test_effects_that_are_on_have_no_row_and_prices_are_positive() -> None:
    warm = {"thermal": {"block": {"expansion": 1e-5, "temperature": 1.0}}}
    report = said(column(**warm))[1]
    assert "thermal expansion" not in report
    assert {"strain and rotation", "yielding", "inertia", "creep", "wear", "gravity"} <= report.keys()
    assert all(row.seconds > 0 for row in report.values())
    assert report["strain and rotation"].where is not None
    assert 0.001 < (report["strain and rotation"].number or 0.0) < 0.1  # strains of 1 %


def test_the_closing_table_names_the_largest() -> None:
    row = {"effect": "gravity", "number": 0.1, "where": {"part": "bodies.block", "point": [0.0, 1.0]}, "seconds": 0.2}
    rows = [
        row | {"changes": {"base.normal_force": 0.3}, "reaches": {}, "says": ""},
        row | {"effect": "wear", "changes": {}, "reaches": {"k [1/Pa]": 2e-6}, "says": "so", "number": None},
    ]
    last = {"contacts": {"base": {"normal_force": 3.0}}}
    content = {"steps": [last], "neglect": rows, "scene": {"model": "plane strain"}}
    head, table = error_budget(content)
    assert (head[-1], table[0][-1]) == ("largest neglected", "gravity 10 %")
    assert largest_neglected(content, "base.max_pressure", 1.0) == ""
    assert all(len(cells) == len(HEAD) for cells in neglect_rows(content))
    assert "k [1/Pa]: 2e-06; so" in neglect_lines(content)[1]
    assert neglect_rows({}) == []
