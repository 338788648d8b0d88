"""Friction on a rigid plane in plain UFL, dolfinx and PETSc: `python dolfinx_by_hand.py problem.json lu|gamg`.

What one writes without stickslip. Contact is a penalty, friction an elastic stick that Coulomb's limit cuts off (the
return mapping of plasticity), both integrated at the nodes of the base; SNES solves each step on the whole volume, by
MUMPS, or by GMRES with GAMG. Prints one line of JSON. Penetration and creep are 1/PENALTY of the block's compression.
"""

import json
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

if find_spec("dolfinx_solver"):  # PyPI's dolfinx loads its MPI first
    import dolfinx_solver  # noqa: F401
import dolfinx
import gmsh
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc

PENALTY = 1e4  # stiffness of contact and stick, in units of E / height
SOLVERS = {
    "lu": {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps", "mat_mumps_icntl_7": 5},
    "gamg": {
        "ksp_type": "gmres",
        "ksp_gmres_restart": 100,
        "ksp_max_it": 500,
        "ksp_rtol": 1e-6,
        "pc_type": "gamg",
        "mg_levels_ksp_type": "chebyshev",
        "mg_levels_pc_type": "sor",
    },
}
NODES = {  # corners of a facet, with equal weights
    2: {"quadrature_points": [[0.0], [1.0]], "quadrature_weights": [0.5, 0.5]},
    3: {"quadrature_points": [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], "quadrature_weights": [0.25] * 4},
}


def read_mesh(path: Path, dim: int) -> tuple[Any, Any]:
    """The mesh, and the tags of its facets: base and top are 2 d - 1 and 2 d."""
    gmsh.initialize(["", "-v", "0"])
    gmsh.open(str(path))  # 0.5.2 has a function for files that fails
    if find_spec("dolfinx.io.gmshio"):
        from dolfinx.io import gmshio

        found = gmshio.model_to_mesh(gmsh.model, MPI.COMM_SELF, 0, gdim=dim)
    else:
        from dolfinx.io import gmsh as gmsh_io

        read = gmsh_io.model_to_mesh(gmsh.model, MPI.COMM_SELF, 0, gdim=dim)
        found = read.mesh, read.cell_tags, read.facet_tags
    gmsh.finalize()
    return found[0], found[2]


def vector_space(mesh: Any) -> Any:
    """Continuous piecewise linear displacements."""
    if hasattr(fem, "functionspace"):
        return fem.functionspace(mesh, ("Lagrange", 1, (mesh.geometry.dim,)))
    return fem.VectorFunctionSpace(mesh, ("Lagrange", 1))


class Block:
    """Forms, matrix and solver of the block on the plane."""

    def __init__(self, given: dict[str, Any], mesh: Any, facets: Any, solver: str) -> None:
        self.dim = dim = int(given["dim"])
        base, top = 2 * dim - 1, 2 * dim
        E, nu, mu = given["E"], given["nu"], given["mu"]
        self.V = V = vector_space(mesh)
        self.u, self.before = fem.Function(V), fem.Function(V)
        v, du = ufl.TestFunction(V), ufl.TrialFunction(V)
        eps = ufl.sym(ufl.grad(self.u))
        sigma = E / (1 + nu) * (eps + nu / (1 - 2 * nu) * ufl.tr(eps) * ufl.Identity(dim))
        ds = ufl.Measure("ds", mesh, subdomain_data=facets, metadata={"quadrature_rule": "custom"} | NODES[dim])(base)

        stiffness = fem.Constant(mesh, PENALTY * E / given["height"])
        x, slip = ufl.SpatialCoordinate(mesh), self.u - self.before
        self.gap = x[dim - 1] + self.u[dim - 1]
        p = ufl.max_value(-stiffness * self.gap, 0)
        trial = stiffness * ufl.as_vector([slip[k] for k in range(dim - 1)])
        size = ufl.sqrt(ufl.dot(trial, trial) + 1e-30)
        t = trial * ufl.conditional(ufl.le(size, mu * p), 1, mu * p / size)

        F = ufl.inner(sigma, ufl.grad(v)) * ufl.dx - p * v[dim - 1] * ds + sum(t[k] * v[k] for k in range(dim - 1)) * ds
        self.F, self.J = fem.form(F), fem.form(ufl.derivative(F, self.u, du))
        self.forces = [fem.form(force * ds) for force in (p, *(t[k] for k in range(dim - 1)))]
        self.top = fem.locate_dofs_topological(V, dim - 1, facets.find(top))
        self.base = fem.locate_dofs_topological(V, dim - 1, facets.find(base))
        self.held = [fem.dirichletbc(np.zeros(dim), self.top, V)]
        self.matrix = petsc.create_matrix(self.J)
        self.matrix.setBlockSize(dim)
        self.matrix.setNearNullSpace(self.rigid_motions())
        self.snes = self.newton(solver)

    def rigid_motions(self) -> Any:
        """Translations and rotations: GAMG's coarse spaces need them."""
        x, dim = self.V.tabulate_dof_coordinates(), self.dim
        motions = [np.tile(axis, (len(x), 1)) for axis in np.eye(dim)]
        for i in range(dim):
            for j in range(i):
                motions.append(np.outer(x[:, j], np.eye(dim)[i]) - np.outer(x[:, i], np.eye(dim)[j]))
        q, _ = np.linalg.qr(np.stack([motion.ravel() for motion in motions], axis=1))
        return PETSc.NullSpace().create(vectors=[PETSc.Vec().createWithArray(column.copy()) for column in q.T])

    def newton(self, solver: str) -> Any:
        """SNES on the whole volume."""
        snes, options = PETSc.SNES().create(MPI.COMM_SELF), PETSc.Options("hand_")
        for key, value in (
            {"snes_type": "newtonls", "snes_linesearch_type": "basic", "snes_divergence_tolerance": -1}
            | SOLVERS[solver]
        ).items():
            options[key] = value
        snes.setOptionsPrefix("hand_")
        self.residual = self.matrix.createVecRight()
        snes.setFunction(self.assemble_residual, self.residual)
        snes.setJacobian(self.assemble_tangent, self.matrix)
        snes.setTolerances(rtol=1e-8, atol=1e-12, stol=0.0, max_it=50)
        snes.setFromOptions()
        return snes

    def assemble_residual(self, snes: Any, q: Any, R: Any) -> None:
        """Nodal forces [N] that are left; 0 where the displacement is prescribed."""
        self.u.x.array[:] = q.array_r
        with R.localForm() as local:
            local.set(0.0)
        petsc.assemble_vector(R, self.F)
        R.array.reshape(-1, self.dim)[self.top] = 0.0

    def assemble_tangent(self, snes: Any, q: Any, J: Any, P: Any) -> None:
        """Their derivative."""
        self.u.x.array[:] = q.array_r
        P.zeroEntries()
        petsc.assemble_matrix(P, self.J, bcs=self.held)
        P.assemble()

    def step(self, motion: list[float]) -> dict[str, float]:
        """Move the top, and solve: forces [N], penetration [m], iterations."""
        self.before.x.array[:] = self.u.x.array
        self.u.x.array.reshape(-1, self.dim)[self.top] = motion
        q = PETSc.Vec().createWithArray(self.u.x.array.copy())
        self.snes.solve(None, q)
        if self.snes.getConvergedReason() <= 0:
            raise SystemExit(f"SNES does not converge: reason {self.snes.getConvergedReason()}")
        self.u.x.array[:] = q.array_r
        return {"iterations": self.snes.getIterationNumber(), "linear_iterations": self.snes.getLinearSolveIterations()}

    def reactions(self) -> dict[str, float]:
        """Normal and tangential force [N] on the block, and the deepest penetration [m]."""
        normal, *tangential = (fem.assemble_scalar(force) for force in self.forces)
        depth = -self.u.x.array.reshape(-1, self.dim)[self.base, self.dim - 1].min()
        return {
            "normal_force": float(normal),
            "tangential_force": float(np.linalg.norm(tangential)),
            "penetration": float(max(depth, 0.0)),
        }


def peak() -> float:
    """Largest memory of this process so far [GB]; `ru_maxrss` knows what its parent had."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e9


def main(path: Path, solver: str) -> dict[str, Any]:
    """Solve the problem of a file. Seconds [s] of the processor: assembly and solution, without mesh and compiler."""
    given = json.loads(path.read_text())
    mesh, facets = read_mesh(path.with_name("mesh.msh"), given["dim"])
    block = Block(given, mesh, facets, solver)
    began, steps = time.process_time(), []
    for motion in given["motion"]:
        counts = block.step(motion)
        steps.append(counts | block.reactions())
    return {
        "program": "dolfinx by hand",
        "version": dolfinx.__version__,
        "seconds": time.process_time() - began,
        "memory": peak(),
        "dofs": len(block.u.x.array),
        "steps": steps,
    }


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]), sys.argv[2])))
