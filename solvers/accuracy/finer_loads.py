"""What the quadrature of the run leaves out of loads that are expressions of place: features narrower than a facet."""

from __future__ import annotations

from dataclasses import dataclass

from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.protocols import Vec
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.system.applied_loads import AppliedLoads
from stickslip.solvers.system.system import System, applied_loads

# degree of the quadrature by dimension: along an edge 10 points and 6, where the run has 4 at order 1
DENSE = {2: 18, 3: 10}


def beyond(mesh: Mesh) -> int:
    """That degree beyond twice the order."""
    return DENSE[mesh.dim] - 2 * mesh.degree


@dataclass(frozen=True)
class FinerLoads:
    """The loads of a system with denser quadrature."""

    system: System
    loads: AppliedLoads

    @classmethod
    def of(cls, system: System) -> FinerLoads | None:
        """Compile the forms; None: no load is an expression of place; collective."""
        places = system.problem.timeline.expressions.items()
        if not any(place.table != "supports" and found.names & {*"xyz"} for place, found in places):
            return None
        weak = WeakForms(system.problem, system.mesh, system.space, system.counters, smooth=beyond(system.mesh))
        return cls(system, applied_loads(system.problem, weak, system.constraints, system.vector()))

    def added(self, time: float) -> Vec:
        """Forces [N] that the loads of the run lack at a time [s]; collective."""
        total = self.system.vector()
        self.loads.add_to(total, self.system.course, time)
        return total - self.system.load(time)
