"""What a scene's mesh holds: the counts behind `stickslip plan --mesh`."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

from geometry.mesh import build_mesh
from geometry.nodes import Nodes
from solvers.constraints import find_constraints
from solvers.nouns.scene import Scene
from solvers.system import contact_rows, displacement_space


def count(scene: Scene) -> dict[str, Any]:
    """Cells, nodes, unknowns, and per contact its points and area; meshes, but assembles nothing."""
    mesh = build_mesh(scene.geometry, scene.request(), MPI.COMM_WORLD)
    space = displacement_space(mesh)
    nodes = Nodes.of(space)
    constraints = find_constraints(scene, mesh, space, nodes)
    return {
        "cells": int(mesh.domain.topology.index_map(mesh.dim).size_global),
        "nodes": nodes.total,
        "displacement_unknowns": constraints.free_total,
        "contacts": {
            c.name: {
                "normal_points": len(c.W_n),
                "tangential_points": len(c.W_t),
                "dropped_multipliers": c.dropped,
                "area": float(c.node_weights.sum()),
                "smallest_gap": float(c.node_gap.min()),
            }
            for c in contact_rows(scene, mesh, space, nodes, constraints)
        },
    }
