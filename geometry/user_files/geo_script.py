"""Text of .geo scripts: scripts with system calls are refused, and the names of their parameters are found."""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from geometry.errors import GeometryError

REFUSED = ("SystemCall", "System", "NonBlockingSystemCall", "OnelabRun")
READS = ("Include", "Merge", "MergeWithBoundingBox", "ShapeFromFile")
# as in gmsh: strings have no escapes, comments do not nest
TOKEN = re.compile(r""""[^"]*"|'[^']*'|//[^\n]*|/\*.*?(?:\*/|\Z)|[A-Za-z_]\w*|[^\s\w]|\S""", re.DOTALL)


def tokens(text: str) -> list[str]:
    """Split a .geo script into words, strings and signs, without its comments.

    >>> tokens('a = "x;y"; // b')
    ['a', '=', '"x;y"', ';']
    """
    return [token for token in TOKEN.findall(text) if not token.startswith(("//", "/*"))]


def scripts(path: Path, seen: set[Path] | None = None) -> Iterator[tuple[Path, list[str]]]:
    """Yield path and tokens of a script and of every file that it reads.

    Args:
        seen: files to leave out; those that are read are added.

    Raises:
        GeometryError: there is a system call, or the name of a file is computed, so that it cannot be checked.
    """
    seen = set() if seen is None else seen
    if path in seen:
        return
    seen.add(path)
    content = path.read_bytes()
    with suppress(OSError, EOFError, zlib.error):
        content = gzip.decompress(content)  # gmsh also reads compressed files
    text = content.decode("latin-1")
    found = tokens(text)
    for word in REFUSED:
        if word in found:
            raise GeometryError(f"{path.name}: {word} is refused, a scene's geometry runs no other programs")
    if tokens(text.rpartition("\n")[2]).count(";") > 1:  # gmsh 4.8 would take the first of these statements only
        raise GeometryError(f"{path.name}: its last line has several statements and no line break at its end; add one")
    yield path, found
    for i, word in enumerate(found):
        if word in READS:
            after = [token for token in found[i + 1 : i + 4] if token != "("]
            name, end = [*after, "", ""][:2]
            if name[:1] not in ('"', "'") or end not in (";", ")"):
                raise GeometryError(f"{path.name}: {word} must name its file as a text in quotes, not compute it")
            inner = path.parent / name[1:-1]
            if inner.is_file():
                yield from scripts(inner.resolve(), seen)


def parameter_names(path: Path) -> set[str]:
    """Names of the parameters of a script: those in DefineConstant, and those that it tests with Exists."""
    names: set[str] = set()
    for _, found in scripts(path):
        depth = 0
        for i, token in enumerate(found):
            before = found[max(0, i - 2) : i]
            if token == "DefineConstant":
                depth = 1
            elif depth:
                depth += (token in "[{(") - (token in "]})")
                depth = 0 if depth == 1 and token == "]" else depth
                if depth == 2 and found[i + 1 : i + 2] in (["="], [","], ["]"]) and token[0].isalpha():
                    names.add(token)
                if before == ["Name"] or before[-1:] == ["Name"]:
                    names.add(token[1:-1])
            if before == ["Exists", "("]:
                names.add(token)
    return names
