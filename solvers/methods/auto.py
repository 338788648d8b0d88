"""Auto: tries the methods of a chain one after the other until one solves the step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from stickslip.solvers.methods.method import Applicability, Method, Ready, Setup


@dataclass(frozen=True, kw_only=True)
class Auto(Method):
    """Name of the chain that `solvers/stepping/choice.py` builds from the TURNS of all methods; it has no solver."""

    NAME: ClassVar = "auto"
    WHEN: ClassVar = (
        "the default: by size and number of steps, condensed-newton, or without a dense matrix tangent-cg (3D) or "
        "surface-uzawa; "
        "goes on with a safer method when one stalls"
    )
    WORKS_WITH: ClassVar = Applicability(floating=True, worn=True)
    ROW: ClassVar = 0

    def build(self, setup: Setup) -> Ready:
        raise NotImplementedError("auto is replaced by the methods of its chain")
