"""`stickslip verify`: verification problems, and the suites hard, accuracy and effects."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stickslip.geometry.errors import SceneError


def verify(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="cases [all]; or the suite: hard, accuracy, effects")
    ] = None,
    rows: Annotated[bool, typer.Option("--rows", help="print all figures, not only those that fail")] = False,
    random: Annotated[
        bool, typer.Option("--random", help="accuracy: of scenes drawn at random, instead of known problems")
    ] = False,
    number: Annotated[
        int | None, typer.Option("--number", help="hard: number of variations [2000]; random: of scenes [30]")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="hard: of their order and random numbers; random: of scenes")] = 0,
    scenes: Annotated[
        str, typer.Option("--scenes", metavar="NAME,NAME", help="suites: these scenes (effects) only; random: files")
    ] = "",
    budget: Annotated[
        float | None, typer.Option("--budget", help="random: seconds for the errors, in those of all else of a run")
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", help="suites: number of processes")] = 1,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="suites: write NAME.md, .png, .jsonl there")
    ] = None,
    again: Annotated[
        bool, typer.Option("--again", help="hard: of the run in DIR, judge again only what was not solved")
    ] = False,
    resume: Annotated[bool, typer.Option("--resume", help="hard: go on with the run in DIR that was ended")] = False,
) -> None:
    """Compare figures with closed forms and published values; or run a suite: hard, accuracy, effects."""
    from stickslip.workflows.lab.verification import registry
    from stickslip.workflows.lab.verification.accuracy.run import NUMBER, accuracy, random_accuracy
    from stickslip.workflows.lab.verification.effects.run import effects
    from stickslip.workflows.lab.verification.hard.run import NUMBER as VARIATIONS
    from stickslip.workflows.lab.verification.hard.run import hard

    only = [name for name in scenes.split(",") if name]
    for suite in ("hard", "accuracy", "effects"):
        if suite in (names or []) and names != [suite]:
            raise SceneError(f"verify {suite}: takes no other name beside it")
    if random and names != ["accuracy"]:
        raise SceneError("--random: goes with `verify accuracy` alone")
    if budget is not None and not random:
        raise SceneError("--budget: goes with --random alone")
    if names == ["hard"]:
        passed = hard(only, VARIATIONS if number is None else number, seed, jobs, output, again, resume)
    elif random:
        files = [Path(name) for name in only]
        passed = random_accuracy(NUMBER if number is None else number, seed, jobs, output, budget, files)
    elif names == ["accuracy"]:
        passed = accuracy(only, jobs, output)
    elif names == ["effects"]:
        passed = effects(only, output)
    else:
        passed = registry.verify(names or [], rows)
    if not passed:
        raise typer.Exit(1)
