"""One measurement of the price: `python -m stickslip.workflows.lab.benchmarks.price_run CASE [SOLVER]`, CASE in JSON.

With SOLVER only this solver is tried for the linear reference, so that the memory is that of the fastest one; with the
word `peers` it is what is laid beside other programs. Prints one line of JSON.
"""

from __future__ import annotations

import json
import os
import statistics
import sys
import time as clock
from dataclasses import asdict, dataclass, replace
from itertools import islice
from typing import Any

from mpi4py import MPI

import stickslip
from stickslip import Counters, Scene, Simulation, StickslipError, prepare, read
from stickslip.geometry.memory import peak
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.solvers.linear.multigrid import HYPRE
from stickslip.solvers.parallel.counters import Clock
from stickslip.solvers.results.linear_reference import linear_reference
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.stepping.method_chain import MethodChain
from stickslip.solvers.stepping.stepper import Stepper
from stickslip.solvers.system.system import assemble
from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.lab.verification.prepared import march, pressed

os.environ.update(ONE_THREAD)  # before the first operation that would start them

COUNTED = "cg+boomeramg" if HYPRE else "cg+gamg"  # solver whose iterations are the unit of those of a method
REFERENCE = "linear reference"  # the method that solves no contact at all
OURS, PEERS = "stickslip", "peers"  # the name of this program among the others, and what asks for them
EXACT = 1e-10  # tolerance of the forces that are the measure of the peers' errors
GIGABYTE = 1e9  # bytes
LEAST = 2.0  # [s] that repetitions may fill


@dataclass(frozen=True)
class Case:
    """Press, shift, and a further shift of a block (dim 2) or a cube (dim 3), n cells over the height.

    On a rigid plane; or, with two bodies, of a cube on another one whose mesh does not match.
    """

    dim: int
    n: int
    method: str = "auto"
    surface: str = "auto"
    tolerance: float = 1e-8
    cells: str = "tensor"
    bodies: int = 1

    @property
    def name(self) -> str:
        words = f"{self.dim}d_{self.n:03d}_{self.method}_{self.surface}_{self.tolerance:g}_{self.cells}"
        return words.replace(" ", "_") + (f"_{self.bodies}_bodies" if self.bodies > 1 else "")

    def scene(self) -> Scene:
        """The ready scene `block`, `cube` or `two_blocks` with a third step."""
        method = "auto" if self.method == REFERENCE else self.method
        settings = [
            *pressed(self.dim, self.n, further=True),
            *(cubes(self.n) if self.bodies == 2 else []),
            f'geometry.cells="{self.cells}"',
            f'solver={{ method = "{method}", surface = "{self.surface}", tolerance = {self.tolerance!r} }}',
            "output.error=false",  # its own price is in docs/accuracy.md
        ]
        return read("two_blocks" if self.bodies == 2 else "block" if self.dim == 2 else "cube", settings)


def cubes(n: int) -> list[str]:
    """Settings that make `two_blocks` a cube on a cube, with n and n - 1 cells over the height."""
    sizes = f"length=1.0, width=1.0, height=1.0, mesh_size={1 / n!r}, lower_mesh_size={1 / (n - 1)!r}"
    return [
        "model=3d",
        f'geometry={{ builder = "two_blocks", {sizes} }}',
        "supports.base.displacement={ x = 0.0, y = 0.0, z = 0.0 }",
    ]


def measure(case: Case, only: str = "") -> dict[str, Any]:
    """CPU seconds by phase and step, counters, residuals, peak memory; the linear reference in the same process.

    Short runs are repeated, each with its own reference; the first pair runs with cold caches.
    """
    found = _solve(case, only)
    if case.method == REFERENCE or found["status"] != "converged":
        return found | dict.fromkeys(("two_steps", "further", "price", "further_price", "reference_seconds"))
    rows = [_prices(found)]
    while sum(row["two_steps"] for row in rows) < LEAST:
        rows.append(_prices(_solve(case)))
    return found | {key: statistics.median(row[key] for row in rows) for key in rows[0]} | {"repeated": len(rows)}


def _prices(found: dict[str, Any]) -> dict[str, float]:
    """Seconds of the two-step problem, of a further step and of the reference beside them, and their ratios."""
    seconds, reference = [step["seconds"] for step in found["steps"]], found["reference"]["seconds"]
    two_steps, further = found["prepare"] + sum(seconds[:2]), sum(seconds[2:])
    return {
        "two_steps": two_steps,
        "further": further,
        "price": two_steps / reference,
        "further_price": further / reference,
        "reference_seconds": reference,
    }


def _solve(case: Case, only: str = "") -> dict[str, Any]:
    scene, counters, status = case.scene(), Counters(), "converged"
    counters.clock = Clock(now=clock.process_time)  # others may use the machine
    steps: list[dict[str, Any]] = []
    if case.method == REFERENCE:
        mesh = build_mesh(scene.geometry, scene.request(), MPI.COMM_WORLD)
        system, prepared = assemble(resolve(scene), mesh, counters), 0.0
    else:
        simulation = prepare(scene, counters=counters)
        system, prepared = simulation.system, simulation.seconds.prepare
        steps, status = _timed(simulation.stepper)
    memory = peak() / GIGABYTE  # before the reference
    reference = linear_reference(system, only, now=clock.process_time)
    own = (
        linear_reference(system, COUNTED, case.tolerance) if any(step["linear_iterations"] for step in steps) else None
    )
    if case.method == REFERENCE:
        memory = peak() / GIGABYTE
    return {
        "case": asdict(case),
        "status": status,
        "dofs": system.constraints.free_total,
        "contact_dofs": len(system.interface.dofs),
        "prepare": prepared,
        "steps": steps,
        "memory": memory,
        "reference": asdict(reference),
        "own": asdict(own) if own else None,
        "counters": asdict(counters),
    }


def _timed(stepper: Stepper) -> tuple[list[dict[str, Any]], str]:
    """CPU seconds of each step, and how the run ended; no results: the price is that of the solution alone."""
    found, counters = list[dict[str, Any]](), stepper.system.counters
    began, linear = clock.process_time(), counters.linear_iterations
    try:
        for accepted in march(stepper):
            found.append(
                {key: getattr(accepted, key) for key in ("iterations", "volume_solves", "residual")}
                | {"seconds": clock.process_time() - began, "linear_iterations": counters.linear_iterations - linear}
            )
            began, linear = clock.process_time(), counters.linear_iterations
    except StickslipError as error:
        return found, str(error)
    return found, "converged"


def beside_peers(case: Case) -> dict[str, Any]:
    """Seconds, memory, unit of cost, and forces of the first two steps, as other programs are measured.

    Seconds are of the processor, for assembly, preparation and both steps; the unit is by the same clock.
    """
    usual = prepare(case.scene())  # forms are compiled
    seconds, memory = _whole_seconds(usual), peak() / GIGABYTE
    fastest = linear_reference(usual.system).fastest
    unit = linear_reference(usual.system, fastest, now=clock.process_time).seconds
    keys = {"normal_force": "normal_force", "tangential_force": "tangential_force", "penetration": "max_penetration"}
    exact = prepare(replace(case, tolerance=EXACT).scene()).steps()
    steps = [
        {"iterations": step.iterations} | {key: getattr(step.contacts["base"], own) for key, own in keys.items()}
        for step in islice(exact, 2)
    ]
    return {
        "program": OURS,
        "version": stickslip.__version__,
        "seconds": seconds,
        "memory": memory,
        "dofs": usual.system.constraints.free_total,
        "unit": unit,
        "steps": steps,
    }


def _whole_seconds(prepared: Simulation) -> float:
    """Seconds of the processor for assembly, preparation and both steps, on the mesh of another simulation."""
    began = clock.process_time()
    system = assemble(prepared.problem, prepared.mesh, Counters())
    _ = system.K_B  # assembled too
    list(islice(march(Stepper(system, MethodChain(system, None, None))), 2))
    return clock.process_time() - began


def main(case: str, only: str = "") -> None:
    """Measure the case that the arguments describe, and print the result in JSON."""
    asked = Case(**json.loads(case))
    print(json.dumps(beside_peers(asked) if only == PEERS else measure(asked, only)))


if __name__ == "__main__":
    main(*sys.argv[1:])
