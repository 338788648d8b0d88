"""Results of a solved step: fields, contact states, reactions, probes, energy; plain arrays, nothing of PETSc."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from html import escape
from operator import or_
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip.geometry.arrays import AnyArray, Array, Ints
from stickslip.geometry.protocols import DataFrame
from stickslip.solvers.iteration import Convergence
from stickslip.solvers.results.error_parts import ErrorParts, Value
from stickslip.solvers.scene.quantities import CONTACT_NUMBERS
from stickslip.solvers.stepping.history import HistoryTuple
from stickslip.solvers.stepping.state import Energy

OPEN, SLIP, STICK = 0, 1, 2  # values of `ContactState.status`
STATUS_WORDS = ("open", "slip", "stick")  # of these values, in tables


class Reaction(NamedTuple):
    """What a support exerts on the body, or an elastic one."""

    force: Array  # (d,) [N]
    moment: Array  # (1,) in 2D, about z; (3,) in 3D; about the origin [N m]


class ObstacleState(NamedTuple):
    """Where a rigid obstacle is, and what it exerts on the bodies through all its contacts."""

    displacement: Array  # (d,) translation since t = 0 [m], without the part of a rotation
    force: Array  # (d,) [N]
    moment: Array  # (1,) or (3,) about the point of the rotation, or about the origin without one [N m]


class SpringForce(NamedTuple):
    """What a spring between places exerts on the body at its end `at`."""

    force: Array  # (d,) [N]


class BoltState(NamedTuple):
    """A bolt between two sides."""

    tension: float  # [N], positive where it clamps
    shortening: float  # [m]


class RemoteState(NamedTuple):
    """Motion of a remote point, and what it exerts on its side, loads and reactions together."""

    displacement: Array  # (d,) [m]
    rotation: Array  # (1,) in 2D, about z; (3,) in 3D [rad]
    force: Array  # (d,) [N]
    moment: Array  # (1,) or (3,) about the point [N m]


class BodyState(NamedTuple):
    """The largest values of a body's fields."""

    max_displacement: float  # largest length of the displacement of a node [m]
    max_von_mises: float  # largest equivalent stress at the midpoint of a cell [Pa]


class ProbeValue(NamedTuple):
    """Fields at a point that a probe names."""

    displacement: Array  # (d,) interpolated [m]
    stress: Array  # (3, 3) of the cell that contains the point [Pa], tension positive


class SurfaceMesh(NamedTuple):
    """The slave side of a contact as a mesh; its nodes are in the order of `ContactState`."""

    points: Array  # (n, d) [m], undeformed
    facets: Ints  # (f, k) nodes of each facet, in dolfinx's order
    shape: str  # interval, triangle or quadrilateral


@dataclass(frozen=True, kw_only=True, repr=False)
class ContactState:
    """One contact at the end of a step, at the n nodes of its slave side and as resultants.

    Vectors have d Cartesian components. Tractions act on the slave side, `force` and `moment` on the side that the
    scene calls `surface`, which is the slave unless `slave` says or finds otherwise. Pressure is positive where it
    presses, a gap is positive where it is open. In plane models resultants and areas are per metre of thickness, in
    axisymmetric ones of the full circle.
    """

    points: Array  # (n, d) undeformed [m]
    weight: Array  # (n,) area that each node stands for [m^(d-1)]; its sum is the area of the side
    gap: Array  # (n,) current gap g - u_n [m]; negative: penetration
    pressure: Array  # (n,) p_n [Pa]
    traction: Array  # (n, d) tangential traction sigma_T [Pa]
    slip: Array  # (n, d) tangential displacement relative to the other side, since t = 0 [m]
    slip_increment: Array  # (n, d) the same, since the last accepted substep [m]
    bound: Array  # (n,) friction bound s on |sigma_T| [Pa]; inf: never slips, 0: no friction
    lam: Array  # (n, d) lambda = -sigma_T / s [-]; its length is 1 where the node slips; 0 where s = 0
    status: NDArray[np.int8]  # (n,) OPEN, SLIP or STICK
    force: Array  # (d,) resultant of pressure and traction [N]
    moment: Array  # (1,) in 2D, about z; (3,) in 3D; about the origin [N m]
    normal_force: float  # integral of the pressure [N]
    tangential_force: float  # length of the resultant of the traction [N]
    max_pressure: float  # largest pressure at contact points [Pa]; nodes have averages of these
    contact_area: float  # of nodes that stick or slip [m^(d-1)]
    stick_area: float  # [m^(d-1)]
    slip_area: float  # [m^(d-1)]
    max_penetration: float  # largest penetration at contact points, >= 0 [m]
    max_slip: float  # largest length of `slip` where the contact is closed [m]
    dissipation: float  # work of friction in this step, >= 0 [J]
    dissipation_total: float  # the same, since t = 0 [J]

    def columns(self) -> dict[str, AnyArray]:
        """What stands at the nodes, by the columns of contact_NAME.csv but `arc`: arrays (n,); a status is a word."""
        axes = "xyz"[: self.points.shape[1]]
        vectors = (("traction", self.traction), ("slip", self.slip), ("slip_increment", self.slip_increment))
        parts = (("", self.points), *((f"{name}_", values) for name, values in (*vectors, ("lambda", self.lam))))
        (place, *at_nodes) = ({f"{name}{a}": v for a, v in zip(axes, values.T, strict=True)} for name, values in parts)
        numbers = {"weight": self.weight, "gap": self.gap, "pressure": self.pressure}
        words = {"status": np.array(STATUS_WORDS)[self.status]}
        return reduce(or_, (place, numbers, *at_nodes, words))

    def to_pandas(self) -> DataFrame:
        """The nodes as a `pandas.DataFrame`, with the same columns.

        Raises:
            ImportError: pandas is not installed.
        """
        return data_frame(self.columns())

    def counts(self) -> dict[str, int]:
        """Number of nodes that are open, slip and stick."""
        return dict(zip(STATUS_WORDS, np.bincount(self.status, minlength=3).tolist(), strict=True))

    def __repr__(self) -> str:
        said = ", ".join(f"{number} {word}" for word, number in self.counts().items())
        forces = f"normal_force={self.normal_force:.6g}, tangential_force={self.tangential_force:.6g}"
        return f"ContactState({len(self.weight)} nodes: {said}; {forces}, max_pressure={self.max_pressure:.6g})"

    def _repr_html_(self) -> str:
        """A table of the resultants, for notebooks."""
        return html_table("contact", {"": self.counts() | {key: getattr(self, key) for key in CONTACT_NUMBERS}})


@dataclass(frozen=True, kw_only=True)
class Numbers:
    """What bodies, supports and obstacles exert on each other; keys are the names of the scene."""

    contacts: Mapping[str, ContactState]
    supports: Mapping[str, Reaction]
    obstacles: Mapping[str, ObstacleState]
    springs: Mapping[str, SpringForce]
    bolts: Mapping[str, BoltState]
    remote_points: Mapping[str, RemoteState]
    elastic_support: Mapping[str, Reaction]
    energy: Energy  # totals since t = 0 [J]


@dataclass(frozen=True, kw_only=True, repr=False)
class StepResult:
    """The solution at a requested time.

    Nodes and cells are in the order of the gmsh model, whatever the number of ranks. `displacement`, `stress` and
    `stress_error` are on rank 0 (empty elsewhere), all else is on every rank. Mappings have the names of the scene as
    keys. d is 2 or 3.
    """

    time: float  # [s]
    substeps: int  # number of substeps that the step was solved in; 1 if it succeeded as a whole
    iterations: int  # of all substeps, failed attempts included
    volume_solves: int  # applications of K_B^-1 in this step
    residual: float  # natural residual of the contact laws at the end [-]
    displacement: Array  # (nodes, d) [m]
    stress: Array  # (cells, 3, 3) at the midpoints [Pa], tension positive
    contacts: Mapping[str, ContactState]
    supports: Mapping[str, Reaction]
    obstacles: Mapping[str, ObstacleState]
    probes: Mapping[str, ProbeValue]
    energy: Energy  # totals since t = 0 [J]
    iteration_error: (
        float  # bound on what iterations left so far, energy norm, relative to the largest [-]; nan: unknown
    )
    mesh_error: float  # estimate of what the mesh leaves, energy norm, relative to the largest [-]; nan: none
    stress_error: Array  # (cells,) the same as an error of the stress [Pa], see `MeshError`; empty: not estimated
    law_error: float  # the same by the method's approximation of the contact laws, earlier steps included [-]
    p: Array  # (rows,) tractions, flat [Pa]; for the audit and the next step
    w: Array  # (rows,) relative displacement, flat [m]
    reference: Array  # (rows,) that the contact laws subtract from w [m]: the gap, and the slip at the substep's start
    driven: Array  # (o,) displacement of the obstacles that forces drive [m], for the audit
    shortened: (
        Array  # (b,) that are found: shortening of bolts by force, slack of springs of one way [m]; for the audit
    )
    searched: Mapping[str, Array]  # by sliding contact, displacement (n_all, d) that its pairs were searched at [m]
    memory: Mapping[str, Array]  # by contact whose friction remembers slip: its length so far [m], or rate [m/s] (m_t,)
    p_ref: float  # scale of tractions: of statuses, and of what counts as none [Pa]
    u_ref: float  # scale of relative displacements: of statuses [m]
    history: tuple[HistoryTuple, ...]  # each iteration: time, iteration, residual, volume solves, seconds, method
    weakening: float = 0.0  # how much faster than bodies unload friction weakened by slip [-]; above 1 slip jumped
    linear_error: float = 0.0  # error left by an iterative volume solve, energy norm, relative [-]; 0: direct solver
    convergence: Convergence | None = None  # of Uzawa's iteration, from methods that measure it
    other_solutions: tuple[
        Mapping[str, float], ...
    ] = ()  # that friction admits and were met: normal force by contact [N]
    corrected: Mapping[str, Value] = field(default_factory=dict)  # by `Quantity`: most of the mesh's error removed
    errors: Mapping[str, ErrorParts] = field(default_factory=dict)  # by `Quantity`, but for those of the time steps
    springs: Mapping[str, SpringForce] = field(default_factory=dict)
    bolts: Mapping[str, BoltState] = field(default_factory=dict)
    remote_points: Mapping[str, RemoteState] = field(default_factory=dict)
    elastic_support: Mapping[str, Reaction] = field(default_factory=dict)
    bodies: Mapping[str, BodyState] = field(default_factory=dict)
    columns: Mapping[str, float] = field(default_factory=dict)  # numbers that effects add to steps.csv, by column

    def __repr__(self) -> str:
        return f"StepResult(time={self.time:g}, {len(self.displacement)} nodes, contacts={dict(self.contacts)})"

    def _repr_html_(self) -> str:
        """A table of the contacts' resultants, for notebooks."""
        numbers = {name: {key: getattr(c, key) for key in CONTACT_NUMBERS} for name, c in self.contacts.items()}
        return html_table(f"t = {self.time:g}", numbers)

    def without_fields(self) -> StepResult:
        """The same, fields of nodes and cells empty: their memory grows with the mesh."""
        nothing = np.zeros(0)
        return replace(self, displacement=np.zeros((0, 0)), stress=np.zeros((0, 3, 3)), stress_error=nothing)

    @property
    def von_mises(self) -> Array:
        """Equivalent stress (cells,) [Pa], >= 0; on rank 0 (empty elsewhere)."""
        return von_mises(self.stress)


@dataclass(frozen=True, kw_only=True, repr=False)
class MeshData:
    """The mesh as plain arrays in the order of the gmsh model.

    `points`, `cells`, `body` and `slaves` are on rank 0 (empty elsewhere), all else is on every rank.
    """

    points: Array  # (nodes, d) [m], undeformed
    cells: Ints  # (cells, k) rows of `points`, in dolfinx's order of a cell's nodes
    shape: str  # of the cells: triangle, quadrilateral, tetrahedron or hexahedron
    body: Ints  # (cells,) index into `bodies`
    bodies: tuple[str, ...]
    surfaces: Mapping[str, SurfaceMesh]  # by contact
    slaves: Mapping[str, Ints] = field(default_factory=dict)  # by contact, (n,) rows of `points` of its surface
    gaps: Mapping[str, Array] = field(default_factory=dict)  # by contact, (n,) initial gap [m]

    def __repr__(self) -> str:
        found = f"{len(self.cells)} cells ({self.shape}), {len(self.points)} nodes, bodies {', '.join(self.bodies)}"
        return f"MeshData({found})"


def von_mises(stress: Array) -> Array:
    """Equivalent stress (cells,) [Pa] of stresses (cells, 3, 3)."""
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    return np.asarray(np.sqrt(1.5 * np.einsum("cij,cij->c", deviator, deviator)))


def data_frame(content: Mapping[str, AnyArray] | Sequence[Mapping[str, object]]) -> DataFrame:
    """A `pandas.DataFrame` of columns by name, or of rows.

    Raises:
        ImportError: pandas is not installed.
    """
    try:
        import pandas
    except ModuleNotFoundError:
        line = "to_pandas: pandas is not installed; pip install pandas (Debian 12: pip install pandas 'numpy<2')"
        raise ImportError(line) from None
    return pandas.DataFrame(content)


def html_table(title: str, numbers: Mapping[str, Mapping[str, float]]) -> str:
    """Names and numbers as a table of HTML: a column for each name, a row for each number.

    >>> html_table("t = 1", {"base": {"force": 2.0}})
    '<table><tr><th>t = 1</th><th>base</th></tr><tr><td>force</td><td>2</td></tr></table>'
    """
    rows = dict.fromkeys(row for column in numbers.values() for row in column)
    head = "".join(f"<th>{escape(text)}</th>" for text in (title, *numbers))
    lines = [
        f"<td>{escape(row)}</td>" + "".join(f"<td>{column[row]:.6g}</td>" for column in numbers.values())
        for row in rows
    ]
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in (head, *lines))}</table>"
