"""A column without lateral strain on springs, pressed by a plate that comes down, and sheared at its top and sides."""

from __future__ import annotations

from dataclasses import dataclass

E, HEIGHT, GAP = 1000.0, 1.0, 1e-3  # [Pa], [m], [m] between plate and top
NORMAL, TANGENTIAL = 500.0, 300.0  # of the springs [Pa/m]
DOWN, SHEAR = 6e-3, 0.5  # of the plate [m], of the tractions [Pa]


@dataclass(frozen=True, kw_only=True)
class BedState:
    """Column and springs in series; the shear modulus is E / 2, nu being zero."""

    p: float  # pressure of the plate [Pa]
    settlement: float  # of the base [m]
    along: float  # displacement of the top by shear [m]
    stored: float  # energy of column and springs per area [J/m²]


def state(down: float, shear: float) -> BedState:
    """State under a plate that comes down by `down` [m], and under a uniform shear stress [Pa].

    >>> state(GAP + 0.003, 0.0).p  # 3 mm go into 1 / 500 + 1 / 1000
    1.0
    """
    p = max(0.0, down - GAP) / (1 / NORMAL + HEIGHT / E)
    along = shear * (1 / TANGENTIAL + HEIGHT / (E / 2))
    return BedState(p=p, settlement=p / NORMAL, along=along, stored=(p * max(0.0, down - GAP) + shear * along) / 2)
