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
ORDER = {  # nodes of a cell in GetFEM's order, by dimension and number of nodes
    (2, 4): [0, 1, 3, 2], (2, 3): [0, 1, 2], (2, 9): [0, 4, 1, 7, 8, 5, 3, 6, 2], (2, 6): [0, 3, 1, 5, 4, 2],
    (3, 8): [0, 1, 3, 2, 4, 5, 7, 6], (3, 4): [0, 1, 2, 3],
}  # fmt: skip


def model_of(given: dict[str, Any], data: Any) -> tuple[Any, Any, Any]:
    """The model, its displacements and its integration method.

    Args:
        given: problem.json.
        data: mesh.npz; cells with as many nodes as one of order 2 has are curved.
    """
    dim, order, points, E, nu = given["dim"], given["order"], data["points"], given["E"], given["nu"]
    nodes = ORDER[dim, data["cells"].shape[1]]
    grid, degree = 2**dim <= len(nodes) != 6, 1 + (len(nodes) in (6, 9))  # 6: a curved triangle
    mesh, kind = gf.Mesh("empty", dim), "QK" if grid else "PK"
    mesh.add_convex(
        gf.GeoTrans(f"GT_{kind}({dim},{degree})"), np.asfortranarray(points[data["cells"][:, nodes]].transpose(2, 1, 0))
    )
    for region, side in ((BASE, "base"), (TOP, "top")):
        there = mesh.pid_from_coords(np.asfortranarray(points[data[side]].T), 1e-9 * given["height"])
        mesh.set_region(region, mesh.faces_from_pid(there))
    displacements, obstacle = gf.MeshFem(mesh, dim), gf.MeshFem(mesh, 1)
    for space in (displacements, obstacle):
        space.set_fem(gf.Fem(f"FEM_{kind}({dim},{order})"))
    rule = f"IM_GAUSS_PARALLELEPIPED({dim},{2 * order})" if grid else RULES[dim, order]
    inside = gf.MeshIm(mesh, gf.Integ(rule))

    model = gf.Model("real")
    model.add_fem_variable("u", displacements)
    model.add_initialized_data("lame_lambda", E * nu / ((1 + nu) * (1 - 2 * nu)))
    model.add_initialized_data("lame_mu", E / (2 * (1 + nu)))
    model.add_isotropic_linearized_elasticity_brick(inside, "u", "lame_lambda", "lame_mu")
    model.add_initialized_data("motion", np.zeros(dim))
    model.add_Dirichlet_condition_with_simplification("u", TOP, "motion")
    model.add_filtered_fem_variable("traction", displacements, BASE)
    places, R = obstacle.basic_dof_nodes(), given["radius"]
    distance = np.linalg.norm(places, axis=0) - R if R else places[-1]
    model.add_initialized_fem_data("obstacle", obstacle, distance)
    model.add_initialized_fem_data("before", displacements, np.zeros(displacements.nbdof()))
    for name, value in (("r", E / given["height"] if "penalty" in given else E), ("mu", given["mu"]), ("alpha", 1.0)):
        model.add_initialized_data(name, value)
    model.add_integral_contact_with_rigid_obstacle_brick(
        inside, "u", "traction", "obstacle", "r", "mu", BASE, 1, "alpha", "before"
    )
    return model, displacements, inside


RULES = {(2, 1): "IM_TRIANGLE(2)", (2, 2): "IM_TRIANGLE(4)", (3, 1): "IM_TETRAHEDRON(2)", (3, 2): "IM_TETRAHEDRON(5)"}
N = "Normalized(Grad_obstacle)"  # into the body
PRESSED = f"(traction.{N}-r*(obstacle+u.{N}))"
TRIAL = f"(traction-(traction.{N})*{N}-r*(u-before-((u-before).{N})*{N}))"
STICKS = f"Heaviside({PRESSED})*Heaviside(mu*{PRESSED}-Norm({TRIAL}))"


def peak() -> float:
    """Largest memory of this process so far [GB]; `ru_maxrss` knows what its parent had."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e9


def main(path: Path) -> dict[str, Any]:
    """Solve the problem of a file."""
    given, started = json.loads(path.read_text()), time.process_time()
    with np.load(path.with_name("mesh.npz")) as data:
        model, displacements, inside = model_of(given, data)
    dim, base = given["dim"], displacements.basic_dof_on_region(BASE)
    nodes, R = displacements.basic_dof_nodes()[:, base[::dim]].T, given["radius"]
    far = np.linalg.norm(nodes, axis=1)
    gap, n = (far - R, nodes / far[:, None]) if R else (nodes[:, -1], np.eye(dim)[[-1]])
    began, steps = time.process_time(), []
    for motion in given["motion"]:
        model.set_variable("before", model.variable("u"))
        model.set_variable("motion", np.array(motion))
        iterations, converged = model.solve("max_res", 1e-9, "max_iter", 100, "lsolver", "mumps")
        if not converged:
            raise SystemExit(f"GetFEM's Newton method does not converge in {iterations} iterations")
        normal = float(gf.asm_generic(inside, 0, f"traction.{N}", BASE, model))
        tangential = gf.asm_generic(inside, 0, f"traction-(traction.{N})*{N}", BASE, model)
        pressed = -((model.variable("u")[base].reshape(-1, dim) * n).sum(axis=1) + gap)
        pressures = (model.variable("traction").reshape(-1, dim) * n).sum(axis=1)
        steps.append(
            {
                "iterations": int(iterations),
                "normal_force": abs(normal),
                "tangential_force": float(np.linalg.norm(tangential)),
                "stick_area": float(gf.asm_generic(inside, 0, STICKS, BASE, model)),
                "penetration": float(max(pressed.max(), 0.0)),
                "max_pressure": float(pressures.max()),
            }
        )
    return {
        "program": "GetFEM",
        "version": str(gf.getfem_env("version")),
        "seconds": time.process_time() - began,
        "start": started,
        "mesh": began - started,
        "memory": peak(),
        "dofs": int(model.nbdof()),
        "steps": steps,
    }


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]))))
