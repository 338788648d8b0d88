"""The page of a run: one file of HTML with all that it shows inside."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from matplotlib import colormaps

from stickslip.geometry.builders.builder import modelled
from stickslip.geometry.errors import FolderError
from stickslip.geometry.units import SI
from stickslip.solvers.effects import records
from stickslip.solvers.scene.record import ContactNumbers, Energy, numbers_of, singular
from stickslip.workflows.formats.aside import write_aside
from stickslip.workflows.formats.plus_minus import MISSING, missing, of_parts, parts_of, stated
from stickslip.workflows.formats.profile import HEAD, profile_rows
from stickslip.workflows.pictures.report_curves import Curve, panel
from stickslip.workflows.pictures.report_results import Results
from stickslip.workflows.pictures.report_view import model
from stickslip.workflows.pictures.sheet import COLOURS, STATUS_COLOURS, STATUS_WORDS

NAME = "report.html"
PARTS = files("stickslip.workflows.pictures") / "report"
BESIDE = 3  # contacts
SHADES = 33  # of the colour scale
NUMBERS = tuple((key, number.words, number.unit) for key, number in numbers_of(ContactNumbers).items() if number.words)
ENERGIES = tuple((number.words, key) for key, number in numbers_of(Energy).items() if number.words)
ASKED = ("geometry", "bodies", "obstacles", "contacts", "supports", "loads", "probes", "steps")  # first, in this order
DOUBT = ("doubtful", "inaccurate", "interrupted", "not ended")
LATER = ("title", "model", "units", "solver", "output", "exact", "accuracy", "hash")
PHASES = ("imports", "mesh", "assemble", "prepare", "iterate", "error", "audit", "output", "other")
Html = str
Told = Mapping[str, Any]


def write_report(results: Results, path: Path) -> Path:
    """Write the page; it is one of the run's files where runs write it, and the user's elsewhere.

    Raises:
        FolderError: the results are of another version, or were changed.
        MachineError: the disk is full, or a file of the results is damaged.
    """
    try:
        content = page(results)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise FolderError(f"{results.folder}: not results that this version can read: {error!r}") from error
    write_aside(path, content.encode(), own=path == results.folder / NAME)
    return path


def page(results: Results) -> Html:
    """The whole page."""
    data = model(results)
    sections = {
        "Summary": _summary(results),
        "View": _view(data),
        "Scene": _scene(results),
        "Curves": _curves(results),
        "Forces": _forces(results),
        "Pictures": "".join(map(_picture, results.pictures)),
        "Cost": _cost(results),
        "Audit": _audit(results),
    }
    there = {name: content for name, content in sections.items() if content}
    body = [f'<section id="{name.lower()}"><h2>{_heading(name)}</h2>{part}</section>' for name, part in there.items()]
    return bare_page(
        results.title,
        f"<nav>{''.join(f'<a href=#{name.lower()}>{_heading(name)}</a>' for name in there)}</nav>{_head(results)}"
        + "".join(body),
        _script(data) if data else "",
    )


def bare_page(title: str, body: Html, script: Html = "") -> Html:
    """A page with our style; whatever it holds, it may load nothing."""
    parts = {"title": escape(title), "style": _part("page.css"), "body": body, "script": script}
    return Template(_part("page.html")).substitute(parts)


def table(head: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1) -> Html:
    """A table; the first `words` columns hold words, the others numbers."""

    def cells(row: Sequence[str], tag: str) -> Html:
        kinds = ["" if place < words else ' class="n"' for place in range(len(row))]
        return "".join(f"<{tag}{kind}>{escape(cell)}</{tag}>" for kind, cell in zip(kinds, row, strict=True))

    lines = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    return (
        f'<div class="table"><table><thead><tr>{cells(head, "th")}</tr></thead><tbody>{lines}</tbody></table></div>'
        if lines
        else ""
    )


def number(owner: Told, key: str, component: int | None = None) -> str:
    """A number of a step with its error; a dash if it is not there."""
    value = owner.get(key)
    value = value[component] if component is not None and isinstance(value, list) else value
    if not isinstance(value, int | float):
        return "–"
    return of_parts(value, parts_of((owner.get("error") or {}).get(key), component))


def _heading(name: str) -> str:
    return {"View": "3D view", "Scene": "What was asked", "Forces": "Forces with ±"}.get(name, name)


def _part(name: str) -> str:
    return (PARTS / name).read_text(encoding="utf-8")


def _head(results: Results) -> Html:
    content, scene = results.content, results.scene
    status = str(content.get("status", "")).replace("_", " ")
    facts = [
        str(scene.get("model", "")),
        str(scene.get("units")) if results.units != SI else "",
        f"{content['dofs']} unknown displacements" if content.get("dofs") else "",
        f"{content['contact_points']} contact points" if content.get("contact_points") else "",
        f"{count} step{'s' * (count > 1)}" if (count := len(results.reported)) else "no step was solved",
        f"stickslip {content.get('version')}, dolfinx {content.get('dolfinx')}",
    ]
    kind = "good" if status == "converged" else "doubt" if status in DOUBT else "bad"
    return (
        f'<header><h1>{escape(results.title)}</h1><p><b class="badge {kind}">{escape(status)}</b> '
        f"{escape(' · '.join(filter(None, facts)))} · results “{escape(results.name)}”</p></header>"
    )


def _summary(results: Results) -> Html:
    content, said = results.content, []
    if content.get("sentence"):
        said.append(f'<p class="note bad">{escape(str(content["sentence"]))}</p>')
    said += [f'<p class="note">{escape(str(warning))}</p>' for warning in content.get("warnings") or ()]
    if results.reported:
        last = results.reported[-1]
        said.append(f"<p>Last step, t = {last['time']:g} s. {_signs(results)}</p>")
        contacts = {name: c for name, c in (last.get("contacts") or {}).items() if c}
        rows = [
            (f"{words} [{results.unit(unit)}]", *(number(c, key) for c in contacts.values()))
            for key, words, unit in NUMBERS
            if any(c.get(key) is not None for c in contacts.values())
        ]
        head, *rows = [("contact", *contacts), *rows]
        if len(contacts) > BESIDE:  # then below each other
            head, *rows = [*zip(head, *rows, strict=True)]
        said.append(table(head, rows))
        if "(grows)" in said[-1]:
            said.append("<p>(grows): the number has no limit on ever finer meshes, as at a sharp edge.</p>")
        if lacking := _lacking(last):
            said.append(f"<p>{MISSING} without the error of the {escape(lacking)}, which is not known.</p>")
    if mesh_error := (content.get("error") or {}).get("discretisation"):
        said.append(f"<p>The mesh leaves an error of about {mesh_error:.1%} in the displacement (energy norm).</p>")
    if rounds := (content.get("accuracy") or {}).get("rounds"):
        each = ", ".join(f"{one['unknowns']} unknowns (order {one['order']})" for one in rounds)
        said.append(f"<p>Refined in {len(rounds)} round{'s' * (len(rounds) > 1)} for the accuracy asked: {each}.</p>")
    return "".join(said)


def _signs(results: Results) -> str:
    part = modelled(results.scene.get("geometry") or {}, results.scene.get("model", ""))
    of = [f"a {results.units.metre} of thickness"] * results.plane + [f"the modelled {part}"] * bool(part)
    per = f"Forces are those of {' of '.join(of)}; they act" if of else "Forces act"
    return f"{per} on the slave side. ± is the estimated error."


def _lacking(step: Told) -> str:
    contacts = [c for c in (step.get("contacts") or {}).values() if c]
    lacking = {part for c in contacts for told in (c.get("error") or {}).values() for part in missing(parts_of(told))}
    return ", ".join(sorted(part.replace("_", " ") for part in lacking))


def _view(data: Told | None) -> Html:
    if data is None:
        return ""
    left_out = f" {data['left_out']} steps between them are left out here." if data["left_out"] else ""
    return _part("view.html") + f"<p class='small'>Turn: drag. Move: right button. Zoom: wheel.{left_out}</p>"


def _script(data: Told) -> Html:
    """The data, the library as one object THREE, and the program of the view."""
    shades = [[int(255 * part) for part in colormaps[COLOURS](place)[:3]] for place in np.linspace(0, 1, SHADES)]
    statuses = {str(status): [STATUS_WORDS[status], colour] for status, colour in STATUS_COLOURS.items()}
    told = {**data, "shades": shades, "statuses": statuses}
    text = json.dumps(told, ensure_ascii=False).replace("<", "\\u003c")
    three, names = re.subn(r"export\{([^}]*)\};?\s*$", _as_object, _part("three/three.module.min.js"))
    controls, found = re.subn(
        r"^import \{([^}]*)\} from 'three';", r"const {\1} = THREE;", _part("three/OrbitControls.js"), flags=re.M
    )
    assert names == found == 1, "the library's files are not those of report/three/README.md"
    controls = controls.replace("export { OrbitControls };", "return OrbitControls;")
    return (
        f'<script type="application/json" id="model">{text}</script>'
        f"<script>const THREE = (() => {{{three}}})();\nconst OrbitControls = (() => {{{controls}}})();</script>"
        f"<script>{_part('view.js')}</script>"
    )


def _as_object(found: re.Match[str]) -> str:
    """`a as B,c` of an export as the object {B:a,c:c}."""
    pairs = (entry.split(" as ") for entry in found[1].split(","))
    return f"return{{{','.join(f'{pair[-1]}:{pair[0]}' for pair in pairs)}}};"


def _curves(results: Results) -> Html:
    steps = results.reported
    times = np.array([step["time"] for step in steps], float)

    def curve(name: str, kind: str, owner: str, key: str, component: int | None = None) -> Curve:
        holders = [(step.get(kind) or {}) for step in steps]
        found = [(holder.get(owner) if owner else holder) or {} for holder in holders]
        values, errors = [], []
        for one in found:
            value = one.get(key)
            value = value[component] if component is not None and isinstance(value, list) else value
            error = stated(parts_of((one.get("error") or {}).get(key), component))
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
    drawn = "".join(panel(label, times, curves) for label, curves in panels)
    return (
        f'<p>Over time [s]; the bands are the estimated errors.</p><div class="panels">{drawn}</div>' if drawn else ""
    )


def _forces(results: Results) -> Html:
    """Contact forces of each step, then what supports, obstacles and effects carry in the last one, and the probes."""
    if not results.reported:
        return ""
    keys = [(key, f"{words} [{results.unit(unit)}]") for key, words, unit in NUMBERS[:6]]
    rows = [
        (f"{step['time']:g}", name, *(number(contact or {}, key) for key, _ in keys), str(step.get("iterations", "–")))
        for step in results.reported
        for name, contact in (step.get("contacts") or {}).items()
    ]
    said = [table(("t [s]", "contact", *(words for _, words in keys), "iterations"), rows, words=2)]
    axes, last = "xyz"[: 3 if results.solid else 2], results.reported[-1]
    held = [
        (f"{singular(kind)} {name}", *(number(owner, "force", place) for place in range(len(axes))), _moment(owner))
        for kind, record in records().items()
        for name, owner in (last.get(kind) or {}).items()
        if "force" in numbers_of(record) and owner and owner.get("force")
    ]
    alone = [
        (f"{singular(kind)} {name}", f"{declared.words} [{results.unit(declared.unit)}]", number(owner, key))
        for kind, record in records().items()
        for name, owner in (last.get(kind) or {}).items()
        for key, declared in numbers_of(record).items()
        if kind not in ("contacts", "energy") and declared.words and not declared.shape
    ]
    heads = (*(f"{axis} [{results.unit('N')}]" for axis in axes), f"moment [{results.unit('N m')}]")
    moved = (f"{axis} [{results.unit('m')}]" for axis in axes)
    probes = [
        (name, *(number(probe, "displacement", place) for place in range(len(axes))))
        for name, probe in (last.get("probes") or {}).items()
    ]
    for title, part in (
        ("Resultants of the last step", table(("force of", *heads), held)),
        ("Numbers of the last step", table(("of", "number", ""), alone, words=2)),
        ("Probes in the last step", table(("displacement of", *moved), probes)),
    ):
        said.append(f"<h3>{title}</h3>{part}" if part else "")
    return "".join(said)


def _moment(owner: Told) -> str:
    moment = owner.get("moment")
    if isinstance(moment, list):
        return ", ".join(number(owner, "moment", place) for place in range(len(moment)))
    return number(owner, "moment")


def _picture(path: Path) -> Html:
    words = escape(path.stem.replace("_", " "))
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<figure><img alt="{words}" src="data:image/png;base64,{data}"><figcaption>{words}</figcaption></figure>'


def _scene(results: Results) -> Html:
    scene = results.scene
    names = [*ASKED, *(key for key in scene if key not in (*ASKED, *LATER))]
    asked = [row for name in names for row in _rows(name, scene.get(name))]
    later = [row for name in LATER[2:] for row in _rows(name, scene.get(name))]
    plan = [(row["effect"], row["because"]) for row in results.content.get("plan") or () if row["on"]]
    mesh = [*results.mesh_lines]
    if not mesh and "mesh/cells" in results.mesh:
        mesh = [f"mesh: {len(results.mesh['mesh/cells'])} cells, {len(results.mesh['mesh/points'])} nodes"]
    said = [table(("table", "keys"), asked, words=2)]
    said.append(f"<h3>Mesh</h3><ul>{''.join(f'<li>{escape(line)}</li>' for line in mesh)}</ul>" if mesh else "")
    said.append(
        f"<h3>Plan: what the scene switches on</h3>{table(('effect', 'because'), plan, words=2)}" if plan else ""
    )
    settings = table(("table", "keys"), later, words=2)
    said.append(f"<details><summary>Solver and output settings</summary>{settings}</details>" if settings else "")
    return "".join(said) if scene else ""


def _rows(name: str, value: Any) -> list[tuple[str, str]]:
    """A table of the scene; of one that holds tables by name (bodies, contacts, ...), each of these."""
    if isinstance(value, dict) and value and all(isinstance(item, dict) for item in value.values()):
        return [row for key, item in value.items() for row in _rows(f"{name}.{key}", item)]
    text = as_written(value)
    return [(name, text)] if text else []


def as_written(value: Any) -> str:
    """As a scene file says it; what is empty is left out.

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


def _cost(results: Results) -> Html:
    content = results.content
    seconds, counters = content.get("seconds") or {}, content.get("counters") or {}
    choice = content.get("choice") or {}
    said = []
    if content.get("method"):
        because = f" ({choice['because']})" if choice.get("because") else ""
        said.append(f"<p>Method {escape(str(content['method']))}{escape(because)}.</p>")
    profile = content.get("profile") or ()  # results of before it was there have seconds alone
    phases = [(name, f"{seconds[name]:.2f}") for name in (*PHASES, "total") if seconds.get(name) is not None]
    names = ("factorisations", "volume_solves", "linear_iterations", "error_solves", "forms", "searches")
    counted = [(name.replace("_", " "), str(counters[name])) for name in names if counters.get(name)]
    steps = [s for s in results.reported if s.get("iterations") is not None]
    if steps:
        counted.insert(0, ("iterations of all steps", str(sum(s["iterations"] for s in steps))))
    reference = (content.get("linear_reference") or {}).get("seconds")
    if reference:
        said.append(f"<p>One linear solve of the same mesh takes {reference:.2f} s.</p>")
    spent = table(HEAD, profile_rows(profile)) if profile else table(("phase", "seconds"), phases)
    said.append(f'<div class="panels">{spent}{table(("work", "count"), counted)}</div>' if phases or counted else "")
    return "".join(said)


def _audit(results: Results) -> Html:
    verdict, audit = results.content.get("verdict") or {}, results.content.get("audit") or {}
    limits = verdict.get("limits") or {}
    rows = [
        (name.replace("_", " "), f"{value + 0.0:.1e}", f"{limits[name]:.0e}" if name in limits else "–")
        for name, value in audit.items()
        if value is not None
    ]
    if not rows:
        return ""
    passed = verdict.get("passed") or ()
    said = f"The audit finds that {'; '.join(passed)}." if passed else "Every check of the audit is within its limit."
    kind = "note bad" if passed else "note good"
    return (
        f'<p class="{kind}">{escape(said)}</p><p>Recomputed from the written files by code that shares nothing with '
        f"the methods; the worst step, relative.</p>{table(('defect', 'found', 'limit'), rows)}"
    )
