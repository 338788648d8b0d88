"""`stickslip verify accuracy`: lay stated errors beside true ones, tell their shares, and write a page.

The page and the picture of the accuracy suite: shares by part, kind and problem, and the worst cases.
"""

from __future__ import annotations

import json
import shlex
import time as clock
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from stickslip import VERSION, SceneError, read
from stickslip.geometry.errors import nearest, require
from stickslip.geometry.keys import adapter
from stickslip.workflows.formats.files import disk_errors, make_folder
from stickslip.workflows.formats.templates import render
from stickslip.workflows.lab.verification.accuracy.drawn import DOUBT, FINER, MORE, drawn, of_file
from stickslip.workflows.lab.verification.accuracy.judge import (
    COUNTS,
    HIGH,
    ITERATION,
    LOW,
    MANY,
    MESH,
    OF_DRAWN,
    OF_PROBLEMS,
    PARTS,
    TIME,
    TOO_LARGE,
    TOO_SMALL,
    TOTAL,
    WORST,
    Case,
    Endless,
    Share,
    counted,
    kind,
)
from stickslip.workflows.lab.verification.accuracy.problems import MESHES, PROBLEMS
from stickslip.workflows.lab.verification.accuracy.suite import LOOSE, Study, drawn_studies, studied, studies
from stickslip.workflows.lab.verification.hard.tables import overrides
from stickslip.workflows.scene_file.read import READY, to_dict

NUMBER = 30  # of drawn scenes
LINES, OF_SEED = "accuracy.jsonl", "seed_{}.jsonl"  # studies of the problems, and of the scenes of a seed


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
    began = clock.monotonic()
    found = _told(lambda folder: studies(studied, tuple(names) or tuple(PROBLEMS), jobs), jobs, folder)
    print(f"{sentence(found)}; {clock.monotonic() - began:.0f} s")
    _keep(folder, LINES, found)
    return passed(found)


def random_accuracy(
    number: int = NUMBER,
    seed: int = 0,
    jobs: int = 1,
    folder: Path | None = None,
    budget: float | None = None,
    scenes: Sequence[Path] = (),
) -> bool:
    """Judge the stated errors of scenes drawn at random; one line for each, then the tables.

    Args:
        number: of scenes.
        seed: of what is drawn.
        jobs: processes, of one core each.
        budget: seconds that errors may take, in those of all else of a run; None: as is usual.
        scenes: files that are judged in place of what is drawn, in a folder of their own.
        folder: where the scene files, accuracy.md, accuracy.png and seed_SEED.jsonl are written; None: nowhere.

    Returns:
        Whether the shares are what is asked for.

    Raises:
        SceneError: an option is wrong.
        MachineError: the folder cannot be written.
    """
    require(number >= 1, "--number", number, "must be at least 1")
    require(seed >= 0, "--seed", seed, "must not be negative")
    require(budget is None or budget > 0, "--budget", budget, "must be positive")
    given, name = [of_file(path) for path in scenes], "scenes" if scenes else f"seed_{seed}"
    number, began = len(given) or number, clock.monotonic()
    found = _told(lambda folder: drawn_studies(given or drawn(seed), number, jobs, folder / name, budget), jobs, folder)
    print(f"\n{drawn_tables(found)}\n\n{clock.monotonic() - began:.0f} s")
    if not given:
        _keep(folder, OF_SEED.format(seed), found)
    return well_drawn(found)


def _told(run: Callable[[Path], Iterator[Study]], jobs: int, folder: Path | None) -> list[Study]:
    """Studies that a run in a folder gives, or else in one that is removed, each told as soon as it is there."""
    require(jobs >= 1, "--jobs", jobs, "must be at least 1")
    if folder is not None:
        make_folder(folder)
    found = list[Study]()
    with TemporaryDirectory() as aside:
        for study in run(folder or Path(aside)):
            found.append(study)
            print(line(study), flush=True)
    return found


def _keep(folder: Path | None, name: str, found: Sequence[Study]) -> None:
    """Write the studies of a run, and the page of all runs whose studies lie there."""
    if folder is None:
        return
    with disk_errors(folder):
        text = "".join(json.dumps(asdict(study), ensure_ascii=False) + "\n" for study in found)
        (folder / name).write_text(text, encoding="utf-8")
        seeds = {int(path.stem.partition("_")[2]): _kept(path) for path in folder.glob(OF_SEED.format("*"))}
        write_page(folder / "accuracy.md", _kept(folder / LINES), dict(sorted(seeds.items())))


def _kept(path: Path) -> list[Study]:
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [adapter(Study).validate_python(json.loads(row)) for row in lines]


ASKED = (MESH, TIME, TOTAL)  # parts, of order 1, whose shares are asked for
SHOWN = 25  # of the worst cases
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
    return Share.of(asked(studies)).meets(OF_PROBLEMS) and all(Share.of(cases).said for cases in each)


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
    """Line that is printed of a problem, or of a drawn scene."""
    judged = asked([study]) or study.cases
    order = "".join(f", order {order}" for order in {case.order for case in judged})
    return f"{study.problem}{order}: {study.failure or words(Share.of(judged))}; {study.seconds:.0f} s"


def well_drawn(studies: Sequence[Study]) -> bool:
    """Whether the shares of drawn scenes are what is asked for, and few true errors are not known."""
    cases, worst = [case for study in studies for case in study.cases], worst_scene(studies)
    shares = {order: Share.of(case for case in cases if case.order == order) for order in OF_DRAWN}
    bearable = worst is None or Share.of(worst.cases).inside >= WORST
    return bearable and unknown(cases) <= 1 / 10 and all(shares[k].meets(asked) for k, asked in OF_DRAWN.items())


def unknown(cases: Iterable[Case]) -> float:
    """Share of the large enough true errors that are not known."""
    known = [case.known for case in cases if case.size > COUNTS]
    return 1 - sum(known) / max(len(known), 1)


def worst_scene(studies: Sequence[Study]) -> Study | None:
    """The scene of many numbers that has the least share of the right size."""
    many = [study for study in studies if Share.of(study.cases).counted >= MANY]
    return min(many, key=lambda study: Share.of(study.cases).inside, default=None)


def drawn_tables(studies: Sequence[Study]) -> str:
    """What became of drawn scenes, in Markdown."""
    solved = [study for study in studies if not study.failure]
    cases = sorted((case for study in solved for case in study.cases), key=lambda case: (case.order, kind(case.name)))
    worst, prices = worst_scene(solved), {study.problem: study.price for study in solved}
    again = [f"{study.problem} ({study.failure})" for study in studies if study.failure]
    told: list[Any] = [
        f"{len(solved)} scenes; drawn again: {'; '.join(again) or 'none'}. Of the true errors that are large enough,"
        f" {100 * unknown(cases):.1f} % are not known and do not count. Stated errors cost"
        f" {np.median([*prices.values()] or np.nan):.2g} times the rest of a run in the median.",
        worst and f"The worst scene of {MANY} numbers or more is {worst.problem}: {words(Share.of(worst.cases))}.",
        table("order", cases, lambda case: f"order {case.order}"),
        table("kind", cases, lambda case: f"order {case.order}, {kind(case.name)}"),
        table(
            "scene (price)",
            [case for study in solved for case in study.cases],
            lambda case: f"{case.problem}, order {case.order} ({prices[case.problem]:.1f})",
        ),
        f"Numbers without a limit:\n\n{_endless([each for study in solved for each in study.endless])}",
    ]
    return "\n\n".join(filter(None, told))


def again(case: Case) -> str:
    """The command that solves the case once more."""
    if not (READY / f"{case.problem}.toml").exists() or case.part == ITERATION:
        return shlex.join(["stickslip", "verify", "accuracy", "--scenes", case.problem])
    changed = to_dict(PROBLEMS[case.problem].meshed(1 if case.order == 1 else 2, case.mesh))
    changes = overrides(to_dict(read(case.problem)), changed)
    return shlex.join(["stickslip", "run", case.problem, *(f"--set={word}" for word in changes)])


def write_page(page: Path, studies: Sequence[Study], seeds: Mapping[int, Sequence[Study]]) -> None:
    """Write the page, and its picture beside it; the picture has the page's name and ends in .png.

    Args:
        studies: of the problems.
        seeds: of drawn scenes, by seed.
    """
    picture, cases = page.with_suffix(".png"), [case for study in studies for case in study.cases]
    first = [case for case in cases if case.order == 1]
    second = [case for case in cases if case.order == 2 and case.part == MESH]
    worst = sorted(counted(asked(studies)), key=lambda case: -abs(np.log(max(case.effectivity, 1e-9) / 1.4)))[:SHOWN]
    text = render(
        "lab/verification/templates/accuracy.md",
        version=VERSION,
        sentence=f"{sentence(studies)}." + ("" if enough(studies) else " That is not what is asked for."),
        **{name: f"{100 * share:.0f}" for name, share in OF_PROBLEMS._asdict().items() if share},
        within=f"[{LOW:g}, {HIGH:g}]",
        too_small=f"{TOO_SMALL:g}",
        too_large=f"{TOO_LARGE:g}",
        meshes=", ".join(f"{mesh:g}" for mesh in MESHES),
        **{"mesh": MESH, "time": TIME, "iteration": ITERATION, "total": TOTAL},
        finer=sorted(round(1 / problem.fine) for problem in PROBLEMS.values()),
        more=MORE,
        finest=f"{max(FINER.values()):g}",
        doubt=f"{DOUBT:g}",
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
        by_seed={seed: Share.of(case for study in found for case in study.cases) for seed, found in seeds.items()},
        drawn=drawn_tables([_of_seed(study, seed) for seed, found in seeds.items() for study in found]),
    )
    page.write_text(text, encoding="utf-8")
    draw(picture, cases)


def _of_seed(study: Study, seed: int) -> Study:
    """The study of a drawn scene whose name tells the seed."""
    name = f"{seed}/{study.problem}"
    return replace(
        study,
        problem=name,
        cases=tuple(replace(case, problem=name) for case in study.cases),
        endless=tuple(replace(each, problem=name) for each in study.endless),
    )


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
