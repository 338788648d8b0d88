"""A scene's geometry and mesh: faces listed, edited, meshed, judged, written; for `stickslip mesh`."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI
from rich.console import Console

from stickslip.geometry.errors import GeometryError, SceneError
from stickslip.geometry.mesh.mesh import write_msh
from stickslip.geometry.shape import Model, Request, Shape
from stickslip.geometry.units import SI, Units
from stickslip.geometry.user_files.outline import Facets
from stickslip.geometry.user_files.touching import touching
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.geometry.user_files.window import open_window
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.run.mesh_report import look
from stickslip.workflows.run.ranks import raise_together
from stickslip.workflows.run.terminal import console, print_mesh, print_table, table_of


def announce(scene: Scene) -> None:
    """Say on stderr how long gmsh takes, if that is more than ten seconds."""
    request = scene.request()
    seconds = scene.geometry.meshing_time(request)
    if seconds > 10:
        count = scene.geometry.cell_count(request)
        print(f"gmsh makes about {count:.1g} cells, in up to {seconds / 60:.1f} minutes ...", file=sys.stderr)


def report(scene: Scene, target: Path | None) -> None:
    """Mesh the scene, print the mesh report, and write the mesh if there is a target; collective.

    Raises:
        SceneError: `target` does not end in .msh, or is the file that the scene reads.
        MachineError: the file cannot be written.
    """
    if target is not None and target.suffix != ".msh":
        raise SceneError(f"-o {target}: expected a file that ends in .msh")
    read = Path(scene.geometry.file) if isinstance(scene.geometry, UserFile) else None
    if target is not None and read is not None and target.exists() and target.samefile(read):
        raise SceneError(f"-o {target}: is the file that the scene reads; choose another name")
    out = _console()
    print_mesh(look(scene)[0], out)
    if target is not None:
        raise_together(MPI.COMM_WORLD, lambda: write_msh(scene.geometry, scene.request(), target))
        of = scene.labels
        out.print(f"wrote {target}, in {'metres' if of.length == 'm' else of.length}")


def edit(geometry: Shape, model: Model) -> None:
    """Open gmsh's window on rank 0; collective."""
    raise_together(MPI.COMM_WORLD, lambda: open_window(geometry, Request(model=model)))


def list_entities(geometry: Shape, model: Model, units: Units, picture: Path) -> None:
    """List bodies, sides, and every face or edge of a user's file, in a table and in a picture; collective."""
    raise_together(MPI.COMM_WORLD, lambda: _list(geometry, 3 if model == "3d" else 2, units, picture, _console()))


def _console() -> Console:
    return console(160, quiet=MPI.COMM_WORLD.rank > 0)


def _list(geometry: Shape, dim: int, units: Units, picture: Path, out: Console) -> None:
    if isinstance(geometry, UserFile):
        geometry = _without_wrong_names(geometry, dim, out)
    for body, sides in geometry.bodies(dim).items():
        out.print(f"body {body}: sides {', '.join(f'{body}.{side}' for side in sides) or '-'}")
    if not isinstance(geometry, UserFile):
        out.print("a builder's sides have names only; numbers are those of CAD files")
        return
    out.print(geometry.note(dim), end="\n" if geometry.note(dim) else "")
    outline, word = geometry.outline(dim), "face" if dim == 3 else "edge"
    meets: dict[int, list[str]] = {}
    for pair in touching(outline, dim):
        for side, partner in ((pair.one, pair.other), (pair.other, pair.one)):
            for number in side.numbers:
                meets.setdefault(number, []).append(partner.body)
    size, rows = "area [m²]" if dim == 3 else "length [m]", []
    for facets in outline.entities:
        number, partners = facets.number, dict.fromkeys(meets.get(facets.number, ["-"]))
        words = (", ".join(facets.bodies) or "-", outline.side_of.get(number, "-"), ", ".join(partners))
        rows.append((str(number), *words, facets.name or "-", *_measures(facets)))
    heads = (word, "body", "side", "touches", "name in the file", size, "centre [m]", "box [m]")
    labels = [*map(units.label, heads)]
    print_table(table_of(labels, rows, labels), out)
    draw_picture(picture, outline.entities, Path(geometry.file).name, units)
    out.print(f"drawn in {picture}")


def _without_wrong_names(geometry: UserFile, dim: int, out: Console) -> UserFile:
    """The file without `geometry.names` if these are wrong, with a warning: the user lists numbers to correct them."""
    try:
        geometry.outline(dim)
    except GeometryError as error:
        if not geometry.names:
            raise
        out.print(f"warning: {error}; listed without geometry.names", soft_wrap=True)
        return replace(geometry, names={})
    return geometry


def _measures(facets: Facets) -> tuple[str, str, str]:
    low, high = facets.box
    return f"{facets.size:.4g}", _vector(facets.centre), f"{_vector(low)} to {_vector(high)}"


def _vector(x: Any) -> str:
    return ", ".join(f"{value + 0.0:.4g}" for value in x.round(12))


def draw_picture(picture: Path, entities: tuple[Facets, ...], title: str, units: Units = SI) -> None:
    """Draw the numbered faces or edges; only this function imports VTK."""
    from stickslip.workflows.pictures.sides import draw_numbers

    draw_numbers(picture, entities, title, units)
