"""`stickslip fclib`: solve discrete Coulomb problems of other programs, and compare methods on them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def fclib(
    files: Annotated[list[Path], typer.Argument(metavar="FILES...", help="discrete problems in FCLIB's HDF5 format")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="for copies of the files with their solutions")
    ] = Path("results/fclib"),
    method: Annotated[
        list[str] | None, typer.Option("--method", metavar="NAME", help="repeat to compare; all: every one [auto]")
    ] = None,
    tolerance: Annotated[
        float, typer.Option("--tolerance", help="on the residual, relative to the norm of q after scaling")
    ] = 1e-8,
    report: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="write the figures, for scripts")
    ] = None,
) -> None:
    """Solve discrete Coulomb problems of non-smooth contact dynamics, and compare methods on them."""
    from stickslip.workflows.commands._fclib import solve_all

    raise typer.Exit(solve_all(files, output, method or (), tolerance, report))
