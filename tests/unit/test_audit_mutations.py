"""A per cent of any number, a status, or any physics term: the audit notices each of them, or it is named here."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pytest

from shared.audited import record_of, stored_by
from shared.problems import plane
from stickslip import Simulation, StepResult
from stickslip.geometry.arrays import ROUNDING
from stickslip.solvers.effects import by_name, records
from stickslip.solvers.results.audit import Audit, Auditor, Record
from stickslip.solvers.results.step_result import OPEN, SLIP, STICK
from stickslip.solvers.results.verdict import limits
from stickslip.solvers.scene.record import numbers_of
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

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

    @cached_property
    def auditor(self) -> Auditor:
        return Auditor(self.simulation.problem, self.simulation.mesh)

    def audit(self, **stored: Any) -> Audit:
        """With some of what is stored in place of what is."""
        return self.auditor(replace(self.record, stored=replace(self.record.stored, **stored)))

    def exceeded(self, found: Audit) -> set[str]:
        """Names of the limits that are exceeded."""
        most = limits(self.simulation.scene.solver.tolerance, self.step.law_error, found.rounding)
        return {name for name, value in vars(found).items() if not value <= getattr(most, name)}


KNOWN: dict[str, Case] = {}


def case_of(name: str) -> Case:
    if name not in KNOWN:
        simulation = prepare(from_dict(SCENES[name]))
        *_, before, last = simulation.steps()
        KNOWN[name] = Case(simulation, last, replace(record_of(last), stored=stored_by(last, before)))
    return KNOWN[name]


@pytest.mark.parametrize("name", SCENES)
def test_nothing_is_exceeded_as_it_is(name: str) -> None:
    case = case_of(name)
    assert not case.exceeded(found := case.audit()), found
    assert found.numbers < 1e-6


def components(told: dict[str, Any]) -> dict[tuple[str, str, str, int], float]:
    """Each component of each number of a step but for what is rounding beside the largest of its unit."""
    found, units = dict[tuple[str, str, str, int], float](), dict[tuple[str, str, str, int], str]()
    for table, record in records().items():
        for name, own in by_name(table, told[table]).items():
            for key, number in numbers_of(record).items():
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
