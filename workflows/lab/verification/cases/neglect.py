"""What the neglect report says of effects that are off, against the same scenes with them on.

Where a property lacks, the effect is turned on with the value at which a main number is said to change by 1 %; the
largest true change of forces and energy is held against what is said.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

from stickslip import Scene, Wear
from stickslip.solvers.results.step_result import StepResult, values
from stickslip.workflows.lab.verification.check import ONE, Check, problem, within
from stickslip.workflows.lab.verification.prepared import solved
from stickslip.workflows.run.neglect import GRAVITY, REACHED, Neglected, neglected
from stickslip.workflows.run.warnings import Fields, Seen
from stickslip.workflows.scene_file.read import read, with_keys

ASIDE = ("geometry.order=1", "steps.count=2")
On = Callable[..., Scene]


def _weight(scene: Scene, density: float, *_: float) -> Scene:
    acceleration = [0.0] * (scene.dim - 1) + [-GRAVITY]
    heavy = {f"bodies.{name}.density": density for name in scene.bodies}
    return with_keys(scene, heavy | {"gravity.acceleration": acceleration})


def _warm(body: str) -> On:
    return lambda scene, strain, *_: with_keys(scene, {f"thermal.{body}": {"expansion": strain, "temperature": 1.0}})


def _wearing(scene: Scene, k: float, *_: float) -> Scene:
    return replace(scene, contacts={name: replace(c, wear=Wear(k=k)) for name, c in scene.contacts.items()})


def _rubbing(contact: str) -> On:
    key = f"contacts.{contact}.friction.mu"
    return lambda scene, more, *_: with_keys(scene, {key: scene.parameters()[key] + more})


CASES: tuple[tuple[str, tuple[str, ...], Mapping[str, On]], ...] = (
    ("block", (), {"gravity": _weight, "thermal expansion": _warm("block"), "friction by rate": _rubbing("base")}),
    ("two_blocks", (), {"thermal expansion": _warm("lower"), "friction by rate": _rubbing("joint")}),
    ("ring", ASIDE, {"gravity": _weight, "thermal expansion": _warm("ring"), "friction by rate": _rubbing("outside")}),
    ("shaft", (), {"wear": _wearing, "thermal expansion": _warm("ring"), "friction by rate": _rubbing("bore")}),
    ("shrink_fit", ASIDE, {"facets": lambda scene, *_: with_keys(scene, {"geometry.order": 2})}),
)


def said(scene: Scene) -> tuple[StepResult, dict[str, Neglected]]:
    """The last step of a scene, and the report on it by effect."""
    simulation, steps = solved(scene)
    fields = Fields(simulation.problem, simulation.data, simulation.system.contacts, Seen(), None)
    for step in steps:
        fields.see(step)
    assert simulation.reported is not None
    found = neglected(simulation, steps, simulation.reported.state, fields.seen, None)
    return steps[-1], {row.effect: row for row in found}


def changed(before: StepResult, after: StepResult, names: Collection[str]) -> float:
    """Largest relative change of forces and stored energy, of these numbers."""
    one, two = values(before), values(after)
    main = [key for key in names if key.endswith(("normal_force", "tangential_force", "energy.stored")) and one[key]]
    return max(abs(two[key] / one[key] - 1) for key in main)


@problem("what is said of effects that are off, against the same scenes with them on", ONE, slow=ONE)
def checks(method: str) -> list[Check]:
    """Estimated over true change of each effect, within .3 and 3."""
    found = list[Check]()
    for name, settings, effects in CASES:
        scene = read(name, settings)
        last, report = said(scene)
        for effect, on in effects.items():
            row, known = report[effect], values(last)
            sizes = [size / abs(known[key]) for key, size in row.changes.items() if not key.endswith("max_pressure")]
            reaches = [value for key, value in row.reaches.items() if "bodies.upper" not in key]
            estimated = REACHED if reaches else max(sizes)
            true = changed(last, solved(on(scene, *reaches, 0.0))[1][-1], [*row.changes] or [*known])
            found.append(within(f"{name}: {effect}, estimated over true", estimated / true, 0.3, 3.0))
    return found
