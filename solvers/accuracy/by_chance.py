"""How far sums and largest values of a contact may be off although they agree with those of a better solution.

Differences at nodes cancel in a sum by chance. As if they were independent, that of the sum is at least a part of the
root of the sum of their squares; of the dissipation since t = 0 that of the last step counts alone. A largest value is
off by as much as the values around it. The parts are fitted to the problems of `stickslip verify accuracy`: they hardly
raise what is stated, but where it would be .05 to .5 of the error.
"""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import Array, Bools
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.results.step_result import OPEN, ContactState
from stickslip.solvers.scene.record import Value

FORCE, DISSIPATION, PRESSURE, SLIP = 0.3, 0.5, 0.5, 1.0


def by_chance(c: ContactRows, own: ContactState, better: ContactState) -> dict[str, Value]:
    """The least error of numbers of a contact, by quantity, >= 0.

    Args:
        own: whose errors are asked for.
        better: a solution with less of the same error, at the same nodes.
    """
    weight, pressure = own.weight[:, None], np.abs(better.pressure - own.pressure)
    force = weight * (better.traction - own.traction + (own.pressure - better.pressure)[:, None] * c.frames[:, 0])
    work = (weight * (better.traction * better.slip_increment - own.traction * own.slip_increment)).sum(axis=1)
    slip = np.linalg.norm(better.slip - own.slip, axis=1)
    slipped = np.where(own.status == OPEN, 0.0, np.linalg.norm(own.slip, axis=1))
    dissipation = DISSIPATION * float(np.linalg.norm(work))
    return {
        "force": FORCE * np.linalg.norm(force, axis=0),
        "normal_force": FORCE * float(np.linalg.norm(own.weight * pressure)),
        "max_pressure": PRESSURE * float(pressure[_around(c, own.pressure)].max(initial=0.0)),
        "max_slip": SLIP * float(slip[_around(c, slipped)].max(initial=0.0)),
        "dissipation": dissipation,
        "dissipation_total": dissipation,
    }


def _around(c: ContactRows, values: Array) -> Bools:
    """The nodes with the largest of some values (n,) above zero, and their neighbours."""
    peaks = (values > 0) & (values == values.max(initial=0.0))
    return np.asarray(peaks | (c.surface.neighbours() @ peaks.astype(float) > 0))
