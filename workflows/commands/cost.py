"""`stickslip cost`: what accuracy costs in time."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from stickslip.workflows.commands.options import SceneArgument, SetOption
from stickslip.workflows.commands.process import complain, say


def cost(
    scene: SceneArgument,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="results folder [results/NAME_cost]")] = None,
    budget: Annotated[float, typer.Option("--budget", metavar="SECONDS", help="for all runs together")] = 300.0,
    quantity: Annotated[
        list[str] | None, typer.Option("--quantity", metavar="NAME", help="e.g. base.normal_force, energy.stored")
    ] = None,
    methods: Annotated[
        str | None,
        typer.Option(
            "--methods",
            metavar="NAME,NAME",
            help="lay these side by side on the same meshes; NAME+KEY=VALUE sets a key",
        ),
    ] = None,
    override: SetOption = None,
    resume: Annotated[bool, typer.Option("--resume", help="go on with the runs of an earlier study")] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="say nothing but the sentence")] = False,
) -> None:
    """Show what accuracy costs in time: mesh sizes, orders, methods, tolerances."""
    from stickslip.workflows.cost import command
    from stickslip.workflows.cost.progress import Teller
    from stickslip.workflows.scene_file.read import find, named, read

    loaded = read(scene, override or ())
    folder = output or Path("results") / f"{find(scene).stem}_cost"
    with named(scene, override or ()):
        beside = [name.strip() for name in methods.split(",")] if methods is not None else []
        answer = command.cost(loaded, folder, budget, quantity or (), resume, Teller(budget, quiet), beside)
    say(answer.sentence)
    if answer.complaint:
        complain(answer.complaint)
    sys.exit(answer.exit_code)
