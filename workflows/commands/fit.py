"""`stickslip fit`: find numbers of a scene from a measured history."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from stickslip.workflows.commands.options import SceneArgument, SetOption
from stickslip.workflows.commands.process import complain, say, speaks


def fit(
    scene: SceneArgument,
    data: Annotated[Path, typer.Argument(metavar="DATA.csv", help="columns time, and numbers as in steps.csv")],
    vary: Annotated[str, typer.Option("--vary", metavar="KEY,KEY", help="e.g. contacts.base.friction.mu")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="folder [results/NAME_fit]")] = None,
    override: SetOption = None,
) -> None:
    """Find numbers of a scene for which its history fits a measured one, with what they are sure to."""
    from stickslip.workflows.formats.files import json_text, write_output
    from stickslip.workflows.pictures.history import draw_fit
    from stickslip.workflows.run.terminal import console, print_table, table_of
    from stickslip.workflows.scene_file.read import find, named, read
    from stickslip.workflows.sweep.fit import fit as fitted
    from stickslip.workflows.sweep.fit import read_data

    loaded, keys = read(scene, override or ()), [key.strip() for key in vary.split(",")]
    with named(scene, override or ()):
        found = fitted(loaded, read_data(data), keys, tell=lambda line: say(line) if speaks() else None)
    if not speaks():
        return
    folder = output or Path("results") / f"{find(scene).stem}_fit"
    told: dict[str, Any] = {"values": found.values, "deviations": found.deviations, "not_told": found.not_told}
    told |= {"covariance": found.covariance.tolist(), "remainder": found.remainder, "runs": found.runs}
    write_output(folder / "fit.json", json_text(told).encode())
    draw_fit(folder / "fit.png", found.data, found.found, " ".join(loaded.title.split()), loaded.labels)
    rows = [
        (key, f"{found.start[key]:.6g}", f"{value:.6g}", f"{size:.2g}", f"{abs(size / value):.2g}")
        for (key, value), size in zip(found.values.items(), found.deviations.values(), strict=True)
    ]
    print_table(table_of(("number", "start", "fitted", "± (k = 1)", "relative"), rows, ("number",)), console(120))
    for name, rest in found.remainder.items():
        say(f"{name}: {rest:.3g} left (root mean square)")
    say(f"{folder}: fit.json with the covariance, fit.png")
    if found.not_told:
        complain(f"the data do not tell {', '.join(found.not_told)}: leave them out, or measure what depends on them")
        sys.exit(1)
