"""`stickslip verify hard`: run the hard suite, tell what was not solved, and write its page.

The page and the picture of the hard suite: counts by scene and by kind, and every variation that was not solved.
"""

from __future__ import annotations

import json
import shlex
import sys
import time as clock
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from statistics import median

import numpy as np

from stickslip import VERSION, MachineError, SceneError
from stickslip.geometry.errors import nearest, require
from stickslip.workflows.formats.files import disk_errors, make_folder
from stickslip.workflows.formats.templates import render
from stickslip.workflows.lab.verification.hard.judge import AGREES, DIFFERS, Outcome, Verdict
from stickslip.workflows.lab.verification.hard.suite import NAMES, Row, judged_again, results
from stickslip.workflows.lab.verification.hard.variations import FIXED

NUMBER = 2000
LINES = "hard.jsonl"
PART = "hard.part.jsonl"  # what run it is of, and its rows so far


def hard(
    scenes: Sequence[str] = (),
    number: int = NUMBER,
    seed: int = 0,
    jobs: int = 1,
    folder: Path | None = None,
    again: bool = False,
    resume: bool = False,
) -> bool:
    """Run the suite; one line for each variation that failed or is wrong, then a sentence with all counts.

    Args:
        scenes: ready scenes; none: all.
        number: of variations.
        seed: of the order and the random ones.
        jobs: processes, of one core each.
        folder: where hard.md, hard.png and hard.jsonl are written; None: nowhere.
        again: take the rows of hard.jsonl there, and judge only those again that were not solved.
        resume: go on behind the rows that an earlier run has left there when it was ended.

    Returns:
        Whether no variation is wrong or has failed.

    Raises:
        SceneError: an option is wrong.
        MachineError: the folder cannot be written.
    """
    for name in scenes:
        if name not in NAMES:
            raise SceneError(f"--scenes {name}: no such ready scene; {nearest(name, NAMES)}")
    require(number >= 1, "--number", number, "must be at least 1")
    require(seed >= 0, "--seed", seed, "must not be negative")
    require(jobs >= 1, "--jobs", jobs, "must be at least 1")
    if folder is not None:
        make_folder(folder)
    for option, asked in (("--again", again), ("--resume", resume)):
        require(folder is not None or not asked, option, "", "needs the folder of an earlier run, with -o")
    require(not (again and resume), "--resume", "", "goes without --again")
    if folder is not None and (folder / PART).exists() and not (again or resume):
        raise SceneError(f"{folder / PART}: of a run that was ended; go on with --resume, or remove it")
    earlier = _rows(folder / LINES, _stored_lines(folder / LINES)) if folder is not None and again else []
    run = json.dumps({"version": VERSION, "scenes": list(scenes), "seed": seed})
    rows = _begun(folder / PART, run)[:number] if folder is not None and resume else []
    began = clock.monotonic()
    fresh = results(tuple(scenes) or NAMES, number, seed, jobs, known=rows)
    keep = _keeper(folder / PART, run, rows) if folder is not None and not again else None
    for row in judged_again(earlier, seed, jobs) if again else fresh:
        rows.append(row)
        if keep is not None:
            keep(row)
        if row.verdict.outcome in BAD:
            print(
                f"{row.scene}, {row.name}: {row.verdict.outcome.value}: {row.verdict.reason}\n  {repeating(row)}",
                flush=True,
            )
        elif sys.stdout.isatty():
            print(f"{len(rows)} of {number}", end="\r", flush=True)
    print(f"{sentence(rows)}; {clock.monotonic() - began:.0f} s")
    if folder is not None:
        words = ["stickslip", "verify", "hard", "--number", str(len(rows)), "--seed", str(seed)]
        words += ["--scenes", ",".join(scenes)] if scenes else []
        words += ["-o", folder.resolve().name]
        command = shlex.join(words) + (f" && {shlex.join([*words, '--again'])}" if again else "")
        with disk_errors(folder):
            write_page(folder / "hard.md", rows, command)
            (folder / LINES).write_text("".join(map(_line, rows)), encoding="utf-8")
            if not again:
                (folder / PART).unlink()
    return not any(row.verdict.outcome in BAD for row in rows)


def _keeper(path: Path, run: str, rows: Sequence[Row]) -> Callable[[Row], None]:
    """Write the rows so far; the function that is returned appends one more."""
    with disk_errors(path.parent):
        path.write_text("".join([f"{run}\n", *map(_line, rows)]), encoding="utf-8")

    def keep(row: Row) -> None:
        with disk_errors(path.parent), path.open("a", encoding="utf-8") as file:
            file.write(_line(row))

    return keep


def _begun(path: Path, run: str) -> list[Row]:
    """The rows that a run has left when it was ended.

    Raises:
        MachineError: there are none.
        SceneError: they are of another run.
    """
    first, *lines = _stored_lines(path) or [""]
    if first != run:
        raise SceneError(f"--resume: {path} is of another run: {first or 'nothing'}")
    return _rows(path, lines)


def _stored_lines(path: Path) -> list[str]:
    """Whole lines of a file.

    Raises:
        MachineError: it cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8").split("\n")[:-1]
    except (OSError, ValueError) as error:
        raise MachineError(f"{path}: is not what `verify hard` has written: {error}") from None


def _rows(path: Path, lines: Sequence[str]) -> list[Row]:
    """The rows of an earlier run.

    Raises:
        MachineError: they are none.
    """
    try:
        found = [json.loads(line) for line in lines]
        return [
            Row(
                **plain
                | {
                    "overrides": tuple(plain["overrides"]),
                    "verdict": Verdict(**plain["verdict"] | {"outcome": Outcome(plain["verdict"]["outcome"])}),
                }
            )
            for plain in found
        ]
    except (ValueError, TypeError, KeyError) as error:
        raise MachineError(f"{path}: is not what `verify hard` has written: {error}") from None


def _line(row: Row) -> str:
    plain = asdict(row)
    plain["verdict"]["outcome"] = row.verdict.outcome.value
    return json.dumps(plain, ensure_ascii=False) + "\n"


COLOURS = {  # in the order of the page's columns
    Outcome.SOLVED: "#bcd9c2",
    Outcome.BRANCH: "#5aa469",
    Outcome.PROVED: "#9ecae1",
    Outcome.UNDECIDED: "#6a8fb5",
    Outcome.REFUSED: "#d9d9d9",
    Outcome.FAILED: "#f4a742",
    Outcome.DOUBTFUL: "#e6d94c",
    Outcome.WRONG: "#c8372d",
}
BAD = (Outcome.WRONG, Outcome.FAILED, Outcome.DOUBTFUL)
SHOWN = 160  # characters of a reason


def write_page(page: Path, rows: Sequence[Row], command: str) -> None:
    """Write the page, and its picture beside it; the picture has the page's name and ends in .png."""
    picture = page.with_suffix(".png")
    groups = {
        outcome.value.capitalize(): "\n".join(_entry(row) for row in rows if row.verdict.outcome is outcome)
        for outcome in (*BAD, Outcome.UNDECIDED, Outcome.BRANCH, Outcome.REFUSED)
    }
    text = render(
        "lab/verification/templates/hard.md",
        command=command,
        version=VERSION,
        sentence=sentence(rows),
        twins=twins(rows),
        picture=picture.name,
        by_scene="\n".join(table("scene", rows, lambda row: row.scene)),
        by_kind="\n".join(table("kind", rows, lambda row: row.kind)),
        groups={name: entries for name, entries in groups.items() if entries},
    )
    page.write_text(text, encoding="utf-8")
    draw(picture, rows)


def sentence(rows: Sequence[Row]) -> str:
    """Count the variations by their endings."""
    counts = Counter(row.verdict.outcome for row in rows)
    unanswered = [row for row in rows if row.verdict.outcome in (Outcome.FAILED, Outcome.DOUBTFUL)]
    held = sum(row.verdict.held for row in unanswered)
    words = [f"{counts[outcome]} {outcome.value}" for outcome in COLOURS if counts[outcome]]
    failed = f" (of these with held bodies: {held})" if unanswered else ""
    return f"{len(rows)} variations: {'; '.join(words)}{failed}"


def table(heading: str, rows: Sequence[Row], key: Callable[[Row], str]) -> Iterator[str]:
    """Counts of outcomes by a key, in Markdown."""
    yield f"| {heading} | variations | {' | '.join(o.value for o in COLOURS)} | second | median seconds |"
    yield "|---|" + "--:|" * (len(COLOURS) + 3)
    for name in dict.fromkeys(key(row) for row in sorted(rows, key=key)):
        own = [row for row in rows if key(row) == name]
        counts = Counter(row.verdict.outcome for row in own)
        answers = [row for row in own if row.verdict.outcome in (Outcome.SOLVED, Outcome.BRANCH)]
        second = f"{sum(confirmed(row) for row in answers)} of {len(answers)}"
        seconds = median(row.verdict.seconds for row in own)
        yield f"| {name} | {len(own)} | {' | '.join(str(counts[o]) for o in COLOURS)} | {second} | {seconds:.2f} |"


def confirmed(row: Row) -> bool:
    """Whether a second method had an opinion on the answer."""
    return bool(row.verdict.second) and "none" not in row.verdict.second and "no use" not in row.verdict.second


def twins(rows: Sequence[Row]) -> str:
    """Count the answers that were compared with that of a twin, and the other twins."""
    doubles = [row.verdict for row in rows if row.name in FIXED and FIXED[row.name].twin]
    answers = [verdict for verdict in doubles if verdict.twin or verdict.outcome in (Outcome.SOLVED, Outcome.BRANCH)]
    found = Counter(verdict.twin or "not recorded" for verdict in answers)
    compared = found.pop(AGREES, 0) + found.pop(DIFFERS, 0)
    others = "; ".join(f"{word}: {count}" for word, count in found.items())
    return (
        f"Of {len(answers)} answers with a twin, a scene whose answer is known to be the same, {compared} were compared"
        f" with it{f' ({others})' if others else ''}."
    )


def _entry(row: Row) -> str:
    """The variation, its reason, and the command that repeats it."""
    held = "held" if row.verdict.held else "floating"
    about = f"{row.scene}, {row.name} ({held}, {row.verdict.seconds:.1f} s)"
    return f"- {about}: {row.verdict.reason[:SHOWN]}\n  `{repeating(row)}`"


def repeating(row: Row) -> str:
    """The command that solves the variation once more."""
    return shlex.join(["stickslip", "run", row.scene, *(f"--set={word}" for word in row.overrides)])


def draw(picture: Path, rows: Sequence[Row]) -> None:
    """A matrix of scenes and variations, fixed ones first, coloured by outcome."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import to_rgb
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    names = [name for name in FIXED if any(row.name == name for row in rows)]
    drawn = {row.name for row in rows if row.kind == "random"}
    names += sorted(drawn, key=lambda name: int(name.split()[1]))
    scenes = sorted({row.scene for row in rows})
    cells = np.ones((len(scenes), len(names), 3))
    for row in rows:
        cells[scenes.index(row.scene), names.index(row.name)] = to_rgb(COLOURS[row.verdict.outcome])
    figure = Figure(figsize=(3 + 0.14 * len(names), 3.2 + 0.2 * len(scenes)), layout="constrained")
    axes = figure.subplots()
    axes.imshow(cells, aspect="auto")
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=6)
    axes.set_yticks(range(len(scenes)), scenes, fontsize=7)
    axes.set_xticks(np.arange(len(names)) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(scenes)) - 0.5, minor=True)
    axes.grid(which="minor", color="white", linewidth=0.6)
    axes.tick_params(which="both", length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    patches = [Patch(color=colour, label=outcome.value) for outcome, colour in COLOURS.items()]
    figure.legend(handles=patches, loc="outside upper center", ncols=len(patches), fontsize=7, frameon=False)
    FigureCanvasAgg(figure).print_figure(picture, dpi=110)
