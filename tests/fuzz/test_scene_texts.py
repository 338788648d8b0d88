"""Scenes, keys and expressions drawn by lot are solved or refused in one line."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import stickslip
from shared.fuzzing import accepted, fuzzed
from stickslip.geometry.expression import CONSTANTS, FUNCTIONS, NAMES, RATE, Expression, check_varying
from stickslip.geometry.keys import Noun
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.commands.cli import app, guarded
from stickslip.workflows.scene_file.read import READY, from_dict, read

FILES = ("cad_part", "crack", "dovetail", "split_clamp")  # of geometries that take long to open
SCENES = {p.stem: p.read_text(encoding="utf-8") for p in sorted(READY.glob("*.toml")) if p.stem not in FILES}
SNIPPETS = [
    "", "\n", "[", "]", "[[", "{", "}", "=", ".", '"', "'", "#", ",", "-", "inf", "nan", "-1", "0", "1e308", "1e-308",
    "true", "[]", "{}", "[[0,0],[1]]", "[[]]", "[1]", "9" * 5000, "[" * 3000, "a." * 3000, "x" * 5000, "\0", "\ufeff",
    "\u2028", "é", "2020-01-01", "3d", "axisymmetric", "plane stress", "block.bottom", "block.top", "foundation",
    "[geometry]", "model",
]  # fmt: skip


def keys_of(table: dict[str, Any], before: str = "") -> Iterator[str]:
    for key, value in table.items():
        yield before + key
        if isinstance(value, dict):
            yield from keys_of(value, f"{before}{key}.")


KEYS = sorted({key for text in SCENES.values() for key in keys_of(tomllib.loads(text))})
numbers = st.one_of(
    st.integers(), st.integers(-3, 3), st.floats(), st.sampled_from([1e-300, 1e300, 1e-9, 1e9, 10**400, 2**63])
)
leaves = st.one_of(numbers, st.booleans(), st.text(max_size=8), st.sampled_from(SNIPPETS))
values = st.recursive(
    leaves, lambda v: st.one_of(st.lists(v, max_size=4), st.dictionaries(st.text(max_size=5), v)), max_leaves=8
)
words = st.one_of(st.sampled_from(SNIPPETS), values.map(lambda v: json.dumps(v)), st.text(max_size=20))
longer = st.tuples(st.sampled_from(KEYS), st.text(max_size=4)).map(".".join)
keys = st.one_of(st.sampled_from(KEYS), st.text(max_size=12), longer)


@st.composite
def mutated(draw: st.DrawFn) -> str:
    """A ready scene with pieces of its text left out, repeated, replaced or moved."""
    text = SCENES[draw(st.sampled_from(sorted(SCENES)))]
    for _ in range(draw(st.integers(1, 4))):
        start, end = sorted(draw(st.tuples(st.integers(0, len(text)), st.integers(0, len(text)))))
        end = min(end, start + draw(st.sampled_from([0, 1, 3, 20, 200])))
        piece = draw(st.one_of(st.sampled_from(SNIPPETS), st.just(text[start:end] * 2), st.text(max_size=5)))
        text = text[:start] + piece + text[end:]
    return text


def planned(source: str | Path, overrides: list[str]) -> None:
    scene = accepted(lambda: read(source, overrides))
    if scene is not None:
        accepted(lambda: make_plan(scene))


@fuzzed(4)
@given(mutated())
def test_a_mutated_scene(tmp_path_factory: Any, text: str) -> None:
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    planned(path, [])


@fuzzed(1)
@given(st.binary(max_size=200))
def test_any_bytes(tmp_path_factory: Any, content: bytes) -> None:
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_bytes(content)
    planned(path, [])


@fuzzed(8)
@given(st.sampled_from(sorted(SCENES)), keys, words)
def test_any_words_of_set(name: str, key: str, word: str) -> None:
    planned(name, [f"{key}={word}"])


@fuzzed(4)
@given(st.sampled_from(sorted(SCENES)), st.sampled_from(KEYS), values)
def test_any_value_of_a_key(name: str, key: str, value: Any) -> None:
    data = tomllib.loads(SCENES[name])
    *tables, last = key.split(".")
    inner = data
    for table in tables:
        inner = inner.setdefault(table, {})
        if not isinstance(inner, dict):
            return
    inner[last] = value
    scene = accepted(lambda: from_dict(data, READY))
    if scene is not None:
        accepted(lambda: make_plan(scene))


@fuzzed(1)
@given(st.text(max_size=300).filter(lambda name: not name.startswith("-")), words)
def test_the_command_ends_with_exit_code_2(name: str, word: str) -> None:
    code = guarded(lambda: app(["plan", f"no such {name}", f"--set=model={word}"], standalone_mode=False))
    assert code == 2


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


PIECES = [
    *NAMES, *FUNCTIONS, "+", "-", "*", "/", "**", "(", ")", ",", ".", " ", "1", "0", "2.5", "1e308", "1e-308", "1_0",
    "0x1", "1j", "9" * 50, "(" * 30, "-" * 30, "lambda", "if", "else", "and", "not", "for", "in", "await", "yield",
    "print", "__import__", "None", "True", "é", "[", "]", "{", ":", "=", "'", "#", "\\", "\n", "\0", "ｘ", "@", "%",
]  # fmt: skip
POINTS = np.array([[0.0, -1.0, 1e300], [1.0, 0.5, 2.0]])


def examined(text: str) -> None:
    def read() -> Expression:
        check_varying(text, "key")
        return Expression(text, dict.fromkeys(CONSTANTS, 0.3))

    expression = accepted(read)
    if expression is not None:
        assert expression.names <= {*NAMES}
        if RATE in expression.names:  # of friction laws: no field depends on it
            accepted(lambda: stickslip.RateDependent(mu=text))
            return
        assert expression(POINTS, 0.5, 1.0).shape == (2,)


@fuzzed(40)
@given(st.lists(st.sampled_from(PIECES), max_size=30).map("".join))
def test_pieces_of_formulas(text: str) -> None:
    examined(text)


@fuzzed(10)
@given(st.text(max_size=500))
def test_any_text(text: str) -> None:
    examined(text)


OF_FIELDS = [name for name in NAMES if name != RATE]
expression_leaves = st.one_of(st.sampled_from(OF_FIELDS), st.floats(0, allow_nan=False, allow_infinity=False).map(repr))
formulas = st.recursive(
    expression_leaves,
    lambda part: st.one_of(
        st.tuples(part, st.sampled_from(["+", "-", "*", "/", "**"]), part).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
        st.tuples(st.sampled_from(sorted(FUNCTIONS)), part).map(
            lambda t: f"{t[0]}({t[1]}, 1)" if t[0] in ("min", "max") else f"{t[0]}({t[1]})"
        ),
        part.map(lambda text: f"-{text}"),
    ),
    max_leaves=8,
)


@fuzzed(20)
@given(formulas)
def test_every_formula_is_read(text: str) -> None:
    """And is worth what Python says of the same text, where that is a real number."""
    check_varying(text, "key")
    points = np.full((1, 3), 2.0)
    values = {name: points[:, i] for i, name in enumerate("xyz")} | {
        name: np.float64(2.0) for name in ("t", *CONSTANTS)
    }
    with np.errstate(all="ignore"):
        try:
            expected = eval(text, {"__builtins__": {}}, values | {"pi": np.float64(np.pi), **FUNCTIONS})
        except (OverflowError, ZeroDivisionError):  # of Python's own numbers
            return
        found = Expression(f"{text} + 0*t", dict.fromkeys(CONSTANTS, 2.0))(points, 2.0, 1.0)
    if not isinstance(expected, complex):
        np.testing.assert_allclose(found, expected, rtol=1e-12)
