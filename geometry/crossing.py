"""Where a line meets a facet: pairs of one line and one facet, straight or curved, all at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geometry import dolfinx_versions as dx
from geometry.surface import Surface

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
EDGE = 1e-8  # a line this close to a facet's edge, in reference coordinates, meets the facet: neighbours leave no slit
STEPS = 12
STILL = 1e-11  # the last Newton step, in reference coordinates, of a point that was found
AWAY = 0.5  # how far out of its reference facet an iterate may go


def cross(
    master: Surface, facet: Ints, points: Array, directions: Array, frames: Array
) -> tuple[NDArray[np.bool_], Array, Array]:
    """Meet the line through points[i] along directions[i] with the facet facet[i]: (c,) pairs.

    Seen along the line the facet is flat: `local` solves sum_k phi_k(local) P_k = 0, P_k its nodes in the plane
    across the line. The determinant of that map is the normal's component along the line, so it also says whether
    the facet faces the direction. One linear step is exact on straight simplices; others go on with Newton's.

    Args:
        frames: (c, d-1, d) unit vectors across the lines, from `across`.

    Returns:
        met (c,): the line meets the facet, and the facet's outward normal is against the direction;
        local (c, d-1) and gap (c,) [m], where it does.
    """
    away = master.points[master.facets[facet]] - points[:, None]
    nodes = np.einsum("ctd,ckd->ckt", frames, away)
    middle = dx.reference_nodes(master.shape, 1).mean(axis=0, keepdims=True)
    basis, gradient = dx.reference_basis(master.shape, master.degree, middle)
    step, turn = _newton_step(basis, gradient, nodes)
    local = middle + step
    found = np.isfinite(local).all(axis=1)
    if master.degree > 1 or master.shape == "quadrilateral":
        found[:] = False
        left = np.arange(len(facet))
        for _ in range(STEPS):
            local[left] = np.clip(local[left], -AWAY, 1 + AWAY)
            basis, gradient = dx.reference_basis(master.shape, master.degree, local[left])
            step, turn[left] = _newton_step(basis, gradient, nodes[left])
            local[left] += step
            size = np.abs(step).max(axis=1)
            found[left[size <= STILL]] = True
            left = left[size > STILL]
    clipped = clip(master.shape, np.where(found[:, None], local, middle))
    met = found & (np.abs(local - clipped).max(axis=1) <= EDGE) & (turn * master.outward[facet] < 0)
    basis = dx.reference_basis(master.shape, master.degree, clipped)[0]
    return met, clipped, np.einsum("cd,cd->c", directions, np.einsum("ck,ckd->cd", basis, away))


def across(directions: Array) -> Array:
    """Unit vectors (m, d-1, d) across unit directions (m, d); with the direction last, a right-handed frame.

    >>> across(np.array([[0.0, -1.0]]))
    array([[[1., 0.]]])
    """
    if directions.shape[1] == 2:
        return np.asarray(np.stack([-directions[:, 1], directions[:, 0]], axis=1)[:, None])
    axis = np.eye(3)[np.abs(directions).argmin(axis=1)]
    first = np.cross(axis, directions)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


def clip(shape: str, local: Array) -> Array:
    """The reference facet's point near `local`."""
    if shape != "triangle":
        return np.asarray(np.clip(local, 0.0, 1.0))
    inside = np.maximum(local, 0.0)
    return np.asarray(inside / np.maximum(inside.sum(axis=1, keepdims=True), 1.0))


def _newton_step(basis: Array, gradient: Array, nodes: Array) -> tuple[Array, Array]:
    """Step (c, d-1) towards the zero of sum_k phi_k P_k and the determinant (c,) of its gradient.

    Basis (1 or c, k) and gradient (d-1, 1 or c, k); the step is not finite where the facet is seen edge-on.
    """
    basis = np.broadcast_to(basis, nodes.shape[:2])
    gradient = np.broadcast_to(gradient, (len(gradient), *nodes.shape[:2]))
    value = -np.einsum("ck,ckt->tc", basis, nodes)
    jacobian = np.einsum("ack,ckt->tac", gradient, nodes)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if len(value) == 1:
            return (value / jacobian[0]).T, jacobian[0, 0]
        (a, b), (c, d) = jacobian
        turn = a * d - b * c
        return np.stack([d * value[0] - b * value[1], a * value[1] - c * value[0]], axis=1) / turn[:, None], turn
