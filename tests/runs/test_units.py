"""`units`: what results are labelled with; a number is the same whatever the label says."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from matplotlib.text import Text
from numpy.testing import assert_allclose

from shared.assemblies import bolted, stacked, write_assembly
from shared.command import COARSE, Call, assert_one_line, result
from shared.drawn import draw, scene_data
from shared.histories import FOUR, SMALL
from stickslip.geometry.errors import SceneError
from stickslip.geometry.units import SI, Units
from stickslip.workflows.cost.pictures import draw_methods
from stickslip.workflows.formats.results import read_results
from stickslip.workflows.pictures.sheet import Sheet
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.identity import DECIDES_NOTHING, identity
from stickslip.workflows.scene_file.read import from_dict, read

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
            found.extend(text for each in self.figure.findobj(Text) if (text := each.get_text()))  # type: ignore[attr-defined]
            return kept

        monkeypatch.setattr(Sheet, name, act)

    reading("save")
    reading("pixels")
    return found


def test_tables_and_sentences_say_the_units_of_the_scene_and_leave_the_numbers(call: Call, folder: Path) -> None:
    _, in_metres, _ = call("run", "block", "-o", "si", *COARSE)
    code, out, err = call("run", "block", "-o", "mm", MM, *COARSE)
    assert code == 0
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
        code, out, _ = call(*words, MM, *COARSE)
        assert code == 0
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
    assert read_results(stopped).unit("Pa") == "MPa"


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
        code, _, err = call("new", f"{name}.toml", "--from", "joint.step", *words)
        assert (code, err) == (0, "")
        sizes = (f"--set=geometry.mesh_size={16 * size}", f"--set=geometry.contact_mesh_size={8 * size}")
        still = ("--set=output.pictures=false", "--set=output.error=false")
        code, _, err = call("run", f"{name}.toml", "-q", "-o", name, *sizes, *still)
        assert code == 0, err
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
    code, out, _ = call("contacts", "stack.brep", "--units", "mm-N-MPa")
    assert code == 0
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
        code, _, err = call(*words)
        assert_one_line(err)
        assert (code, says in err) == (2, True), err
    assert not (folder / "mine.toml").exists()
    _, out, _ = call("mesh", "stack.toml", "--list")
    assert "centre [mm]" in out
    code, out, _ = call("plan", "stack.toml", "--json")
    assert (code, json.loads(out)["units"]) == (0, "mm-N-MPa")
