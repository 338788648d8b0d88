"""Array types that all packages use in signatures, and how small a number has to be to count as none.

A tolerance is one of these levels times a size of what is compared, and the line that does so says which size.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
AnyArray = NDArray[Any]

EPS = float(np.finfo(np.float64).eps)  # 2.2e-16
TINY = float(np.finfo(np.float64).tiny) / EPS  # 1e-292: keeps denominators, logarithms and roots from zero
LAST_DIGITS = 64 * EPS  # 1.4e-14: of one sum or product, and where Newton's method for a few unknowns ends
EXACT = 1e-12  # of what linear systems and long sums yield
HALF_DIGITS = EPS**0.5  # 1.5e-8: what a system leaves that is singular but for rounding
ROUNDING = 1e-9  # of coordinates, shape functions, forces and motions that went through several of those
CLOSE = 1e-6  # of what other programs hand over, of directions, and of answers that are improved afterwards
SLIGHT = 1e-3  # a part that the eye does not see, and by which numbers tell nothing apart


def cross(arms: Array, forces: Array) -> Array:
    """Cross products over the last axis: (..., 3) in space; in the plane numbers (...), which numpy 2 does not make.

    >>> float(cross(np.array([1.0, 0.0]), np.array([0.0, 2.0])))
    2.0
    """
    if arms.shape[-1] == 3:
        return np.asarray(np.cross(arms, forces))
    return np.asarray(arms[..., 0] * forces[..., 1] - arms[..., 1] * forces[..., 0])
