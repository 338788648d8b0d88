"""Any text as a scene, and any words of --set, are read or refused in one line."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from shared.fuzzing import accepted, fuzzed
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.commands.cli import app, guarded
from stickslip.workflows.scene_file.read import READY, from_dict, read

SCENES = {p.stem: p.read_text(encoding="utf-8") for p in sorted(READY.glob("*.toml")) if p.stem != "cad_part"}
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
