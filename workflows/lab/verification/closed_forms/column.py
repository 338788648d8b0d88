"""Column pressed on a compliant foundation: M (U - d) / H = c_n (d - g)_+^m.

A square or cube with u_x (= u_y) = 0 on its sides is under uniaxial strain, so the pressure is the same at every
height: M times the shortening (U - d) / H, M the constrained modulus. At the base it is the normal compliance
law. The displacement is linear, so any finite element must reproduce these numbers to solver precision.

Signs: U and d are the downward displacements of the top and of the base, g the initial gap (negative = overlap at the
start), all in [m]; the pressure is positive when pressing. c_n has the unit Pa/m^m.

Source: equilibrium, derived here; the table is recomputed in test_reference.py with 50 digits.
"""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class ColumnState:
    """Where the base of the column is and what it carries."""

    penetration: float  # d - g where they touch, otherwise 0 [m]
    displacement: float  # d, downward [m]
    pressure: float  # [Pa]


def constrained_modulus(E: float, nu: float) -> float:
    """Stiffness under uniaxial strain, M = E (1 - nu) / ((1 + nu) (1 - 2 nu)) [Pa].

    >>> round(constrained_modulus(1000.0, 0.3), 4)
    1346.1538
    """
    return E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))


def penetration(*, stiffness: float, excess: float, c_n: float, m: float) -> float:
    """Root x > 0 of stiffness (excess - x) = c_n x^m; 0 where excess <= 0 [m].

    The unknown is x = d - g itself and not d: at grazing contact x is many orders smaller than g, and d - g would lose
    those digits. With x = excess y the equation is y + K y^m = 1: increasing, convex for m >= 1, and of relative
    condition at most 1 at its root. Newton from above therefore falls monotonically, until rounding stops it.

    Args:
        stiffness: M / H [Pa/m].
        excess: U - g, penetration without resistance of the base [m].
        c_n: compliance coefficient [Pa/m^m], > 0.
        m: compliance exponent, >= 1.

    Raises:
        ValueError: for m < 1, or a stiffness or c_n that is not positive.
    """
    if m < 1:
        raise ValueError(f"m = {m}: the compliance exponent must be at least 1")
    if stiffness <= 0 or c_n <= 0:
        raise ValueError(f"stiffness = {stiffness}, c_n = {c_n}: both must be positive")
    if excess <= 0:
        return 0.0
    K = c_n * excess ** (m - 1) / stiffness
    y = 1.0 if K <= 1 else K ** (-1 / m)
    while True:
        smaller = y - (y + K * y**m - 1) / (1 + m * K * y ** (m - 1))
        if smaller >= y:
            return excess * y
        y = smaller


def driven_by_displacement(*, M: float, U: float, g: float, c_n: float, m: float, height: float = 1.0) -> ColumnState:
    """State under a prescribed top displacement U (downward).

    U - g is exact in floating point when U and g are within a factor 2 (Sterbenz), so the answer belongs to the two
    numbers as given. Where g (1 + 1e-6) is meant more exactly than a float can hold it, call `penetration` with the
    excess g 1e-6.

    >>> state = driven_by_displacement(M=1000.0, U=0.03, g=0.01, c_n=1000.0, m=1)
    >>> round(state.displacement, 12), round(state.pressure, 12)
    (0.02, 10.0)
    """
    x = penetration(stiffness=M / height, excess=U - g, c_n=c_n, m=m)
    return ColumnState(penetration=x, displacement=g + x if x > 0 else U, pressure=c_n * x**m)


def driven_by_force(*, p: float, g: float, c_n: float, m: float) -> ColumnState:
    """State under a prescribed pressure p on top: d = g + (p / c_n)^(1 / m), whatever the column is made of.

    >>> driven_by_force(p=4.0, g=0.5, c_n=1.0, m=2).displacement
    2.5
    """
    if p < 0:
        raise ValueError(f"p = {p} Pa: a pulled column leaves its foundation, p must not be negative")
    x = (p / c_n) ** (1 / m)
    return ColumnState(penetration=x, displacement=g + x, pressure=p)


@dataclass(frozen=True, kw_only=True)
class ColumnCase:
    """One tabulated column of height 1 m with the digits it was published with."""

    U: float  # [m]
    g: float  # [m]
    c_n: float  # [Pa/m^m]
    m: float
    d: float  # [m]
    p: float  # [Pa]
    digits: int  # significant digits of d and p
    E: float = 1000.0  # [Pa]
    nu: float = 0.3


TABLE = (
    ColumnCase(U=0.01, g=0.002, c_n=1e4, m=1, d=2.9491525e-3, p=9.4915254, digits=8),
    ColumnCase(U=0.01, g=0.002, c_n=1e6, m=2, d=4.6768878e-3, p=7.1657280, digits=8),
    ColumnCase(U=0.01, g=0.002, c_n=1e8, m=3, d=5.8291773e-3, p=5.6145690, digits=8),
    # overlap at the start
    ColumnCase(U=0.0, g=-0.002, c_n=1e4, m=1, d=-1.7627119e-3, p=2.3728814, digits=8),
    # nearly incompressible
    ColumnCase(U=0.01, g=0.002, c_n=1e4, m=1, d=9.952299e-3, p=79.52299, digits=7, nu=0.4999),
)
