"""NGSolve on the block and the cube: `python ngsolve_peer.py problem.json`, with PyPI's ngsolve.

What one writes by hand there: a penalty at Gauss points, friction by return mapping with the same stiffness, Newton's
method with UMFPACK. It stands on grids with straight sides, of any order. Prints one line of JSON; seconds are of the
processor, with assembly, without the mesh.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

import ngsolve as ng
import numpy as np
from netgen.meshing import Element1D, Element2D, Element3D, FaceDescriptor, MeshPoint, Pnt
from netgen.meshing import Mesh as Netgen


def mesh_of(data: Any, dim: int) -> Any:
    """The mesh, whose base and top have names; a facet is outer if it belongs to one cell.

    Args:
        data: mesh.npz.
        dim: 2 or 3.
    """
    points, cells, found = data["points"], data["cells"], Netgen(dim=dim)
    for point in points:
        found.Add(MeshPoint(Pnt(*point, *[0.0] * (3 - dim))))
    body = found.AddRegion("body", dim=dim)
    for cell in cells + 1:
        found.Add((Element2D if dim == 2 else Element3D)(body, cell.tolist()))
    sides = [[0, 1], [1, 2], [2, 3], [3, 0]]
    if dim == 3:
        sides = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    facets = np.concatenate([cells[:, side] for side in sides])
    _, first, count = np.unique(np.sort(facets), axis=0, return_index=True, return_counts=True)
    outer = facets[first[count == 1]]
    kinds = 1 + np.isin(outer, data["base"]).all(axis=1) + 2 * np.isin(outer, data["top"]).all(axis=1)
    for number, name in enumerate(("free", "base", "top"), start=1):
        if dim == 3:
            found.Add(FaceDescriptor(bc=number, domin=1, surfnr=number))
        for facet in outer[kinds == number] + 1:
            found.Add(Element1D(facet.tolist(), index=number) if dim == 2 else Element2D(number, facet.tolist()))
        found.SetBCName(number - 1, name)
    return ng.Mesh(found)


def peak() -> float:
    """Largest memory of this process so far [GB]; `ru_maxrss` knows what its parent had."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e9


def newton(form: Any, u: Any, free: Any) -> int:
    """Solve, and return the iterations.

    Args:
        form: whose derivative is the tangent.
        u: displacements, with their prescribed values; the solution afterwards.
        free: which of them are free.
    """
    first = 0.0
    residual = u.vec.CreateVector()
    form.Apply(u.vec, residual)
    for iteration in range(50):
        size = float(np.linalg.norm(residual.FV().NumPy()[free]))
        first = first or size
        if size <= 1e-8 * first:
            return iteration
        form.AssembleLinearization(u.vec)
        change, part = residual.CreateVector(), 1.0
        change.data = form.mat.Inverse(form.space.FreeDofs(), inverse="umfpack") * residual
        u.vec.data -= change
        form.Apply(u.vec, residual)
        while np.linalg.norm(residual.FV().NumPy()[free]) > size and part > 0.1:
            part /= 2
            u.vec.data += part * change
            form.Apply(u.vec, residual)
    raise SystemExit("NGSolve: Newton's method does not converge in 50 iterations")


def main(path: Path) -> dict[str, Any]:
    """Solve the problem of a file.

    Raises:
        SystemExit: the mesh is of another kind, or Newton's method does not converge.
    """
    given, started = json.loads(path.read_text()), time.process_time()
    dim, order, E, nu, mu = (given[key] for key in ("dim", "order", "E", "nu", "mu"))
    data = np.load(path.with_name("mesh.npz"))
    if data["cells"].shape[1] != 2**dim:
        raise SystemExit("NGSolve: this driver knows grids of straight cells alone")
    mesh, stiffness = mesh_of(data, dim), given["penalty"] * E / given["height"]
    began = time.process_time()
    space = ng.VectorH1(mesh, order=order, dirichlet="top")
    (u, v), now, before = space.TnT(), ng.GridFunction(space), ng.GridFunction(space)

    def contact(u: Any) -> tuple[Any, Any, Any]:
        """Pressure, tangential traction, and whether it sticks."""
        depth = -stiffness * (u[dim - 1] + ng.CoefficientFunction((ng.x, ng.y, ng.z))[dim - 1])
        p = ng.IfPos(depth, depth, 0)
        trial = ng.CoefficientFunction(tuple(stiffness * (u[k] - before[k]) for k in range(dim - 1)))
        size = ng.sqrt(ng.InnerProduct(trial, trial) + 1e-30)
        return p, ng.IfPos(mu * p - size, 1, mu * p / size) * trial, ng.IfPos(mu * p - size, 1, 0)

    strain = 0.5 * (ng.Grad(u) + ng.Grad(u).trans)
    sigma = E / (1 + nu) * (strain + nu / (1 - 2 * nu) * ng.Trace(strain) * ng.Id(dim))
    p, t, _ = contact(u)
    t_v = sum(t[k] * v[k] for k in range(dim - 1)) if dim == 3 else t * v[0]
    form = ng.BilinearForm(space)
    form += ng.InnerProduct(sigma, ng.Grad(v)) * ng.dx
    form += (t_v - p * v[dim - 1]) * ng.ds("base")
    free, steps = np.array(list(space.FreeDofs())), []
    for motion in given["motion"]:
        before.vec.data = now.vec
        moved = ng.GridFunction(space)
        moved.Set(ng.CoefficientFunction(tuple(motion)), definedon=mesh.Boundaries("top"))
        now.vec.FV().NumPy()[~free] = moved.vec.FV().NumPy()[~free]
        iterations = newton(form, now, free)
        p, t, sticks = contact(now)
        parts = (p, sticks, *([t] if dim == 2 else [t[0], t[1]]))
        normal, area, *tangential = (ng.Integrate(value * ng.ds("base"), mesh) for value in parts)
        steps.append(
            {
                "iterations": iterations,
                "normal_force": float(normal),
                "tangential_force": float(np.linalg.norm(tangential)),
                "stick_area": float(area),
            }
        )
    return {
        "program": "NGSolve",
        "version": ng.__version__,
        "seconds": time.process_time() - began,
        "start": started,
        "mesh": began - started,
        "memory": peak(),
        "dofs": space.ndof,
        "steps": steps,
    }


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]))))
