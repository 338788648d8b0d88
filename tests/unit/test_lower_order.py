"""The error of the mesh with order 2 in 3D: about how large it is, and where nothing is known."""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from shared.cases import slow
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.nested_mesh import CornerMesh
from stickslip.solvers.accuracy.lower_order import sides_of
from stickslip.solvers.results.step_result import Quantity, quantities
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.solvers.stepping.stepper import StepError, Stepper
from stickslip.workflows.scene_file.read import read

SETS = ["geometry.order=2", "steps.count=1", "steps.end=1.0"]
HIDDEN = Quantity("contacts", "base", "max_pressure")  # at an edge: it has no limit


def simulation(mesh_size: float, cells: str) -> Simulation:
    return prepare(read("cube", [*SETS, f"geometry.mesh_size={mesh_size}", f"geometry.cells={cells}"]))


@pytest.mark.parametrize("cells", ["simplex", *slow("tensor")])
def test_what_is_stated_is_as_large_as_the_error(cells: str) -> None:
    coarse = simulation(1 / 3, cells)
    steps, (*_, exact) = [*coarse.steps()], simulation(1 / 8, cells).steps()
    *_, errors = coarse.errors(steps)
    true = quantities(exact)
    for key, value in quantities(steps[-1]).items():
        parts = errors[key]
        if key.quantity in ("normal_force", "contact_area"):
            off = abs(value - true[key])
            assert 0.3 * off - 1e-12 < parts.mesh < 6 * off + 1e-12, key
            assert parts.geometry == 0
            assert parts.total is not None
    assert errors[HIDDEN].converges is False


@pytest.mark.parametrize("cells", ["simplex", "tensor"])
def test_the_mesh_of_corners_has_the_same_cells_and_sides(cells: str) -> None:
    own = simulation(0.5, cells)
    data = own.data
    shape = CornerMesh(
        kind=data.shape, points=data.points, cells=data.cells, body=data.body, names=data.bodies,
        sides=sides_of(own.system),
    )  # fmt: skip
    mesh = build_mesh(shape, own.problem.request, MPI.COMM_WORLD)
    assert mesh.degree == 1
    assert mesh.domain.topology.index_map(3).size_local == len(data.cells)
    assert mesh.domain.geometry.x.shape[0] == 27
    assert sorted(mesh.sides) == sorted(own.system.mesh.sides)
    assert all(len(mesh.facets(side)) == len(own.system.mesh.facets(side)) for side in mesh.sides)


def test_from_a_step_on_that_was_cut_or_fails_nothing_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = prepare(read("cube", ["geometry.order=2", "geometry.mesh_size=0.5"]))
    first, second = whole.steps()
    assert len(whole.mesh_errors([first, second])) == 2
    assert len(whole.mesh_errors([first, replace(second, substeps=2)])) == 1
    reach = Stepper.reach

    def fails(self: Stepper, state, time, *rest):  # type: ignore[no-untyped-def]
        if time > first.time:
            raise StepError(time, "for the test", (), None)  # type: ignore[arg-type]
        return reach(self, state, time, *rest)

    monkeypatch.setattr(Stepper, "reach", fails)
    assert len(whole.mesh_errors([first, second])) == 1
    known = whole.mesh_errors([first])[0]
    assert np.isfinite(known[Quantity("contacts", "base", "contact_area")].mesh)
    force = Quantity("contacts", "base", "normal_force")
    assert force not in known  # it is known from bubbles
    assert first.errors[str(force)].mesh > 0
    assert whole.mesh_errors([replace(first, errors={})])[0][force].mesh > 0


def test_what_has_no_limit_has_no_error() -> None:
    """A spring at a point gives way the more, the finer the mesh is: bubbles do not show it."""
    spring = "springs.tip={at=[1.0, 1.0, 1.0], stiffness=0.05, direction=[1.0, 0.0, 0.0], displacement=[0.3, 0.0, 0.0]}"
    coarse = prepare(read("cube", [*SETS, "geometry.mesh_size=0.5", spring]))
    steps = [*coarse.steps()]
    for errors in (steps[-1].errors, {str(key): parts for key, parts in coarse.errors(steps)[-1].items()}):
        assert errors["springs.tip.force"].mesh is None
        assert errors["contacts.base.normal_force"].mesh is not None
