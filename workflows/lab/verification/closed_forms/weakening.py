"""A point on a spring whose coefficient of friction depends on its slip so far: stick, weakening, jump, plateau.

The spring's end is moved by V, and drags the point at w under a pressure p: tau = k (V - w), |tau| <= mu(l) p, l the
length of the path of w. In a step the point slips until friction balances the spring for the first time. On a straight
piece of mu(l) the excess |tau| - mu(l) p is linear in the slip: it falls if p d mu/dl > -k, otherwise slip jumps to the
next piece.

Source: derived here; the condition of stability is that of Rice & Ruina, J. Appl. Mech. 50 (1983), without a rate.
"""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import Array


def drag(table: tuple[tuple[float, float], ...], p: float, k: float, ends: Array) -> tuple[Array, Array]:
    """Traction tau [Pa] and length of slip [m] after each step (steps,), from rest.

    Args:
        table: mu [-] by length of slip [m], linear between its lines and constant beyond them.
        p: pressure [Pa].
        k: stiffness of the spring [Pa/m].
        ends: V after each step (steps,) [m], monotone between them.

    >>> tau, length = drag(((0.0, 0.3), (1.0, 0.2)), 10.0, 2.0, np.array([1.0, 2.0, 5.0]))
    >>> tau.round(9), length.round(9)
    (array([2., 2., 2.]), array([0., 1., 4.]))
    """
    at, mu = np.array(table).T
    tau, lengths, w, length = np.zeros(len(ends)), np.zeros(len(ends)), 0.0, 0.0
    for i, V in enumerate(ends):
        way = np.sign(V - w)
        corners = [length, *at[at > length]]
        excess = [k * (abs(V - w) - (x - length)) - p * float(np.interp(x, at, mu)) for x in corners]
        slip = 0.0
        if excess[0] > 0:
            j = next((j for j, e in enumerate(excess) if e <= 0), len(corners))
            if j == len(corners):  # beyond the last line mu stays what it is
                slip = corners[-1] - length + excess[-1] / k
            else:
                part = excess[j - 1] / (excess[j - 1] - excess[j])
                slip = corners[j - 1] - length + part * (corners[j] - corners[j - 1])
        w, length = w + way * slip, length + slip
        tau[i], lengths[i] = k * (V - w), length
    return tau, lengths
