"""Two results side by side: what was asked differently, numbers of the last step with ±, prices."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from stickslip.geometry.errors import FolderError
from stickslip.solvers.effects import by_name, records
from stickslip.solvers.results.step_result import PARTS, ErrorParts
from stickslip.solvers.scene.record import numbers_of, singular
from stickslip.workflows.formats.plus_minus import error_of, missing, of_parts, plus_minus, stated
from stickslip.workflows.formats.results import Results, legend
from stickslip.workflows.formats.templates import render
from stickslip.workflows.pictures.report_page import PHASES, as_written

NOTHING = "–"
APART = ("title", "hash", "output")  # of a scene: nothing that is asked of the solution
COUNTED = ("factorisations", "volume_solves", "linear_iterations", "error_solves")
Rows = list[tuple[str, ...]]
Told = Mapping[str, Any]


class Compared(NamedTuple):
    """A table; its first columns hold words."""

    title: str
    head: tuple[str, ...]
    rows: Rows
    words: int = 1


def compare(a: Results, b: Results) -> list[Compared]:
    """The tables, those without a row left out.

    Raises:
        FolderError: one of them has no step, or is of another version.
    """
    for results in (a, b):
        if not results.reported:
            raise FolderError(f"{results.folder}: no step was solved, so there is nothing to compare")
    try:
        found = (
            Compared("Asked differently", ("key", "A", "B"), _asked(a, b), words=3),
            Compared("Last step", ("number", "A", "B", "B - A", "relative", "within ±"), [*_numbers(a, b)]),
            Compared("Price", ("", "A", "B", "B / A"), [*_prices(a, b)]),
        )
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise FolderError(f"{a.folder} or {b.folder}: not results of this version: {error!r}") from error
    return [one for one in found if one.rows]


def notes(a: Results, b: Results) -> list[str]:
    """What marks beside the numbers mean, and that the two have other units."""
    one, other = (r.scene.get("units", "SI") for r in (a, b))
    mine, theirs = legend(a.content), legend(b.content)
    said = f"A is in {one}, B in {other}: numbers stand as each run has them, and are not compared"
    return [*([mine] if mine == theirs else [f"A: {mine}", f"B: {theirs}"]), *[said] * (a.units != b.units)]


def compare_page(a: Results, b: Results) -> str:
    """The tables as a page."""
    return render("pictures/report/compare.html", a=a, b=b, notes=notes(a, b), tables=compare(a, b))


def _asked(a: Results, b: Results) -> Rows:
    """Keys of the scenes with different values."""

    def leaves(results: Results) -> dict[str, str]:
        tables = {name: value for name, value in results.scene.items() if name not in APART}
        return dict(leaf for name, value in tables.items() for leaf in _leaves(name, value))

    first, second = leaves(a), leaves(b)
    keys = dict.fromkeys([*first, *second])
    rows = [(key, first.get(key, NOTHING), second.get(key, NOTHING)) for key in keys]
    return [row for row in rows if row[1] != row[2]]


def _leaves(name: str, value: Any) -> Iterator[tuple[str, str]]:
    """Keys and values as a scene file says them.

    >>> list(_leaves("steps", {"end": 2.0, "count": 2}))
    [('steps.end', '2'), ('steps.count', '2')]
    """
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _leaves(f"{name}.{key}", item)
    elif text := as_written(value):
        yield name, text


def _numbers(a: Results, b: Results) -> Iterator[tuple[str, ...]]:
    last, given = (a.reported[-1], b.reported[-1]), {"error": {"time": dict.fromkeys(PARTS, 0.0)}}
    yield _difference("time [s]", {**last[0], **given}, {**last[1], **given}, "time")

    def alike(of: str) -> bool:
        return a.unit(of) == b.unit(of)

    def unit(of: str) -> str:
        return " or ".join(dict.fromkeys((a.unit(of), b.unit(of))))

    for kind, record in records().items():
        mine, theirs = (by_name(kind, step.get(kind)) for step in last)
        for name in dict.fromkeys([*mine, *theirs]):
            plain = {"contacts": f"{name}: ", "supports": f"{name}: ", "energy": ""}
            owner = plain.get(kind, f"{f'{singular(kind)} {name}'.rstrip()}: ")
            both = mine.get(name) or {}, theirs.get(name) or {}
            for key, number in numbers_of(record).items():
                for place, axis in enumerate(number.axes(3 if a.solid else 2) if number.words else ()):
                    words = f"{owner}{f'{number.words} {axis}'.rstrip()} [{unit(number.unit)}]"
                    yield _difference(words, *both, key, place, alike(number.unit))


def _difference(
    words: str, a: Told, b: Told, key: str, place: int | None = None, alike: bool = True
) -> tuple[str, ...]:
    """A row: both numbers, their difference with the errors of both, relative to A, and whether these explain it.

    Args:
        alike: whether both have the same unit; else there is no difference.
    """

    def of(owner: Told) -> tuple[float | None, str, ErrorParts]:
        value = owner.get(key)
        value = value[place] if isinstance(value, list) and place is not None and place < len(value) else value
        if not isinstance(value, int | float):
            return None, NOTHING, ErrorParts()
        parts = error_of(owner, key, place)
        return value, of_parts(value, parts), parts

    (mine, told, parts), (theirs, told_too, parts_too) = of(a), of(b)
    if mine is None or theirs is None or not alike:
        return words, told, told_too, NOTHING, NOTHING, NOTHING
    change, error, error_too = theirs - mine, stated(parts), stated(parts_too)
    known = None if error is None or error_too is None else error + error_too
    incomplete = bool(missing(parts) or missing(parts_too))
    relative = f"{100 * change / abs(mine):+.3g} %" if mine and change else NOTHING
    within = "yes" if known is not None and abs(change) <= known else NOTHING if known is None or incomplete else "no"
    return words, told, told_too, plus_minus(change, known, incomplete=incomplete) if change else "0", relative, within


def _prices(a: Results, b: Results) -> Iterator[tuple[str, ...]]:
    def found(results: Results) -> dict[str, Any]:
        content = results.content
        seconds, counters = content.get("seconds") or {}, content.get("counters") or {}
        return {
            "unknown displacements": content.get("dofs"),
            "contact points": content.get("contact_points"),
            "steps": len(results.reported),
            "iterations": sum(step.get("iterations") or 0 for step in results.reported),
            **{name.replace("_", " "): counters.get(name) for name in COUNTED},
            **{f"{name} [s]": seconds.get(name) for name in (*PHASES, "total")},
        }

    mine, theirs = found(a), found(b)
    yield "method", *(str(r.content.get("method") or NOTHING) for r in (a, b)), ""
    for name, one in mine.items():
        other, form = theirs[name], ".2f" if name.endswith("[s]") else ".7g"
        texts = (NOTHING if value is None else f"{value:{form}}" for value in (one, other))
        if one or other:
            yield name, *texts, f"{other / one:.2f}" if one and other is not None else NOTHING
