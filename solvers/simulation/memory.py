"""Memory of a run by part, predicted before it is taken; and what is left out or refused where it is short.

Each part is there in some stages of a run, and the peak is that of the stage in which most is there. What grows with
the mesh has a price by cell or unknown for each kind of cell, K and multigrid one by entry of K; the condensed form is
foretold by `Size.dense_bytes`. Fitted to the table of `stickslip.workflows.lab.benchmarks.memory`.

On several ranks the bodies are shared out; the program and a part of contact are on every rank.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from mpi4py import MPI

from stickslip.geometry.errors import MachineError
from stickslip.geometry.memory import available, resident
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.protocols import Comm
from stickslip.geometry.shape import MOST_CELLS
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Output
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.stepping.choice import Choice, Size, chosen, entries, mixed, slower

# of a run; at the end, of audit and pictures, multigrid is freed
STAGES = ("meshing", "assembling", "solving", "end")
PROGRAM = 1.5e8  # Python and libraries, on each rank
GMSH = 6e7  # its library, on rank 0, which keeps it
ENTRY = 12.5  # of K, by entry
WITH_PRESSURES = 4.0  # entries of the stiffness and of the mixed one, by those of a stiffness without averages
MULTIGRID = 19.0  # with its copy of K, by entry of K
POINT = 3900.0  # of contact, on each rank
OWN_POINT = 5500.0  # of the contact points that are a rank's share, beside that
VIEWERS = {2: 1.7e8, 3: 3.1e8}  # VTK and matplotlib, on rank 0, by dimension
ERRORS, PICTURES = "error estimate", "pictures"  # parts that a run can do without
SURE = 1.25  # the prediction is not refused before it is so many times what is free


@dataclass(frozen=True)
class Price:
    """Bytes by cell and by unknown of one kind of cell."""

    meshing: float  # by cell, in gmsh and dolfinx while the mesh is made, on rank 0
    mesh: float  # by cell, that stay
    steps: float  # by unknown: vectors of the step, of the state and of results
    errors: float  # by unknown: estimates of errors, beside the steps
    end: float  # by unknown: vectors and fields that the audit reads back
    nodes: float  # of a large mesh, by cell


PRICES = {
    ("triangle", 1): Price(1100, 960, 2000, 280, 2200, 0.5),
    ("triangle", 2): Price(1300, 1500, 1800, 2300, 1700, 2.0),
    ("quadrilateral", 1): Price(590, 600, 2000, 570, 1900, 1.0),
    ("quadrilateral", 2): Price(1900, 2300, 1600, 3100, 1300, 4.0),
    ("tetrahedron", 1): Price(590, 470, 2000, 2400, 2100, 0.18),
    ("tetrahedron", 2): Price(1400, 1500, 850, 2400, 1500, 1.4),
    ("hexahedron", 1): Price(1100, 960, 580, 2600, 1200, 1.0),
    ("hexahedron", 2): Price(3900, 6100, 200, 2100, 1500, 8.0),
}


SHAPES = {2: ("triangle", "quadrilateral"), 3: ("tetrahedron", "hexahedron")}  # by dimension: simplex, tensor


@dataclass(frozen=True)
class Part:
    """Part of a run that takes memory."""

    name: str
    rank: float  # on each rank [bytes]
    first: float  # on rank 0, beside that [bytes]
    stages: tuple[str, ...]  # in which it is there


@dataclass(frozen=True)
class Demand:
    """The memory that a run is foretold to take."""

    parts: tuple[Part, ...]
    unknowns: int
    ranks: int  # of one machine

    @property
    def stages(self) -> dict[str, float]:
        """Of rank 0, which takes most, by stage [bytes]."""
        return {s: sum(p.rank + p.first for p in self.parts if s in p.stages) for s in STAGES}

    @property
    def peak(self) -> float:
        """Of rank 0 [bytes]."""
        return max(self.stages.values())

    @property
    def machine(self) -> float:
        """Of all ranks of the machine that rank 0 is on [bytes]."""
        return max(sum(self.ranks * p.rank + p.first for p in self.parts if s in p.stages) for s in STAGES)

    def without(self, part: str) -> Demand:
        """The same without a part."""
        return replace(self, parts=tuple(each for each in self.parts if each.name != part))

    def plain(self, free: float) -> dict[str, object]:
        """As plain data, for `stickslip plan`; free: see `spare` [bytes]."""
        return {
            "parts": [
                {
                    "part": part.name,
                    "per_unknown": (part.rank + part.first) / self.unknowns,
                    "rank": part.rank + part.first,
                    "machine": self.ranks * part.rank + part.first,
                    "stages": list(part.stages),
                }
                for part in self.parts
            ],
            "stages": self.stages,
            "peak": self.peak,
            "machine": self.machine,
            "ranks": self.ranks,
            "free": free,
        }


@dataclass(frozen=True)
class Counts:
    """The mesh, as far as its memory goes."""

    shape: str  # of cells
    order: int
    cells: float
    processes: int = 1  # that share them

    @staticmethod
    def of(mesh: Mesh) -> Counts:
        """Of a mesh, on all ranks."""
        topology = mesh.domain.topology
        return Counts(topology.cell_type.name, mesh.degree, topology.index_map(mesh.dim).size_global, mesh.comm.size)


def memory_of(output: Output, counts: Counts, size: Size, choice: Choice) -> Demand:
    """Memory of a run with this output, mesh and method."""
    price, share = PRICES[counts.shape, counts.order], 1 / counts.processes
    form, cells, unknowns = choice.stages[0].surface, counts.cells, size.dofs
    multigrid = MULTIGRID * size.entries * share
    plain = size.dofs * entries((counts.shape, counts.order), 0.0)
    # condensed, the stiffness of averaged dilatations is never one matrix; but there is the one that is factorised
    stored = min(size.entries, WITH_PRESSURES * plain) if form == "condensed" else size.entries
    condensed = size.dense_bytes / size.ranks
    solver = {"matrix-free": ("multigrid", multigrid), "condensed": ("factor, dense stiffness", condensed)}
    after = ("assembling", "solving", "end")
    solving, until = ("solving",), ("solving", "end")  # a factor may serve another run: it stays
    parts = [
        Part("program", PROGRAM, GMSH, STAGES),
        Part("mesh while gmsh makes it", 0.0, price.meshing * cells, ("meshing",)),
        Part("mesh", price.mesh * cells * share, 0.0, after),
        Part("stiffness", ENTRY * stored * share, 0.0, after),
        Part(*solver.get(form, solver["condensed"]), 0.0, solving if form == "matrix-free" else until),
        Part("contact", (POINT + OWN_POINT * share) * size.contact_dofs / size.dim, 0.0, until),
        Part("steps and results", price.steps * unknowns * share, 0.0, solving),
    ]
    if stored > WITH_PRESSURES * plain:
        # twice the stiffness with averages
        parts.append(Part("averages of the dilatation", 2 * ENTRY * stored * share, 0.0, ("assembling",)))
    if output.error:
        parts.append(Part(ERRORS, price.errors * unknowns * share, 0.0, solving))
    parts.append(Part("results and audit", price.end * unknowns * share, 0.0, ("end",)))
    if output.pictures:
        parts.append(Part(PICTURES, 0.0, VIEWERS[size.dim], ("end",)))
    return Demand(tuple(parts), unknowns, size.ranks)


def foretold(scene: Scene) -> dict[str, object] | None:
    """Predict the memory of a run by the number of cells that its geometry expects; see `Demand.plain`.

    A body is taken for a cube with contact on one side, and all bodies for equally large. None where the number is not
    known; collective.
    """
    problem = resolve(scene)
    cells, order, dim = float(problem.shape.cell_count(problem.request)), problem.shape.degree, problem.dim
    if not 0 < cells < MOST_CELLS:
        return None
    kind = SHAPES[dim][getattr(problem.shape, "cells", "simplex") == "tensor"], order
    nodes, comm = cells * PRICES[kind].nodes, MPI.COMM_WORLD
    dofs, touching = max(1, round(dim * nodes)), round(dim * nodes ** (1 - 1 / dim))
    machine = comm.Split_type(MPI.COMM_TYPE_SHARED)
    ranks = comm.allreduce(machine.size, op=MPI.MAX)
    machine.Free()
    averaged = len(problem.averaged) / len(problem.bodies)
    size = Size(
        dim,
        dofs,
        dofs * entries(kind, averaged),
        touching,
        len(problem.timeline.times),
        ranks=ranks,
        slower=slower(problem),
        mixed=mixed(kind, averaged),
    )
    choice = chosen(size, problem.solver, least_available(comm))
    return memory_of(scene.output, Counts(*kind, cells, comm.size), size, choice).plain(spare(comm))


def least_available(comm: Comm) -> float:
    """Memory that each rank may take without knowing of the others [bytes], the least of all ranks; collective."""
    return float(comm.allreduce(float(available()), op=MPI.MIN))


def spare(comm: Comm) -> float:
    """Memory that the ranks of a machine have and may take together [bytes], the least of all machines; collective."""
    machine = comm.Split_type(MPI.COMM_TYPE_SHARED)
    total = float(machine.allreduce(resident())) + float(machine.allreduce(available(), op=MPI.MIN))
    machine.Free()
    return float(comm.allreduce(total, op=MPI.MIN))


def affordable(output: Output, demand: Demand, free: float, steered: bool) -> tuple[Output, str]:
    """The output of a run, without errors where memory is too short for them; and a warning where it is short.

    Args:
        output: that the scene asks for.
        demand: of the run.
        free: see `spare` [bytes].
        steered: whether the errors decide how the run goes on.

    Raises:
        MachineError: it does not fit without them either.
    """
    if demand.machine <= free:
        return output, ""
    needs = f"about {demand.machine / 1e9:.2g} GB of memory are needed, and {free / 1e9:.2g} GB are free"
    least = demand if steered else demand.without(ERRORS)
    if output.error and least.machine <= SURE * free and not steered:
        return replace(
            output, error=False
        ), f"{needs}: errors are not estimated; to estimate them take more memory or a larger mesh_size"
    if demand.machine <= SURE * free:
        return output, f"{needs}: the run may be ended by the system"
    pictures = "output.pictures = false, " * (least.without(PICTURES).machine <= SURE * free)
    raise MachineError(f"{needs}; use {pictures}a larger mesh_size, or more machines")
