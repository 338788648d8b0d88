"""Terms that loads and effects add to the weak form: loads and initial strains, each with its value in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Constant, UflForm
from stickslip.solvers.scene.timeline import Drive, Place


@dataclass(frozen=True, kw_only=True)
class LoadTerm:
    """A load: a linear form in the test function at value 1 [N], and the value in time that multiplies it."""

    drive: Drive
    form: UflForm
    power: int = 1  # of the value in time
    clock: Constant | None = None  # t [s] in the form, of an expression that changes in time: assembled at each time


@dataclass(frozen=True, kw_only=True)
class InitialStrain:
    """A strain at which a body has no stress, times a value in time, and an expression of place if it has one.

    sigma = C (eps(u) - initial strain). It loads the bodies and changes stress and stored energy; the work that it
    does on the stressed bodies counts as external work.
    """

    drive: Drive
    body: str
    field: Place | None = None  # of an expression without t; None: the strain is uniform over the body
    strain: Array  # (3, 3) at value 1 [-], symmetric; the third axis is out of plane, in axisymmetric models the hoop
    shrunk: tuple[Array, Array] | None = None  # instead of `strain` the one of `drawn_together`, two points (d,) [m]
    tension: Place | None = None  # [N] given: the value, a shortening, is then found
    held_from: float = np.inf  # [s], from there on it is kept


def drawn_together(points: Array, start: Array, end: Array) -> Array:
    """Displacement (n, d) [m] of points (n, d) that draws all beyond `end` by 1 m to all before `start`.

    It is linear between the planes across both points (d,): a strain of -1 / distance along the axis. Taken at nodes of
    a mesh, its work on the stresses is exactly the force with which what lies beyond pulls.

    >>> drawn_together(np.array([[-1.0, 9.0], [0.5, 9.0], [7.0, 9.0]]), np.zeros(2), np.array([2.0, 0.0]))
    array([[-0.  , -0.  ],
           [-0.25, -0.  ],
           [-1.  , -0.  ]])
    """
    axis = end - start
    share = np.clip((points - start) @ axis / (axis @ axis), 0.0, 1.0)
    return np.asarray(-share[:, None] * axis / np.linalg.norm(axis))
