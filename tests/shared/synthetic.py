"""Small meshes and step results with random numbers in every field."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import basix
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from stickslip import OPEN, SLIP, STICK, ContactState, Energy, MeshData, Output, ProbeValue, StepResult, read
from stickslip.geometry.arrays import Array
from stickslip.solvers.scene.record import ContactNumbers
from stickslip.workflows.writers.writer import Job

FACET = {"triangle": "interval", "quadrilateral": "interval", "tetrahedron": "triangle", "hexahedron": "quadrilateral"}
SIZE = {"triangle": 1 / 2, "quadrilateral": 1, "tetrahedron": 1 / 6, "hexahedron": 1, "interval": 1}
MESHES = [(shape, order) for shape in FACET for order in (1, 2)]


def reference_nodes(shape: str, order: int) -> Array:
    """The nodes of dolfinx's reference cell, from basix: an answer that our tables do not know."""
    cell = getattr(basix.CellType, shape)
    return np.array(basix.create_element(basix.ElementFamily.P, cell, order, basix.LagrangeVariant.gll_warped).points)


def two_cells(shape: str, order: int) -> tuple[Array, NDArray[np.int64]]:
    """Two reference cells three metres apart."""
    nodes = reference_nodes(shape, order)
    shift = np.eye(nodes.shape[1])[0] * 3.0
    return np.vstack([nodes, nodes + shift]), np.arange(2 * len(nodes)).reshape(2, -1)


def mesh_of(shape: str, order: int = 1) -> MeshData:
    points, cells = two_cells(shape, order)
    on_surface, facets = two_cells(FACET[shape], order)
    flat = np.pad(on_surface, ((0, 0), (0, 1)))  # the plane y = 0 or z = 0
    return MeshData(
        points=points,
        cells=cells,
        shape=shape,
        body=np.array([0, 1]),
        bodies=("left", "right"),
        surfaces={"base": (flat, facets, FACET[shape])},
        slaves={"base": np.array([np.linalg.norm(points - x, axis=1).argmin() for x in flat])},
    )


def result_of(mesh: MeshData, time: float = 0.1 + 0.2, seed: int = 0) -> StepResult:
    """Numbers without a pattern, so that nothing can be mistaken for anything else."""
    random = np.random.default_rng(seed)
    d, n = mesh.points.shape[1], len(mesh.surfaces["base"][0])
    stress = random.normal(size=(len(mesh.cells), 3, 3))
    contact = ContactState(
        points=mesh.surfaces["base"][0],
        weight=random.random(n),
        gap=random.random(n),
        pressure=random.random(n),
        traction=random.normal(size=(n, d)),
        slip=random.normal(size=(n, d)),
        slip_increment=random.normal(size=(n, d)),
        bound=random.random(n),
        lam=random.normal(size=(n, d)),
        status=np.resize(np.array([OPEN, SLIP, STICK], np.int8), n),
        force=np.zeros(d),
        moment=np.zeros(1 if d == 2 else 3),
        **{f.name: 0.0 for f in fields(ContactNumbers) if f.name not in ("force", "moment")},
    )
    return StepResult(
        time=time,
        substeps=1,
        iterations=2,
        volume_solves=3,
        residual=1e-9,
        displacement=random.normal(size=mesh.points.shape),
        stress=stress + stress.transpose(0, 2, 1),
        contacts={"base": contact},
        supports={},
        obstacles={},
        probes={"corner": ProbeValue(random.normal(size=d), stress[0] + stress[0].T)},
        energy=Energy(0.0, 0.0, 0.0, 0.0, np.zeros(1)),
        iteration_error=0.0,
        mesh_error=0.0,
        stress_error=np.zeros(len(stress)),
        law_error=0.0,
        p=random.normal(size=n * d),
        w=random.normal(size=n * d),
        reference=random.normal(size=n * d),
        driven=random.normal(size=1),
        shortened=np.zeros(0),
        searched={},
        memory={},
        p_ref=1.5,
        u_ref=1e-3 / 3,
        history=((time, 1, 0.1, 1, 0.5, "uzawa"), (time, 2, 1e-9, 3, 0.1 + 0.7, "uzawa")),
    )


def job_of(folder: Path, mesh: MeshData, **output: Any) -> Job:
    """A run of the ready scene `block`, whose contact is `base` as well, with these keys of [output]."""
    scene = replace(read("block"), output=Output(**output))
    return Job(folder=folder, scene=scene, mesh=mesh, comm=MPI.COMM_SELF)


def padded(values: Array) -> Array:
    return np.pad(values, ((0, 0), (0, 3 - values.shape[1])))
