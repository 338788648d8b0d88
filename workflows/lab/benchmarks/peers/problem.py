"""The problem of the price benchmark as files that any program can read: problem.json, mesh.msh and mesh.npz."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

import meshio
import numpy as np

from stickslip.geometry.amplitude import Amplitude, value_at
from stickslip.geometry.arrays import Array
from stickslip.geometry.mesh.mesh import write_msh
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.scene.material import Material
from stickslip.workflows.lab.benchmarks.price_run import Case

AXES: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")
TIMES = (1.0, 2.0)  # [s] of pressing and shifting
CELLS = {2: ("quad", "line"), 3: ("hexahedron", "quad")}


def write_problem(case: Case, folder: Path) -> Path:
    """Write the mesh and the data of a case into a folder; the path of problem.json.

    mesh.npz has `points` (nodes, d) [m], `cells` and the base's `facets` in the node order of gmsh, and the nodes
    `base` and `top`; all numbers of nodes begin with 0.
    """
    folder.mkdir(parents=True, exist_ok=True)
    scene, mesh_file = case.scene(), folder / "mesh.msh"
    write_msh(scene.geometry, scene.request(), mesh_file)
    mesh, (cell, facet) = meshio.read(mesh_file), CELLS[case.dim]
    sides = {name: mesh.cells_dict[facet][mesh.cell_sets_dict[name][facet]] for name in ("block.bottom", "block.top")}
    points: Array = mesh.points[:, : case.dim]
    np.savez(
        folder / "mesh.npz",
        points=points,
        cells=mesh.cells_dict[cell],
        facets=sides["block.bottom"],
        base=np.unique(sides["block.bottom"]),
        top=np.unique(sides["block.top"]),
    )
    top, body, friction = scene.supports["top"].displacement, scene.bodies["block"], scene.contacts["base"].friction
    assert isinstance(body, Material)
    assert isinstance(friction, Coulomb)
    data = {
        "dim": case.dim,
        "E": body.E,  # [Pa]
        "nu": body.nu,
        "mu": friction.mu,
        "height": float(np.ptp(points[:, -1])),  # [m]
        "motion": [[_at(top[axis], time) for axis in AXES[: case.dim]] for time in TIMES],  # [m] of the top
    }
    path = folder / "problem.json"
    path.write_text(json.dumps(data, indent=1))
    return path


def _at(table: Amplitude | str, time: float) -> float:
    assert not isinstance(table, str)  # an expression: the scene has none
    return value_at(table, time, TIMES[-1])
