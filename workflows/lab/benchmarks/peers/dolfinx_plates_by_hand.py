"""Two plates and a bolt with dolfinx, NumPy and PETSc: `python dolfinx_plates_by_hand.py problem.json`.

Contact is a penalty between opposite nodes of the joint, friction an elastic stick that Coulomb's limit cuts off: what
one writes by hand where both meshes fit. Newton's method on the whole volume with MUMPS; a step is halved as long as
the forces grow. Prints one line of JSON; seconds are of the processor.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse

from stickslip.workflows.lab.benchmarks.peers.dolfinx_by_hand import SOLVERS, peak, read_mesh, vector_space

SIDES = ("upper_joint", "lower_joint", "upper_washer", "lower_washer", "upper_end", "lower_end")


class Plates:
    """Stiffness, opposite nodes, and the bolt."""

    def __init__(self, given: dict[str, Any], mesh: Any, facets: Any, groups: dict[str, int]) -> None:
        self.mu, E, nu = given["mu"], given["E"], given["nu"]
        V = vector_space(mesh, given["order"])
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

    def step(self, shortening: float, motion: list[float]) -> dict[str, float]:
        """Shorten the bolt, move the upper plate's end, and solve."""
        free, b, k = self.free, self.bolt[self.free], self.stiffness
        self.u[self.moved] = motion
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
                drag, tension = abs(joint[:, 0].sum()), k * (self.bolt @ self.u + shortening)
                self.before = self.jump @ self.u
                return {"iterations": count + 1, "tangential_force": float(drag), "bolt.bolt.tension": float(tension)}
        raise SystemExit("dolfinx by hand: Newton's method does not converge in 100 iterations")


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


def main(path: Path) -> dict[str, Any]:
    """Solve the problem of a file."""
    given, started = json.loads(path.read_text()), time.process_time()
    mesh, facets, groups = read_mesh(path.with_name("mesh.msh"), 2)
    read = time.process_time()
    plates = Plates(given, mesh, facets, groups)
    began = time.process_time()
    steps = [plates.step(*step) for step in given["steps"]]
    return {
        "program": "dolfinx by hand",
        "version": dolfinx.__version__,
        "seconds": time.process_time() - began,
        "start": started + began - read,
        "mesh": read - started,
        "memory": peak(),
        "dofs": len(plates.u),
        "steps": steps,
    }


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]))))
