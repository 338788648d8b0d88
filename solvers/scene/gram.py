"""The Gram matrix that preconditions `gram-uzawa`: its basis, its factorisation, and the unknown it acts on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key, Noun


@dataclass(frozen=True, kw_only=True)
class Gram(Noun):
    """H1 Gram matrix of finite element basis functions, and its Cholesky factor."""

    space: Annotated[
        Literal["volume", "multiplier"],
        Key("-", "basis: of displacements, Q^-1 from the factor's block of contact dofs; or of tractions, Q"),
    ] = "volume"
    factor: Annotated[
        Literal["complete", "drop", "ic0"], Key("-", "complete, with a drop tolerance, or in the matrix's own pattern")
    ] = "complete"
    drop: Annotated[float, Key("-", "for factor = drop: tolerance, relative to the norm of a column")] = 1e-3
    unknown: Annotated[Literal["forces", "tractions"], Key("-", "unknown that it is the metric of")] = "forces"
    length: Annotated[
        float | None,
        Key("m", "l in the product, integral of grad u : grad v + u . v / l^2; absent: the bodies' extent"),
    ] = None

    def __post_init__(self) -> None:
        require(0 < self.drop < 1, "drop", self.drop, "must lie between 0 and 1, for example 1e-3")
        require(self.length is None or self.length > 0, "length", self.length, "must be positive")
