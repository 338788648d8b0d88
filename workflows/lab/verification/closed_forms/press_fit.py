"""A shaft pressed into a hub, both with free ends: Lamé's solution in plane stress, cold and warm.

Source: Timoshenko & Goodier, Theory of Elasticity, § 28.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Shaft:
    """A full cylinder."""

    radius: float  # [m]
    E: float  # [Pa]
    nu: float  # [-]

    def displacement(self, p: float, r: Array) -> Array:
        """Radial displacement (n,) [m] at radii r (n,) [m] under a pressure p [Pa] around it.

        >>> Shaft(radius=1.0, E=2.0, nu=0.5).displacement(1.0, np.array([0.0, 1.0]))
        array([-0.  , -0.25])
        """
        return np.asarray(-(1 - self.nu) * p * r / self.E)

    def stresses(self, p: float, r: Array) -> tuple[Array, Array]:
        """Radial and hoop stress (n,) [Pa]: both are the pressure."""
        return np.full_like(r, -p), np.full_like(r, -p)


@dataclass(frozen=True, kw_only=True)
class Hub:
    """A ring."""

    bore: float  # radius [m]
    outer: float  # radius [m]
    E: float  # [Pa]
    nu: float  # [-]

    @property
    def _share(self) -> float:
        """Mean of radial and hoop stress, over the pressure."""
        return self.bore**2 / (self.outer**2 - self.bore**2)

    def displacement(self, p: float, r: Array, expanded: float = 0.0) -> Array:
        """Radial displacement (n,) [m] at radii r (n,) [m] under a pressure p [Pa] in the bore.

        Args:
            expanded: free strain, expansion times temperature.

        >>> hub = Hub(bore=1.0, outer=2.0, E=1.0, nu=0.0)
        >>> hub.displacement(3.0, np.array([1.0, 2.0])).tolist(), hub.displacement(0.0, np.array([2.0]), 0.25).tolist()
        ([5.0, 4.0], [0.5])
        """
        strain = self._share * p / self.E
        return np.asarray(strain * ((1 - self.nu) * r + (1 + self.nu) * self.outer**2 / r) + expanded * r)

    def stresses(self, p: float, r: Array) -> tuple[Array, Array]:
        """Radial and hoop stress (n,) [Pa]: -p and p (b² + a²) / (b² - a²) in the bore.

        >>> Hub(bore=1.0, outer=2.0, E=1.0, nu=0.3).stresses(3.0, np.array([1.0, 2.0]))
        (array([-3.,  0.]), array([5., 2.]))
        """
        mean, turn = self._share * p, self._share * p * self.outer**2 / r**2
        return mean - turn, mean + turn


def pressure(shaft: Shaft, hub: Hub, interference: float, expanded: float = 0.0) -> float:
    """Pressure [Pa] where they meet.

    Args:
        interference: [m].
        expanded: free strain of the hub, which takes its part of the interference, or all of it.

    >>> shaft, hub = Shaft(radius=1.0, E=1.0, nu=0.0), Hub(bore=1.0, outer=3.0, E=1.0, nu=0.0)
    >>> round(pressure(shaft, hub, 9.0), 12), round(pressure(shaft, hub, 9.0, 5.0), 12), pressure(shaft, hub, 9.0, 10.0)
    (4.0, 1.777777777778, 0.0)
    """
    at = np.array([hub.bore])
    gives = hub.displacement(1.0, at) - shaft.displacement(1.0, at)
    return max(interference - expanded * hub.bore, 0.0) / float(gives[0])
