"""Error of the mesh in the energy norm, from a stress that is continuous within each body.

The stress of a finite element solution jumps between cells. A continuous stress sigma*, the mean of those of the cells
around each node, is nearer to the exact one, and eta^2 = ∫ (sigma* - sigma) : C^-1 (sigma* - sigma) dx estimates the
squared error of the displacement in the energy norm. With order 2 it is too small by a third, as measured on smooth
fields, and is raised by that. What earlier steps and the time steps add to the error is not seen.

Source: Zienkiewicz & Zhu, Int. J. Numer. Methods Engrg. 24 (1987).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geometry import dolfinx_versions as dx
from geometry.arrays import Array, Ints
from solvers.results.step_result import MeshData
from solvers.scene.material import Material
from solvers.scene.problem import Problem

CHUNK = 20_000  # cells at a time: memory
TWICE = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # shear counts twice in products of stresses
RAISED = {1: 1.0, 2: 1.5}  # by order; stated over true without it: .96 to 1.00, and .59 to .74


@dataclass(frozen=True)
class MeshError:
    """The estimate of one step."""

    size: float  # of the displacement in the energy norm, its root taken [J^(1/2)], in plane models for a metre
    stress: Array  # (cells,) error of the stress [Pa]: that of one component which would have the same energy


class RecoveredStress:
    """The estimate for the steps of one mesh, made once; in the order of the gmsh model, on rank 0."""

    def __init__(self, problem: Problem, mesh: MeshData) -> None:
        """Nothing is computed yet."""
        self._mesh, self._axisymmetric = mesh, problem.model == "axisymmetric"
        self._plane_stress = problem.model == "plane stress"
        self._bodies = [problem.bodies[name] for name in mesh.bodies]

    def __call__(self, displacement: Array) -> MeshError:
        """The estimate for a displacement of the nodes (nodes, d) [m]."""
        size, error = 0.0, np.zeros(len(self._mesh.cells))
        for body, parts in zip(self._bodies, self._parts, strict=True):
            smooth = self._smooth(body, parts, displacement)
            for part in parts:
                off = np.tensordot(self._basis, smooth[:, part.nodes], (1, 1)).swapaxes(0, 1)
                off -= self._stress(body, part.inside, part.nodes, displacement)
                share = body.lame_lambda / (3 * body.lame_lambda + 2 * body.lame_mu)
                squares = np.tensordot(TWICE, off**2, 1) - share * off[:3].sum(axis=0) ** 2
                energy = (squares * part.inside.volume).sum(axis=0) * RAISED[self._degree] ** 2 / (2 * body.lame_mu)
                size += float(energy.sum())
                error[part.cells] = np.sqrt(body.E * energy / part.inside.volume.sum(axis=0))
        return MeshError(size=float(np.sqrt(size)), stress=error)

    def _smooth(self, body: Material, parts: Sequence[_Part], displacement: Array) -> Array:
        """sigma* (6, nodes) [Pa] of one body: means at its nodes, weighted by volume."""
        total, size = np.zeros((6, len(self._mesh.points))), np.zeros(len(self._mesh.points))
        for part in parts:
            stress = self._stress(body, part.mean, part.nodes, displacement)
            weight = np.broadcast_to(part.inside.volume.sum(axis=0), part.nodes.shape)
            size += np.bincount(part.nodes.ravel(), weight.ravel(), len(size))
            for k, component in enumerate(stress):
                total[k] += np.bincount(part.nodes.ravel(), (weight * component).ravel(), len(size))
        return np.asarray(total / np.maximum(size, np.finfo(float).tiny))

    def _stress(self, body: Material, places: _Places, nodes: Ints, displacement: Array) -> Array:
        """Stress xx, yy, zz, xy, yz, xz (6, q, c) [Pa] without initial strains.

        Initial strains are uniform in a body: they do not change the difference of sigma* and sigma.
        """
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
            on_axis = places.radius <= 0  # there u_r / r is its limit
            strain[2] = np.where(on_axis, strain[0], places.basis @ moved[0] / np.where(on_axis, 1.0, places.radius))
        first, second = body.lame_lambda, body.lame_mu
        if self._plane_stress:
            strain[2] = -first / (first + 2 * second) * (strain[0] + strain[1])
        pressure = first * strain[:3].sum(axis=0)
        strain *= 2 * second
        strain[:3] += pressure
        return strain

    @cached_property
    def _degree(self) -> int:
        """Polynomial degree of the cells."""
        nodes = self._mesh.cells.shape[1]
        return next(k for k in RAISED if len(dx.reference_nodes(self._mesh.shape, k)) == nodes)

    @cached_property
    def _rule(self) -> tuple[Array, Array]:
        return dx.reference_rule(self._mesh.shape, 2 * self._degree)

    @cached_property
    def _basis(self) -> Array:
        """At the quadrature points (q, n)."""
        return dx.reference_basis(self._mesh.shape, self._degree, self._rule[0])[0]

    @cached_property
    def _parts(self) -> list[list[_Part]]:
        """The cells of each body, some at a time."""
        mesh, (points, weights) = self._mesh, self._rule
        at = dx.reference_nodes(mesh.shape, self._degree)
        # of linear cells the stress is best at their midpoint, of others it is taken at each node
        at = at.mean(axis=0, keepdims=True) if self._degree == 1 else at
        found = []
        for index in range(len(mesh.bodies)):
            members = np.flatnonzero(mesh.body == index)
            parts = (members[start : start + CHUNK] for start in range(0, len(members), CHUNK))
            found.append(
                [
                    _Part(
                        cells,
                        np.ascontiguousarray(mesh.cells[cells].T),
                        self._places(mesh.cells[cells], at, np.ones(len(at))),
                        self._places(mesh.cells[cells], points, weights),
                    )
                    for cells in parts
                ]
            )
        return found

    def _places(self, nodes: Ints, points: Array, weights: Array) -> _Places:
        basis, slope = dx.reference_basis(self._mesh.shape, self._degree, points)
        x = self._mesh.points[nodes]
        jacobian = np.tensordot(slope, x, (2, 1)).transpose(1, 2, 3, 0)  # (q, c, i, k)
        radius = basis @ x[..., 0].T
        around = 2 * np.pi * radius if self._axisymmetric else 1.0
        volume = np.abs(np.linalg.det(jacobian)) * weights[:, None] * around
        inverse = np.ascontiguousarray(np.linalg.inv(jacobian).transpose(2, 3, 0, 1))
        return _Places(basis, slope, inverse, volume, radius)


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
