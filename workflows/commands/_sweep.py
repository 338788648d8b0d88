"""Run a sweep for `stickslip sweep`: a line for each member as it ends, and a table of all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import monotonic
from typing import Any

from stickslip.geometry.errors import SceneError, shortened
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.commands.process import complain, say, speaks
from stickslip.workflows.formats.marker import read_checked_json
from stickslip.workflows.formats.results import legend
from stickslip.workflows.run.folder import RESULT, place_of
from stickslip.workflows.run.resume import FINISHED
from stickslip.workflows.run.terminal import (
    console,
    contact_cells,
    contact_numbers,
    print_table,
    table_of,
    time_left,
)
from stickslip.workflows.scene_file.read import value_of
from stickslip.workflows.sweep.sweep import Solved, Sweep, said, short, sweep

PROBLEM = {"doubtful": 1}  # exit codes, other than 3


def sweep_scene(scene: Scene, words: Sequence[str], files: Path, folder: Path, jobs: int, quiet: bool) -> int:
    """Solve the members, and say how they end; the exit code, 0 if all are solved.

    Args:
        files: the scene file's folder.

    Raises:
        SceneError: a key or a value is wrong.
    """

    began, fresh = monotonic(), 0  # of solving; members that this process has solved

    def tell(number: int, count: int, solved: Solved) -> None:
        nonlocal fresh
        fresh += solved.seconds is not None
        if speaks() and not quiet:
            left = time_left((monotonic() - began) / fresh * (count - number)) if fresh else ""
            say(f"{number:>{len(str(count))}}/{count}  {solved}{left}")

    def checked(number: int, count: int) -> None:
        nonlocal began
        began = monotonic()
        if speaks() and not quiet and number % 50 == 0:
            say(f"{number} of {count} members are checked")

    done = sweep(scene, _parsed(words), folder, jobs, tell, files, checked)
    if not speaks():
        return 0
    off = [one for one in done.solved if one.status != "converged"]
    if not quiet:
        _print(done, scene)
        say(f"{done.path}: a row for each of {len(done.solved)} members")
    if off:
        names = ", ".join(one.member.name for one in off[:5]) + (", ..." if len(off) > 5 else "")
        complain(f"{len(off)} of {len(done.solved)} members are not solved, or doubtful: {names}")
    return max((PROBLEM.get(one.status, 3) for one in off), default=0)


def _print(done: Sweep, scene: Scene) -> None:
    """The keys that are swept, and the main numbers of each contact in the last step of what is solved."""
    if not done.solved:  # other ranks
        return
    numbers, rows, notes = contact_numbers(scene.model, scene.labels), [], dict[str, None]()
    del numbers["max_penetration"]
    keys = short(list(done.solved[0].member.values))
    for one in done.solved:
        content = read_checked_json(place_of(one.folder) / RESULT) if one.status in FINISHED else {}
        steps = content.get("steps") or [{}]
        notes |= {legend(content): None} if content else {}
        values = [shortened(said(value), 24) for value in one.member.values.values()]
        for name, contact in (steps[-1].get("contacts") or {"-": None}).items():
            rows.append((*values, name, *contact_cells(contact, numbers)))
    out = console(160)
    print_table(table_of((*keys.values(), "contact", *numbers.values()), rows, ("contact",)), out)
    out.print("\n".join(notes), end="\n" * bool(notes), soft_wrap=True)


def _parsed(words: Sequence[str]) -> dict[str, Any]:
    """Values by key, from KEY=[VALUE, VALUE]."""
    found = dict[str, Any]()
    for word in words:
        key, equals, text = word.partition("=")
        if not equals or not key.strip():
            raise SceneError(f"sweep {shortened(word)}: expected KEY=[VALUE, VALUE], as solver.tolerance=[1e-6, 1e-8]")
        if key.strip() in found:
            raise SceneError(f"sweep {shortened(word)}: the key stands there twice")
        found[key.strip()] = value_of(text, f"sweep {shortened(word)}")
    return found
