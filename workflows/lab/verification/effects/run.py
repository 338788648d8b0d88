"""`stickslip verify effects`: count what effects cost scenes that do not call for them, and write a page.

The page of the suite of effects: what scenes without an effect pay for it, and what it adds to those with it.
"""

from __future__ import annotations

import shlex
import time as clock
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np

from stickslip import VERSION
from stickslip.geometry.errors import SceneError, nearest
from stickslip.workflows.formats.files import disk_errors, make_folder
from stickslip.workflows.formats.templates import render
from stickslip.workflows.lab.verification.effects.suite import (
    EFFECTS,
    LAWS,
    REPEATS,
    SCENES,
    Study,
    Work,
    noise,
    schur,
    studied,
)

NAMES = (*EFFECTS, *(f"friction.{law}" for law in LAWS))


def effects(names: Sequence[str] = (), folder: Path | None = None) -> bool:
    """Run the suite; one line for each effect, then a sentence.

    Args:
        names: effects, and laws as friction.NAME; none: all, and the Schur complement without friction.
        folder: where effects.md is written; None: nowhere.

    Returns:
        Whether scenes that do not call for an effect pay nothing for it.

    Raises:
        SceneError: an unknown name.
        MachineError: the folder cannot be written.
    """
    for name in names:
        if name not in NAMES:
            raise SceneError(f"--scenes {name}: no such effect or law; {nearest(name, NAMES)}")
    if folder is not None:
        make_folder(folder)
    studies, began = [], clock.monotonic()
    for name in names or NAMES:
        studies.append(studied(name))
        print(line(studies[-1]), flush=True)
    smooth, rubbing = (None, None) if names else schur()
    found = Found(studies=studies, noise=noise(), smooth=smooth, rubbing=rubbing)
    print(f"{sentence(found)}; {clock.monotonic() - began:.0f} s")
    if folder is not None:
        words = ["stickslip", "verify", "effects", *(["--scenes", ",".join(names)] if names else [])]
        with disk_errors(folder):
            write_page(folder / "effects.md", found, shlex.join([*words, "-o", folder.resolve().name]))
    return not faults(found)


ASKING = 100  # calls at most to see that an effect is off
COUNTERS = [f.name for f in fields(Work) if f.name != "answer"]


@dataclass(frozen=True, kw_only=True)
class Found:
    """What the suite has given."""

    studies: Sequence[Study]
    noise: Sequence[float]  # seconds of each scene by those of itself
    smooth: Work | None = None  # `cube` without friction
    rubbing: Work | None = None  # as it is


def faults(found: Found) -> list[str]:
    """Sentences of what is not as it is asked for; seconds are told, not judged."""
    said = []
    for study in found.studies:
        for each in study.absent:
            before, after = astuple(each.without), astuple(each.with_it)
            other = [name for name, a, b in zip((*COUNTERS, "answer"), before, after, strict=True) if a != b]
            if other:
                said.append(f"{study.name}: {each.scene}, which does not call for it, has another {', '.join(other)}")
            if each.asked > ASKING:
                said.append(f"{study.name}: {each.scene} asks {each.asked} calls for it, more than {ASKING}")
        if study.before.answer == study.after.answer:
            said.append(f"{study.name}: the scene that calls for it has the answer of the one that does not")
    if found.smooth and found.rubbing:
        points = found.smooth.rows
        if (found.smooth.condensed, found.rubbing.condensed) != (points, 3 * points):
            said.append("cube: the Schur complement does not hold the normal displacements alone")
    return said


def line(study: Study) -> str:
    """What is printed of an effect."""
    added = _added(study)
    return f"{study.name}: {len(study.absent)} scenes without it; {study.base} with it: {added or 'the same counters'}"


def _added(study: Study) -> str:
    """Counters that the scene that calls for it has otherwise."""
    pairs = ((name, getattr(study.before, name), getattr(study.after, name)) for name in COUNTERS)
    return ", ".join(f"{name.replace('_', ' ')} {a} → {b}" for name, a, b in pairs if a != b)


def sentence(found: Found) -> str:
    """The outcome."""
    wrong, runs = faults(found), sum(len(study.absent) for study in found.studies)
    effects = sum(bool(study.absent) for study in found.studies)
    if wrong:
        return f"{len(wrong)} faults: {'; '.join(wrong)}"
    return f"{effects} effects, {runs} scenes without them: all counters and all bits of the answers are the same"


def write_page(page: Path, found: Found, command: str) -> None:
    """Write the page."""
    seconds = np.percentile([e.seconds for study in found.studies for e in study.absent] or [np.nan], [25, 50, 75])
    scenes = {e.scene: e.with_it for study in found.studies for e in study.absent}
    text = render(
        "lab/verification/templates/effects.md",
        command=command,
        version=VERSION,
        sentence=sentence(found),
        repeats=REPEATS,
        seconds=[f"{value:.3f}" for value in seconds],
        itself=[f"{value:.3f}" for value in np.percentile(found.noise, [25, 50, 75])],
        absent=[_absent(study) for study in found.studies if study.absent],
        heads=[name.replace("_", " ") for name in COUNTERS],
        scenes=[(scene, *(getattr(work, counter) for counter in COUNTERS)) for scene, work in scenes.items()],
        called=[(study.name, study.base, _added(study) or "the same", study.idle) for study in found.studies],
        smooth=found.smooth,
        rubbing=found.rubbing,
    )
    page.write_text(text, encoding="utf-8")


def _absent(study: Study) -> tuple[object, ...]:
    """The cells of an effect, of the scenes that do not call for it."""
    each = study.absent
    differ = sum(a != b for e in each for a, b in zip(astuple(e.with_it), astuple(e.without), strict=True))
    asked, idle = max(e.asked for e in each), max(e.idle / e.calls for e in each)
    names = "; ".join(e.scene for e in each) if len(each) < len(SCENES) else "all"
    ratio = float(np.median([e.seconds for e in each]))
    return study.name, names, differ, asked, f"{100 * idle:.1f} %", f"{ratio:.2f}"
