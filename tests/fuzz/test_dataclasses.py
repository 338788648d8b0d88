"""Whatever a program passes to the parts of a scene is accepted or refused in one line."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import stickslip
from shared.fuzzing import accepted, fuzzed
from stickslip.geometry.keys import Noun
from stickslip.solvers.simulation.plan import make_plan

FACE = {name: getattr(stickslip, name) for name in sorted(stickslip.__all__)}
NOUNS = {name: kind for name, kind in FACE.items() if isinstance(kind, type) and issubclass(kind, Noun)}
KINDS = {name: kind for name, kind in NOUNS.items() if is_dataclass(kind) and kind.is_key()}
GOOD: dict[str, dict[str, Any]] = {
    "Material": {"E": 1.0, "nu": 0.3},
    "Block": {"length": 4.0, "height": 2.0, "mesh_size": 0.5},
    "Ring": {"inner_radius": 1.0, "outer_radius": 2.0, "mesh_size": 0.5},
    "Plane": {"point": (0.0, 0.0), "normal": (0.0, 1.0)},
    "Contact": {"surface": "block.bottom", "against": "foundation"},
    "Support": {"boundary": "block.top", "displacement": {"y": -0.1}},
    "Load": {"boundary": "block.left", "pressure": 1.0},
    "Coulomb": {"mu": 0.3},
}
GOOD["Scene"] = {
    "model": "plane strain",
    "geometry": stickslip.Block(**GOOD["Block"]),
    "bodies": {"block": stickslip.Material(**GOOD["Material"])},
    "obstacles": {"foundation": stickslip.Plane(**GOOD["Plane"])},
    "contacts": {"base": stickslip.Contact(**GOOD["Contact"])},
    "supports": {"top": stickslip.Support(**GOOD["Support"])},
}
odd = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.complex_numbers(),
    st.binary(max_size=3),
    st.text(max_size=6),
    st.sampled_from(
        ["3D", "axisymetric", "quad", "condensd", "x" * 5000, 10**400, object(), print, int, np.float32(1)]
    ),
    st.sampled_from([np.array([1.0, np.nan]), np.array(["a"]), np.zeros((2, 0)), np.int8(3), np.array(None)]),
    st.sampled_from([stickslip.Steps(), stickslip.Material(E=1.0, nu=0.3), stickslip.Coulomb(mu=0.3)]),
)
names_or_odd = st.one_of(st.sampled_from(["x", "y", "top", "block", "base"]), st.integers(), st.none())
deep = st.recursive(
    odd,
    lambda v: st.one_of(
        st.lists(v, max_size=3),
        st.tuples(v, v),
        st.sets(st.integers(), max_size=2),
        st.dictionaries(names_or_odd, v, max_size=3),
    ),
    max_leaves=6,
)  # fmt: skip


@fuzzed(12)
@given(st.data())
def test_any_values_of_a_part(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(KINDS)))
    names = [f.name for f in fields(KINDS[name])]
    wild = data.draw(st.dictionaries(st.one_of(st.sampled_from(names), st.text(max_size=5)), deep, max_size=3))
    made = accepted(lambda: KINDS[name](**(GOOD.get(name, {}) | wild)))
    if isinstance(made, stickslip.Scene):
        accepted(lambda: make_plan(made))
