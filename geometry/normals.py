"""Which facets have a say in a node's normal, where a side has a crease."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
CREASE = 40.0  # [degrees] smooth sides bend less from facet to facet, edges that are meant as edges more
TIE = 1e-9  # areas that differ by less are equal


def largest_smooth_part(facets: Ints, normals: Array, crease: float) -> NDArray[np.bool_]:
    """Whether a facet is in the smooth part with the largest area at its node (f, k).

    Two facets of a node are smooth together if their normals there differ by no more than `crease` degrees, or if
    others lead from one to the other in such steps. The average over a crease belongs to neither side: a line along
    it leaves the body slantwise and misses the surface that lies against the node's larger side. Of equal parts the
    one with the lowest facet has it.

    Args:
        facets: (f, k) nodes of facets.
        normals: (f, k, d) outward normals, as long as the area.
    """
    node = facets.ravel()
    area = np.linalg.norm(normals, axis=2).ravel()
    direction = normals.reshape(len(node), -1) / area[:, None]
    corners = sparse.csr_matrix((np.ones(len(node)), (np.arange(len(node)), node)))  # of facets, at their nodes
    i, j = (corners @ corners.T).nonzero()
    smooth = np.einsum("cd,cd->c", direction[i], direction[j]) >= np.cos(np.radians(crease)) - TIE
    parts, part = connected_components(sparse.csr_matrix((smooth[smooth], (i[smooth], j[smooth]))), directed=False)
    size = np.bincount(part, area, parts)[part]
    largest = np.zeros(node.max() + 1)
    np.maximum.at(largest, node, size)
    large = np.flatnonzero(size >= (1 - TIE) * largest[node])
    first = np.full(node.max() + 1, len(node))
    np.minimum.at(first, node[large], large)
    return np.asarray(part == part[first[node]]).reshape(facets.shape)
