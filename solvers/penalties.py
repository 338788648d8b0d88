"""Penalties ω of the perturbed Lagrangian from the bodies' stiffness and the size of their facets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geometry.surface import Surface
from solvers.nouns.material import Material
from solvers.operators.rows import ContactRows
from solvers.system import System

Array = NDArray[np.float64]


def penalties(system: System) -> Array:
    """ω_n, then ω_t = ω_τ, by area (rows,) [Pa/m]: omega_factor times E / h and G / h of the facets that touch.

    A layer of elements behind the surface is omega_factor times as soft as the springs; two bodies give in series.
    """
    factor, found = system.scene.solver.omega_factor, [np.zeros(0)]
    for shear in (False, True):
        for c in system.contacts:
            give = sum(_size(side) / _modulus(body, shear) for side, body in _sides(system, c))
            found.append(np.full(c.free.size if shear else len(c.W_n), factor / give))
    return np.concatenate(found)


def _sides(system: System, c: ContactRows) -> list[tuple[Surface, Material]]:
    contact, bodies = system.scene.contacts[c.name], system.scene.bodies
    sides = [(c.surface, contact.surface)] + ([(c.master, contact.against)] if c.master else [])
    return [(surface, bodies[name.split(".")[0]]) for surface, name in sides]


def _modulus(body: Material, shear: bool) -> float:
    return body.E / (2 * (1 + body.nu)) if shear else body.E


def _size(surface: Surface) -> float:
    """h, mean length of one edge of each facet [m]."""
    ends = surface.points[surface.facets[:, :2]]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean())
