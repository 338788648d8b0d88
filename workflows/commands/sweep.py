"""`stickslip sweep`: solve a scene with many values of some keys."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from stickslip.workflows.commands.options import SceneArgument, SetOption


def sweep(
    scene: SceneArgument,
    over: Annotated[
        list[str], typer.Argument(metavar="KEY=[VALUES]...", help="e.g. contacts.base.friction.mu=[0.1, 0.2, 0.3]")
    ],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="results folder [results/NAME_sweep]")] = None,
    jobs: Annotated[int, typer.Option("--jobs", help="number of processes; under mpirun the ranks are taken")] = 1,
    override: SetOption = None,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="say nothing but errors")] = False,
) -> None:
    """Solve a scene with many values of some keys; what is solved already is not solved again."""
    from stickslip.workflows.commands._sweep import sweep_scene
    from stickslip.workflows.scene_file.read import find, named, read

    loaded = read(scene, override or ())
    with named(scene, override or ()):
        path = find(scene)
        folder = output or Path("results") / f"{path.stem}_sweep"
        code = sweep_scene(loaded, over, path.parent, folder, jobs, quiet)
    sys.exit(code)
