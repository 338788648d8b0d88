"""A scene's geometry in gmsh's own hands: written to a .msh file, or opened in its window."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from geometry.errors import MachineError
from geometry.gmsh_session import gmsh_session, own_interrupt
from geometry.mesh import put_shape
from geometry.shape import Request, Shape
from geometry.user_files.reader import read_parts, setting_words
from geometry.user_files.user_file import UserFile


def write_msh(shape: Shape, request: Request, path: Path) -> None:
    """Mesh the shape and write it in metres, aside first, then renamed.

    Raises:
        MachineError: the file cannot be written.
    """
    aside = path.with_name(f".{path.stem}.{os.getpid()}.msh")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        aside.touch()
        with own_interrupt(), gmsh_session() as gmsh:
            unit = put_shape(gmsh, shape, request)
            gmsh.option.setNumber("Mesh.ScalingFactor", unit)
            gmsh.option.setNumber("Mesh.SaveAll", 0)
            gmsh.write(str(aside))
        aside.replace(path)
    except OSError as error:
        raise MachineError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        with suppress(OSError):
            aside.unlink(missing_ok=True)


def open_window(shape: Shape, request: Request) -> None:
    """Show the geometry in gmsh until its window is closed.

    Raises:
        MachineError: there is no display, or gmsh was built without its window.
    """
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise MachineError("--gui: there is no display here (DISPLAY is not set); try --list, or gmsh elsewhere")
    question = shape.question(request.dim) if isinstance(shape, UserFile) else None
    with own_interrupt(), gmsh_session(setting_words(question) if question else ()) as gmsh:
        if "Fltk" not in gmsh.option.getString("General.BuildOptions").split():
            raise MachineError("--gui: this gmsh was built without its window (FLTK); try --list")
        if question:
            read_parts(gmsh, question)
        else:
            shape.put(gmsh, request)
        gmsh.fltk.run()
