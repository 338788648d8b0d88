"""`stickslip verify accuracy`: lay stated errors beside true ones, tell their shares, and write a page.

The page and the picture of the accuracy suite: shares by part, kind and problem, and the worst cases.
"""

from __future__ import annotations

import json
import shlex
import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from stickslip import VERSION
from stickslip.geometry.errors import SceneError, nearest, require
from stickslip.workflows.lab.verification.accuracy.judge import (
    BELOW,
    COUNTS,
    HIGH,
    INSIDE,
    ITERATION,
    LOW,
    MESH,
    PARTS,
    SILENT,
    TIME,
    TOO_LARGE,
    TOO_SMALL,
    TOTAL,
    Case,
    Endless,
    Share,
    counted,
    kind,
)
from stickslip.workflows.lab.verification.accuracy.problems import MESHES, PROBLEMS
from stickslip.workflows.lab.verification.accuracy.suite import LOOSE, MORE, Study, studies
from stickslip.workflows.lab.verification.hard.tables import overrides
from stickslip.workflows.lab.verification.suite_folder import made, writing
from stickslip.workflows.scene_file.read import READY, read, to_dict


def accuracy(names: Sequence[str] = (), jobs: int = 1, folder: Path | None = None) -> bool:
    """Run the suite; one line for each problem, then a sentence with the shares.

    Args:
        names: problems; none: all.
        jobs: processes, of one core each.
        folder: where accuracy.md, accuracy.png and accuracy.jsonl are written; None: nowhere.

    Returns:
        Whether all problems were solved, and the shares of order 1 are what is asked for.

    Raises:
        SceneError: an option is wrong.
        MachineError: the folder cannot be written.
    """
    for name in names:
        if name not in PROBLEMS:
            raise SceneError(f"--scenes {name}: no such problem; {nearest(name, PROBLEMS)}")
    require(jobs >= 1, "--jobs", jobs, "must be at least 1")
    if folder is not None:
        made(folder)
    found, began = list[Study](), clock.monotonic()
    for study in studies(tuple(names) or tuple(PROBLEMS), jobs):
        found.append(study)
        print(line(study), flush=True)
    print(f"{sentence(found)}; {clock.monotonic() - began:.0f} s")
    if folder is not None:
        words = ["stickslip", "verify", "accuracy", *(["--scenes", ",".join(names)] if names else [])]
        with writing(folder):
            write_page(folder / "accuracy.md", found, shlex.join([*words, "-o", folder.resolve().name]))
            (folder / "accuracy.jsonl").write_text("".join(map(_text, found)), encoding="utf-8")
    return passed(found)


def _text(study: Study) -> str:
    """A line of JSON for each case."""
    rows = [asdict(case) for case in study.cases] + [{"endless": asdict(each)} for each in study.endless]
    return "".join(json.dumps(row, ensure_ascii=False) + "\n" for row in rows)


ASKED = (MESH, TIME, TOTAL)  # parts, of order 1, whose shares are asked for
WORST = 25  # cases that the page lists
COLOURS = {
    "force": "#1f77b4", "moment": "#17becf", "area": "#2ca02c", "pressure": "#d62728", "length": "#9467bd",
    "dissipation": "#ff7f0e", "energy": "#7f7f7f", "rotation": "#e377c2",
}  # fmt: skip


def asked(studies: Sequence[Study]) -> list[Case]:
    """The cases of order 1 whose shares are asked for."""
    return [case for study in studies for case in study.cases if case.order == 1 and case.part in ASKED]


def passed(studies: Sequence[Study]) -> bool:
    """Whether all problems were solved, and the shares of order 1 are what is asked for."""
    return enough(studies) and not any(study.failure for study in studies)


def enough(studies: Sequence[Study]) -> bool:
    """Whether the shares of order 1 are what is asked for, and something is stated in each problem and part."""
    each = [[case for case in asked([study]) if case.part == part] for study in studies for part in ASKED]
    return Share.of(asked(studies)).enough and all(Share.of(cases).said for cases in each)


def sentence(studies: Sequence[Study]) -> str:
    """The shares of order 1, all problems and parts together."""
    return f"{len(studies)} problems, order 1: {words(Share.of(asked(studies)))}"


def words(share: Share) -> str:
    """A share in words."""
    if not share.counted:
        return "no error is large enough to count" if share.said else f"none of {share.silent} errors is stated"
    return (
        f"{share.counted} errors count; stated / true is within [{LOW:g}, {HIGH:g}] in {100 * share.inside:.1f} %,"
        f" below {TOO_SMALL:g} in {100 * share.below:.1f} %, above {TOO_LARGE:g} in {share.above};"
        f" median {share.median:.2f}"
    )


def line(study: Study) -> str:
    """What is printed of a problem."""
    said = study.failure or words(Share.of(asked([study])))
    return f"{study.problem}: {said}; {study.seconds:.0f} s"


def again(case: Case) -> str:
    """The command that solves the case once more."""
    if not (READY / f"{case.problem}.toml").exists() or case.part == ITERATION:
        return shlex.join(["stickslip", "verify", "accuracy", "--scenes", case.problem])
    changed = to_dict(PROBLEMS[case.problem].meshed(1 if case.order == 1 else 2, case.mesh))
    changes = overrides(to_dict(read(case.problem)), changed)
    return shlex.join(["stickslip", "run", case.problem, *(f"--set={word}" for word in changes)])


def write_page(page: Path, studies: Sequence[Study], command: str) -> None:
    """Write the page, and its picture beside it; the picture has the page's name and ends in .png."""
    picture = page.with_suffix(".png")
    page.write_text("\n".join(_lines(studies, command, picture.name)) + "\n", encoding="utf-8")
    draw(picture, [case for study in studies for case in study.cases])


def _unknown(studies: Sequence[Study]) -> str:
    """How many errors do not count because the truth is not known well enough, and what is found with them."""
    found, every = asked(studies), [replace(case, known=True) for case in asked(studies)]
    count = len(counted(every)) - len(counted(found))
    return (
        f"{count} errors of order 1 do not count, because order 2 on the finest of the three meshes is farther from the"
        f" truth than they are; with them, {words(Share.of(every))}."
    )


def _lines(studies: Sequence[Study], command: str, picture: str) -> Iterator[str]:
    cases = [case for study in studies for case in study.cases]
    yield "# Stated errors beside true ones"
    yield ""
    yield f"Made by `{command}`, version {VERSION}; do not edit."
    yield ""
    yield f"{sentence(studies)}." + ("" if enough(studies) else " That is not what is asked for.")
    yield ""
    yield (
        f"Asked for are {100 * INSIDE:.0f} % within [{LOW:g}, {HIGH:g}], at most {100 * BELOW:.0f} % below"
        f" {TOO_SMALL:g}, none above {TOO_LARGE:g}, and at most {100 * SILENT:.0f} % of the true errors that are large"
        " enough to count not stated, in no problem and part all of them. Every number of every step of the problems"
        f" is judged, vectors by component, each on three meshes (cells {', '.join(f'{mesh:g}' for mesh in MESHES)}"
        " times as large), in both orders. A number that has several names, as a force and its reaction, counts once."
    )
    yield ""
    yield "| part | true error: the distance to |"
    yield "|---|---|"
    finer = sorted(round(1 / problem.fine) for problem in PROBLEMS.values())
    yield (
        f"| {MESH} (with geometry) | order 2 on a mesh {finer[0]} to {finer[-1]} times finer than the finest, same"
        " steps; closed forms |"
    )
    yield f"| {TIME} | {MORE} times the steps on the same mesh |"
    yield f"| {ITERATION} (with linear_solver) | the run, from `surface-uzawa`, matrix-free, at tolerance {LOOSE:g} |"
    yield f"| {TOTAL} | order 2 on the finer mesh in {MORE} times the steps, where that is affordable |"
    yield ""
    yield (
        f"An error counts if it is above {COUNTS:g} of the scale of its kind: forces, of the largest normal force;"
        " moments, of that times the size of the bodies; areas, of the area of the side; pressures and stresses, of the"
        " largest pressure; lengths, of the largest displacement of the contact; energies, of the stored energy;"
        " dissipations, of themselves where they are above a thousandth of it. What the iteration leaves is stated as a"
        " bound. Errors of the time steps below half a per cent come from single nodes that slip a step earlier or"
        f" later, which shorter histories do not show. {_unknown(studies)}"
    )
    yield ""
    yield f"![Stated over true errors, by the size of the true error]({picture})"
    yield ""
    yield "## By part"
    yield ""
    yield from table("part, order", cases, lambda case: f"{case.part}, order {case.order}")
    yield ""
    yield (
        "Of order 2 in 3D, areas, largest pressures and penetrations are stated to be off by 1.5 times what it adds to"
        " order 1."
    )
    yield "Errors of the stress at probes are not judged."
    yield ""
    yield "## By kind of quantity, order 1"
    yield ""
    first = [case for case in cases if case.order == 1]
    yield from table("part, kind", first, lambda case: f"{case.part}, {kind(case.name)}")
    yield ""
    yield "## By problem, order 1"
    yield ""
    yield from table("problem", asked(studies), lambda case: case.problem)
    yield ""
    yield "## By problem, order 2: the mesh"
    yield ""
    second = [case for case in cases if case.order == 2 and case.part == MESH]
    yield from table("problem", second, lambda case: case.problem)
    yield ""
    yield "## Sizes"
    yield ""
    yield "| problem | unknowns of order 1 | of the truth | seconds |"
    yield "|---|--:|--:|--:|"
    for study in studies:
        *own, best = study.unknowns or (0,)
        yield f"| {study.problem} | {', '.join(map(str, own))} | {best} | {study.seconds:.0f} |"
    yield ""
    yield "## Largest pressures without a limit"
    yield ""
    yield from _endless([each for study in studies for each in study.endless])
    yield ""
    yield "## The worst cases of order 1"
    yield ""
    worst = sorted(counted(asked(studies)), key=lambda case: -abs(np.log(max(case.effectivity, 1e-9) / 1.4)))[:WORST]
    for case in worst:
        yield (
            f"- {case.problem}, mesh {case.mesh:g}, t = {case.time:g}: {case.part} error of {case.name}: stated / true"
            f" {case.effectivity:.2f}, true error {100 * case.size:.2g} % of its scale"
        )
        yield f"  `{again(case)}`"


def table(heading: str, cases: Sequence[Case], key: Callable[[Case], str]) -> Iterator[str]:
    """Shares by a key, in Markdown, in the order in which the keys come up."""
    yield (
        f"| {heading} | counted | within [{LOW:g}, {HIGH:g}] | below {TOO_SMALL:g} | above {TOO_LARGE:g} | median |"
        " largest true error | not stated |"
    )
    yield "|---|" + "--:|" * 7
    for name in dict.fromkeys(map(key, cases)):
        own = [case for case in cases if key(case) == name]
        share = Share.of(own)
        largest = max((case.size for case in counted(own)), default=0.0)
        figures = ["-"] * 5
        if share.counted:
            figures = [
                f"{100 * share.inside:.1f} %",
                f"{100 * share.below:.1f} %",
                str(share.above),
                f"{share.median:.2f}",
                f"{100 * largest:.2g} %",
            ]
        yield f"| {name} | {share.counted} | {' | '.join(figures)} | {share.silent} |"


def _endless(found: Sequence[Endless]) -> Iterator[str]:
    """Found, missed and false alarms, each with its steps and meshes."""
    groups = {
        "found": [each for each in found if each.said and each.true],
        "missed": [each for each in found if not each.said],
        "false alarms": [each for each in found if not each.true],
    }
    yield "At the ends of a punch and at corners the largest pressure grows with every finer mesh; no error is stated."
    yield ""
    for name, members in groups.items():
        places = {f"{each.problem}, {each.name}": 0 for each in members}
        for each in members:
            places[f"{each.problem}, {each.name}"] += 1
        said = "; ".join(f"{place} ({count})" for place, count in places.items())
        yield f"- {name}: {len(members)}{': ' if said else ''}{said}"


def draw(picture: Path, cases: Sequence[Case]) -> None:
    """Stated over true against the true error, a panel for each part, coloured by kind; order 2 is hollow."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    figure = Figure(figsize=(4.2 * len(PARTS), 4.6), layout="constrained")
    panels = figure.subplots(1, len(PARTS), sharey=True, squeeze=False)[0]
    shown = counted(cases)
    for axes, part in zip(panels, PARTS, strict=True):
        axes.axhspan(LOW, HIGH, color="#e6eee0", zorder=0)
        axes.axhline(1.0, color="#888888", linewidth=0.6)
        for order in (1, 2):
            own = [case for case in shown if case.part == part and case.order == order]
            colours = [COLOURS[kind(case.name)] for case in own]
            axes.scatter(
                [case.size for case in own],
                [np.clip(case.effectivity, 1e-2, 1e2) for case in own],
                s=7,
                facecolors=colours if order == 1 else "none",
                edgecolors=colours,
                linewidths=0.5,
                alpha=0.6,
            )
        axes.set(title=part, xscale="log", yscale="log", xlabel="true error over its scale")
        axes.set(xlim=(COUNTS, max([1.0, *(case.size for case in shown)])), ylim=(1e-2, 1e2))
    panels[0].set_ylabel("stated over true")
    handles = [
        Line2D([], [], linestyle="", marker="o", markersize=4, color=colour, label=name)
        for name, colour in COLOURS.items()
    ]
    handles.append(
        Line2D([], [], linestyle="", marker="o", markersize=4, color="black", fillstyle="none", label="order 2")
    )
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), fontsize=8, frameon=False)
    FigureCanvasAgg(figure).print_figure(picture, dpi=110)
