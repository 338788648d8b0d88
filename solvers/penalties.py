"""Penalties ω of the perturbed Lagrangian from the bodies' stiffness and the size of their facets."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from geometry.surface import Surface
from solvers.nouns.material import Material
from solvers.operators.rows import ContactRows
from solvers.system import System

Array = NDArray[np.float64]


def penalties(system: System) -> Array:
    """ω_n, then ω_t = ω_τ, by area (rows,) [Pa/m]: omega_factor times E / h and G / h of the facets that touch.

    A layer of elements behind the surface is omega_factor times as soft as the springs, at each point those that are
    there: h is that of the facets around its nodes. Two bodies give in series.
    """
    factor, found = system.scene.solver.omega_factor, [np.zeros(0)]
    for shear in (False, True):
        for c in system.contacts:
            give = _give(system, c, c.N_t if shear else c.N_n, shear)
            found.append(factor / give)
    return np.concatenate(found)


def _give(system: System, c: ContactRows, N: Any, shear: bool) -> Array:
    """h / E or h / G (rows,) [m/Pa]: of each side as the row N weighs its nodes, added up."""
    N, dim = N.tocsr(), c.surface.dim
    parts = sparse.csr_matrix((np.abs(N.data), N.indices // dim, N.indptr), shape=(N.shape[0], N.shape[1] // dim))
    total, start = np.zeros(N.shape[0]), 0
    for surface, body in _sides(system, c):
        size = _sizes(surface)
        weight = parts[:, start : (start := start + len(size))]
        sums = np.asarray(weight.sum(axis=1)).ravel()
        own = np.divide(weight @ size, sums, out=np.full(len(sums), size.mean()), where=sums > 0)
        total += own / _modulus(body, shear)
    return total


def _sides(system: System, c: ContactRows) -> list[tuple[Surface, Material]]:
    contact, bodies = system.scene.contacts[c.name], system.scene.bodies
    sides = [(c.surface, contact.surface)] + ([(c.master, contact.against)] if c.master else [])
    return [(surface, bodies[name.split(".")[0]]) for surface, name in sides]


def _modulus(body: Material, shear: bool) -> float:
    return body.E / (2 * (1 + body.nu)) if shear else body.E


def _sizes(surface: Surface) -> Array:
    """h (n,), mean length of one edge of each facet around a node [m]."""
    ends = surface.points[surface.facets[:, :2]]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    facets = surface.facets.ravel()
    around = np.repeat(length, surface.facets.shape[1])
    return np.bincount(facets, around, len(surface.points)) / np.bincount(facets, minlength=len(surface.points))
