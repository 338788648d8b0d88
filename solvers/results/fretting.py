"""Fretting numbers of a surface over a cycle: slip, work of friction, criteria of fatigue, by what the surface knows.

Stresses are those just below the surface. Tractions give their normal part and the shear across the surface; the strain
along the surface, of its own displacement, gives with Hooke's law all others. Stresses of cells are not read: these lie
half a cell deep, where a stress that varies over some cells has changed.

Sources: Smith, Watson & Topper, J. Mater. 5 (1970); Ruiz, Boddington & Chen, Exp. Mech. 24 (1984); Dang Van, ASTM STP
1191 (1993), with the smallest sphere around the path by Badoiu & Clarkson, SODA (2003).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import ROUNDING, Array, Bools
from stickslip.geometry.shape import Model
from stickslip.solvers.results.step_result import OPEN, ContactState, SurfaceMesh
from stickslip.solvers.scene.material import Material


@dataclass(frozen=True)
class Below:
    """States just below a surface of n nodes: where it carries the tractions of a contact.

    Attributes:
        normals: (n, d) outward unit vectors.
        sense: 1 if the scene calls it `surface`, else -1.
    """

    mesh: SurfaceMesh
    normals: Array
    sense: float
    material: Material
    model: Model

    def strain(self, moved: Array) -> Array:
        """Strain (n, 3, 3) [-] along the surface, by the displacement (n, d) [m]; of plane stress without that of zz.

        In each facet it is that of its basis at its nodes; the shorter a facet is, the more it counts at a node.
        """
        points, facets, shape = self.mesh
        degree = 1 if facets.shape[1] == {"interval": 2, "triangle": 3, "quadrilateral": 4}[shape] else 2
        slope = dx.reference_basis(shape, degree, dx.reference_nodes(shape, degree))[1]
        along, change = (np.einsum("aqk,fki->fqai", slope, values[facets]) for values in (points, moved))
        dual = np.einsum("fqab,fqbi->fqai", np.linalg.inv(along @ np.swapaxes(along, -1, -2)), along)
        each = np.einsum("fqai,fqaj->fqij", dual, change)  # gradient of the displacement along the facet
        size = np.linalg.norm(np.ptp(points[facets], axis=1), axis=1)
        dim = points.shape[1]
        total, weight = np.zeros((len(points), dim, dim)), np.zeros(len(points))
        np.add.at(total, facets, each / size[:, None, None, None])
        np.add.at(weight, facets, 1 / size[:, None])
        gradient = total / np.where(weight > 0, weight, 1.0)[:, None, None]
        across = np.eye(dim) - self.normals[:, :, None] * self.normals[:, None, :]
        found = np.zeros((len(points), 3, 3))
        found[:, :dim, :dim] = across @ (gradient + np.swapaxes(gradient, 1, 2)) / 2 @ across
        if self.model == "axisymmetric":
            on_axis = points[:, 0] <= ROUNDING * np.ptp(points)
            found[:, 2, 2] = np.where(
                on_axis, np.trace(found, axis1=1, axis2=2), moved[:, 0] / np.where(on_axis, 1.0, points[:, 0])
            )
        return found

    def stress(self, contact: ContactState, moved: Array) -> Array:
        """Stress (n, 3, 3) [Pa] by the tractions and the displacement (n, d) [m] of the surface."""
        E, nu, strain = self.material.E, self.material.nu, self.strain(moved)
        normals, shear = (
            np.pad(v, ((0, 0), (0, 3 - v.shape[1]))) for v in (self.normals, self.sense * contact.traction)
        )
        normal = -contact.pressure[:, None, None]
        outward = normals[:, :, None] * normals[:, None, :]
        along, stretch = np.eye(3) - outward, np.trace(strain, axis1=1, axis2=2)[:, None, None]
        if self.model == "plane stress":
            along[:, 2, 2] = 0.0
            inside = (E * stretch + nu * normal) * along
        else:
            inside = E / (1 - nu**2) * ((1 - nu) * strain + nu * stretch * along) + nu / (1 - nu) * normal * along
        across = shear[:, :, None] * normals[:, None, :]
        return np.asarray(inside + normal * outward + across + np.swapaxes(across, 1, 2))

    def elastic_strain(self, stress: Array) -> Array:
        """Strain (..., 3, 3) [-] of a stress (..., 3, 3) [Pa]."""
        E, nu, mean = self.material.E, self.material.nu, np.trace(stress, axis1=-2, axis2=-1)[..., None, None]
        return np.asarray(((1 + nu) * stress - nu * mean * np.eye(3)) / E)

    def numbers(self, contacts: Sequence[ContactState], stress: Array, dang_van: float | None) -> dict[str, Array]:
        """Fretting numbers (n,) of a cycle by name.

        Args:
            contacts: at its times, from its start on.
            stress: at these (t, n, 3, 3) [Pa].
            dang_van: weight of the hydrostatic stress [-]; None: no such number.
        """
        slip, traction = (np.array([getattr(each, key) for each in contacts]) for key in ("slip", "traction"))
        closed, shear = np.array([each.status for each in contacts]) != OPEN, np.linalg.norm(traction, axis=2)
        amplitude = slip_amplitude(slip, closed)
        tension = np.maximum(self._tension(stress), 0.0)
        swt, plane = self._smith_watson_topper(stress)
        found = {
            "slip_amplitude": amplitude,
            "work": -np.einsum("tnd,tnd->n", traction[1:], np.diff(slip, axis=0)),
            "max_shear": shear.max(axis=0),
            "max_tension": tension.max(axis=0),
            "ruiz_work": shear.max(axis=0) * amplitude,
            "ruiz_1": tension.max(axis=0) * shear.max(axis=0) * amplitude,
            "ruiz_2": (tension * shear).max(axis=0) * amplitude,
            "swt": swt,
            **{f"swt_{axis}": part for axis, part in zip("xyz"[: slip.shape[2]], plane.T, strict=False)},
        }
        return found if dang_van is None else found | {"dang_van": largest_dang_van(stress, dang_van)}

    def _tension(self, stress: Array) -> Array:
        """The largest stress (t, n) [Pa] along the surface, in plane models that in the plane."""
        along = np.eye(3)[None] - np.pad(
            self.normals[:, :, None] * self.normals[:, None, :], ((0, 0), *[(0, 3 - self.normals.shape[1])] * 2)
        )
        inside = along @ stress @ along
        if self.normals.shape[1] == 2:
            return np.asarray(inside[..., 0, 0] + inside[..., 1, 1])
        return np.asarray(np.linalg.eigvalsh(inside)[..., -1])

    def _smith_watson_topper(self, stress: Array) -> tuple[Array, Array]:
        """The largest product (n,) [Pa] of normal stress and half the range of strain of any plane, and this plane."""
        strain, best = self.elastic_strain(stress), np.zeros(stress.shape[1])
        plane = np.zeros((len(best), 3))
        for normal in directions(self.normals.shape[1]):
            pull, stretch = (np.einsum("tnij,i,j->tn", values, normal, normal) for values in (stress, strain))
            product = np.maximum(pull.max(axis=0), 0.0) * np.ptp(stretch, axis=0) / 2
            plane[product > best] = normal
            best = np.maximum(product, best)
        return best, plane


def directions(dim: int, degrees: int = 180) -> Array:
    """Unit vectors (k, 3), of both senses one: of all planes to be tried.

    In plane models they are as many as there are degrees in half a turn, and z; in space as many squared over eight.
    """
    if dim == 2:
        angle = np.radians(np.arange(degrees) * 180 / degrees)
        return np.array([*zip(np.cos(angle), np.sin(angle), 0 * angle, strict=True), (0.0, 0.0, 1.0)])
    count = degrees**2 // 8
    z, turn = 1 - (np.arange(count) + 0.5) / count, np.pi * (3 - np.sqrt(5)) * np.arange(count)
    flat = np.sqrt(1 - z**2)
    spiral = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
    return np.concatenate([np.eye(3), spiral])


def slip_amplitude(slip: Array, closed: Bools) -> Array:
    """Half the largest distance (n,) [m] between places of a node (t, n, d) at times at which it is closed (t, n).

    >>> slip_amplitude(np.array([[[0.0, 0.0]], [[3.0, 4.0]], [[9.0, 9.0]]]), np.array([[True], [True], [False]]))
    array([2.5])
    """
    found = np.zeros(slip.shape[1])
    for one, other in combinations(range(len(slip)), 2):
        both = closed[one] & closed[other]
        found = np.maximum(found, np.where(both, np.linalg.norm(slip[other] - slip[one], axis=1) / 2, 0.0))
    return found


def largest_dang_van(stress: Array, weight: float) -> Array:
    """The largest sum (n,) [Pa], over a cycle (t, n, 3, 3), of shear and `weight` times hydrostatic stress.

    The shear is that of Tresca of the deviator, counted from the middle of the smallest sphere around its path.

    >>> pulled = np.array([[np.diag([0.0, 0.0, 0.0])], [np.diag([3.0, 0.0, 0.0])]])
    >>> largest_dang_van(pulled, 0.5)  # 3 / 4 + 0.5 * 3 / 3
    array([1.25])
    """
    mean = np.trace(stress, axis1=2, axis2=3) / 3
    deviator = stress - mean[..., None, None] * np.eye(3)
    left = deviator - _middle(deviator.reshape(*mean.shape, 9)).reshape(-1, 3, 3)
    shear = np.ptp(np.linalg.eigvalsh(left), axis=2) / 2
    return np.asarray((shear + weight * mean).max(axis=0))


def _middle(path: Array, turns: int = 200) -> Array:
    """Middle (n, k) of the smallest sphere around the places (t, n, k) of each path, found by so many turns."""
    apart = np.zeros(path.shape[1])
    middle = path[0].copy()
    for one, other in combinations(path, 2):
        length = np.linalg.norm(other - one, axis=1)
        middle[length > apart] = (other + one)[length > apart] / 2
        apart = np.maximum(length, apart)
    for turn in range(1, turns):
        away = np.linalg.norm(path - middle, axis=2)
        far, at = away.argmax(axis=0), np.arange(path.shape[1])
        outside = away[far, at] > apart / 2 * (1 + ROUNDING)  # half the longest way is a sphere's least radius
        middle += np.where(outside, 1 / (turn + 1), 0.0)[:, None] * (path[far, at] - middle)
    return np.asarray(middle)
