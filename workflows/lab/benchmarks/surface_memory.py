"""Bytes that each rank holds for a contact point, object by object: `mpirun -n 2 python -m` this module, with N LAYERS.

The slab of `scaling_run`, to the end of its steps. Held are numpy arrays and Python's objects,
each under the first name that reaches it; the tops of phases are what they need on the way, by tracemalloc. Both count
bytes and are firm; what PETSc holds is not among them.
"""

from __future__ import annotations

import gc
import sys
import tracemalloc
from typing import Annotated

import typer
from mpi4py import MPI

from stickslip.geometry.memory import peak
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.simulation.plan import planned
from stickslip.solvers.stepping.method_chain import MethodChain
from stickslip.solvers.stepping.stepper import Stepper
from stickslip.solvers.system.system import assemble
from stickslip.workflows.lab.benchmarks.scaling_run import Case, size_of

ROWS = "  {:24} {}"


def measure(case: Case) -> tuple[dict[str, int], dict[str, float]]:
    """Bytes that this rank holds by object, and the tops of phases above what was held before; collective."""
    comm, tops = MPI.COMM_WORLD, dict[str, float]()
    tracemalloc.start()

    def done(phase: str) -> None:
        now, top = tracemalloc.get_traced_memory()
        tops[phase], tops[f"{phase}, held"] = top, now
        comm.Barrier()
        gc.collect()
        tracemalloc.reset_peak()

    problem = planned(case.scene())
    mesh = build_mesh(problem.shape, problem.request, comm)
    done("mesh")
    system = assemble(problem, mesh, Counters())
    done("assemble")
    _ = system.K_B
    done("stiffness")
    stepper = Stepper(system, MethodChain(system, None, None))
    state = stepper.start()
    done("prepare")
    for time in problem.timeline.times[: case.steps]:
        accepted = stepper.reach(state, time, lambda row: None)
        state = accepted.state
    done("steps")
    tracemalloc.stop()
    seen = set[int]()
    held = {"volume": size_of(mesh, system.nodes, system.weak, system.problem, sys.modules, seen=seen)}
    roots = {
        "sides": [c.surface for c in system.contacts],
        "rows": system.contacts,
        "constraints": system.constraints,
        "interface": system.interface,
        "system, other": system,
        "coordinates": [getattr(one, "coordinates", None) for one in stepper.chain._ready.values()],
        "operator N, W, R": [stepper.surface.N, stepper.surface.W, stepper.surface.R],
        "surface, volume": [stepper.surface, stepper.chain.volume],
        "coarse mesh": stepper.chain.coarse,
        "method": stepper.chain._ready,
        "stepper": stepper,
        "step": accepted.problem,
        "state": [state, accepted],
    }
    for name, root in roots.items():
        held[name] = size_of(root, seen=seen)
    return held, tops


def main(
    n: Annotated[int, typer.Argument(help="cells along x and y")] = 128,
    layers: Annotated[int, typer.Argument(help="cells along z")] = 2,
    method: Annotated[str, typer.Option(help="with the bodies in matrix-free form")] = "tangent-cg",
) -> None:
    """Print bytes by contact point of each rank."""
    comm, case = MPI.COMM_WORLD, Case(n, layers, method=method)
    held, tops = measure(case)
    tops["peak of the process"] = peak()
    found = comm.gather((held, tops))
    if found is None:
        return
    for kind, title in enumerate(("held", "tops of phases")):
        print(f"{title} [bytes by contact point], {case.points} points, {comm.size} ranks")
        for name in found[0][kind]:
            values = " ".join(f"{one[kind][name] / case.points:9.0f}" for one in found)
            print(ROWS.format(name, values))


if __name__ == "__main__":
    typer.run(main)
