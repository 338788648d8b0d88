"""Solved scenes are saddle points at fixed p_T: (u, λ) against random v and η, and what the source says of λ.

Equation numbers are those of Pop (1999); its c_T p_T is the friction bound s here, its v_T the slip of the step.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy import sparse

from shared.cases import often
from stickslip.solvers.contact.admissible_set import ContactBlock
from stickslip.solvers.method_registry import METHODS, Solver
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.stepper import Accepted
from stickslip.solvers.stepping.update import relative_displacement
from stickslip.solvers.system.system import System
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import read

Array = NDArray[np.float64]
COMPLIANCE = (
    'contacts.base.normal={law="compliance", c_n=20.0, m_n=2.0}',
    'contacts.base.friction={law="compliance", c_T=6.0, m_T=2.0}',
)
COARSE = ("geometry.mesh_size=0.4", "geometry.contact_mesh_size=0.2")
ROUND = ('obstacles.foundation={shape="cylinder", point=[2.0, -10.0], radius=10.0}',)  # 0.2 m lower at both ends
SCENES = {
    "block": ("block", COARSE),
    "block, open at the ends": ("block", (*COARSE, *ROUND)),
    "cube": ("cube", ("geometry.mesh_size=0.25",)),
    "block, compliance": ("block", (*COARSE, *COMPLIANCE)),
    "cube, compliance": ("cube", ("geometry.mesh_size=0.25", *COMPLIANCE)),
}
TRIALS = 1000
TOLERANCE = 1e-11  # of the solver


@dataclass(frozen=True)
class Saddle:
    """The last step of a scene, and the Lagrangian of Theorem 3.1 for it, with one contact."""

    simulation: Simulation
    accepted: Accepted

    @property
    def system(self) -> System:
        return self.simulation.system

    @property
    def place(self) -> ContactBlock:
        (place,) = self.accepted.problem.cone.places
        return place

    @cached_property
    def s(self) -> Array:
        """c_T p_T (m_t,), fixed at the solution [Pa]."""
        return self.accepted.problem.cone.bound(self.place, self.accepted.state.p[self.place.normal])

    @cached_property
    def lam(self) -> Array:
        """λ (m_t, d-1)."""
        t = self.accepted.state.p[self.place.tangential].reshape(len(self.s), -1)
        return np.divide(t, self.s[:, None], out=np.zeros_like(t), where=self.s[:, None] > 0)

    def relative(self, v: Any) -> tuple[Array, Array]:
        """v_n - g (m_n,) and v_T (m_t, d-1) of a displacement, tangentially since the last step [m]."""
        problem = self.accepted.problem
        r = relative_displacement(self.system, v, problem.cone.time, np.zeros(0)) - problem.gap
        return r[self.place.normal], r[self.place.tangential].reshape(len(self.s), -1)

    def energy(self, v: Any) -> tuple[float, Array]:
        """1/2 a(v, v) + what compliance stores - L(v) [J], and v_T: all that the Lagrangian takes of v."""
        rows, (depth, v_T) = self.place.rows, self.relative(v)
        law, stored = rows.normal, 0.0
        if law.at_quadrature:  # the potential of j_n
            stored = float(rows.W_n @ (law.c_n * np.maximum(depth, 0.0) ** (law.m_n + 1) / (law.m_n + 1)))
        return float((self.system.K * v).dot(v) / 2 - self.accepted.state.load.dot(v) + stored), v_T

    def lagrangian(self, of_v: tuple[float, Array], eta: Array) -> float:
        """Energy + ∫ c_T p_T η . v_T [J]."""
        return of_v[0] + self.friction(eta, of_v[1])

    def friction(self, eta: Array, v_T: Array) -> float:
        """∫ c_T p_T η . v_T [J]."""
        return float(np.sum((self.place.rows.W_t * self.s)[:, None] * eta * v_T))

    @cached_property
    def lift(self) -> Any:
        """Free numbers (n_free,) that undo a penetration (m_n,): N_n times this is 1."""
        N_n = self.place.rows.N_n @ self.system.interface.trace(self.place.rows)
        return N_n.T @ sparse.linalg.inv((N_n @ N_n.T).tocsc())

    def trial(self, random: np.random.Generator, size: float, sliding: bool) -> Any:
        """A displacement of V near u: supports hold it, and under unilateral contact v_n <= g: it lies in K.

        Every other one slides only: rough ones of K lose more by lifting off than a wrong λ lets them gain.
        """
        system, z = self.system, self.system.T.createVecRight()
        z.array[:] = random.normal(size=z.getLocalSize()) * size
        v = self.accepted.state.u + system.T * z
        if self.place.rows.normal.at_quadrature:
            return v
        z.array[:] = 0
        excess = self.relative(v)[0]
        excess = excess - self.relative(self.accepted.state.u)[0] if sliding else np.maximum(excess, 0.0)
        z.array[system.interface.dofs] = -self.lift @ excess
        return v + system.T * z

    def multiplier(self, random: np.random.Generator) -> Array:
        """η of Λ: |η| <= 1 on the support of p_T, every radius as likely, and 0 elsewhere."""
        eta = random.normal(size=self.lam.shape)
        eta *= (random.random(len(eta)) / np.linalg.norm(eta, axis=1))[:, None]
        return np.where((self.s > 0)[:, None] & self.place.rows.free, eta, 0.0)


def solved(name: str, method: str) -> Saddle:
    """One of the scenes, by a method."""
    ready, overrides = SCENES[name]
    scene: Scene = read(ready, overrides)
    simulation = prepare(replace(scene, solver=Solver(method=method, tolerance=TOLERANCE)))
    state = simulation.stepper.start()
    for time in scene.requested_times():
        accepted = simulation.stepper.reach(state, time, lambda row: None)
        state = accepted.state
    return Saddle(simulation, accepted)


@pytest.fixture(scope="module", params=SCENES)
def saddle(request: pytest.FixtureRequest) -> Saddle:
    return solved(request.param, "condensed-newton")


def sizes(saddle: Saddle, random: np.random.Generator) -> Array:
    """Of the trials [m]: from where the first derivative decides to where the curvature does."""
    return np.asarray(saddle.accepted.problem.u_ref * 10 ** random.uniform(-6, 0, TRIALS))


def test_u_is_the_least_over_v(saddle: Saddle) -> None:
    """L(u, λ) <= L(v, λ), the second inequality of (2.5), and of no other λ."""
    random = np.random.default_rng(1)
    trials = [saddle.trial(random, size, i % 2 == 0) for i, size in enumerate(sizes(saddle, random))]
    u, lam, found = saddle.accepted.state.u, saddle.lam, [saddle.energy(v) for v in trials]
    here = saddle.energy(u)
    above = np.array([saddle.lagrangian(v, lam) for v in found]) - saddle.lagrangian(here, lam)
    rounding = 1e-12 * abs((saddle.system.K * u).dot(u))
    assert above.min() > -rounding
    assert above.max() > 1e3 * rounding
    for wrong in (0.0 * lam, -lam, 0.9 * lam):
        assert min(saddle.lagrangian(v, wrong) for v in found) < saddle.lagrangian(here, wrong) - 100 * rounding


def test_lambda_is_the_greatest_over_the_multipliers(saddle: Saddle) -> None:
    """L(u, η) <= L(u, λ), the first inequality of (2.5): λ makes the most of the slip, ∫ c_T p_T |u_T|."""
    random = np.random.default_rng(2)
    u = saddle.energy(saddle.accepted.state.u)
    greatest, u_T = saddle.lagrangian(u, saddle.lam), u[1]
    all_slip = saddle.friction(saddle.lam, u_T)
    assert all_slip == pytest.approx(saddle.place.rows.W_t * saddle.s @ np.linalg.norm(u_T, axis=1), rel=1e-7)
    assert all_slip > 0
    found = np.array([saddle.lagrangian(u, saddle.multiplier(random)) for _ in range(TRIALS)])
    assert found.max() <= greatest + 1e-12 * abs(greatest)
    assert found.min() < greatest - all_slip / 2


def test_lambda_works_against_slip(saddle: Saddle) -> None:
    assert_lambda(saddle, 1e-8)


def assert_lambda(saddle: Saddle, creep: float) -> None:
    """λ . v_T = |v_T|, (2.4): where p_T > 0, for elsewhere λ = 0; |λ| <= 1, (2.2).

    Args:
        creep: what may slip where nothing does, beside u_ref.
    """
    u_T, lam, on = saddle.relative(saddle.accepted.state.u)[1], saddle.lam, saddle.s > 0
    length, u_ref = np.linalg.norm(u_T, axis=1), saddle.accepted.problem.u_ref
    assert_allclose(np.sum(lam * u_T, axis=1)[on], length[on], rtol=0, atol=creep * u_ref)
    assert np.max(length[on]) > 1e-3 * u_ref  # some slip
    assert np.all(np.linalg.norm(lam, axis=1) <= 1 + 1e-9)
    assert not lam[~on].any()


APPROXIMATE = {"regularised": 1e-3, "perturbed-lagrangian": 1e-3}  # what sticks creeps, by smoothing or springs
OTHERS = [m for m in METHODS if m not in ("auto", "condensed-newton")]


@pytest.mark.parametrize(
    "case",
    often(
        [("block, open at the ends", method) for method in OTHERS]
        + [("cube", method) for method in ("surface-uzawa", *APPROXIMATE)],
        [("cube", "surface-uzawa"), *(("block, open at the ends", method) for method in (*APPROXIMATE, *OTHERS[::3]))],
    ),
)
def test_lambda_of_every_method_works_against_slip(case: tuple[str, str]) -> None:
    """By methods that carry it as an unknown, recover it, or let springs ask for it."""
    name, method = case
    saddle = solved(name, method)
    assert_lambda(saddle, APPROXIMATE.get(method, 1e-8))
    assert ("open" in name) == bool(np.any(saddle.s == 0))


def test_the_stress_on_the_surface_is_minus_the_bound_times_lambda(saddle: Saddle) -> None:
    """σ_T = -c_T p_T λ, (2.6), as the results show it, and its force is what equilibrium asks for."""
    contact = saddle.simulation.observer(saddle.accepted).contacts["base"]
    assert np.abs(contact.traction).max() > 0
    assert_allclose(contact.traction, -contact.bound[:, None] * contact.lam, atol=1e-12 * contact.bound.max())
    off = contact.bound == 0
    assert not contact.lam[off].any()
    assert not contact.traction[off].any()


def test_the_weak_form_holds_with_the_sign_of_theorem_2_1(saddle: Saddle) -> None:
    """b(u, v) + ∫ c_T p_T λ v_T = L(v), (2.3), for any v of V; Proposition 3.1 has the wrong sign."""
    system, state, random = saddle.system, saddle.accepted.state, np.random.default_rng(4)
    rows, free = saddle.place.rows, system.T.createVecRight()
    K_u, load = system.K * state.u, state.load
    for _ in range(20):
        free.array[:] = random.normal(size=free.getLocalSize())
        v = system.T * free
        moved = system.interface.displacement(v)[0].ravel()
        v_n, v_T = rows.N_n @ moved, (rows.N_t @ moved).reshape(saddle.lam.shape)
        b = K_u.dot(v) + float((rows.W_n * state.p[saddle.place.normal]) @ v_n)
        integral = saddle.friction(saddle.lam, v_T)
        scale = np.abs((K_u.array) * v.array).sum()
        assert abs(b + integral - load.dot(v)) < 1e-10 * scale
        assert abs(b - integral - load.dot(v)) > 1e-6 * scale


def test_some_of_these_surfaces_are_open(saddle: Saddle, request: pytest.FixtureRequest) -> None:
    """Off the support there is something to see only where a surface has lifted off."""
    if "open" in request.node.callspec.id:
        assert 0 < np.mean(saddle.s == 0) < 0.9
        assert saddle.relative(saddle.accepted.state.u)[0].min() < -1e-3 * saddle.accepted.problem.u_ref
    else:
        assert np.mean(saddle.s > 0) > 0.5
