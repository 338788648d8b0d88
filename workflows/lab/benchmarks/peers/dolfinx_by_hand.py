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
from scipy import sparse

PENALTY = 1e4  # stiffness of contact and stick, in units of E / height, unless the problem names one
SIDES = ("upper_joint", "lower_joint", "upper_washer", "lower_washer", "upper_end", "lower_end")
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
NODES = {  # corners of a facet, with equal weights; for quadrilaterals and hexahedra of order 1
    2: {"quadrature_points": [[0.0], [1.0]], "quadrature_weights": [0.5, 0.5]},
    3: {"quadrature_points": [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], "quadrature_weights": [0.25] * 4},
}


def read_mesh(path: Path, dim: int) -> tuple[Any, Any, dict[str, int]]:
    """The mesh, the tags of its facets, and those of its named groups."""
    gmsh.initialize(["", "-v", "0"])
    gmsh.open(str(path))  # 0.5.2 has a function for files that fails
    if find_spec("dolfinx.io.gmshio"):
        from dolfinx.io import gmshio

        found = gmshio.model_to_mesh(gmsh.model, MPI.COMM_SELF, 0, gdim=dim)
    else:
        from dolfinx.io import gmsh as gmsh_io

        read = gmsh_io.model_to_mesh(gmsh.model, MPI.COMM_SELF, 0, gdim=dim)
        found = read.mesh, read.cell_tags, read.facet_tags
    groups = {gmsh.model.getPhysicalName(*group): group[1] for group in gmsh.model.getPhysicalGroups(dim - 1)}
    gmsh.finalize()
    return found[0], found[2], groups


def vector_space(mesh: Any, order: int) -> Any:
    """Continuous displacements, piecewise linear or quadratic."""
    if hasattr(fem, "functionspace"):
        return fem.functionspace(mesh, ("Lagrange", order, (mesh.geometry.dim,)))
    return fem.VectorFunctionSpace(mesh, ("Lagrange", order))


class Block:
    """Forms, matrix and solver of the block on the plane."""

    def __init__(self, given: dict[str, Any], mesh: Any, facets: Any, groups: dict[str, int], solver: str) -> None:
        self.dim = dim = int(given["dim"])
        self.order = order = int(given["order"])
        base, top = groups[given["base"]], groups[given["top"]]
        E, nu, mu, R = given["E"], given["nu"], given["mu"], given["radius"]
        self.V = V = vector_space(mesh, order)
        self.u, self.before = fem.Function(V), fem.Function(V)
        v, du = ufl.TestFunction(V), ufl.TrialFunction(V)
        eps = ufl.sym(ufl.grad(self.u))
        sigma = E / (1 + nu) * (eps + nu / (1 - 2 * nu) * ufl.tr(eps) * ufl.Identity(dim))
        at_nodes = order == 1 and str(mesh.ufl_cell()) in ("quadrilateral", "hexahedron")
        points = {"quadrature_rule": "custom"} | NODES[dim] if at_nodes else {"quadrature_degree": 2 * order}
        ds = ufl.Measure("ds", mesh, subdomain_data=facets, metadata=points)(base)

        self.stiffness = given.get("penalty", PENALTY) * E / given["height"]
        stiffness = fem.Constant(mesh, self.stiffness)
        x, slip = ufl.SpatialCoordinate(mesh), self.u - self.before
        up = ufl.as_vector([0.0] * (dim - 1) + [1.0])
        distance = ufl.sqrt(ufl.dot(x, x))
        gap, n = (distance - R, x / distance) if R else (x[dim - 1], up)
        p = ufl.max_value(-stiffness * (gap + ufl.dot(self.u, n)), 0)
        trial = stiffness * (slip - ufl.dot(slip, n) * n)
        size = ufl.sqrt(ufl.dot(trial, trial) + 1e-30)
        sticks = ufl.le(size, mu * p)
        t = trial * ufl.conditional(sticks, 1, mu * p / size)

        inside = ufl.dx(metadata={"quadrature_degree": 2 * order})
        F = ufl.inner(sigma, ufl.grad(v)) * inside + ufl.dot(t - p * n, v) * ds
        self.F, self.J = fem.form(F), fem.form(ufl.derivative(F, self.u, du))
        area = ufl.conditional(ufl.And(sticks, ufl.gt(p, 0)), 1.0, 0.0)
        self.numbers = [fem.form(value * ds) for value in (p, area, *(t[k] for k in range(dim)))]
        self.top = fem.locate_dofs_topological(V, dim - 1, facets.find(top))
        self.base = fem.locate_dofs_topological(V, dim - 1, facets.find(base))
        nodes = V.tabulate_dof_coordinates()[self.base, :dim]
        far = np.linalg.norm(nodes, axis=1)
        self.gap = far - R if R else nodes[:, dim - 1]
        self.n = nodes / far[:, None] if R else np.eye(dim)[[dim - 1]]
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
            {"snes_type": "newtonls", "snes_linesearch_type": "bt", "snes_divergence_tolerance": -1} | SOLVERS[solver]
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
        """Forces [N], area of stick, deepest penetration [m] and largest pressure [Pa] at the nodes of the base."""
        normal, stick, *tangential = (fem.assemble_scalar(number) for number in self.numbers)
        moved = self.u.x.array.reshape(-1, self.dim)[self.base]
        depth = max(0.0, -float((self.gap + (moved * self.n).sum(axis=1)).min()))
        return {
            "normal_force": float(normal),
            "tangential_force": float(np.linalg.norm(tangential)),
            "stick_area": float(stick),
            "penetration": depth,
            "max_pressure": depth * self.stiffness,
        }


class Plates:
    """Two plates and a bolt: a penalty between opposite nodes of the joint, Newton's method on the whole volume."""

    def __init__(self, given: dict[str, Any], mesh: Any, facets: Any, groups: dict[str, int]) -> None:
        self.mu, E, nu = given["mu"], given["E"], given["nu"]
        self.V = V = vector_space(mesh, given["order"])
        u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
        eps, ds = ufl.sym(ufl.grad(u)), ufl.Measure("ds", mesh, subdomain_data=facets)
        sigma = E / (1 + nu) * (eps + nu / (1 - 2 * nu) * ufl.tr(eps) * ufl.Identity(2))
        matrix = petsc.assemble_matrix(fem.form(ufl.inner(sigma, ufl.grad(v)) * ufl.dx))
        matrix.assemble()
        self.K = sparse.csr_matrix(matrix.getValuesCSR()[::-1])
        where, tags = V.tabulate_dof_coordinates(), {name: groups[given[name]] for name in SIDES}
        self.nodes = {name: fem.locate_dofs_topological(V, 1, facets.find(tag)) for name, tag in tags.items()}
        over, under = (nodes[np.argsort(where[nodes, 0])] for nodes in (self.nodes[name] for name in SIDES[:2]))
        if len(over) != len(under) or abs(where[over] - where[under]).max() > 1e-9:
            raise SystemExit("dolfinx by hand: nodes of the joint are not opposite")
        ends = np.concatenate([self.nodes["upper_end"], self.nodes["lower_end"]])
        self.moved = 2 * self.nodes["upper_end"][:, None] + [0, 1]
        self.free = np.setdiff1d(np.arange(self.K.shape[0]), 2 * ends[:, None] + [0, 1])
        n = 2 * len(over)
        rows, columns = (
            np.tile(np.arange(n), 2),
            np.concatenate([2 * over[:, None] + [0, 1], 2 * under[:, None] + [0, 1]]),
        )
        self.jump = sparse.csr_matrix((np.repeat([1.0, -1.0], n), (rows, columns.ravel())), (n, self.K.shape[0]))
        areas, *washers = (
            petsc.assemble_vector(fem.form(v[1] * ds(tags[name]))).array
            for name in ("upper_joint", "upper_washer", "lower_washer")
        )
        self.spring = given["penalty"] * E / given["height"] * areas[2 * over + 1]
        self.bolt, self.stiffness = (washers[0] - washers[1]) / given["washer"], given["stiffness"]
        self.u, self.before = np.zeros(self.K.shape[0]), np.zeros(n)

    def forces(self, u: Any, shortening: float) -> tuple[Any, Any, Any]:
        """Forces that are left [N/m], those of the joint (nodes, 2), and their derivative (nodes, 2, 2)."""
        jump = self.jump @ u
        slip, gap = (jump - self.before).reshape(-1, 2)[:, 0], jump[1::2]
        P, trial = np.maximum(-self.spring * gap, 0), -self.spring * slip
        sticks, touches = np.abs(trial) <= self.mu * P, P > 0
        joint = np.stack([np.clip(trial, -self.mu * P, self.mu * P), P], axis=1)
        D = np.zeros((len(P), 2, 2))
        D[:, 1, 1] = D[:, 0, 0] = self.spring * touches
        D[~sticks, 0, 0] = 0
        D[~sticks, 0, 1] = (self.mu * np.sign(trial) * self.spring * touches)[~sticks]
        pull = self.stiffness * (self.bolt @ u + shortening)
        return self.K @ u + pull * self.bolt - self.jump.T @ joint.ravel(), joint, D

    def step(self, motion: list[float]) -> dict[str, float]:
        """Shorten the bolt, move the upper plate's end, and solve."""
        shortening, *end = motion
        free, b, k = self.free, self.bolt[self.free], self.stiffness
        self.u[self.moved] = end
        left, joint, D = self.forces(self.u, shortening)
        first = np.linalg.norm(left[free])
        for count in range(100):
            tangent = (self.K + self.jump.T @ sparse.block_diag(D, "csr") @ self.jump)[free][:, free]
            x, y = solve(tangent, left[free], b)  # the bolt's part has rank one: Sherman and Morrison
            change, size, part = x - y * k * (b @ x) / (1 + k * (b @ y)), np.linalg.norm(left[free]), 1.0
            self.u[free] -= change
            left, joint, D = self.forces(self.u, shortening)
            while np.linalg.norm(left[free]) > size and part > 0.1:
                part /= 2
                self.u[free] += part * change
                left, joint, D = self.forces(self.u, shortening)
            if np.linalg.norm(left[free]) < 1e-9 * first:
                self.before, self.drag = self.jump @ self.u, float(abs(joint[:, 0].sum()))
                self.tension = float(k * (self.bolt @ self.u + shortening))
                return {"iterations": count + 1}
        raise SystemExit("dolfinx by hand: Newton's method does not converge in 100 iterations")

    def reactions(self) -> dict[str, float]:
        """Forces per metre [N/m]."""
        return {"tangential_force": self.drag, "bolt.bolt.tension": self.tension}


def solve(matrix: Any, *right: Any) -> list[Any]:
    """Solve with MUMPS for some right sides."""
    A = PETSc.Mat().createAIJ(matrix.shape, csr=(matrix.indptr, matrix.indices, matrix.data), comm=MPI.COMM_SELF)
    ksp, options = PETSc.KSP().create(MPI.COMM_SELF), PETSc.Options("hand_")
    for key, value in SOLVERS["lu"].items():
        options[key] = value
    ksp.setOptionsPrefix("hand_")
    ksp.setOperators(A)
    ksp.setFromOptions()
    found = []
    for values in right:
        x = A.createVecRight()
        ksp.solve(PETSc.Vec().createWithArray(values.copy()), x)
        found.append(x.array.copy())
    ksp.destroy()
    A.destroy()
    return found


def peak() -> float:
    """Largest memory of this process so far [GB]; `ru_maxrss` knows what its parent had."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e9


def main(path: Path, solver: str) -> dict[str, Any]:
    """Solve the problem of a file. Seconds [s] of the processor: assembly and solution, without mesh and compiler."""
    given, started = json.loads(path.read_text()), time.process_time()
    mesh, facets, groups = read_mesh(path.with_name("mesh.msh"), given["dim"])
    read = time.process_time()
    plates = "washer" in given
    block = Plates(given, mesh, facets, groups) if plates else Block(given, mesh, facets, groups, solver)
    began, steps = time.process_time(), []
    for motion in given["motion"]:
        counts = block.step(motion)
        steps.append(counts | block.reactions())
    return {
        "program": "dolfinx by hand",
        "version": dolfinx.__version__,
        "seconds": time.process_time() - began,
        "start": started + began - read,
        "mesh": read - started,
        "memory": peak(),
        "dofs": given["dim"] * len(block.V.tabulate_dof_coordinates()),
        "steps": steps,
    }


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]), sys.argv[2])))
