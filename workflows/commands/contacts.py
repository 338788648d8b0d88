"""`stickslip contacts`: list and draw the pairs of faces of an assembly that touch."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

UnitOption = Annotated[
    str | None,
    typer.Option("--unit", metavar="UNIT", help="of the geometry file: mm, in, ... [STEP: mm; else the scene's]"),
]
UnitsOption = Annotated[
    str | None, typer.Option("--units", metavar="UNITS", help="of the scene, such as mm-N-MPa [SI]")
]
WithinOption = Annotated[
    float | None, typer.Option("--within", metavar="LENGTH", help="largest gap of a pair [.001 of the assembly's size]")
]


def contacts(
    source: Annotated[str, typer.Argument(metavar="FILE", help="a geometry file, or a scene with one")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="for a picture of each pair [NAME_contacts]")
    ] = None,
    unit: UnitOption = None,
    units: UnitsOption = None,
    within: WithinOption = None,
) -> None:
    """List and draw the pairs of faces of an assembly that touch, or lie close to each other."""
    from stickslip.workflows.commands._contacts import list_contacts

    list_contacts(source, unit, units, within, output)
