"""`stickslip verify accuracy`: lay stated errors beside true ones, tell their shares, and write a page."""

from __future__ import annotations

import json
import shlex
import time as clock
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from stickslip.geometry.errors import SceneError, nearest, require
from stickslip.workflows.lab.verification.accuracy.page import line, passed, sentence, write_page
from stickslip.workflows.lab.verification.accuracy.problems import PROBLEMS
from stickslip.workflows.lab.verification.accuracy.suite import Study, studies
from stickslip.workflows.lab.verification.suite_folder import made, writing


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
