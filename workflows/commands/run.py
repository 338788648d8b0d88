"""`stickslip run`: solve a scene and write its results."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from stickslip.workflows.commands.options import SceneArgument, SetOption
from stickslip.workflows.commands.process import BEGAN, complain, speaks


def run(
    scene: SceneArgument,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="results folder [results/NAME]")] = None,
    override: SetOption = None,
    resume: Annotated[bool, typer.Option("--resume", help="go on where an earlier run of it was stopped")] = False,
    accuracy: Annotated[
        list[str] | None,
        typer.Option("--accuracy", metavar="NUMBER=1%", help="refine until the error of a number is below this"),
    ] = None,
    budget: Annotated[float | None, typer.Option("--budget", metavar="SECONDS", help="for --accuracy [600]")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print result.json in place of the table")] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="say nothing but errors")] = False,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="one line an iteration")] = False,
) -> None:
    """Solve a scene and write its results."""
    from stickslip.workflows.accuracy import rounds
    from stickslip.workflows.accuracy.rounds import aiming
    from stickslip.workflows.commands._mesh import announce
    from stickslip.workflows.formats.files import json_text
    from stickslip.workflows.run.terminal import Reporter
    from stickslip.workflows.scene_file.read import find, named, read

    loaded = aiming(read(scene, override or ()), accuracy or (), budget)
    folder = output or Path("results") / find(scene).stem
    if not quiet and speaks():
        announce(loaded)
    reporter = Reporter(quiet=quiet or not speaks(), verbose=verbose)
    with reporter, named(scene, override or ()):
        outcome, content = rounds.run(loaded, folder, reporter.watch(), resume, began=BEGAN)
    if as_json:
        typer.echo(json_text(content))
    else:
        reporter.table(content)
        reporter.files(outcome)
    if outcome.sentence and speaks():
        again = ["stickslip", "run", scene, "-o", str(folder), *(f"--set={word}" for word in override or ())]
        again += [
            *(f"--accuracy={word}" for word in accuracy or ()),
            *([] if budget is None else [f"--budget={budget:g}"]),
        ]
        how = f"; go on with: {shlex.join([*again, '--resume'])}" if outcome.status == "interrupted" else ""
        complain(f"{outcome.status.replace('_', ' ')}: {outcome.sentence}{how}")
    sys.exit(outcome.exit_code)
