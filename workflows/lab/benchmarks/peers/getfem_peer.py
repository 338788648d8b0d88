"""GetFEM on the problem of the price benchmark: `python getfem_peer.py problem.json`, with Debian's python3-getfem.

Its integral contact brick with a rigid obstacle: Alart and Curnier's augmented Lagrangian, with multipliers in the
traces of the displacements, and friction by the slip since `before`. Newton's method with MUMPS on all unknowns.
Contact holds in the mean over the multipliers' functions, ours at nodes: the forces differ by a part that falls with
the mesh size. Prints one line of JSON; seconds are of the processor, with assembly, without the mesh.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

import getfem as gf
import numpy as np

BASE, TOP = 1, 2
CORNERS = {2: [0, 1, 3, 2], 3: [0, 1, 3, 2, 4, 5, 7, 6]}  # of a cell, in GetFEM's order


def model_of(given: dict[str, Any], data: Any) -> tuple[Any, Any, Any]:
    """The model, its displacements and its multipliers."""
    dim, points, E, nu = given["dim"], data["points"], given["E"], given["nu"]
    mesh = gf.Mesh("empty", dim)
    mesh.add_convex(
        gf.GeoTrans(f"GT_QK({dim},1)"), np.asfortranarray(points[data["cells"][:, CORNERS[dim]]].transpose(2, 1, 0))
    )
    nodes = mesh.pts()
    for region, height in ((BASE, 0.0), (TOP, given["height"])):
        there = np.flatnonzero(np.abs(nodes[-1] - height) < 1e-9 * given["height"])
        mesh.set_region(region, mesh.faces_from_pid(there))
    displacements, obstacle = gf.MeshFem(mesh, dim), gf.MeshFem(mesh, 1)
    for space in (displacements, obstacle):
        space.set_fem(gf.Fem(f"FEM_QK({dim},1)"))
    inside = gf.MeshIm(mesh, gf.Integ(f"IM_GAUSS_PARALLELEPIPED({dim},2)"))

    model = gf.Model("real")
    model.add_fem_variable("u", displacements)
    model.add_initialized_data("lame_lambda", E * nu / ((1 + nu) * (1 - 2 * nu)))
    model.add_initialized_data("lame_mu", E / (2 * (1 + nu)))
    model.add_isotropic_linearized_elasticity_brick(inside, "u", "lame_lambda", "lame_mu")
    model.add_initialized_data("motion", np.zeros(dim))
    model.add_Dirichlet_condition_with_simplification("u", TOP, "motion")
    model.add_filtered_fem_variable("traction", displacements, BASE)
    model.add_initialized_fem_data("obstacle", obstacle, obstacle.eval("y" if dim == 2 else "z"))
    model.add_initialized_fem_data("before", displacements, np.zeros(displacements.nbdof()))
    for name, value in (("r", E), ("mu", given["mu"]), ("alpha", 1.0)):
        model.add_initialized_data(name, value)
    model.add_integral_contact_with_rigid_obstacle_brick(
        inside, "u", "traction", "obstacle", "r", "mu", BASE, 1, "alpha", "before"
    )
    return model, displacements, inside


def peak() -> float:
    """Largest memory of this process so far [GB]; `ru_maxrss` knows what its parent had."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e9


def main(path: Path) -> dict[str, Any]:
    """Solve the problem of a file."""
    given = json.loads(path.read_text())
    with np.load(path.with_name("mesh.npz")) as data:
        model, displacements, inside = model_of(given, data)
    dim, base = given["dim"], displacements.basic_dof_on_region(BASE)
    began, steps = time.process_time(), []
    for motion in given["motion"]:
        model.set_variable("before", model.variable("u"))
        model.set_variable("motion", np.array(motion))
        iterations, converged = model.solve("max_res", 1e-9, "max_iter", 100, "lsolver", "mumps")
        if not converged:
            raise SystemExit(f"GetFEM's Newton method does not converge in {iterations} iterations")
        force = gf.asm_generic(inside, 0, "traction", BASE, model)
        depth = -model.variable("u")[base][dim - 1 :: dim].min()
        steps.append(
            {
                "iterations": int(iterations),
                "normal_force": float(abs(force[dim - 1])),
                "tangential_force": float(np.linalg.norm(force[: dim - 1])),
                "penetration": float(max(depth, 0.0)),
            }
        )
    return {
        "program": "GetFEM",
        "version": str(gf.getfem_env("version")),
        "seconds": time.process_time() - began,
        "memory": peak(),
        "dofs": int(model.nbdof()),
        "steps": steps,
    }


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]))))
