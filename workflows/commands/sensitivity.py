"""`stickslip sensitivity`: the numbers of a scene that its results depend on, and by how much."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from stickslip.workflows.commands.options import SceneArgument, SetOption
from stickslip.workflows.commands.process import say, speaks

WIDTH = 24  # letters of the longest bar


def sensitivity(
    scene: SceneArgument,
    quantity: Annotated[
        list[str] | None, typer.Option("--quantity", metavar="NAME", help="e.g. base.normal_force, energy.stored")
    ] = None,
    picture: Annotated[Path | None, typer.Option("--picture", metavar="FILE.png", help="draw them, too")] = None,
    check: Annotated[
        Path | None, typer.Option("--check", metavar="FOLDER", help="solve it with uncertain numbers a deviation away")
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", help="number of processes of these runs")] = 1,
    override: SetOption = None,
) -> None:
    """Show what the numbers of the last step depend on: derivatives by numbers of the scene, largest first."""
    from dataclasses import replace

    from stickslip.geometry.errors import require_known
    from stickslip.solvers.results.step_result import slope_columns, slopes_of, values
    from stickslip.solvers.scene.parameters import Sensitivity
    from stickslip.solvers.simulation.simulation import prepare
    from stickslip.workflows.pictures.tornado import draw_tornado, swings
    from stickslip.workflows.run.terminal import console, print_table, table_of
    from stickslip.workflows.scene_file.read import named, read
    from stickslip.workflows.sweep.true_runs import true_runs

    loaded = read(scene, override or ())
    for name in quantity or ():
        require_known("--quantity", name, loaded.quantities(), "no such quantity")
    asked = loaded if loaded.derived_by else replace(loaded, sensitivity=Sensitivity(parameters="all"))
    with named(scene, override or ()):
        *_, last = prepare(replace(asked, output=replace(asked.output, error=False))).steps()
    numbers, slopes, known = values(last), slopes_of(last), asked.parameters()
    chosen = tuple(quantity or [*(f"{contact}.normal_force" for contact in last.contacts), "energy.stored"])
    out, head = console(120, quiet=not speaks()), ("by", "derivative", "% by 1 %", "")
    for name, changes in ((name, swings(last, known).get(name, {})) for name in chosen):
        share = {
            by: slopes[name][by][0] * known[by] / numbers[name]
            for by in changes
            if slopes[name][by][0] == slopes[name][by][1] and numbers[name] != 0
        }
        most = max((max(map(abs, sides)) for sides in changes.values()), default=0.0)
        rows = [
            (
                by,
                " | ".join(f"{side:.6g}" for side in dict.fromkeys(slopes[name][by])),
                f"{share[by]:+.4f}" if by in share else "",
                "█" * round(WIDTH * max(map(abs, sides)) / most) if most > 0 else "",
            )
            for by, sides in changes.items()
        ]
        table = table_of(head, rows, ("by", ""))
        table.title, table.title_justify = f"{name} = {numbers[name]:.6g}", "left"
        print_table(table, out)
    if picture is not None and speaks():
        draw_tornado(picture, last, known, " ".join(asked.title.split()), chosen, asked.labels)
    if check is not None:
        runs, lies = true_runs(loaded, check, jobs), False
        columns = slope_columns(last)
        for name in chosen if speaks() else ():
            inputs, (low, high) = columns[f"{name}.uncertainty"], runs.spread(name, numbers[name])
            lies |= (lie := runs.doubts(name, numbers[name], inputs))
            by = f"{name}: ± {inputs:.3g} by derivatives, {low:+.3g} {high:+.3g} by {2 * len(runs.rows)} runs"
            say(by + (": the linear answer lies" if lie else ""))
        sys.exit(int(lies))
