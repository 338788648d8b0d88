"""STEP files of verification problems: drawn by OpenCASCADE through gmsh, and read as a user's file is."""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from stickslip.geometry.arrays import Array, Bools
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.user_files.user_file import UserFile

MM = 1e-3  # [m]; STEP files are written in mm
NEAR = 1e-7  # [m] by which points of a face may miss the plane or circle that it lies on
Where = Callable[[Array], Bools]  # points (n, 3) [m] to whether each lies on a side


@contextmanager
def step_file(draw: Callable[[Any], object]) -> Iterator[Path]:
    """A STEP file that lives as long as the block; `draw` makes its solids or faces in gmsh's `model.occ`, in mm."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "drawn.step")
        with gmsh_session() as gmsh, _silent():  # OpenCASCADE prints what it writes
            draw(gmsh.model.occ)
            gmsh.model.occ.synchronize()
            gmsh.write(str(path))
        yield path


@contextmanager
def _silent() -> Iterator[None]:
    """Nothing that libraries write to standard output is seen."""
    kept, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nothing)


def read_step(
    path: Path,
    bodies: Mapping[str, str],
    sides: Mapping[str, Where],
    mesh_size: float,
    contact_mesh_size: float | None = None,
    order: Literal[1, 2] = 2,
    dim: int = 3,
) -> UserFile:
    """The geometry of a scene, its sides found by where they lie: numbers of faces are OpenCASCADE's own affair.

    Args:
        bodies: name in the scene to name in the file.
        sides: body.side to the place of its faces.
        mesh_size: [m].
        contact_mesh_size: [m].

    Raises:
        ValueError: a side has no face.
    """
    plain = UserFile(file=str(path), length_unit="mm")
    faces = plain.outline(dim).entities
    names: dict[str, tuple[str, ...]] = {new: (old,) for new, old in bodies.items() if new != old}
    for side, where in sides.items():
        body = bodies[side.split(".")[0]]
        own = [f.number for f in faces if body in f.bodies and where(f.corners.reshape(-1, 3)).all()]
        if not own:
            raise ValueError(f"{side}: no face of {body} lies there")
        names[side] = tuple(f"{'face' if dim == 3 else 'edge'} {number}" for number in own)
    return UserFile(
        file=str(path),
        length_unit="mm",
        mesh_size=mesh_size,
        contact_mesh_size=contact_mesh_size,
        order=order,
        names=names,
    )


def on_plane(axis: int, at: float = 0.0) -> Where:
    """Points with this coordinate [m]."""
    return lambda x: np.abs(x[:, axis] - at) < NEAR


def on_cylinder(radius: float) -> Where:
    """Points at this distance [m] from the axis z."""
    return lambda x: np.abs(np.hypot(x[:, 0], x[:, 1]) - radius) < NEAR
