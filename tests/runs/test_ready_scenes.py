"""Every ready scene, end to end: what stands in the files is complete, agrees with itself and obeys mechanics."""

import csv
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import pyvista
from numpy.testing import assert_allclose

from geometry.amplitude import value_at
from solvers.effects.friction import Coulomb
from solvers.nouns.scene import Scene
from solvers.nouns.support import Support
from workflows.run import run
from workflows.scene import READY, from_dict, read
from workflows.writers.steps import read_step, step_name

COARSER = 2.5  # times the mesh sizes of the ready scenes: what is tested holds on every mesh
ZERO = 1e-8  # the tolerance of the ready scenes: balances hold to it, relative to their largest term
ROUNDING = 1e-12
Json = dict[str, Any]


@dataclass(frozen=True)
class Solved:
    """A ready scene, solved."""

    scene: Scene
    folder: Path
    result: Json

    @property
    def contacts(self) -> Iterator[tuple[Json, str, Json]]:
        for step in self.result["steps"]:
            for name, contact in step["contacts"].items():
                yield step, name, contact

    def rows(self, name: str) -> list[dict[str, str]]:
        """Rows of a CSV file."""
        return list(csv.DictReader((self.folder / name).read_text().splitlines()))

    def points(self, name: str, time: float) -> dict[str, Any]:
        """Columns of contact_NAME.csv at a time; vectors as (n, d)."""
        rows = [row for row in self.rows(f"contact_{name}.csv") if float(row["time"]) == time]
        columns: dict[str, Any] = {"status": np.array([row["status"] for row in rows])}
        for key in ("weight", "gap", "pressure"):
            columns[key] = np.array([float(row[key]) for row in rows])
        for key in ("traction", "slip", "slip_increment", "lambda"):
            columns[key] = np.array([[float(row[f"{key}_{a}"]) for a in "xyz"[: self.scene.dim]] for row in rows])
        columns["x"] = np.array([[float(row[a]) for a in "xyz"[: self.scene.dim]] for row in rows])
        return columns


def coarse(name: str) -> list[str]:
    """Overrides for a coarser mesh, with a probe more, and no pictures (they have tests of their own)."""
    scene = read(name)
    sizes = {key: getattr(scene.geometry, key, None) for key in ("mesh_size", "contact_mesh_size")}
    origin = [0.0] * scene.dim
    return [
        *(f"geometry.{key}={COARSER * size}" for key, size in sizes.items() if size is not None),
        f"probes.origin={{point={origin}}}",
        "output.pictures=false",
    ]


def refuse(constant: str) -> float:
    raise AssertionError(f"result.json holds {constant}")


def solve(scene: Scene, folder: Path) -> Solved:
    """Run it, and read result.json back as a stranger would."""
    run(scene, folder)
    return Solved(scene, folder, json.loads((folder / "result.json").read_text(), parse_constant=refuse))


@pytest.fixture(scope="module", params=sorted(path.stem for path in READY.glob("*.toml")))
def solved(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Solved:
    return solve(read(request.param, coarse(request.param)), tmp_path_factory.mktemp(request.param) / "out")


# --- result.json is complete


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def is_text(value: Any) -> bool:
    return isinstance(value, str) and value != ""


def is_null(value: Any) -> bool:
    return value is None


def is_truth(value: Any) -> bool:
    return isinstance(value, bool)


def is_vector(value: Any) -> bool:
    return isinstance(value, list) and len(value) in (2, 3) and all(map(is_number, value))


def is_moment(value: Any) -> bool:
    """A number in the plane, three components in space."""
    return is_number(value) or (is_vector(value) and len(value) == 3)


def is_stress(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 6 and all(map(is_number, value))


AUDIT = dict.fromkeys(
    ("equilibrium", "penetration", "negative_pressure", "cone", "complementarity", "dissipation"), is_number
)
RESULTANTS = ("normal_force", "tangential_force", "max_pressure", "max_penetration", "max_slip")
AREAS = ("contact_area", "stick_area", "slip_area")
CONTACT = dict.fromkeys((*RESULTANTS, *AREAS, "dissipation", "dissipation_total"), is_number)
FORMAT_1: Json = {
    "format": lambda value: value == 1,
    "status": lambda value: value == "converged",
    "version": is_text,
    "dolfinx": is_text,
    "ranks": lambda value: value == 1,
    "method": lambda value: is_text(value) and value != "auto",
    "dofs": is_count,
    "contact_points": is_count,
    "plan": [{"effect": is_text, "on": is_truth, "because": is_text}],
    "steps": [
        {
            "time": is_number,
            "substeps": is_count,
            "iterations": is_count,
            "volume_solves": is_count,
            "residual": is_number,
            "contacts": {"*": CONTACT | {"force": is_vector, "moment": is_moment}},
            "supports": {"*": {"force": is_vector, "moment": is_moment}},
            "probes": {"*": {"displacement": is_vector, "stress": is_stress}},
            "energy": dict.fromkeys(("external", "stored", "contact", "dissipated", "time_remainder"), is_number),
            "audit": AUDIT,
        }
    ],
    "counters": {
        "unknowns": dict.fromkeys(("displacement", "normal", "tangential"), is_count),
        **dict.fromkeys(("forms", "searches", "factorisations", "schur_size"), is_count),
        **dict.fromkeys(("volume_solves", "linear_iterations"), is_count),
    },
    "audit": AUDIT,
    "error": {
        "discretisation": is_null,  # not computed yet
        "law": is_null,
        "iteration": is_number,
        "linear_solver": is_null,
        "what": lambda value: value == "relative, energy norm",
    },
    "seconds": {
        **dict.fromkeys(("mesh", "assemble", "prepare", "iterate", "output", "total"), is_number),
        "linear_reference": is_null,
    },
}


def assert_has(value: Any, form: Any, at: str = "result.json") -> None:
    """Every key of the form is there, of the right kind; `*` stands for any name."""
    if isinstance(form, dict):
        assert isinstance(value, dict), at
        for key, inner in form.items():
            for name in value if key == "*" else [key]:
                assert name in value, f"{at}.{name} is missing"
                assert_has(value[name], inner, f"{at}.{name}")
    elif isinstance(form, list):
        assert isinstance(value, list), at
        assert value, at
        for index, item in enumerate(value):
            assert_has(item, form[0], f"{at}[{index}]")
    else:
        assert form(value), f"{at} = {value!r}"


def test_result_holds_every_key_of_format_1(solved: Solved) -> None:
    assert_has(solved.result, FORMAT_1)


def test_result_names_what_the_scene_names_at_every_requested_time(solved: Solved) -> None:
    assert [step["time"] for step in solved.result["steps"]] == list(solved.scene.requested_times())
    for step in solved.result["steps"]:
        for table in ("contacts", "supports", "probes"):
            assert step[table].keys() == getattr(solved.scene, table).keys()
        d = solved.scene.dim
        assert all(len(item["force"]) == d for table in ("contacts", "supports") for item in step[table].values())


def test_result_repeats_the_scene_so_that_it_can_be_solved_again(solved: Solved) -> None:
    stored = dict(solved.result["scene"])
    assert len(stored.pop("hash")) == 64
    assert from_dict(stored) == solved.scene


# --- mechanics


def weight(scene: Scene, time: float) -> Any:
    """Resultant of gravity (d,) [N] and its moment about the origin, of a block of one material."""
    if "gravity" not in scene.sections:
        return np.zeros(scene.dim), np.zeros(1 if scene.dim == 2 else 3)
    (material,) = scene.bodies.values()
    size = np.array(scene.geometry.extent(scene.dim))
    acceleration = [value_at(a, time, scene.steps.end) for a in scene.sections["gravity"].acceleration]
    force = material.density * size.prod() * np.array(acceleration)
    return force, np.atleast_1d(np.cross(size / 2, force))


def test_forces_and_moments_balance(solved: Solved) -> None:
    assert not solved.scene.loads  # a ready scene with loads: add their resultants here
    for step in solved.result["steps"]:
        parts = [*step["contacts"].values(), *step["supports"].values()]
        pull, turn = weight(solved.scene, step["time"])
        forces = np.array([pull, *(part["force"] for part in parts)])
        moments = np.array([turn, *(np.atleast_1d(part["moment"]) for part in parts)])
        lever = max(solved.scene.geometry.extent(solved.scene.dim))
        assert_allclose(forces.sum(axis=0), 0, atol=ZERO * np.abs(forces).max())
        assert_allclose(moments.sum(axis=0), 0, atol=ZERO * lever * np.abs(forces).max())


def test_work_is_stored_or_left_at_the_contact(solved: Solved) -> None:
    for step in solved.result["steps"]:
        energy = step["energy"]
        scale = max(abs(energy[key]) for key in ("external", "stored", "contact"))
        assert_allclose(energy["external"], energy["stored"] + energy["contact"], atol=ZERO * scale)
        assert energy["stored"] > 0


def test_friction_dissipates_and_the_parts_add_up(solved: Solved) -> None:
    scale = abs(solved.result["steps"][-1]["energy"]["external"])
    before = dict.fromkeys(solved.scene.contacts, 0.0)
    for step, name, contact in solved.contacts:
        assert contact["dissipation"] >= -ROUNDING * scale
        assert_allclose(contact["dissipation_total"], before[name] + contact["dissipation"], atol=ROUNDING * scale)
        before[name] = contact["dissipation_total"]
        total = sum(c["dissipation_total"] for c in step["contacts"].values())
        assert_allclose(step["energy"]["dissipated"], total, atol=ROUNDING * scale)
    assert any(contact["dissipation"] > 0 for _, _, contact in solved.contacts)  # every ready scene slips somewhere


def test_areas_add_up(solved: Solved) -> None:
    for step, name, contact in solved.contacts:
        points = solved.points(name, step["time"])
        touching = points["weight"][points["status"] != "open"].sum()
        assert_allclose(contact["stick_area"] + contact["slip_area"], contact["contact_area"], rtol=ROUNDING)
        assert_allclose(contact["contact_area"], touching, rtol=ROUNDING)
        side = np.prod(np.ptp(points["x"], axis=0)[:-1])  # the bottom of a block: every axis but the last
        assert_allclose(points["weight"].sum(), side, rtol=ROUNDING)


def test_audit_finds_nothing(solved: Solved) -> None:
    for step in solved.result["steps"]:
        assert max(step["audit"].values()) <= ZERO
        assert step["residual"] <= solved.scene.solver.tolerance
    for metric, worst in solved.result["audit"].items():
        assert worst == max(step["audit"][metric] for step in solved.result["steps"])


def test_coulomb_bounds_the_tangential_force(solved: Solved) -> None:
    for _, name, contact in solved.contacts:
        law = solved.scene.contacts[name].friction
        assert isinstance(law, Coulomb)
        assert contact["tangential_force"] <= law.mu * contact["normal_force"] * (1 + ZERO)


# --- the tables agree with result.json


def test_contact_table_agrees_with_the_result(solved: Solved) -> None:
    for step, name, contact in solved.contacts:
        points, scale = solved.points(name, step["time"]), contact["normal_force"]
        assert set(points["status"]) <= {"open", "slip", "stick"}
        assert_allclose(points["weight"] @ points["pressure"], scale, rtol=ROUNDING)
        tangential = points["weight"] @ points["traction"]
        assert_allclose(np.linalg.norm(tangential), contact["tangential_force"], atol=ROUNDING * scale)
        up = np.eye(solved.scene.dim)[-1]  # out of the foundation
        assert_allclose(contact["force"], scale * up + tangential, atol=ROUNDING * scale)
        slid = np.linalg.norm(points["slip"][points["status"] != "open"], axis=1).max()
        assert_allclose(contact["max_slip"], slid, rtol=ROUNDING)
        assert_allclose(np.linalg.norm(points["lambda"], axis=1).clip(1), 1, rtol=1e-6)  # |lambda| <= 1
        slipping = points["status"] == "slip"
        assert_allclose(np.linalg.norm(points["lambda"][slipping], axis=1), 1, rtol=1e-6)


def test_history_agrees_with_the_result(solved: Solved) -> None:
    rows = solved.rows("history.csv")
    for index, step in enumerate(solved.result["steps"], start=1):
        mine = [row for row in rows if int(row["step"]) == index]
        assert float(mine[-1]["time"]) == step["time"]
        assert float(mine[-1]["residual"]) == step["residual"]
        assert step["substeps"] == 1  # coarse and easy: no step is cut
        assert int(mine[-1]["iteration"]) == step["iterations"]
    solves = [int(row["volume_solves"]) for row in rows]
    assert all(a <= b for a, b in pairwise(solves))
    assert solves[-1] <= solved.result["counters"]["volume_solves"]


def test_probe_table_agrees_with_the_result(solved: Solved) -> None:
    rows = {(float(row["time"]), row["probe"]): row for row in solved.rows("probes.csv")}
    assert len(rows) == len(solved.result["steps"]) * len(solved.scene.probes)
    for step in solved.result["steps"]:
        for name, probe in step["probes"].items():
            row = rows[step["time"], name]
            assert [float(row[f"displacement_{a}"]) for a in "xyz"[: solved.scene.dim]] == probe["displacement"]
            stresses = ("xx", "yy", "zz", "xy", "yz", "xz")
            assert [float(row[f"stress_{ij}"]) for ij in stresses] == probe["stress"]


def test_step_files_agree_with_the_contact_table(solved: Solved) -> None:
    for index, step in enumerate(solved.result["steps"], start=1):
        stored = read_step(solved.folder / step_name(index))
        assert stored.time == step["time"]
        for name, contact in stored.contacts.items():
            points = solved.points(name, step["time"])
            assert (contact.pressure == points["pressure"]).all()  # bit by bit
            assert (contact.traction[:, : solved.scene.dim] == points["traction"]).all()


# --- XDMF, read by others


def assert_shows_the_probes(solved: Solved, index: int, points: Any, displacement: Any) -> None:
    """At the mesh node where a probe lies, the field is what the probe says; the probes lie on corners."""
    for name, probe in solved.scene.probes.items():
        distance = np.linalg.norm(points[:, : solved.scene.dim] - np.array(probe.point), axis=1)
        assert distance.min() <= ROUNDING
        expected = solved.result["steps"][index]["probes"][name]["displacement"]
        scale = np.abs(displacement).max()
        found = displacement[int(distance.argmin()), : solved.scene.dim]
        assert_allclose(found, expected, atol=ROUNDING * scale)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # meshio's own
def test_meshio_reads_the_fields(solved: Solved, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(solved.folder)  # meshio looks for the HDF5 file where it stands itself
    with meshio.xdmf.TimeSeriesReader("fields.xdmf") as reader:
        points, cells = reader.read_points_cells()
        assert reader.num_steps == len(solved.result["steps"])
        for index, step in enumerate(solved.result["steps"]):
            time, at_points, at_cells = reader.read_data(index)
            assert time == step["time"]
            assert_shows_the_probes(solved, index, points, at_points["displacement"])
            assert len(at_cells["von_mises"][0]) == sum(len(block.data) for block in cells)
            assert at_cells["stress"][0].shape[-1] == 9


def shown(path: Path) -> Iterator[tuple[float, Any]]:
    """Times and grids, as VTK reads them."""
    reader: Any = pyvista.get_reader(str(path))  # type: ignore[no-untyped-call]
    for time in reader.time_values:
        reader.set_active_time_value(time)
        grid = reader.read()
        yield time, grid[0] if isinstance(grid, pyvista.MultiBlock) else grid


def test_vtk_reads_the_fields(solved: Solved) -> None:
    size, measure = np.prod(solved.scene.geometry.extent(solved.scene.dim)), ("Area", "Volume")[solved.scene.dim - 2]
    times = []
    for index, (time, grid) in enumerate(shown(solved.folder / "fields.xdmf")):
        times.append(time)
        assert_shows_the_probes(solved, index, np.array(grid.points), np.array(grid.point_data["displacement"]))
        cells = grid.compute_cell_sizes().cell_data[measure]
        assert_allclose(cells.sum(), size, rtol=1e-6)  # single precision, in case VTK turns to it
    assert times == [step["time"] for step in solved.result["steps"]]


def test_vtk_reads_the_contact_surface(solved: Solved) -> None:
    for name in solved.scene.contacts:
        for time, surface in shown(solved.folder / f"contact_{name}.xdmf"):
            points, data = solved.points(name, time), surface.point_data
            assert (np.array(data["pressure"]) == points["pressure"]).all()
            assert_allclose(np.array(data["slip"])[:, : solved.scene.dim], points["slip"], rtol=ROUNDING)
            words = np.array(["open", "slip", "stick"])[np.array(data["status"]).astype(int)]
            assert (words == points["status"]).all()


# --- an effect that is off costs nothing


@pytest.fixture(scope="module")
def with_everything() -> Scene:
    """Gravity, compliance, friction."""
    return read("foundation", coarse("foundation"))


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


def test_rigid_obstacles_need_no_search(solved: Solved) -> None:
    assert solved.result["counters"]["searches"] == 0


def test_volume_is_prepared_once_whatever_the_number_of_steps(tmp_path: Path) -> None:
    block = read("block", [*coarse("block"), "steps.count=6"])
    counters = solve(block, tmp_path / "out").result["counters"]
    assert counters["factorisations"] == 1


def test_each_effect_taken_away_takes_its_forms_along(with_everything: Scene, tmp_path: Path) -> None:
    def forms(scene: Scene, name: str) -> int:
        return int(solve(scene, tmp_path / name).result["counters"]["forms"])

    light = replace(with_everything, sections={})
    free = replace(light, contacts={}, obstacles={}, supports={"wall": read("block").supports["top"]})
    counted = [forms(with_everything, "everything"), forms(light, "no gravity"), forms(free, "no contact")]
    assert counted[0] > counted[1] >= counted[2] > 0  # gravity is a form; a rigid obstacle is matrix rows, not forms
