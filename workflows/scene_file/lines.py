"""The lines of a scene file in which its keys stand, for messages that an editor can follow."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

TOKEN = re.compile(  # a text, a comment, a bracket or an end of line, or what lies between
    r'''"""(?:\\.|[^\\])*?"{3,5}|"(?:\\.|[^"\\\n])*"|'{3}.*?'{3,5}|'[^'\n]*'|#[^\n]*|[^"'#\[\]{}\n]+|.''', re.DOTALL
)
KEY = re.compile(r"[^\s:=]+")  # at the beginning of a message


def located(messages: Sequence[str], path: Path, but: Sequence[str] = ()) -> list[tuple[int | None, str]]:
    """Each message that begins with a dotted key, with the line of that key, or of the table that lacks it; by lines.

    Args:
        but: keys that come from elsewhere.
    """
    try:
        lines = lines_of_keys(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):  # the message says it
        lines = {}
    found = [(_line(message, lines, but), message) for message in messages]
    return sorted(found, key=lambda each: each[0] or 0)


def _line(message: str, lines: dict[str, int], but: Sequence[str]) -> int | None:
    words = KEY.match(message)
    key = words[0] if words else ""
    while key:
        if any(f"{key}.".startswith(f"{other}.") for other in but):
            return None
        if key in lines:
            return lines[key]
        key = key.rpartition(".")[0]
    return None


def lines_of_keys(text: str) -> dict[str, int]:
    """Line of each dotted key and table of a text that is TOML; keys in one value are all in the line of its beginning.

    >>> lines_of_keys('a = 1\\n[b.c]  # [d]\\nx = [\\n1,\\n2]\\ny = {z = 3}')
    {'a': 1, 'b': 2, 'b.c': 2, 'b.c.x': 3, 'b.c.y': 6, 'b.c.y.z': 6}
    """
    found: dict[str, int] = {}
    table: tuple[str, ...] = ()
    for line, statement in _statements(text):
        paths, head = list(_paths(tomllib.loads(statement))), statement.lstrip().startswith("[")
        for path in paths:
            found.setdefault(".".join(path if head else (*table, *path)), line)
        table = paths[-1] if head else table
    return found


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Line and text of each table's head and each `key = value`, which goes on while a bracket is open."""
    begin, line, depth, parts = 1, 1, 0, list[str]()
    for word in (found[0] for found in TOKEN.finditer(f"{text}\n")):
        depth += (word in "[{") - (word in "]}")
        if word == "\n" and depth == 0:
            if parts:
                yield begin, "".join(parts)
            parts = []
        elif not word.startswith("#") and (parts or not word.isspace()):
            begin = begin if parts else line
            parts.append(word)
        line += word.count("\n")


def _paths(value: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """All keys in what a statement says, a table before what it holds."""
    for name, item in value.items() if isinstance(value, dict) else ():
        yield (*above, name)
        yield from _paths(item, (*above, name))
