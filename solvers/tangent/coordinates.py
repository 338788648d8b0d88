"""Contact coordinates: a basis of the free displacements in which relative displacements are unknowns of their own.

u = T v: at a slave node v has the relative displacements w of its rows, and the motions that no row measures; at all
others v = u. As the multipliers are dual, T is sparse: u_s = w + P u_m on a mortar, and a turned frame on an obstacle.
Forces on v are T^T times those on u; those of tractions p are W p at the rows, and zero elsewhere.

Source: Hüeber & Wohlmuth, Comput. Methods Appl. Mech. Engrg. 194 (2005), of the change of basis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse

from stickslip.geometry.arrays import LAST_DIGITS, SLIGHT, Array, Bools, Ints
from stickslip.geometry.errors import SolverError
from stickslip.geometry.mesh.ranks import of_all_ranks
from stickslip.geometry.protocols import Mat, Sparse
from stickslip.solvers.contact.build import along
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.flexibility import DelassusOperator
from stickslip.solvers.parallel.replicated import from_rows
from stickslip.solvers.system.system import System


@dataclass(frozen=True)
class ContactCoordinates:
    """The basis T, and where the rows are in it. Each rank knows its own contact nodes, and those that they need."""

    T: Mat  # (free, free), distributed as the free displacements
    inverse: Mat  # its inverse: the rows N, and the motions that they do not measure
    numbers: Ints  # (n d,) of the coordinates of the n contact nodes that this rank knows: all, if faces are compliant
    rows: Sparse  # (rows, n d) relative displacements by these coordinates, N T; without entries if none is compliant
    blocks: Ints  # (m, d) numbers of the coordinates of this rank's m slave nodes, increasing
    at: Ints  # (rows,) number of each row's coordinate, of all ranks; -1: the row carries nothing, or is compliant
    compliant: Ints  # numbers of the coordinates that are normal motions of compliant faces
    signs: Array  # (m, d) of T's diagonal at the slave nodes: each coordinate stands in the place of the nearest axis
    alone: bool  # whether T couples slave nodes to each other only: no bodies on the other side
    normal_rows: int  # the first of `at`

    @property
    def normal(self) -> Ints:
        """Numbers of the coordinates that are normal relative displacements, of all ranks."""
        found = np.concatenate([self.at[: self.normal_rows], self.compliant])
        return np.asarray(found[found >= 0])

    @staticmethod
    def of(system: System, surface: DelassusOperator, only: Ints | None = None) -> ContactCoordinates:
        """From the rows N of a surface problem; collective.

        Args:
            system: the bodies.
            surface: their rows.
            only: numbers of the coordinates (k,) that are rows: other motions of their nodes stay the node's own, and
                other nodes as they are; None: all.

        Raises:
            SolverError: the rows of a node depend on each other, or nodes are each other's masters.
        """
        failure: SolverError | None = None
        try:
            known = _Known.of_rank(system, surface, only)
        except SolverError as error:
            failure = error
        for each in system.mesh.comm.allgather(failure):
            if each is not None:
                raise each
        comm, own, count = system.mesh.comm, known.own, surface.N.shape[0]
        mine = np.flatnonzero((known.owner >= 0) & (known.of < count))
        mine = mine[own(known.node[known.owner[mine]])]
        at = np.full(count, -1, PETSc.IntType)
        at[of_all_ranks(comm, known.of[mine])] = of_all_ranks(comm, known.at[mine])
        blocks = known.node[known.slaves, None] * known.dim + np.arange(known.dim)
        return ContactCoordinates(
            numbers=known.numbers.ravel(),
            rows=known.rows,
            at=at,
            compliant=known.at[known.of >= count],
            signs=known.signs[own(known.node[known.slaves])],
            T=_distributed(system, known.change, known.numbers),
            inverse=_distributed(system, known.inverse, known.numbers),
            blocks=blocks[own(known.node[known.slaves])],
            alone=bool(comm.allreduce(known.alone, op=MPI.LAND)),
            normal_rows=surface.normal_rows,
        )


@dataclass(frozen=True, kw_only=True)
class _Known:
    """The change of basis on the n contact nodes of this rank and of those that they are coupled to."""

    dim: int
    own: Callable[[Ints], Bools]  # which nodes are of this rank
    node: Ints  # (n,) increasing, in the numbers of the free displacements by d
    of: Ints  # (r,) its rows; those beyond the rows of the surface problem are normal motions of compliant faces
    owner: Ints  # (r,) the slave node that each belongs to, an index into `node`; -1: none
    at: Ints  # (r,) number of each row's coordinate; -1: none
    slaves: Ints  # (m,) slave nodes, indices into `node`
    signs: Array  # (m, d)
    change: Sparse  # (n d, n d), T
    inverse: Sparse  # (n d, n d)
    rows: Sparse  # see `ContactCoordinates`
    alone: bool

    @property
    def numbers(self) -> Ints:
        """Numbers (n, d) of the coordinates."""
        return np.asarray(self.node[:, None] * self.dim + np.arange(self.dim))

    @staticmethod
    def of_rank(system: System, surface: DelassusOperator, only: Ints | None) -> _Known:
        """See `ContactCoordinates.of`; no communication."""
        dim, dofs = system.mesh.dim, system.interface.dofs
        more, compliant = [_normal_motion(system, c) for c in system.contacts], _compliant(system)
        N = surface.N[:, : len(dofs)]
        count, N = N.shape[0], sparse.vstack([N, *more], format="csr") if compliant else N
        node, of_dof = np.unique(dofs // dim, return_inverse=True)
        sides = [np.zeros(0, np.int64), *(system.constraints.roots(c.surface.nodes) for c in system.contacts)]
        rows = np.arange(N.shape[0])
        if system.mesh.comm.size > 1 and not compliant:
            slave = np.isin(node, np.concatenate(sides))
            rows = _coupled(N, of_dof, slave, slave & system.constraints.is_own(node))
            N = N[rows]
            touched = np.zeros(len(node), bool)
            touched[of_dof[N.indices]] = True
            touched |= system.constraints.is_own(node)
            node, of_dof = node[touched], (np.cumsum(touched) - 1)[of_dof]
        known = np.unique(N.indices)
        padded = (np.ones(len(known)), (known, of_dof[known] * dim + dofs[known] % dim))
        N = (N @ sparse.csr_matrix(padded, shape=(len(dofs), node.size * dim))).tocsr()
        owner = _owners(N, node, _spans(system, more), rows, sides)
        if only is not None:
            owner[~np.isin(node[owner], only // dim)] = -1
        chosen = np.flatnonzero(owner >= 0)
        chosen = chosen[np.argsort(owner[chosen], kind="stable")]
        own, first, counts = np.unique(owner[chosen], return_index=True, return_counts=True)
        if counts.max(initial=0) > dim:
            raise SolverError(f"a contact node has {counts.max()} rows in {dim}D")
        slot = own.repeat(counts) * dim + np.arange(len(chosen)) - first.repeat(counts)  # as in `numbers`, flat
        slot, blocks, coupling, inverse = _measured(N, chosen, slot, own, counts, dim)
        at = np.full(len(owner), -1)
        at[chosen] = node[slot // dim] * dim + slot % dim
        if only is not None:
            rows_alone = np.isin((node[:, None] * dim + np.arange(dim)).ravel(), only)
            coupling = (sparse.diags(rows_alone.astype(float)) @ coupling).tocsr()
            coupling.eliminate_zeros()
        change = _inverse(inverse, coupling)
        coupled, slave = change.tocoo(), np.isin(np.arange(len(node)), own)
        return _Known(
            dim=dim,
            own=system.constraints.is_own,
            node=node,
            of=rows,
            owner=owner,
            at=at,
            slaves=own,
            signs=np.where(inverse.diagonal()[own[:, None] * dim + np.arange(dim)] < 0, -1.0, 1.0),
            change=change,
            inverse=blocks + coupling,
            rows=(N[:count] @ change).tocsr() if compliant else sparse.csr_matrix((0, change.shape[1])),
            alone=bool(slave[coupled.col[slave[coupled.row // dim]] // dim].all()),
        )


def _compliant(system: System) -> bool:
    return any(c.normal.at_quadrature for c in system.contacts)


def _coupled(N: Sparse, of_dof: Ints, slave: Bools, own: Bools) -> Ints:
    """The rows that touch own slave nodes, or slave nodes that such rows touch, and so on.

    Args:
        N: (rows, c).
        of_dof: (c,) node of each contact dof.
        slave: (nodes,) slave nodes.
        own: (nodes,) this rank's.
    """
    pattern = sparse.csr_matrix((np.ones(N.nnz, np.int8), N.indices, N.indptr), shape=N.shape)
    nodes, found = own, np.zeros(N.shape[0], bool)
    while nodes.any():
        more = (pattern[~found] @ nodes[of_dof].astype(np.int8)) != 0
        new = np.flatnonzero(~found)[more]
        found[new] = True
        nodes = np.zeros(len(slave), bool)
        nodes[of_dof[pattern[new].indices]] = True
        nodes &= slave
        if not len(new):
            break
    return np.flatnonzero(found)


def _spans(system: System, more: list[Sparse]) -> list[tuple[int, int, bool]]:
    """Blocks of rows: how many, index of their contact, and whether they are compliant and have no coordinates."""
    kinds = [(len(c.W_n), k, c.normal.at_quadrature) for k, c in enumerate(system.contacts)]
    kinds += [(c.free.size, k, False) for k, c in enumerate(system.contacts)]
    return kinds + [(rows.shape[0], k, False) for k, rows in enumerate(more)]


def _owners(N: Sparse, node: Ints, spans: list[tuple[int, int, bool]], rows: Ints, sides: list[Ints]) -> Ints:
    """The slave node (r,) that each row belongs to, an index into `node`; -1: it has none, or is compliant.

    Args:
        N: (r, n d).
        node: (n,).
        spans: see `_spans`.
        rows: (r,) their numbers, increasing.
        sides: slave nodes of each contact, after an empty array.
    """
    entries, dim = N.tocoo(), N.shape[1] // max(len(node), 1)
    size = sparse.csr_matrix((entries.data**2, (entries.row, entries.col // dim)), shape=(N.shape[0], len(node)))
    owner, last = np.full(N.shape[0], -1), 0
    for count, contact, compliant in spans:
        first, last = last, last + count
        span = slice(*np.searchsorted(rows, (first, last)).tolist())
        known = span.stop - span.start
        if known and not compliant:
            slaves = np.isin(node, sides[1 + contact]).astype(float)
            often = np.maximum(np.asarray((size[span] != 0).sum(axis=0)).ravel(), 1)  # a node without rows is shared
            part = (size[span] @ sparse.diags(slaves / often**2)).tocoo()
            order = np.lexsort((-part.col, part.data, part.row))
            ends = order[np.flatnonzero(np.diff(part.row[order], append=known))]  # the largest entry of each row
            ends = ends[part.data[ends] > 0]
            owner[span.start + part.row[ends]] = part.col[ends]
    return owner


def _normal_motion(system: System, c: ContactRows) -> Sparse:
    """Normal relative displacement of the slave's nodes (m, c), where pressure acts elsewhere; none else.

    As coordinates they are small where the faces are stiff, as those of rigid laws are.
    """
    whole = system.constraints.bases(c.surface.nodes)[1].all(axis=1) & (c.node_weights > 0)
    nodes = np.flatnonzero(whole & c.normal.at_quadrature)
    first = np.unique(system.constraints.roots(c.surface.nodes[nodes]), return_index=True)[1]
    nodes = nodes[np.sort(first)]
    return along(c.relative[nodes], c.frames[nodes, :1]) @ system.interface.trace(c)


def _measured(
    N: Sparse, rows: Ints, slot: Ints, own: Ints, count: Ints, dim: int
) -> tuple[Ints, Sparse, Sparse, Sparse]:
    """T^-1 on the contact nodes: of nodes by themselves, of one to another, the inverse of the former.

    Multigrid knows a coordinate by its place in its node: each stands in that of the axis that it is nearest to.

    Args:
        N: (rows, n d).
        rows: those with a coordinate, by node.
        slot: their coordinates, in any order in a node.
        own: slave nodes (m,).
        count: number of rows of each.

    Returns:
        The coordinates of the rows, in their places, and three matrices (n d, n d).
    """
    size = N.shape[1]
    place = np.zeros(size // dim, np.int64)
    place[own] = np.arange(len(own))
    entries = N[rows].tocoo()
    i, j = slot[entries.row], entries.col
    inside = j // dim == i // dim
    measured = np.zeros((len(own), dim, dim))
    measured[place[i[inside] // dim], i[inside] % dim, j[inside] % dim] = entries.data[inside]
    for k in range(1, dim):  # motions that k rows do not measure
        few = np.flatnonzero(count == k)
        measured[few, k:] = np.linalg.svd(measured[few, :k])[2][:, k:]
    sizes = np.linalg.svd(measured, compute_uv=False)
    # smallest singular value of a node's rows, relative to the largest
    if np.any(sizes[:, -1] <= SLIGHT * sizes[:, 0]):
        raise SolverError("the contact rows of a node are nearly the same")
    by_axis = _nearest(measured)
    measured = np.take_along_axis(measured, by_axis[:, :, None], axis=1)
    axis = np.argsort(by_axis, axis=1)
    slot = slot // dim * dim + axis[place[slot // dim], slot % dim]
    i = slot[entries.row]
    numbers, others = own[:, None] * dim + np.arange(dim), np.ones(size)
    others[numbers] = 0.0
    a, b = (np.broadcast_to(x, measured.shape).ravel() for x in (numbers[:, :, None], numbers[:, None, :]))

    def whole(values: Array) -> Sparse:
        return (sparse.csr_matrix((values.ravel(), (a, b)), shape=(size, size)) + sparse.diags(others)).tocsr()

    coupling = sparse.csr_matrix((entries.data[~inside], (i[~inside], j[~inside])), shape=(size, size))
    return slot, whole(measured), coupling, whole(np.linalg.inv(measured))


def _nearest(measured: Array) -> Ints:
    """The coordinate (m, d) that is nearest to each axis, each once, of motions (m, d, d) by coordinate and axis."""
    dim = measured.shape[1]
    orders = np.array(list(permutations(range(dim))))
    size = np.abs(measured) / np.linalg.norm(measured, axis=2)[:, :, None]
    found = np.array([size[:, order, range(dim)].sum(axis=1) for order in orders])
    return np.asarray(orders[found.argmax(axis=0)])


def _inverse(inverse: Sparse, coupling: Sparse) -> Sparse:
    """The inverse of the sum D + O of nodes by themselves and what couples them: D^-1 - D^-1 O D^-1 + ...

    It ends with the last of nodes coupled in a chain, or, where normals turn between nodes, in rounding.

    Args:
        inverse: D^-1.
        coupling: O.
    """
    found = term = inverse
    for _ in range(40):  # chain of slave nodes, each coupled to the next
        term = (inverse @ (coupling @ term)).tocsr()
        term.data = np.where(np.abs(term.data) > LAST_DIGITS, -term.data, 0.0)  # entries of T; its largest are about 1
        term.eliminate_zeros()
        if not term.nnz:
            return found
        found = (found + term).tocsr()
    raise SolverError("contact nodes are each other's masters")


def _distributed(system: System, change: Sparse, numbers: Ints) -> Mat:
    """T over the free displacements, from that on the contact nodes; collective."""
    K = system.K_B
    (low, high), total, numbers = K.getOwnershipRange(), K.getSize()[0], numbers.ravel()
    mine = (numbers >= low) & (numbers < high)
    rest = np.ones(high - low)
    rest[numbers[mine] - low] = 0.0
    rows = change[np.flatnonzero(mine)].tocoo()
    same = np.flatnonzero(rest)
    i = np.concatenate([same, (numbers[mine] - low)[rows.row]])
    j = np.concatenate([same + low, numbers[rows.col]])
    entries = sparse.csr_matrix((np.concatenate([np.ones(len(same)), rows.data]), (i, j)), shape=(high - low, total))
    return from_rows(entries, K.getSizes(), K.comm, system.mesh.dim)
