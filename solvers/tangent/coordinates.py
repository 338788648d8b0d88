"""Contact coordinates: a basis of the free displacements in which relative displacements are unknowns of their own.

u = T v: at a slave node v has the relative displacements w of its rows, and the motions that no row measures; at all
others v = u. As the multipliers are dual, T is sparse: u_s = w + P u_m on a mortar, and a turned frame on an obstacle.
Forces on v are T^T times those on u; those of tractions p are W p at the rows, and zero elsewhere.

Source: Hüeber & Wohlmuth, Comput. Methods Appl. Mech. Engrg. 194 (2005), of the change of basis.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.errors import SolverError
from stickslip.geometry.protocols import Mat, Sparse
from stickslip.solvers.contact.build import along
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.flexibility import DelassusOperator
from stickslip.solvers.system.system import System

SINGULAR = 1e-3  # smallest singular value of a node's rows, relative to the largest
LONGEST = 40  # chain of slave nodes, each coupled to the next
ROUNDED = 1e-14  # entries of T; its largest are about 1


@dataclass(frozen=True)
class ContactCoordinates:
    """The basis T, and where the rows are in it."""

    T: Mat  # (free, free), distributed as the free displacements
    inverse: Mat  # its inverse: the rows N, and the motions that they do not measure
    numbers: Ints  # (n d,) of the coordinates of all contact nodes
    rows: Sparse  # (rows, n d) relative displacements by these coordinates, N T
    blocks: Ints  # (m, d) numbers of the coordinates of the m slave nodes, increasing
    at: Ints  # (rows,) number of each row's coordinate; -1: the row carries nothing, or is compliant
    normal: Ints  # numbers of the coordinates that are normal relative displacements
    signs: Array  # (m, d) of T's diagonal at the slave nodes: each coordinate stands in the place of the nearest axis
    alone: bool  # whether T couples slave nodes to each other only: no bodies on the other side

    @staticmethod
    def of(system: System, surface: DelassusOperator, only: Ints | None = None) -> ContactCoordinates:
        """From the rows N of a surface problem; the same on every rank, but for T.

        Args:
            system: the bodies.
            surface: their rows.
            only: slave nodes (k,), in the numbers of the free displacements by d, that are changed; None: all.

        Raises:
            SolverError: the rows of a node depend on each other, or nodes are each other's masters.
        """
        dim, dofs = system.mesh.dim, system.interface.dofs
        node, of_dof = np.unique(dofs // dim, return_inverse=True)
        padded = (np.ones(len(dofs)), (np.arange(len(dofs)), of_dof * dim + dofs % dim))
        padding = sparse.csr_matrix(padded, shape=(len(dofs), node.size * dim))
        rows_N = surface.N[:, : len(dofs)] @ padding
        N = sparse.vstack([rows_N, *(_normal_motion(system, c) @ padding for c in system.contacts)], format="csr")
        owner, numbers = _owners(system, N, node), node[:, None] * dim + np.arange(dim)
        if only is not None:
            owner[~np.isin(node[owner], only)] = -1
        rows = np.flatnonzero(owner >= 0)
        rows = rows[np.argsort(owner[rows], kind="stable")]
        own, first, count = np.unique(owner[rows], return_index=True, return_counts=True)
        if count.max(initial=0) > dim:
            raise SolverError(f"a contact node has {count.max()} rows in {dim}D")
        slot = own.repeat(count) * dim + np.arange(len(rows)) - first.repeat(count)  # as in `numbers`, flat
        slot, blocks, coupling, inverse = _measured(N, rows, slot, own, count, dim)
        at = np.full(len(owner), -1)
        at[rows] = numbers.ravel()[slot]
        normal = np.concatenate([at[: surface.normal_rows], at[rows_N.shape[0] :]])
        change = _inverse(inverse, coupling)
        coupled, slave = change.tocoo(), np.isin(np.arange(len(node)), own)
        return ContactCoordinates(
            numbers=numbers.ravel(),
            rows=(rows_N @ change).tocsr(),
            at=at[: rows_N.shape[0]],
            normal=normal[normal >= 0],
            signs=np.where(inverse.diagonal()[own[:, None] * dim + np.arange(dim)] < 0, -1.0, 1.0),
            T=_distributed(system, change, numbers),
            inverse=_distributed(system, blocks + coupling, numbers),
            blocks=numbers[own],
            alone=bool(slave[coupled.col[slave[coupled.row // dim]] // dim].all()),
        )


def _owners(system: System, N: Sparse, node: Ints) -> Ints:
    """The slave node (rows,) that each row belongs to, an index into `node`; -1: it has none, or is compliant."""
    entries, dim = N.tocoo(), system.mesh.dim
    size = sparse.csr_matrix((entries.data**2, (entries.row, entries.col // dim)), shape=(N.shape[0], len(node)))
    kinds = [(len(c.W_n), c, c.normal.at_quadrature) for c in system.contacts]
    kinds += [(c.free.size, c, False) for c in system.contacts]
    kinds += [(_normal_motion(system, c).shape[0], c, False) for c in system.contacts]
    owner, first = np.full(N.shape[0], -1), 0
    for count, c, compliant in kinds:
        span = slice(first, first + count)
        first += count
        if count and not compliant:
            slaves = np.isin(node, system.constraints.roots(c.surface.nodes)).astype(float)
            often = np.maximum(np.asarray((size[span] != 0).sum(axis=0)).ravel(), 1)  # a node without rows is shared
            part = (size[span] @ sparse.diags(slaves / often**2)).tocoo()
            order = np.lexsort((-part.col, part.data, part.row))
            last = order[np.flatnonzero(np.diff(part.row[order], append=count))]  # the largest entry of each row
            last = last[part.data[last] > 0]
            owner[first - count + part.row[last]] = part.col[last]
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
    if np.any(sizes[:, -1] <= SINGULAR * sizes[:, 0]):
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
        found: Sparse = (sparse.csr_matrix((values.ravel(), (a, b)), shape=(size, size)) + sparse.diags(others)).tocsr()
        return found

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
    """The inverse of the sum D + O of nodes by themselves and what couples them: D^-1 - D^-1 O D^-1 + ..., which ends.

    Args:
        inverse: D^-1.
        coupling: O.
    """
    found = term = inverse
    for _ in range(LONGEST):
        term = (inverse @ (coupling @ term)).tocsr()
        term.data = np.where(np.abs(term.data) > ROUNDED, -term.data, 0.0)
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
    csr = (entries.indptr.astype(PETSc.IntType), entries.indices.astype(PETSc.IntType), entries.data)
    found: Mat = PETSc.Mat().createAIJ(K.getSizes(), bsize=system.mesh.dim, csr=csr, comm=K.comm)
    found.assemble()
    return found
