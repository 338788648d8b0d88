"""`stickslip plan`: the effects of a scene, and what its numbers will cost, before it is solved."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from typing import Annotated, Any

import typer

from stickslip.workflows.commands.options import SceneArgument, SetOption
from stickslip.workflows.commands.process import speaks


def plan(
    scene: SceneArgument,
    override: SetOption = None,
    mesh: Annotated[bool, typer.Option("--mesh", help="mesh it too, and count")] = False,
    cost: Annotated[bool, typer.Option("--cost", help="tell what 10, 1, .1 % of its numbers will take")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="for scripts")] = False,
) -> None:
    """Say which effects a scene switches on, and why, without solving; with --cost from coarse versions of it."""
    from stickslip.solvers.simulation.memory import foretold
    from stickslip.solvers.simulation.plan import make_plan, warnings
    from stickslip.workflows.run.terminal import print_plan
    from stickslip.workflows.scene_file.read import named, read

    loaded = read(scene, override or ())
    with named(scene, override or ()):
        rows = make_plan(loaded)
    content: dict[str, Any] = {
        "title": loaded.title,
        "model": loaded.model,
        "units": loaded.units,
        "method": loaded.solver.method,
        "times": list(loaded.requested_times()),
        "effects": [asdict(row) for row in rows],
        "warnings": list(warnings(loaded)),
        "memory": None if mesh else foretold(loaded),
    }
    if mesh:
        from stickslip.workflows.commands._mesh import announce
        from stickslip.workflows.run.mesh_report import count

        if speaks():
            announce(loaded)
        with named(scene, override or ()):
            content["mesh"] = count(loaded)
        content["memory"] = content["mesh"].pop("memory")
    if speaks() and not as_json:
        print_plan(content)
    if cost:
        from stickslip.workflows.cost.foresee import Coarse, foresee
        from stickslip.workflows.cost.progress import print_prices

        def tell(one: Coarse) -> None:
            size = f"{one.unknowns} unknowns, {one.steps} steps: {one.seconds:.1f} s"
            print(f"solving coarse versions, for about ten seconds: {size}", file=sys.stderr, flush=True)

        with named(scene, override or ()):
            foreseen = foresee(loaded, on_coarse=tell)
        content["cost"] = [asdict(row) for row in foreseen]
        if speaks() and not as_json:
            print_prices(foreseen)
    if speaks() and as_json:
        typer.echo(json.dumps(content, indent=1, ensure_ascii=False))
