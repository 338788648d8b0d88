"""Open a user's file of any kind in the current gmsh model; of .geo scripts find the names of their parameters."""

from __future__ import annotations

import gzip
import re
import runpy
import traceback
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path

from stickslip.geometry.errors import GeometryError, shortened
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.user_files.foreign import put_foreign

Parameter = bool | int | float | str
KINDS = {".geo": "geo", ".step": "cad", ".stp": "cad", ".brep": "cad", ".msh": "msh", ".py": "py"}
FOREIGN = (".inp", ".unv", ".med", ".vtu", ".vtk", ".bdf")  # meshes that gmsh does not read, or not with their sets
KINDS |= dict.fromkeys(FOREIGN, "msh")
# How files of a kind begin; gmsh would run any other content as a .geo script.
BEGINS = {".msh": "$MeshFormat", ".step": "ISO-10303-21", ".stp": "ISO-10303-21", ".brep": "CASCADE Topology"}
HEAD = 4096  # bytes in which that must occur
STEP = (".step", ".stp")
STARTS = ("Info: Calling ", "aborting system call", "Abnormal server termination")  # how gmsh logs that
LARGEST = 2**30  # bytes of an unpacked file


def kind_of(path: Path) -> str | None:
    """Kind of the file (geo, cad, msh or py) by its ending, without .gz; None if unknown."""
    return KINDS.get(_suffix(path))


def declared_unit(path: Path) -> str | None:
    """Unit in which gmsh gives the coordinates of a file that declares its own, whichever that is; else None."""
    return "mm" if _suffix(path) in STEP else None


def _suffix(path: Path) -> str:
    return Path(path.stem if path.suffix.lower() == ".gz" else path.name).suffix.lower()


def unpacked(path: Path, folder: Path) -> Path:
    """Path of the file itself, or of the decompressed content of a .gz file, which is written into `folder`.

    A CAD file or a mesh gets its ending in lower case, by a link in `folder`: gmsh 4.8 does not know .BREP.

    Raises:
        GeometryError: it is damaged, or its content is larger than LARGEST.
    """
    packs = path.suffix.lower() == ".gz"
    plain, size = folder / (path.stem if packs else path.name), 0
    if kind_of(path) in ("cad", "msh"):
        plain = plain.with_suffix(_suffix(path))
    if not packs:
        if plain.name == path.name:
            return path
        plain.symlink_to(path.absolute())
        return plain
    try:
        with gzip.open(path) as packed, plain.open("wb") as target:
            while piece := packed.read(2**20):
                size += len(piece)
                if size > LARGEST:
                    raise GeometryError(f"unpacks to more than {LARGEST // 2**20} MiB")
                target.write(piece)
    except (OSError, EOFError, zlib.error) as error:
        raise GeometryError(f"cannot be unpacked: {error}") from None
    return plain


def open_file(gmsh: Gmsh, path: Path, parameters: Mapping[str, Parameter]) -> None:
    """Put the geometry or the mesh of a file into the current gmsh model.

    Raises:
        GeometryError: the message of gmsh or Python, in one line.
    """
    suffix = _suffix(path)
    if suffix == ".py":
        _run_build(gmsh, path, parameters)
        return
    if suffix == ".geo":
        refuse_open_end(path)
    begins = BEGINS.get(suffix)
    if begins is not None and begins.encode() not in path.read_bytes()[:HEAD]:
        raise GeometryError(f"is not a {suffix} file: it does not begin with {begins}")
    if suffix in FOREIGN:
        put_foreign(gmsh, path)
        return
    gmsh.logger.start()
    gmsh.merge(str(path))
    raise_gmsh_error(gmsh, path.parent)


def raise_gmsh_error(gmsh: Gmsh, folder: Path | None = None) -> None:
    """Stop gmsh's log, and raise GeometryError with the first error in it, if any; `folder` is left out of its text."""
    try:
        lines = gmsh.logger.get()
    except UnicodeDecodeError:
        raise GeometryError("contains bytes that are not text") from None
    finally:
        gmsh.logger.stop()
    if any(words in line for line in lines for words in STARTS):  # its process is kept from it
        raise GeometryError("starts a program, and a geometry may not; a .py file may")
    errors = [line.removeprefix("Error: ") for line in lines if line.startswith("Error")]
    if errors:
        raise GeometryError(f"gmsh says: {shortened(errors[0].replace(f'{folder}/', ''), 200)}")


def _run_build(gmsh: Gmsh, path: Path, parameters: Mapping[str, Parameter]) -> None:
    """Run `build(model, parameters)` of a .py file."""
    try:
        code = compile(path.read_bytes(), str(path), "exec")  # a program of its own would end the session
        named = "build" in code.co_names or ("*",) in code.co_consts
        build = runpy.run_path(str(path)).get("build") if named else None
        if build is None:
            raise GeometryError("defines no build(model, parameters)")
        build(gmsh.model, dict(parameters))
        gmsh.model.occ.synchronize()
    except GeometryError:
        raise
    except SyntaxError as error:
        raise GeometryError(f"line {error.lineno}: {type(error).__name__}: {error.msg}") from None
    except (Exception, SystemExit) as error:
        own = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        where = f"line {own[-1]}: " if own else ""
        raise GeometryError(f"{where}{type(error).__name__}: {error}") from None


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


GLUES = re.compile(
    r"\b(BooleanFragments|Coherence|fragment|removeAllDuplicates|remove_all_duplicates|removeDuplicateNodes)\b"
)


def apart(path: Path) -> str:
    """Return what gives bodies that share faces or nodes their own, in words: what to leave out of a script."""
    kind, found = kind_of(path), list[str]()
    if kind == "geo":
        found = [word for script in scripts(path) for word in script if GLUES.fullmatch(word)]
    if kind == "py":
        found = GLUES.findall(_text_of(path))
    if found:
        return f"leave out {' and '.join(dict.fromkeys(found))} in {path.name}"
    if kind in ("geo", "py"):
        return "draw curves and points for each body apart"
    return "export the bodies as parts apart" if kind == "cad" else "leave out fragment or Coherence where it is made"


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
