"""A mesh of several parts that share no node: contact can hold one part only, the others need supports."""

from __future__ import annotations

from dataclasses import replace

from geometry.errors import SceneError
from geometry.mesh import Mesh
from solvers.constraints import Constraints


def refuse_loose_parts(constraints: Constraints, mesh: Mesh) -> None:
    """Collective.

    Raises:
        SceneError: a part that can move as a whole, whatever else holds it.
    """
    if mesh.parts is None:
        return
    nodes, (low, high) = constraints.nodes, mesh.box()
    own = [n for n in range(nodes.owned) if int(nodes.number[n]) in constraints.points]
    offers = mesh.comm.allgather({int(nodes.number[n]): int(mesh.parts[nodes.input[n]]) for n in own})
    part_of = {node: part for offer in offers for node, part in offer.items()}
    for part in range(int(mesh.parts.max()) + 1):
        rows = {node: r for node, r in constraints.rows.items() if part_of[node] == part}
        root = {s: m for s, m in constraints.root.items() if part_of[s] == part_of[m] == part}
        if replace(constraints, rows=rows, root=root).rigid_motions(low, high).shape[1]:
            raise SceneError(
                f"supports: the mesh falls into {mesh.parts.max() + 1} parts that share no node, and supports alone "
                "must hold each of them; one can move as a whole"
            )
