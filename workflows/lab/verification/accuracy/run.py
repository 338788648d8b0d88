"""`stickslip verify accuracy`: lay stated errors beside true ones, tell their shares, and write a page.

The page and the picture of the accuracy suite: shares by part, kind and problem, and the worst cases.
"""

from __future__ import annotations

import json
import shlex
import time as clock
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from stickslip import VERSION, SceneError, read
from stickslip.geometry.errors import nearest, require
from stickslip.workflows.formats.files import disk_errors, make_folder
from stickslip.workflows.formats.templates import render
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
from stickslip.workflows.scene_file.read import READY, to_dict


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
        make_folder(folder)
    found, began = list[Study](), clock.monotonic()
    for study in studies(tuple(names) or tuple(PROBLEMS), jobs):
        found.append(study)
        print(line(study), flush=True)
    print(f"{sentence(found)}; {clock.monotonic() - began:.0f} s")
    if folder is not None:
        words = ["stickslip", "verify", "accuracy", *(["--scenes", ",".join(names)] if names else [])]
        with disk_errors(folder):
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
    """Line that is printed of a problem."""
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
    picture, cases = page.with_suffix(".png"), [case for study in studies for case in study.cases]
    first = [case for case in cases if case.order == 1]
    second = [case for case in cases if case.order == 2 and case.part == MESH]
    worst = sorted(counted(asked(studies)), key=lambda case: -abs(np.log(max(case.effectivity, 1e-9) / 1.4)))[:WORST]
    text = render(
        "lab/verification/templates/accuracy.md",
        command=command,
        version=VERSION,
        sentence=f"{sentence(studies)}." + ("" if enough(studies) else " That is not what is asked for."),
        **{name: f"{100 * share:.0f}" for name, share in (("inside", INSIDE), ("below", BELOW), ("silent", SILENT))},
        within=f"[{LOW:g}, {HIGH:g}]",
        too_small=f"{TOO_SMALL:g}",
        too_large=f"{TOO_LARGE:g}",
        meshes=", ".join(f"{mesh:g}" for mesh in MESHES),
        **{"mesh": MESH, "time": TIME, "iteration": ITERATION, "total": TOTAL},
        finer=sorted(round(1 / problem.fine) for problem in PROBLEMS.values()),
        more=MORE,
        loose=f"{LOOSE:g}",
        counts=f"{COUNTS:g}",
        unknown=_unknown(studies),
        picture=picture.name,
        by_part=table("part, order", cases, lambda case: f"{case.part}, order {case.order}"),
        by_kind=table("part, kind", first, lambda case: f"{case.part}, {kind(case.name)}"),
        by_problem=table("problem", asked(studies), lambda case: case.problem),
        of_order_2=table("problem", second, lambda case: case.problem),
        studies=studies,
        endless=_endless([each for study in studies for each in study.endless]),
        worst="\n".join(map(_worst, worst)),
    )
    page.write_text(text, encoding="utf-8")
    draw(picture, cases)


def _worst(case: Case) -> str:
    """A case, and the command that solves it once more."""
    return (
        f"- {case.problem}, mesh {case.mesh:g}, t = {case.time:g}: {case.part} error of {case.name}: stated / true"
        f" {case.effectivity:.2f}, true error {100 * case.size:.2g} % of its scale\n  `{again(case)}`"
    )


def _unknown(studies: Sequence[Study]) -> str:
    """Count errors for which the truth is not known well enough, and tell what is found with them."""
    found, every = asked(studies), [replace(case, known=True) for case in asked(studies)]
    count = len(counted(every)) - len(counted(found))
    return (
        f"{count} errors of order 1 do not count, because order 2 on the finest of the three meshes is farther from the"
        f" truth than they are; with them, {words(Share.of(every))}."
    )


def table(heading: str, cases: Sequence[Case], key: Callable[[Case], str]) -> str:
    """Shares by a key, in Markdown, in the order in which the keys come up."""
    head = f"| {heading} | counted | within [{LOW:g}, {HIGH:g}] | below {TOO_SMALL:g} | above {TOO_LARGE:g} | median |"
    lines = [f"{head} largest true error | not stated |", "|---|" + "--:|" * 7]
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
        lines.append(f"| {name} | {share.counted} | {' | '.join(figures)} | {share.silent} |")
    return "\n".join(lines)


def _endless(found: Sequence[Endless]) -> str:
    """Found, missed and false alarms, each with its steps and meshes."""
    groups = {
        "found": [each for each in found if each.said and each.true],
        "missed": [each for each in found if not each.said],
        "false alarms": [each for each in found if not each.true],
    }
    lines = []
    for name, members in groups.items():
        places = Counter(f"{each.problem}, {each.name}" for each in members)
        said = "; ".join(f"{place} ({count})" for place, count in places.items())
        lines.append(f"- {name}: {len(members)}{': ' if said else ''}{said}")
    return "\n".join(lines)


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
