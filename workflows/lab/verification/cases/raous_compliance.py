"""The block of Raous on a compliant face, c_n = k_T = k E / SIDE: the larger k, the smaller the shift of its corner."""

from functools import lru_cache

import numpy as np

from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.lab.verification.cases import raous
from stickslip.workflows.lab.verification.cases import raous as raous_case
from stickslip.workflows.lab.verification.check import Case, Check
from stickslip.workflows.lab.verification.prepared import prepare

SLOW = ("surface-uzawa",)  # methods that take more than some seconds
N = 64  # cells a side: with half of them, where the face opens moves the shift at k = 1000 by half of it
RIGID = 1e8  # k whose own shift is 4e-9
UZAWA_UP_TO = 100  # its iterations grow as k: 743 and 5719 at k = 10 and 100


@lru_cache
def solve(method: str, k: float, mu: float = raous.MU) -> tuple[StepResult, float]:
    """The only step, and its u_x at x = 0 [m]."""
    simulation = prepare(raous_case.scene(method, mu=mu, n=N, k=k))
    (step,) = simulation.steps()
    corner = np.argmin(simulation.data.surfaces["base"][0][:, 0])
    return step, float(step.contacts["base"].slip[corner, 0])


def checks(method: str, mu: float = raous.MU) -> list[Check]:
    """Against the limit of the same law on the same mesh; with another mu than 1 all must fail."""
    limit = solve("condensed-newton", RIGID)[1]
    return [
        Check(
            f"shift of u_x at x = 0, k = {at.k:g}",
            solve(method, at.k, mu)[1] / limit - 1,
            at.shift,
            at.tolerance,
            False,
        )
        for at in raous.COMPLIANCE_SHIFTS
        if method != "uzawa" or at.k <= UZAWA_UP_TO
    ]


CASE = Case(about="the same block, its face compliant: the shift", checks=checks)
