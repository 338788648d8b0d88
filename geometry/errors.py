"""Errors that a user meets, by their cause: the scene, the geometry, the solver or the machine."""

from __future__ import annotations

import difflib
import unicodedata
from collections.abc import Collection, Iterable, Sequence

LONGEST, LONGEST_LINE = 120, 280  # characters of a user's text that an error repeats, and of the whole line
MOST_LINES = 30  # mistakes that are said at once


def shortened(text: object, longest: int = LONGEST) -> str:
    """A user's text in one line; of a long one only its beginning and end.

    >>> shortened("a" * 500 + "\\nb", 20)
    'aaaaaaaaa ... aaaa b'
    """
    line = printable(" ".join(str(text).split()))
    head = longest - 5 - longest // 3
    return line if len(line) <= longest else f"{line[:head]} ... {line[len(line) - longest // 3 :]}"


def printable(text: str) -> str:
    r"""A text in which a terminal finds no commands, nor signs that turn its direction: these are shown by their codes.

    >>> printable("a\x1b[2Jb\u202ec, é")
    'a\\x1b[2Jb\\u202ec, é'
    """
    if text.isprintable():
        return text
    seen = (c if c in "\n\t" or unicodedata.category(c)[0] != "C" else ascii(c)[1:-1] for c in text)
    return "".join(seen)


class StickslipError(Exception):
    """Base of every error that a user meets; its text is one line, its exit code is that of the command line."""

    exit_code = 1


class InputError(StickslipError):
    """The user's input is wrong. It may be of any length, and the text of the error repeats the ends of it only.

    Its text is the first mistake; further ones that were found with it are Python's notes, and `lines` has them all.
    """

    exit_code = 2

    def __init__(self, text: str, *further: str) -> None:
        super().__init__(shortened(text, LONGEST_LINE))
        left_out = len(further) - (MOST_LINES - 1)
        for line in further[: MOST_LINES - 1]:
            self.add_note(shortened(line, LONGEST_LINE))
        if left_out > 0:
            self.add_note(f"and {left_out} more")

    @property
    def lines(self) -> tuple[str, ...]:
        """One line for each mistake."""
        return (str(self), *getattr(self, "__notes__", ()))


class SceneError(InputError, ValueError):
    """The scene asks for something impossible; the text names the key, the value and what is possible instead."""


class FolderError(SceneError):
    """The results cannot be written to the folder that the user names."""


class GeometryError(InputError):
    """A shape or a mesh cannot be made, or does not fit the scene."""


class GluedError(GeometryError):
    """A side lies between two bodies that hold each other there."""


class SolverError(StickslipError):
    """A step has no solution, or the solver does not find it."""

    exit_code = 3


class MachineError(StickslipError):
    """The disk, the memory or a library fails."""

    exit_code = 4


class DamagedError(MachineError):
    """A file is truncated, or its content is not what was written; a caller that can write it again may catch this."""


class prefixed:  # noqa: N801  reads as a word in `with`
    """Context that puts the table's name in front of a SceneError."""

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, SceneError):
            raise SceneError(*(f"{self.prefix}.{line}" for line in error.lines)) from None


class Mistakes:
    """Collects the errors of input of what is done `with` it, so that a user reads them all at once."""

    def __init__(self) -> None:
        self._found: list[InputError] = []

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        if not isinstance(error, InputError):
            return False
        self._found.append(error)
        return True

    def report(self) -> None:
        """Raise one error of them all, of the first one's kind; nothing if there was none.

        >>> mistakes = Mistakes()
        >>> for value in (-1, 2, -3):
        ...     with mistakes:
        ...         require(value > 0, "mu", value, "must be positive")
        >>> try:
        ...     mistakes.report()
        ... except SceneError as error:
        ...     print(error.lines)
        ('mu = -1: must be positive', 'mu = -3: must be positive')
        """
        if self._found:
            raise type(self._found[0])(*dict.fromkeys(line for error in self._found for line in error.lines))


def require(ok: bool, key: str, found: object, expected: str) -> None:
    """Raise `SceneError("key = found: expected")` unless `ok`.

    Args:
        key: name of the scene key, as the user writes it.
        found: its value.
        expected: what is allowed, with the unit.

    >>> require(1 < 2, "mu", 0.3, "must not be negative")
    """
    if not ok:
        said = shortened(found) or '""'
        raise SceneError(f"{key} = {said}: {expected}")


def require_components(vector: Sequence[object] | None, key: str, dim: int, place: str = "in this model") -> None:
    """Raise `SceneError` unless a vector, if one is given, has as many components as the model has dimensions."""
    require(vector is None or len(vector) == dim, key, list(vector or ()), f"expected {dim} components {place}")


def require_known(key: str, name: str, known: Collection[str], expected: str = "") -> None:
    """Raise `SceneError("key = name: expected; did you mean ...?")` unless the name is known.

    What is spelled most like it is looked for then alone: among the sides of fifty bodies that takes 30 ms.

    >>> require_known("contacts.base.surface", "block.top", ["block.bottom", "block.top"], "no such side")
    """
    if name not in known:
        require(False, key, name, f"{expected}{'; ' if expected else ''}{nearest(name, known)}")


def nearest(name: str, known: Iterable[str]) -> str:
    """Hint at the end of an error message: the valid name that is spelled most like `name`, or all valid names.

    >>> nearest("block.botom", ["block.bottom", "block.top"])
    'did you mean block.bottom?'
    >>> nearest("x", ["a", "b"])
    'known: a, b'
    """
    names = {entry.lower(): entry for entry in sorted(known)}
    close = difflib.get_close_matches(name.lower(), names, n=1) if len(name) < LONGEST else []
    if close:
        return f"did you mean {names[close[0]]}?"
    return f"known: {shortened(', '.join(names.values()))}" if names else "there is none in this scene"
