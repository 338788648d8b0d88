"""Array types that all packages use in signatures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
AnyArray = NDArray[Any]


def cross(arms: Array, forces: Array) -> Array:
    """Cross products over the last axis: (..., 3) in space; in the plane numbers (...), which numpy 2 does not make.

    >>> float(cross(np.array([1.0, 0.0]), np.array([0.0, 2.0])))
    2.0
    """
    if arms.shape[-1] == 3:
        return np.asarray(np.cross(arms, forces))
    return np.asarray(arms[..., 0] * forces[..., 1] - arms[..., 1] * forces[..., 0])
