"""The peers: which there are, where they are installed, and one measurement of each in a process of its own.

The problem of the price benchmark is written to files that any program can read: problem.json, mesh.msh and mesh.npz.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Literal

import meshio
import numpy as np

from stickslip import Builder, Coulomb, Material, Scene, Steps
from stickslip.geometry.amplitude import Amplitude, value_at
from stickslip.geometry.arrays import Array
from stickslip.geometry.builders.cuboid import Block
from stickslip.geometry.mesh.mesh import write_msh
from stickslip.solvers.effects.bolts import Bolt
from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.lab.benchmarks.own_process import Run, child, kept
from stickslip.workflows.lab.benchmarks.price_run import OURS, PEERS, Case

HERE = Path(__file__).parent
PYTHONS = (sys.executable, "/usr/bin/python3", "results/peers/bin/python")  # Debian's packages are the second one's
AXES: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")
CELLS = ("quad", "triangle", "quad9", "triangle6", "hexahedron", "tetra", "hexahedron27", "tetra10")
TWO = Steps(end=2.0, count=2)  # pressing and shifting
FACETS = {2: ("line", "line3"), 3: ("quad", "triangle", "quad9", "triangle6")}


def write_problem(scene: Scene, folder: Path) -> Path:
    """Write the mesh and the data of a scene of one body and one obstacle into a folder; the path of problem.json.

    The obstacle is the plane where the last coordinate is 0, or a cylinder around the origin, and does not move. What
    is held is moved in equal steps. mesh.npz has `points` (nodes, d) [m], `cells` and the base's `facets` in the node
    order of gmsh, and the nodes `base` and `top`; all numbers of nodes begin with 0. Cells with straight sides are
    written with their corners alone.
    """
    folder.mkdir(parents=True, exist_ok=True)
    mesh_file, dim, shape = folder / "mesh.msh", scene.dim, scene.geometry
    assert isinstance(shape, Builder)  # bodies of builders have both orders
    write_msh(shape.of_order(1) if isinstance(shape, Block) else shape, scene.request(), mesh_file)
    mesh = meshio.read(mesh_file)
    (contact,), (support,), (body,) = scene.contacts.values(), scene.supports.values(), scene.bodies.values()
    names = {"base": contact.surface, "top": support.boundary}
    facet = next(kind for kind in FACETS[dim] if kind in mesh.cells_dict)
    sides = {key: mesh.cells_dict[facet][mesh.cell_sets_dict[name][facet]] for key, name in names.items()}
    points: Array = mesh.points[:, :dim]
    np.savez(
        folder / "mesh.npz",
        points=points,
        cells=mesh.cells_dict[next(kind for kind in CELLS if kind in mesh.cells_dict and kind not in FACETS[dim])],
        facets=sides["base"],
        base=np.unique(sides["base"]),
        top=np.unique(sides["top"]),
    )
    assert isinstance(contact.against, str)
    assert isinstance(body, Material)
    assert isinstance(contact.friction, Coulomb)
    end, count = scene.steps.end, scene.steps.count
    data = (
        names
        | {
            "dim": dim,
            "order": shape.degree,
            "E": body.E,  # [Pa]
            "nu": body.nu,
            "mu": contact.friction.mu,
            "height": float(np.ptp(points[:, -1])),  # [m]
            "radius": getattr(scene.obstacles[contact.against], "radius", 0.0),  # [m] of the cylinder; 0: a plane
            "motion": [  # [m] of the top, by step
                [_at(support.displacement[axis], end * k / count, end) for axis in AXES[:dim]]
                for k in range(1, count + 1)
            ],
        }
    )
    path = folder / "problem.json"
    path.write_text(json.dumps(data, indent=1))
    return path


def write_bolted(scene: Scene, folder: Path) -> Path:
    """Write mesh and data of two plane bodies, upper and lower, and a bolt into a folder; the path of problem.json.

    mesh.npz has `points` (nodes, 2) [m], and for both bodies the `cells` and the nodes of `joint`, `washer` and `end`,
    all by the body's name. The lower body's end is held, the upper one's is moved;
    `motion` has the bolt's shortening and what moves that end, by step [m].
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_msh(scene.geometry, scene.request(), folder / "mesh.msh")
    mesh = meshio.read(folder / "mesh.msh")
    bolts, upper, (contact,) = scene.sections["bolts"], scene.bodies["upper"], scene.contacts.values()
    assert isinstance(bolts, Mapping)
    bolt = bolts["bolt"]
    assert isinstance(bolt, Bolt)
    assert isinstance(upper, Material)
    assert isinstance(contact.friction, Coulomb)
    assert bolt.shortening is not None
    groups = {"upper_joint": contact.surface, "lower_joint": contact.against, "upper_washer": bolt.head}
    groups |= {"lower_washer": bolt.nut, "lower_end": scene.supports["held"].boundary}
    groups |= {"upper_end": scene.supports["pulled"].boundary}
    held, cells = mesh.cell_sets_dict, mesh.cells_dict
    facet, cell = ("line", "triangle") if "line" in cells else ("line3", "triangle6")
    sides = {key: np.unique(cells[facet][held[str(name)][facet]]) for key, name in groups.items()}
    bodies = {f"{name}_cells": cells[cell][held[name][cell]] for name in scene.bodies}
    points: Array = mesh.points[:, :2]
    np.savez(folder / "mesh.npz", points=points, **sides, **bodies)
    pulled, end = scene.supports["pulled"].displacement, scene.steps.end
    times = [end * k / scene.steps.count for k in range(1, scene.steps.count + 1)]
    data = (
        groups
        | {
            "dim": 2,
            "order": scene.geometry.degree,
            "E": upper.E,  # [Pa]
            "nu": upper.nu,
            "mu": contact.friction.mu,
            "height": float(np.ptp(points[sides["upper_end"], 1])),  # [m]
            "washer": float(np.ptp(points[sides["upper_washer"], 0])),  # [m]
            "stiffness": bolt.stiffness,  # [N/m per metre]
            "motion": [
                [_at(bolt.shortening, t, end), *(_at(pulled[axis], t, end) for axis in AXES[:2])] for t in times
            ],
        }
    )
    path = folder / "problem.json"
    path.write_text(json.dumps(data, indent=1))
    return path


def _at(table: Amplitude | str, time: float, end: float) -> float:
    assert not isinstance(table, str)  # an expression: the scene has none
    return value_at(table, time, end)


@dataclass(frozen=True, kw_only=True)
class Program:
    """One way to solve the problem."""

    name: str
    script: str  # beside this file
    arguments: tuple[str, ...] = ()
    needs: str  # a module of Python, or an executable
    executable: bool = False
    install: str
    how: str  # for the page
    growth: tuple[float, float]  # of the time with n in 2D and 3D, to foresee what takes too long
    dims: tuple[int, ...] = (2, 3)

    @cache  # noqa: B019  there are a few of them
    def command(self) -> list[str]:
        """Command that runs it, without arguments; empty if it is not installed."""
        if self.executable:
            return [sys.executable, str(HERE / self.script)] if shutil.which(self.needs) else []
        for python in filter(shutil.which, PYTHONS):
            words = [python, "-c", f"import {self.needs}"]
            if not subprocess.run(words, capture_output=True, env=os.environ | ONE_THREAD, check=False).returncode:
                return [python, str(HERE / self.script)]
        return []


OWN = Program(
    name=OURS,
    script="../price_run.py",
    needs="stickslip",
    install="is this program",
    how="the default of this program",
    growth=(0.0, 0.0),
)
PROGRAMS = (
    Program(
        name="dolfinx by hand, MUMPS",
        script="dolfinx_by_hand.py",
        arguments=("lu",),
        needs="dolfinx",
        install="is ours too",
        how="penalty and return mapping in UFL at the nodes, SNES; MUMPS",
        growth=(2.6, 6.0),
    ),
    Program(
        name="dolfinx by hand, GAMG",
        script="dolfinx_by_hand.py",
        arguments=("gamg",),
        needs="dolfinx",
        install="is ours too",
        how="the same with GMRES and GAMG",
        growth=(2.4, 3.5),
    ),
    Program(
        name="GetFEM",
        script="getfem_peer.py",
        needs="getfem",
        install="Debian: python3-getfem",
        how="integral augmented Lagrangian, multipliers in the traces, Newton; MUMPS",
        growth=(2.6, 6.0),
    ),
    Program(
        name="NGSolve by hand",
        script="ngsolve_peer.py",
        needs="ngsolve",
        install="PyPI: ngsolve, in an environment results/peers",
        how="penalty and return mapping at Gauss points, Newton; UMFPACK",
        growth=(2.6, 6.0),
        dims=(),
    ),
    Program(
        name="FElupe",
        script="felupe_peer.py",
        needs="felupe",
        install="PyPI: felupe, in an environment results/peers",
        how="penalty at nodes, its rigid plane; SciPy's direct solver",
        growth=(2.6, 6.0),
        dims=(),
    ),
    Program(
        name="CalculiX",
        script="calculix_peer.py",
        needs="ccx",
        executable=True,
        install="Debian: calculix-ccx",
        how="face-to-face penalty, stick slope, its default direct solver; its seconds include reading its input",
        growth=(2.6, 6.0),
        dims=(3,),
    ),
)


def measured(folder: Path, dim: int, sizes: Sequence[int], limit: float) -> Iterator[Run]:
    """Ours and all peers on the meshes of one dimension; what has a file is not measured again.

    Args:
        folder: of the benchmark.
        dim: 2 or 3.
        sizes: cells over the height, ascending.
        limit: seconds that a program may be expected to take.
    """
    last: dict[str, Run] = {}
    for n in sizes:
        case = Case(dim, n)
        problem = write_problem(replace(case.scene(), steps=TWO), folder / "peers" / f"{dim}d_{n:03d}")
        for program in (program for program in (OWN, *PROGRAMS) if dim in program.dims):
            name, before = program.name, last.get(program.name)
            command = [*program.command(), *([json.dumps(asdict(case)), PEERS] if program is OWN else [str(problem)])]
            path = problem.parent / f"{name.replace(' ', '_').replace(',', '')}.json"
            if not program.command():
                found: Run = {"status": f"not installed: {program.install}"}
            elif before and "seconds" not in before:
                found = {"status": before["status"]}
            elif before and (expected := before["seconds"] * (n / before["n"]) ** program.growth[dim - 2]) > limit:
                found = {"status": f"not run: {expected:.0f} s expected"}
            else:
                found = kept(path, partial(child, [*command, *program.arguments], limit))
            last[name] = {"dim": dim, "n": n, "name": name} | found
            yield last[name]
