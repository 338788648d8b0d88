"""Which scenes a method can solve; a scene that it cannot solve is refused with one line."""

from __future__ import annotations

from dataclasses import dataclass

RIGID = "rigid"  # the operator of a rigid obstacle


@dataclass(frozen=True, kw_only=True)
class Applicability:
    """What a method supports.

    Every method works in every model, with cells of every kind and order, with pairs that are searched again, and on
    any number of ranks.
    """

    floating: bool  # bodies that only contact and friction hold, and obstacles that a force moves
    driven: bool = True  # the latter, if the former
    bedded: bool = False  # floating bodies, if compliant contact alone resists their rigid modes
    normal: tuple[str, ...] | None = None  # names of the supported normal laws; None: all
    friction: tuple[str, ...] | None = None  # names of the supported friction laws; None: all
    k_T: bool = True  # tangential stiffness before slip
    operators: tuple[str, ...] | None = None  # supported contact operators: RIGID, and those between bodies; None: all
    matrix_free: bool = True  # bodies in matrix-free form: iterative volume solves
    condensed: bool = True  # bodies in condensed form: a dense stiffness of the contact dofs; in neither form: sparse
    contends: bool = True  # whether a cost study that may choose the method tries this one

    def knows(self, what: str, name: str) -> bool:
        """Whether the method supports a law or an operator.

        Args:
            what: `normal`, `friction` or `operators`.
            name: name of the law or of the operator.
        """
        known: tuple[str, ...] | None = getattr(self, what)
        return known is None or name in known
