"""Open a user's file of any kind in the current gmsh model."""

from __future__ import annotations

import gzip
import runpy
import traceback
import zlib
from collections.abc import Mapping
from pathlib import Path

from stickslip.geometry.errors import GeometryError, shortened
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.user_files.geo_script import refuse_open_end

Parameter = bool | int | float | str
KINDS = {".geo": "geo", ".step": "cad", ".stp": "cad", ".brep": "cad", ".msh": "msh", ".py": "py"}
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
        build = runpy.run_path(str(path)).get("build")
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
