"""Reading a user's file into the current gmsh model, each kind in its own way."""

from __future__ import annotations

import gzip
import runpy
import traceback
import zlib
from collections.abc import Mapping
from pathlib import Path

from geometry.errors import GeometryError
from geometry.protocols import Gmsh
from geometry.user_files.system_calls import scripts

Parameter = bool | int | float | str
KINDS = {".geo": "geo", ".step": "cad", ".stp": "cad", ".brep": "cad", ".msh": "msh", ".py": "py"}
# gmsh runs whatever it does not recognise as a script of its own
BEGINS = {".msh": "$MeshFormat", ".step": "ISO-10303-21", ".stp": "ISO-10303-21", ".brep": "CASCADE Topology"}
HEAD = 4096


def kind_of(path: Path) -> str | None:
    """geo, cad, msh or py by the file's ending, .gz apart."""
    return KINDS.get(_suffix(path))


def _suffix(path: Path) -> str:
    return Path(path.stem if path.suffix == ".gz" else path.name).suffix.lower()


def unpacked(path: Path, folder: Path) -> Path:
    """The file itself, or what a .gz holds, put into `folder`."""
    if path.suffix != ".gz":
        return path
    plain = folder / path.stem
    try:
        plain.write_bytes(gzip.decompress(path.read_bytes()))
    except (OSError, EOFError, zlib.error) as error:
        raise GeometryError(f"cannot be unpacked: {error}") from None
    return plain


def open_file(gmsh: Gmsh, path: Path, parameters: Mapping[str, Parameter]) -> None:
    """Put the file's geometry, or its mesh, into the current model.

    Raises:
        GeometryError: gmsh's or Python's own words, in one line.
    """
    suffix = _suffix(path)
    if suffix == ".py":
        _build(gmsh, path, parameters)
        return
    if suffix == ".geo":
        for _ in scripts(path):
            pass
    begins = BEGINS.get(suffix)
    if begins is not None and begins.encode() not in path.read_bytes()[:HEAD]:
        raise GeometryError(f"is no {suffix} file: it does not begin with {begins}")
    gmsh.logger.start()
    gmsh.merge(str(path))
    complain(gmsh, path.parent)


def complain(gmsh: Gmsh, folder: Path | None = None) -> None:
    """Raise gmsh's first error since its log was started, without the folder that the file lies in."""
    try:
        lines = gmsh.logger.get()
    except UnicodeDecodeError:
        raise GeometryError("holds bytes that are no text") from None
    finally:
        gmsh.logger.stop()
    errors = [line.removeprefix("Error: ") for line in lines if line.startswith("Error")]
    if errors:
        raise GeometryError(f"gmsh says: {errors[0].replace(f'{folder}/', '')}")


def _build(gmsh: Gmsh, path: Path, parameters: Mapping[str, Parameter]) -> None:
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
