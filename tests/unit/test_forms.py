"""Weak forms: what UFL writes is what the rows add up, and a constant stress comes out as it went in."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import every_nth, slow
from shared.problems import scene_of
from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.dolfinx_versions import ufl
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.fem.elastic_energy import forces_of_energy
from stickslip.solvers.fem.forms import numbered
from stickslip.solvers.laws.normal import Compliance
from stickslip.solvers.system.system import System
from stickslip.workflows.lab.verification.prepared import prepare, system_of
from stickslip.workflows.scene_file.read import read

MESHES: list[tuple[int, dict[str, Any]]] = [
    (2, {"contact_mesh_size": 0.2}),
    (2, {"cells": "tensor"}),
    (3, {"contact_mesh_size": 0.4}),
    (3, {"cells": "tensor"}),
    (2, {"order": 2}),
    (3, {"order": 2}),
]
CURVED: dict[str, tuple[int, str, dict[str, Any]]] = {
    "roller": (2, "plane strain", {"shape": "cylinder", "point": [1.0, -3.0], "radius": 3.0}),
    "ball": (3, "3d", {"shape": "sphere", "center": [1.0, 0.5, -3.0], "radius": 3.0}),
    "bore": (3, "3d", {"shape": "cylinder", "point": [0, 0.5, 9], "axis": [1, 0, 0], "radius": 9.5, "inside": True}),
    "ball on the axis": (2, "axisymmetric", {"shape": "sphere", "center": [0.0, -3.0], "radius": 3.0}),
}


def compliant(dim: int, geometry: dict[str, Any], m_n: float) -> System:
    law = {"law": "compliance", "c_n": 3.0, "m_n": m_n}
    return system_of(
        scene_of(dim, geometry, contacts={"base": {"surface": "block.bottom", "against": "foundation", "normal": law}})
    )


def some_displacement(system: System) -> Any:
    """Random, partly touching: about half of the facets cross the line between open and closed."""
    u = dx.fem.Function(system.space)
    u.x.array[:] = np.random.default_rng(11).normal(size=len(u.x.array))
    return u


def j_n(system: System, u: Any) -> Any:
    """The form of the scene's only contact."""
    (rows,), (contact,) = system.contacts, (pair.contact for pair in system.problem.pairs.values())
    assert isinstance(rows.normal, Compliance)
    return system.weak.normal_compliance(u, contact, rows.normal)


def penetration(rows: ContactRows, u: Array) -> Array:
    return np.asarray(np.maximum(rows.N_n @ u[rows.surface.nodes].ravel() - rows.gap, 0.0))


def by_rows(system: System, u: Array) -> Array:
    """B^T p over all nodes (n, d), p from the law at the quadrature points."""
    (rows,) = system.contacts
    assert isinstance(rows.normal, Compliance)
    p = rows.normal.c_n * penetration(rows, u) ** rows.normal.m_n
    total = np.zeros_like(u)
    total[rows.surface.nodes] = rows.nodal_forces(p, np.zeros(rows.free.shape))
    return total


@pytest.mark.parametrize("m_n", [1.0, 1.5, *slow(2.0, 3.0)])
@pytest.mark.parametrize(("dim", "geometry"), MESHES)
def test_compliance_form_is_what_the_quadrature_rows_add_up(dim: int, geometry: dict[str, Any], m_n: float) -> None:
    system = compliant(dim, geometry, m_n)
    u = some_displacement(system)
    form = dx.assemble_vector(system.weak.compile(j_n(system, u))).array.reshape(-1, dim)
    rows = by_rows(system, u.x.array.reshape(-1, dim))
    closed = penetration(system.contacts[0], u.x.array.reshape(-1, dim)) > 0
    assert closed.any()
    assert not closed.all()
    assert_allclose(rows, form, atol=1e-12 * np.abs(form).max())  # the same points and weights: rounding only


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("shape", CURVED)
def test_compliance_meets_a_curved_obstacle_at_every_quadrature_point(shape: str, order: int) -> None:
    dim, model, obstacle = CURVED[shape]
    law = {"law": "compliance", "c_n": 3.0, "m_n": 2.0}
    base = {"surface": "block.bottom", "against": "foundation", "normal": law, "gap_offset": -0.2}
    tables = {"obstacles": {"foundation": obstacle}, "contacts": {"base": base}}
    system = system_of(scene_of(dim, {"order": order, "mesh_size": 0.5}, model=model, **tables))
    u = some_displacement(system)
    form = dx.assemble_vector(system.weak.compile(j_n(system, u))).array.reshape(-1, dim)
    rows = by_rows(system, u.x.array.reshape(-1, dim))
    assert_allclose(rows, form, atol=1e-12 * np.abs(form).max())


@pytest.mark.parametrize("m_n", [1.5, 2.0])
@pytest.mark.parametrize(("dim", "geometry"), [MESHES[0], MESHES[3]])
def test_compliance_tangent_is_the_derivative_of_the_form(dim: int, geometry: dict[str, Any], m_n: float) -> None:
    system = compliant(dim, geometry, m_n)
    (rows,) = system.contacts
    assert isinstance(rows.normal, Compliance)
    u = some_displacement(system)
    values = u.x.array.reshape(-1, dim)
    tangent = dx.assemble_matrix(system.weak.compile(ufl.derivative(j_n(system, u), u)))
    direction = np.random.default_rng(12).normal(size=values.shape)
    x = tangent.createVecRight()
    x.array[:] = direction.ravel()
    from_form = (tangent * x).array.reshape(-1, dim)
    # N^T W k N with the slope that Newton uses
    p = rows.normal.c_n * penetration(rows, values) ** rows.normal.m_n
    k = rows.normal.stiffness(p, np.where(p > 0, 1.0, -1.0))
    moved = rows.N_n @ direction[rows.surface.nodes].ravel()
    from_rows = np.zeros_like(values)
    from_rows[rows.surface.nodes] = rows.nodal_forces(k * moved, np.zeros(rows.free.shape))
    assert_allclose(from_rows, from_form, atol=1e-12 * np.abs(from_form).max())
    # central difference; m_n = 1.5 has no second derivative where the surface lifts off
    h = 1e-6
    difference = (by_rows(system, values + h * direction) - by_rows(system, values - h * direction)) / (2 * h)
    assert_allclose(difference, from_form, atol=1e-5 * np.abs(from_form).max())


STATES = {
    # model: strain (x, along the last axis) per unit pull in x, E = 1, nu = 0.3
    "plane stress": (2, 1.0, -0.3),
    "plane strain": (2, 1 - 0.09, -0.3 * 1.3),
    "3d": (3, 1.0, -0.3),
}


@pytest.mark.parametrize(("model", "cells"), every_nth(2, STATES, ["simplex", "tensor"]))
def test_a_pulled_block_stretches_by_the_modulus_of_its_model(model: str, cells: str) -> None:
    dim, along, across = STATES[model]
    rollers = {"left": {"boundary": "block.left", "displacement": {"x": 0.0}}}
    rollers["bottom"] = {"boundary": "block.bottom", "displacement": {"xyz"[dim - 1]: 0.0}}
    if dim == 3:
        rollers["front"] = {"boundary": "block.front", "displacement": {"y": 0.0}}
    pull = {"pull": {"boundary": "block.right", "traction": [2.0] + [0.0] * (dim - 1)}}
    size = {"cells": cells} | ({"contact_mesh_size": 0.2 * (dim - 1)} if cells == "simplex" else {})
    scene = scene_of(dim, size, model=model, obstacles={}, supports=rollers, loads=pull)
    simulation = prepare(scene)
    (step,) = simulation.steps()
    x = simulation.data.points
    strain = np.array([along] + [across] * (dim - 1))
    assert_allclose(step.displacement, 2.0 * strain * x, atol=1e-12)  # linear: in the space
    expected = np.zeros((3, 3))
    expected[0, 0] = 2.0
    if model == "plane strain":
        expected[2, 2] = 0.3 * 2.0  # what holds the thickness
    assert_allclose(step.stress, np.tile(expected, (len(step.stress), 1, 1)), atol=1e-12)


@pytest.mark.parametrize(("mesh", "law"), every_nth(3, MESHES, ["unilateral", "bilateral", "compliance"]))
def test_a_pressed_block_hands_its_pressure_to_the_foundation(mesh: tuple[int, dict[str, Any]], law: str) -> None:
    dim, geometry = mesh
    normal = {"law": law} | ({"c_n": 5.0, "m_n": 2.0} if law == "compliance" else {})
    rollers = {"left": {"boundary": "block.left", "displacement": {"x": 0.0}}}
    if dim == 3:
        rollers["front"] = {"boundary": "block.front", "displacement": {"y": 0.0}}
    scene = scene_of(
        dim,
        geometry,
        contacts={"base": {"surface": "block.bottom", "against": "foundation", "normal": normal}},
        supports=rollers,
        loads={"press": {"boundary": "block.top", "pressure": 0.2}},
    )
    (step,) = prepare(scene).steps()
    contact = step.contacts["base"]
    assert_allclose(contact.pressure, 0.2, rtol=1e-7)  # solver.tolerance 1e-8
    assert_allclose(contact.gap, -((0.2 / 5.0) ** 0.5) if law == "compliance" else 0.0, atol=1e-8)
    assert_allclose(contact.force, np.eye(dim)[-1] * 0.4, atol=1e-8)  # 0.2 Pa on 2 m (2 m x 1 m)
    expected = np.zeros((3, 3))
    expected[dim - 1, dim - 1] = -0.2
    if dim == 2:
        expected[2, 2] = -0.3 * 0.2  # plane strain
    assert_allclose(step.stress, np.tile(expected, (len(step.stress), 1, 1)), atol=1e-7)


def test_forms_of_bodies_and_sides_are_compiled_once() -> None:
    """Whatever numbers bodies and sides have in the mesh, alone or together."""
    weak = system_of(read("arch", ["geometry.mesh_size=0.5"])).weak
    one, other, third, *_ = weak.problem.bodies
    weights = [weak.v[1] * weak.volume(body) for body in (one, other)]
    pairs = [weak.v[0] * weak.volume(a) + weak.v[1] * weak.volume(b) for a, b in ((one, other), (one, third))]
    sides = [weak.v[1] * weak.boundary(side) for side in list(weak.mesh.sides)[1:3]]
    for kind in (weights, pairs, sides):
        assert len({form.signature() for form in kind}) == 2
        assert len({numbered(form, weak.mesh.domain).signature() for form in kind}) == 1
    inner = [numbered(form, weak.mesh.domain) for form in forces_of_energy(weak, dx.fem.Function(weak.space), {})]
    assert len(inner) == len(weak.problem.bodies)
    assert len({form.signature() for form in inner}) == 1
    alone = system_of(read("block", ["geometry.mesh_size=1.0"])).weak
    assert alone.elasticity().signature() == weak.elasticity().signature()  # whatever the number of bodies
    found = [dx.assemble_vector(weak.compile(form)).array for form in (*weights, *pairs)]
    assert_allclose(dx.assemble_vector(*map(weak.compile, weights)).array, found[0] + found[1], rtol=1e-15)
    assert not np.any(found[0] * found[1])  # no node is in both bodies
    first, second = (part.reshape(-1, 2).sum(axis=0) for part in found[2:])
    assert_allclose(first, [weak.size(one), weak.size(other)], rtol=1e-12)
    assert_allclose(second, [weak.size(one), weak.size(third)], rtol=1e-12)
