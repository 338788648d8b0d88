"""One measurement of scaling: `mpirun -n 2 python -m stickslip.workflows.lab.benchmarks.scaling_run CASE` (JSON).

The ready scene `cube`, or a slab of it, by method tangent-cg: CPU seconds by phase and by part of an iteration, the
events of PETSc's log, calls of collectives, and peak memory; the largest of all ranks, and memory of each. Set
OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import cProfile
import ctypes
import gc
import json
import os
import pstats
import shutil
import subprocess
import sys
import time as clock
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from stickslip import Counters, Scene, read
from stickslip.geometry.arrays import Array
from stickslip.geometry.memory import peak
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.mesh.joints import find_parts
from stickslip.geometry.mesh.mesh import build_mesh, mesh_shape
from stickslip.solvers.fem.supports import find_constraints
from stickslip.solvers.interface.prepare import prepare_surface
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.simulation.plan import planned
from stickslip.solvers.stepping.method_chain import MethodChain
from stickslip.solvers.stepping.stepper import Stepper
from stickslip.solvers.system.system import assemble, contact_rows
from stickslip.solvers.tangent.coordinates import ContactCoordinates
from stickslip.workflows.lab.verification.prepared import march, pressed

SOURCE = """#include <mpi.h>
long stickslip_counted[4];  /* messages, their bytes, collectives, their bytes */
static void count(int at, long n, MPI_Datatype type) {
    int size;
    PMPI_Type_size(type, &size);
    stickslip_counted[at] += 1;
    stickslip_counted[at + 1] += n * size;
}
int MPI_Isend(const void *b, int n, MPI_Datatype t, int to, int tag, MPI_Comm c, MPI_Request *r) {
    count(0, n, t);
    return PMPI_Isend(b, n, t, to, tag, c, r);
}
int MPI_Send(const void *b, int n, MPI_Datatype t, int to, int tag, MPI_Comm c) {
    count(0, n, t);
    return PMPI_Send(b, n, t, to, tag, c);
}
int MPI_Allreduce(const void *b, void *to, int n, MPI_Datatype t, MPI_Op op, MPI_Comm c) {
    count(2, n, t);
    return PMPI_Allreduce(b, to, n, t, op, c);
}
int MPI_Allgather(const void *b, int n, MPI_Datatype t, void *to, int m, MPI_Datatype u, MPI_Comm c) {
    count(2, n, t);
    return PMPI_Allgather(b, n, t, to, m, u, c);
}
int MPI_Allgatherv(const void *b, int n, MPI_Datatype t, void *to, const int *m, const int *d, MPI_Datatype u,
                   MPI_Comm c) {
    count(2, n, t);
    return PMPI_Allgatherv(b, n, t, to, m, d, u, c);
}
int MPI_Bcast(void *b, int n, MPI_Datatype t, int from, MPI_Comm c) {
    count(2, n, t);
    return PMPI_Bcast(b, n, t, from, c);
}
"""
KEYS = ("messages", "bytes", "collectives", "collective_bytes")


def build(folder: Path) -> Path | None:
    """The library, compiled in a folder; None where there is no mpicc."""
    compiler = shutil.which("mpicc")
    if compiler is None:
        return None
    source, library = folder / "counted.c", folder / "counted.so"
    source.write_text(SOURCE)
    subprocess.run([compiler, "-O1", "-shared", "-fPIC", "-o", str(library), str(source)], check=True)
    return library


def counted() -> dict[str, int]:
    """Counts of this rank so far; zeros where the library is not loaded (LD_PRELOAD)."""
    try:
        values = (ctypes.c_long * len(KEYS)).in_dll(ctypes.CDLL(None), "stickslip_counted")
    except ValueError:
        return dict.fromkeys(KEYS, 0)
    return dict(zip(KEYS, values, strict=True))


OF_EVENT = {"count": "calls", "time": "seconds", "numMessages": "messages", "messageLength": "bytes"}  # PETSc's: ours


def logged(name: str) -> Array:
    """An event of PETSc's log, such as MatMult, so far on this rank, what it called included; by `OF_EVENT`."""
    found = PETSc.Log.Event(name).getPerfInfo()
    return np.array([float(found[key]) for key in OF_EVENT])


EVENTS = ("MatMult", "PCApply", "VecScatterBegin")
PARTS = {  # of an iteration, by the functions whose time they are, what these call included
    "product": (("operator.py", "product"),),
    "cycle": (("operator.py", "cycle"),),
    "columns": (("columns.py", "product"), ("columns.py", "block")),
    "contact": tuple(
        ("laws.py", name)
        for name in ("relax", "tangent", "residual", "apply", "inverse_blocks", "truncated", "project", "friction_work")
    ),
}
AT_CONTACT = {"assemble": "surface", "prepare": "coordinates"}  # phase: what of it is done at the contact
COLLECTIVES = ("allreduce", "allgather", "bcast")


@dataclass(frozen=True)
class Case:
    """The cube with n cells a side, or of it a slab of so many layers of cells; and how many steps of it are solved.

    Without steps it is drawn alone.
    """

    n: int
    layers: int = 0  # 0: as many as n
    steps: int = 2
    tolerance: float = 1e-8
    method: str = "tangent-cg"

    @property
    def shape(self) -> tuple[int, int, int]:
        """Cells along x, y and z."""
        return self.n, self.n, self.layers or self.n

    @property
    def unknowns(self) -> int:
        """Displacements, those of the supported side too."""
        x, y, z = self.shape
        return 3 * (x + 1) * (y + 1) * (z + 1)

    @property
    def points(self) -> int:
        """Contact points."""
        return (self.n + 1) ** 2

    def scene(self) -> Scene:
        """The ready scene `cube` with such cells; displacements are those of a slab of its height."""
        x, _, z = self.shape
        solver = f'solver={{ method = "{self.method}", surface = "matrix-free", tolerance = {self.tolerance!r} }}'
        return read("cube", [*pressed(3, x, height=z / x), solver, "output.error=false"])


def measure(case: Case) -> dict[str, Any]:
    """Mesh, assemble, prepare and solve; collective. The same on every rank.

    What is done at the contact is done a second time, to know its share.
    """
    comm = MPI.COMM_WORLD
    seconds: dict[str, float] = {}
    memory: dict[str, float] = {}
    PETSc.Log.begin()
    scene, counters = case.scene(), Counters()
    problem = planned(scene)
    memory["start"] = peak()
    began = clock.process_time()

    def done(phase: str) -> None:
        nonlocal began
        seconds[phase], memory[phase] = clock.process_time() - began, peak()
        comm.Barrier()
        began = clock.process_time()

    if comm.rank == 0:
        draw(problem)
    done("gmsh")
    if not case.steps:
        return {"case": asdict(case), "unknowns": case.unknowns, "seconds": seconds, "memory": comm.allgather(memory)}
    mesh = build_mesh(problem.shape, problem.request, comm)
    done("mesh")
    system = assemble(problem, mesh, counters)
    _ = system.K_B
    done("assemble")
    find_constraints(problem, mesh, system.space, system.nodes)
    contact_rows(problem, mesh, system.space, system.nodes, system.constraints)
    done("surface")
    stepper = Stepper(system, MethodChain(system, None, None))
    stepper.start()
    done("prepare")
    ContactCoordinates.of(system, prepare_surface(system, stepper.chain.volume))
    done("coordinates")
    for phase, part in AT_CONTACT.items():
        seconds[phase] -= seconds[part]
    profile, sent = cProfile.Profile(clock.process_time), counted()
    before = [logged(name) for name in EVENTS]
    cycles, iterations = counters.linear_iterations, []
    profile.enable()
    for accepted in islice(march(stepper), case.steps):
        iterations.append(accepted.iterations)
    profile.disable()
    found = [logged(name) - was for name, was in zip(EVENTS, before, strict=True)]
    own = {key: count - sent[key] for key, count in counted().items()}
    done("iterate")
    of_parts = parts(profile)
    return {
        "case": asdict(case),
        "ranks": comm.size,
        "unknowns": 3 * system.nodes.total,
        "points": case.points,
        "nonzeros": system.K_B.getInfo()["nz_used"],
        "iterations": iterations,
        "cycles": counters.linear_iterations - cycles,
        "seconds": {phase: comm.allreduce(value, MPI.MAX) for phase, value in seconds.items()},
        "parts": {part: comm.allreduce(value, MPI.MAX) for part, value in of_parts.items()},
        "calls": calls(profile),
        "sent": {key: reduced(value) for key, value in own.items()},
        "events": {
            name: dict(zip(OF_EVENT.values(), map(reduced, event.tolist()), strict=True))
            for name, event in zip(EVENTS, found, strict=True)
        },
        "memory": comm.allgather(memory),
        "objects": comm.allgather(size_of(stepper, accepted.state)),
    }


def reduced(value: float) -> tuple[float, float]:
    """Sum over all ranks, and the largest; collective."""
    return MPI.COMM_WORLD.allreduce(value), MPI.COMM_WORLD.allreduce(value, MPI.MAX)


def draw(problem: Problem) -> None:
    """Make on rank 0 alone the mesh in gmsh, and its parts. `build_mesh` does it again."""
    with gmsh_session() as gmsh:
        unit = mesh_shape(gmsh, problem.shape, problem.request)
        find_parts(gmsh, problem.request.dim, unit)


def parts(profile: cProfile.Profile) -> dict[str, float]:
    """CPU seconds [s] of each part of the iterations on this rank, and of all."""
    rows = statistics(profile)
    found = {part: sum(rows.get(function, (0, 0.0))[1] for function in of) for part, of in PARTS.items()}
    found["iterations"] = rows.get(("tangent_cg.py", "solve"), (0, 0.0))[1]
    return found


def calls(profile: cProfile.Profile) -> dict[str, int]:
    """Count the calls of mpi4py's collectives during the steps."""
    counts = dict.fromkeys(COLLECTIVES, 0)
    for (_, function), (count, _) in statistics(profile).items():
        for name in COLLECTIVES:
            if function.startswith(f"<method '{name}' of 'mpi4py.MPI"):
                counts[name] += count
    return counts


def statistics(profile: cProfile.Profile) -> dict[tuple[str, str], tuple[int, float]]:
    """Calls and seconds [s] by file's name and function; what it calls is included."""
    found: dict[tuple[str, str], tuple[int, float]] = {}
    rows = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    for (file, _, function), (_, count, _, seconds, _) in rows.items():
        key = os.path.basename(file), function
        before = found.get(key, (0, 0.0))
        found[key] = before[0] + count, before[1] + seconds
    return found


def size_of(*roots: object, seen: set[int] | None = None) -> int:
    """Bytes of all Python objects and numpy arrays that can be reached; what PETSc holds is not among them.

    Args:
        seen: identities of objects that are not counted; those that are counted are added.
    """
    waiting, total = list(roots), 0
    seen = set() if seen is None else seen
    while waiting:
        one = waiting.pop()
        if id(one) in seen or isinstance(one, type | ModuleType | FunctionType):
            continue
        seen.add(id(one))
        total += sys.getsizeof(one)
        waiting += gc.get_referents(one)
        if isinstance(one, np.ndarray) and one.base is not None:
            waiting.append(one.base)
    return total


def main() -> None:
    """Measure the case that the argument describes, and print the result in JSON."""
    found = measure(Case(**json.loads(sys.argv[1])))
    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps(found))


if __name__ == "__main__":
    main()
