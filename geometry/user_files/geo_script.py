"""Text of .geo scripts: the names of their parameters; gmsh alone decides what a script does."""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Iterator
from pathlib import Path

from stickslip.geometry.errors import GeometryError

READS = ("Include", "Merge", "MergeWithBoundingBox", "ShapeFromFile")
LONGEST = 2**26  # bytes of a script that are looked at
# as in gmsh: strings have no escapes, comments do not nest
TOKEN = re.compile(r""""[^"]*"|'[^']*'|//[^\n]*|/\*.*?(?:\*/|\Z)|[A-Za-z_]\w*|[^\s\w]|\S""", re.DOTALL)


def tokens(text: str) -> list[str]:
    """Split a .geo script into words, strings and signs, without its comments.

    >>> tokens('a = "x;y"; // b')
    ['a', '=', '"x;y"', ';']
    """
    return [token for token in TOKEN.findall(text) if not token.startswith(("//", "/*"))]


def scripts(path: Path, seen: set[Path] | None = None) -> Iterator[list[str]]:
    """Yield the tokens of a script and of every file that it reads by a name in quotes.

    Args:
        seen: files to leave out; those that are read are added.
    """
    seen = set() if seen is None else seen
    if path in seen or not path.is_file():
        return
    seen.add(path)
    found = tokens(_text_of(path))
    yield found
    for i, word in enumerate(found):
        if word in READS:
            name = next((after for after in found[i + 1 : i + 3] if after != "("), "")
            if name[:1] in ('"', "'"):
                yield from scripts((path.parent / name[1:-1]).resolve(), seen)


def _text_of(path: Path) -> str:
    """The first LONGEST bytes of a script's text, which may be compressed."""
    try:
        with gzip.open(path) as packed:
            content = packed.read(LONGEST)
    except (OSError, EOFError, zlib.error):
        with path.open("rb") as plain:
            content = plain.read(LONGEST)
    return content.decode("latin-1")


def refuse_open_end(path: Path) -> None:
    """Raise GeometryError if the last line is one of which gmsh 4.8 would take the first statement only."""
    if tokens(_text_of(path).rpartition("\n")[2]).count(";") > 1:
        raise GeometryError(f"{path.name}: its last line has several statements and no line break at its end; add one")


def parameter_names(path: Path) -> dict[str, str]:
    """Names of the parameters of a script: those in DefineConstant, and those that it tests with Exists.

    Returns:
        The variable of each name: the name itself, or where it is that of ONELAB the one before it.
    """
    names: dict[str, str] = {}
    for found in scripts(path):
        depth, variable = 0, ""
        for i, word in enumerate(found):
            before = found[max(0, i - 2) : i]
            if word == "DefineConstant":
                depth = 1
            elif depth:
                depth += (word in "[{(") - (word in "]})")
                depth = 0 if depth == 1 and word == "]" else depth
                if depth == 2 and word == ",":
                    variable = ""
                if depth == 2 and found[i + 1 : i + 2] in (["="], [","], ["]"]) and word[0].isalpha():
                    names[word] = variable = word
                if before[-1:] == ["Name"] and variable:
                    names.setdefault(word[1:-1], variable)
            if before == ["Exists", "("]:
                names[word] = word
    return names
