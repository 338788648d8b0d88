"""`stickslip verify effects`: count what effects cost scenes that do not call for them, and write a page.

The page of the suite of effects: what scenes without an effect pay for it, and what it adds to those with it.
"""

from __future__ import annotations

import shlex
import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np

from stickslip import VERSION
from stickslip.geometry.errors import SceneError, nearest
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
from stickslip.workflows.lab.verification.suite_folder import made, writing

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
        made(folder)
    studies, began = [], clock.monotonic()
    for name in names or NAMES:
        studies.append(studied(name))
        print(line(studies[-1]), flush=True)
    smooth, rubbing = (None, None) if names else schur()
    found = Found(studies=studies, noise=noise(), smooth=smooth, rubbing=rubbing)
    print(f"{sentence(found)}; {clock.monotonic() - began:.0f} s")
    if folder is not None:
        words = ["stickslip", "verify", "effects", *(["--scenes", ",".join(names)] if names else [])]
        with writing(folder):
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
    page.write_text("\n".join(_lines(found, command)) + "\n", encoding="utf-8")


def _row(*cells: object) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def _lines(found: Found, command: str) -> Iterator[str]:
    seconds = np.percentile([e.seconds for study in found.studies for e in study.absent] or [np.nan], [25, 50, 75])
    itself = np.percentile(found.noise, [25, 50, 75])
    yield "# What effects cost"
    yield ""
    yield f"Made by `{command}`, version {VERSION}; do not edit."
    yield ""
    yield f"{sentence(found)}."
    yield ""
    yield "## Scenes that do not call for an effect"
    yield ""
    yield (
        "Each scene below is prepared and solved, its errors estimated, with the effect in the registry and with it"
        " taken out. *Differ*: counters of the table below, or bits of displacements and tractions, that are not the"
        " same. *Asked*: calls of Python functions that are left out without it: they ask whether it is on. *Idle*:"
        " calls of files that serve it alone, by all of stickslip's in the run: they find nothing to do. *Seconds*: of"
        f" the processor with it, by those without it, medians of {REPEATS} pairs, then of the scenes. Of all"
        f" pairs half lie within {seconds[0]:.3f} and {seconds[2]:.3f}, their median is {seconds[1]:.3f}; those of a"
        f" scene and itself within {itself[0]:.3f} and {itself[2]:.3f}, {itself[1]:.3f}."
    )
    yield ""
    yield _row("effect", "scenes without it", "differ", "asked", "idle", "seconds")
    yield "|---|---|--:|--:|--:|--:|"
    for study in found.studies:
        if each := study.absent:
            differ = sum(a != b for e in each for a, b in zip(astuple(e.with_it), astuple(e.without), strict=True))
            asked, idle = max(e.asked for e in each), max(e.idle / e.calls for e in each)
            names = "; ".join(e.scene for e in each) if len(each) < len(SCENES) else "all"
            ratio = float(np.median([e.seconds for e in each]))
            yield _row(study.name, names, differ, asked, f"{100 * idle:.1f} %", f"{ratio:.2f}")
    yield ""
    scenes = {e.scene: e.with_it for study in found.studies for e in study.absent}
    heads = [name.replace("_", " ") for name in COUNTERS]
    yield _row("scene", *heads)
    yield f"|---|{'--:|' * len(heads)}"
    for scene, work in scenes.items():
        yield _row(scene, *(getattr(work, counter) for counter in COUNTERS))
    yield ""
    yield "## Scenes that call for it"
    yield ""
    yield "What differs from the scene that it is added to; `friction.NAME` are laws of friction, beside Coulomb's."
    yield "*Idle*: calls, in the scene without it, of files that serve it alone."
    yield ""
    yield _row("effect or law", "added to", "counters", "idle")
    yield "|---|---|---|--:|"
    for study in found.studies:
        yield _row(study.name, study.base, _added(study) or "the same", study.idle)
    yield ""
    if found.smooth and found.rubbing:
        yield "## Without friction"
        yield ""
        yield (
            f"The ready scene `cube` at h = 1/16 touches at {found.smooth.rows} points. Without friction the Schur"
            f" complement holds {found.smooth.condensed} displacements, the normal ones; with friction"
            f" {found.rubbing.condensed}."
        )
