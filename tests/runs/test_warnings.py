"""What can be solved but answers badly is said before solving: by the plan, by the run, and in its log."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from shared.command import COARSE, READY_NAMES, Spoken, result
from shared.drawn import FACES, draw, scene_data
from shared.histories import PUSHED
from stickslip.solvers.simulation.plan import warnings
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict, read

Call = Callable[..., Spoken]
SOFT = "--set=bodies.block.nu=0.4999"
ALONE = "--set=bodies.block.formulation=displacement"
LOCKS = "warning: bodies.block.nu = 0.4999: displacements of order 1 lock"


def flat(text: str) -> str:
    """Without the line breaks of a narrow terminal."""
    return " ".join(text.split())


def test_plan_and_run_warn_of_linear_elements_that_lock(call: Call, folder: Path) -> None:
    code, out, _ = call("plan", "block", SOFT, ALONE)
    assert code == 0
    assert LOCKS in flat(out)
    said = [*warnings(read("block", [SOFT[6:], ALONE[6:]]))]
    assert json.loads(call("plan", "block", "--json", SOFT, ALONE)[1])["warnings"] == said
    code, _, err = call("run", "block", "-o", "out", SOFT, ALONE, *COARSE)
    assert code == 0
    assert LOCKS in flat(err)
    assert "WARNING bodies.block.nu = 0.4999" in (folder / "out" / "run.log").read_text()


@pytest.mark.parametrize(
    "override",
    ["bodies.block.nu=0.48", "geometry.order=2", "model='plane stress'", "bodies.block.formulation='auto'"],
)
def test_no_warning_where_nothing_locks(override: str) -> None:
    assert warnings(read("block", [SOFT[6:], ALONE[6:]]))
    assert warnings(read("block", [SOFT[6:], ALONE[6:], override])) == ()


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("x=[[5, 1]]", "supports.top.displacement.x: its table goes on up to t = 5, past steps.end = 2; what"),
        (
            "x=[[0, 0], [3, 1]], y=[[0, 0], [4, 1], [6, 0.5]]",
            "supports.top.displacement.y: its table goes on up to t = 6, past steps.end = 2, as 2 tables do; what",
        ),
        ("x=[[0, 0], [2, 1]], y=0.1", None),
        ("x=[[0, 0], [1, 0.1], [9, 0.1]]", None),  # nothing happens any more
    ],
)
def test_a_table_that_goes_on_after_the_end_is_said(table: str, said: str | None, call: Call) -> None:
    word = f"supports.top.displacement={{{table}}}"
    assert [line[: len(said or "")] for line in warnings(read("block", [word]))] == ([said] if said else [])
    code, out, _ = call("plan", "block", "--set", word)
    assert (code, f"warning: {said}" in flat(out)) == (0, said is not None)


@pytest.mark.parametrize("name", READY_NAMES)
def test_ready_scenes_are_warned_of_nothing(name: str) -> None:
    assert warnings(read(name)) == tuple(line for line in warnings(read(name)) if "mu falls by" in line)


def test_bodies_that_nothing_loads_are_doubted(call: Call, folder: Path) -> None:
    still = "--set=supports.top.displacement={x=0, y=0}"
    code, _, err = call("run", "block", "-o", "out", still, *COARSE)
    assert (code, "warning: nothing loads or moves the bodies" in flat(err)) == (0, True), err
    assert any("nothing loads" in line for line in result(folder / "out")["warnings"])


def test_displacements_that_are_not_small_are_doubted(call: Call, folder: Path) -> None:
    """A block 2 m high, pressed by 1.8 m; or moved by 10 m as a whole, together with its foundation."""
    coarse = ("--set", "geometry.mesh_size=0.5", "--set", "geometry.contact_mesh_size=0.5", *COARSE[2:])
    pressed = "supports.top.displacement={x=0, y=[[0, 0], [1, -1.8]]}"
    code, _, err = call("run", "block", *coarse, "--set", pressed)
    assert code == 0
    assert "warning: displacements differ by up to 0.4" in flat(err)  # 1.8 and more, of the diagonal 20^(1/2)
    assert "displacements differ" in (folder / "results" / "block" / "run.log").read_text()
    moved = ("--set", "supports.top.displacement={x=10, y=0}", "--set", "obstacles.foundation.displacement={x=10}")
    for overrides in ((), moved):
        assert "displacements differ" not in call("run", "block", *coarse, *overrides)[2]


@pytest.mark.parametrize("keeps", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_steps_that_leave_a_large_error_are_doubted(keeps: bool, call: Call, folder: Path) -> None:
    """And the number of steps that is asked for keeps what it promises."""
    coarse = ["--set=geometry.mesh_size=0.3", "--set=geometry.contact_mesh_size=0.03", "--set=geometry.order=1"]
    coarse += [f"--set={word}" for word in (*PUSHED, "steps.count=10")]
    words = ["run", "half_disc", *coarse, "--set=output.pictures=false"]
    silent = ["--set=output.error=false", "--set=steps.count=1"]
    code, _, err = call(*words, "-o", "few")
    assert code == 0
    said = re.search(
        r"warning: the time steps leave an error of about (\d+)% in the dissipation of contacts.pole; use "
        r"steps.count = (\d+)",
        flat(err),
    )
    assert said is not None
    assert said[0][9:] in result(folder / "few")["warnings"]
    assert "the time steps leave" not in call(*words, "-o", "silent", *silent)[2]
    if not keeps:
        return
    call(*words, "-o", "many", f"--set=steps.count={said[2]}")
    few, many = (result(folder / name)["steps"][-1] for name in ("few", "many"))
    before, after = (step["contacts"]["pole"] for step in (few, many))
    assert after["error"]["dissipation_total"]["time_step"] < 0.05 * after["dissipation_total"]
    true = abs(before["dissipation_total"] - after["dissipation_total"])
    assert 0.7 * true < before["error"]["dissipation_total"]["time_step"] < 3 * true


@pytest.mark.parametrize("pressure", [-0.001, 0.0])
def test_a_curved_contact_that_is_pulled_or_unloaded_ends(pressure: float, call: Call, folder: Path) -> None:
    (folder / "pulled.toml").write_text(
        'model = "plane strain"\n[geometry]\nbuilder = "ring"\ninner_radius = 1.0\nouter_radius = 1.5\nangle = 90\n'
        "mesh_size = 0.25\ncontact_mesh_size = 0.2\n[bodies.ring]\nE = 1.0\nnu = 0.3\n[obstacles.shaft]\n"
        'shape = "cylinder"\npoint = [0.0, 0.0]\nradius = 1.0\n[contacts.bore]\nsurface = "ring.inner"\n'
        'against = "shaft"\nnormal = { law = "bilateral" }\n[supports.x_axis]\nboundary = "ring.x_axis"\n'
        'displacement = { y = 0.0 }\n[supports.y_axis]\nboundary = "ring.y_axis"\ndisplacement = { x = 0.0 }\n'
        f'[loads.pull]\nboundary = "ring.outer"\npressure = {pressure}\n[output]\npictures = false\nerror = false\n'
    )
    code, _, err = call("run", "pulled.toml")
    assert code == 0, err
    assert "curved" not in err


PIECES = """
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 2};
Rectangle(2) = {1, 0, 0, 1, 2};
"""
IN_ONE = """
Physical Surface("block") = {1, 2};
Physical Curve("block.bottom") = Curve In BoundingBox {-0.1, -0.1, -1, 2.1, 0.1, 1};
Physical Curve("block.top") = Curve In BoundingBox {-0.1, 1.9, -1, 2.1, 2.1, 1};
"""
SEAM = 'Physical Curve("block.seam") = Curve In BoundingBox {0.9, -0.1, -1, 1.1, 2.1, 1};\n'


@pytest.mark.parametrize(
    ("drawing", "warned"),
    [
        (PIECES + IN_ONE, True),
        (PIECES + "Coherence;" + IN_ONE, False),
        (PIECES.replace("1, 0, 0, 1, 2", "1.1, 0, 0, 0.9, 2") + IN_ONE, False),
        (PIECES + IN_ONE + SEAM, False),  # may be a contact
    ],
)
def test_a_body_whose_pieces_only_look_as_if_they_held_together_is_warned_of(
    drawing: str, warned: bool, tmp_path: Path
) -> None:
    (tmp_path / "b.geo").write_text(drawing)
    _, content = run(from_dict(scene_data(tmp_path / "b.geo", mesh_size=0.5)), tmp_path / "out")
    said = "body block is in pieces: 3 pairs of nodes lie at the same place"  # five, with those of bottom and top
    assert any(said in line for line in content["warnings"]) == warned, content["warnings"]


@pytest.mark.parametrize(
    ("units", "length_unit", "warned"),
    [("SI", None, True), ("SI", "m", False), ("SI", "mm", False), ("mm-N-MPa", None, False)],
)
def test_a_step_file_taken_in_another_unit_than_gmsh_gives_is_warned_of(
    units: str, length_unit: str | None, warned: bool, tmp_path: Path
) -> None:
    data = scene_data(draw(tmp_path / "b.step"), 3, "part", mesh_size=0.5, names=FACES, length_unit=length_unit)
    said = 'box, read in m, is 4 x 2 x 2 m: write length_unit = "mm", or "m" if that is meant'
    assert any(said in warning for warning in warnings(from_dict(data | {"units": units}))) == warned


TILTED = """
model = "plane strain"
geometry = { builder = "two_blocks", length = 1.0, height = 0.25, lower_length = 2.0, mesh_size = 0.25 }
bodies = { upper = { E = 1e6, nu = 0.3 }, lower = { E = 1e8, nu = 0.3 } }
loads.top = { boundary = "upper.top", traction = [0.0, -400.0] }
steps = { end = 2.0, count = 4 }

[contacts.base]
surface = "upper.bottom"
against = "lower.top"
friction = { law = "coulomb", mu = 0.1 }

[remote_points.base]
boundary = "lower.bottom"
point = [0.0, -0.5]
coupling = "rigid"
displacement = { x = 0.0, y = 0.0 }
rotation = { z = [[0, 0], [1, 0.02]] }

[springs.pull]
at = "upper.right"
stiffness = 2e4
direction = [1.0, 0.0]
displacement = [[[0, 0], [1, 0], [2, 0.01]], 0.0]
"""


def test_sides_that_turn_by_a_part_of_mu_are_doubted(call: Call, folder: Path) -> None:
    """A block pulled up a slope of .02 rad, to which its foundation turns: N (mu + .02) / (1 - .02 mu) in truth."""
    (folder / "tilted.toml").write_text(TILTED)
    pulls = {}
    for sliding in ("false", "true"):
        bare = ("--set=output.error=false", "--set=output.pictures=false", f"--set=contacts.base.sliding={sliding}")
        code, _, err = call("run", "tilted.toml", "-o", sliding, *bare)
        step = result(folder / sliding)["steps"][-1]
        assert (code, "contacts.base: its sides turn by 20% of mu" in flat(err)) == (0, sliding == "false"), err
        pulls[sliding] = step["springs"]["pull"]["force"][0]
    assert pulls["false"] == pytest.approx(40.0, rel=1e-6)
    assert pulls["true"] == pytest.approx(400 * 0.12 / (1 - 0.002), rel=2e-3)


@pytest.mark.parametrize("carries", [True, False])
def test_a_support_at_a_point_that_carries_is_doubted(carries: bool, call: Call, folder: Path) -> None:
    """Two points under a block; or one beside a side that carries, which holds it along the side alone."""
    held = {
        True: "supports={a={point=[0.0,2.0],displacement={x=0,y=0}},b={point=[4.0,2.0],displacement={y=-0.01}}}",
        False: "supports={a={point=[0.0,2.0],displacement={x=0}},b={boundary='block.top',displacement={y=-0.01}}}",
    }
    smooth = "--set=contacts.base={surface='block.bottom',against='foundation'}"
    words = ["--set=geometry.mesh_size=0.5", "--set=geometry.contact_mesh_size=0.5", "--set=output.error=false", smooth]
    code, _, err = call("run", "block", "-o", "out", *words, f"--set={held[carries]}")
    assert (code, "a point carries" in flat(err)) == (0, carries), err
