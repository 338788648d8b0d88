"""The page of a run is one file of HTML with all that it shows inside: tables, pictures, and curves over time."""

from __future__ import annotations

import base64
import json
import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib import colormaps

from stickslip.geometry.arrays import ROUNDING, Array, Bools
from stickslip.geometry.builders.builder import modelled
from stickslip.geometry.errors import FolderError
from stickslip.geometry.units import SI
from stickslip.solvers.effects import by_name, records
from stickslip.solvers.scene.record import ContactNumbers, Energy, numbers_of, singular
from stickslip.workflows.formats import neglect_table
from stickslip.workflows.formats.files import write_output
from stickslip.workflows.formats.marker import declare, is_marked, read_checked
from stickslip.workflows.formats.plus_minus import error_of, of_parts, stated
from stickslip.workflows.formats.results import HEAD, Results, error_budget, legend, profile_rows
from stickslip.workflows.formats.templates import render
from stickslip.workflows.pictures.report_view import model
from stickslip.workflows.pictures.sheet import COLOURS, CURVES, RAISED, STATUS_COLOURS, STATUS_WORDS, ticks

NAME = "report.html"
PARTS = files("stickslip.workflows.pictures") / "report"
NUMBERS = tuple((key, number.words, number.unit) for key, number in numbers_of(ContactNumbers).items() if number.words)
ENERGIES = tuple((number.words, key) for key, number in numbers_of(Energy).items() if number.words)
ASKED = ("geometry", "bodies", "obstacles", "contacts", "supports", "loads", "probes", "steps")  # first, in this order
DOUBT = ("doubtful", "inaccurate", "interrupted", "not ended")
LATER = ("title", "model", "units", "solver", "output", "exact", "accuracy", "hash")
PHASES = ("imports", "mesh", "assemble", "prepare", "iterate", "error", "audit", "output", "other")
Told = Mapping[str, Any]


def write_report(results: Results, path: Path | None = None) -> Path:
    """Write the page, beside the results as one of the run's files, or as the user's own in a file that they name.

    Raises:
        FolderError: the results are of another version, or were changed.
        MachineError: the disk is full, or a file of the results is damaged.
    """
    try:
        content = page(results)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise FolderError(f"{results.folder}: not results that this version can read: {error!r}") from error
    if path is None:
        path = results.folder / NAME
        if is_marked(results.folder) and not os.path.lexists(path):  # a page that is there may be the user's
            declare(results.folder, [NAME])
    write_output(path, content.encode())
    return path


class Table(NamedTuple):
    """A table of a page; its first columns hold words, the others numbers."""

    head: Iterable[str]
    rows: Sequence[Sequence[str]]
    words: int = 1  # so many columns


def page(results: Results) -> str:
    """The whole page."""
    content, steps = results.content, results.reported
    data = model(results)
    return render(
        "pictures/report/run.html",
        title=results.title,
        name=results.name,
        status=str(content.get("status", "")).replace("_", " "),
        kind=_kind(str(content.get("status", "")).replace("_", " ")),
        facts=_facts(results),
        sentence=content.get("sentence"),
        warnings=content.get("warnings") or (),
        steps=steps,
        of=_modelled(results),
        last=_last(results) if steps else None,
        budget=Table(*error_budget(content)),
        neglect=Table(neglect_table.HEAD, neglect_table.neglect_rows(content), words=6),
        mesh_error=f"{error:.1%}" if (error := (content.get("error") or {}).get("discretisation")) else "",
        rounds=(content.get("accuracy") or {}).get("rounds") or (),
        left_out=data["left_out"] if data else None,
        mesh=_mesh(results),
        panels=_panels(results),
        pictures=[_picture(path) for path in results.pictures],
        **_asked(results),
        **(_forces(results) if steps else {}),
        **_cost(results),
        **_audit(results),
        **_view(data),
    )


def number(owner: Told, key: str, component: int | None = None) -> str:
    """A number of a step with its error; a dash if it is not there."""
    value = owner.get(key)
    value = value[component] if component is not None and isinstance(value, list) else value
    return of_parts(value, error_of(owner, key, component)) if isinstance(value, int | float) else "–"


def _kind(status: str) -> str:
    return "good" if status == "converged" else "doubt" if status in DOUBT else "bad"


def _facts(results: Results) -> list[str]:
    content = results.content
    return [
        str(results.scene.get("model", "")),
        str(results.scene.get("units")) if results.units != SI else "",
        f"{content['dofs']} unknown displacements" if content.get("dofs") else "",
        f"{content['contact_points']} contact points" if content.get("contact_points") else "",
        f"{count} step{'s' * (count > 1)}" if (count := len(results.reported)) else "no step was solved",
        f"stickslip {content.get('version')}, dolfinx {content.get('dolfinx')}",
    ]


def _modelled(results: Results) -> list[str]:
    """Return the part whose forces are told, where it is not the whole body."""
    part = modelled(results.scene.get("geometry") or {}, results.scene.get("model", ""))
    return [f"a {results.units.metre} of thickness"] * results.plane + [f"the modelled {part}"] * bool(part)


def _last(results: Results) -> dict[str, Any]:
    """The last step: numbers of its contacts, and what marks beside them mean."""
    last = results.reported[-1]
    contacts = {name: c for name, c in (last.get("contacts") or {}).items() if c}
    rows = [
        (f"{words} [{results.unit(unit)}]", *(number(c, key) for c in contacts.values()))
        for key, words, unit in NUMBERS
        if any(c.get(key) is not None for c in contacts.values())
    ]
    head, *rows = [("contact", *contacts), *rows]
    if len(contacts) > 3:  # then below each other
        head, *rows = [*zip(head, *rows, strict=True)]
    return {"time": f"{last['time']:g}", "contacts": Table(head, rows), "legend": legend(results.content)}


def _view(data: Told | None) -> dict[str, Markup | str]:
    """The data, the library as one object THREE, and the program of the view."""
    if data is None:
        return {"model": ""}
    shades = [[int(255 * part) for part in colormaps[COLOURS](place)[:3]] for place in np.linspace(0, 1, 33)]
    statuses = {str(status): [STATUS_WORDS[status], colour] for status, colour in STATUS_COLOURS.items()}
    told = {**data, "shades": shades, "statuses": statuses}
    text = json.dumps(told, ensure_ascii=False).replace("<", "\\u003c")
    three, names = re.subn(r"export\{([^}]*)\};?\s*$", _as_object, _part("three/three.module.min.js"))
    controls, found = re.subn(
        r"^import \{([^}]*)\} from 'three';", r"const {\1} = THREE;", _part("three/OrbitControls.js"), flags=re.M
    )
    assert names == found == 1, "the library's files are not those of report/three/README.md"
    controls = controls.replace("export { OrbitControls };", "return OrbitControls;")
    return {"model": Markup(text), "three": Markup(three), "controls": Markup(controls)}  # noqa: S704  ours, and JSON without <


def _part(name: str) -> str:
    return (PARTS / name).read_text(encoding="utf-8")


def _as_object(found: re.Match[str]) -> str:
    """`a as B,c` of an export as the object {B:a,c:c}."""
    pairs = (entry.split(" as ") for entry in found[1].split(","))
    return f"return{{{','.join(f'{pair[-1]}:{pair[0]}' for pair in pairs)}}};"


def _panels(results: Results) -> list[Panel]:
    steps = results.reported
    times = np.array([step["time"] for step in steps], float)

    def curve(name: str, kind: str, owner: str, key: str, component: int | None = None) -> Curve:
        holders = [(step.get(kind) or {}) for step in steps]
        found = [(holder.get(owner) if owner else holder) or {} for holder in holders]
        values, errors = [], []
        for one in found:
            value = one.get(key)
            value = value[component] if component is not None and isinstance(value, list) else value
            error = stated(error_of(one, key, component))
            values.append(np.nan if value is None else value)
            errors.append(np.nan if error is None else error)
        return Curve(name=name, values=np.array(values, float), error=np.array(errors, float))

    def of_contacts(*keys: tuple[str, str]) -> list[Curve]:
        names = [
            name
            for name in results.scene.get("contacts") or ()
            if any(name in (s.get("contacts") or {}) for s in steps)
        ]
        return [
            curve(" ".join(filter(None, (name, word))), "contacts", name, key) for name in names for key, word in keys
        ]

    force, axes = results.unit("N"), "xyz"[: 3 if results.solid else 2]
    held = [
        curve(f"{name} {axis}", "supports", name, "force", place)
        for name in results.scene.get("supports") or ()
        for place, axis in enumerate(axes)
    ]
    panels = (
        (f"normal force [{force}]", of_contacts(("normal_force", ""))),
        (f"tangential force [{force}]", of_contacts(("tangential_force", ""))),
        (f"largest pressure [{results.unit('Pa')}]", of_contacts(("max_pressure", ""))),
        (f"contact area [{results.unit('m²')}]", of_contacts(("stick_area", "stick"), ("slip_area", "slip"))),
        (f"force of supports [{force}]", held),
        (f"energy [{results.unit('J')}]", [curve(words, "energy", "", key) for words, key in ENERGIES]),
    )
    drawn = (panel(label, times, curves) for label, curves in panels)
    return [one for one in drawn if one is not None]


def _forces(results: Results) -> dict[str, Table]:
    """Contact forces of each step, then what supports, obstacles and effects carry in the last one, and the probes."""
    keys = [(key, f"{words} [{results.unit(unit)}]") for key, words, unit in NUMBERS[:6]]
    rows = [
        (f"{step['time']:g}", name, *(number(contact or {}, key) for key, _ in keys), str(step.get("iterations", "–")))
        for step in results.reported
        for name, contact in (step.get("contacts") or {}).items()
    ]
    axes, last = "xyz"[: 3 if results.solid else 2], results.reported[-1]
    held = [
        (f"{singular(kind)} {name}", *(number(owner, "force", place) for place in range(len(axes))), _moment(owner))
        for kind, record in records().items()
        for name, owner in by_name(kind, last.get(kind)).items()
        if "force" in numbers_of(record) and owner and owner.get("force")
    ]
    alone = [
        (f"{singular(kind)} {name}", f"{declared.words} [{results.unit(declared.unit)}]", number(owner, key))
        for kind, record in records().items()
        for name, owner in by_name(kind, last.get(kind)).items()
        for key, declared in numbers_of(record).items()
        if kind not in ("contacts", "energy") and declared.words and not declared.shape
    ]
    heads = (*(f"{axis} [{results.unit('N')}]" for axis in axes), f"moment [{results.unit('N m')}]")
    moved = (f"{axis} [{results.unit('m')}]" for axis in axes)
    probes = [
        (name, *(number(probe, "displacement", place) for place in range(len(axes))))
        for name, probe in (last.get("probes") or {}).items()
    ]
    return {
        "by_step": Table(("t [s]", "contact", *(words for _, words in keys), "iterations"), rows, words=2),
        "resultants": Table(("force of", *heads), held),
        "numbers": Table(("of", "number", ""), alone, words=2),
        "probes": Table(("displacement of", *moved), probes),
    }


def _moment(owner: Told) -> str:
    moment = owner.get("moment")
    if isinstance(moment, list):
        return ", ".join(number(owner, "moment", place) for place in range(len(moment)))
    return number(owner, "moment")


def _picture(path: Path) -> dict[str, str]:
    return {"words": path.stem.replace("_", " "), "data": base64.b64encode(read_checked(path)).decode()}


def _asked(results: Results) -> dict[str, Any]:
    """The tables of the scene, what it switches on, and its settings."""
    scene = results.scene
    names = [*ASKED, *(key for key in scene if key not in (*ASKED, *LATER))]
    plan = [(row["effect"], row["because"]) for row in results.content.get("plan") or () if row["on"]]

    def keys(names: Iterable[str]) -> Table:
        return Table(("table", "keys"), [row for name in names for row in _rows(name, scene.get(name))], words=2)

    return {
        "scene": keys(names) if scene else None,
        "plan": Table(("effect", "because"), plan, words=2),
        "settings": keys(LATER[2:]),
    }


def _mesh(results: Results) -> list[str]:
    if results.mesh_lines or "mesh/cells" not in results.mesh:
        return [*results.mesh_lines]
    return [f"mesh: {len(results.mesh['mesh/cells'])} cells, {len(results.mesh['mesh/points'])} nodes"]


def _rows(name: str, value: Any) -> list[tuple[str, str]]:
    """A table of the scene; of one that holds tables by name (bodies, contacts, ...), each of these."""
    if isinstance(value, dict) and value and all(isinstance(item, dict) for item in value.values()):
        return [row for key, item in value.items() for row in _rows(f"{name}.{key}", item)]
    text = as_written(value)
    return [(name, text)] if text else []


def as_written(value: Any) -> str:
    """Return a value as a scene file says it; what is empty is left out.

    >>> as_written({"law": "coulomb", "mu": 0.3, "gap": {}, "x": [[0.0, 0.0], [1.0, 0.5]]})
    'law = coulomb, mu = 0.3, x = [[0, 0], [1, 0.5]]'
    """
    if isinstance(value, dict):
        words = {key: as_written(item) for key, item in value.items()}
        return ", ".join(
            f"{key} = {{{text}}}" if isinstance(value[key], dict) else f"{key} = {text}"
            for key, text in words.items()
            if text
        )
    if isinstance(value, list):
        return f"[{', '.join(map(as_written, value))}]" if value else ""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.6g}" if isinstance(value, float) else "" if value is None else str(value)


def _cost(results: Results) -> dict[str, Any]:
    content = results.content
    seconds, counters = content.get("seconds") or {}, content.get("counters") or {}
    profile = content.get("profile") or ()  # results of before it was there have seconds alone
    phases = [(name, f"{seconds[name]:.2f}") for name in (*PHASES, "total") if seconds.get(name) is not None]
    names = ("factorisations", "volume_solves", "linear_iterations", "error_solves", "forms", "searches")
    counted = [(name.replace("_", " "), str(counters[name])) for name in names if counters.get(name)]
    steps = [s for s in results.reported if s.get("iterations") is not None]
    if steps:
        counted.insert(0, ("iterations of all steps", str(sum(s["iterations"] for s in steps))))
    reference = (content.get("linear_reference") or {}).get("seconds")
    return {
        "method": content.get("method"),
        "because": (content.get("choice") or {}).get("because"),
        "reference": f"{reference:.2f}" if reference else "",
        "spent": Table(HEAD, [*profile_rows(profile)]) if profile else Table(("phase", "seconds"), phases),
        "counted": Table(("work", "count"), counted),
    }


def _audit(results: Results) -> dict[str, Any]:
    verdict, audit = results.content.get("verdict") or {}, results.content.get("audit") or {}
    limits = verdict.get("limits") or {}
    rows = [
        (name.replace("_", " "), f"{value + 0.0:.1e}", f"{limits[name]:.0e}" if name in limits else "–")
        for name, value in audit.items()
        if value is not None
    ]
    return {"passed": verdict.get("passed") or (), "audit": Table(("defect", "found", "limit"), rows)}


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Values over time; NaN: not known."""

    name: str
    values: Array  # (t,)
    error: Array  # (t,)


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A curve as points of the drawing."""

    name: str
    colour: str
    band: list[tuple[float, float]]  # around what its error leaves; empty: not known
    line: list[tuple[float, float]]
    marks: list[tuple[float, float]]


@dataclass(frozen=True, kw_only=True)
class Panel:
    """A drawing of curves: its labels with their places, and the curves."""

    name: str  # of the numbers, with their unit
    label: str  # the same with the power of ten that the numbers of the axis leave out
    levels: list[tuple[float, str]]
    times: list[tuple[float, str]]
    curves: list[Drawn]
    width: int = 460  # of the drawing; then where its axes lie
    height: int = 190
    left: int = 58
    right: int = 448
    top: int = 8
    bottom: int = 166


def panel(name: str, times: Array, curves: Sequence[Curve]) -> Panel | None:
    """Draw these curves, those that stay zero left out; None if none is left, or there is one step alone."""
    size = max((_largest(curve) for curve in curves), default=0.0)
    shown = [curve for curve in curves if _largest(curve) > ROUNDING * size][: len(CURVES)]
    if len(times) < 2 or not shown:
        return None
    reach = [c.values + sign * np.nan_to_num(c.error) for c in shown for sign in (-1, 1)]
    low, high = float(min(0.0, np.nanmin(reach))), float(max(0.0, np.nanmax(reach)))
    low, high = (0.0 if abs(end) < 0.02 * (high - low) else end for end in (low, high))  # so little needs no axis
    levels, power = _ticks(low, high)
    low, high = levels[0], levels[-1]
    end = float(times[-1])
    along = [tick for tick in _ticks(0.0, end)[0] if tick <= end * (1 + ROUNDING)]

    def x(time: Array) -> Array:
        return Panel.left + (Panel.right - Panel.left) * time / end

    def y(values: Array) -> Array:
        return Panel.top + (Panel.bottom - Panel.top) * (high - values) / (high - low)

    def points(values: Array, known: Bools) -> list[tuple[float, float]]:
        return [*zip(x(times)[known].tolist(), y(values)[known].tolist(), strict=True)]

    drawn = []
    for curve, colour in zip(shown, CURVES, strict=False):
        known = np.isfinite(curve.values)
        sure = known & np.isfinite(curve.error)
        line = points(curve.values, known)
        band = points(curve.values + curve.error, sure) + points(curve.values - curve.error, sure)[::-1]
        marks = line if len(times) <= 30 else []
        drawn.append(Drawn(name=curve.name, colour=colour, band=band, line=line, marks=marks))
    return Panel(
        name=name,
        label=name.replace("[", f"[10{str(power).translate(RAISED)} ") if power else name,
        levels=[(float(y(np.array(tick))), f"{tick / 10**power:.4g}") for tick in levels],
        times=[(float(x(np.array(tick))), f"{tick:.4g}") for tick in along],
        curves=drawn,
    )


def _largest(curve: Curve) -> float:
    return float(np.nanmax(np.abs(np.append(curve.values, 0.0))))


def _ticks(low: float, high: float) -> tuple[list[float], int]:
    """About five round numbers that span the range, and the power of ten to write them with.

    >>> _ticks(0.0, 0.0243)
    ([0.0, 0.005, 0.01, 0.015, 0.02, 0.025], -3)
    """
    exponent = math.floor(math.log10(max(abs(low), abs(high)) or 1.0))
    found = ticks(6).tick_values(low, high if high > low else low + 1.0)
    return [float(f"{x:.12g}") for x in found], 0 if -2 < exponent < 4 else 3 * math.floor(exponent / 3)
