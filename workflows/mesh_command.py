"""`stickslip mesh`: look at a scene's geometry and mesh, name its faces, edit it, write it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI
from rich.console import Console
from rich.table import Table

from geometry.editing import open_window, write_msh
from geometry.errors import SceneError
from geometry.user_files.outline import Facets
from geometry.user_files.user_file import UserFile
from solvers.nouns.scene import Scene
from workflows.count import look
from workflows.report import console, print_mesh, print_table
from workflows.run import raise_together


def show_mesh(scene: Scene, name: str, listed: bool, window: bool, target: Path | None) -> None:
    """Do what was asked, and without --list and --gui mesh the scene and report; collective.

    Raises:
        SceneError: `target` is no .msh file.
        MachineError: no display, or the disk refuses.
    """
    comm = MPI.COMM_WORLD
    if target is not None and target.suffix != ".msh":
        raise SceneError(f"-o {target}: expected a file that ends in .msh")
    out = console(160, quiet=comm.rank > 0)
    if listed:
        picture = (target.parent if target else Path()) / f"{name}_faces.png"
        raise_together(comm, lambda: _list(scene, picture, out))
    if window:
        raise_together(comm, lambda: open_window(scene.geometry, scene.request()))
    if not (listed or window):
        print_mesh(look(scene)[0], out)
    if target is not None:
        raise_together(comm, lambda: write_msh(scene.geometry, scene.request(), target))
        out.print(f"wrote {target}, in metres")


def _list(scene: Scene, picture: Path, out: Console) -> None:
    """Bodies, sides, and every face or edge of a user's file, in a table and in a picture."""
    for body, sides in scene.geometry.bodies(scene.dim).items():
        out.print(f"body {body}: sides {', '.join(f'{body}.{side}' for side in sides) or '-'}")
    if not isinstance(scene.geometry, UserFile):
        out.print("a builder's sides have names only; numbers are those of CAD files")
        return
    outline, word = scene.geometry.outline(scene.dim), "face" if scene.dim == 3 else "edge"
    table = Table()
    for head in (word, "side", "name in the file", "area [m²]" if scene.dim == 3 else "length [m]", "centre [m]"):
        table.add_column(head)
    table.add_column("box [m]")
    for facets in outline.entities:
        table.add_row(
            str(facets.number), outline.side_of.get(facets.number, "-"), facets.name or "-", *_measures(facets)
        )
    print_table(table, out)
    draw_picture(picture, outline.entities, scene.title or picture.stem)
    out.print(f"drawn in {picture}")


def _measures(facets: Facets) -> tuple[str, str, str]:
    low, high = facets.box
    return f"{facets.size:.4g}", _vector(facets.centre), f"{_vector(low)} to {_vector(high)}"


def _vector(x: Any) -> str:
    return ", ".join(f"{value + 0.0:.4g}" for value in x.round(12))


def draw_picture(picture: Path, entities: tuple[Facets, ...], title: str) -> None:
    """VTK is loaded only here."""
    from workflows.writers.numbered import draw_numbers

    draw_numbers(picture, entities, title)
