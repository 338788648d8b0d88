"""The folder fclib/: the condensed contact problem of each step in the FCLIB format, for other programs' solvers.

Per contact point, normal first: u = W r + q, with r the forces on the point [N] and u = gap - w the opening and slip
[m], which are to be complementary. W is the Delassus operator of the bodies [m/N], the same in every step; q holds
loads, gaps and where slip is counted from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import EXACT, Array, Ints
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.solvers.contact.admissible_set import ContactBlock
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.laws.normal import Unilateral
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.formats.fclib import LocalProblem, write_local
from stickslip.workflows.formats.files import disk_errors, make_folder
from stickslip.workflows.writers.writer import Job, Keys, Turn, Writer, keys_of

FOLDER, KEY = "fclib", "output.fclib"
NO_ROW = -1  # for a direction that carries no friction: W, q and the force are zero there


@dataclass(frozen=True, kw_only=True)
class FclibKeys(Keys):
    """Whether they are written."""

    fclib: Annotated[
        bool, Key("-", "write the folder fclib/: W, q, mu of each step in the FCLIB format, for other solvers")
    ] = False


class FclibFiles(Writer):
    """One file a step; with it the run's own solution."""

    turn = Turn.AFTER
    keys = FclibKeys
    reader = "solvers of discrete contact problems"
    files = (f"{FOLDER}/*.hdf5",)

    @classmethod
    def wanted(cls, scene: Scene) -> bool:
        """Whether the scene asks for it.

        Raises:
            SceneError: it asks, but a contact is none of unilateral contact with Coulomb friction.
        """
        if not keys_of(FclibKeys, scene.output).fclib:
            return False
        require(scene.solver.surface != "matrix-free", KEY, True, "needs solver.surface = condensed")
        for name, contact in scene.pairs.items():
            friction, where = contact.friction, f"contacts.{name}"
            _require(isinstance(contact.normal, Unilateral), f'{where}.normal is not "unilateral"')
            coulomb = friction is None or (isinstance(friction, Coulomb) and friction.k_T is None)
            _require(coulomb, f'{where}.friction is neither "coulomb" without k_T nor absent')
            _require(not contact.sliding, f"{where}.sliding changes the contact points")
        return True

    def __init__(self, job: Job) -> None:
        """
        Raises:
            SceneError: the bodies are not condensed, or float, or some friction acts in some directions only.
        """
        super().__init__(job)
        assert job.simulation is not None
        stepper = job.simulation.stepper
        surface = stepper.surface
        require(isinstance(surface, CondensedSurface), KEY, True, "needs solver.surface = condensed")
        assert isinstance(surface, CondensedSurface)
        _require(not surface.floating, "contact alone holds a body or an obstacle")
        points = [_points(place) for place in stepper.cone.places]
        self._rows = np.concatenate([rows for rows, _ in points])  # (points, d) rows of the flat vectors, or NO_ROW
        self._mu = np.concatenate([mu for _, mu in points])
        self._weights = surface.W
        self._W = self._spread(surface)

    def _spread(self, surface: CondensedSurface) -> Array:
        """N F N^T by point; solved with the factor, so that the bodies' own answers stay what they are to the bit."""
        delassus = surface.N @ surface.by_factor(surface.N.T.toarray())
        known = self._rows.ravel() != NO_ROW
        rows = self._rows.ravel()[known]
        W = np.zeros((len(known), len(known)))
        W[np.ix_(known, known)] = (delassus + delassus.T)[np.ix_(rows, rows)] / 2
        return W

    def _flat(self, values: Array) -> Array:
        """Values by row (rows,) as values by point, normal first (points d,)."""
        return np.where(self._rows == NO_ROW, 0.0, values[self._rows]).ravel()

    def step(self, index: int, result: StepResult) -> None:
        r, u = self._flat(self._weights * result.p), self._flat(result.reference - result.w)
        problem = LocalProblem(W=sparse.csc_matrix(self._W), q=u - self._W @ r, mu=self._mu)
        of = self.job.scene.labels
        said = f"u in {of.length}, r in {of.force}"
        info = {
            "title": f"{self.job.scene.title}, step {index}",
            "description": f"static contact of elastic bodies, t = {result.time:g} s; {said}; from stickslip",
            "math_info": "W symmetric, positive definite where the bodies are held",
        }
        make_folder(self.job.folder / FOLDER)
        write_local(self._path(index), problem, info, {"u": u, "r": r})

    def names(self) -> Sequence[str]:
        return [f"{FOLDER}/"]

    def resume(self, steps: Sequence[StepResult]) -> None:
        for index, result in enumerate(steps, start=1):
            if not self._path(index).exists():
                self.step(index, result)
        folder = self.job.folder / FOLDER
        wanted = {self._path(index) for index in range(1, len(steps) + 1)}
        with disk_errors(folder):
            for path in folder.glob(f"{'[0-9]' * 6}.hdf5"):
                if path not in wanted:
                    path.unlink()

    def _path(self, index: int) -> Path:
        return self.job.folder / FOLDER / f"{index:06d}.hdf5"


def _require(ok: bool, why: str) -> None:
    require(ok, KEY, True, f"the format has held bodies with unilateral Coulomb contact at points only, and {why}")


def _points(place: ContactBlock) -> tuple[Ints, Array]:
    """Rows (m_n, d) of each point of a contact, normal first, and its mu (m_n,)."""
    contact, d = place.rows, place.components + 1
    rows = np.full((len(contact.W_n), d), NO_ROW)
    rows[:, 0] = np.arange(place.normal.start, place.normal.stop)
    mu = np.zeros(len(rows))
    if not isinstance(contact.friction, Coulomb) or not len(contact.W_t):
        return rows, mu
    pressed = contact.average.tocsr()
    pressed.eliminate_zeros()
    alone = (np.diff(pressed.indptr) == 1).all() and len(np.unique(pressed.indices)) == len(pressed.indices)
    # relative difference of weights that counts as rounding
    same = alone and np.allclose(pressed.data, 1.0, atol=EXACT, rtol=0)
    same = same and np.allclose(contact.W_n[pressed.indices], contact.W_t, atol=0, rtol=EXACT)
    _require(bool(same), f"contacts.{contact.name} has friction and pressure at different points")
    free = contact.free
    _require(bool((free.all(axis=1) | ~free.any(axis=1)).all()), f"supports stop some slip at contacts.{contact.name}")
    sliding = free.any(axis=1)
    at = pressed.indices[sliding]
    rows[at, 1:] = np.arange(place.tangential.start, place.tangential.stop).reshape(free.shape)[sliding]
    mu[at] = contact.friction.mu
    return rows, mu
