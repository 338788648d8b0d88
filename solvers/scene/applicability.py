"""Which method works with what: yes, or refused with one line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

RIGID = "rigid"  # the operator of a rigid obstacle


@dataclass(frozen=True, kw_only=True)
class Applicability:
    """What a method needs of a scene; when to use it stands in README.

    All of them work in every model, with cells of every kind and order, and on any number of ranks.
    """

    floating: bool  # works while a body is held by contact and friction alone, or an obstacle is moved by a force
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
        floating=True,
    ),
    "condensed-newton": Applicability(floating=True, matrix_free=False),
    "surface-uzawa": Applicability(
        floating=True,
    ),
    "gram-uzawa": Applicability(
        floating=False,
        matrix_free=False,
        keys=("gram", "relaxation"),
        contends=False,
    ),
    "uzawa": Applicability(floating=False, keys=UZAWA),
    "inexact-uzawa": Applicability(
        floating=False,
        condensed=False,
        keys=UZAWA + INNER,
        contends=False,
    ),
    "nonlinear-uzawa": Applicability(
        floating=False,
        matrix_free=False,
        keys=("outer_metric", "relaxation", "friction_update", *INNER),
        contends=False,
    ),
    "regularised": Applicability(
        floating=False,
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
        normal=("unilateral", "bilateral", "tied"),
        friction=("coulomb", "tresca", "stick"),
        matrix_free=False,
        keys=("omega_factor",),
        contends=False,
    ),
}
