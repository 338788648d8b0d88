"""The key `gap` of a contact: what the exact shapes leave between bodies, whatever their facets do."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.geometry.errors import SceneError
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

E, A, B, C = 200.0, 1.0, 2.0, 3.0  # [Pa], radii [m]


def pressure(gap: float | None, normal: dict[str, Any] | None = None) -> float:
    """Mean pressure [Pa] between a quarter of two rings of the same radius with other facets."""
    joint = {"surface": "outer.inside", "against": "inner.outside", "normal": normal or {"law": "unilateral"}}
    roller = {f"{name}_{axis}": {"boundary": f"{name}.{axis}_axis", "displacement": {"xy"[axis == "x"]: 0.0}}
              for name in ("inner", "outer") for axis in "xy"}  # fmt: skip
    scene = from_dict(
        {
            "model": "plane stress",
            "geometry": {"builder": "rings", "inner_radius": A, "radius": B, "outer_radius": C, "angle": 90}
            | {"mesh_size": 0.3, "inner_mesh_size": 0.15, "cells": "tensor"},
            "bodies": {"inner": {"E": E, "nu": 0.3}, "outer": {"E": E, "nu": 0.3}},
            "contacts": {"joint": joint | ({} if gap is None else {"gap": gap})},
            "supports": roller,
        }
    )
    (step,) = prepare(scene).steps()
    return step.contacts["joint"].normal_force / (B * np.pi / 2)


def test_rings_that_fit_press_nothing_though_their_facets_overlap() -> None:
    assert pressure(None) > 0.01  # by the mesh, of twice as many facets inside: a press fit of .7 mm
    assert pressure(0.0) == 0.0


@pytest.mark.parametrize("normal", [{"law": "unilateral"}, {"law": "compliance", "c_n": 1e6, "m_n": 1.0}])
def test_a_negative_gap_is_a_press_fit(normal: dict[str, Any]) -> None:
    """Lamé's closed form, the interference on the radius."""
    exact = E * 1e-3 / B / ((B**2 + A**2) / (B**2 - A**2) + (C**2 + B**2) / (C**2 - B**2))
    assert_allclose(pressure(-1e-3, normal), exact, rtol=0.02)  # order 1, cells of a third of a ring


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"sliding": True}, r"contacts\.base\.gap = 0\.0: a side that slides"),
        ({"normal": {"law": "tied"}}, r"contacts\.base\.gap = 0\.0: a tied surface closes none"),
        ({}, r"contacts\.base\.gap = 0\.0: an obstacle has its exact shape; see gap_offset"),
    ],
)
def test_where_the_key_means_nothing_it_is_refused(changed: dict[str, Any], says: str, scene_of: Any) -> None:
    base = {"surface": "block.bottom", "against": "foundation", "gap": 0.0}
    with pytest.raises(SceneError, match=says):
        scene_of(contacts={"base": base | changed})
