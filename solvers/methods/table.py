"""Which method works with what: yes, or refused with one line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

RIGID = "rigid"  # the operator of a rigid obstacle


@dataclass(frozen=True, kw_only=True)
class Applicability:
    """What a method needs of a scene, and when to use it.

    All of them work in every model, with cells of every kind and order, and on any number of ranks.
    """

    floating: bool  # works while a body is held by contact and friction alone, or an obstacle is moved by a force
    use: str
    normal: tuple[str, ...] | None = None  # names of the normal laws that it can do; None: all
    friction: tuple[str, ...] | None = None  # of the friction laws
    k_T: bool = True  # tangential stiffness before slip
    operators: tuple[str, ...] | None = None  # RIGID, and those between bodies
    sliding: bool = True  # contact that is looked for where the bodies have moved to
    matrix_free: bool = True  # meets the bodies through iterative solves too
    condensed: bool = True  # meets them through their dense stiffness too
    keys: tuple[str, ...] = ()  # of [solver], that it knows besides those that all know
    contends: bool = True  # for the best price, where a cost study is free to choose

    def knows(self, what: str, name: str) -> bool:
        """Whether one of its laws (`normal`, `friction`) or `operators` is one that it can do."""
        known: tuple[str, ...] | None = getattr(self, what)
        return known is None or name in known


UZAWA = ("relaxation", "alpha", "friction_update")
INNER = ("inner_rule", "inner_tolerance")

METHODS: Mapping[str, Applicability] = {
    "auto": Applicability(
        floating=True, use="the default: condensed-newton, or surface-uzawa where iterative solves are cheaper"
    ),
    "condensed-newton": Applicability(floating=True, use="few iterations, hard to break", matrix_free=False),
    "surface-uzawa": Applicability(
        floating=True, use="few volume solves at any mesh size: for bodies too large to condense"
    ),
    "gram-uzawa": Applicability(
        floating=False,
        use="the published preconditioner: to see what it does; surface-uzawa where iterations count",
        matrix_free=False,
        keys=("gram", "relaxation"),
        contends=False,
    ),
    "uzawa": Applicability(floating=False, use="the classical iteration: simple, many cheap iterations", keys=UZAWA),
    "inexact-uzawa": Applicability(
        floating=False,
        use="uzawa for bodies too large to factorise: the same iterations, each a few of conjugate gradients",
        condensed=False,
        keys=UZAWA + INNER,
        contends=False,
    ),
    "nonlinear-uzawa": Applicability(
        floating=False,
        use="compliant faces: they belong to the bodies, friction alone is iterated; without it once is enough",
        matrix_free=False,
        keys=("outer_metric", "relaxation", "friction_update", *INNER),
        contends=False,
    ),
    "regularised": Applicability(
        floating=False,
        use="the baseline: penalty and smoothed friction in UFL, SNES on the whole volume; states its error",
        normal=("unilateral", "bilateral", "compliance"),
        friction=("coulomb", "tresca"),
        k_T=False,
        operators=(RIGID,),
        sliding=False,
        matrix_free=False,
        keys=("smoothing",),
    ),
    "perturbed-lagrangian": Applicability(
        floating=True,
        use="stiff springs at each contact node, Newton-Raphson: the published element; states its error",
        normal=("unilateral", "bilateral", "tied"),
        friction=("coulomb", "tresca", "stick"),
        matrix_free=False,
        keys=("omega_factor",),
        contends=False,
    ),
}
