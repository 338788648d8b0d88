"""`stickslip verify effects`: count what effects cost scenes that do not call for them, and write a page."""

from __future__ import annotations

import shlex
import time as clock
from collections.abc import Sequence
from pathlib import Path

from stickslip.geometry.errors import SceneError, nearest
from stickslip.workflows.lab.verification.effects.page import Found, faults, line, sentence, write_page
from stickslip.workflows.lab.verification.effects.parts import EFFECTS, LAWS
from stickslip.workflows.lab.verification.effects.suite import noise, schur, studied
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
