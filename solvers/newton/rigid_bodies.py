"""Where bodies that have room come to rest: a model of rigid bodies, whose surfaces give dof by dof.

Bodies that travel far move as rigid ones, until they are held. A system of the model has as many unknowns as there are
rigid motions, whatever the bodies are, so that soft contact, and the settling of the bodies from it, can be followed
for hundreds of them. An interior point leads from there to the solution.

Source: Pfeiffer & Glocker, Multibody Dynamics with Unilateral Contacts (1996), of rigid bodies in contact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from stickslip.geometry.arrays import ROUNDING, Array
from stickslip.solvers.interface.prepare import condensed
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import PATIENT, Status
from stickslip.solvers.newton.active_set import ActiveSet
from stickslip.solvers.newton.attempts import FIRM, Attempts, Start
from stickslip.solvers.newton.settling import settled
from stickslip.solvers.newton.soft_start import soft_starts


class RigidBodies:
    """Bodies u = F (f - N^T W p) + R b of diagonal flexibility F (c,) [m/N] and rigid motions b (r,) [m].

    Rows without flexibility, of obstacles that a force drives, are held by the proximal term of their laws alone.
    """

    def __init__(self, problem: SurfaceProblem) -> None:
        self.problem, self.surface = problem, condensed(problem.surface)
        self.F, N, R = self.surface.flexibility.diagonal, self.surface.N, self.surface.R
        self.moved, self.free = N @ R, problem.relative_displacement(self.F * problem.load.f_c)
        self.give = N @ (self.F[:, None] * R)  # (rows, r), transposed: rigid motion in what tractions deform
        self.G = N @ sparse.diags(self.F) @ N.T @ sparse.diags(self.surface.W)  # (rows, rows) [m/Pa]

    def relative(self, p: Array, u: Array) -> Array:
        """Relative displacement (rows,) [m] of displacements u (c,) [m], whatever the tractions p are."""
        return self.problem.relative_displacement(u)

    def solve(self, laws: ActiveSet, p: Array, u: Array) -> tuple[Array, Array]:
        """Tractions (rows,) [Pa] and displacement (c,) [m] that satisfy the linearised laws.

        Springs on the rigid motions R^T u have no force at the u that is given; motions that nothing resists, and along
        which nothing pushes, stay as they are there.

        Raises:
            LinAlgError: rows depend on each other, or the active set leaves a rigid mode free.
        """
        surface, load, R, spring = self.surface, self.problem.load, self.surface.R, laws.hold * self.surface.rho
        try:
            rows = splu(sparse.csc_matrix(laws.A_p - laws.A_w @ self.G))
        except RuntimeError as error:  # SuperLU: exactly singular
            raise np.linalg.LinAlgError(str(error)) from None
        x = rows.solve(np.column_stack([laws.rhs - laws.A_w @ self.free, laws.A_w @ self.moved]))
        forces = (self.moved - spring * self.give).T @ (surface.W[:, None] * x)
        held = spring * np.eye(len(load.resultant)) - forces[:, 1:]
        right = load.resultant - forces[:, 0] + spring * (R.T @ (u - self.F * load.f_c))
        left, stiffness, motions = np.linalg.svd(held)
        # of the largest stiffness: what resists a motion less does not resist it; springs do, however soft they are
        felt = stiffness > (0.0 if spring else ROUNDING) * stiffness.max(initial=0.0)
        b = motions[felt].T @ ((left[:, felt].T @ right) / stiffness[felt])
        p = x[:, 0] - x[:, 1:] @ b
        if not spring:
            laws.refuse_unbalanced(p)
        found = self.F * (load.f_c - surface.forces(p)) + R @ b
        return p, found + R @ (motions[~felt].T @ (motions[~felt] @ (R.T @ (u - found))))


def at_rest(attempts: Attempts) -> Start | None:
    """Where floating bodies would rest if they were rigid, and what is closed, sticks or slips; None: it is not found.

    Args:
        attempts: those so far, at a problem of the bodies. They are left as they are.
    """
    problem = attempts.problem
    if not problem.surface.floating or problem.give is None or problem.p_ref == 0:
        return None
    posed = replace(problem, touch=None)
    model = Attempts(posed, RigidBodies(posed), attempts.rtol, min(attempts.max_it, PATIENT))
    for start, proximal in coming_to_rest(model):
        model(start, proximal)
        if model.over:
            break
    found = model.best
    if found is None or found.status is not Status.CONVERGED:
        return None
    return replace(Start.at(problem, found.p, found.u_c), in_equilibrium=False, near=True)


def coming_to_rest(model: Attempts) -> Iterator[tuple[Start, float | None]]:
    """Starts of attempts at the model, from soft contact: where the bodies settle, and a damped one."""
    for start in soft_starts(model):
        for place in settled(model, start, model.max_it):
            yield place, None
        yield start, FIRM[0]
