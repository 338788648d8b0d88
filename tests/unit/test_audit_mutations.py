"""A per cent of any number, a status, or any physics term: the audit notices each of them, or it is named here."""

from __future__ import annotations

import copy
import csv
import functools
import inspect
import shutil
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shared.audited import record_of, stored_by
from shared.problems import plane
from stickslip import Simulation, StepResult
from stickslip.geometry.arrays import ROUNDING, SLIGHT
from stickslip.geometry.obstacles.obstacle import Obstacle, Rotation
from stickslip.geometry.obstacles.round import Cylinder
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.effects import by_name, records
from stickslip.solvers.fem.constraints import Constraints
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.fem.springs import Links
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.laws.normal import Compliance
from stickslip.solvers.laws.rate_and_state import RateAndStateByPoint
from stickslip.solvers.laws.rate_dependent import RateDependent
from stickslip.solvers.laws.slip_dependent import BySlip
from stickslip.solvers.laws.wear import Slide, Turned
from stickslip.solvers.results.audit import Audit, Auditor, Record
from stickslip.solvers.results.second_numbers import SecondNumbers
from stickslip.solvers.results.step_result import OPEN, SLIP, STICK, Errors
from stickslip.solvers.results.verdict import limits
from stickslip.solvers.scene.material import Material, Orthotropic
from stickslip.solvers.scene.record import numbers_of
from stickslip.solvers.simulation.simulation import prepare as estimating
from stickslip.workflows.formats import csv_tables, hdf5, marker
from stickslip.workflows.formats.csv_tables import csv_text
from stickslip.workflows.formats.marker import MARKER
from stickslip.workflows.formats.steps import read_step, step_name
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.run.run import run
from stickslip.workflows.run.written_files import WrittenFiles
from stickslip.workflows.scene_file.read import from_dict
from stickslip.workflows.writers import tables

A_PER_CENT = 1.01
DRAWN = {"x": [[1, 0], [2, 0.06]], "y": [[0, 0], [1, -0.1]]}
COULOMB = {"law": "coulomb", "mu": 0.3}
SOFT = {"law": "compliance", "c_n": 20.0, "m_n": 2.0}
BASE = {"surface": "block.bottom", "against": "floor"}
BLOCK = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5}
TWO = {"builder": "two_blocks", "length": 2.0, "height": 0.5, "mesh_size": 0.5, "lower_mesh_size": 0.4}


def scene(dim: int = 2, **tables: Any) -> dict[str, Any]:
    """A block on a floor that has moved and turned, pressed, then drawn to the right."""
    aside = {} if tables.get("model") == "axisymmetric" else {"x": -0.01}
    floor = plane(dim) | {"displacement": aside | {"xyz"[dim - 1]: 0.02}}
    return {
        "model": "plane strain" if dim == 2 else "3d",
        "geometry": BLOCK,
        "bodies": {"block": {"E": 1.0, "nu": 0.3, "density": 1.0}},
        "obstacles": {"floor": floor},
        "contacts": {"base": BASE | {"friction": COULOMB}},
        "supports": {"top": {"boundary": "block.top", "displacement": DRAWN}},
        "probes": {"inside": {"point": [0.7, 0.4, 0.3][:dim]}},
        "steps": {"end": 2.0, "count": 2},
    } | tables


DEEP = {"z": [[0, 0], [1, -0.05]], "x": [[1, 0], [2, 0.03]], "y": 0.01}
HELD = {"bed": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0}}}
DROP = {"law": "static_kinetic", "mu_s": 0.3, "mu_k": 0.28, "slip_length": 0.05}
TO_AND_FRO = {"x": [[1, 0], [2, 0.08], [3, -0.04]], "y": [[0, 0], [1, -0.05]]}
SCENES: dict[str, dict[str, Any]] = {
    "block": scene(),
    "turning floor": scene(
        obstacles={
            "floor": {"shape": "cylinder", "point": [1.0, -4.0], "radius": 4.0, "displacement": {"y": 0.05}}
            | {"rotation": {"angle": 0.01, "point": [0.5, -4.0]}}
        }
    ),
    "3D, compliant springs": scene(
        3,
        geometry=BLOCK | {"width": 1.0, "order": 2, "mesh_size": 1.0},
        contacts={"base": BASE | {"normal": SOFT, "friction": COULOMB | {"k_T": 5.0}}},
        supports={"top": {"boundary": "block.top", "displacement": DEEP}},
    ),
    "axisymmetric": scene(
        model="axisymmetric",
        supports={"top": {"boundary": "block.top", "displacement": {"y": -0.1}}},
        contacts={"base": BASE | {"friction": {"law": "tresca", "bound": 0.01}}},
    ),
    "two bodies, roles exchanged": scene(
        geometry=TWO,
        bodies={"upper": {"E": 20.0, "nu": 0.3}, "lower": {"E": 1.0, "nu": 0.2}},
        obstacles={},
        contacts={"joint": {"surface": "upper.bottom", "against": "lower.top", "friction": COULOMB}},
        supports=HELD | {"top": {"boundary": "upper.top", "displacement": DRAWN}},
    ),
    "effects": scene(
        geometry=TWO,
        bodies={"upper": {"E": 1.0, "nu": 0.3, "density": 0.01}, "lower": {"E": 1.0, "nu": 0.2, "density": 0.01}},
        obstacles={},
        contacts={"joint": {"surface": "upper.bottom", "against": "lower.top", "friction": COULOMB}},
        supports={},
        elastic_support={"bed": {"boundary": "lower.bottom", "normal": 5.0, "tangential": 3.0}},
        springs={"rope": {"at": "upper.right", "stiffness": [0.5, 0.2], "displacement": [0.05, 0.01]}},
        bolts={"screw": {"head": "upper.top", "nut": "lower.bottom", "axis": [0, 1], "stiffness": 2.0, "force": 0.1}},
        plungers={"stop": {"boundary": "upper.left", "direction": [1, 0], "stiffness": 1.0, "preload": 0.02}},
        remote_points={"hand": {"boundary": "upper.top", "point": [1.0, 2.0], "coupling": "distributing",
                                "force": {"x": 0.01, "y": -0.02}, "moment": {"z": 0.01}}},
        gravity={"acceleration": [0.0, -1.0]},
    ),
    "bolt, rigid point": scene(
        bolts={"screw": {"body": "block", "shank": [[0.0, 0.3], [0.0, 0.8]], "shortening": 0.01}},
        supports={},
        remote_points={"grip": {"boundary": "block.top", "point": [0.5, 1.5], "coupling": "rigid",
                                "displacement": {"x": DRAWN["x"], "y": DRAWN["y"]}, "moment": {"z": 0.001}}},
    ),
    "rate and state": scene(
        contacts={"base": BASE | {"friction": {"law": "rate_and_state", "f0": 0.3, "a": 0.02, "b": 0.015, "Dc": 0.02,
                                               "V0": 0.01, "damping": 0.05}}},
        steps={"end": 2.0, "count": 2, "seconds": True},
    ),
    "rate, radiation": scene(
        contacts={"base": BASE | {"friction": {"law": "rate_dependent", "mu": [[0, 0.2], [0.1, 0.3]], "damping": 0.1}}},
        steps={"end": 2.0, "count": 2, "seconds": True},
    ),
    "wear": scene(contacts={"base": BASE | {"friction": COULOMB, "slide": 0.04, "wear": {"k": 1.0}}}),
    "to and fro, remembers": scene(
        contacts={"base": BASE | {"friction": DROP}},
        supports={"top": {"boundary": "block.top", "displacement": TO_AND_FRO}},
        steps={"end": 3.0, "count": 3},
    ),
    "slides to and fro, remembers": scene(
        geometry=TWO,
        bodies={"upper": {"E": 1.0, "nu": 0.3}, "lower": {"E": 1.0, "nu": 0.2}},
        obstacles={},
        contacts={"joint": {"surface": "upper.bottom", "against": "lower.top", "friction": DROP, "sliding": True}},
        supports=HELD | {"top": {"boundary": "upper.top", "displacement": TO_AND_FRO}},
        steps={"end": 3.0, "count": 3},
    ),
    "partners": scene(
        obstacles={
            name: {"shape": "plane", "point": [x, 0.0], "normal": [lean, 1.0]}
            for name, x, lean in (("left", 1.0, 0.02), ("right", 1.0, -0.02))
        },
        contacts={"seat": {"surface": "block.bottom", "against": ["left", "right"], "friction": COULOMB}},
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A solved scene and the record of its last step."""

    simulation: Simulation
    step: StepResult
    record: Record
    before: Record | None = None  # the step before, where this one is not halved

    @cached_property
    def auditor(self) -> Auditor:
        return Auditor(self.simulation.problem, self.simulation.mesh)

    def audit(self, **stored: Any) -> Audit:
        """With some of what is stored in place of what is."""
        return self.auditor(replace(self.record, stored=replace(self.record.stored, **stored)), self.before)

    def exceeded(self, found: Audit) -> set[str]:
        """Names of the limits that are exceeded."""
        most = limits(self.simulation.scene.solver.tolerance, self.step.law_error, found.rounding)
        return {name for name, value in vars(found).items() if not value <= getattr(most, name)}


KNOWN: dict[str, Case] = {}


def case_of(name: str) -> Case:
    if name not in KNOWN:
        simulation = prepare(from_dict(SCENES[name]))
        *_, before, last = simulation.steps()
        assert last.substeps == 1
        known = replace(record_of(before), stored=stored_by(before))
        KNOWN[name] = Case(simulation, last, replace(record_of(last), stored=stored_by(last, before)), known)
    return KNOWN[name]


@pytest.mark.parametrize("name", SCENES)
def test_nothing_is_exceeded_as_it_is(name: str) -> None:
    case = case_of(name)
    assert not case.exceeded(found := case.audit()), found
    assert found.numbers < 1e-6


@pytest.mark.parametrize("name", SCENES)
def test_a_per_cent_of_the_work_at_contacts_that_no_balance_shows_is_noticed(name: str) -> None:
    """The same work from outside, at contacts and in the remainder: it is integrated again from step to step."""
    case, auditor = case_of(name), Auditor(case_of(name).simulation.problem, case_of(name).simulation.mesh)
    assert case.step.substeps == 1
    honest = auditor(case.record, case.before)
    assert honest.numbers < 1e-6
    known = any(said.startswith("energy.contact: ") for said in auditor.shared)
    assert known == (name in ("effects", "slides to and fro, remembers"))  # a spring of one way, other rows
    told = copy.deepcopy(dict(case.record.stored.told))
    for key in ("external", "contact", "time_remainder"):
        told["energy"][key] += (A_PER_CENT - 1) * case.record.stored.told["energy"]["contact"]
    found = auditor(replace(case.record, stored=replace(case.record.stored, told=told)), case.before)
    assert ("numbers" in case.exceeded(found)) != known


def components(told: dict[str, Any]) -> dict[tuple[str, str, str, int], float]:
    """Each component of each number of a step but for what is rounding beside the largest of its unit."""
    found, units = dict[tuple[str, str, str, int], float](), dict[tuple[str, str, str, int], str]()
    for table, record in records().items():
        for name, own in by_name(table, told[table]).items():
            for key, number in ((key, number) for key, number in numbers_of(record).items() if key in own):
                for k, value in enumerate(np.ravel(own[key]).tolist()):
                    found[table, name, key, k], units[table, name, key, k] = value, number.unit
    largest = {unit: max(abs(found[at]) for at, own in units.items() if own == unit) for unit in units.values()}
    return {at: value for at, value in found.items() if abs(value) > ROUNDING * largest[units[at]]}


@pytest.mark.parametrize("name", SCENES)
def test_a_per_cent_of_any_number_is_noticed(name: str) -> None:
    case, missed = case_of(name), []
    known = dict(case.record.stored.told)
    for at, value in components(known).items():
        told, (table, owner, key, k) = copy.deepcopy(known), at
        own = told[table][owner] if owner else told[table]
        values = np.array(own[key], float)
        values.reshape(-1)[k] = A_PER_CENT * value
        own[key] = values.tolist()
        found = case.audit(told=told)
        if "numbers" not in case.exceeded(found):
            missed.append(at)
    assert not missed


@pytest.mark.parametrize("name", ["block", "wear"])
def test_dissipation_whose_sum_agrees_is_noticed_but_where_parts_of_the_step_are_not_known(name: str) -> None:
    case = case_of(name)
    told = copy.deepcopy(dict(case.record.stored.told))
    more = (A_PER_CENT - 1) * told["contacts"]["base"]["dissipation"]
    for own, key in ((told["contacts"]["base"], "dissipation_total"), (told["energy"], "dissipated")):
        own[key] += more
    told["contacts"]["base"]["dissipation"] += more
    told["energy"]["time_remainder"] -= more
    assert case.audit(told=told).numbers == pytest.approx(A_PER_CENT - 1, rel=0.02)
    assert case.audit(told=told | {"substeps": 2}).numbers < 1e-6


@pytest.mark.parametrize("name", SCENES)
def test_every_status_that_is_flipped_is_noticed(name: str) -> None:
    case, missed = case_of(name), []
    for contact, fields in case.record.stored.contacts.items():
        for node, status in enumerate(fields["status"]):
            for wrong in {OPEN, SLIP, STICK} - {status}:
                statuses = fields["status"].copy()
                statuses[node] = wrong
                contacts = {**case.record.stored.contacts, contact: {**fields, "status": statuses}}
                found = case.audit(contacts=contacts)
                if "fields" not in case.exceeded(found):
                    missed.append((contact, node, int(status), wrong))
    assert not missed


@pytest.mark.parametrize("name", SCENES)
def test_every_number_has_a_second_formula(name: str) -> None:
    case = case_of(name)
    case.audit()
    assert not [said for said in case.auditor.shared if said.endswith(": number")]


def test_a_number_that_nothing_shows_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    case = case_of("effects")
    auditor = Auditor(case.simulation.problem, case.simulation.mesh)
    monkeypatch.setattr(SecondNumbers, "_link", lambda self, link, record: None)
    auditor(case.record)
    named = [said for said in auditor.shared if said.endswith(": number")]
    assert "bolts.screw.tension: number" in named
    assert "springs.rope.force: number" in named


UNSURE = {"bodies.block.E": "10 %", "contacts.base.friction.mu": 0.02}
WRITTEN = scene(probes={"inside": {"point": [0.7, 0.4]}}, output={"pictures": False}, uncertainty=UNSURE)
WRONG = {  # file, and what of it is changed by what; a cell is the first one of its column in the last row
    "normal force": ("steps.csv", "base.normal_force", A_PER_CENT),
    "tangential force": ("steps.csv", "base.tangential_force.x", A_PER_CENT),
    "mean slip": ("steps.csv", "base.slip.x", A_PER_CENT),
    "moment": ("steps.csv", "base.moment.z", A_PER_CENT),
    "reaction": ("steps.csv", "support.top.force.y", A_PER_CENT),
    "prescribed motion": ("steps.csv", "support.top.displacement.x", A_PER_CENT),
    "energy": ("steps.csv", "energy.stored", A_PER_CENT),
    "error": ("steps.csv", "base.normal_force.error", A_PER_CENT),
    "derivative": ("steps.csv", "energy.stored.sensitivity.bodies.block.E", A_PER_CENT),
    "uncertainty": ("steps.csv", "base.normal_force.uncertainty", A_PER_CENT),
    "time": ("steps.csv", "time", A_PER_CENT),
    "pressure": ("contact_base.csv", "pressure", A_PER_CENT),
    "slip": ("contact_base.csv", "slip_x", A_PER_CENT),
    "lambda": ("contact_base.csv", "lambda_x", A_PER_CENT),
    "place": ("contact_base.csv", "x", A_PER_CENT),
    "status": ("contact_base.csv", "status", "open"),
    "stress": ("probes.csv", "stress_yy", A_PER_CENT),
    "displacement": ("probes.csv", "displacement_x", A_PER_CENT),
    "step of a field": ("fields.xdmf", "000002.h5:/stress<", "000001.h5:/stress<"),
    "field": ("contact_base.xdmf", "/slip<", "/slip_increment<"),
    "time of a field": ("fields.xdmf", '"2.0"', '"2.02"'),
}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Simulation, Path, list[StepResult], list[Errors]]:
    folder = tmp_path_factory.mktemp("written") / "run"
    _, content = run(from_dict(WRITTEN), folder)
    assert not content["verdict"]["exceeded"]  # of the audit: what linear elasticity leaves out is judged elsewhere
    assert content["audit"]["files"] < ROUNDING
    assert content["audit"]["numbers"] < 1e-6
    assert content["verdict"]["exceeded"] == content["verdict"]["passed"] == []
    (folder / MARKER).unlink()  # whose checksums would tell of what is changed here
    simulation = estimating(from_dict(WRITTEN))
    steps = list(simulation.steps())
    return simulation, folder, steps, list(simulation.errors(steps))


def told_apart(written: Any, folder: Path) -> list[float]:
    """Read back what the files in a folder tell."""
    simulation, _, steps, errors = written
    files = WrittenFiles(simulation, folder)
    for index, step in enumerate(steps, start=1):
        stored = read_step(folder / step_name(index)).contacts
        files.see(step.time, {name: vars(contact) for name, contact in stored.items()})
    return files.apart(steps, errors)


@pytest.mark.parametrize("what", WRONG)
def test_what_files_tell_wrong_is_noticed(what: str, written: Any, tmp_path: Path) -> None:
    (name, place, by), folder, copied = WRONG[what], written[1], tmp_path / "copied"
    shutil.copytree(folder, copied)
    assert max(told_apart(written, copied)) < ROUNDING
    text = (copied / name).read_text()
    if name.endswith(".csv"):
        header, *rows = list(csv.reader(text.splitlines()))
        row = rows[-3 if name.startswith("contact") else -1]
        cell = header.index(place)
        row[cell] = by if isinstance(by, str) else repr(float(row[cell]) * by)
        text = csv_text([header, *rows])
    else:
        text = str(by).join(text.rsplit(place, 1))
    (copied / name).write_text(text)
    assert told_apart(written, copied)[1] > SLIGHT


def test_a_run_whose_table_lies_is_doubtful(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = tables.steps_row

    def lying(*given: Any) -> dict[str, float]:
        row = honest(*given)
        return row | {"base.normal_force": A_PER_CENT * row["base.normal_force"]}

    monkeypatch.setattr(tables, "steps_row", lying)
    outcome, content = run(from_dict(WRITTEN), tmp_path / "run")
    assert outcome.exit_code == 1
    assert content["status"] == "doubtful"
    assert "files is 9.9e-03 in step 1" in content["sentence"]
    assert content["verdict"]["exceeded"] == content["verdict"]["passed"] != []


def test_each_file_is_read_once_and_what_a_step_without_fields_tells_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A step whose file is a light one has numbers in tables: wrong ones count with the next step that is audited."""
    honest, reads = tables.steps_row, list[str]()

    def lying(index: int, *given: Any) -> dict[str, float]:
        row = honest(index, *given)
        return row | {"base.normal_force": (A_PER_CENT if index == 1 else 1) * row["base.normal_force"]}

    def counting(path: Path) -> bytes:
        reads.append(path.name)
        return marker.read_checked(path)

    monkeypatch.setattr(tables, "steps_row", lying)
    for module in (hdf5, csv_tables):
        monkeypatch.setattr(module, "read_checked", counting)
    seldom = WRITTEN | {"output": {"pictures": False, "error": False, "every": 2, "step_files": "every"}}
    _, content = run(from_dict(seldom), tmp_path / "run")
    first, second = (step["audit"] for step in content["steps"])
    assert first is None
    assert second["files"] == pytest.approx(0.0099, 1e-2)
    own = ["000002.h5", "contact_base.csv", "fields.h5", "probes.csv", "steps.csv"]
    assert sorted(reads) == [*own[:2], "fields.h5", *own[2:]]  # the mesh by its writer too, that finds it whole


@pytest.mark.parametrize("name", ["contact_base.csv", "probes.csv", "steps.csv"])
def test_tables_that_lack_their_last_row_tell_wrong(name: str, written: Any, tmp_path: Path) -> None:
    copied = tmp_path / "copied"
    shutil.copytree(written[1], copied)
    (copied / name).write_text("".join((copied / name).read_text().splitlines(True)[:-1]))
    first, last = told_apart(written, copied)
    assert first < ROUNDING
    assert last == np.inf


WOOD = {"E_1": 1.0, "E_2": 0.5, "E_3": 0.4, "G_12": 0.3, "nu_12": 0.3, "nu_13": 0.2, "nu_23": 0.2, "axis_1": [1.0, 0.5]}
PULLED = {"pull": {"boundary": "block.right", "traction": [0.01, 0.005]}}
PHYSICS: dict[str, tuple[Any, str, dict[str, Any]]] = {  # of what, the term, and the scene that has it
    "stiffness": (WeakForms, "elasticity", scene()),
    "stress": (Material, "stress", scene()),
    "stiffness along axes": (Orthotropic, "stiffness_in", scene(bodies={"block": WOOD})),
    "axes": (Orthotropic, "axes", scene(bodies={"block": WOOD})),
    "pressure": (WeakForms, "load", scene(loads={"wind": {"boundary": "block.right", "pressure": 0.01}})),
    "traction": (WeakForms, "along", scene(loads=PULLED)),
    "force": (WeakForms, "along", scene(loads={"pull": {"boundary": "block.right", "force": {"x": 0.01}}})),
    "load by place": (WeakForms, "_value", scene(loads={"wind": {"boundary": "block.right", "pressure": "0.01*y**2"}})),
    "gravity": (WeakForms, "along", scene(gravity={"acceleration": [0.0, -1e-4]})),
    "body force": (WeakForms, "along", scene(body_force={"block": {"force": [1e-4, 0.0]}})),
    "rotation": (WeakForms, "linear", scene(centrifugal={"speed": 0.01, "point": [0.5, 0.5]})),
    "rotation around": (WeakForms, "linear", scene(model="axisymmetric", supports={
        "top": {"boundary": "block.top", "displacement": {"y": -0.1}}}, centrifugal={"speed": 0.01})),
    "heat": (WeakForms, "initial_load", scene(thermal={"block": {"expansion": 1e-4, "temperature": 10.0}})),
    "heat by place": (WeakForms, "_value", scene(thermal={"block": {"expansion": 1e-4, "temperature": "10*x*y"}})),
    "heat along axes": (WeakForms, "initial_load", scene(
        bodies={"block": WOOD}, thermal={"block": {"expansion": [1e-4, 2e-4, 3e-4], "temperature": 10.0}})),
    "heat around": (WeakForms, "initial_load", scene(model="axisymmetric", supports={
        "top": {"boundary": "block.top", "displacement": {"y": -0.1}}},
        thermal={"block": {"expansion": 1e-4, "temperature": "10*x"}})),
    "heat in a plate": (WeakForms, "initial_load", scene(
        model="plane stress", thermal={"block": {"expansion": 1e-4, "temperature": 10.0}})),
    "energy of heat": (WeakForms, "initial_energy", scene(thermal={"block": {"expansion": 1e-4, "temperature": 10.0}})),
    "averaged dilatation": (WeakForms, "lame", scene(bodies={"block": {"E": 1.0, "nu": 0.499}})),
    "elastic support": (WeakForms, "springs", SCENES["effects"]),
    "links": (Links, "forces", SCENES["effects"]),
    "motion of an obstacle": (Obstacle, "motion", scene()),
    "turn of an obstacle": (Rotation, "displacement", SCENES["turning floor"]),
    "gap": (Cylinder, "signed_gap", SCENES["turning floor"]),
    "friction": (Coulomb, "limit", scene()),
    "friction by rate": (RateDependent, "coefficient", SCENES["rate, radiation"]),
    "friction by state": (RateAndStateByPoint, "coefficient", SCENES["rate and state"]),
    "state": (RateAndStateByPoint, "state", SCENES["rate and state"]),
    "memory of slip": (BySlip, "after", SCENES["to and fro, remembers"]),
    "memory of slip that slides": (BySlip, "after", SCENES["slides to and fro, remembers"]),
    "wear": (ContactRows, "wear_rate", SCENES["wear"]),
    "sliding out of the plane": (Slide, "within", SCENES["wear"]),
    "work out of the plane": (Turned, "work_aside", SCENES["wear"]),
    "prescribed motion": (Constraints, "prescribed", scene(
        elastic_support={"side": {"boundary": "block.right", "normal": 1.0}})),
}  # fmt: skip


@pytest.mark.parametrize("term", PHYSICS)
def test_a_per_cent_of_any_physics_term_is_noticed(term: str, monkeypatch: pytest.MonkeyPatch) -> None:
    owner, name, tables = PHYSICS[term]
    true = inspect.getattr_static(owner, name)
    if isinstance(true, functools.cached_property):
        turn = np.array([[1.0, 0.01, 0.0], [-0.01, 1.0, 0.0], [0.0, 0.0, 1.0]])
        wrong: Any = property(lambda self: turn @ true.func(self))
    else:

        def wrong(*given: Any, **named: Any) -> Any:
            found = true(*given, **named)
            if isinstance(found, tuple):
                return A_PER_CENT * found[0], *found[1:]
            if hasattr(found, "form"):
                return replace(found, form=A_PER_CENT * found.form)
            return A_PER_CENT * found

    assert not judged(tables)
    monkeypatch.setattr(owner, name, wrong)
    assert judged(tables)


def test_a_per_cent_of_the_penetration_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """All that the solver asks of the law is that of another one, whose penetration is larger at each pressure."""
    assert not judged(SCENES["3D, compliant springs"])
    penetration, stiffness, resolvent = Compliance.penetration, Compliance.stiffness, Compliance.resolvent
    monkeypatch.setattr(Compliance, "penetration", lambda law, p: A_PER_CENT * penetration(law, p))
    monkeypatch.setattr(Compliance, "stiffness", lambda law, p, p_hat: stiffness(law, p, p_hat) / A_PER_CENT)
    monkeypatch.setattr(Compliance, "resolvent", lambda law, p_hat, gamma: resolvent(law, p_hat, A_PER_CENT * gamma))
    assert judged(SCENES["3D, compliant springs"])


def judged(tables: dict[str, Any]) -> set[str]:
    """Which checks of the audit the last step of a scene fails."""
    simulation = prepare(from_dict(tables))
    before, *more = list(simulation.steps())[-2:]
    last, known = (more[0], before) if more else (before, None)
    record = replace(record_of(last), stored=stored_by(last, known))
    followed = record_of(known) if known is not None and last.substeps == 1 else None
    return Case(simulation, last, record).exceeded(Auditor(simulation.problem, simulation.mesh)(record, followed))
