"""What a script imports: complete, described, and open to kinds that a new file adds."""

import ast
import importlib
import inspect
import pydoc
import re
import textwrap
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, Literal, get_args

import numpy as np
import pytest

import stickslip
from stickslip.geometry.builders import Builder
from stickslip.geometry.keys import Key, Noun
from stickslip.geometry.obstacles import Obstacle
from stickslip.solvers.effects import EFFECTS
from stickslip.solvers.laws import FrictionLaw, NormalLaw

FAMILIES = (Builder, Obstacle, NormalLaw, FrictionLaw)
UNIT = re.compile(r"\[[^\]]+\]")  # [Pa], [m], [-]
SHAPE = re.compile(r"\([^)]*,[^)]*\)|\(\d\)")  # (n,), (n, d)
RESULTS = ("StepResult", "ContactState", "MeshData", "Energy", "Seconds", "HistoryRow")


def comments(kind: type[Any]) -> dict[str, str]:
    """The comments of each field of a class: in its own lines, and in the lines just above it."""
    source = textwrap.dedent(inspect.getsource(kind))
    lines, end, found = source.split("\n"), 0, dict[str, str]()
    body = ast.parse(source).body[0]
    assert isinstance(body, ast.ClassDef)
    for node in body.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            own = lines[end : node.end_lineno]
            found[node.target.id] = " ".join(line.partition("#")[2] for line in own)
        end = node.end_lineno or end
    return found


def test_every_name_is_there_and_has_its_place_in_the_guide() -> None:
    assert len(stickslip.__all__) == len(set(stickslip.__all__))
    guide = (stickslip.__doc__ or "").partition("Names\n-----")[2]
    named = set(re.findall(r"\b[A-Za-z]\w*\b", guide))
    assert not {name for name in stickslip.__all__ if name not in named}


@pytest.mark.parametrize("name", stickslip.__all__)
def test_every_public_class_and_function_says_what_it_is(name: str) -> None:
    found = getattr(stickslip, name)
    if not (inspect.isclass(found) or inspect.isfunction(found)):
        assert name in ("OPEN", "SLIP", "STICK")
        return
    said = inspect.getdoc(found) or ""
    assert said.split("\n")[0].endswith((".", ":")), said
    assert not said.startswith(f"{name}("), "a dataclass without words of its own"
    if inspect.isfunction(found):
        wanted = ["Args:", "Returns:", "Raises:", *(f"    {p}: " for p in inspect.signature(found).parameters)]
        assert not [part for part in wanted if f"\n{part}" not in said]


@pytest.mark.parametrize("name", RESULTS)
def test_every_number_of_a_result_has_a_unit_and_every_array_a_shape(name: str) -> None:
    kind = getattr(stickslip, name)
    assert is_dataclass(kind)
    said = comments(kind)
    no_shape = [f.name for f in fields(kind) if f.type in ("Array", "Ints") and not SHAPE.search(said[f.name])]
    no_unit = [f.name for f in fields(kind) if f.type in ("float", "Array") and not UNIT.search(said[f.name])]
    for_all = UNIT.search(kind.__doc__ or "")  # a class of energies, or of seconds, says its unit once
    assert (no_shape, [] if for_all else no_unit) == ([], [])


def test_every_registered_kind_is_public() -> None:
    for family in FAMILIES:
        for kind in family.kinds:
            assert getattr(stickslip, kind.__name__) is kind
            assert kind.__name__ in dir(stickslip)
    tables = {kind for effect in EFFECTS for kind in nouns_of({**vars(type(effect)), **vars(effect)})}
    assert {kind.__name__ for kind in tables} >= {"Gravity", "Periodic"}
    assert all(getattr(stickslip, kind.__name__) is kind for kind in tables)


def nouns_of(attributes: dict[str, Any]) -> set[type[Noun]]:
    """Scene tables among an effect's attributes: a class, or a mapping of names to it."""
    found = [part for value in attributes.values() for part in (value, *get_args(value))]
    return {part for part in found if isinstance(part, type) and issubclass(part, Noun)}


def test_a_new_kind_is_public_without_a_line_here(monkeypatch: pytest.MonkeyPatch) -> None:
    for family in FAMILIES:
        monkeypatch.setattr(family, "kinds", list(family.kinds))  # the new ones go with the test
    with pytest.raises(AttributeError, match="no attribute 'Sticky'"):
        _ = stickslip.Sticky

    @dataclass(frozen=True, kw_only=True)
    class Sticky(FrictionLaw):
        """The bound does not depend on the pressure."""

        s: Annotated[float, Key("Pa", "bound")]
        law: Annotated[Literal["sticky"], Key("-", "the law's name")] = "sticky"

    @dataclass(frozen=True, kw_only=True)
    class Shared(Obstacle):
        """What several kinds share: it has no name of its own, and is no kind."""

    @dataclass(frozen=True, kw_only=True)
    class Wind(Noun):
        """The table of a new effect."""

    assert stickslip.Sticky is Sticky
    assert stickslip.Wind is Wind
    assert {"Sticky", "Wind"} <= set(dir(stickslip))
    assert "Shared" not in dir(stickslip)
    assert importlib.import_module("stickslip").Sticky is Sticky


def block_of(E: float) -> stickslip.Scene:
    """The ready scene, of another material."""
    return replace(stickslip.read("block"), bodies={"block": stickslip.Material(E=E, nu=0.3)})


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: stickslip.steps("block"), "steps: scene = 'block': expected Scene"),
        (lambda: stickslip.prepare(None), "prepare: scene = None: expected Scene"),
        (lambda: stickslip.run(None, "out"), "run: scene = None: expected Scene"),
        (lambda: stickslip.run(stickslip.read("block"), 3), "run: folder = 3: expected str | Path"),
        (lambda: stickslip.read("block", [3]), "read: overrides = [3]: expected Sequence[str]"),
        (lambda: stickslip.read("block", "steps.count=3"), "read: overrides = 'steps.count=3': expected Sequence[str]"),
        (lambda: stickslip.load(None), "load: folder = None: expected str | Path"),
        (lambda: stickslip.sweep("block", {}, "out"), "sweep: scene = 'block': expected Scene"),
        (lambda: stickslip.sweep(stickslip.read("block"), {3: [1]}, "out"), "sweep: over = {3: [1]}: expected Mapping"),
        (lambda: stickslip.sweep(stickslip.read("block"), {"steps.count": [object()]}, "out"), "expected a whole"),
        (lambda: stickslip.Material(E=10**400, nu=0.3), "E = 1000.*000: expected a number, in Pa"),
        (lambda: block_of(1e300), "bodies.block.E = 1e+300: must be 0, or from 1e-100 to 1e+100 in size"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_no_scene_and_no_folder_is_refused_in_a_line(call: Callable[[], Any], said: str) -> None:
    with pytest.raises(stickslip.SceneError, match=re.escape(said).replace(r"\.\*", ".*")) as caught:
        call()
    assert len(caught.value.lines) == 1


def test_a_name_that_nothing_has_is_refused() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Blok'"):
        _ = stickslip.Blok
    with pytest.raises(ImportError):
        from stickslip import Blok  # noqa: F401


def test_help_begins_with_the_guide() -> None:
    page = pydoc.plain(pydoc.render_doc(stickslip))
    assert page.index("A first script") < page.index("Units and signs") < page.index("CLASSES")
    assert max(len(line) for line in (stickslip.__doc__ or "").split("\n")) <= 105


def test_types_of_results_are_public() -> None:
    """What a script can hold in its hands has a name that it can import."""
    seen = set[str]()
    for name in RESULTS:
        kind = getattr(stickslip, name)
        words = {word for f in fields(kind) for word in re.findall(r"\b[A-Z]\w+", str(f.type))}
        module = inspect.getmodule(kind)
        assert isinstance(module, ModuleType)
        met = {word: getattr(module, word) for word in words if hasattr(module, word)}
        seen |= {
            word for word, each in met.items() if inspect.isclass(each) and each.__module__.startswith("stickslip.")
        }
    assert {"ContactState", "Energy"} <= seen
    assert not seen - set(stickslip.__all__)


def test_the_constants_are_those_of_the_status() -> None:
    assert np.unique([stickslip.OPEN, stickslip.SLIP, stickslip.STICK]).size == 3
    source = Path(inspect.getsourcefile(stickslip.ContactState) or "").read_text(encoding="utf-8")
    assert "OPEN, SLIP or STICK" in source
