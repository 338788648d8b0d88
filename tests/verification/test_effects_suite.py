"""The suite of effects: a small sibling passes, and its judge sees what is wrong."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from stickslip.geometry.dolfinx_versions import CACHE
from stickslip.geometry.errors import SceneError
from stickslip.solvers import effects as registry
from stickslip.solvers.laws import FrictionLaw
from stickslip.solvers.simulation.resolve import plan_rows
from stickslip.solvers.simulation.simulation import prepare
from stickslip.workflows.lab.verification.effects.page import Found, faults, write_page
from stickslip.workflows.lab.verification.effects.parts import EFFECTS, LAWS, SCENES
from stickslip.workflows.lab.verification.effects.run import effects
from stickslip.workflows.lab.verification.effects.suite import (
    ROOT,
    Absent,
    Study,
    Work,
    calls,
    studied,
    taken_out,
    work,
)
from stickslip.workflows.scene_file.read import from_dict

WORK = Work(
    forms=2,
    unknowns=10,
    rows=4,
    nonzeros=50,
    factorisations=1,
    condensed=4,
    volume_solves=3,
    error_solves=0,
    iterations=2,
    answer="a",
)
ABSENT = Absent(scene="held, 2D", with_it=WORK, without=WORK, calls=1000, asked=5, idle=10, seconds=1.0)
STUDY = Study(name="heat", absent=(ABSENT,), base="held, 2D", idle=0, before=WORK, after=replace(WORK, answer="b"))


def on(tables: dict[str, object]) -> set[str]:
    return {row.effect for row in plan_rows(from_dict(tables)) if row.on}


def names() -> set[str]:
    return {effect.name for effect in registry.EFFECTS}


def test_the_plan_says_what_each_effect_and_law_adds() -> None:
    of_laws = {"unilateral", "compliance", "bilateral", "tied"}  # the row of the law; contact has their words
    for name, part in EFFECTS.items():
        tables = {**SCENES[part.base], **part.calls}
        assert name in of_laws or {row.effect: row.adds for row in plan_rows(from_dict(tables))}[name]
    for name, part in LAWS.items():
        rows = {row.effect: row.adds for row in plan_rows(from_dict({**SCENES[part.base], **part.calls}))}
        assert rows["friction"].startswith(f"{name}: ")
        assert ("again until mu" in rows["friction"]) == (name in ("slip_dependent", "static_kinetic"))
        assert ("along its directions" in rows["friction"]) == name.startswith("orthotropic")


def test_every_effect_and_every_law_has_a_scene_that_calls_for_it() -> None:
    assert set(EFFECTS) == names()
    assert set(LAWS) == {law.law for law in FrictionLaw.kinds}
    for name, part in EFFECTS.items():
        assert on({**SCENES[part.base], **part.calls}) > on(SCENES[part.base]) - {"unilateral"}
        assert name not in on(SCENES[part.base])
    files = {file for part in (*EFFECTS.values(), *LAWS.values()) for file in part.serves}
    assert all((ROOT / file).is_file() for file in files)


@pytest.mark.parametrize(
    ("scene", "nth"),  # of the effects; each of them when there is time
    [("rubbing, 2D", 3), *(pytest.param(name, 1, marks=pytest.mark.slow) for name in ("rubbing, 2D", "held, 2D"))],
)
def test_a_scene_that_does_not_call_for_an_effect_pays_nothing_for_it(scene: str, nth: int) -> None:
    prepared = from_dict(SCENES[scene])
    (whole, _), every = work(prepared), names()
    off = every - on(SCENES[scene])
    assert len(off) > 10
    for name in sorted(off)[::nth]:
        with taken_out(name):
            assert names() == every - {name}
            assert work(prepared)[0] == whole
        assert names() == every


@pytest.mark.slow
@pytest.mark.parametrize("name", [*EFFECTS, *(f"friction.{law}" for law in LAWS)])
def test_the_whole_suite(name: str) -> None:
    study = studied(name, repeats=0)
    assert name.startswith("friction.") or study.absent
    assert not faults(Found(studies=[study], noise=[1.0]))


def test_calls_do_not_depend_on_what_ran_before_or_runs_beside() -> None:
    scene = from_dict(SCENES["held, 2D"])
    first = calls(scene)
    kept = [prepare(scene) for _ in range(3)]  # meshes that live on
    os.utime(CACHE)  # as another process does that compiles a form
    assert calls(scene) == first
    assert len(kept) == 3


def test_the_judge_sees_what_an_effect_costs(tmp_path: Path) -> None:
    def fault(study: Study, smooth: Work | None = None) -> str:
        return "; ".join(faults(Found(studies=[study], noise=[1.0], smooth=smooth, rubbing=smooth and WORK)))

    costly = replace(ABSENT, without=replace(WORK, forms=1, answer="c"))
    assert not fault(STUDY)
    assert "which does not call for it, has another forms, answer" in fault(replace(STUDY, absent=(costly,)))
    assert "asks 400 calls" in fault(replace(STUDY, absent=(replace(ABSENT, asked=400),)))
    assert "has the answer of the one that does not" in fault(replace(STUDY, after=WORK))
    assert "Schur complement" in fault(STUDY, smooth=WORK)
    page = tmp_path / "effects.md"
    write_page(page, Found(studies=[STUDY], noise=[0.98, 1.01]), "stickslip verify effects")
    assert "| heat | held, 2D | 0 | 5 | 1.0 % | 1.00 |" in page.read_text()


def test_an_unknown_effect_is_refused() -> None:
    with pytest.raises(SceneError, match=r"--scenes sprigs: no such effect or law; did you mean springs"):
        effects(["sprigs"])
