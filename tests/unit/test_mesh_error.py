"""One rule states the error of the mesh of every number, by better cells and by coarser ones."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip import ErrorParts, Quantity, Simulation, StepResult, prepare, read
from stickslip.solvers.accuracy.areas import areas_inside_facets
from stickslip.solvers.accuracy.histories import OtherHistory, cells_along
from stickslip.solvers.accuracy.mesh_error import Better, errors_of_step
from stickslip.solvers.accuracy.nested_run import Corners, cut_cells
from stickslip.solvers.results.step_result import quantities

COARSE = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25"]
PEAK = Quantity("contacts", "base", "max_pressure")


@cache
def solved() -> tuple[Simulation, StepResult]:
    simulation = prepare(read("block", COARSE))
    *_, last = simulation.steps()
    return simulation, last


def test_stated_is_the_larger_of_two_differences() -> None:
    simulation, last = solved()
    times, system = simulation.scene.requested_times(), simulation.system
    steps, raised = list(simulation.steps()), OtherHistory.of_order(system, 2).stepper.system
    cut = cut_cells(system, raised, steps, lambda size: True)
    assert cut is not None
    better, coarser = OtherHistory.on(system, cut), OtherHistory.coarser(system, 2.0)
    (*_, fine), (*_, rough) = better(times), coarser(times)
    areas = areas_inside_facets(better.stepper.system.contacts, fine)
    *_, errors = simulation.errors(steps)
    judged = 0
    for key, value in quantities(last).items():
        if key.kind in ("bodies", "probes") or errors[key].converges is False:
            continue  # stresses: at corners of cells
        off = np.abs(value - quantities(fine)[key])
        if key in areas:
            off = max(off / 2, abs(value - areas[key]))
        expected = np.maximum(1.4 * off, np.abs(value - quantities(rough)[key]) / 3)
        assert_allclose(errors[key].mesh, expected, rtol=1e-9, atol=1e-14, err_msg=str(key))
        assert errors[key].by == "order 2"
        judged += 1
    assert judged > 20


def test_cells_that_cannot_be_finer_tell_nothing() -> None:
    """Cubes of order 2 whose size is so near to the side that two thirds of it make as many."""
    simulation = prepare(read("cube", ["geometry.order=2", "geometry.mesh_size=0.6"]))
    *_, errors = simulation.errors(list(simulation.steps()))
    force = errors[Quantity("contacts", "base", "normal_force")]
    assert force.by == "rough"
    assert 0 < force.mesh < 1e-3


def stated(better: float | None, coarser: float | None, order: int = 1, **given: object) -> ErrorParts:
    """Of a largest pressure of 1, twice the mean one, that is another on other cells."""
    simulation, last = solved()

    def as_if(peak: float) -> StepResult:
        base = {**last.contacts["base"].__dict__, "max_pressure": peak, "normal_force": 0.5, "contact_area": 1.0}
        return StepResult(**{**vars(last), "contacts": {"base": type(last.contacts["base"])(**base)}})

    near = () if better is None else (quantities(as_if(better)),)
    far = None if coarser is None else as_if(coarser)
    return errors_of_step(simulation.problem, order, as_if(1.0), Better(near, **given), far, "order 2")[PEAK]


@pytest.mark.parametrize("off", [0.01, 0.5])
def test_cells_that_lock_when_they_are_longer_tell_no_third(off: float) -> None:
    """Where all numbers are off by less of the difference to longer cells, one that is right by chance is, too."""
    simulation, last = solved()
    base = last.contacts["base"]
    names = [key.quantity for key in quantities(last) if key.name == "base" and key.quantity in vars(base)]
    longer = {**vars(base), **{name: 0.0 * getattr(base, name) for name in names}}
    far = StepResult(**{**vars(last), "contacts": {"base": type(base)(**longer)}})
    near = {key: value * (1 if key == PEAK else 1 - off) for key, value in quantities(last).items()}
    found = errors_of_step(simulation.problem, 1, last, Better((near,), frozenset({PEAK})), far, "order 2")
    assert found[PEAK].mesh == pytest.approx(base.max_pressure * min(1.4 * off, 1 / 3))


def test_what_grows_by_no_less_each_time_has_no_limit() -> None:
    assert stated(1.3, 0.8).converges is False
    assert stated(1.3, 0.8).mesh is None
    assert stated(1.1, 0.8).converges  # less and less
    assert stated(1.01, 0.99).converges  # hardly at all
    assert stated(1.3, None).converges is None
    assert stated(1.3, 0.8, smooth=frozenset({PEAK})).mesh == pytest.approx(1.4 * 0.3)


def test_cells_that_are_but_smaller_count_by_how_much_smaller_they_are() -> None:
    assert stated(1.05, 0.8, order=2, finer=1.5).mesh == pytest.approx(0.05 / (1 - 1 / 1.5**2))
    assert stated(1.12, 0.8, order=2, finer=1.5).converges is False  # as fast as before by logarithms of sizes
    assert stated(1.12, 0.8, order=2, finer=2.0).converges


def test_order_2_in_space_is_compared_with_smaller_cells() -> None:
    sets = ["geometry.mesh_size=0.5", "geometry.order=2", "steps.count=1"]
    simulation = prepare(read("cube", sets))
    steps = list(simulation.steps())
    finer = OtherHistory.coarser(simulation.system, 1 / 1.5)
    coarser, key = OtherHistory.coarser(simulation.system, 2.0), Quantity("contacts", "base", "normal_force")
    times = [step.time for step in steps]
    off, rough = (abs(quantities(steps[-1])[key] - quantities(each(times)[-1])[key]) for each in (finer, coarser))
    many = cells_along(finer.stepper.system.mesh) / cells_along(simulation.mesh)
    error = simulation.errors(steps)[-1][key]
    assert error.mesh == pytest.approx(max(off / (1 - 1 / many**2), rough / 7), rel=1e-6)
    assert off > 0
    assert error.by == "order 2"


def test_an_edge_of_stick_that_no_mesh_shows_may_lie_beside_any_node() -> None:
    sets = [*COARSE, "contacts.base.friction.mu=9.0", "steps.count=1"]
    simulation = prepare(read("block", sets))
    steps = list(simulation.steps())
    (base,), errors = simulation.system.contacts, simulation.errors(steps)[-1]
    assert steps[-1].contacts["base"].slip_area == 0
    for name in ("stick_area", "slip_area"):
        assert errors[Quantity("contacts", "base", name)].mesh == base.node_weights.max()


def test_without_better_cells_coarser_ones_tell() -> None:
    assert stated(None, 0.8).mesh == pytest.approx(0.2)
    assert stated(None, 0.8).by == "rough"
    assert stated(None, 0.8, order=2).mesh == pytest.approx(0.1)
    assert stated(1.01, 0.7, order=2).mesh == pytest.approx(0.1)  # a third: contact nodes decide it
    assert stated(None, None).mesh is None


def test_estimates_that_differ_are_unsure() -> None:
    assert stated(1.1, 0.8).unsure is None
    assert stated(1.001, 0.8).unsure
    assert stated(1.08, 0.97).unsure


def test_planes_of_symmetry_have_no_corners() -> None:
    """A quarter of a ring in a ring: all corners lie on planes that are held along their normal."""
    ring = Corners.of(prepare(read("shrink_fit", ["geometry.order=2", "output.error=false"])).system)
    block = Corners.of(prepare(read("block", [*COARSE, "geometry.order=2", "output.error=false"])).system)
    assert ring is not None
    assert block is not None
    assert not len(ring.points)
    assert len(block.points) == 4
    assert not block.far(np.array([4.0, 2.0]))
    assert block.far(np.array([2.0, 1.0]))
