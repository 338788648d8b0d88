"""`stickslip sensitivity`: the numbers of a scene that its results depend on, and by how much."""

from __future__ import annotations

from typing import Annotated

import typer

from stickslip.workflows.commands.options import SceneArgument, SetOption
from stickslip.workflows.commands.process import speaks

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

    from stickslip.geometry.errors import require_known
    from stickslip.solvers.results.step_result import slope_columns, values
    from stickslip.solvers.scene.parameters import Sensitivity
    from stickslip.solvers.simulation.simulation import prepare
    from stickslip.workflows.run.terminal import console, print_table, table_of
    from stickslip.workflows.scene_file.read import named, read

    loaded = read(scene, override or ())
    for name in quantity or ():
        require_known("--quantity", name, loaded.quantities(), "no such quantity")
    asked = loaded if loaded.derived_by else replace(loaded, sensitivity=Sensitivity(parameters="all"))
    with named(scene, override or ()):
        *_, last = prepare(replace(asked, output=replace(asked.output, error=False))).steps()
    numbers, slopes, known = values(last), slope_columns(last), asked.parameters()
    out, head = console(120, quiet=not speaks()), ("by", "derivative", "% by 1 %", "")
    for name in quantity or [f"{contact}.normal_force" for contact in last.contacts] + ["energy.stored"]:
        found = {key.partition(".sensitivity.")[2]: x for key, x in slopes.items() if key.startswith(f"{name}.sens")}
        single = {by: slope for by, slope in found.items() if isfinite(slope)}
        share = {by: slope * known[by] / numbers[name] for by, slope in single.items() if numbers[name] != 0}
        order, most = sorted(found, key=lambda by: -abs(share.get(by, 0.0))), max(map(abs, share.values()), default=0.0)
        bars = {by: "█" * round(WIDTH * abs(x) / most) if most > 0 else "" for by, x in share.items()}
        said = {by: f"{single[by]:.6g}" if by in single else "two sides, or none" for by in order}
        rows = [(by, said[by], f"{share[by]:+.4f}" if by in share else "", bars.get(by, "")) for by in order]
        table = table_of(head, rows, ("by", ""))
        table.title, table.title_justify = f"{name} = {numbers[name]:.6g}", "left"
        print_table(table, out)
