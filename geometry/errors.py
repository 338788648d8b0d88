"""What can go wrong, by whose doing: the scene, the geometry, the solver or the machine."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class StickslipError(Exception):
    """Base of every error that a user meets; its text is one line."""

    exit_code = 1


class SceneError(StickslipError, ValueError):
    """A scene asks for something impossible; the text names the key, the value and a way out."""

    exit_code = 2


class FolderError(SceneError):
    """The results cannot go where the user wants them."""


class GeometryError(StickslipError):
    """A shape or a mesh is not what the scene says."""

    exit_code = 2


class SolverError(StickslipError):
    """A step has no answer, or none was found."""

    exit_code = 3


class MachineError(StickslipError):
    """Disk, memory or a library stand in the way."""

    exit_code = 4


class DamagedError(MachineError):
    """A file is cut short or not what was written; whoever can make it anew may."""


def require(ok: bool, key: str, found: object, expected: str) -> None:
    """Raise a SceneError in the scene's own words unless `ok`.

    >>> require(1 < 2, "mu", 0.3, "must not be negative")
    """
    if not ok:
        raise SceneError(f"{key} = {found}: {expected}")


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint that ends an error message: the nearest valid name, or all of them.

    >>> nearest("block.botom", ["block.bottom", "block.top"])
    'did you mean block.bottom?'
    >>> nearest("x", ["a", "b"])
    'known: a, b'
    """
    names = {entry.lower(): entry for entry in sorted(known)}
    close = difflib.get_close_matches(name.lower(), names, n=1)
    if close:
        return f"did you mean {names[close[0]]}?"
    return f"known: {', '.join(names.values())}" if names else "there is none in this scene"
