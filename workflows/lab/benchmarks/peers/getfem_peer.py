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

BASE, TOP, WASHER = 1, 2, 3
ORDER = {  # nodes of a cell in GetFEM's order, by dimension and number of nodes
    (2, 4): [0, 1, 3, 2], (2, 3): [0, 1, 2], (2, 9): [0, 4, 1, 7, 8, 5, 3, 6, 2], (2, 6): [0, 3, 1, 5, 4, 2],
    (3, 8): [0, 1, 3, 2, 4, 5, 7, 6], (3, 4): [0, 1, 2, 3],
}  # fmt: skip
RULES = {(2, 1): "IM_TRIANGLE(2)", (2, 2): "IM_TRIANGLE(4)", (3, 1): "IM_TETRAHEDRON(2)", (3, 2): "IM_TETRAHEDRON(5)"}
P = "pos_part(traction(2)-r*(upper(2)-Interpolate(lower,across)(2)))"
SLIP = "(upper(1)-Interpolate(lower,across)(1)-upper_before(1)+Interpolate(lower_before,across)(1))"
DRAG = f"(traction(1)-r*{SLIP})"
T = f"(pos_part({DRAG}+mu*{P})-pos_part({DRAG}-mu*{P})-mu*{P})"  # cut off at both limits
CONTACT = f"traction.(Interpolate(Test_lower,across)-Test_upper)+(traction-[{T},{P}]).Test_traction/r"


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


N = "Normalized(Grad_obstacle)"  # into the body
PRESSED = f"(traction.{N}-r*(obstacle+u.{N}))"
TRIAL = f"(traction-(traction.{N})*{N}-r*(u-before-((u-before).{N})*{N}))"
STICKS = f"Heaviside({PRESSED})*Heaviside(mu*{PRESSED}-Norm({TRIAL}))"


def peak() -> float:
    """Largest memory of this process so far [GB]; `ru_maxrss` knows what its parent had."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e9


def block(given: dict[str, Any], data: Any) -> tuple[Any, Any, Any]:
    """Return the model of the block on an obstacle, how it is moved, and its numbers."""
    model, displacements, inside = model_of(given, data)
    dim, base = given["dim"], displacements.basic_dof_on_region(BASE)
    nodes, R = displacements.basic_dof_nodes()[:, base[::dim]].T, given["radius"]
    far = np.linalg.norm(nodes, axis=1)
    gap, n = (far - R, nodes / far[:, None]) if R else (nodes[:, -1], np.eye(dim)[[-1]])

    def move(motion: list[float]) -> None:
        """Move the top."""
        model.set_variable("before", model.variable("u"))
        model.set_variable("motion", np.array(motion))

    def numbers() -> dict[str, float]:
        """Forces [N], area of stick [m^2], deepest penetration [m] and largest pressure [Pa] on the base."""
        normal = float(gf.asm_generic(inside, 0, f"traction.{N}", BASE, model))
        tangential = gf.asm_generic(inside, 0, f"traction-(traction.{N})*{N}", BASE, model)
        pressed = -((model.variable("u")[base].reshape(-1, dim) * n).sum(axis=1) + gap)
        pressures = (model.variable("traction").reshape(-1, dim) * n).sum(axis=1)
        return {
            "normal_force": abs(normal),
            "tangential_force": float(np.linalg.norm(tangential)),
            "stick_area": float(gf.asm_generic(inside, 0, STICKS, BASE, model)),
            "penetration": float(max(pressed.max(), 0.0)),
            "max_pressure": float(pressures.max()),
        }

    return model, move, numbers


def plate(model: Any, name: str, given: dict[str, Any], data: Any) -> Any:
    """Add an elastic plate to the model, held at its end by `end_NAME`; how it is integrated, its space and its mesh.

    Args:
        model: that is added to.
        name: upper or lower.
        given: problem.json.
        data: mesh.npz.
    """
    mesh, order, points = gf.Mesh("empty", 2), given["order"], data["points"] / given["height"]
    cells = data[f"{name}_cells"]
    nodes = ORDER[2, cells.shape[1]]
    kind = gf.GeoTrans(f"GT_PK(2,{1 + (len(nodes) == 6)})")
    mesh.add_convex(kind, np.asfortranarray(points[cells[:, nodes]].transpose(2, 1, 0)))
    for region, side in ((BASE, "joint"), (WASHER, "washer"), (TOP, "end")):
        there = mesh.pid_from_coords(np.asfortranarray(points[data[f"{name}_{side}"]].T), 1e-9)
        mesh.set_region(region, mesh.faces_from_pid(there))
    space, inside = gf.MeshFem(mesh, 2), gf.MeshIm(mesh, gf.Integ(RULES[2, order]))
    space.set_fem(gf.Fem(f"FEM_PK(2,{order})"))
    model.add_fem_variable(name, space)
    model.add_initialized_fem_data(f"{name}_before", space, np.zeros(space.nbdof()))
    model.add_isotropic_linearized_elasticity_brick(inside, name, "lame_lambda", "lame_mu")
    model.add_initialized_data(f"end_{name}", np.zeros(2))
    model.add_Dirichlet_condition_with_simplification(name, TOP, f"end_{name}")
    return inside, space, mesh


def two_plates(given: dict[str, Any], data: Any) -> tuple[Any, Any, Any]:
    """Return the model of two plates and a bolt, in units of E and a plate's height, how it is moved, its numbers."""
    nu, height, model = given["nu"], given["height"], gf.Model("real")
    force = given["E"] * height  # per metre
    for name, value in (
        ("lame_lambda", nu / ((1 + nu) * (1 - 2 * nu))), ("lame_mu", 0.5 / (1 + nu)), ("r", 0.1), ("mu", given["mu"]),
        ("stiffness", given["stiffness"] / given["E"]), ("width", given["washer"] / height), ("shortening", 0.0),
    ):  # fmt: skip
        model.add_initialized_data(name, value)
    parts = [plate(model, name, given, data) for name in ("upper", "lower")]  # GetFEM forgets what nobody holds
    (inside, space, mesh), (below, _, under) = parts
    model.add_interpolate_transformation_from_expression("across", mesh, under, "X")
    model.add_filtered_fem_variable("traction", space, BASE)
    model.add_nonlinear_term(inside, CONTACT, BASE)
    model.add_variable("tension", 1)
    pulls = "(tension*Test_upper(2)+upper(2)*Test_tension+(shortening-tension/stiffness)*Test_tension)/width"
    model.add_nonlinear_term(inside, pulls, WASHER)
    model.add_nonlinear_term(below, "-(tension*Test_lower(2)+lower(2)*Test_tension)/width", WASHER)

    def move(motion: list[float]) -> None:
        """Shorten the bolt, and move the upper plate's end."""
        for name in ("upper", "lower"):
            model.set_variable(f"{name}_before", model.variable(name))
        model.set_variable("shortening", [motion[0] / height])
        model.set_variable("end_upper", np.array(motion[1:]) / height)

    def numbers() -> dict[str, float]:
        """Forces per metre [N/m]."""
        drag = float(gf.asm_generic(parts[0][0], 0, "traction(1)", BASE, model))
        tension = float(model.variable("tension")[0])
        return {"tangential_force": abs(drag) * force, "bolt.bolt.tension": tension * force}

    return model, move, numbers


def main(path: Path) -> dict[str, Any]:
    """Solve the problem of a file."""
    given, started = json.loads(path.read_text()), time.process_time()
    with np.load(path.with_name("mesh.npz")) as data:
        model, move, numbers = (two_plates if "washer" in given else block)(given, data)
    began, steps = time.process_time(), []
    for motion in given["motion"]:
        move(motion)
        iterations, converged = model.solve("max_res", 1e-9, "max_iter", 100, "lsolver", "mumps")
        if not converged:
            raise SystemExit(f"GetFEM's Newton method does not converge in {iterations} iterations")
        steps.append({"iterations": int(iterations)} | numbers())
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
