"""What a method works with: yes, or refused with one line."""

from __future__ import annotations

from dataclasses import dataclass

RIGID = "rigid"  # the operator of a rigid obstacle


@dataclass(frozen=True, kw_only=True)
class Applicability:
    """What a method needs of a scene.

    Every method works in every model, with cells of every kind and order, and on any number of ranks.
    """

    floating: bool  # works while a body is held by contact and friction alone, or an obstacle is moved by a force
    normal: tuple[str, ...] | None = None  # names of the normal laws that it can do; None: all
    friction: tuple[str, ...] | None = None  # of the friction laws
    k_T: bool = True  # tangential stiffness before slip
    operators: tuple[str, ...] | None = None  # RIGID, and those between bodies
    sliding: bool = True  # contact that is looked for where the bodies have moved to
    matrix_free: bool = True  # meets the bodies through iterative solves too
    condensed: bool = True  # meets them through their dense stiffness too
    contends: bool = True  # for the best price, where a cost study is free to choose

    def knows(self, what: str, name: str) -> bool:
        """Whether one of its laws (`normal`, `friction`) or `operators` is one that it can do."""
        known: tuple[str, ...] | None = getattr(self, what)
        return known is None or name in known
