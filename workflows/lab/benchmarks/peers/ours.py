"""Our default on the meshes of the peers: `python -m stickslip.workflows.lab.benchmarks.peers.ours DIM N`.

Seconds of the processor for assembly, preparation and both steps, as of the peers; the unit of cost by the same clock;
and the forces to 1e-10, which are the measure of the peers' errors. Prints one line of JSON.
"""

from __future__ import annotations

import json
import os
import sys
import time as clock
from typing import Any

import stickslip
from stickslip.geometry.memory import peak
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.results.linear_reference import linear_reference
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.solvers.stepping.method_chain import MethodChain
from stickslip.solvers.stepping.stepper import Stepper
from stickslip.solvers.system.system import assemble
from stickslip.workflows.lab.benchmarks.peers.programs import OURS, TIMES
from stickslip.workflows.lab.benchmarks.price_run import GIGABYTE, Case

for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[threads] = "1"  # before numpy starts them

USUAL, EXACT = 1e-8, 1e-10  # tolerances of the seconds, and of the forces


def measure(dim: int, n: int) -> dict[str, Any]:
    """Seconds, memory, unit of cost, and forces of both steps."""
    usual = prepare(Case(dim, n, tolerance=USUAL).scene())  # forms are compiled
    seconds, memory = _seconds(usual), peak() / GIGABYTE
    fastest = linear_reference(usual.system).fastest
    unit = linear_reference(usual.system, fastest, now=clock.process_time).seconds
    steps = []
    for _, step in zip(TIMES, prepare(Case(dim, n, tolerance=EXACT).scene()).steps(), strict=False):
        base = step.contacts["base"]
        steps.append(
            {
                "iterations": step.iterations,
                "normal_force": base.normal_force,
                "tangential_force": base.tangential_force,
                "penetration": base.max_penetration,
            }
        )
    return {
        "program": OURS,
        "version": stickslip.__version__,
        "seconds": seconds,
        "memory": memory,
        "dofs": usual.system.constraints.free_total,
        "unit": unit,
        "steps": steps,
    }


def _seconds(prepared: Simulation) -> float:
    """Seconds of the processor for assembly, preparation and both steps, on the mesh of another simulation."""
    began = clock.process_time()
    system = assemble(prepared.problem, prepared.mesh, Counters())
    _ = system.K_B  # assembled too
    stepper = Stepper(system, MethodChain(system, None, None))
    state = stepper.start()
    for time in TIMES:
        state = stepper.reach(state, time, lambda row: None).state
    return clock.process_time() - began


if __name__ == "__main__":
    print(json.dumps(measure(int(sys.argv[1]), int(sys.argv[2]))))
