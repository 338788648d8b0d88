"""What a program passes to the parts of a scene is checked like a scene file, and refused in the same words."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stickslip as s
from stickslip.geometry.errors import LONGEST_LINE, SceneError, nearest, require
from stickslip.solvers.laws.friction import Coulomb
from stickslip.workflows.scene_file.read import from_dict, lines_of_keys, read


def scene(**keys: Any) -> s.Scene:
    found = dict[str, Any](
        model="plane strain",
        geometry=s.Block(length=4.0, height=2.0, mesh_size=0.5),
        bodies={"block": s.Material(E=1.0, nu=0.3)},
        supports={"bottom": s.Support(boundary="block.bottom", displacement={"x": 0.0, "y": 0.0})},
    )
    return s.Scene(**(found | keys))


WRONG: dict[str, tuple[Callable[[], object], str]] = {
    "3D": (lambda: scene(model="3D"), r'^model = "3D": not one of these; did you mean 3d\?$'),
    "misspelt model": (lambda: scene(model="axisymetric"), r"^model = .*; did you mean axisymmetric\?$"),
    "no model": (lambda: scene(model=None), "^model = null: not one of these; known: 3d, axisymmetric, plane strain"),
    "cells": (lambda: s.Block(length=1.0, height=1.0, mesh_size=1.0, cells="quad"), "^cells = .*known: simplex, tens"),  # type: ignore[arg-type]
    "surface": (lambda: s.Solver(surface="condensd"), r"^surface = .*did you mean condensed\?$"),  # type: ignore[arg-type]
    "infinite": (lambda: s.Steps(end=math.inf), "^end = Infinity: must be a finite number$"),
    "nan": (lambda: s.Material(E=math.nan, nu=0.3), "^E = NaN: must be a finite number$"),
    "tiny": (lambda: s.Steps(end=1e-300), "^end = 1e-300: must be from 1e-100 to 1e.100 s$"),
    "text for a number": (lambda: s.Material(E="1", nu=0.3), '^E = "1": expected a number, in Pa$'),  # type: ignore[arg-type]
    "fraction": (lambda: s.Steps(count=2.5), "^count = 2.5: expected a whole number$"),  # type: ignore[arg-type]
    "truth": (lambda: s.Steps(count=True), "^count = true: expected a whole number$"),
    "unknown key": (lambda: s.Steps(cout=2), r"^cout: unknown key; did you mean count\?$"),  # type: ignore[call-arg]
    "missing": (lambda: s.Material(E=1.0), "^nu: missing, it has no default$"),  # type: ignore[call-arg]
    "no geometry": (lambda: scene(geometry=None), "^geometry = null: expected a table$"),
    "no body": (lambda: scene(bodies={"block": None}), "^bodies.block = null: expected a Material$"),
    "a list of bodies": (lambda: scene(bodies=[1]), r"^bodies = \[1\]: expected a table$"),
    "law": (lambda: s.Contact(surface="a.b", against="c", friction=0.3), "^friction = 0.3: expected a table$"),  # type: ignore[arg-type]
    "row": (
        lambda: s.Support(boundary="a.b", displacement={"y": [[0, 0], [1]]}),  # type: ignore[dict-item]
        r"^displacement.y.1 = \[1\]: expected a pair \[time, value\]$",
    ),
    "direction": (lambda: s.Support(boundary="a.b", displacement={"q": 1.0}), "^displacement.q = .*known: normal, x"),  # type: ignore[dict-item]
    "effect": (lambda: scene(gravity=9.81), "^gravity = 9.81: expected a Gravity$"),
    "misspelt effect": (lambda: scene(gravty=None), r"^gravty: unknown key; did you mean gravity\?$"),
    "effect's table": (lambda: scene(springs={"s": 1.0}), "^springs.s = 1.0: expected a Spring$"),
    "replaced": (lambda: replace(scene(), model="4d"), '^model = "4d": not one of these'),  # type: ignore[arg-type]
}  # fmt: skip


def test_tables_of_effects_are_given_and_replaced_like_all_others() -> None:
    spring = s.Spring(at="block.top", stiffness=(1.0, 1.0))
    found = scene(bodies={"block": s.Material(E=1.0, nu=0.3, density=1.0)}, springs={"s": spring})
    heavy: s.Scene = replace(found, gravity=s.Gravity(acceleration=(0.0, -9.81)))  # type: ignore[call-arg]
    assert (heavy.springs, heavy.bolts, heavy.gravity.acceleration) == ({"s": spring}, {}, (0.0, -9.81))
    assert heavy == replace(found, sections=heavy.sections)
    assert replace(heavy, gravity=None) == found  # type: ignore[call-arg]
    assert replace(heavy, springs={}).sections.keys() == {"gravity"}  # type: ignore[call-arg]
    with pytest.raises(AttributeError, match="no attribute 'gravty'"):
        _ = found.gravty


@pytest.mark.parametrize("name", WRONG)
def test_wrong_values_are_refused(name: str) -> None:
    make, says = WRONG[name]
    with pytest.raises(SceneError, match=says):
        make()


@pytest.mark.parametrize(("keys", "value"), [("steps.end", '"x"'), ("steps.count", "2.5"), ("steps.end", "[1]")])
def test_the_words_are_those_of_a_file(keys: str, value: str) -> None:
    table, key = keys.split(".")
    with pytest.raises(SceneError) as from_file:
        read("block", [f"{keys}={value}"])
    with pytest.raises(SceneError) as from_python:
        s.Steps(**{key: {'"x"': "x", "2.5": 2.5, "[1]": [1]}[value]})  # type: ignore[arg-type]
    assert str(from_file.value) == f"block.toml: {table}.{from_python.value}"


def test_numpys_numbers_lists_and_whole_numbers_are_what_they_mean() -> None:
    assert s.Probe(point=np.array([1, 2])).point == (1.0, 2.0)  # type: ignore[arg-type]
    assert s.Steps(count=np.int64(3)).count == 3  # type: ignore[arg-type]
    assert isinstance(s.Material(E=1, nu=0.3).E, float)


def test_a_law_of_ones_own_is_accepted() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Own(Coulomb):
        pass

    assert isinstance(s.Contact(surface="a.b", against="c", friction=Own(mu=0.3)).friction, Own)


ODD = {
    "digits": f"geometry.mesh_size={'1' * 5000}",
    "many digits": f"geometry.mesh_size={'1' * 400}",
    "brackets": f"geometry.mesh_size={'[' * 3000}{']' * 3000}",
    "open brackets": f"geometry.mesh_size={'[' * 3000}",
    "tables": f"{'a.' * 3000}a=1",
    "long key": f"{'a' * 100_000}=1",
    "long value": f"model={'x' * 100_000}",
    "lone surrogate": "title=\udcff",
    "row": "supports.top.displacement.y=[[0,0],[1]]",
}


@pytest.mark.parametrize("name", ODD)
def test_odd_words_of_set_are_refused_in_a_short_line(name: str) -> None:
    with pytest.raises(SceneError) as caught:
        read("block", [ODD[name]])
    assert len(str(caught.value)) <= LONGEST_LINE
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["x" * 5000, "a\0b", "/dev/zero", "\udcff"])
def test_odd_names_of_scenes_are_refused(name: str) -> None:
    with pytest.raises(SceneError, match=r"no such file|cannot be read"):
        read(name)


def test_deep_tables_of_a_file_are_refused() -> None:
    value: Any = 1
    for _ in range(30):
        value = {"a": value}
    with pytest.raises(SceneError, match="tables and lists more than 20 deep"):
        from_dict({"title": value})


def test_long_names_are_compared_with_nothing() -> None:
    assert nearest("x" * 100_000, ["a", "b"]) == "known: a, b"
    with pytest.raises(SceneError, match=r"^key = x+ \.\.\. x+: expected$"):
        require(False, "key", "x" * 1000, "expected")


@pytest.mark.parametrize(
    ("name", "key", "size"),
    [("block", "contact", 1e-7), ("cube", "contact", 1e-6), ("two_blocks", "contact", 1e-7), ("ring", "contact", 1e-6),
     ("strip", "", 1e-9)],
)  # fmt: skip
def test_the_key_of_a_mesh_that_is_too_large_is_named(name: str, key: str, size: float) -> None:
    key = f"{key}_mesh_size".removeprefix("_")
    with pytest.raises(SceneError, match=rf"^{name}\.toml: geometry\.{key} = {size}: makes"):
        read(name, [f"geometry.{key}={size}"])


def test_a_mesh_that_does_not_fit_is_refused_with_what_it_needs() -> None:
    geometry, request = scene().geometry.refined(0.01), scene().request()
    geometry.refuse_too_large(request, free=1e10)
    with pytest.raises(
        SceneError, match=r"^mesh_size = 0.005: makes about 6.4e\+05 cells; gmsh would take about 0.96 GB"
    ):
        geometry.refuse_too_large(request, free=1e8)


def test_lines_of_keys_are_found_beside_texts_comments_and_brackets() -> None:
    text = (
        '\ntitle = """a\n "b" # no\n"""\n'  # from line 2
        "s = '''\nx = [\n'''\n"  # 5
        'b = "]#"  # ]\n'  # 8
        "[t]\nc = [ # [\n 1,\n]\n"  # 9, 10
        "d = '['\n\"p.q\" = { r = 1 }\n"  # 13, 14
    )
    expected = {"title": 2, "s": 5, "b": 8, "t": 9, "t.c": 10, "t.d": 13, "t.p.q": 14, "t.p.q.r": 14}
    assert lines_of_keys(text) == expected
    assert lines_of_keys("[a]\nt = [" + "[0, 1],\n" * 10_000 + "]\nz = 1\n")["a.z"] == 10_003


def test_keys_that_are_too_deep_have_no_line(tmp_path: Path) -> None:
    (tmp_path / "deep.toml").write_text("a." * 3000 + "a = 1\n")
    with pytest.raises(SceneError, match=r"^deep\.toml: a\.a\..*more than 20 deep"):
        read(tmp_path / "deep.toml")
