"""The suite of effects: small scenes with an effect in the registry and with it taken out, and scenes that call for it.

Counters of work, Python calls and the bits of the answer are the same in every run; seconds are those of the processor,
medians of runs with and without the effect in turn, beside the same scene against itself.

The effects and friction laws, each with the tables of a small scene that call for it.
"""

from __future__ import annotations

import gc
import hashlib
import sys
import time as clock
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

import stickslip
from stickslip import Scene, prepare, read
from stickslip.solvers import effects
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.scene_file.read import from_dict

Tables = dict[str, Any]
COULOMB = {"law": "coulomb", "mu": 0.3}
SOFT = {"law": "compliance", "c_n": 1e6, "m_n": 2.0}


def block(dim: int, pressed: float | str = -0.02) -> Tables:
    """A unit cube or square that its top holds, presses and shears; one step."""
    width = {"width": 1.0} if dim == 3 else {}
    top = dict.fromkeys("xyz"[:dim], 0.0) | {"x": 0.005, "xyz"[dim - 1]: pressed}
    return {
        "model": "3d" if dim == 3 else "plane strain",
        "geometry": {"builder": "block", "length": 1.0, "height": 1.0, "mesh_size": 0.25 if dim == 3 else 0.125}
        | width,
        "bodies": {"block": {"E": 1000.0, "nu": 0.3, "density": 1.0}},
        "supports": {"top": {"boundary": "block.top", "displacement": top}},
    }


def touching(dim: int, **contact: Any) -> Tables:
    """Overrides that put it on a floor."""
    floor = {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}
    base = {"surface": "block.bottom", "against": "floor", **contact}
    return {"obstacles": {"floor": floor}, "contacts": {"base": base}}


STEPS = {"steps": {"count": 3, "seconds": True}}
SCENES: Mapping[str, Tables] = {
    name: tables
    for dim in (2, 3)
    for name, tables in {
        f"held, {dim}D": block(dim),
        f"tilted, {dim}D": block(dim, "0.03*x-0.02") | touching(dim),
        f"rubbing, {dim}D": block(dim) | touching(dim, friction=COULOMB) | STEPS,
    }.items()
}


@dataclass(frozen=True, kw_only=True)
class Part:
    """Effect or law that a scene may call for."""

    calls: Tables  # what calls for it, beside or instead of tables of its base
    base: str = "rubbing, 2D"
    serves: tuple[str, ...] = ()  # files that serve it alone


LINKS = "solvers/fem/springs.py"
TWO_BLOCKS = {
    "geometry": {"builder": "two_blocks", "length": 1.0, "height": 1.0, "mesh_size": 0.125},
    "bodies": {name: block(2)["bodies"]["block"] for name in ("upper", "lower")},
    "obstacles": {},
    "contacts": {"base": {"surface": "upper.bottom", "against": "lower.top", "friction": COULOMB}},
    "supports": {
        "top": {"boundary": "upper.top", "displacement": block(2)["supports"]["top"]["displacement"]},
        "foot": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0}},
    },
}
SLIDING = TWO_BLOCKS | {"contacts": {"base": TWO_BLOCKS["contacts"]["base"] | {"sliding": True}}}
EFFECTS: Mapping[str, Part] = {
    "contact": Part(base="held, 2D", calls=touching(2), serves=("solvers/contact/coupling.py",)),
    "unilateral": Part(base="held, 2D", calls=touching(2)),
    "compliance": Part(base="tilted, 2D", calls=touching(2, normal=SOFT)),
    "bilateral": Part(base="tilted, 2D", calls=touching(2, normal={"law": "bilateral"})),
    "tied": Part(base="tilted, 2D", calls=touching(2, normal={"law": "tied"})),
    "friction": Part(base="tilted, 3D", calls=touching(3, friction=COULOMB)),
    "quasistatic": Part(base="held, 2D", calls=STEPS),
    "multibody": Part(calls=TWO_BLOCKS, serves=("solvers/contact/mortar.py", "solvers/contact/coupling.py")),
    "sliding": Part(calls=SLIDING, serves=("solvers/stepping/pairs.py",)),
    "slide": Part(calls=touching(2, friction=COULOMB, slide=0.02)),
    "wear": Part(calls=touching(2, friction=COULOMB, wear={"k": 1e-3})),
    "gravity": Part(calls={"gravity": {"acceleration": [0.0, -9.81]}}),
    "body_force": Part(calls={"body_force": {"block": {"force": ["sin(pi*x)", 0.0]}}}),
    "centrifugal": Part(calls={"centrifugal": {"speed": 1.0}}),
    "elastic_support": Part(calls={"elastic_support": {"wall": {"boundary": "block.left", "normal": 100.0}}}),
    "periodic": Part(calls={"periodic": {"walls": {"boundary": "block.right", "with": "block.left"}}}),
    "thermal": Part(
        calls={"thermal": {"block": {"expansion": 1e-4, "temperature": "10*y"}}},
        serves=("solvers/system/applied_loads.py",),
    ),
    "springs": Part(calls={"springs": {"wall": {"at": "block.left", "stiffness": [100.0, 0.0]}}}, serves=(LINKS,)),
    "bolts": Part(
        calls={
            "bolts": {"bolt": {
                "head": "block.right", "nut": "block.left", "axis": [1.0, 0.0], "stiffness": 100.0, "force": 3.0
            }}
        },
        serves=(LINKS, "solvers/stepping/tightening.py"),
    ),
    "remote_points": Part(
        calls={
            "remote_points": {
                "top": {
                    "boundary": "block.top", "point": [0.5, 2.0], "coupling": "rigid",
                    "displacement": {"x": 0.005, "y": -0.02}, "rotation": {"z": 0.0},
                }
            },
            "supports": {},
        },
        serves=("solvers/fem/remote_points.py",),
    ),
    "mean_dilatation": Part(
        calls={"bodies": {"block": {"E": 1000.0, "nu": 0.4999, "density": 1.0}}},
        serves=("solvers/fem/mean_dilatation.py",),
    ),
    "orthotropic": Part(
        calls={
            "bodies": {
                "block": {
                    "E_1": 1000.0, "E_2": 80.0, "E_3": 50.0, "G_12": 60.0, "nu_12": 0.4, "nu_13": 0.4, "nu_23": 0.4,
                    "axis_1": [2.0, 1.0], "density": 1.0,
                }
            }
        },
        serves=("solvers/scene/material.py", "solvers/metrics.py"),
    ),
    **{effect.name: Part(calls=dict(effect.example)) for effect in effects.EFFECTS if effect.example},
}  # fmt: skip

NEEDS: Tables = {"compliance": {"normal": SOFT}}  # laws that need more of the contact
RATE_AND_STATE = {"f0": 0.3, "a": 0.01, "b": 0.005, "Dc": 0.02, "V0": 0.1}
WEAKENS = ("solvers/laws/slip_dependent.py", "solvers/stepping/law_memory.py")
LAWS: Mapping[str, Part] = {
    law: Part(
        base=f"rubbing, {dim}D",
        calls=touching(dim, friction={"law": law, **keys}, **NEEDS.get(law, {})),
        serves=serves,
    )
    for law, dim, keys, serves in (
        ("coulomb", 2, {"mu": 0.2}, ()),
        ("tresca", 2, {"bound": [[0.0, 3.0]]}, ()),
        ("stick", 2, {}, ()),
        ("capped_coulomb", 2, {"mu": 0.3, "s_max": 3.0}, ()),
        ("compliance", 2, {"c_T": 100.0, "m_T": 1.0}, ()),
        ("cohesion", 2, {"a": 0.5, "mu": 0.2}, ()),
        ("pressure_dependent", 2, {"mu": [[0.0, 0.4], [40.0, 0.2]]}, ("solvers/laws/pressure_dependent.py",)),
        ("slip_dependent", 2, {"mu": [[0.0, 0.3], [0.02, 0.2]]}, WEAKENS),
        ("rate_dependent", 2, {"mu": [[0.0, 0.2], [0.1, 0.3]]}, ("solvers/laws/rate_dependent.py",)),
        ("rate_and_state", 2, RATE_AND_STATE, ("solvers/laws/rate_and_state.py",)),
        ("static_kinetic", 2, {"mu_s": 0.3, "mu_k": 0.2, "slip_length": 0.02}, WEAKENS),
        ("orthotropic_coulomb", 3, {"mu_1": 0.3, "mu_2": 0.1, "axis": [1.0, 0.0, 0.0]}, ()),
    )
}  # fmt: skip


ROOT = Path(stickslip.__file__).parent
BY_OTHERS = (
    "solvers/parallel/released.py",  # asked for every mesh that was in the process before
    "geometry/form_cache.py",  # looks at its folder again where another process has compiled a form
)
REPEATS = 3  # pairs of runs whose seconds are compared


@dataclass(frozen=True, kw_only=True)
class Work:
    """Work of a run; its answer as a hash of all displacements and tractions."""

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
    """The ready scene `cube` at h = 1/16 in the condensed form, without friction and as it is."""
    cube = read("cube", ["geometry.mesh_size=0.0625", "solver.surface='condensed'"])
    smooth = replace(cube, contacts={"base": replace(cube.contacts["base"], friction=None)})
    return work(smooth)[0], work(cube)[0]
