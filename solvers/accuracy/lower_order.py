"""Error of the mesh of what an edge of contact decides, order 2 in 3D: the same steps on the same cells with order 1.

What order 2 adds to order 1 is the error of order 1. At an edge of contact order 2 is hardly better: stated is ROUGH
times the difference for areas, largest pressures and penetrations. Of all other numbers the error is known already from
bubbles of order 3, see `next_order`; where a step with these was not solved, SHARE of the difference is stated. It
tells how large the error is, no more. A largest pressure that grows without end with order 1 has no limit, see `peaks`.
The part of curved sides is in it; that of the geometry is zero.

Difference / true error against order 2 on meshes two to three times finer, `circular_drive`, `hertz_3d`, `cube`,
`half_ball` on three meshes each, 354 errors above 1e-3 of the scale of their kind, quartiles: moments 2.7 to 4, forces
6.4 to 9, energies 5.2 to 12, dissipation 3.6 to 17, areas .7 to 2.1, pressures .6 to 3.2. The history of order 1 has an
eighth of the unknowns.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from stickslip.geometry.arrays import LAST_DIGITS
from stickslip.geometry.errors import StickslipError
from stickslip.geometry.nested_mesh import CornerMesh
from stickslip.solvers.accuracy.mesh_error import at_points, without_limit
from stickslip.solvers.accuracy.next_order import AT_THE_EDGE
from stickslip.solvers.accuracy.other_mesh import OtherMeshRun, on_other_mesh, sides_of
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.step_result import ErrorParts, Errors, Quantity, StepResult, quantities
from stickslip.solvers.stepping.stepper import Stepper

log = logging.getLogger(__name__)
SHARE, ROUGH = 0.33, 1.5


class LowerOrderRun(OtherMeshRun):
    """Order 2 in 3D: the same cells with order 1."""

    DIM = 3

    def __call__(self, steps: Sequence[StepResult]) -> tuple[Errors, ...]:
        own, counters, found = self._stepper.system, Counters(), list[Errors]()
        log.info("the same history with cells of order 1, for the error of the mesh")
        mesh = own.mesh.comm.bcast(self._of_order_1())
        try:
            stepper = on_other_mesh(own, mesh, counters)
            observe, state = Observer.of(stepper), stepper.start()
            for step in steps:
                if step.substeps > 1:
                    break
                with stepper.chain.repeating(stepper.system):
                    accepted = stepper.reach(state, step.time, self._on_iteration)
                found.append(_errors(stepper, step, observe(accepted)))
                state = accepted.state
        except StickslipError as error:
            log.info("no error of the mesh from there on: %s", error)
        own.counters.error_solves += counters.volume_solves + counters.error_solves
        return tuple(found)

    def _of_order_1(self) -> CornerMesh | None:
        """The cells of the run with their corners alone, on rank 0; collective."""
        data, sides = self._data, sides_of(self._stepper.system)
        if self._stepper.system.mesh.comm.rank:
            return None
        return CornerMesh(
            kind=data.shape, points=data.points, cells=data.cells, body=data.body, names=data.bodies, sides=sides
        )


def _errors(stepper: Stepper, step: StepResult, coarser: StepResult) -> Errors:
    """Errors of the numbers of a step.

    Args:
        stepper: of order 1.
        coarser: the step with order 1.
    """
    of_order_1, errors = quantities(coarser), dict[Quantity, ErrorParts]()
    for key, value in quantities(step).items():
        known = step.errors.get(str(key))
        if key.quantity != "stress" and (known is None or known.mesh is None):
            part = ROUGH if key.quantity in AT_THE_EDGE else SHARE
            off = part * np.abs(value - of_order_1[key])
            errors[key] = ErrorParts(mesh=off, geometry=0.0 * off, converges=True)
    for c in stepper.system.contacts:
        errors |= without_limit(c, coarser.contacts[c.name], LAST_DIGITS * stepper.system.extent)
    return errors | at_points(stepper.system.problem, of_order_1)
