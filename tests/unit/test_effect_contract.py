"""An effect that adds stiffness: an elastic bedding under a side, as a new file would bring it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import pytest
from jsonschema import Draft202012Validator
from numpy.testing import assert_allclose

from shared.audited import audit
from stickslip.geometry.dolfinx_versions import ufl
from stickslip.geometry.errors import SceneError
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import UflExpr, UflForm
from stickslip.solvers import effects
from stickslip.solvers.effects.effect import Effect, Equilibrium
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.results.step_result import told, values
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.record import Number
from stickslip.solvers.scene.scene import EffectTable, Scene
from stickslip.solvers.scene.timeline import Timeline
from stickslip.solvers.simulation import resolve
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.formats.files import json_text
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.run.result import result_schema
from stickslip.workflows.scene_file.read import from_dict

K, E, MOVED = 500.0, 1000.0, -0.03


@dataclass(frozen=True, kw_only=True)
class Bedding(EffectTable):
    """Springs under a side."""

    boundary: Annotated[str, Key("-", "side, as body.side")]
    k: Annotated[float, Key("Pa/m", "stiffness of the springs, in every direction")]

    def check(self, scene: Scene, key: str) -> None:
        scene.require_side(self.boundary, f"{key}.boundary")


class _Bedding(Effect):
    name = "bedding"
    table = Mapping[str, Bedding]

    def stiffness(self, problem: Problem, weak: WeakForms, u: UflExpr) -> Iterable[UflForm]:
        for table in problem.tables["bedding"].values():
            yield weak.constant(table.k) * ufl.inner(u, weak.v) * weak.boundary(table.boundary)

    def columns(self, problem: Problem, timeline: Timeline, time: float) -> Mapping[str, float]:
        return {"bedding.k": problem.tables["bedding"]["floor"].k}


class Weight(NamedTuple):
    """What a step reports of it."""

    force: Annotated[float, Number("N", "of all bodies", words="weight")]


@dataclass(frozen=True, kw_only=True)
class Scales(EffectTable):
    """A table without names."""

    reports = Weight

    factor: Annotated[float, Key("-", "of the stored energy")]


class _Scales(Effect):
    name = "scales"
    table = Scales

    def read(self, reached: Equilibrium) -> Mapping[str, Weight]:
        return {"": Weight(reached.problem.tables["scales"].factor)}


KINDS = {name: EffectTable.kinds.pop(name) for name in ("bedding", "scales")}  # known here alone


@pytest.fixture(autouse=True)
def bedding(monkeypatch: pytest.MonkeyPatch) -> None:
    every = (*effects.EFFECTS, _Bedding(), _Scales())
    monkeypatch.setattr(EffectTable, "kinds", EffectTable.kinds | KINDS)
    for module in (effects, resolve):
        monkeypatch.setattr(module, "EFFECTS", every)


def on_springs(supports: dict[str, dict[str, object]], boundary: str = "block.bottom") -> Scene:
    """A block 2 x 1, nu = 0, on springs under its base."""
    scene = from_dict(
        {
            "model": "plane strain",
            "geometry": {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5},
            "bodies": {"block": {"E": E, "nu": 0.0}},
            "supports": supports,
        }
    )
    return replace(scene, sections={"bedding": {"floor": Bedding(boundary=boundary, k=K)}})


LID = {"lid": {"boundary": "block.top", "displacement": {"x": 0.0, "y": MOVED}}}  # alone it moves the block as a whole
WALLS = LID | {"walls": {"boundary": "block.left", "displacement": {"x": 0.0}}}


@pytest.mark.parametrize("supports", [LID, WALLS], ids=["a rigid motion prescribed", "more than that"])
def test_springs_enter_forces_energy_and_audit(supports: dict[str, dict[str, object]]) -> None:
    """Springs in series with the block: k E/h / (k + E/h) per area."""
    simulation = prepare(on_springs(supports))
    (step,) = simulation.steps()
    stiffness = 2.0 * K * E / (K + E)
    assert_allclose(step.supports["lid"].force[1], stiffness * MOVED, rtol=1e-10)
    assert step.energy.stored == pytest.approx(stiffness * MOVED**2 / 2, rel=1e-10)
    assert step.energy.external == pytest.approx(step.energy.stored, rel=1e-10)
    assert step.columns == {"bedding.k": K}
    assert max(audit(simulation, step).values()) < 1e-10


def test_a_table_without_names_reports_one_record() -> None:
    found = replace(on_springs(LID), scales=Scales(factor=3.0))  # type: ignore[call-arg]
    assert "scale.force" in found.quantities()
    weighed, other = (next(prepare(each).steps()) for each in (found, on_springs(LID)))
    assert (values(weighed)["scale.force"], weighed.scales[""].force, other.scales) == (3.0, 3.0, {})
    lines = [json.loads(json_text(told(step, None))) for step in (weighed, other)]
    assert [line["scales"] for line in lines] == [{"force": 3.0, "error": None}, None]
    schema = Draft202012Validator({"$ref": "#/$defs/StepRecord", "$defs": result_schema()["$defs"]})
    for line in lines:
        schema.validate(line | {"audit": None})


def test_the_plan_names_it_and_its_table() -> None:
    (row,) = (row for row in make_plan(on_springs(LID)) if row.effect == "bedding")
    assert (row.on, row.because) == (True, "bedding.floor")


def test_springs_alone_hold_no_body() -> None:
    slides = {"lid": {"boundary": "block.top", "displacement": {"y": MOVED}}}
    walls = {"walls": {"boundary": "block.left", "displacement": {"x": 0.0}}}
    make_plan(on_springs(slides | walls))
    with pytest.raises(SceneError, match=r"supports: nothing resists|bedding: needs bodies that their supports hold"):
        make_plan(on_springs(slides))


def test_its_own_check_refuses_a_wrong_side() -> None:
    with pytest.raises(SceneError, match=r"bedding\.floor\.boundary = block\.botom: no such side; did you mean"):
        on_springs(LID, "block.botom")
