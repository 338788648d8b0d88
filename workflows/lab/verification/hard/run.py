"""`stickslip verify hard`: run the hard suite, tell what was not solved, and write its page."""

from __future__ import annotations

import json
import shlex
import sys
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

from stickslip import VERSION
from stickslip.geometry.errors import MachineError, SceneError, nearest, require
from stickslip.workflows.lab.verification.hard.judge import Outcome, Verdict
from stickslip.workflows.lab.verification.hard.page import BAD, sentence, write_page
from stickslip.workflows.lab.verification.hard.page import again as repeated
from stickslip.workflows.lab.verification.hard.suite import NAMES, Row, judged_again, results
from stickslip.workflows.lab.verification.suite_folder import made, writing

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
        made(folder)
    for option, asked in (("--again", again), ("--resume", resume)):
        require(folder is not None or not asked, option, "", "needs the folder of an earlier run, with -o")
    require(not (again and resume), "--resume", "", "goes without --again")
    if folder is not None and (folder / PART).exists() and not (again or resume):
        raise SceneError(f"{folder / PART}: of a run that was ended; go on with --resume, or remove it")
    earlier = _rows(folder / LINES, _lines(folder / LINES)) if folder is not None and again else []
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
                f"{row.scene}, {row.name}: {row.verdict.outcome.value}: {row.verdict.reason}\n  {repeated(row)}",
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
        with writing(folder):
            write_page(folder / "hard.md", rows, command)
            (folder / LINES).write_text("".join(map(_line, rows)), encoding="utf-8")
            if not again:
                (folder / PART).unlink()
    return not any(row.verdict.outcome in BAD for row in rows)


def _keeper(path: Path, run: str, rows: Sequence[Row]) -> Callable[[Row], None]:
    """Write the rows so far; the function that is returned appends one more."""
    with writing(path.parent):
        path.write_text("".join([f"{run}\n", *map(_line, rows)]), encoding="utf-8")

    def keep(row: Row) -> None:
        with writing(path.parent), path.open("a", encoding="utf-8") as file:
            file.write(_line(row))

    return keep


def _begun(path: Path, run: str) -> list[Row]:
    """The rows that a run has left when it was ended.

    Raises:
        MachineError: there are none.
        SceneError: they are of another run.
    """
    first, *lines = _lines(path) or [""]
    if first != run:
        raise SceneError(f"--resume: {path} is of another run: {first or 'nothing'}")
    return _rows(path, lines)


def _lines(path: Path) -> list[str]:
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
