"""The error of the mesh with order 2: against finer meshes, where there is none, and what it costs."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.geometry import dolfinx_versions as dx
from stickslip.solvers.accuracy import nested_run
from stickslip.solvers.accuracy.bubbles import Bubbles
from stickslip.solvers.accuracy.nested_run import NestedRun, Places
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.results.step_result import Errors, Quantity, StepResult, quantities
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.solvers.system.system import System
from stickslip.workflows.scene_file.read import read

SystemOf = Callable[[Scene], System]
COARSE = ["geometry.order=2", "geometry.mesh_size=0.3", "geometry.contact_mesh_size=0.15"]
FINE = ["geometry.order=2", "geometry.mesh_size=0.1", "geometry.contact_mesh_size=0.025"]


def solved(name: str, *sets: str) -> tuple[Simulation, list[StepResult]]:
    simulation = prepare(read(name, sets))
    return simulation, [*simulation.steps()]


def errors_of(name: str, *sets: str) -> tuple[StepResult, Errors]:
    """The last step and its errors."""
    simulation, steps = solved(name, *sets)
    return steps[-1], simulation.errors(steps)[-1]


def test_areas_that_agree_by_chance_are_not_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    """The other mesh finds the same; the edge of contact lies somewhere in a facet all the same."""
    simulation, steps = solved("cylinders", "geometry.mesh_size=3.0", "geometry.contact_mesh_size=0.2", "steps.count=2")
    monkeypatch.setattr(NestedRun, "_finer", lambda *given: map(quantities, steps))
    errors = simulation.mesh_errors(steps)[-1]
    area, force = (errors[Quantity("contacts", "line", name)].mesh for name in ("contact_area", "normal_force"))
    assert force == 0
    assert area == pytest.approx(nested_run.ANYWHERE * 0.1 * np.sqrt(2), rel=0.3)  # two half facets


@pytest.mark.parametrize("cells", ["simplex", "tensor"])
@pytest.mark.parametrize("model", ["plane strain", "axisymmetric"])
def test_forces_of_bubbles_are_those_of_order_3(
    model: str, cells: str, scene_of: Callable[..., Scene], system_of: SystemOf
) -> None:
    held = {"top": {"boundary": "block.top", "displacement": {"y": -0.1}}}
    base = {"base": {"surface": "block.bottom", "against": "foundation"}}
    shape = {"order": 2, "mesh_size": 0.5, "cells": cells}
    system = system_of(scene_of(model=model, geometry=shape, contacts=base, supports=held))
    bubbles = Bubbles(system)
    weak = WeakForms(system.problem, system.mesh, bubbles.space, system.counters, 8)
    K = dx.assemble_matrix(weak.compile(weak.elasticity()))
    random = np.random.default_rng(0)
    x, u = bubbles.zero(), system.vector()
    x.array[:], u.array[:] = random.random(len(x.array)), random.random(len(u.array))
    x = bubbles.displacement(bubbles.free(x))
    u.array[0::2] *= system.nodes.points[:, 0]  # none of the axis
    whole, own = dx.fem.Function(bubbles.space), dx.fem.Function(system.space)
    dx.fill(own, u.array)
    whole.interpolate(own)
    total = x.copy()
    total.array[:] += whole.x.array[: len(total.array)]
    expected = bubbles.free(K * total).array
    slack = 3e-2 if model == "axisymmetric" else 1e-12  # 1/r is integrated by other rules
    assert_allclose(bubbles.free(bubbles.inner(u, x)).array, expected, atol=slack * np.abs(expected).max())
    assert u.dot(bubbles.pull(x)) == pytest.approx(x.dot(bubbles.inner(u, 0.0 * x)), rel=1e-12)
    assert len(np.unique(bubbles.nodes.input)) == len(bubbles.nodes.input)


def test_stated_errors_are_true() -> None:
    step, stated = errors_of("block", *COARSE)
    truth = quantities(solved("block", *FINE)[1][-1])
    keys = [Quantity("contacts", "base", key) for key in ("tangential_force", "dissipation_total", "max_slip")]
    for key in [*keys, Quantity("contacts", "base", "force"), Quantity("energy", "", "stored")]:
        true = np.abs(quantities(step)[key] - truth[key])
        parts = stated[key]
        assert parts.geometry is not None
        assert np.all(parts.geometry == 0), key
        assert parts.total is not None, key
        assert np.all((parts.mesh > 0.7 * true) & (parts.mesh < 3 * true)), key
        assert np.all(np.abs(parts.corrected - truth[key]) < 0.5 * true), key


def test_a_pressure_without_limit_has_no_error_and_one_with_a_limit_has() -> None:
    step, corner = errors_of("block", *COARSE)
    key = Quantity("contacts", "base", "max_pressure")
    assert corner[key].converges is False
    assert corner[key].mesh is None
    step, smooth = errors_of("half_space", "geometry.order=2", "geometry.contact_mesh_size=0.05", "steps.count=4")
    key = Quantity("contacts", "track", "max_pressure")
    assert smooth[key].converges
    assert 0 < smooth[key].mesh < 0.02 * step.contacts["track"].max_pressure


def test_cells_are_cut_at_edges_of_contact_and_corners() -> None:
    simulation, steps = solved("half_space", "geometry.order=2")
    mesh = NestedRun(simulation.stepper, simulation.data)._flat()
    assert mesh is not None
    places = Places.of(simulation.problem, simulation.system.contacts, steps)
    x = mesh.points[places.nodes(mesh)]
    (c,), touching = simulation.system.contacts, steps[-1].contacts["track"].status > 0
    edge = np.abs(c.surface.points[touching, 0]).max()
    assert np.abs(x[:, 0] - edge).min() < 0.1 * edge
    low, high = simulation.mesh.box()
    for corner in (low, [high[0], low[1]]):  # those of the support
        assert np.linalg.norm(x - corner, axis=1).min() < 1e-12
    away = (np.abs(x - low) > 1e-9).all(axis=1) & (np.abs(x - high) > 1e-9).all(axis=1)
    assert not away.any()  # on sides alone


@pytest.mark.parametrize("name", ["sliding", "foundation", pytest.param("shaft", marks=pytest.mark.slow)])
def test_it_follows_sliding_and_grids_and_compliance(name: str) -> None:
    simulation, steps = solved(name, "geometry.order=2", "steps.count=2")
    found = simulation.mesh_errors(steps)
    (contact,) = steps[0].contacts
    assert len(found) == len(steps)
    force = Quantity("contacts", contact, "tangential_force")
    assert 0 < found[-1][force].mesh < 0.1 * steps[-1].contacts[contact].normal_force


def test_probes_and_their_displacement() -> None:
    step, stated = errors_of("block", *COARSE, "probes.inside.point=[1.3, 0.7]")
    found = stated[Quantity("probes", "inside", "displacement")]
    assert found.mesh.shape == (2,)
    assert (found.mesh > 0).all()
    assert np.linalg.norm(found.mesh) < 0.05 * np.linalg.norm(step.probes["inside"].displacement)
    assert stated[Quantity("probes", "inside", "stress")].mesh is None


def test_what_is_too_dear_is_cut_once_or_not_at_all(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation, steps = solved("block", *COARSE)
    run = NestedRun(simulation.stepper, simulation.data)
    (twice, fine), asked = run._cut_mesh(steps), list[float]()

    def price(size: Any) -> float:
        asked.append(size.dofs)
        return float(size.dofs)

    monkeypatch.setattr(nested_run, "_seconds", price)
    monkeypatch.setattr(nested_run, "SOON", 0.0)
    monkeypatch.setattr(nested_run, "MOST", 1e9)
    assert run._cut_mesh(steps)[0] == twice == 2
    own, dear = asked
    monkeypatch.setattr(nested_run, "MOST", 0.999 * dear / own)
    once, coarser = run._cut_mesh(steps)
    assert once == 1
    assert coarser is not None
    assert fine is not None
    assert len(simulation.data.points) < len(coarser.points) < len(fine.points)
    monkeypatch.setattr(nested_run, "MOST", 1.0)
    assert run._cut_mesh(steps) == (0, None)
    assert simulation.mesh_errors(steps) == ()
    parts = simulation.errors(steps)[-1][Quantity("contacts", "base", "normal_force")]
    assert parts.mesh is None
    assert parts.total is None


def test_its_work_is_that_of_errors() -> None:
    simulation, steps = solved("block", *COARSE)
    before, solves = simulation.seconds.error, simulation.counters.volume_solves
    simulation.mesh_errors(steps)
    assert simulation.seconds.error > before
    assert simulation.counters.volume_solves == solves
    assert simulation.counters.error_solves > 0


def test_none_from_the_first_step_on_that_was_cut() -> None:
    simulation, steps = solved(
        "two_blocks", "geometry.order=2", "geometry.mesh_size=0.4", "geometry.lower_mesh_size=0.4"
    )
    cut = [*steps[:1], replace(steps[1], substeps=2), *steps[2:]]
    assert len(simulation.mesh_errors(cut)) == 1
    assert simulation.mesh_errors([replace(steps[0], substeps=2)]) == ()


@pytest.mark.parametrize(("name", "sets"), [("cube", ["geometry.mesh_size=0.5"]), ("block", COARSE)])
def test_none_with_approximate_laws(name: str, sets: list[str]) -> None:
    simulation, steps = solved(name, "geometry.order=2", "solver.method=regularised", *sets)
    assert simulation.mesh_errors(steps) == ()
