"""GetFEM on two plates and a bolt: `python getfem_plates_peer.py problem.json`, with Debian's python3-getfem.

Alart and Curnier's augmented Lagrangian between two elastic bodies, in GetFEM's language of weak forms: multipliers in
the traces on the upper plate, the lower one's displacements interpolated there, and the bolt's tension as an unknown.
Newton's method with MUMPS on all unknowns. Prints one line of JSON; seconds are of the processor, without the mesh.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

import getfem as gf
import numpy as np

JOINT, WASHER, END = 1, 2, 3
NODES = {3: [0, 1, 2], 6: [0, 3, 1, 5, 4, 2]}  # of a triangle in GetFEM's order
P = "pos_part(traction(2)-r*(upper(2)-Interpolate(lower,across)(2)))"
SLIP = "(upper(1)-Interpolate(lower,across)(1)-upper_before(1)+Interpolate(lower_before,across)(1))"
TRIAL = f"(traction(1)-r*{SLIP})"
T = f"(pos_part({TRIAL}+mu*{P})-pos_part({TRIAL}-mu*{P})-mu*{P})"  # cut off at both limits
CONTACT = f"traction.(Interpolate(Test_lower,across)-Test_upper)+(traction-[{T},{P}]).Test_traction/r"


def peak() -> float:
    """Largest memory of this process so far [GB]; `ru_maxrss` knows what its parent had."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e9


def plate(model: Any, name: str, given: dict[str, Any], data: Any) -> Any:
    """Add an elastic plate to the model, held at its end by `end_NAME`; its integration method.

    Args:
        model: that is added to.
        name: upper or lower.
        given: problem.json.
        data: mesh.npz.
    """
    mesh, order, points = gf.Mesh("empty", 2), given["order"], data["points"] / given["height"]
    cells = data[f"{name}_cells"]
    nodes = NODES[cells.shape[1]]
    kind = gf.GeoTrans(f"GT_PK(2,{1 + (len(nodes) == 6)})")
    mesh.add_convex(kind, np.asfortranarray(points[cells[:, nodes]].transpose(2, 1, 0)))
    for region, side in ((JOINT, "joint"), (WASHER, "washer"), (END, "end")):
        there = mesh.pid_from_coords(np.asfortranarray(points[data[f"{name}_{side}"]].T), 1e-9)
        mesh.set_region(region, mesh.faces_from_pid(there))
    space, inside = gf.MeshFem(mesh, 2), gf.MeshIm(mesh, gf.Integ(f"IM_TRIANGLE({2 * order})"))
    space.set_fem(gf.Fem(f"FEM_PK(2,{order})"))
    model.add_fem_variable(name, space)
    model.add_initialized_fem_data(f"{name}_before", space, np.zeros(space.nbdof()))
    model.add_isotropic_linearized_elasticity_brick(inside, name, "lame_lambda", "lame_mu")
    model.add_initialized_data(f"end_{name}", np.zeros(2))
    model.add_Dirichlet_condition_with_simplification(name, END, f"end_{name}")
    return inside, space, mesh


def main(path: Path) -> dict[str, Any]:
    """Solve the problem of a file, in units of E and the height of a plate."""
    given, started = json.loads(path.read_text()), time.process_time()
    nu, height, model = given["nu"], given["height"], gf.Model("real")
    force = given["E"] * height  # per metre
    for name, value in (
        ("lame_lambda", nu / ((1 + nu) * (1 - 2 * nu))), ("lame_mu", 0.5 / (1 + nu)), ("r", 0.1), ("mu", given["mu"]),
        ("stiffness", given["stiffness"] / given["E"]), ("width", given["washer"] / height), ("shortening", 0.0),
    ):  # fmt: skip
        model.add_initialized_data(name, value)
    with np.load(path.with_name("mesh.npz")) as data:
        (inside, space, mesh), (below, _, under) = (plate(model, name, given, data) for name in ("upper", "lower"))
    model.add_interpolate_transformation_from_expression("across", mesh, under, "X")
    model.add_filtered_fem_variable("traction", space, JOINT)
    model.add_nonlinear_term(inside, CONTACT, JOINT)
    model.add_variable("tension", 1)
    pulls = "(tension*Test_upper(2)+upper(2)*Test_tension+(shortening-tension/stiffness)*Test_tension)/width"
    model.add_nonlinear_term(inside, pulls, WASHER)
    model.add_nonlinear_term(below, "-(tension*Test_lower(2)+lower(2)*Test_tension)/width", WASHER)
    began, steps = time.process_time(), []
    for shortening, motion in given["steps"]:
        for name in ("upper", "lower"):
            model.set_variable(f"{name}_before", model.variable(name))
        model.set_variable("shortening", [shortening / height])
        model.set_variable("end_upper", np.array(motion) / height)
        iterations, converged = model.solve("max_res", 1e-10, "max_iter", 100, "lsolver", "mumps")
        if not converged:
            raise SystemExit(f"GetFEM's Newton method does not converge in {iterations} iterations")
        drag = float(gf.asm_generic(inside, 0, "traction(1)", JOINT, model))
        steps.append(
            {
                "iterations": int(iterations),
                "tangential_force": abs(drag) * force,
                "bolt.bolt.tension": float(model.variable("tension")[0]) * force,
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
