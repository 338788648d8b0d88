"""Which methods are tried, with which form of the bodies: chosen by dimension, size and memory, never by timing."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI

from stickslip.geometry.arrays import ROUNDING
from stickslip.geometry.errors import MachineError
from stickslip.geometry.memory import available
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.surfaces.surface import SECTOR
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.fem.constraints import Constraints
from stickslip.solvers.interface.prepare import Form
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.scene.material import LEAST
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.settings import Solver
from stickslip.solvers.system.system import System

ENTRIES = {  # non-zero entries of a row of K_B, inside a regular mesh
    ("triangle", 1): 14, ("triangle", 2): 23, ("quadrilateral", 1): 18, ("quadrilateral", 2): 32,
    ("tetrahedron", 1): 44, ("tetrahedron", 2): 84, ("hexahedron", 1): 81, ("hexahedron", 2): 192,
}  # fmt: skip
AVERAGED = {  # the same where the dilatation is averaged, see `MeanDilatation`
    ("triangle", 1): 120, ("triangle", 2): 94, ("quadrilateral", 1): 158, ("quadrilateral", 2): 126,
    ("tetrahedron", 1): 800, ("tetrahedron", 2): 571, ("hexahedron", 1): 1526, ("hexahedron", 2): 1149,
}  # fmt: skip
MIXED = {(2, 1): 5.0, (2, 2): 1.5, (3, 1): 3.0, (3, 2): 1.25}  # then, of a factor: times the seconds and the entries
# CPU seconds on one core, one thread, fitted to the table of `stickslip.workflows.lab.benchmarks.auto`
POWER = {2: 1.1, 3: 2.0}  # of N, free dofs, that the time of a factorisation grows with
FACTOR_TIME = {2: 1.1e-6, 3: 2.7e-9}  # of a factorisation with its Schur complement, times that power of N
BACK = {2: 8e-7, 3: 2e-6}  # of a step's solves with the factor, times N
INVERSE = 6e-11  # of the inverse of the dense stiffness, times the cube of the number of contact dofs
SET_UP = 6e-8  # of multigrid, for each entry of K_B
PER_ENTRY = 1e-8  # of one iteration of conjugate gradients, for each entry of K_B: products and a multigrid cycle
PER_CONTACT_DOF = 2e-6  # of what is done on the surface beside it, for each contact dof
# Of conjugate gradients that a step takes, measured 40 to 75 and 20 to 50, and 9 to 31 with little else beside them;
# where points close 26 to 41 that cost twice as much, and half of that again for where they touch
ITERATIONS = {
    (2, "surface-uzawa"): 60, (3, "surface-uzawa"): 40, (3, "tangent-cg"): 15, (3, "tangent-cg, closing"): 120,
}  # fmt: skip
FACTOR = {2: 40.0, 3: 60.0}  # entries of a factor, to be multiplied by N and N^(4/3)
NEEDS = ("floating", "driven", "rates", "worn")  # fields of `Size` that a method may not work with
SHARE = 0.7  # of the available memory that the condensed form may take


@dataclass(frozen=True)
class Stage:
    """One method with one form of the bodies."""

    method: str
    surface: Form
    safe: bool = False  # with a metric that overestimates the bodies' flexibility: shorter steps

    def __str__(self) -> str:
        return f"{self.method} ({self.surface}{', safer metric' if self.safe else ''})"


@dataclass(frozen=True)
class Size:
    """Size of a problem."""

    dim: int
    dofs: int
    entries: float  # approximate number of non-zero entries of K_B
    contact_dofs: int
    steps: int = 2  # requested times
    slender: float = 1.0  # length over thickness of the most slender body that floats
    ranks: int = 1  # that share a machine's memory
    floating: bool = False  # whether contact or forces alone hold a body or an obstacle
    driven: bool = False  # whether a force moves an obstacle
    rates: bool = False  # whether friction depends on the slip rate
    clock: bool = False  # whether steps follow slip rates, by the flexibility of each contact dof
    worn: bool = False  # whether a contact slides out of the plane, or wears
    closing: bool = False  # whether points of contact are open before the first step
    slower: float = 1.0  # iterations of conjugate gradients, relative to those of bodies that are easy to compress
    mixed: float = 1.0  # seconds and entries of a factor, likewise
    parts: tuple[tuple[float, float], ...] = ()  # dofs and contact dofs of bodies that share no node; (): of all

    @staticmethod
    def of(problem: Problem, mesh: Mesh, constraints: Constraints, contacts: tuple[ContactRows, ...]) -> Size:
        """Size from what is known before assembly; collective."""
        dofs = constraints.free_total
        nodes = np.unique(np.concatenate([np.zeros(0, np.int64), *(c.nodes % SECTOR for c in contacts)]))
        kind = mesh.domain.topology.cell_type.name, mesh.degree
        averaged, (low, high) = _averaged(problem, mesh), mesh.box()
        machine = mesh.comm.Split_type(MPI.COMM_TYPE_SHARED)
        ranks = mesh.comm.allreduce(machine.size, op=MPI.MAX)
        machine.Free()
        return Size(
            dim=mesh.dim,
            dofs=dofs,
            entries=dofs * entries(kind, averaged),
            contact_dofs=mesh.dim * len(nodes),
            steps=len(problem.timeline.times),
            slender=max([1.0, *(_slenderness(mesh, body) for body in _floating(problem))]),
            ranks=ranks,
            floating=bool(problem.rigid_modes.shape[1] or problem.driven),
            driven=bool(problem.driven),
            rates=any(c.friction is not None and c.friction.drags for c in contacts),
            clock=problem.timeline.clock is not None,
            worn=any(c.wears or c.slides for c in contacts),
            closing=any((c.gap > ROUNDING * np.max(high - low)).any() for c in contacts),
            slower=slower(problem),
            mixed=mixed(kind, averaged),
            parts=_parts(mesh, dofs, contacts) if mesh.comm.size == 1 and mesh.part_count > 1 else (),
        )

    def times(self, unknowns: float, on_sides: float | None = None) -> Size:
        """A size with so many times the unknowns, and so many on contact sides; None: as many along a line.

        >>> found = Size(dim=2, dofs=400, entries=4000, contact_dofs=40).times(0.25)
        >>> found.dofs, found.entries, found.contact_dofs
        (100, 1000.0, 20)
        """
        on_sides = unknowns ** (1 - 1 / self.dim) if on_sides is None else on_sides
        return replace(
            self,
            dofs=round(unknowns * self.dofs),
            entries=unknowns * self.entries,
            contact_dofs=round(on_sides * self.contact_dofs),
            parts=tuple((unknowns * n, on_sides * c) for n, c in self.parts),
        )

    @property
    def condensed_seconds(self) -> float:
        """Predicted time [s] on one core of preparation and all steps, with the bodies in condensed form."""
        factor = self.mixed * FACTOR_TIME[self.dim]
        prepared = sum(factor * n ** POWER[self.dim] + INVERSE * c**3 for n, c in self._each)
        # of a step: few systems of few rows, or many of many
        newton = INVERSE * self._rows**3 if self.closing else INVERSE / 10 * float(self.contact_dofs) ** 3
        return float(prepared + self.steps * (BACK[self.dim] * self.dofs + newton))

    def matrix_free_seconds(self, method: str) -> float:
        """The same with the bodies in matrix-free form, by a method."""
        kinds = [method + ", closing", method, "surface-uzawa"][not self.closing :]
        usual = next(ITERATIONS[self.dim, kind] for kind in kinds if (self.dim, kind) in ITERATIONS)
        # a floating body more slender than 2 takes more, in proportion to the square
        iterations = usual * self.slower * max(1.0, self.slender / 2) ** 2
        step = iterations * (PER_ENTRY * self.entries + PER_CONTACT_DOF * self.contact_dofs)
        return SET_UP * self.entries + self.steps * step * (self.contact_dofs if self.clock else 1)

    @property
    def dense_bytes(self) -> float:
        """Predicted memory [bytes] of the condensed form: a dense stiffness on each rank, one factor for all ranks.

        Newton's systems are dense over the rows of all contacts: half as many as the contact dofs of several bodies. So
        is the Delassus matrix, which they are cut from.
        """
        factor = sum(n * (n ** (1 / 3) * FACTOR[3] if self.dim == 3 else FACTOR[2]) for n, _ in self._each)
        several, rows = len(self.parts) > 1, self._rows**2
        # copies of the dense stiffness that are in memory at the same time
        dense = 5 * (sum(c**2 for _, c in self._each) + several * rows) + rows
        return 8.0 * (self.ranks * dense + self.mixed * factor)

    @property
    def _rows(self) -> float:
        return self.contact_dofs / (2 if len(self.parts) > 1 else 1)

    @property
    def _each(self) -> tuple[tuple[float, float], ...]:
        return self.parts or ((self.dofs, self.contact_dofs),)


def entries(kind: tuple[str, int], averaged: float) -> float:
    """Approximate number of non-zero entries of a row of K_B, for cells of a shape and order.

    Args:
        averaged: share of the cells whose dilatation is averaged.
    """
    return ENTRIES[kind] + averaged * (AVERAGED[kind] - ENTRIES[kind])


def mixed(kind: tuple[str, int], averaged: float) -> float:
    """See `Size.mixed`; arguments as of `entries`."""
    dim = 2 if kind[0] in ("triangle", "quadrilateral") else 3
    return 1 + averaged * (MIXED[dim, kind[1]] - 1)


def slower(problem: Problem) -> float:
    """See `Size.slower`: 3.6, 14, 57 for nu = .49, .499, .4999, where 3.8, 14, 47 were measured (order 1, 3D)."""
    if problem.model == "plane stress":
        return 1.0
    least = min(max(1 - 2 * body.near_incompressible, LEAST) for body in problem.bodies.values())
    return float(max(1.0, (0.17 / least) ** 0.6))


def _averaged(problem: Problem, mesh: Mesh) -> float:
    """Share of the cells whose dilatation is averaged; collective."""
    cells = [sum(len(mesh.cells_of(body)) for body in bodies) for bodies in (problem.averaged, problem.bodies)]
    some, every = mesh.comm.allreduce(np.array(cells, float))
    return float(some / every)


def _parts(mesh: Mesh, dofs: int, contacts: tuple[ContactRows, ...]) -> tuple[tuple[float, float], ...]:
    """About how many dofs, and how many contact dofs, each part of the mesh has, see `Size.parts`."""
    nodes = np.bincount(mesh.parts, minlength=mesh.part_count)  # on one rank these are all
    _, first = np.unique(
        np.concatenate([np.zeros(0, np.int64), *(c.input % SECTOR for c in contacts)]), return_index=True
    )
    part = np.concatenate([np.zeros(0, np.int64), *(c.part for c in contacts)])[first]
    on_sides = mesh.dim * np.bincount(part, minlength=mesh.part_count)
    return tuple(zip((dofs * nodes / nodes.sum()).tolist(), on_sides.tolist(), strict=True))


def _floating(problem: Problem) -> list[str]:
    """Bodies with a rigid motion that no support resists."""
    moved = problem.rigid_modes.any(axis=1).reshape(len(problem.bodies), -1)
    return [body for body, moves in zip(problem.bodies, moved.any(axis=1), strict=True) if moves]


def _slenderness(mesh: Mesh, body: str) -> float:
    """Length of a body over its thickness; collective."""
    low, high = mesh.body_box(body)
    return float(np.max(high - low) / np.min(high - low))


@dataclass(frozen=True)
class Choice:
    """Stages that are tried one after the other, and the reason for the first of them."""

    stages: tuple[Stage, ...]
    because: str

    @property
    def coarse(self) -> bool:
        """Whether the first method uses an additional coarse mesh."""
        return METHODS[self.stages[0].method].COARSE_MESH


def choose(system: System) -> Choice:
    """Stages for a scene's `solver.method` and `solver.surface` at its size; collective.

    Raises:
        MachineError: they ask for a dense stiffness that does not fit in memory.
    """
    return chosen(_size(system), system.problem.solver, _memory(system))


def fits(system: System, form: Form) -> bool:
    """Whether a form of the bodies fits in the memory that is free now; collective."""
    return form != "condensed" or _size(system).dense_bytes < SHARE * _memory(system)


def _size(system: System) -> Size:
    size = Size.of(system.problem, system.mesh, system.constraints, system.contacts)
    return replace(size, floating=size.floating or system.interface.rigid_modes.shape[1] > 0)  # also parts of bodies


def _memory(system: System) -> float:
    return float(min(system.mesh.comm.allgather(available())))


def chosen(size: Size, solver: Solver, memory: float) -> Choice:
    """Stages for a given size and free memory [bytes]; see `choose`."""
    form, because = _form(size, solver, size.dense_bytes < SHARE * memory)
    if solver.method != "auto":
        return Choice((Stage(solver.method, form),), because)
    stages, there = chain(form, size), size.dense_bytes < SHARE * memory
    if form == "matrix-free" and there:  # where bodies float no other one is as sure
        stages = (stages[:1] if size.floating else stages) + chain("condensed", size)
    return Choice(stages, because)


def chain(form: Form, size: Size) -> tuple[Stage, ...]:
    """Stages that `auto` tries with one form of the bodies, in the order of the methods' turns.

    >>> [str(stage) for stage in chain("matrix-free", Size(2, 74_390, 1.3e6, 1002))]
    ['surface-uzawa (matrix-free)', 'surface-uzawa (matrix-free, safer metric)']
    """
    turns = [
        (turn, name)
        for name, method in METHODS.items()
        if all(getattr(method.WORKS_WITH, need) or not getattr(size, need) for need in NEEDS)
        for turn in method.TURNS
        if turn.form == form and size.dim in turn.dims
    ]
    return tuple(Stage(name, form, turn.safe) for turn, name in sorted(turns, key=lambda each: each[0].place))


def _form(size: Size, solver: Solver, fits: bool) -> tuple[Form, str]:
    """The form of the bodies, and the reason for it; `fits`: whether the condensed form fits in memory."""
    table = METHODS[solver.method].WORKS_WITH
    if not (table.condensed or table.matrix_free):
        return "sparse", f"solver.method = {solver.method}"
    wanted = "condensed" if not table.matrix_free else "matrix-free" if not table.condensed else solver.surface
    if wanted == "matrix-free":
        because = "surface = matrix-free" if solver.surface == wanted else f"method = {solver.method}"
        return "matrix-free", f"solver.{because}"
    needs = f"{size.dense_bytes / 1e9:.2g} GB for {size.contact_dofs} contact dofs of {size.dofs} dofs in all"
    if wanted == "condensed":
        if not fits:
            raise MachineError(
                f"solver.method = {solver.method}, surface = {solver.surface}: the condensed form needs about {needs}, "
                "more than this machine has free; use solver.method = surface-uzawa, surface = matrix-free"
            )
        return "condensed", f"solver.method = {solver.method}, surface = {solver.surface}"
    if not fits:
        return "matrix-free", f"the condensed form needs about {needs}, more than this machine has free"
    first = chain("matrix-free", size)[0].method if solver.method == "auto" else solver.method
    form: Form = "condensed" if size.condensed_seconds <= size.matrix_free_seconds(first) else "matrix-free"
    return form, f"{size.dofs} dofs in {size.dim}D, {size.steps} steps: {form} is the cheaper form"
