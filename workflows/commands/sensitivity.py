"""`stickslip sensitivity`: the numbers of a scene that its results depend on, and by how much."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from stickslip.workflows.commands.options import SceneArgument, SetOption
from stickslip.workflows.commands.process import BEGAN, complain, speaks

WIDTH = 24  # letters of the longest bar


def sensitivity(
    scene: SceneArgument,
    quantity: Annotated[
        list[str] | None, typer.Option("--quantity", metavar="NAME", help="e.g. base.normal_force, energy.stored")
    ] = None,
    override: SetOption = None,
) -> None:
    """Show what the numbers of the last step depend on: derivatives by numbers of the scene, largest first."""
    from dataclasses import replace
    from math import isfinite
    from pathlib import Path
    from tempfile import TemporaryDirectory

    import numpy as np
    from mpi4py import MPI

    from stickslip.geometry.errors import require_known
    from stickslip.solvers.results.step_result import StepResult, names_of, slope_columns, walk
    from stickslip.solvers.scene.parameters import Sensitivity
    from stickslip.workflows.formats.plus_minus import of_parts, parts_of
    from stickslip.workflows.run.ranks import from_rank_0
    from stickslip.workflows.run.run import run
    from stickslip.workflows.run.terminal import Reporter, console, print_table, table_of
    from stickslip.workflows.scene_file.read import named, read

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
    if outcome.status in ("converged", "doubtful") and speaks():
        (last,), told, known, out = steps, content["steps"][-1], asked.parameters(), console(120)
        every, slopes = {key: value for key, _, value in walk(last)}, slope_columns(last)
        flat = {name: (key, axis) for key, value in every.items() for name, axis in names_of(key, value)}
        for name in quantity or [f"{contact}.normal_force" for contact in last.contacts] + ["energy.stored"]:
            key, axis = flat[name]
            number = float(np.ravel(every[key])[axis or 0])
            found = {by.partition(".sensitivity.")[2]: x for by, x in slopes.items() if by.startswith(f"{name}.sens")}
            single = {by: slope for by, slope in found.items() if isfinite(slope)}
            share = {by: slope * known[by] / number for by, slope in single.items() if number != 0}
            order, most = (
                sorted(found, key=lambda by: -abs(share.get(by, 0.0))),
                max(map(abs, share.values()), default=0.0),
            )
            bars = {by: "█" * round(WIDTH * abs(x) / most) if most > 0 else "" for by, x in share.items()}
            said = {by: f"{single[by]:.6g}" if by in single else "two sides, or none" for by in order}
            rows = [(by, said[by], f"{share[by]:+.4f}" if by in share else "", bars.get(by, "")) for by in order]
            table = table_of(("by", "derivative", "% by 1 %", ""), rows, ("by", ""))
            owner = told[key.kind][key.name] if key.name else told[key.kind]
            error = parts_of((owner.get("error") or {}).get(key.quantity), axis)
            table.title, table.title_justify = f"{name} = {of_parts(number, error)}", "left"
            print_table(table, out)
    if outcome.sentence:
        complain(f"{outcome.status.replace('_', ' ')}: {outcome.sentence}")
    sys.exit(outcome.exit_code)
