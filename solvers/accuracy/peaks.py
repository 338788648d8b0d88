"""Whether a largest pressure has a limit, or grows without end as the mesh is refined: at a corner, at the end of a
punch.

Such a pressure falls off like a negative power of the distance: by much to the nearest nodes, by far less to those
behind. Where it is smooth, or falls to zero at the edge of contact, the fall grows with the distance or stays.
"""

from __future__ import annotations

import numpy as np

from geometry.arrays import Array
from geometry.surfaces.surface import Surface

STEEP = (
    0.15  # part by which the nearest nodes have less; smooth pressures that were tried: .10 at most on shipped meshes
)
CONVEX = 1.5  # times the next fall; r^(-1/2) has 2.3, r^(-1/10) 1.8


def grows(side: Surface, pressure: Array) -> bool:
    """Whether the largest pressure (n,) [Pa] of a side of n nodes grows without end."""
    rings = [float(pressure.max(initial=0.0))]
    seen = np.arange(len(pressure)) == np.argmax(pressure) if len(pressure) else np.zeros(0, bool)
    near = side.neighbours()
    for _ in range(3):
        ring = (near @ seen.astype(float) > 0) & ~seen
        if not ring.any():
            return False
        rings.append(float(pressure[ring].max()))
        seen |= ring
    first, second, third = -np.diff(rings)
    return bool(rings[-1] > 0 and first > STEEP * rings[0] and first > CONVEX * second and second >= 0 and third >= 0)
