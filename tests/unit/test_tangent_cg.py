"""tangent-cg: the answers of condensed-newton for two linear solves, in coordinates that contain the contact rows."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose
from petsc4py import PETSc

from shared.cells import REFERENCE, Cell, largest, reference, refused, solved
from stickslip.geometry.errors import SolverError
from stickslip.geometry.protocols import PC, Mat
from stickslip.solvers.linear import multigrid
from stickslip.solvers.results.linear_reference import linear_reference
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.tangent import operator as operator_module
from stickslip.solvers.tangent.coordinates import ContactCoordinates
from stickslip.solvers.tangent.operator import TangentOperator
from stickslip.workflows.scene_file.read import read
from stickslip.workflows.verification.prepared import prepare

SAME = 1e-7  # two decades above the tolerance: friction's condition
CELLS = [
    Cell("tangent-cg", model="3d"),  # lifts off when it is relieved
    Cell("tangent-cg", friction=None, model="3d"),
    Cell("tangent-cg", friction="capped_coulomb", operator="mortar", model="3d"),
    Cell("tangent-cg", normal="compliance", operator="mortar", model="3d"),
    Cell("tangent-cg", model="3d", more="order 2"),
    Cell("tangent-cg", operator="mortar", model="3d", more="floating"),
    Cell("tangent-cg", operator="node-to-segment", more="k_T"),
]
METHOD = ['solver={ method = "tangent-cg", tolerance = 1e-8 }', "output.error=false"]
BACK = "supports.top.displacement={ x = [[0, 0], [1, 0], [2, 0.02], [3, -0.01]], y = 0.0, z = [[0, 0], [1, -0.05]] }"


def cube(*settings: str) -> Scene:
    return read("cube", [*METHOD, *settings])


def ran(scene: Scene) -> tuple[Simulation, list[np.ndarray]]:
    """The simulation, and the forces of all steps."""
    simulation = prepare(scene, MPI.COMM_SELF)
    contact = next(iter(simulation.problem.pairs))
    return simulation, [step.contacts[contact].force for step in simulation.steps()]


@pytest.mark.parametrize("cell", CELLS, ids=str)
def test_the_answer_is_that_of_newton(cell: Cell) -> None:
    assert largest(solved(cell.scene(1e-9))[1], reference(replace(cell, method=REFERENCE), 1e-9)) < SAME


@pytest.mark.parametrize(
    "scene",
    [
        ("cube", "geometry.mesh_size=0.25", BACK, "steps={ end = 3.0, count = 3 }"),  # slip that turns back
        ("half_ball", "geometry.contact_mesh_size=0.1", "steps.count=2"),
    ],
    ids=lambda scene: scene[0],
)
def test_ready_scenes_have_the_forces_of_newton(scene: tuple[str, ...]) -> None:
    name, *settings = scene
    found = ran(read(name, [*METHOD, *settings]))[1]
    expected = ran(read(name, ["solver.method=condensed-newton", "output.error=false", *settings]))[1]
    assert_allclose(found, expected, rtol=0, atol=SAME * np.abs(expected).max())


@pytest.mark.parametrize("operator", ["rigid", "mortar"])
def test_relative_displacements_are_coordinates(operator: str) -> None:
    simulation = prepare(Cell("tangent-cg", operator=operator, model="3d").scene(1e-9), MPI.COMM_SELF)
    surface, system = simulation.stepper.surface, simulation.system
    coordinates = ContactCoordinates.of(system, surface)
    at = TangentOperator(system, coordinates)
    u = system.K_B.createVecRight()
    u.array[:] = np.random.default_rng(1).standard_normal(u.getLocalSize())
    v = at.coordinates(u)
    rows = coordinates.at >= 0
    assert_allclose(v[coordinates.at[rows]], (surface.N @ u.array[system.interface.dofs])[rows], atol=1e-12)
    assert_allclose(at.displacement(v).array, u.array, atol=1e-12)  # T T^-1
    K_u = at.forces(system.K_B * u)
    assert_allclose(at.product(v), K_u, atol=1e-12)  # (T^T K T) T^-1 u
    alone = np.zeros_like(v)
    alone[at.at] = v[at.at]
    assert_allclose(at.of_slaves(v[at.at]), at.product(alone), atol=1e-12)
    assert coordinates.alone == (operator == "rigid")


@pytest.mark.parametrize("of_nodes", ["all", "normal"])  # of their motions
@pytest.mark.parametrize("operator", ["rigid", "mortar"])
def test_multigrid_has_the_stiffness_without_held_motions(
    operator: str, of_nodes: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = prepare(Cell("tangent-cg", operator=operator, model="3d").scene(1e-9), MPI.COMM_SELF)
    surface, system = simulation.stepper.surface, simulation.system
    every = ContactCoordinates.of(system, surface)
    some = every.blocks[::2].ravel()
    some = some if of_nodes == "all" else np.intersect1d(some, every.normal)
    given: list[Mat] = []
    made: list[PC] = []

    def kept(K: Mat, *others: Any, **options: Any) -> PC:
        given.append(K.copy())
        made.append(multigrid.multigrid(K, *others, **options))
        return made[-1]

    monkeypatch.setattr(operator_module, "multigrid", kept)
    before = system.K_B.copy()
    at = TangentOperator(system, every)
    part = ContactCoordinates.of(system, surface, some)
    at.hold(part, some)
    assert [bool(each) for each in made] == [False, True]  # the first is destroyed: there is memory for one
    assert system.K_B.equal(before)
    for found, coordinates, held in zip(given, (every, part), (every.blocks.ravel(), some), strict=True):
        expected = before.PtAP(coordinates.T)
        expected.zeroRowsColumns(held.astype(PETSc.IntType))
        found.zeroRowsColumns(held.astype(PETSc.IntType))  # their diagonal is a mean
        expected.axpy(-1.0, found, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        assert expected.norm() < 1e-14 * before.norm()


def test_two_steps_cost_two_linear_solves_on_any_mesh() -> None:
    """Multigrid cycles; of a linear solve to 1e-8 as the price table counts them."""
    for n in (6, 12):
        simulation, _ = ran(cube(f"geometry.mesh_size={1 / n}"))
        solve = linear_reference(simulation.system, f"cg+{'boomeramg' if multigrid.HYPRE else 'gamg'}")
        (timing,) = solve.solvers.values()
        assert timing.iterations is not None
        assert simulation.counters.linear_iterations <= 2.5 * timing.iterations


def test_gamg_stands_in_for_hypre(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = ran(cube("geometry.mesh_size=0.25"))[1]
    monkeypatch.setattr(multigrid, "HYPRE", False)
    assert_allclose(ran(cube("geometry.mesh_size=0.25"))[1], expected, rtol=0, atol=SAME * np.abs(expected).max())


def test_no_equilibrium_is_found_by_the_certificate(
    scene_of: Callable[..., Scene], simulation_of: Callable[[Scene], Simulation]
) -> None:
    pushed = scene_of(
        contacts={
            "base": {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": 0.3}}
        },
        supports={},
        loads={"top": {"boundary": "block.top", "traction": [0.0031, -0.01]}},
        solver={"method": "tangent-cg"},
    )
    with pytest.raises(Exception, match="cannot balance the loads"):
        list(simulation_of(pushed).steps())


def test_driven_obstacles_are_refused() -> None:
    sentence = refused(Cell("tangent-cg", more="driven"))
    assert sentence == "solver.method = tangent-cg: cannot move obstacles.other by a force; use condensed-newton"


def test_auto_goes_on_without_it_where_rows_depend_on_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = read("cube", ["geometry.mesh_size=0.25", "solver.surface=matrix-free", "output.error=false"])
    expected = ran(scene)

    def refuse(*_: object) -> ContactCoordinates:
        raise SolverError("the contact rows of a node are nearly the same")

    monkeypatch.setattr(ContactCoordinates, "of", refuse)
    found = ran(scene)
    assert_allclose(found[1], expected[1], rtol=0, atol=1e-5 * np.abs(expected[1]).max())
    (switch,) = found[0].stepper.chain.switches
    assert (switch.before, switch.after) == ("tangent-cg (matrix-free)", "surface-uzawa (matrix-free)")
    assert "nearly the same" in switch.because
    assert not expected[0].stepper.chain.switches
