"""The peers: which there are, where they are installed, and one measurement of each in a process of its own.

The problem of the price benchmark is written to files that any program can read: problem.json, mesh.msh and mesh.npz.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import meshio
import numpy as np

from stickslip.geometry.amplitude import Amplitude, value_at
from stickslip.geometry.arrays import Array
from stickslip.geometry.mesh.mesh import write_msh
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.scene.material import Material
from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.lab.benchmarks.price_run import Case

OURS = "stickslip"
HERE = Path(__file__).parent
PYTHONS = (sys.executable, "/usr/bin/python3")  # Debian's packages are the second one's
Run = dict[str, Any]
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

    def command(self) -> list[str]:
        """Command that runs it; empty if it is not installed."""
        if self.executable:
            return [sys.executable, str(HERE / self.script), *self.arguments] if shutil.which(self.needs) else []
        for python in PYTHONS:
            if shutil.which(python) and not _quiet([python, "-c", f"import {self.needs}"]):
                return [python, str(HERE / self.script), *self.arguments]
        return []


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
        limit: seconds that a peer may be expected to take.
    """
    ours = [sys.executable, "-m", "stickslip.workflows.lab.benchmarks.peers.ours"]
    commands = {program.name: program.command() for program in PROGRAMS if dim in program.dims}
    growths = {program.name: program.growth[dim - 2] for program in PROGRAMS}
    last: dict[str, Run] = {}
    for n in sizes:
        problem = write_problem(Case(dim, n), folder / "peers" / f"{dim}d_{n:03d}")
        for name, command in ({OURS: ours} | commands).items():
            arguments = [str(dim), str(n)] if name == OURS else command[2:]
            whole = [*command, *arguments] if name == OURS else [*command[:2], str(problem), *arguments]
            path = problem.parent / f"{name.replace(' ', '_').replace(',', '')}.json"
            because = "" if command else "not installed: " + next(p.install for p in PROGRAMS if p.name == name)
            if name in last and "seconds" in last[name]:
                expected = last[name]["seconds"] * (n / last[name]["n"]) ** growths.get(name, 0.0)
                because = because or (f"not run: {expected:.0f} s expected" if expected > limit else "")
            elif name in last:
                because = because or last[name]["status"]
            if because:
                found: Run = {"status": because}
            elif path.exists():
                found = json.loads(path.read_text())
            else:
                found = child(whole, limit)
                write_aside(path, json.dumps(found, indent=1).encode())
            last[name] = {"dim": dim, "n": n, "name": name} | found
            yield last[name]


def child(command: Sequence[str], limit: float, **environment: str) -> Run:
    """The answer of a program on one thread, or why there is none; it is stopped after ten times the limit."""
    whole = os.environ | ONE_THREAD | environment
    try:
        done = subprocess.run(command, capture_output=True, text=True, env=whole, timeout=10 * limit, check=False)
    except subprocess.TimeoutExpired:
        return {"status": f"took more than {10 * limit:g} s"}
    if done.returncode:
        return {"status": (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]}
    found: Run = json.loads(done.stdout.splitlines()[-1])
    return {"status": "converged"} | found


def _quiet(command: Sequence[str]) -> int:
    return subprocess.run(command, capture_output=True, env=os.environ | ONE_THREAD, check=False).returncode
