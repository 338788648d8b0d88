"""`stickslip sensitivity`: the numbers of a scene that its results depend on, and by how much."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from stickslip.workflows.commands.options import SceneArgument, SetOption
from stickslip.workflows.commands.process import BEGAN, complain, say, speaks

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
    from tempfile import TemporaryDirectory

    import numpy as np
    from mpi4py import MPI

    from stickslip.geometry.errors import require_known
    from stickslip.solvers.results.step_result import StepResult, names_of, slope_columns, slopes_of, walk
    from stickslip.solvers.scene.parameters import Sensitivity
    from stickslip.workflows.formats.plus_minus import error_of, of_parts
    from stickslip.workflows.pictures.tornado import draw_tornado, swings
    from stickslip.workflows.run.ranks import from_rank_0
    from stickslip.workflows.run.run import run
    from stickslip.workflows.run.terminal import Reporter, console, print_table, table_of
    from stickslip.workflows.scene_file.read import named, read
    from stickslip.workflows.sweep.true_runs import true_runs

    loaded = read(scene, override or ())
    for name in quantity or ():
        require_known("--quantity", name, loaded.quantities(), "no such quantity")
    asked = loaded if loaded.derived_by else replace(loaded, sensitivity=Sensitivity(parameters="all"))
    asked, steps = replace(asked, output=replace(asked.output, pictures=False)), list[StepResult]()
    reporter = Reporter(quiet=not speaks(), verbose=False)
    watch = replace(reporter.watch(), kept="")

    def keep(step: StepResult) -> None:
        steps[:] = [step.without_fields()]
        watch.on_step(step)

    with TemporaryDirectory() as own, reporter, named(scene, override or ()):
        place = Path(from_rank_0(MPI.COMM_WORLD, lambda: own)) / "run"
        outcome, content = run(asked, place, replace(watch, on_step=keep), began=BEGAN)
    reporter.line(*(f"warning: {warning}" for warning in outcome.warnings))
    solved, code = outcome.status in ("converged", "doubtful"), outcome.exit_code
    runs = true_runs(loaded, check, jobs) if check is not None and solved else None
    if solved and speaks():
        (last,), told, known, out = steps, content["steps"][-1], asked.parameters(), console(120)
        every, slopes, inputs = {key: value for key, _, value in walk(last)}, slopes_of(last), slope_columns(last)
        flat = {name: (key, axis) for key, value in every.items() for name, axis in names_of(key, value)}
        chosen = tuple(quantity or [*(f"{contact}.normal_force" for contact in last.contacts), "energy.stored"])
        moved = swings(last, known)
        for name in chosen:
            key, axis = flat[name]
            number = float(np.ravel(every[key])[axis or 0])
            most = max((max(map(abs, sides)) for sides in moved.get(name, {}).values()), default=0.0)
            rows = list[tuple[str, ...]]()
            for by, sides in moved.get(name, {}).items():
                both = dict.fromkeys(slopes[name][by])  # one, or two
                share = f"{next(iter(both)) * known[by] / number:+.4f}" if len(both) == 1 and number != 0 else ""
                bar = "█" * round(WIDTH * max(map(abs, sides)) / most) if most > 0 else ""
                rows.append((by, " | ".join(f"{side:.6g}" for side in both), share, bar))
            table = table_of(("by", "derivative", "% by 1 %", ""), rows, ("by", ""))
            owner = told[key.kind][key.name] if key.name else told[key.kind]
            said = of_parts(number, error_of(owner, key.quantity, axis))
            table.title, table.title_justify = f"{name} = {said}", "left"
            print_table(table, out)
            if runs is not None:
                size, (low, high) = inputs[f"{name}.uncertainty"], runs.spread(name, number)
                lies = runs.doubts(name, number, size)
                code = code or int(lies)
                said = f"± {size:.3g} by derivatives, {low:+.3g} {high:+.3g} by {2 * len(runs.rows)} runs"
                say(f"{name}: {said}{': the linear answer lies' if lies else ''}")
        if picture is not None:
            draw_tornado(picture, last, known, " ".join(asked.title.split()), chosen, asked.labels)
    if outcome.sentence:
        complain(f"{outcome.status.replace('_', ' ')}: {outcome.sentence}")
    sys.exit(code)
