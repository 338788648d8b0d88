"""What a reported step leaves behind: fields, contact states, reactions, probes, energy. Plain arrays, no PETSc."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from geometry.arrays import Array, Ints
from solvers.stepping.history import HistoryTuple
from solvers.stepping.state import Energy

OPEN, SLIP, STICK = 0, 1, 2


@dataclass(frozen=True, kw_only=True)
class ContactState:
    """One contact surface: n nodes, d dimensions, Cartesian components; resultants act on the slave side."""

    weight: Array  # (n,) [m^(d-1)]
    gap: Array  # (n,) current gap g - u_n [m], negative: penetration
    pressure: Array  # (n,) [Pa]
    traction: Array  # (n, d) sigma_T [Pa]
    slip: Array  # (n, d) tangential relative displacement since t = 0 [m]
    slip_increment: Array  # (n, d) since the last accepted step [m]
    bound: Array  # (n,) friction bound s [Pa], infinite for stick
    lam: Array  # (n, d) lambda = t/s, 0 where s = 0 [-]
    status: NDArray[np.int8]  # (n,) OPEN, SLIP or STICK
    force: Array  # (d,) [N]
    moment: Array  # (1,) or (3,) about the origin [N m]
    normal_force: float
    tangential_force: float
    max_pressure: float
    contact_area: float
    stick_area: float
    slip_area: float
    max_penetration: float
    max_slip: float
    dissipation: float  # in this step [J]
    dissipation_total: float


@dataclass(frozen=True, kw_only=True)
class StepResult:
    """A requested time, reached. Nodes and cells in the order of the gmsh model, whatever the number of ranks.

    `displacement` and `stress` are on rank 0 only (empty elsewhere), all else is on every rank.
    """

    time: float
    substeps: int
    iterations: int
    volume_solves: int
    residual: float
    displacement: Array  # (nodes, d) [m]
    stress: Array  # (cells, 3, 3) [Pa]
    contacts: Mapping[str, ContactState]
    supports: Mapping[str, tuple[Array, Array]]  # force (d,) [N], moment [N m] about the origin
    # of each obstacle: displacement (d,) [m]; force (d,) [N] on the bodies, and its moment [N m] about the axis of
    # rotation, or the origin without one
    obstacles: Mapping[str, tuple[Array, Array, Array]]
    probes: Mapping[str, tuple[Array, Array]]  # displacement (d,) [m], stress (3, 3) [Pa]
    energy: Energy
    iteration_error: float  # relative to the largest energy norm so far
    law_error: (
        float  # relative, energy norm: what the method's approximation of the laws leaves, earlier steps included
    )
    p: Array  # (rows,) flat tractions [Pa], for the audit and the next step
    w: Array  # (rows,) flat relative displacement [m]
    reference: Array  # (rows,) what the laws count w from [m]: the gap, and where this step's slip begins
    driven: Array  # (o,) motion of the obstacles that forces drive [m], for the audit
    searched: Mapping[str, Array]  # where sliding contacts were paired, (n_all, d) [m] by contact; empty if none slides
    p_ref: float  # [Pa]
    u_ref: float  # [m]
    history: tuple[HistoryTuple, ...]
    linear_error: float = 0.0  # relative, energy norm: what an iterative volume solve leaves
    columns: Mapping[str, float] = field(default_factory=dict)  # what effects add to steps.csv

    def without_fields(self) -> StepResult:
        """What is known besides displacement and stress: they take memory that grows with the mesh."""
        return replace(self, displacement=np.zeros((0, 0)), stress=np.zeros((0, 3, 3)))

    @property
    def von_mises(self) -> Array:
        """(cells,) [Pa]."""
        deviator = self.stress - np.trace(self.stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        return np.asarray(np.sqrt(1.5 * np.einsum("cij,cij->c", deviator, deviator)))


@dataclass(frozen=True, kw_only=True)
class MeshData:
    """The mesh as plain arrays in the order of the gmsh model, on rank 0 (empty elsewhere)."""

    points: Array  # (nodes, d) [m]
    cells: Ints  # (cells, k) in dolfinx's order of nodes
    shape: str  # triangle, quadrilateral, tetrahedron, hexahedron
    body: Ints  # (cells,) index into `bodies`
    bodies: tuple[str, ...]
    surfaces: Mapping[str, tuple[Array, Ints, str]]  # contact: points (n, d), facets (f, k), shape
    gaps: Mapping[str, Array] = field(default_factory=dict)  # contact between bodies: (n,) before anything moves [m]
