"""Loads, thermal strains and averaged dilatations a second time, by quadratures of their own.

They are compared once, each at value 1 in time: no term is so small beside others that a per cent of it is lost.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CHUNK, Array, inverse_and_determinant
from stickslip.geometry.protocols import Mat, Vec
from stickslip.solvers.fem.elastic_energy import axes_again, stress_by_compliance
from stickslip.solvers.fem.terms import InitialStrain
from stickslip.solvers.results.second_numbers import SecondNumbers
from stickslip.solvers.scene.material import Material, Orthotropic
from stickslip.solvers.scene.timeline import Place
from stickslip.solvers.system.system import System

At = Callable[[Array], Array]  # values (m, ...) at points (m, d) [m]


class SecondForces:
    """Nodal forces (nodes, d) [N] in the order of the gmsh model."""

    def __init__(self, system: System, second: SecondNumbers) -> None:
        self._system, self._problem, self._second = system, system.problem, second

    def apart(self) -> dict[str, float | None]:
        """Difference of each term of the system from its second value, relative to it [-]; None: it has none.

        Collective.
        """
        system, known, again = self._system, dict[str, Vec](), dict[str, Array]()
        for drive, _, vector in system.loads.fixed:
            known[str(drive)] = known[str(drive)] + vector if str(drive) in known else vector
        for place, forces in self._loads():
            if (name := str(place)) in known:
                again[name] = forces() + again.get(name, 0.0)
        found = {name: self._off(vector, again[name]) if name in again else None for name, vector in known.items()}
        found |= {str(term.drive): None for term, _ in system.loads.changing}
        energies = np.diag(system.initial.coupling)
        for strain, vector, energy in zip(system.initial.strains, system.initial.forces, energies, strict=False):
            seen = strain.shrunk is None and not (strain.body in self._problem.averaged and strain.field)
            load, stored = self._initial(strain) if seen else (np.zeros(0), 0.0)
            name, off = f"initial strain of {strain.body}", abs(stored / energy - 1) if energy else 0.0
            found[name] = max(self._off(vector, load), off) if seen else None
        for body, (C, weight) in zip(self._problem.averaged, system.dilatation.terms(), strict=True):
            found[f"mean dilatation of {body}"] = self._dilatation(body, C, weight)
        return found

    def _off(self, vector: Vec, forces: Array) -> float:
        nodes = self._system.nodes
        off = np.abs(vector.array_r - forces[nodes.input[: nodes.owned]].ravel()).sum(), np.abs(vector.array_r).sum()
        apart, size = self._system.mesh.comm.allreduce(np.array(off))
        return float(apart / size) if size else float(apart > 0)

    def _loads(self) -> Iterator[tuple[Place, Callable[[], Array]]]:
        """Forces of loads of the scene, gravity, body forces and rotation, at value 1."""
        problem, axes = self._problem, dict(zip("xyz", np.eye(self._problem.dim), strict=False))
        for name, load in problem.loads.items():
            key = "pressure" if load.pressure is not None else "traction" if load.traction is not None else "force"
            for axis, along in axes.items() if key != "pressure" else [("", None)]:
                place = Place("loads", name, key, axis)
                yield place, partial(self._on_side, load.boundary, place, along, key == "force")
        for (name, body), (axis, along) in product(problem.bodies.items(), axes.items()):
            place = Place("gravity", "", "acceleration", axis)
            yield place, partial(self._in_body, name, partial(self._along, place, body.density * along))
            place = Place("body_force", name, "force", axis)
            yield place, partial(self._in_body, name, partial(self._along, place, along))
        table = problem.tables.get("centrifugal")
        if table is not None:
            turning = np.array(table.axis or ((0.0, 1.0) if problem.axisymmetric else np.zeros(problem.dim)), float)
            across = np.eye(problem.dim) - np.outer(turning, turning) / (turning @ turning or 1.0)
            centre = np.array(table.point or np.zeros(problem.dim))

            def outward(density: float, x: Array) -> Array:
                return np.asarray(density * (x - centre) @ across)

            for name, body in problem.bodies.items():
                place = Place("centrifugal", "", "speed")
                yield place, partial(self._in_body, name, partial(outward, body.density))

    def _along(self, place: Place, along: Array, x: Array) -> Array:
        """A direction (d,), or of stresses (3, 3), times the expression at a place of the scene, if it is one."""
        timeline = self._problem.timeline
        size = timeline.values(place, x, timeline.end) if place in timeline.expressions else np.ones(len(x))
        return np.asarray(size.reshape(-1, *[1] * along.ndim) * along)

    def _on_side(self, name: str, place: Place, along: Array | None, whole: bool) -> Array:
        """Forces of a traction on a side, without a direction of a pressure; whole: the force is that of the side."""
        side, total = self._second.side(name), np.zeros((self._system.nodes.total, self._problem.dim))
        area = side.quadrature(2 * side.degree)[0].sum() if whole else 1.0

        def traction(x: Array, normals: Array) -> Array:
            return (
                -normals * self._along(place, np.ones(1), x) if along is None else self._along(place, along / area, x)
            )

        total[side.input] = self._second.on_side(name, side.points, traction)
        return total

    def _initial(self, strain: InitialStrain) -> tuple[Array, float]:
        """Forces [N] of an initial strain at value 1, and the work of its stress on it [J]."""
        body, tables = self._problem.bodies[strain.body], self._problem.tables.get("thermal", {})
        own, flat, e = tables.get(strain.body), self._problem.model == "plane stress", strain.strain
        if own is not None and strain.drive.table == "thermal":  # type: ignore[union-attr]
            Q = axes_again(body) if isinstance(body, Orthotropic) else np.eye(3)
            e = Q.T @ np.diag(np.broadcast_to(own.expansion, 3)) @ Q
        if isinstance(body, Orthotropic):
            stress = stress_by_compliance(body, e[None], flat)[0]
        else:
            assert isinstance(body, Material)
            grown = body.nu / (1 - body.nu) * (e[0, 0] + e[1, 1]) if flat else body.nu / body.give * np.trace(e)
            stress = body.E / (1 + body.nu) * (e + grown * np.eye(3)) * (np.diag([1.0, 1.0, 0.0]) if flat else 1.0)
        place, first = strain.field or Place("", "", ""), np.eye(self._problem.dim)[0]
        forces = self._in_body(strain.body, None, partial(self._along, place, stress))
        work = float((stress * e).sum())
        works = self._in_body(strain.body, lambda x: work * self._along(place, np.ones(1), x) ** 2 * first)
        return forces, float(works.sum())

    def _dilatation(self, body: str, C: Mat, weight: Vec) -> float:
        """Energy of a displacement that is the place itself, whose dilatation is the same everywhere."""
        system, first = self._system, np.eye(self._problem.dim)[0]
        material, u = self._problem.isotropic[body], system.vector()
        u.array[:] = system.nodes.points[: system.nodes.owned].ravel()
        grown = 3 if system.mesh.axisymmetric or system.mesh.dim == 3 else 2
        volume = self._in_body(body, lambda x: np.tile(first, (len(x), 1))).sum()
        change = C * u
        known = float((change * change).dot(weight))
        return float(
            abs(known / (material.E * material.nu / (1 + material.nu) / material.give * grown**2 * volume) - 1)
        )

    def _in_body(self, body: str, force: At | None, stress: At | None = None) -> Array:
        """∫ force . v dx + ∫ stress : grad v dx; the third axis of stresses (m, 3, 3) is out of plane, or the hoop."""
        system, mesh, d = self._system, self._system.mesh, self._system.mesh.dim
        shape, cells = mesh.domain.topology.cell_type.name, mesh.cells_of(body)
        cells = cells[cells < mesh.domain.topology.index_map(d).size_local]
        total = np.zeros((system.nodes.total, d))
        points, rule = dx.reference_rule(shape, 2 * mesh.degree + system.weak.smooth)
        basis, slope = dx.reference_basis(shape, mesh.degree, points)
        for dofs in np.array_split(dx.cell_dofs(system.space)[cells], 1 + len(cells) // CHUNK):
            x = system.nodes.points[dofs]
            inverse, det = inverse_and_determinant(np.einsum("kqn,cnd->kdqc", slope, x))
            at = np.einsum("qn,cnd->qcd", basis, x)
            weights = rule[:, None] * np.abs(det) * (2 * np.pi * at[..., 0] if mesh.axisymmetric else 1.0)
            nodal = np.zeros(x.shape)
            if force is not None:
                nodal += np.einsum("qc,qn,qcd->cnd", weights, basis, force(at.reshape(-1, d)).reshape(at.shape))
            if stress is not None:
                s = stress(at.reshape(-1, d)).reshape(*at.shape[:2], 3, 3)
                nodal += np.einsum("qc,qcij,kqn,jkqc->cni", weights, s[..., :d, :d], slope, inverse, optimize=True)
                if mesh.axisymmetric:
                    nodal[..., 0] += np.einsum("qc,qn->cn", weights * s[..., 2, 2] / at[..., 0], basis)
            np.add.at(total, system.nodes.input[dofs], nodal)
        return np.asarray(mesh.comm.allreduce(total))
