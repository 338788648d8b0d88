"""Contact dofs, displacement and forces at the contacts, and the motion of rigid obstacles: prescribed or driven."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import LAST_DIGITS, ROUNDING, Array, Ints
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.protocols import Mat, Sparse, Vec
from stickslip.geometry.surfaces.surface import SECTOR, in_sectors
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.fem.constraints import AXES, Constraints
from stickslip.solvers.fem.rigid_modes import RigidModes
from stickslip.solvers.parallel.replicated import Replicated
from stickslip.solvers.scene.contact import table_of
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.timeline import Course, Place


@dataclass(frozen=True)
class Obstacles:
    """The obstacles of a problem; `driven` (o,) are the motions [m] that forces drive, unknowns of the problem."""

    problem: Problem
    course: Course

    @cached_property
    def driven(self) -> tuple[tuple[str, int], ...]:
        """Name of the obstacle and index of the axis, for each unknown motion (o,)."""
        return tuple((name, AXES[axis]) for name, axis in self.problem.driven)

    def driving_force(self, time: float) -> Array:
        """Forces (o,) [N] on the driven obstacles at a time [s]."""
        places = [Place("obstacles", name, "force", axis) for name, axis in self.problem.driven]
        return np.array([self.course.value(place, time) for place in places], float)

    def translation(self, name: str, time: float, driven: Array) -> Array:
        """Translation (d,) [m] of an obstacle at a time [s]; driven: the unknown motions (o,) [m]."""
        moved = self._prescribed(name, time)
        for (other, axis), size in zip(self.driven, driven, strict=True):
            moved[axis] += size * (other == name)
        return moved

    def motion(self, pair: str, points: Array, time: float, driven: Array) -> Array:
        """Motion of a pair's obstacle (m, d) [m], at its points closest to `points`, or if tied at `points` themselves.

        What the pair slides along it is a part of that, which the obstacle does not have elsewhere.

        Args:
            pair: name of the contact.
            points: (m, d) [m].
            time: [s].
            driven: unknown motions (o,) [m].
        """
        known = self.problem.pairs[pair]
        assert known.obstacle is not None
        obstacle, name = self.problem.obstacles[known.obstacle], known.obstacle
        angle = 0.0
        if obstacle.rotation is not None:
            angle = self.course.value(Place("obstacles", name, "rotation", "angle"), time)
        tied = known.contact.normal.ties
        motion = obstacle.motion(points, self._prescribed(name, time), angle, tied=tied)
        for (other, axis), size in zip(self.driven, driven, strict=True):
            if other == name:
                motion[:, axis] += size
        for way in known.contact.along:  # the other side slides back
            motion[:, AXES[way]] -= self.course.value(Place("contacts", table_of(pair), "slide", way), time)
        return motion

    def motions(self, contacts: tuple[ContactRows, ...], time: float, driven: Array) -> dict[str, Array]:
        """Motion (n_all, d) [m] of each contact's obstacle at the nodes of its surface; zero between bodies."""
        return {
            c.name: np.zeros(c.points.shape) if c.master else self.motion(c.name, c.points, time, driven)
            for c in contacts
        }

    def resultants(self, pair: str, force: Array) -> Array:
        """Components (o,) [N] of a contact's force (d,) [N] along the driven motions; zero for other obstacles."""
        against = self.problem.pairs[pair].obstacle
        return np.array([force[axis] * (name == against) for name, axis in self.driven], float)

    def unit_motions(self, pair: str, count: int) -> Mapping[int, Array]:
        """Displacement (count d,) of `count` points for a motion of 1 m, by index of the pair's unknown motions."""
        against = self.problem.pairs[pair].obstacle
        unit = np.eye(self.problem.dim)
        return {k: np.tile(unit[axis], count) for k, (name, axis) in enumerate(self.driven) if name == against}

    def _prescribed(self, name: str, time: float) -> Array:
        given = self.problem.obstacles[name].displacement
        places = [(axis, Place("obstacles", name, "displacement", axis)) for axis in "xyz"[: self.problem.dim]]
        return np.array([self.course.value(place, time) if axis in given else 0.0 for axis, place in places])


UNTOUCHED = "that no contact touches "  # a part of the mesh, in words


@dataclass(frozen=True, kw_only=True)
class ContactInterface:
    """The surfaces of all contacts, replicated on every rank, and the c contact dofs that their rows touch."""

    mesh: Mesh
    constraints: Constraints
    contacts: tuple[ContactRows, ...]
    motions: RigidModes
    obstacles: Obstacles
    T: Mat  # (all, all), from free displacements to all displacements
    sliding: bool  # whether pairs are searched again

    @cached_property
    def dofs(self) -> Ints:
        """Indices (c,) of the free displacements at the contact nodes, increasing; the same on every rank."""
        found: list[Ints] = [np.zeros(0, np.int64)]
        near = [c.near_nodes for c in self.contacts]
        found += [self.constraints.numbers(nodes)[self.constraints.bases(nodes)[1]] for nodes in near]
        return np.unique(np.concatenate(found))

    @cached_property
    def pressed(self) -> Ints:
        """Those of `dofs` that the rows of contacts touch: without friction the normal ones of sides across an axis.

        They are all where bodies float, whose motions have to be seen, and where pairs slide, whose normals turn.
        """
        slides = any(c.friction is not None or self.sliding for c in self.contacts)
        if slides or self.motions.unresisted.shape[1] or not self.contacts:
            return self.dofs
        rows = sparse.vstack([c.N_n @ self.trace(c) for c in self.contacts])
        largest = np.asarray(abs(rows).max(axis=0).todense()).ravel()
        # of the largest entry of the rows; a displacement with less is not touched
        touched: Ints = self.dofs[largest > LAST_DIGITS * largest.max(initial=0.0)]
        return touched

    def trace(self, c: ContactRows) -> Sparse:
        """Sparse matrix (n_all d, c) from the contact dofs to the displacement of a contact's nodes."""
        bases, numbers = self.constraints.bases(c.nodes)[0], self.constraints.numbers(c.nodes)
        node, i, j = np.nonzero(bases)
        node, i, j = (at[np.isin(numbers[node, j], self.dofs)] if c.near is not None else at for at in (node, i, j))
        columns = np.searchsorted(self.dofs, numbers[node, j])
        shape = (self.mesh.dim * len(c.nodes), len(self.dofs))
        return sparse.csr_matrix((bases[node, i, j], (self.mesh.dim * node + i, columns)), shape=shape)

    @cached_property
    def rigid_modes(self) -> Array:
        """Rigid modes that no support resists, on the contact dofs (c, r), orthonormal.

        Raises:
            SceneError: one of them moves no contact dof; see `loose`.
        """
        modes, count = self.motions.unresisted, self.mesh.part_count
        of_part = modes.reshape(count, len(modes) // count, modes.shape[1])
        values = np.zeros((len(self.dofs), modes.shape[1]))
        for c in self.contacts if modes.shape[1] else ():
            fields = self.motions.fields(c.points) @ of_part[c.part]
            bases, free = self.constraints.bases(c.nodes)
            numbers, moved = self.constraints.numbers(c.nodes)[free], (np.swapaxes(bases, 1, 2) @ fields)[free]
            known = np.isin(numbers, self.dofs) if c.near is not None else slice(None)
            values[np.searchsorted(self.dofs, numbers[known])] = moved[known]
        self.refuse_loose(values, UNTOUCHED)
        return np.asarray(np.linalg.qr(values)[0])

    def refuse_loose(self, resisted: Array, which: str) -> None:
        """
        Args:
            resisted: (rows, r) what the rigid modes that no support resists move.
            which: parts, in words.

        Raises:
            SceneError: some of them move nothing of that.
        """
        count = resisted.shape[1]
        if not count:
            return
        _, sizes, directions = np.linalg.svd(np.linalg.qr(np.pad(resisted, ((0, count), (0, 0))), mode="r"))
        loose = directions[sizes <= ROUNDING]  # of a rigid mode; a part that it moves by less is not moved
        if not len(loose):
            return
        raise loose_part(which, self.motions.hinge(self.motions.unresisted @ loose.T))

    def displacement(self, u: Vec) -> list[Array]:
        """Displacement (n_all, d) [m] of each contact's nodes, on every rank; u over all displacements."""
        values = self._nodes.read(u)
        ends = np.cumsum([0, *(len(c.nodes) for c in self.contacts)])
        return [values[i:j] for i, j in pairwise(ends)]

    def forces(self, p_n: list[Array], t: list[Array]) -> Vec:
        """B^T p over all displacements [N].

        Args:
            p_n: for each contact its normal tractions [Pa].
            t: for each contact its tangential tractions [Pa].
        """
        return self.spread([c.nodal_forces(*parts) for c, *parts in zip(self.contacts, p_n, t, strict=True)])

    def spread(self, forces: list[Array]) -> Vec:
        """Forces (n_all, d) [N] at the nodes of each contact, over all displacements."""
        total = self.T.createVecLeft()
        self._nodes.add(total, np.concatenate([np.zeros((0, self.mesh.dim)), *forces]))
        return total

    def force_of(self, c: ContactRows, p_n: Array, t: Array) -> Vec:
        """B^T p of one contact over all displacements [N]."""
        total = self.T.createVecLeft()
        NodalVectors(total, c.nodes, self.constraints.periodic.sectors).add(total, c.nodal_forces(p_n, t))
        return total

    def resultant_on_driven(self, c: ContactRows, force: Vec) -> Array:
        """Resultants (o,) [N] of B^T p of a contact along the motions of driven obstacles; collective."""
        by_axis = self.mesh.comm.allreduce(force.array.reshape(-1, self.mesh.dim).sum(axis=0))
        return self.obstacles.resultants(c.name, by_axis)

    @cached_property
    def _nodes(self) -> NodalVectors:
        nodes = np.concatenate([np.zeros(0, np.int64), *(c.nodes for c in self.contacts)])
        return NodalVectors(self.T.createVecLeft(), nodes, self.constraints.periodic.sectors)


class NodalVectors:
    """Read and add vectors at nodes, on every rank; those at nodes of other sectors are turned."""

    def __init__(self, like: Vec, nodes: Ints, sectors: Array) -> None:
        """sectors: (s, d, d), see `Periodic`."""
        self._nodes, self._sectors = nodes, sectors
        self._entries = Replicated(like, components(nodes % SECTOR, sectors.shape[1]))

    def read(self, vector: Vec) -> Array:
        """Vectors (n, d) of a distributed one; collective."""
        values = self._entries.read(vector).reshape(len(self._nodes), self._sectors.shape[1])
        return in_sectors(values, self._nodes, self._sectors)

    def add(self, vector: Vec, values: Array) -> None:
        """Add vectors (n, d) to those of the nodes; each rank adds to its own."""
        self._entries.add(vector, in_sectors(values, self._nodes, self._sectors.swapaxes(1, 2)).ravel())


def loose_part(which: str, hinge: Array | None) -> SceneError:
    """Explain why a scene is refused in which a part of the mesh can move.

    Args:
        which: part, in words that end with a blank.
        hinge: (d,) [m] where it hangs on the rest; None: nowhere.
    """
    if hinge is None:
        return SceneError(f"supports: a part of the mesh {which}can move as a whole; hold it")
    at = ", ".join(f"{x:.6g}" for x in hinge)
    return SceneError(
        f"supports: a part of the mesh {which}can turn about ({at}), where it hangs on the rest by a point or an "
        "edge only; hold it, or join it by whole facets"
    )


def components(nodes: Ints, dim: int) -> Ints:
    """Numbers (n d,) of all displacement components of nodes (n,)."""
    return (nodes[:, None] * dim + np.arange(dim)).ravel()
