"""Numbers of a step a second time: what the step's file shows of supports, obstacles, probes, bodies and effects.

How a number follows from what is seen of its owner is declared with the number, see `stickslip.solvers.scene.record`:
a number of a new record is judged because it is declared. What cannot be seen is named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property, partial
from operator import itemgetter
from types import SimpleNamespace
from typing import Any

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CLOSE, ROUNDING, TINY, Array, Ints, cross
from stickslip.geometry.surfaces.facet_map import place
from stickslip.geometry.surfaces.surface import gather_surface
from stickslip.solvers.effects import by_name, records
from stickslip.solvers.fem.rigid_fields import parts_of_motion, rigid_fields
from stickslip.solvers.results.closed_formulas import gap, in_time
from stickslip.solvers.results.stored_fields import Record, StoredFields, stress_again
from stickslip.solvers.scene.contact import table_of
from stickslip.solvers.scene.loads import Coupling, End, Link, Springs
from stickslip.solvers.scene.record import AGAIN, Number, Seen, Value, numbers_of
from stickslip.solvers.scene.timeline import Place
from stickslip.solvers.system.system import System

Told = Mapping[str, Any]  # a step as result.json has it, by table


@dataclass(frozen=True, kw_only=True)
class _At:
    """Where a probe is."""

    nodes: Ints  # (k,) of its cell, in the order of the gmsh model
    basis: Array  # (k,) at the point
    local: Array  # (1, d) coordinates on the reference cell
    own: Ints  # the cell, on the rank that has it; else empty
    cells: Ints  # (m,) those around its nodes, numbers in the gmsh model
    shares: Array  # (m,) in a mean at the point


class SecondNumbers:
    """What is seen of each record's owner; its places on the mesh are found once."""

    def __init__(self, system: System) -> None:
        """`system` is as it was at the start."""
        self._system, self._problem = system, system.problem
        self._most = dict[str, float]()  # largest number so far, by unit
        self.around = np.array([0.0, 1.0]) if system.mesh.axisymmetric else np.ones(system.mesh.dim)
        self.side = cache(partial(gather_surface, system.mesh, system.space, system.nodes))  # by name; collective

    def seen(self, record: Record, contacts: Mapping[str, Seen], out: Array) -> dict[str, dict[str, Seen]]:
        """By table and name what is seen of each record's owner; collective.

        Args:
            contacts: by name.
            out: forces (nodes, d) [N] that supports and rigid sides exert, in the order of the gmsh model.
        """
        found: dict[str, dict[str, Seen]] = {table: {} for table in records()}
        found["contacts"] = dict(contacts) | {
            name: _together([contacts[pair] for pair in pairs]) for name, pairs in self._problem.sums.items()
        }
        found["supports"] = self._supports(record, out)
        found["obstacles"] = {name: self._obstacle(name, record, contacts) for name in self._problem.obstacles}
        found["probes"] = {name: self._probe(name, record) for name in self._problem.probes}
        found["bodies"] = {
            name: SimpleNamespace(moved=record.displacement[nodes], von_mises=record.stored.von_mises[cells])
            for name, (nodes, cells) in self._bodies.items()
        }
        own = {link.key: self._link(link, record) for link in self._problem.links}
        own |= {springs.key: self._sprung(springs, record) for springs in self._problem.springs}
        own |= {coupling.key: self._coupled(coupling, record, out) for coupling in self._problem.couplings}
        for key, each in own.items():
            table, _, name = key.partition(".")
            found.setdefault(table, {})[name] = each
        return found

    def differences(
        self,
        stored: StoredFields,
        seen: Mapping[str, Mapping[str, Seen]],
        sizes: Mapping[str, float],
        rounding: Mapping[str, float],
    ) -> dict[str, float | None]:
        """Distance of each number from its second value beyond rounding, relative to itself [-]; None: it has none.

        Args:
            stored: with the numbers as result.json has them.
            seen: see `seen`.
            sizes: by unit, of this step; less than CLOSE of it, or of a number so far, counts as if it were that.
            rounding: by unit.
        """
        for told in filter(None, (sizes, stored.told_before, stored.told)):
            for unit, value in told.items() if told is sizes else ((n.unit, own) for _, n, own in _told(told)):
                self._most[unit] = max(self._most.get(unit, 0.0), float(np.abs(value).max(initial=0.0)))
        found = dict[str, float | None]()
        for (table, name, key), number, known in _told(stored.told):
            again, flat = second_value(number, key, seen[table].get(name)), ".".join(filter(None, (table, name, key)))
            if again is None:
                found[flat] = None
                continue
            size = np.maximum(np.maximum(np.abs(known), np.abs(again)), CLOSE * self._most[number.unit] + TINY)
            apart = np.abs(known - again) - rounding.get(number.unit, 0.0)
            found[flat] = float(np.max(apart / size, initial=0.0))
        return found

    def acting(self, points: Array, forces: Array, **more: Seen) -> SimpleNamespace:
        """Forces at points, of which resultant and moment are seen; `couple`: a further moment."""
        found = {"turned": 0 * forces, "couple": 0.0, "around": self.around} | more
        return SimpleNamespace(points=points, forces=forces, **found)

    def value(self, place: Place, record: Record) -> float:
        """A value at the record's time: one that its step has found, or that the scene gives."""
        found = dict(zip((bolt.shortening for bolt in self._system.initial.tightened), record.shortened, strict=True))
        timeline = self._problem.timeline
        return float(found[place] if place in found else in_time(timeline.amplitudes[place], record.time, timeline.end))

    @cached_property
    def supported(self) -> list[tuple[str, Ints, Array, Array]]:
        """Name of each support, gmsh numbers (k,), points (k, d) [m] and normals (k, d) of its nodes; collective."""
        system, found = self._system, []
        for name, support in system.problem.supports.items():
            if support.boundary is not None:
                side = self.side(support.boundary)
                found.append((name, side.input, side.points, side.node_normals()))
                continue
            at = np.array([support.point])
            found.append((name, np.array([self._vertex(at[0])]), at, np.zeros(at.shape)))
        return found

    def _supports(self, record: Record, out: Array) -> dict[str, SimpleNamespace]:
        """Forces along the prescribed directions of nodes; supports that share a node share its force.

        Those of sides that are periodic or rigid are divided by the solver's rule.
        """
        system, problem = self._system, self._problem
        if problem.request.periodic or system.constraints.remote.rigid:
            own = system.vector()
            own.array[:] = out[system.nodes.input[: system.nodes.owned]].ravel()
            shared = {name: system.reactions(own)[name] for name in problem.supports}
            return {
                name: self.acting(self._shift(name, record)[None], force[None], couple=moment)
                for name, (force, moment) in shared.items()
            }
        if not problem.supports:
            return {}
        axes = np.eye(problem.dim)
        held = [
            (name, nodes, points, normals if axis == "normal" else np.tile(axes["xyz".index(axis)], (len(nodes), 1)))
            for name, nodes, points, normals in self.supported
            for axis in problem.supports[name].displacement
        ]
        nodes, directions = (np.concatenate([[*each[k]] for each in held]) for k in (1, 3))
        _, first, count = np.unique(nodes, return_inverse=True, return_counts=True)
        pulls, order = np.zeros(directions.shape), np.argsort(first, kind="stable")
        start = np.concatenate([[0], np.cumsum(count)])[:-1]
        for many in np.unique(count):
            rows = order[start[count == many][:, None] + np.arange(many)]
            along = directions[rows]
            share = np.einsum("kdr,kd->kr", np.linalg.pinv(along, rcond=ROUNDING), out[nodes[rows[:, 0]]])
            pulls[rows] = share[:, :, None] * along
        found, at = dict[str, SimpleNamespace](), 0
        for name in problem.supports:
            parts = [(each, slice(at, at := at + len(each[1]))) for each in held if each[0] == name]
            shift = self._shift(name, record)
            found[name] = self.acting(
                np.concatenate([each[2] + shift for each, _ in parts]), np.concatenate([pulls[own] for _, own in parts])
            )
        return found

    def _shift(self, name: str, record: Record) -> Array:
        """Mean displacement (d,) [m] of what a support holds; over a full circle there is no moment."""
        if self._system.mesh.axisymmetric:
            return np.zeros(2)
        support = self._problem.supports[name]
        return self.mean(support.boundary or tuple(support.point or ()), record)

    def mean(self, end: End, record: Record) -> Array:
        """Displacement (d,) [m] of a point, or the mean one over a side."""
        if not isinstance(end, str):
            return np.asarray(record.displacement[self._vertex(np.array(end))])
        side = self.side(end)
        weights, basis = side.quadrature(2 * side.degree + side.axisymmetric)
        moved = np.einsum("qk,fkd->fqd", basis, record.displacement[side.input[side.facets]])
        return np.asarray(np.einsum("fq,fqd->d", weights, moved) / weights.sum())

    def _vertex(self, point: Array) -> int:
        """Number in the gmsh model of the node at a point (d,) [m]; collective."""
        distance = np.linalg.norm(self._system.nodes.points - point, axis=1)
        nearest = int(np.argmin(distance))
        offer = float(distance[nearest]), int(self._system.nodes.input[nearest])
        return min(self._system.mesh.comm.allgather(offer))[1]

    def moved(self, name: str, record: Record) -> Array:
        """Translation (d,) [m] of an obstacle."""
        found = np.zeros(self._problem.dim)
        for axis in self._problem.obstacles[name].displacement:
            found["xyz".index(axis)] = self.value(Place("obstacles", name, "displacement", axis), record)
        for (other, along), size in zip(self._problem.driven, record.driven, strict=True):
            found["xyz".index(along)] += size * (other == name)
        return found

    def motion(self, pair: str, points: Array, record: Record) -> Array:
        """Motion (m, d) [m] of a pair's obstacle where it is closest to points (m, d), or if tied at these."""
        known = self._problem.pairs[pair]
        name, tied = str(known.obstacle), known.contact.normal.ties
        obstacle, slid = self._problem.obstacles[name], np.zeros(points.shape[1])
        for way in known.contact.along:
            slid["xyz".index(way)] = self.value(Place("contacts", table_of(pair), "slide", way), record)
        found = np.tile(self.moved(name, record) - slid, (len(points), 1))
        if obstacle.rotation is None:
            return found
        own = gap(obstacle, points)
        apart = obstacle.signed_gap(points) if own is None else own
        arm = points - (0.0 if tied else apart[:, None] * obstacle.normals(points)) - np.array(obstacle.rotation.point)
        axis = np.array(obstacle.rotation.axis or (0.0, 0.0, 1.0))
        turn = np.cross(axis / np.linalg.norm(axis), np.pad(arm, ((0, 0), (0, 3 - arm.shape[1]))))
        angle = self.value(Place("obstacles", name, "rotation", "angle"), record)
        return np.asarray(found + angle * turn[:, : arm.shape[1]])

    def _obstacle(self, name: str, record: Record, contacts: Mapping[str, SimpleNamespace]) -> SimpleNamespace:
        """What bodies feel of an obstacle, about the point of its rotation."""
        dim, obstacle, moved = self._problem.dim, self._problem.obstacles[name], self.moved(name, record)
        about = np.array(obstacle.rotation.point) + moved if obstacle.rotation else np.zeros(dim)
        parts = [contacts[pair.name] for pair in self._problem.pairs.values() if pair.obstacle == name]
        empty = self.acting(np.zeros((0, dim)), np.zeros((0, dim)))
        points, forces, turned = (
            np.concatenate([getattr(part, key) for part in (empty, *parts)]) for key in ("points", "forces", "turned")
        )
        return self.acting(points, forces, turned=turned, couple=-cross(about, forces.sum(axis=0)), displacement=moved)

    @cached_property
    def _bodies(self) -> dict[str, tuple[Ints, Ints]]:
        """Numbers in the gmsh model of each body's nodes and cells; collective."""
        mesh, nodes, dofs = self._system.mesh, self._system.nodes, dx.cell_dofs(self._system.space)
        count = mesh.domain.topology.index_map(mesh.dim).size_local
        numbers, found = np.asarray(mesh.domain.topology.original_cell_index), dict[str, tuple[Ints, Ints]]()
        for name in mesh.bodies:
            cells = mesh.cells_of(name)
            cells = cells[cells < count]
            offers = mesh.comm.allgather((np.unique(nodes.input[dofs[cells]]), numbers[cells]))
            found[name] = np.unique(np.concatenate([o[0] for o in offers])), np.concatenate([o[1] for o in offers])
        return found

    def _probe(self, name: str, record: Record) -> SimpleNamespace:
        """Fields at a point; of several cells that have it in the first one of the gmsh model; collective."""
        at = self._at[name]
        if self._system.mesh.degree == 2:
            stress = stress_again(self._system, record.displacement, record.time, at.own, at.local)[0]
            (stress,) = np.concatenate(self._system.mesh.comm.allgather(stress))
        else:
            stress = np.einsum("m,mij->ij", at.shares, record.stored.stress[at.cells])
        return SimpleNamespace(displacement=at.basis @ record.displacement[at.nodes], stress=stress)

    @cached_property
    def _at(self) -> dict[str, _At]:
        """Where each probe is; collective."""
        system, mesh = self._system, self._system.mesh
        shape, count = mesh.domain.topology.cell_type.name, mesh.domain.topology.index_map(mesh.dim).size_local
        dofs, numbers = dx.cell_dofs(system.space)[:count], np.asarray(mesh.domain.topology.original_cell_index)
        x, middle, found = system.nodes.points[dofs], dx.midpoint(mesh.domain), dict[str, _At]()
        for name, probe in self._problem.probes.items():
            point, slack = np.array(probe.point), CLOSE * np.ptp(x, axis=1)
            near = ((x.min(axis=1) - slack <= point) & (point <= x.max(axis=1) + slack)).all(axis=1)
            own = []
            for cell in np.flatnonzero(near):
                local = middle
                for _ in range(20):  # Newton's method; cells are nearly straight
                    basis, slope = dx.reference_basis(shape, mesh.degree, local)
                    local = local + np.linalg.solve((slope[:, 0] @ x[cell]).T, point - basis[0] @ x[cell])
                if (dx.reference_basis(shape, 1, local)[0] >= -CLOSE).all():
                    basis = dx.reference_basis(shape, mesh.degree, local)[0][0]
                    own.append((int(numbers[cell]), int(cell), system.nodes.input[dofs[cell]], basis, local))
            offers = mesh.comm.allgather(min(own, key=itemgetter(0), default=None))
            number, cell, nodes, basis, local = min((each for each in offers if each), key=itemgetter(0))
            here = np.array([cell] if own and min(own, key=itemgetter(0))[0] == number else [], np.int64)
            cells, shares = self._around(number, nodes, basis)
            found[name] = _At(nodes=nodes, basis=basis, local=local, own=here, cells=cells, shares=shares)
        return found

    def _around(self, number: int, nodes: Ints, basis: Array) -> tuple[Ints, Array]:
        """Cells (m,) of the body of a cell that share nodes with it, and their shares in means at a point; collective.

        The mean of a node is that of its cells by their size, and the node's basis function is its share at the point.
        """
        system, mesh = self._system, self._system.mesh
        dofs, offers = dx.cell_dofs(system.space), list[tuple[Ints, Ints, Array]]()
        numbers = np.asarray(mesh.domain.topology.original_cell_index)
        body = next(name for name, (_, cells) in self._bodies.items() if number in cells)
        members = mesh.cells_of(body)
        members = members[members < mesh.domain.topology.index_map(mesh.dim).size_local]
        slope = dx.reference_basis(mesh.domain.topology.cell_type.name, mesh.degree, dx.midpoint(mesh.domain))[1][:, 0]
        for k, node in enumerate(nodes):
            beside = members[(system.nodes.input[dofs[members]] == node).any(axis=1)]
            x = system.nodes.points[dofs[beside]]
            size = np.abs(np.linalg.det(slope @ x)) * (x[..., 0].mean(axis=1) if mesh.axisymmetric else 1.0)
            offers.append((np.full(len(beside), k), numbers[beside], size))
        each = [np.concatenate(part) for part in zip(*offers, strict=True)]
        node, cells, sizes = (np.concatenate(mesh.comm.allgather(part)) for part in each)
        return cells, basis[node] * sizes / np.bincount(node, sizes)[node]

    def _link(self, link: Link, record: Record) -> SimpleNamespace:
        """Springs between places: their pull on the body at the first end, and what is found or given of their rest."""
        apart = np.sum([sign * self.mean(end, record) for end, sign in link.ends.values()], axis=0)
        rests = {drive: self.value(drive, record) for drive in link.rests}
        tension = link.stiffness * (link.directions @ apart - sum(rests[drive] * link.rests[drive] for drive in rests))
        forces, first = -tension[:, None] * link.directions, next(iter(rests.values()), 0.0)
        pull = {"tension": float(tension.sum()), "shortening": first}
        return self.acting(np.zeros_like(forces), forces, **pull)

    def on_side(self, name: str, values: Array, traction: Callable[[Array, Array], Array]) -> Array:
        """Nodal forces (n, d) [N] of a traction on a side, by its quadrature.

        Args:
            values: of the nodes (n, d).
            traction: of the values and unit normals (m, d), (m, d) [Pa].
        """
        side = self.side(name)
        degree = 2 * side.degree + self._system.weak.smooth
        (weights, basis), local = side.quadrature(degree), dx.reference_rule(side.shape, degree)[0]
        facets = np.repeat(np.arange(len(side.facets)), len(local))
        normals = place(side, facets, np.tile(local, (len(side.facets), 1))).area_normals
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        between = np.einsum("qk,fkd->fqd", basis, values[side.facets])
        stress = traction(between.reshape(normals.shape), normals).reshape(between.shape)
        nodal, found = np.einsum("fq,qk,fqd->fkd", weights, basis, stress), np.zeros(side.points.shape)
        np.add.at(found, side.facets, nodal)
        return found

    def _sprung(self, springs: Springs, record: Record) -> SimpleNamespace:
        """Springs per area to the ground."""

        def resisted(moved: Array, normals: Array) -> Array:
            along = np.einsum("md,md->m", moved, normals)[:, None] * normals
            return np.asarray(-springs.normal * along - springs.tangential * (moved - along))

        side = self.side(springs.boundary)
        forces = self.on_side(springs.boundary, record.displacement[side.input], resisted)
        return self.acting(side.points + self.mean(springs.boundary, record), forces)

    def _coupled(self, coupling: Coupling, record: Record, out: Array) -> SimpleNamespace:
        """Mean motion of the side of a remote point, as that of a rigid body; loads on it, and what holds it."""
        side, dim, about = self.side(coupling.boundary), self._problem.dim, np.array(coupling.point)
        weights, basis = side.quadrature(2 * side.degree + 2)
        x, moved = (
            np.einsum("qk,fkd->fqd", basis, values[side.facets]).reshape(-1, dim)
            for values in (side.points, record.displacement[side.input])
        )
        root = np.sqrt(weights).reshape(-1, 1, 1)
        fields = rigid_fields(x, about, 1.0, side.axisymmetric)
        z = np.linalg.lstsq(np.concatenate(root * fields), np.ravel(root[:, 0] * moved), rcond=None)[0]
        load, held = np.zeros(len(z)), rigid_fields(side.points, about, 1.0, side.axisymmetric)
        for component, drive in coupling.loads.items():
            load[component] += self.value(drive, record)
        pulled = np.einsum("ndk,nd->k", held, out[side.input])
        for component in coupling.prescribed:
            load[component] += pulled[component]
        (shift, turn), (force, moment) = parts_of_motion(z, dim), parts_of_motion(load, dim)
        return SimpleNamespace(displacement=shift, rotation=turn, force=force, moment=moment)


def second_value(number: Number, key: str, seen: Seen) -> Value | None:
    """A number by its second formula; None: nothing of it is seen."""
    known = getattr(seen, key, None)
    again = number.again or AGAIN.get(key)
    if known is None and again is not None and seen is not None:
        known = again(seen)
    return None if known is None else number.value(known)


def _told(told: Told) -> Iterator[tuple[tuple[str, str, str], Number, Array]]:
    """Table, name and key of each number, its declaration and its value."""
    for table, record in records().items():
        for name, own in by_name(table, told[table]).items():
            for key, number in numbers_of(record).items():
                if key in own:
                    yield (table, name, key), number, np.asarray(own[key], float)


def _together(parts: list[SimpleNamespace]) -> SimpleNamespace:
    """What is seen of a contact of several partners: rows of all of them, sums of their works."""
    found = dict[str, Value]()
    for key in vars(parts[0]):
        values = [getattr(part, key) for part in parts]
        found[key] = np.concatenate(values) if np.ndim(values[0]) else float(np.sum(values))
    return SimpleNamespace(**found | {"around": parts[0].around})
