"""Moments act where points are now, on both sides alike; ± contains what pairs of the start leave out."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import stickslip
from shared.audited import record_of, stored_by
from shared.problems import scene_of
from stickslip import Scene
from stickslip.geometry.arrays import Array
from stickslip.solvers.accuracy.kept_pairs import KeptPairs
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.results.step_result import total_errors, values
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

GAP, WEIGHT, PUSH, SIDE = 0.2, 20.0, 4.0, 1.0
SMALL = 1e-6 * WEIGHT  # E is 1e9: strains are below 1e-7


def falling(dim: int, order: int = 1, gap: float = GAP, **tables: Any) -> Scene:
    """A pad above a floor at z = -gap, pressed down and then pushed along x at half its height."""
    push = [[[0, 0], [1, 0], [2, PUSH]], *[0.0] * (dim - 1)]
    rest = [[0.0, 0.0]] if dim == 2 else [[0.0, 0.0, 0.0]]
    floor = {"shape": "plane", "point": [*rest[0][:-1], -gap], "normal": [0.0] * (dim - 1) + [1.0]}
    tables = {
        "obstacles": {"floor": floor},
        "contacts": {
            "sole": {"surface": "block.bottom", "against": "floor", "friction": {"law": "coulomb", "mu": 0.3}}
        },
    } | tables
    return scene_of(
        dim,
        geometry={"builder": "block", "length": SIDE, "height": SIDE, "mesh_size": 0.5, "order": order}
        | ({"width": SIDE} if dim == 3 else {}),
        bodies={"block": {"E": 1e9, "nu": 0.3}},
        loads={
            "press": {"boundary": "block.top", "pressure": [[0, 0], [1, WEIGHT], [2, WEIGHT]]},
            "push": {"boundary": "block.left", "traction": push},
        },
        steps={"end": 2.0, "count": 2},
        **tables,
    )


def about(point: Array, force: Array, moment: Array) -> Array:
    """A moment about another point than the origin."""
    return moment - np.atleast_1d(np.cross(point, force))


@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1), (3, 2)])
def test_friction_acts_where_the_floor_is(dim: int, order: int) -> None:
    *_, last = prepare(falling(dim, order)).steps()
    sole = last.contacts["sole"]
    assert_allclose(sole.force[[0, -1]], [-PUSH, WEIGHT], atol=SMALL)
    middle = np.array([SIDE / 2] * dim)
    middle[-1] -= GAP
    # about the middle of the pad as it lies: the floor balances what the two loads, which go through it, do not
    assert_allclose(about(middle, sole.force, sole.moment), 0.0, atol=SMALL)
    assert_allclose(last.obstacles["floor"].moment, sole.moment, atol=SMALL)


APART = """
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 0.5};
Rectangle(2) = {0, -0.7, 0, 1, 0.5};
Mesh.MeshSizeMax = 0.2;
Physical Surface("pad") = {1}; Physical Surface("slab") = {2};
Physical Curve("pad.bottom") = {1}; Physical Curve("pad.top") = {3}; Physical Curve("pad.left") = {4};
Physical Curve("slab.top") = {7}; Physical Curve("slab.bottom") = {5};
"""


@pytest.mark.parametrize("slave", ["surface", "against"])
def test_both_sides_feel_one_moment_across_a_gap_that_closes(slave: str, tmp_path: Path) -> None:
    """A pad falls on a slab and is pushed: what holds the slab balances what pushes the pad."""
    (tmp_path / "apart.geo").write_text(APART)
    scene = from_dict(
        {
            "model": "plane strain",
            "geometry": {"file": "apart.geo"},
            "bodies": {name: {"E": 1e9, "nu": 0.0} for name in ("pad", "slab")},
            "contacts": {
                "joint": {
                    "surface": "pad.bottom",
                    "against": "slab.top",
                    "slave": slave,
                    "search_distance": 0.3,
                    "friction": {"law": "coulomb", "mu": 0.3},
                }
            },
            "supports": {"base": {"boundary": "slab.bottom", "displacement": {"x": 0.0, "y": 0.0}}},
            "loads": {
                "press": {"boundary": "pad.top", "pressure": [[0, 0], [1, WEIGHT], [2, WEIGHT]]},
                "push": {"boundary": "pad.left", "traction": [[[0, 0], [1, 0], [2, 2 * PUSH]], 0.0]},
            },
            "steps": {"end": 2.0, "count": 2},
        },
        tmp_path,
    )
    simulation = prepare(scene)
    *_, last = simulation.steps()
    joint, base, pad = last.contacts["joint"], last.supports["base"], np.array([0.5, 0.25 - GAP])
    assert_allclose(joint.force, [-PUSH, WEIGHT], atol=SMALL)
    assert_allclose(about(pad, joint.force, joint.moment), 0.0, atol=SMALL)
    assert_allclose(base.force, joint.force, atol=SMALL)
    assert_allclose(base.moment, joint.moment, atol=SMALL)
    record = replace(record_of(last), stored=stored_by(last))
    assert Auditor(simulation.problem, simulation.mesh)(record).moment < 1e-6


def test_supports_and_springs_act_where_sides_have_moved() -> None:
    """A block that is carried 2 up and held back in x by springs: their force acts there."""
    scene = scene_of(
        obstacles={},
        contacts={},
        bodies={"block": {"E": 1e9, "nu": 0.0}},
        geometry={"builder": "block", "length": 1.0, "height": 1.0, "mesh_size": 0.5},
        supports={"top": {"boundary": "block.top", "displacement": {"y": 2.0}}},
        elastic_support={"bed": {"boundary": "block.left", "tangential": 0.0, "normal": 10.0}},
        loads={"push": {"boundary": "block.right", "traction": [5.0, 0.0]}},
    )
    (step,) = prepare(scene).steps()
    bed, top = step.elastic_support["bed"], step.supports["top"]
    assert_allclose(bed.force, [-5.0, 0.0], atol=SMALL)
    assert_allclose(bed.moment, 5.0 * 2.5, rtol=1e-6)  # at half height, which is at 2.5 now
    assert_allclose(bed.moment + top.moment - 5.0 * 2.5, 0.0, atol=1e-5)


@pytest.mark.parametrize("surface", ["outer.inside", "inner.outside"])
def test_a_preloaded_shaft_that_turns_has_the_torque_of_friction_alone(surface: str) -> None:
    """Pressures go through the axis, as their normals turn with their points: a turn of .01 rad adds nothing."""
    other = {"outer.inside": "inner.outside", "inner.outside": "outer.inside"}[surface]
    scene = from_dict({
        "model": "plane strain",
        "geometry": {
            "builder": "rings", "inner_radius": 0.5, "radius": 1.0, "outer_radius": 2.0, "interference": 1e-3,
            "mesh_size": 0.25, "cells": "tensor", "order": 1,
        },
        "bodies": {name: {"E": 1.0, "nu": 0.3} for name in ("inner", "outer")},
        "contacts": {"fit": {"surface": surface, "against": other, "friction": {"law": "coulomb", "mu": 0.1}}},
        "supports": {"housing": {"boundary": "outer.outside", "displacement": {"x": 0.0, "y": 0.0}}},
        "remote_points": {
            "shaft": {
                "boundary": "inner.inside", "point": [0.0, 0.0], "coupling": "rigid",
                "displacement": {"x": 0.0, "y": 0.0}, "rotation": {"z": [[1, 0], [2, 1e-2]]},
            }
        },
        "steps": {"end": 2.0, "count": 2},
    })  # fmt: skip
    *_, last = prepare(scene).steps()
    fit, torque = last.contacts["fit"], last.remote_points["shaft"].moment
    sign = 1.0 if surface == "inner.outside" else -1.0
    assert abs(float(torque[0])) > 0.05 * fit.normal_force
    assert_allclose(sign * fit.moment + torque, 0.0, atol=2e-3 * abs(float(torque[0])))
    assert_allclose(last.supports["housing"].moment + torque, 0.0, atol=2e-3 * abs(float(torque[0])))


def rolling(sliding: bool, shift: float) -> Scene:
    """A block is pressed on a roller by .01 and dragged over its top."""
    return scene_of(
        geometry={"builder": "block", "length": 1.0, "height": 1.0, "mesh_size": 0.1},
        obstacles={"roller": {"shape": "cylinder", "point": [0.5, -2.0], "radius": 2.0}},
        contacts={"base": {"surface": "block.bottom", "against": "roller", "sliding": sliding}},
        supports={"top": {"boundary": "block.top", "displacement": {"x": [[1, 0], [2, shift]], "y": [[1, -0.01]]}}},
        steps={"end": 2.0, "count": 4},
    )


def test_the_error_contains_what_kept_normals_leave_out() -> None:
    """Points that left the roller's top have the normals of where they began: ± is what `sliding` changes."""
    simulation = stickslip.prepare(rolling(False, 0.04))
    steps = [*simulation.steps()]
    before = simulation.counters.volume_solves, simulation.counters.searches
    errors = simulation.errors(steps)[-1]
    assert (simulation.counters.volume_solves, simulation.counters.searches) == before
    *_, slid = prepare(rolling(True, 0.04)).steps()
    kept, true, stated = values(steps[-1]), values(slid), total_errors(steps[-1], errors)
    for name in ("support.top.force.x", "support.top.force.y", "support.top.moment.z", "energy.stored"):
        assert abs(kept[name] - true[name]) < 1.1 * stated[name]
    assert abs(kept["support.top.force.x"] - true["support.top.force.x"]) > 0.5 * stated["support.top.force.x"]


def test_pairs_that_hold_cost_no_second_history() -> None:
    simulation = prepare(rolling(False, 1e-4))
    steps = [*simulation.steps()]
    simulation.time_step_errors(steps)
    before = simulation.counters.error_solves
    assert KeptPairs(simulation.stepper)(steps) == ()
    assert simulation.counters.error_solves == before


def test_the_audit_sees_a_moment_that_only_one_side_feels() -> None:
    simulation = prepare(falling(2))
    *_, last = simulation.steps()
    audit, record = Auditor(simulation.problem, simulation.mesh), replace(record_of(last), stored=stored_by(last))
    assert audit(record).moment < 1e-9
    begun = {"sole": last.contacts["sole"].moment + PUSH * GAP}
    found = asdict(audit(replace(record, stored=replace(record.stored, moments=begun))))
    assert found.pop("moment") > 1e-2
    assert max(found.values()) < 1e-6
