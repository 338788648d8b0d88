"""Effects that are left out, hard scenes and other units change what they should."""

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from math import cos, radians, sin, tan
from pathlib import Path
from typing import Any

import pytest
from matplotlib.text import Text
from numpy.testing import assert_allclose

from shared.assemblies import bolted, stacked, write_assembly
from shared.cases import often, slow
from shared.command import COARSE, Call, assert_one_line, assert_said, ended, output_of, result
from shared.drawn import draw, scene_data
from shared.histories import FOUR, SMALL
from shared.solved import ZERO, Solved, coarse, solve
from stickslip.geometry.errors import SceneError
from stickslip.geometry.units import SI, Units
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.loads import Support
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.stepping.stepper import NoEquilibriumError, StepError
from stickslip.workflows.cost.pictures import draw_methods
from stickslip.workflows.formats.results import read_results
from stickslip.workflows.lab.verification.hard import judge as judging
from stickslip.workflows.lab.verification.hard.judge import Outcome, judge
from stickslip.workflows.lab.verification.hard.tables import toml
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.pictures.sheet import Sheet
from stickslip.workflows.run.folder import work_of
from stickslip.workflows.run.run import run
from stickslip.workflows.run.terminal import Reporter
from stickslip.workflows.scene_file.identity import DECIDES_NOTHING, identity
from stickslip.workflows.scene_file.read import from_dict, read, to_dict


@pytest.fixture(scope="module")
def with_everything() -> Scene:
    """Gravity, compliance, friction; no error of a body without loads, whose scale is rounding."""
    return read("foundation", [*coarse("foundation"), "output.error=false"])


def test_contact_without_friction_has_no_tangential_unknowns(tmp_path: Path) -> None:
    block = read("block", coarse("block"))
    rubbing = solve(block, tmp_path / "with").result
    bare = replace(block, contacts={"base": replace(block.contacts["base"], friction=None)})
    smooth = solve(bare, tmp_path / "without").result
    assert rubbing["counters"]["unknowns"]["tangential"] > 0
    assert smooth["counters"]["unknowns"]["tangential"] == 0
    assert smooth["counters"]["unknowns"]["normal"] == rubbing["counters"]["unknowns"]["normal"]
    assert smooth["counters"]["forms"] <= rubbing["counters"]["forms"]
    for step in smooth["steps"]:
        base = step["contacts"]["base"]
        assert base["tangential_force"] == base["dissipation"] == 0
    assert {row["effect"] for row in rubbing["plan"] if row["on"]} - {
        row["effect"] for row in smooth["plan"] if row["on"]
    } == {"friction"}


def test_scene_without_contact_condenses_and_searches_nothing(tmp_path: Path) -> None:
    block = read("block", coarse("block"))
    supports = {**block.supports, "base": Support(boundary="block.bottom", displacement={"y": 0.0})}
    plain = solve(replace(block, contacts={}, obstacles={}, supports=supports), tmp_path / "out")
    counters = plain.result["counters"]
    assert (counters["schur_size"], counters["searches"]) == (0, 0)
    assert counters["unknowns"]["normal"] == counters["unknowns"]["tangential"] == 0
    assert plain.result["contact_points"] == 0
    assert counters["factorisations"] == 1  # for both steps
    assert counters["volume_solves"] == sum(step["volume_solves"] for step in plain.result["steps"])
    assert all(step["iterations"] == 0 for step in plain.result["steps"])  # linear: nothing to iterate
    assert not list(plain.folder.glob("contact_*"))
    assert [row["effect"] for row in plain.result["plan"] if row["on"]] == ["quasistatic"]
    assert all(step["contacts"] == {} and step["audit"]["equilibrium"] <= ZERO for step in plain.result["steps"])


def test_audit_finds_nothing_in_a_body_that_moves_as_a_whole(tmp_path: Path) -> None:
    block = read("block", coarse("block"))
    moved = solve(
        replace(block, contacts={}, obstacles={}), tmp_path / "out"
    )  # its top moves it, nothing else holds it
    assert max(moved.result["audit"].values()) <= ZERO


def test_each_pair_of_bodies_is_searched_once_and_rigid_obstacles_never(solved: Solved) -> None:
    pairs = [c for c in solved.scene.pairs.values() if c.against not in solved.scene.obstacles]
    searches = solved.result["counters"]["searches"]
    if any(c.sliding for c in pairs):
        assert searches > len(solved.result["steps"]) * len(pairs)
    else:
        assert searches == len(pairs)


def test_volume_is_prepared_once_whatever_the_number_of_steps(tmp_path: Path) -> None:
    block = read("block", [*coarse("block"), "steps.count=6"])
    counters = solve(block, tmp_path / "out").result["counters"]
    assert counters["factorisations"] == 1


def test_each_effect_taken_away_takes_its_forms_along(with_everything: Scene, tmp_path: Path) -> None:
    def forms(scene: Scene, name: str) -> int:
        return int(solve(scene, tmp_path / name).result["counters"]["forms"])

    light = replace(with_everything, sections={})
    held = {"wall": read("block").supports["top"]}
    free = replace(light, contacts={}, obstacles={}, supports=held, exact=replace(light.exact, values={}))
    counted = [forms(with_everything, "everything"), forms(light, "no gravity"), forms(free, "no contact")]
    assert counted[0] > counted[1] >= counted[2] > 0  # gravity is a form; a rigid obstacle is matrix rows, not forms


def test_an_audit_that_is_left_out_compiles_nothing_and_is_null(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    block = read("block", coarse("block"))
    audited = solve(block, tmp_path / "with").result

    def built(*_: object) -> None:
        raise AssertionError("an auditor was built")

    monkeypatch.setattr("stickslip.workflows.run.audit.Auditor", built)
    silent = solve(replace(block, output=replace(block.output, audit=False)), tmp_path / "without").result
    assert silent["counters"].pop("forms") < audited["counters"].pop("forms")
    assert silent["counters"] == audited["counters"]
    assert {step["audit"] for step in silent["steps"]} == set(silent["audit"].values()) == {None}
    assert silent["audit"].keys() == audited["audit"].keys()
    for content in (audited, silent):
        Reporter(quiet=False, verbose=False).table(content)
    shown = capsys.readouterr().out
    assert shown.count("audit (relative defects): equilibrium") == 1
    assert shown.count("audit: left out, output.audit = false") == 1


ARCH = [f"bodies.{name}.nu=0.4999" for name in to_dict(read("arch"))["bodies"]]
STACK = ["geometry.mesh_size=0.14", *(f"bodies.block_{k}.nu=0.4999" for k in range(1, 11))]
AT_ONCE = "steps={end=1.0,count=1}"


def solved(name: str, overrides: Sequence[str]) -> StepResult:
    """The last step of a ready scene."""
    *_, last = prepare(read(name, overrides)).steps()
    return last


def on_a_slope(angle: float, mu: float, size: float) -> list[str]:
    """`block`, held on a slope by friction alone; angle in degrees."""
    g = [sin(radians(angle)), -cos(radians(angle))]
    return [
        *("supports={}", "bodies.block={E=1e6,nu=0.3,density=2000.0}", f"gravity={{acceleration={g}}}", AT_ONCE),
        *(f"contacts.base.friction.mu={mu}", f"geometry.mesh_size={size}", f"geometry.contact_mesh_size={size}"),
    ]


def lifted(force: float) -> list[str]:
    """`block` with a weight of 8000 N/m on the ground, pulled upwards."""
    return [
        *("supports={}", "bodies.block={E=1e7,nu=0.3,density=1000.0}", "gravity={acceleration=[0.0,-1.0]}", AT_ONCE),
        f"loads.lift={{boundary='block.top',force=[0.0,{force}]}}",
    ]


def capstan(pull: float) -> list[str]:
    """`ring`: a quarter of a thin band on a rigid drum, held back at one end with 1 N/m, pulled at the other."""
    loads = {
        "slack": {"boundary": "ring.x_axis", "force": [0.0, -1.0]},
        "pull": {"boundary": "ring.y_axis", "force": [-pull, 0.0]},
    }
    return [
        "geometry={builder='ring',inner_radius=1.0,outer_radius=1.05,angle=90,mesh_size=0.025,cells='tensor'}",
        *("bodies.ring={E=1e6,nu=0.3}", "supports={}", f"loads={toml(loads)}", AT_ONCE),
        "obstacles={drum={shape='cylinder',point=[0.0,0.0],radius=1.0}}",
        "contacts={drum={surface='ring.inner',against='drum',friction={law='coulomb',mu=0.3}}}",
    ]


def ladder(past: float) -> list[str]:
    """`strip` as a ladder between floor and smooth wall, so many degrees flatter than where its foot slides."""
    length, height, stands = 2.0, 0.05, radians(60.0)
    mu = (length * cos(stands) - height * sin(stands)) / (2 * length * sin(stands))  # from moments about the foot
    s, c = sin(stands - radians(past)), cos(stands - radians(past))
    obstacles: dict[str, Any] = {
        "floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [s, c]},
        "wall": {"shape": "plane", "point": [length, 0.0], "normal": [-c, s]},
    }
    contacts: dict[str, Any] = {
        "foot": {"surface": "strip.left", "against": "floor", "friction": {"law": "coulomb", "mu": mu}},
        "head": {"surface": "strip.right", "against": "wall"},
    }
    return [
        *(f"geometry.height={height}", "geometry.mesh_size=0.05", "geometry.layers=2", "supports={}", AT_ONCE),
        *("bodies.strip={E=1e7,nu=0.3,density=1000.0}", f"gravity={{acceleration={[-s, -c]}}}"),
        *(f"obstacles={toml(obstacles)}", f"contacts={toml(contacts)}"),
    ]


SOLVABLE = {
    "little friction": ("block", ["contacts.base.friction.mu=0.05"]),
    "friction 10, nearly incompressible": ("raous", ["contacts.base.friction.mu=10.0", "bodies.block.nu=0.4999"]),
    "nearly incompressible on compliance": ("foundation", ["bodies.block.nu=0.4999"]),
    "stiff block on compliance": ("foundation", ["bodies.block.E=1e15"]),
    "nearly incompressible stones": ("arch", ARCH),
    "nearly incompressible blocks": ("stack", STACK),
    "friction 400 on compliance": ("foundation", ["geometry.mesh_size=0.07", "contacts.base.friction.mu=400.0"]),
    "stiff left springer": ("arch", ["bodies.left_springer.E=2e14"]),
    "stiffer left springer": ("arch", ["bodies.left_springer.E=2e16"]),
    "stiff right springer": ("arch", ["bodies.right_springer.E=2e14"]),
    "one stiff block of ten": ("stack", ["bodies.block_5.E=1e12"]),
    "stiff upper block": ("two_blocks", ["bodies.upper.E=1e6"]),
    "stiff fine slave": ("cylinders", ["bodies.upper.E=2e7"]),
    "soft coarse master": ("cylinders", ["bodies.lower.E=2e-4"]),
    "soft inner ring": ("shrink_fit", ["bodies.inner.E=0.2"]),
    "just held on a slope": ("block", on_a_slope(20.0, 1.00001 * tan(radians(20.0)), 0.1)),
    "just held on a slope, finer": ("block", on_a_slope(20.0, 1.00001 * tan(radians(20.0)), 0.05)),
    "nearly lifted": ("block", lifted(7999.9)),
    "band on a drum": ("ring", capstan(1.4)),  # its limit is exp(0.3 pi/2) = 1.602
    **{f"friction {mu} on a block that opens": ("raous", [f"contacts.base.friction.mu={mu}"]) for mu in (5.0, 50.0)},
    "soft tangential springs": ("block", ["contacts.base.friction.k_T=1e-12"]),
}


OTHERS = {  # of their kind
    *("nearly incompressible blocks", "friction 400 on compliance", "just held on a slope, finer"),
    *("stiffer left springer", "stiff right springer"),
    "stiff fine slave",  # its pressure is compared below
}


@pytest.mark.parametrize("case", often(SOLVABLE, SOLVABLE.keys() - OTHERS))
def test_scene_that_has_a_solution_is_solved(case: str) -> None:
    verdict = next(judge(read(*SOLVABLE[case])))
    assert verdict.outcome in (Outcome.SOLVED, Outcome.BRANCH), verdict.reason


BEYOND_DIGITS = {
    "stiffer block on compliance": ("foundation", ["bodies.block.E=1e19"], "base", 47088.0),  # its weight
    "contrast of 1e15, floating": (
        "two_blocks",
        [
            *coarse("two_blocks"),
            "bodies.upper.E=1e15",
            "supports={base={boundary='lower.bottom',displacement={x=0.0,y=0.0}}}",
            "loads.top={boundary='upper.top',force=[[[0,0],[1,0],[2,0.01]],[[0,0],[1,-0.1]]]}",
        ],
        "joint",
        0.1,
    ),
}


@pytest.mark.parametrize("case", BEYOND_DIGITS)
def test_forces_are_right_where_stresses_are_below_the_last_digit_of_the_displacement(case: str) -> None:
    """The stiff body moves by 1e-4 m and more, and bends by 1e-15 m: the run solves it, and is doubtful."""
    name, overrides, contact, force = BEYOND_DIGITS[case]
    found = judging.solve(read(name, overrides))
    assert any("rounding is" in complaint for complaint in found.complaints)
    assert_allclose(found.steps[-1].contacts[contact].normal_force, force, rtol=1e-9)


def test_blocks_with_next_to_no_friction_rest_until_they_are_tilted() -> None:
    words = ["geometry.mesh_size=0.25", *(f"contacts.{name}.friction.mu=0.0004" for name in read("stack").contacts)]
    verdict = next(judge(read("stack", words)))
    assert verdict.outcome is Outcome.PROVED
    # the tilt grows by 1 m/s2 from t = 1 on: they slide from 0.0004 * 9.81 s later on
    times = [float(word) for word in re.findall(r"t = (\d\.\d+)", verdict.reason)]
    assert times[1] <= times[0]  # as printed
    assert [time - 1 for time in times[:2]] == pytest.approx([0.0004 * 9.81] * 2, rel=2e-3)


def test_points_that_stick_and_lift_may_have_no_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    """With Coulomb's law and mu = 1e4, 1e6 a point slips whose pressure falls as 1/mu while its friction stays."""
    monkeypatch.setattr("stickslip.solvers.stepping.halving.HALVINGS", 1)
    words = ["geometry.mesh_size=0.2", "contacts.base.friction={law='stick'}", "steps.end=6.0", "steps.count=6"]
    words += ["solver.method=condensed-newton"]  # alone: those that take over need ten times as long to give up
    with pytest.raises(StepError, match=r"jumps where the surfaces part: there may be no solution; coulomb has one"):
        solved("hysteresis", words)


@pytest.mark.parametrize("factor", [*slow(1e4), 1e5])
def test_pressure_of_a_stiff_cylinder_does_not_depend_on_which_side_is_the_slave(factor: float) -> None:
    stiff = [f"bodies.upper.E={200 * factor}"]
    swapped = [*stiff, "contacts.line.surface=lower.arc", "contacts.line.against=upper.arc"]
    found, expected = (solved("cylinders", words).contacts["line"].max_pressure for words in (stiff, swapped))
    assert_allclose(found, expected, rtol=0.02)  # cells of 1/40 and 1/30 of the width of contact


def test_far_motion_without_contact_does_not_spoil_the_pressure() -> None:
    """Without contact the long block would turn by metres about its corner; with it, it moves by 0.1 mm."""
    long = ["geometry.length=0.8", "supports.corner.point=[0.8,0.0]"]
    expected = solved("raous", long).contacts["base"]
    found = solved("raous", [*long, "solver.method=surface-uzawa", "solver.tolerance=1e-4"]).contacts["base"]
    assert_allclose(found.max_pressure, expected.max_pressure, rtol=0.01)


def test_weak_compliance_has_its_friction() -> None:
    """All of the base slides: friction is mu times the pressing force, however small both are."""
    weak = ["contacts.base.normal={law='compliance',c_n=1e-9}", "solver.method=uzawa"]
    base = solved("block", weak).contacts["base"]
    assert_allclose(base.normal_force, 1e-9 * 4.0 * 0.1, rtol=1e-6)
    assert_allclose(base.tangential_force, 0.3 * base.normal_force, rtol=1e-4)


@pytest.mark.parametrize(("past", "holds"), [(0.34, True), (0.36, False), (0.5, False)])
def test_ladder_is_solved_or_proved_to_slide(past: float, holds: bool) -> None:
    """It stands a third of a degree longer than in the textbook: its foot has a width, and turns about its corner."""
    if holds:
        assert solved("strip", ladder(past)).residual < 1e-8
        return
    with pytest.raises(NoEquilibriumError):
        solved("strip", ladder(past))


MM = "--set=units=mm-N-MPa"
OF_SI = re.compile(r"\[(m|m²|N/m|Pa|J|J/m|m/s²)\]|\d (m|m²|Pa|J|N/m|J/m)\b|metre")


@pytest.fixture
def texts(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """All that stands in the pictures that are saved."""
    found: list[str] = []

    def reading(name: str) -> None:
        done = getattr(Sheet, name)

        def act(self: Sheet, *words: Any) -> Any:
            kept = done(self, *words)
            found.extend(text for each in self.figure.findobj(Text) if (text := each.get_text()))
            return kept

        monkeypatch.setattr(Sheet, name, act)

    reading("save")
    reading("pixels")
    return found


def test_tables_and_sentences_say_the_units_of_the_scene_and_leave_the_numbers(call: Call, folder: Path) -> None:
    _, in_metres, _ = call("run", "block", "-o", "si", *COARSE)
    out, err = ended(call("run", "block", "-o", "mm", MM, *COARSE))
    assert all(unit in out for unit in ("[N/mm]", "[mm]", "[MPa]", "mJ/mm"))
    assert "mm, no overlap" in err
    assert not OF_SI.search(out + err)
    assert all(unit in in_metres for unit in ("[N/m]", "[m]", "[Pa]", "J/m"))
    assert "mm" not in in_metres
    one, other = result(folder / "si"), result(folder / "mm")
    assert (one["scene"]["units"], other["scene"]["units"]) == ("SI", "mm-N-MPa")
    assert one["steps"][-1]["contacts"] == other["steps"][-1]["contacts"]
    assert one["scene"]["hash"] == other["scene"]["hash"]
    units = other["units"]
    assert units["contacts.normal_force"] == "N/mm"
    assert units["energy.stored"] == "mJ/mm"
    assert units["bodies.max_von_mises"] == "MPa"
    assert units["obstacles.moment"] == "N mm/mm"
    assert units["time"] == "s"
    assert one["units"]["energy.stored"] == "J/m"


def test_mesh_plan_and_sweep_too(call: Call, folder: Path) -> None:
    for words in (
        ("mesh", "block"),
        ("plan", "block", "--mesh"),
        ("sweep", "block", "contacts.base.friction.mu=[0.2]"),
    ):
        out, _ = ended(call(*words, MM, *COARSE))
        assert "[mm]" in out
        assert not OF_SI.search(out)
    _, out, _ = call("plan", "stick_slip", MM)
    assert re.search(r"mu falls by \S+ per mm of slip; above a pressure of about \S+ MPa", out)


def test_pictures_and_the_animation_have_them_but_for_the_words_of_the_user(texts: list[str], tmp_path: Path) -> None:
    changes = ['title="pressed by 3 Pa, x [m]"', 'output.animation="gif"', "output.pictures=true", "steps.count=3"]
    run(read("block", [*SMALL, *changes, "units=mm-N-MPa"]), tmp_path / "out")
    assert {"x [mm]", "traction [MPa]", "energy [mJ/mm]", "contact area [mm]", "contact force [N/mm]"} <= {*texts}
    assert "von Mises stress [MPa]" in texts  # of the film
    assert any(text.startswith("force, y [N/mm]") for text in texts)  # of loops
    assert any(re.search(r"normal force .* N/mm", text) for text in texts)
    own = [text for text in texts if "pressed by" in text]
    assert own
    assert all(text == "pressed by 3 Pa, x [m]" for text in own)
    assert not [text for text in texts if text not in own and OF_SI.search(text)]


def test_maps_of_solid_contacts_have_them(texts: list[str], tmp_path: Path) -> None:
    coarse = ["geometry.mesh_size=0.5", "output.error=false", "steps.count=2"]
    run(read("cube", [*coarse, "units=mm-N-MPa"]), tmp_path / "out")
    assert "pressure [MPa]" in texts
    assert any(re.search(r"longest \S+ MPa", text) for text in texts)
    assert not [text for text in texts if OF_SI.search(text)]


def test_the_page_of_a_run_and_of_two_that_are_unlike(call: Call, folder: Path) -> None:
    for name, words in (("si", ()), ("mm", (MM,))):
        assert call("run", "block", "-q", "-o", name, *words, *COARSE)[0] == 0
    for name, heads in (("si", ("normal force [N/m]", '"Pa": "Pa"')), ("mm", ("normal force [N/mm]", '"Pa": "MPa"'))):
        assert call("report", name, "-o", f"{name}.html")[0] == 0
        page = (folder / f"{name}.html").read_text()
        assert all(head in page for head in heads)
    own = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert "mm-N-MPa" in own
    assert "a mm of thickness" in own
    assert not OF_SI.search(own)
    said = "A is in SI, B in mm-N-MPa"
    _, out, _ = call("compare", "si", "mm", "-o", "both.html")
    assert said in out
    (row,) = [line for line in out.splitlines() if "largest pressure [Pa or MPa]" in line]
    assert row.split("│")[4].strip() == "–"
    assert said in (folder / "both.html").read_text()
    _, out, _ = call("compare", "mm", "mm")
    assert said not in out
    assert "largest pressure [MPa]" in out


def test_pictures_of_faces_and_of_prices_have_them(texts: list[str], call: Call, folder: Path) -> None:
    file = draw(folder / "b.brep", 2)
    (folder / "b.toml").write_text(f'model = "plane strain"\nunits = "mm-N-MPa"\n[geometry]\nfile = "{file.name}"\n')
    code, out, _ = call("mesh", "b.toml", "--list")
    assert (code, "length [mm]" in out) == (0, True)
    assert "x [mm]" in texts
    draw_methods(folder, "Prices", [], ["uzawa"], "", Units.of("mm-N-MPa"))
    assert "edge length of cells at the contact [mm]" in texts
    assert not [text for text in texts if OF_SI.search(text)]


def test_a_run_that_was_killed_is_reported_in_its_units(call: Call, folder: Path, stopped: Path) -> None:
    begun = json.loads((stopped / "begun.json").read_text())
    (stopped / "begun.json").write_text(json.dumps(begun | {"units": "mm-N-MPa"}))
    (stopped / "result.json").unlink()
    killed = stopped.rename(work_of(stopped))
    assert read_results(killed).unit("Pa") == "MPa"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("mm-N-Pa", r'N/mm² is not Pa; the pressure that fits is MPa: "mm-N-MPa"'),
        ("m-kN-Pa", r"the pressure that fits is kPa"),
        ("in-lbf-ksi", r"the pressure that fits is psi"),
        ("cm-N-MPa", r'N/cm² is not MPa; .* "cm-N-N/cm²"'),
        ("mm-N", r'expected "SI", or "LENGTH-FORCE-PRESSURE" such as "mm-N-MPa"'),
        ("mm- N-MPa", r'expected "SI"'),
        ("", r'expected "SI"'),
    ],
)
def test_units_that_do_not_fit_together_are_refused_in_one_line(text: str, says: str, call: Call, folder: Path) -> None:
    code, _, err = call("plan", "block", f"--set=units='{text}'")
    assert_one_line(err)
    assert code == 2
    assert re.search(rf'block\.toml: units = "{text}": .*{says}', err)


def test_refusals_of_numbers_have_the_units_of_the_scene(call: Call, folder: Path) -> None:
    for word, says in (
        ("geometry.contact_mesh_size=-1", "must be positive, in mm"),
        ("bodies.block.E='soft'", "expected a number, in MPa"),
        ("bodies.block.density=-1", "must not be negative, in t/mm³"),
        ("supports.top.displacement.y=[1]", "in mm, or a table"),
    ):
        code, _, err = call("plan", "block", MM, f"--set={word}")
        assert (code, says in err) == (2, True), err


def test_unknown_units_are_taken_as_they_are() -> None:
    own = Units.of("rod-stone-slab")
    assert [own(unit) for unit in ("N/m", "Pa/m", "J", "kg/m³")] == [
        *("stone/rod", "slab/rod", "stone rod", "stone s²/rod⁴")
    ]
    assert Units.of("SI") == SI
    assert Units.of("m-N-Pa") == SI
    with pytest.raises(SceneError, match='length_unit = "mm": rod is not a length that is known here'):
        read("cad_part", ["units=rod-stone-slab"])


def test_a_file_comes_in_the_unit_of_the_scene(tmp_path: Path) -> None:
    data = scene_data(draw(tmp_path / "b.brep", 2, scale=1000.0), body="part", mesh_size=500.0) | {"units": "mm-N-MPa"}
    data["geometry"]["names"] = {"part.bottom": ["edge 1"], "part.top": ["edge 3"]}
    sizes = {}
    for unit in (None, "mm", "cm"):
        data["geometry"].pop("length_unit", None)
        data["geometry"] |= {"length_unit": unit} if unit else {}
        sizes[unit] = from_dict(data).geometry.box(2)[1, 0]
    assert sizes == pytest.approx({None: 4000.0, "mm": 4000.0, "cm": 40_000.0})
    metres = from_dict(data | {"units": "SI", "geometry": data["geometry"] | {"length_unit": "mm", "mesh_size": 0.5}})
    assert metres.geometry.box(2)[1, 0] == pytest.approx(4.0)


def test_labels_are_no_part_of_what_a_run_is_but_the_size_of_its_geometry_is(tmp_path: Path) -> None:
    block, labelled = read("block"), read("block", ["units=mm-N-MPa"])
    assert identity(block, DECIDES_NOTHING) == identity(labelled, DECIDES_NOTHING)
    data = scene_data(draw(tmp_path / "b.msh", 2), length_unit="m")
    one, other = (from_dict(data | {"units": units}) for units in ("SI", "mm-N-MPa"))
    assert identity(one, DECIDES_NOTHING) != identity(other, DECIDES_NOTHING)


def test_a_run_goes_on_with_other_labels(call: Call, folder: Path, stopped: Path) -> None:
    words = ("run", "block", "-q", "-o", "out", "--resume", *(f"--set={word}" for word in FOUR))
    assert call(*words, MM)[0] == 0
    assert result(folder / "out")["units"]["contacts.max_pressure"] == "MPa"


@pytest.mark.slow  # unbolted above
def test_a_bolted_step_file_in_metres_and_in_millimetres(call: Call, folder: Path) -> None:
    write_assembly(folder / "joint.step", bolted)
    found = {}
    for name, words, size in (("si", (), 1e-3), ("mm", ("--units", "mm-N-MPa"), 1.0)):
        output_of(call("new", f"{name}.toml", "--from", "joint.step", *words))
        sizes = (f"--set=geometry.mesh_size={16 * size}", f"--set=geometry.contact_mesh_size={8 * size}")
        still = ("--set=output.pictures=false", "--set=output.error=false")
        ended(call("run", f"{name}.toml", "-q", "-o", name, *sizes, *still))
        found[name] = result(folder / name)
    text = (folder / "mm.toml").read_text()
    for line in ('units = "mm-N-MPa"', "E = 210000, nu = 0.3, density = 7.85e-09", "acceleration = [0, 0, -9810]"):
        assert line in text
    assert "units" not in (folder / "si.toml").read_text()
    one, other = found["si"], found["mm"]
    assert one["dofs"] == other["dofs"]
    mine, theirs = (content["steps"][-1] for content in (one, other))
    assert mine["bolts"]["part_3"]["tension"] == pytest.approx(100e6 * 3.1416 * 4e-3**2, rel=2e-3)
    for name, contact in mine["contacts"].items():
        for key, unit in (("normal_force", 1.0), ("max_pressure", 1e-6), ("contact_area", 1e6)):
            assert_allclose(theirs["contacts"][name][key], unit * contact[key], rtol=1e-12)
    assert_allclose(theirs["energy"]["stored"], 1e3 * mine["energy"]["stored"], rtol=1e-12)


def test_contacts_and_new_take_units(call: Call, folder: Path) -> None:
    write_assembly(folder / "stack.brep", stacked)
    out, _ = ended(call("contacts", "stack.brep", "--units", "mm-N-MPa"))
    assert "area [mm²]" in out
    assert "gap [mm]" in out
    assert call("new", "--from", "stack.brep", "--units", "mm-N-MPa")[0] == 0
    assert 'length_unit = "mm"' in (folder / "stack.toml").read_text()
    for words, says in (
        (("contacts", "stack.brep", "--units", "mm-N-Pa"), "the pressure that fits is MPa"),
        (("contacts", "stack.toml", "--units", "SI"), "--units SI: a scene has its own"),
        (("new", "block", "--units", "SI"), "belong to --from"),
        (("new", "mine.toml", "--from", "stack.brep", "--units", "rod-stone-slab"), "--units: rod is not a unit"),
    ):
        assert_said(call(*words), 2, says)
    assert not (folder / "mine.toml").exists()
    _, out, _ = call("mesh", "stack.toml", "--list")
    assert "centre [mm]" in out
    code, out, _ = call("plan", "stack.toml", "--json")
    assert (code, json.loads(out)["units"]) == (0, "mm-N-MPa")
