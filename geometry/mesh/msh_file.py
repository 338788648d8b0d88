"""The mesh of a scene as a .msh file, in the scene's unit of length."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from stickslip.geometry.errors import MachineError
from stickslip.geometry.mesh.gmsh_session import gmsh_session, own_interrupt
from stickslip.geometry.mesh.mesh import mesh_shape
from stickslip.geometry.shape import Request, Shape


def write_msh(shape: Shape, request: Request, path: Path) -> None:
    """Mesh the shape and write it in the scene's unit: into a temporary file beside `path`, which is then renamed.

    Raises:
        MachineError: the file cannot be written.
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.msh")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch()
        with own_interrupt(), gmsh_session() as gmsh:
            unit = mesh_shape(gmsh, shape, request)
            gmsh.option.setNumber("Mesh.ScalingFactor", unit)
            gmsh.option.setNumber("Mesh.SaveAll", 0)
            gmsh.write(str(temporary))
        temporary.replace(path)
    except OSError as error:
        raise MachineError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
