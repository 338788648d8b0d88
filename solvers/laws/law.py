"""The contract of a contact law: its resolvent, its stiffness, its friction bound. Pointwise, vectorised."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import Array, Bools, Ints
from stickslip.geometry.errors import require
from stickslip.geometry.expression import Varying
from stickslip.geometry.keys import Choice, Key
from stickslip.geometry.protocols import Sparse


class Trial(NamedTuple):
    """Trial tractions t_hat = t + gamma (slip and elastic motion in the step) of points."""

    size: Array  # (m_t,) |t_hat| [Pa]
    gamma: Array  # (m_t,) > 0 [Pa/m]


class Dragged(NamedTuple):
    """Traction of points that slip at their own rates, in their way."""

    bound: Array  # (m_t,) [Pa]; of points that stick, at rest
    by_trial: Array  # (m_t,) its derivative by |t_hat| [-]
    by_pressure: Sparse  # (m_t, m_n) and by pressures [-]


class NormalLaw(Choice):
    """Relation of contact pressure p_n [Pa] and penetration u_n - g [m].

    Methods evaluate it through the resolvent only: p* solves p + gamma (law's inverse)(p) = p_hat, where
    p_hat = p + gamma (u_n - g) for any gamma > 0 [Pa/m]. So a rigid law needs no penalty parameter.
    """

    tag: ClassVar[str] = "law"
    sides: ClassVar[int] = 1  # 1: presses only, 2: holds in both directions
    ties: ClassVar[bool] = False  # no relative motion in any direction, from the initial position on
    at_quadrature: ClassVar[bool] = False  # pressure is a function of displacement, at facet quadrature points

    @property
    def power(self) -> float | None:
        """The power of the penetration that pressure is proportional to, 1 for a rigid law; None: to no power."""
        return None if self.at_quadrature else 1.0

    @property
    def give(self) -> Array | float:
        """Softness (m,) [m/Pa] of points that are rigid, as `stiffness` has it, but for this: p softness is added."""
        return 0.0

    def degree(self, order: int) -> int:
        """Quadrature degree that the law needs on facets, for elements of an order."""
        return 2 * order

    def resolvent(self, p_hat: Array, gamma: Array) -> Array:
        """Pressure p* (m,) [Pa].

        Args:
            p_hat: trial pressure p + gamma (u_n - g) (m,) [Pa].
            gamma: positive (m,) [Pa/m].
        """
        raise NotImplementedError

    def stiffness(self, p: Array, p_hat: Array) -> Array:
        """dp/d(penetration) (m,) [Pa/m] at p = resolvent(p_hat): 0 where open, inf where the law is rigid."""
        raise NotImplementedError

    def pressure(self, penetration: Array) -> Array:
        """Pressure (m,) [Pa] at a penetration u_n - g (m,) [m], of a law at quadrature points."""
        raise NotImplementedError

    def penetration(self, p: Array) -> Array:
        """Penetration (m,) [m] at a pressure (m,) [Pa]: the law's inverse."""
        return np.zeros_like(p)

    def energy(self, p: Array) -> Array:
        """Energy stored in the law at pressure p (m,) [Pa], per area (m,) [J/m²]."""
        return np.zeros_like(p)


@dataclass(frozen=True, kw_only=True)
class FrictionLaw(Choice):
    """Bound s [Pa] of the tangential traction t, and the tangential stiffness of the surface before slip.

    With k_T, the part t / k_T of the tangential displacement is elastic, the rest is slip. Methods evaluate the bound
    through `limit` and its slope: `average`, sparse (m_t, m_n) and nowhere negative, maps values at normal points to
    their averages at the points of t, see `ContactRows.average`.
    """

    tag: ClassVar[str] = "law"
    continuous: ClassVar[str] = (
        ""  # if the bound jumps where surfaces part, so that there may be no solution: a law with one
    )
    remembers: ClassVar[str] = ""  # what of the slip of a point it depends on, in words; empty: nothing; see `memory`
    timed: ClassVar[bool] = False  # whether the length of steps counts, so that times have to be seconds
    drags: ClassVar[bool] = False  # whether slip in a step raises its bound, see `dragged`
    rests: ClassVar[bool] = True  # whether points stick; false: any traction has its slip, which rounding may hide
    orthotropic: ClassVar[bool] = False  # whether tangential rows are measured along its `directions`
    k_T: Annotated[float | None, Key("Pa/m", "tangential stiffness before slip; absent: rigid")] = None

    def __post_init__(self) -> None:
        require(self.k_T is None or self.k_T > 0, "k_T", self.k_T, "must be positive, in Pa/m")

    @property
    def softness(self) -> float:
        """1 / k_T [m/Pa], 0 where the surface is rigid before slip."""
        return 1 / self.k_T if self.k_T else 0.0

    def degree(self, order: int) -> int:
        """Quadrature degree that the law needs on facets; 0: that of the normal law is enough."""
        return 0

    def resists(self) -> bool:
        """Whether it can resist tangential motion: its bound is not always zero."""
        return True

    def refuses(self, normal: NormalLaw) -> str | None:
        """Explain why this law cannot be combined with a normal law; None if it can."""
        return None

    def check_model(self, model: str) -> None:
        """Refuse a model that the law makes no sense in.

        Raises:
            SceneError: it has none of the law's directions.
        """

    @property
    def changes(self) -> bool:
        """Whether a parameter is a field that changes in time, see `placed`."""
        return False

    def placed(self, points: Array, time: float, end: float) -> FrictionLaw:
        """The law at tangential points (m_t, d) [m] and a time [s], with one parameter for each where it is a field.

        Args:
            end: last time of the scene [s].
        """
        return self

    def memory(self, points: int) -> Array:
        """Memory of points at rest (m_t,); it is kept from step to step and in checkpoints."""
        return np.zeros(points)

    def begun(
        self, memory: Array, pressure: Array, size: Array, state: Array | str | None, rate: float | None
    ) -> Array:
        """The memory (m_t,) of points under initial tractions.

        Args:
            memory: of points at rest.
            pressure, size: of tractions (m_t,) [Pa].
            state, rate: see `Initial`.
        """
        return memory

    def after(self, memory: Array, slip: Array, step: float) -> Array:
        """The memory (m_t,) at the end of a substep.

        Args:
            memory: at its start.
            slip: by which the points have slipped in it (m_t,) [m], >= 0; of points that do not touch 0.
            step: its length [s]; 0: values jump at t = 0.
        """
        return memory

    def rates(self, memory: Array) -> Array | None:
        """Slip rates (m_t,) [m/s] at the end of a substep; None: it asks for none."""
        return memory if self.timed else None

    def ages(self, memory: Array) -> Array | None:
        """States theta (m_t,) [s] of points with a memory; None: it has none."""
        return None

    def at(self, memory: Array) -> FrictionLaw:
        """The law of points with a memory (m_t,) at the end of a substep; what `remembers` has no other bound."""
        return self

    def within(self, memory: Array, step: float) -> FrictionLaw:
        """The law in a substep of a length [s] that is to end with a memory (m_t,), if that does not follow at once."""
        return self.at(memory)

    def work_aside(self, p: Array, average: Sparse, memory: Array, step: float) -> Array:
        """Work of friction (m_t,) [J/m²] in a substep on motion that no tangential row measures.

        Args:
            p: pressures (m_n,) [Pa] at its end.
            memory: at its end.
            step: its length [s].
        """
        return np.zeros(average.shape[0])

    def dragged(self, p: Array, average: Sparse, trial: Trial) -> Dragged:
        """Bound of points by the slip that trial tractions lead to; of a law that `drags`.

        Args:
            p: normal pressures (m_n,) [Pa].
            average: (m_t, m_n), see the class.
            trial: t + gamma (u_T - u_T,before) of the points.
        """
        raise NotImplementedError

    def of_point(self, point: int) -> FrictionLaw:
        """The law of one tangential point."""
        return self

    def of_points(self, points: Ints) -> FrictionLaw:
        """The law of some tangential points."""
        return self

    def directions(self, tangents: Array, free: Bools) -> Array:
        """Directions (m_t, d-1, d) that an orthotropic law measures tractions and slip along, orthogonal, not unit.

        Args:
            tangents: (m_t, d-1, d), unit.
            free: (m_t, d-1) directions that carry a multiplier; where not all do they are kept, but for their length.
        """
        return tangents

    @property
    def at_no_pressure(self) -> float:
        """Bound [Pa] of surfaces that touch without pressing; it comes on top of the slopes of `lines`."""
        return 0.0

    @property
    def weakening(self) -> float:
        """Largest fall of mu by slip [1/m], 0 where it does not fall."""
        return 0.0

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        """Bound s (m_t,) [Pa] >= 0.

        Args:
            p: normal pressures (m_n,) [Pa].
            average: (m_t, m_n), see the class.
            normal: the normal law of the contact.
            time: [s].
            end: last time of the scene [s].
        """
        raise NotImplementedError

    def limit_slope(self, p: Array, average: Sparse, normal: NormalLaw) -> Sparse:
        """ds/dp [-], sparse (m_t, m_n)."""
        return sparse.csr_matrix(average.shape)

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        """Lines that bound s: min(cap, below p) <= s <= min(cap, above p) for p >= 0, `at_no_pressure` apart.

        Returns:
            cap [Pa], below [-], above [-]; infinite where there is no such limit.
        """
        raise NotImplementedError

    def homogeneous(self, normal: NormalLaw, time: float, end: float) -> bool:
        """Whether twice the pressure has twice the bound."""
        cap, below, above = self.lines(normal, time, end)
        return cap == np.inf and below == above and not self.at_no_pressure

    def amplitudes(self) -> Mapping[tuple[str, ...], Varying]:
        """The law's values in time, by key and component."""
        return {}


def touching(p: Array, average: Sparse | Array, normal: NormalLaw) -> Bools:
    """Tangential points (m_t,) with contact: the average pressure is positive, or the normal law cannot open."""
    return np.asarray((average @ p > 0) | (normal.sides == 2))


def touched(p: Array, average: Sparse | Array, normal: NormalLaw) -> Array:
    """Share (m_t,) of each tangential point that is in contact [-]; of a law at quadrature points, of those that press.

    >>> from stickslip.solvers.laws.normal import Compliance
    >>> touched(np.array([2.0, 0.0]), np.array([[0.25, 0.75]]), Compliance(c_n=1.0))
    array([0.25])
    """
    if normal.at_quadrature:
        return np.asarray(average @ (p > 0).astype(float))
    return touching(p, average, normal).astype(float)
