"""Error of the mesh in the energy norm, from a stress that is continuous within each body.

The stress of a finite element solution jumps between cells. A continuous stress sigma*, the mean of those of the cells
around each node, is nearer to the exact one, and eta^2 = ∫ (sigma* - sigma) : C^-1 (sigma* - sigma) dx estimates the
squared error of the displacement in the energy norm. With order 2 it is too small by a third, as measured on smooth
fields, and is raised by that. What earlier steps and the time steps add to the error is not seen.

The shortening of a bolt between two planes jumps there, its stress does not: it is that of the displacement minus the
shortening. Other initial strains are known exactly, and left out: they do not change sigma* - sigma.

Source: Zienkiewicz & Zhu, Int. J. Numer. Methods Engrg. 24 (1987).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CHUNK, ROUNDING, TINY, Array, Ints, inverse_and_determinant
from stickslip.geometry.protocols import Vec
from stickslip.solvers.results.step_result import MeshData
from stickslip.solvers.scene.material import DOUBLED, Elastic, Material, Orthotropic
from stickslip.solvers.scene.record import STRESSES
from stickslip.solvers.system.system import System

TWICE = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # shear counts twice in products of stresses
RAISED = {1: 1.0, 2: 1.5}  # by order; stated over true without it: .96 to 1.00, and .59 to .74


@dataclass(frozen=True)
class MeshError:
    """The estimate of one step."""

    size: float  # of the displacement in the energy norm, its root taken [J^(1/2)], in plane models for a metre
    stress: Array  # (own cells,) error of the stress [Pa]: that of one component which would have the same energy


def cells_around(mesh: MeshData, cell: int, basis: Array, axisymmetric: bool) -> tuple[Ints, Array]:
    """Cells (c,) of the body of a cell that share nodes with it, and their shares in the recovered stress at a point.

    The stress of a node is the mean of that of its cells, by their size; its basis function is its share at the point.
    """
    nodes = mesh.cells[cell]
    cells = np.flatnonzero(np.isin(mesh.cells, nodes).any(axis=1) & (mesh.body == mesh.body[cell]))
    middle = dx.reference_nodes(mesh.shape, 1).mean(axis=0, keepdims=True)
    values, slope = dx.reference_basis(mesh.shape, dx.degree_of(mesh.shape, len(nodes)), middle)
    x = mesh.points[mesh.cells[cells]]
    size = np.abs(np.linalg.det(slope[:, 0] @ x)) * (x[:, :, 0] @ values[0] if axisymmetric else 1.0)
    by_node = (mesh.cells[cells][:, :, None] == nodes).any(axis=1) * size[:, None]
    return cells, by_node / by_node.sum(axis=0) @ basis


class InCell(NamedTuple):
    """A point in a cell that this rank owns, and a displacement of the next order there."""

    cell: int  # local number
    local: Array  # (d,) coordinates on the reference cell
    displacement: Array  # (k, d) of the cell's nodes of that order [m]


class RecoveredStress:
    """The estimate for the steps of one mesh, made once; each rank has its own cells."""

    def __init__(self, system: System) -> None:
        """Nothing is computed yet."""
        problem, mesh = system.problem, system.mesh
        self._space, self._points, self._degree = system.space, system.nodes.points, mesh.degree
        self._u = dx.fem.Function(system.space)
        self._shape = mesh.domain.topology.cell_type.name
        owned = mesh.domain.topology.index_map(mesh.dim).size_local
        self._cells = dx.cell_dofs(system.space)[:owned]
        self._axisymmetric, self._plane_stress = mesh.axisymmetric, problem.model == "plane stress"
        self._axis = ROUNDING * system.extent  # radius [m] up to which a point lies on it
        # where the dilatation is averaged, that of a cell is no measure: only shear is judged, by the same modulus
        bodies = dict(problem.bodies)
        soft = {name: problem.isotropic[name] for name in problem.averaged}
        bodies |= {name: replace(body, E=2.5 * body.lame_mu, nu=0.25) for name, body in soft.items()}
        self._bodies, self._body = list(bodies.values()), np.zeros(owned, np.int64)
        for index, cells in enumerate(map(mesh.cells_of, bodies)):
            self._body[cells[cells < owned]] = index
        self._kept = dict[int, _Part]()  # by the first of its cells
        numbers, d = {name: index for index, name in enumerate(bodies)}, mesh.dim
        self._drawn = [  # number of the initial strain, that of the body, and its shortening (nodes, d) at value 1
            (number, numbers[one.body], system.weak.shrinking(one).x.array.reshape(-1, d))
            for number, one in enumerate(system.initial.strains)
            if one.shrunk is not None
        ]

    def __call__(self, u: Vec, initial: Array) -> MeshError:
        """The estimate for a displacement of all dofs [m] and initial strains of values (k,); collective."""
        whole = self._at_nodes(u)
        energies, error = 0.0, np.zeros(len(self._cells))
        for index, (body, members) in enumerate(zip(self._bodies, self._members, strict=True)):
            displacement = whole - self._shortening(index, initial)
            smooth = self._smooth(body, members, displacement)
            for part in self._parts(members):
                off = np.tensordot(self._basis, smooth[:, part.nodes], (1, 1)).swapaxes(0, 1)
                off -= self._stress(body, part.inside, part.nodes, displacement)
                energy = _energy(body, off, part.inside.volume, RAISED[self._degree])
                energies += float(energy.sum())
                error[part.cells] = np.sqrt(body.modulus * energy / part.inside.volume.sum(axis=0))
        return MeshError(size=float(np.sqrt(self._space.mesh.comm.allreduce(energies))), stress=error)

    def from_midpoints(self, u: Vec, initial: Array, points: Mapping[str, InCell]) -> dict[str, Array]:
        """By what the stress (6,) [Pa] of the next order at points exceeds that at midpoints of cells; collective.

        Args:
            u: displacement of all dofs [m].
            initial: values (k,) of the initial strains: bolts alone count.
        """
        whole, middle = self._at_nodes(u), dx.reference_nodes(self._shape, 1).mean(axis=0)
        found = dict[str, Array]()
        for name, point in points.items():
            shorter = self._at_point(point, initial)
            displacement = whole[self._cells[point.cell]] - shorter
            found[name] = -self._at(point._replace(local=middle), displacement)
            basis = dx.reference_basis(self._shape, self._degree, dx.reference_nodes(self._shape, self._degree + 1))[0]
            found[name] += self._at(point, point.displacement - basis @ shorter)
        return found

    def largest(self, u: Array, cells: Ints, reported: Array) -> list[float]:
        """Largest equivalent stress [Pa] of each body at the corners of cells: that of means there; collective.

        Args:
            u: displacement of the nodes (n, d) [m], of any order.
            cells: (own cells, k) rows of it.
            reported: stress (own cells, 3, 3) [Pa] at the midpoints; from there on it changes as that of u does.
        """
        at, found = dx.reference_nodes(self._shape, 1), list[float]()
        given = np.array([reported[:, i, j] for i, j in STRESSES.values()])
        linear = cells.shape[1] == u.shape[1] + 1 and not self._axisymmetric  # the stress of a cell is one
        for body, members in zip(self._bodies, self._members, strict=True):
            total = np.zeros((7, len(self._points)))  # and the weights
            for own in members:
                middle, volume = self._of(body, own, at.mean(axis=0, keepdims=True), u, cells)
                change = 0.0 * middle if linear else self._of(body, own, at, u, cells)[0] - middle
                nodes = self._cells[own, : len(at)].T
                weight = np.broadcast_to(volume.sum(axis=0), nodes.shape)
                stress = weight * (given[:, None, own] + change)
                for sums, component in zip(total, (*stress, weight), strict=True):
                    sums += np.bincount(nodes.ravel(), component.ravel(), len(sums))
            total = dx.sums_at_nodes(self._space, total)
            six = total[:6] / np.maximum(total[6], TINY)
            deviator = six - np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])[:, None] * six[:3].mean(axis=0)
            found.append(float(np.sqrt(1.5 * TWICE @ deviator**2).max(initial=0.0)))
        return [max(offers) for offers in zip(*self._space.mesh.comm.allgather(found), strict=True)]

    def _of(self, body: Elastic, own: Ints, points: Array, u: Array, cells: Ints) -> tuple[Array, Array]:
        """Stress (6, q, c) [Pa] of a displacement at points of own cells, and their volumes (q, c)."""
        places = self._places(self._cells[own], points, np.ones(len(points)))
        basis, slope = dx.reference_basis(self._shape, dx.degree_of(self._shape, cells.shape[1]), points)
        return self._stress(body, replace(places, basis=basis, slope=slope), cells[own].T, u), places.volume

    def _shortening(self, body: int, initial: Array) -> Array:
        """Displacement (nodes, d) [m], or (1, 1) zero, by which the bolts of a body are shortened."""
        drawn = (initial[number] * by for number, index, by in self._drawn if index == body)
        return np.asarray(sum(drawn, start=np.zeros((1, 1))))

    def _at_point(self, point: InCell, initial: Array) -> Array:
        """`_shortening` at the nodes (k, d) of the cell that a point is in, or (k, 1) zeros [m]."""
        cell = self._cells[point.cell]
        shorter = self._shortening(int(self._body[point.cell]), initial)
        return shorter[cell] if len(shorter) > 1 else np.zeros((len(cell), 1))

    def _at_nodes(self, u: Vec) -> Array:
        """Values (nodes, d) at the local nodes, ghosts included; collective."""
        dx.fill(self._u, u.array_r)
        return np.asarray(self._u.x.array.reshape(len(self._points), -1))

    def _at(self, point: InCell, displacement: Array) -> Array:
        """Stress (6,) [Pa] at a point, for a displacement (k, d) of the nodes of its cell, of any order."""
        own = self._places(self._cells[point.cell][None], point.local[None], np.ones(1))
        degree = dx.degree_of(self._shape, len(displacement))
        basis, slope = dx.reference_basis(self._shape, degree, point.local[None])
        body = self._bodies[int(self._body[point.cell])]
        places = replace(own, basis=basis, slope=slope)
        return self._stress(body, places, np.arange(len(displacement))[:, None], displacement)[:, 0, 0]

    def _smooth(self, body: Elastic, members: Sequence[Ints], displacement: Array) -> Array:
        """sigma* (6, nodes) [Pa] of one body: means at its local nodes, weighted by volume; collective."""
        total = np.zeros((7, len(self._points)))  # and the weights
        for part in self._parts(members):
            stress = self._stress(body, part.mean, part.nodes, displacement)
            weight = np.broadcast_to(part.inside.volume.sum(axis=0), part.nodes.shape)
            for sums, component in zip(total, (*(weight * stress), weight), strict=True):
                sums += np.bincount(part.nodes.ravel(), component.ravel(), len(sums))
        total = dx.sums_at_nodes(self._space, total)
        return np.asarray(total[:6] / np.maximum(total[6], np.finfo(float).tiny))

    def _stress(self, body: Elastic, places: _Places, nodes: Ints, displacement: Array) -> Array:
        """Stress xx, yy, zz, xy, yz, xz (6, q, c) [Pa] of a displacement."""
        moved = [np.ascontiguousarray(component)[nodes] for component in displacement.T]  # d times (n, c)
        d = len(moved)
        gradient = [[np.zeros(0)] * d for _ in range(d)]
        for i, u in enumerate(moved):
            by_reference = np.tensordot(places.slope, u, 1)  # (k, q, c)
            for j in range(d):
                gradient[i][j] = np.asarray(sum(by_reference[k] * places.inverse[k, j] for k in range(d)))
        strain = np.zeros((6, *gradient[0][0].shape))
        for k in range(d):
            strain[k] = gradient[k][k]
        for k, (i, j) in enumerate(((0, 1), (1, 2), (0, 2))[: 2 * d - 3], start=3):
            strain[k] = (gradient[i][j] + gradient[j][i]) / 2
        if self._axisymmetric:
            on_axis = places.radius <= self._axis  # there u_r / r is its limit
            strain[2] = np.where(on_axis, strain[0], places.basis @ moved[0] / np.where(on_axis, 1.0, places.radius))
        if isinstance(body, Orthotropic):
            return np.tensordot(body.stiffness_in(self._plane_stress) * DOUBLED, strain, 1)
        assert isinstance(body, Material)
        first, second = body.lame_lambda, body.lame_mu
        if self._plane_stress:
            strain[2] = -first / (first + 2 * second) * (strain[0] + strain[1])
        pressure = first * strain[:3].sum(axis=0)
        strain *= 2 * second
        strain[:3] += pressure
        return strain

    @cached_property
    def _rule(self) -> tuple[Array, Array]:
        return dx.reference_rule(self._shape, 2 * self._degree)

    @cached_property
    def _basis(self) -> Array:
        """At the quadrature points (q, n)."""
        return dx.reference_basis(self._shape, self._degree, self._rule[0])[0]

    @cached_property
    def _members(self) -> list[list[Ints]]:
        """The own cells of each body, some at a time."""
        bodies = (np.flatnonzero(self._body == index) for index in range(len(self._bodies)))
        return [[body[start : start + CHUNK] for start in range(0, len(body), CHUNK)] for body in bodies]

    def _parts(self, members: Sequence[Ints]) -> Iterator[_Part]:
        """Some cells of a body after the other; of a large mesh each is forgotten when the next one comes."""
        for cells in members:
            part = self._kept.get(int(cells[0])) or self._part(cells)
            if len(self._cells) <= 50_000:  # of a rank
                self._kept[int(cells[0])] = part
            yield part

    def _part(self, cells: Ints) -> _Part:
        points, weights = self._rule
        at = dx.reference_nodes(self._shape, self._degree)
        # of linear cells the stress is best at their midpoint, of others it is taken at each node
        at = at.mean(axis=0, keepdims=True) if self._degree == 1 else at
        nodes = self._cells[cells]
        return _Part(
            cells,
            np.ascontiguousarray(nodes.T),
            self._places(nodes, at, np.ones(len(at))),
            self._places(nodes, points, weights),
        )

    def _places(self, nodes: Ints, points: Array, weights: Array) -> _Places:
        basis, slope = dx.reference_basis(self._shape, self._degree, points)
        x = [np.ascontiguousarray(component)[nodes.T] for component in self._points.T]  # d times (n, c)
        inverse, det = inverse_and_determinant(np.array([np.tensordot(slope, component, 1) for component in x]))
        radius = basis @ x[0]
        around = 2 * np.pi * radius if self._axisymmetric else 1.0
        return _Places(basis, slope, inverse, np.abs(det) * weights[:, None] * around, radius)


def _energy(body: Elastic, stress: Array, volume: Array, raised: float) -> Array:
    """∫ stress : C^-1 stress dx of each cell (c,) [J], times raised^2.

    Args:
        stress: (6, q, c) [Pa].
        volume: (q, c) [m^d].
    """
    if isinstance(body, Orthotropic):
        squares = np.einsum("iqc,iqc->qc", stress, np.tensordot(body.compliance, stress, 1))
        return np.asarray((squares * volume).sum(axis=0) * raised**2)
    assert isinstance(body, Material)
    share = body.lame_lambda / (3 * body.lame_lambda + 2 * body.lame_mu)
    squares = np.tensordot(TWICE, stress**2, 1) - share * stress[:3].sum(axis=0) ** 2
    return np.asarray((squares * volume).sum(axis=0) * raised**2 / (2 * body.lame_mu))


@dataclass(frozen=True)
class _Places:
    """Points of some cells."""

    basis: Array  # (q, n)
    slope: Array  # (k, q, n) of the basis, on the reference cell
    inverse: Array  # (k, j, q, c) of the Jacobian
    volume: Array  # (q, c) by quadrature point [m^d]
    radius: Array  # (q, c) x [m]


@dataclass(frozen=True)
class _Part:
    """Some cells of a body."""

    cells: Ints  # (c,)
    nodes: Ints  # (n, c)
    mean: _Places  # where the stress is taken for sigma*
    inside: _Places  # quadrature points
