"""The suite of effects: small scenes with an effect in the registry and with it taken out, and scenes that call for it.

Counters of work, Python calls and the bits of the answer are the same in every run; seconds are those of the processor,
medians of runs with and without the effect in turn, beside the same scene against itself.
"""

from __future__ import annotations

import gc
import hashlib
import sys
import time as clock
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

import stickslip
from stickslip.solvers import effects
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.simulation import prepare
from stickslip.workflows.lab.verification.effects.parts import EFFECTS, LAWS, SCENES, Part, Tables
from stickslip.workflows.scene_file.read import from_dict, read

ROOT = Path(stickslip.__file__).parent
BY_OTHERS = (
    "solvers/parallel/released.py",  # asked for every mesh that was in the process before
    "geometry/form_cache.py",  # looks at its folder again where another process has compiled a form
)
REPEATS = 3  # pairs of runs whose seconds are compared


@dataclass(frozen=True, kw_only=True)
class Work:
    """What a run has cost; its answer as a hash of all displacements and tractions."""

    forms: int  # compiled or loaded
    unknowns: int  # free displacements
    rows: int  # of the surface problem
    nonzeros: int  # of the stiffness matrix
    factorisations: int
    condensed: int  # order of the Schur complement
    volume_solves: int
    error_solves: int  # volume solves for estimates of errors
    iterations: int
    answer: str


@dataclass(frozen=True, kw_only=True)
class Absent:
    """A scene that does not call for an effect, with it in the registry and without."""

    scene: str
    with_it: Work
    without: Work
    calls: int  # of Python functions of stickslip
    asked: int  # of them, those that are left out without it
    idle: int  # of them, those of files that serve it alone
    seconds: float  # with it, by those without it


@dataclass(frozen=True, kw_only=True)
class Study:
    """An effect or a law: scenes without it; of laws none, for a contact has one law."""

    name: str
    absent: tuple[Absent, ...]
    base: str
    idle: int  # calls in the base of files that serve it alone
    before: Work  # of the base
    after: Work  # of the base that calls for it


@contextmanager
def taken_out(name: str) -> Iterator[None]:
    """The registry without an effect; the name of no effect leaves it as it is."""
    every = effects.EFFECTS
    holders = [m for key, m in sys.modules.items() if key.startswith("stickslip.") and vars(m).get("EFFECTS") is every]
    for module in holders:
        module.EFFECTS = tuple(effect for effect in every if effect.name != name)  # type: ignore[attr-defined]
    try:
        yield
    finally:
        for module in holders:
            module.EFFECTS = every  # type: ignore[attr-defined]


def work(scene: Scene) -> tuple[Work, float]:
    """Prepare and solve a scene: its work, and the seconds of the processor."""
    gc.collect()
    began = clock.process_time()
    simulation = prepare(scene)
    steps = list(simulation.steps())
    spent, system, counters = clock.process_time() - began, simulation.system, simulation.counters
    answer = b"".join(np.ascontiguousarray(a).tobytes() for step in steps for a in (step.displacement, step.p))
    return Work(
        forms=counters.forms,
        unknowns=system.constraints.free_total,
        rows=sum(len(c.W_n) + int(c.free.sum()) for c in system.contacts),
        nonzeros=int(system.K_B.getInfo()["nz_used"]),
        factorisations=counters.factorisations,
        condensed=counters.schur_size,
        volume_solves=counters.volume_solves,
        error_solves=counters.error_solves,
        iterations=sum(step.iterations for step in steps),
        answer=hashlib.sha256(answer).hexdigest()[:12],
    ), spent


def calls(scene: Scene) -> Counter[str]:
    """Calls of Python functions by file of stickslip, relative to its folder; those that other runs cause left out."""
    codes, found = Counter[str](), Counter[str]()

    def count(frame: FrameType, event: str, argument: Any) -> None:
        if event == "call":
            codes[frame.f_code.co_filename] += 1

    sys.setprofile(count)
    try:
        list(prepare(scene).steps())
    finally:
        sys.setprofile(None)
    for file, number in codes.items():
        if Path(file).is_relative_to(ROOT):
            found[Path(file).relative_to(ROOT).as_posix()] += number
    for file in BY_OTHERS:
        del found[file]
    return found


def absent(name: str, part: Part, scene_name: str, repeats: int) -> Absent:
    """A scene that does not call for an effect."""
    scene, ratios = from_dict(SCENES[scene_name]), []
    work(scene)  # compiles the forms
    with_it, counted = work(scene)[0], calls(scene)
    with taken_out(name):
        without, fewer = work(scene)[0], calls(scene)
    for _ in range(repeats):
        seconds = work(scene)[1]
        with taken_out(name):
            ratios.append(seconds / work(scene)[1])
    return Absent(
        scene=scene_name,
        with_it=with_it,
        without=without,
        calls=counted.total(),
        asked=counted.total() - fewer.total(),
        idle=sum(counted[file] for file in part.serves),
        seconds=float(np.median(ratios)) if ratios else float("nan"),
    )


def studied(name: str, scenes: Sequence[str] = tuple(SCENES), repeats: int = REPEATS) -> Study:
    """An effect or a law, `NAME` or `friction.NAME`, beside those of the scenes that do not call for it."""
    law = name.removeprefix("friction.")
    part = EFFECTS[name] if name in EFFECTS else LAWS[law]
    without = [scene for scene in scenes if name in EFFECTS and not _on(name, SCENES[scene])]
    base, called = SCENES[part.base], from_dict({**SCENES[part.base], **part.calls})
    assert name not in EFFECTS or (_on(name, {**base, **part.calls}) and not _on(name, base))
    work(called)
    return Study(
        name=name,
        absent=tuple(absent(name, part, scene, repeats) for scene in without),
        base=part.base,
        idle=sum(calls(from_dict(base))[file] for file in part.serves),
        before=work(from_dict(base))[0],
        after=work(called)[0],
    )


def _on(name: str, tables: Tables) -> bool:
    return any(row.on for row in make_plan(from_dict(tables)) if row.effect == name)


def noise(repeats: int = REPEATS) -> list[float]:
    """Seconds of the scenes by those of the same scenes, medians as those of effects."""
    nothing = Part(calls={})
    return [absent("", nothing, scene, repeats).seconds for scene in SCENES for _ in range(3)]


def schur() -> tuple[Work, Work]:
    """The ready scene `cube` at h = 1/16 without friction, and as it is."""
    cube = read("cube", ["geometry.mesh_size=0.0625"])
    smooth = replace(cube, contacts={"base": replace(cube.contacts["base"], friction=None)})
    return work(smooth)[0], work(cube)[0]
