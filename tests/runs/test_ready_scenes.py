"""Every ready scene, end to end: what stands in the files agrees with itself and obeys mechanics."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pyvista
from numpy.testing import assert_allclose

from shared.measures import facets_miss, measures
from shared.solved import ROUNDING, ZERO, Solved
from stickslip.geometry.amplitude import value_at
from stickslip.geometry.arrays import Array, cross
from stickslip.geometry.builders.domes import Domes
from stickslip.geometry.expression import Expression, Varying
from stickslip.geometry.obstacles.plane import Plane
from stickslip.solvers.laws.cohesion import Cohesion
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.laws.law import FrictionLaw
from stickslip.solvers.laws.orthotropic_coulomb import OrthotropicCoulomb
from stickslip.solvers.laws.pressure_dependent import PressureDependent
from stickslip.solvers.laws.slip_dependent import StaticKinetic
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.formats.steps import read_step, step_name

MOST: dict[type[FrictionLaw], Callable[[Any], float]] = {  # largest slope of the bound
    Coulomb: lambda law: law.mu,
    StaticKinetic: lambda law: law.mu_s,
    Cohesion: lambda law: law.mu,
    PressureDependent: lambda law: max(mu for _, mu in law.mu),
    OrthotropicCoulomb: lambda law: max(law.mu_1, law.mu_2),
}


def weight(solved: Solved, time: float) -> Any:
    """Resultant of gravity and body forces (d,) [N] and its moment about the origin, from VTK's straight cells."""
    scene = solved.scene
    if not {"gravity", "body_force"} & scene.sections.keys():
        return np.zeros(scene.dim), np.zeros(1 if scene.dim == 2 else 3)
    assert scene.geometry.order == 1
    reader: Any = pyvista.get_reader(str(solved.folder / "fields.xdmf"))  # type: ignore[no-untyped-call]
    grid = reader.read()
    grid = grid[0] if isinstance(grid, pyvista.MultiBlock) else grid
    names = list(scene.geometry.bodies(scene.dim))
    of_body = np.zeros((len(names), scene.dim))  # force per volume
    if "gravity" in scene.sections:
        acceleration = [value_at(a, time, scene.steps.end) for a in scene.sections["gravity"].acceleration]
        of_body += np.outer([scene.bodies[name].density or 0.0 for name in names], acceleration)
    for body, table in scene.sections.get("body_force", {}).items():
        of_body[names.index(body)] += [valued(scene, f, np.zeros(3), time) for f in table.force]
    sizes = np.array(grid.compute_cell_sizes().cell_data[("Area", "Volume")[scene.dim - 2]])
    forces = sizes[:, None] * of_body[np.array(grid.cell_data["body"]).astype(int)]
    centres = np.array(grid.cell_centers().points)[:, : scene.dim]
    return forces.sum(axis=0), np.atleast_1d(cross(centres, forces).sum(axis=0))


def valued(scene: Scene, value: Varying, at: Array, time: float) -> float:
    """A value in time, or an expression at a place (d,)."""
    if isinstance(value, str):
        return float(Expression(value)(at[None], time, scene.steps.end)[0])
    return value_at(value, time, scene.steps.end)


def push(scene: Scene, time: float) -> Any:
    """Resultant of the loads (d,) [N] and its moment about the origin: forces, and pressures on flat sides."""
    pull, turn = np.zeros(scene.dim), np.zeros(1 if scene.dim == 2 else 3)
    for load in scene.loads.values():
        if load.pressure is not None:
            assert load.boundary is not None
            corners, normals = scene.geometry.sample(load.boundary, scene.dim)
            area = measures(scene.geometry, scene.dim)[load.boundary]
            ends = corners[[0, -1]] if isinstance(load.pressure, str) else corners.mean(axis=0)[None].repeat(2, axis=0)
            for place, share in ((0.5 - 0.15**0.5, 5 / 18), (0.5, 4 / 9), (0.5 + 0.15**0.5, 5 / 18)):  # Gauss
                x = ends[0] + place * (ends[1] - ends[0])
                force = -valued(scene, load.pressure, x, time) * share * area * normals[0]
                pull, turn = pull + force, turn + cross(x, force)
            continue
        assert load.force is not None  # a ready scene with another load: add its resultant here
        assert load.boundary == "inner.inside"  # a circle about the origin, where its middle is
        pull += [value_at(a, time, scene.steps.end) for a in load.force]
    return pull, turn


def arm(scene: Scene) -> float:
    """How far apart bodies may have been that touch [m]: as far as supports and springs have moved."""
    tables = [a for support in scene.supports.values() for a in support.displacement.values()]
    tables += [a for place, a in scene.drives().items() if place.table == "springs"]
    return max((abs(value_at(a, t, scene.steps.end)) for a in tables for t in scene.requested_times()), default=0.0)


def pulled(scene: Scene, step: dict[str, Any]) -> Any:
    """Force and moment about the origin of each remote point, and spring to the ground, in the middle of its side."""
    found: dict[str, Any] = dict(scene.sections.get("springs", {}))
    for name, point in scene.sections.get("remote_points", {}).items():
        force, moment = (np.atleast_1d(step["remote_points"][name][key]) for key in ("force", "moment"))
        yield force, moment + np.atleast_1d(cross(np.array(point.point), force))
    for name, spring in found.items():
        assert spring.to is None
        force = np.array(step["springs"][name]["force"])
        yield force, np.atleast_1d(cross(scene.geometry.sample(spring.at, scene.dim)[0].mean(axis=0), force))


def test_forces_and_moments_balance(solved: Solved) -> None:
    scene = solved.scene
    lever = np.ptp(scene.geometry.box(scene.dim), axis=0).max()
    for step in solved.result["steps"]:
        outside = [c for n, c in step["contacts"].items() if scene.contacts[n].against in scene.obstacles]
        parts = [*outside, *step["supports"].values(), *step["elastic_support"].values()]
        resultants = [weight(solved, step["time"]), push(scene, step["time"]), *pulled(scene, step)]
        forces = np.array([*(r[0] for r in resultants), *(part["force"] for part in parts)])
        moments = np.array([*(r[1] for r in resultants), *(np.atleast_1d(part["moment"]) for part in parts)])
        largest = max([np.abs(forces).max(), *(c["normal_force"] for c in step["contacts"].values())])
        assert_allclose(forces.sum(axis=0), 0, atol=ZERO * largest)
        # friction acts on both bodies where they were, and turns them by its arm: the gap that has closed between them
        inside = [name for name in step["contacts"] if scene.contacts[name].against not in scene.obstacles]
        rubbed = 0.0
        for points in (solved.points(name, step["time"]) for name in inside):
            rubbed += points["weight"] @ np.linalg.norm(points["traction"], axis=1)
        # where surfaces slide, pressure too acts on both bodies where they were
        rubbed += sum(step["contacts"][name]["normal_force"] for name in inside if scene.contacts[name].sliding)
        assert_allclose(moments.sum(axis=0), 0, atol=ZERO * lever * largest + arm(scene) * rubbed)


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
    rubs = any(contact.friction is not None for contact in solved.scene.contacts.values())
    assert (
        any(contact["dissipation"] > 0 for _, _, contact in solved.contacts) == rubs
    )  # with friction all slip somewhere


def test_areas_add_up(solved: Solved) -> None:
    for step, name, contact in solved.contacts:
        points = solved.points(name, step["time"])
        touching = points["weight"][points["status"] != "open"].sum()
        assert_allclose(contact["stick_area"] + contact["slip_area"], contact["contact_area"], rtol=ROUNDING)
        assert_allclose(contact["contact_area"], touching, rtol=ROUNDING)
        scene = solved.scene
        side = measures(scene.geometry, scene.dim)[scene.contacts[name].surface]
        if scene.axisymmetric:  # Archimedes: the zone of a sphere is as large as that of its cylinder
            side = 2 * np.pi * scene.geometry.radius**2
        if isinstance(scene.geometry, Domes):  # of round sides only the part near the poles is near the other side
            assert 0 < points["weight"].sum() < side
            continue
        stretched = 0.02 if scene.contacts[name].sliding else 0.0  # weights are those of the surface as it is
        assert_allclose(points["weight"].sum(), side, rtol=facets_miss(scene.geometry) + stretched)


def test_audit_finds_nothing(solved: Solved) -> None:
    for step in solved.result["steps"]:
        assert max(step["audit"].values()) <= 1e-7  # solved to 1e-8, and measured by other scales
        assert step["residual"] <= solved.scene.solver.tolerance
    for metric, worst in solved.result["audit"].items():
        assert worst == max(step["audit"][metric] for step in solved.result["steps"])


def test_the_law_bounds_the_tangential_force(solved: Solved) -> None:
    for _, name, contact in solved.contacts:
        law = solved.scene.contacts[name].friction
        if law is None:
            assert contact["tangential_force"] == 0
            continue
        most, a = MOST[type(law)](law), law.at_no_pressure
        bound = a * contact["contact_area"] + most * contact["normal_force"]
        assert contact["tangential_force"] <= bound * (1 + ZERO)


# --- the tables agree with result.json


def test_contact_table_agrees_with_the_result(solved: Solved) -> None:
    for step, name, contact in solved.contacts:
        points, scale = solved.points(name, step["time"]), contact["normal_force"]
        assert set(points["status"]) <= {"open", "slip", "stick"}
        assert_allclose(points["weight"] @ points["pressure"], scale, rtol=ROUNDING)
        around = [0.0, 1.0] if solved.scene.axisymmetric else 1.0  # over the full circle the radial parts balance
        tangential = points["weight"] @ points["traction"] * around
        assert_allclose(np.linalg.norm(tangential), contact["tangential_force"], atol=ROUNDING * scale)
        obstacle = solved.scene.obstacles.get(solved.scene.contacts[name].against)
        if isinstance(obstacle, Plane):  # elsewhere a node carries pressure of several directions
            push = (points["weight"] * points["pressure"]) @ obstacle.normals(points["x"]) * around
            assert_allclose(contact["force"], push + tangential, atol=ROUNDING * scale)
        slid = np.linalg.norm(points["slip"][points["status"] != "open"], axis=1).max()
        assert_allclose(contact["max_slip"], slid, rtol=ROUNDING)
        assert_allclose(np.linalg.norm(points["lambda"], axis=1).clip(1), 1, rtol=1e-6)  # |lambda| <= 1
        slipping, rubs = points["status"] == "slip", float(solved.scene.contacts[name].friction is not None)
        assert_allclose(np.linalg.norm(points["lambda"][slipping], axis=1), rubs, rtol=1e-6)


def test_history_agrees_with_the_result(solved: Solved) -> None:
    rows = solved.rows("history.csv")
    for index, step in enumerate(solved.result["steps"], start=1):
        mine = [row for row in rows if int(row["step"]) == index]
        assert float(mine[-1]["time"]) == step["time"]
        assert float(mine[-1]["residual"]) == step["residual"]
        assert step["substeps"] == 1  # coarse and easy: no step is cut
        assert sum(int(row["iteration"]) > 0 for row in mine) == step["iterations"]  # of every search for pairs
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
