"""The audit's contact forces are UFL forms of the tractions: what the rows have wrong, it sees."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from shared.audited import record_of
from shared.cases import every_nth
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.contact.build import MultiplierNodes
from stickslip.solvers.results.audit import Auditor, Record
from stickslip.solvers.results.multiplier_forces import MultiplierForces
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.system.system import System

Array = NDArray[np.float64]
SceneOf = Callable[..., Scene]
SystemOf = Callable[[Scene], System]
SimulationOf = Callable[[Scene], Simulation]

MODELS: dict[str, tuple[int, str, dict[str, Any]]] = {
    "triangles": (2, "plane strain", {"contact_mesh_size": 0.11}),
    "quadratic triangles": (2, "plane strain", {"order": 2}),
    "quadratic quadrilaterals": (2, "plane strain", {"cells": "tensor", "order": 2}),
    "revolved": (2, "axisymmetric", {}),
    "quadratic, revolved": (2, "axisymmetric", {"order": 2}),
    "tetrahedra": (3, "3d", {"contact_mesh_size": 0.3}),
    "quadratic tetrahedra": (3, "3d", {"order": 2}),
    "hexahedra": (3, "3d", {"cells": "tensor"}),
    "quadratic hexahedra": (3, "3d", {"cells": "tensor", "order": 2}),
}
LAWS: dict[str, dict[str, Any]] = {
    "unilateral": {"normal": {"law": "unilateral"}},
    "unilateral, coulomb": {"normal": {"law": "unilateral"}, "friction": {"law": "coulomb", "mu": 0.3}},
    "bilateral, tresca": {"normal": {"law": "bilateral"}, "friction": {"law": "tresca", "bound": 0.05}},
    "unilateral, k_T": {"normal": {"law": "unilateral"}, "friction": {"law": "coulomb", "mu": 0.3, "k_T": 2.0}},
    "unilateral, stick": {"normal": {"law": "unilateral"}, "friction": {"law": "stick"}},
    "compliance, coulomb": {
        "normal": {"law": "compliance", "c_n": 4.0, "m_n": 1.5}, "friction": {"law": "coulomb", "mu": 0.3}
    },
    "tied": {"normal": {"law": "tied"}},
}  # fmt: skip
EDGES = ("free", "rolling", "held")
EXACT = 1e-13  # of the largest force


def scene(scene_of: SceneOf, model: str, law: str, edge: str = "free", **more: Any) -> Scene:
    """A block pressed and dragged on a plane; `rolling` and `held` supports of a side reach into the contact's edge.

    Args:
        more: keys of the contact.
    """
    dim, name, geometry = MODELS[model]
    axes = "xyz"[:dim]
    drag = dict.fromkeys(axes, 0.0) | {"x": 0.0 if name == "axisymmetric" else 0.02, axes[-1]: -0.1}
    supports: dict[str, Any] = {"top": {"boundary": "block.top", "displacement": drag}}
    if edge == "rolling":
        supports = {"side": {"boundary": "block.right", "displacement": {"x": 0.0}}}
    if edge == "held":  # the normal motion of the edge too: its neighbours share its multiplier
        supports = {"side": {"boundary": "block.right", "displacement": dict.fromkeys(axes, 0.0)}}
    contacts = {"base": {"surface": "block.bottom", "against": "foundation", **LAWS[law], **more}}
    tables = {"supports": supports, "contacts": contacts, "solver": {"tolerance": 1e-10}}
    return scene_of(dim, geometry, model=name, **tables)


def compared(system: System, moved: Array | None = None, forces: MultiplierForces | None = None) -> tuple[Array, Array]:
    """Forces by rows and by forms of admissible random tractions; compliant pressures are no multipliers."""
    start, random = system.contacts[0], np.random.default_rng(5)
    forces = forces or MultiplierForces(system, start)
    (rows,) = system.searched({"base": moved}).contacts if moved is not None else system.contacts
    cone = AdmissibleSet((rows,), 1.0, 1.0)
    hat = random.normal(size=cone.size) + 0.2  # pressed, open, sticking and slipping somewhere
    p = cone.project(hat, np.ones(cone.size))
    (place,) = cone.places
    p_n, t = p[place.normal], p[place.tangential].reshape(rows.free.shape)
    s = cone.bound(place, p_n) if rows.friction is not None else np.zeros(0)
    found = forces(rows, p_n, t, s, 1.0, moved).array
    of_rows = np.zeros_like(p_n) if rows.normal.at_quadrature else p_n
    return found, system.interface.force_of(rows, of_rows, t).array


@pytest.mark.parametrize(("model", "law", "edge"), every_nth(4, MODELS, LAWS, EDGES))
def test_forms_of_the_tractions_are_the_forces_of_the_rows(
    model: str, law: str, edge: str, scene_of: SceneOf, system_of: SystemOf
) -> None:
    system = system_of(scene(scene_of, model, law, edge))
    (rows,) = system.contacts
    if not rows.normal.at_quadrature:
        assert (len(rows.W_n) < len(rows.surface.nodes)) == (edge == "held")
    found, expected = compared(system)
    assert np.abs(expected).max() > 0
    assert_allclose(found, expected, rtol=0, atol=EXACT * np.abs(expected).max())


@pytest.mark.parametrize("model", ["triangles", "quadratic, revolved", "tetrahedra", "quadratic tetrahedra"])
def test_they_are_so_on_a_round_obstacle_and_a_periodic_side(
    model: str, scene_of: SceneOf, system_of: SystemOf
) -> None:
    dim, name, geometry = MODELS[model]
    ball = {"shape": "sphere", "center": [0.0, *[0.5] * (dim - 2), -3.0], "radius": 3.0}
    if name == "plane strain":
        ball = {"shape": "cylinder", "point": [1.0, -3.0], "radius": 3.0}
    contact = {"base": {"surface": "block.bottom", "against": "ball", **LAWS["unilateral, coulomb"]}}
    periodic = {} if name == "axisymmetric" else {"x": {"boundary": "block.right", "with": "block.left"}}
    system = system_of(
        scene_of(dim, geometry, model=name, obstacles={"ball": ball}, contacts=contact, periodic=periodic)
    )
    found, expected = compared(system)
    assert_allclose(found, expected, rtol=0, atol=EXACT * np.abs(expected).max())


@pytest.mark.parametrize("model", [m for m in MODELS if MODELS[m][2].get("cells") != "tensor"])
def test_a_contact_that_slides_gets_new_fields_and_areas_and_no_new_forms(
    model: str, scene_of: SceneOf, system_of: SystemOf
) -> None:
    system = system_of(scene(scene_of, model, "unilateral, k_T", sliding=True))
    (rows,) = system.contacts
    forces = MultiplierForces(system, rows)
    compiled = system.counters.forms
    x = rows.surface.points
    for size in (0.05, 0.2):
        bent = size * x[:, :1] ** 2 * np.arange(1.0, x.shape[1] + 1)  # stretched and tilted
        found, expected = compared(system, bent, forces)
        assert_allclose(found, expected, rtol=0, atol=EXACT * np.abs(expected).max())
    assert system.counters.forms == compiled
    found, expected = compared(system, None, forces)  # back at the start
    assert_allclose(found, expected, rtol=0, atol=EXACT * np.abs(expected).max())


def test_a_traction_where_nothing_presses_is_a_force_too(scene_of: SceneOf, system_of: SystemOf) -> None:
    """It breaks the law of friction, which is said there; equilibrium is that of the tractions as they are."""
    system = system_of(scene(scene_of, "triangles", "unilateral, coulomb"))
    (rows,) = system.contacts
    p_n, t = np.zeros(len(rows.W_n)), np.ones(rows.free.shape)
    found = MultiplierForces(system, rows)(rows, p_n, t, np.zeros(len(t)), 1.0, None).array
    expected = system.interface.force_of(rows, p_n, t).array
    assert_allclose(found, expected, rtol=0, atol=EXACT * np.abs(expected).max())


Change = Callable[[Any], Any]
# wrong in the solver and in the audit alike: both take the rows from the same code
WRONG: dict[str, tuple[type, str, Change]] = {
    "W": (MultiplierNodes, "rows", lambda found: (found[0], 1.1 * found[1])),
    "N": (MultiplierNodes, "rows", lambda found: (1.1 * found[0], found[1])),
    "order of rows": (MultiplierNodes, "rows", lambda found: (found[0][::-1], found[1][::-1])),
    "areas of nodes": (Surface, "node_weights", lambda found: 1.1 * found),
}


def audited(scene_of: SceneOf, simulation_of: SimulationOf, model: str) -> tuple[Auditor, Record]:
    simulation = simulation_of(scene(scene_of, model, "unilateral, coulomb"))
    (step,) = simulation.steps()
    return Auditor(simulation.problem, simulation.mesh), record_of(step)


def by_rows(auditor: Auditor, record: Record) -> float:
    """Equilibrium with the forces N^T W p of the audit's own rows."""

    def force(place: Any, u: Any, record: Record, scales: Any) -> Any:
        p_n, t = record.p[place.normal], record.p[place.tangential].reshape(-1, place.components)
        return auditor.system.interface.force_of(place.rows, p_n, t)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(auditor, "_contact_force", force)
        return auditor(record).equilibrium


@pytest.mark.parametrize(("wrong", "model"), every_nth(2, WRONG, ["triangles", "revolved", "tetrahedra"]))
def test_wrong_rows_show_in_equilibrium_though_they_agree_with_themselves(
    wrong: str, model: str, scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    where, name, change = WRONG[wrong]
    right = getattr(where, name)
    monkeypatch.setattr(where, name, lambda *args: change(right(*args)))
    auditor, record = audited(scene_of, simulation_of, model)
    assert by_rows(auditor, record) < 1e-10  # hidden
    assert auditor(record).equilibrium > 1e-3


@pytest.mark.parametrize("model", ["triangles", "revolved", "tetrahedra"])
def test_right_rows_are_in_equilibrium(model: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    auditor, record = audited(scene_of, simulation_of, model)
    assert auditor(record).equilibrium < 1e-13


def test_the_forms_are_compiled_once(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    auditor, record = audited(scene_of, simulation_of, "triangles")
    auditor(record)
    compiled = auditor.start.counters.forms
    auditor(record)
    assert auditor.start.counters.forms == compiled
