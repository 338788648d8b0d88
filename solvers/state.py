"""An equilibrium: everything the next step needs of the past."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.energy import Energy
from solvers.operators.rows import ContactRows
from solvers.pace import Pace

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Before:
    """The state before a state, as far as the start of the next step is extrapolated from it."""

    time: float
    p: Array  # (rows,) in the same rows as the state's own [Pa]


@dataclass(frozen=True)
class State:
    """An equilibrium: everything the next step needs of the past. Vectors run over all displacements."""

    time: float
    u: Any  # [m]
    u_s: Any  # prescribed part [m]
    load: Any  # [N]
    residual: Any  # K u - load + B^T p [N]: what supports and periodic sides carry
    p: Array  # (rows,) [Pa]
    w: Array  # (rows,) relative displacement [m]
    motion: Mapping[str, Array]  # (n, d) of each contact's obstacle; none at the start, even if it jumps at t = 0 [m]
    driven: Array  # (o,) motion of the obstacles that forces drive, by `System.driven` [m]
    slip: Mapping[str, Array]  # (n, d) total at the slave's nodes of each contact [m]
    forces: Mapping[str, Array]  # (n_all, d) B^T p of each contact, in the rows that the step was solved in [N]
    rows: tuple[ContactRows, ...]  # that p and w are told in
    energy: Energy
    before: Before | None = None  # none: the start, or nothing to be learnt from it
    pace: Pace = Pace()
    law_error: float = 0.0  # added up since t = 0, see `Solution` [J^(1/2)]
    peak: float = 0.0  # largest stored energy since t = 0: what errors are relative to, also where all is let go [J]
