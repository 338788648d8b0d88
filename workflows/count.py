"""What a scene's mesh holds: the counts behind `stickslip plan --mesh`."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from mpi4py import MPI

from geometry.mesh import build_mesh
from geometry.nodes import Nodes
from solvers.choice import Choice, Size, chosen
from solvers.memory import available
from solvers.nouns.scene import Scene
from solvers.supports import find_constraints
from solvers.system import contact_rows, displacement_space
from workflows.mesh_report import MeshReport, report_mesh


def look(scene: Scene) -> tuple[MeshReport, Choice, int]:
    """The mesh report, what solves it, and how many displacements are unknown; meshes, but assembles nothing."""
    mesh = build_mesh(scene.geometry, scene.request(), MPI.COMM_WORLD)
    space = displacement_space(mesh)
    nodes = Nodes.of(mesh, space)
    constraints = find_constraints(scene, mesh, space, nodes)
    contacts = contact_rows(scene, mesh, space, nodes, constraints)
    report = report_mesh(scene, mesh, nodes.total, contacts)
    return report, chosen(Size.of(mesh, constraints, contacts), scene.solver, available()), constraints.free_total


def count(scene: Scene) -> dict[str, Any]:
    """Cells, nodes, unknowns, quality, and each contact's points, area and gap."""
    report, choice, unknown = look(scene)
    return {
        **asdict(report),
        "displacement_unknowns": unknown,
        "method": choice.stages[0].method,
        "choice": {**asdict(choice.stages[0]), "because": choice.because},
        "warnings": list(report.warnings()),
    }
