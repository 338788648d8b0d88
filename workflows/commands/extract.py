"""`stickslip extract`: displacement and stress at points over time, from what a run has left."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stickslip.geometry.errors import FolderError, SceneError
from stickslip.workflows.commands.process import complain, say, speaks


def extract(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="results of a run")],
    point: Annotated[
        list[str], typer.Option("--point", metavar="x,y[,z]", help="of the undeformed bodies; repeat for more")
    ],
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE.csv", help="[stdout]")] = None,
) -> None:
    """Print displacement and recovered stress at points over time, as CSV; nothing is solved."""
    import numpy as np

    from stickslip.geometry.dolfinx_versions import cells_at
    from stickslip.solvers.results.recovered_stress import cells_around
    from stickslip.solvers.scene.record import STRESSES
    from stickslip.workflows.formats.csv_tables import csv_text
    from stickslip.workflows.formats.files import write_output
    from stickslip.workflows.formats.marker import refuse_place
    from stickslip.workflows.run.stored_results import found, loaded

    if output is not None:
        refuse_place(output, "table")
    results = loaded(found(folder, complain))
    mesh = results.mesh
    axes = "xyz"[: mesh.points.shape[1]]
    places = []
    for word in point:
        try:
            x = np.array([float(value) for value in word.split(",")])
        except ValueError:
            x = np.empty(0)
        if len(x) != len(axes):
            raise SceneError(f"--point {word}: expected {','.join(axes)}, {len(axes)} numbers")
        inside = cells_at(mesh.shape, mesh.points, mesh.cells, x, float(np.ptp(mesh.points, axis=0).max()))
        if (at := next(inside, None)) is None:
            raise SceneError(f"--point {word}: lies outside the bodies")
        places.append((x, *at, *cells_around(mesh, *at, results.scene["model"] == "axisymmetric")))
    rows = []
    whole = (step for step in results.steps.kept() if len(step.displacement))  # of `output.every` some alone
    for step in whole:
        for x, cell, basis, cells, shares in places:
            stress = np.einsum("c,cij->ij", shares, step.stress[cells])
            own = [stress[ij] for ij in STRESSES.values()]
            rows.append([step.time, *x, *(basis @ step.displacement[mesh.cells[cell]]), *own])
    if not rows:
        raise FolderError(f"{folder}: holds no step with its fields")
    header = ["time", *axes, *(f"displacement_{axis}" for axis in axes), *(f"stress_{ij}" for ij in STRESSES)]
    text = csv_text([header, *([float(number) for number in row] for row in rows)])
    if speaks() and output is not None:
        write_output(output, text.encode())
        say(f"wrote {output}")
    elif speaks():
        typer.echo(text, nl=False)
