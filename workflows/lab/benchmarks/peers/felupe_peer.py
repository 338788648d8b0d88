"""FElupe on the problems of other programs: `python felupe_peer.py problem.json`, with PyPI's felupe.

Its rigid plane: a penalty at nodes, an elastic stick that Coulomb's limit cuts off; Newton's method with SciPy's
sparse solver. Springs at nodes are as stiff as the penalty times the base's area over the number of its nodes. Prints
one line of JSON; seconds are of the processor, with assembly, without the mesh.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

import felupe as fe
import numpy as np

REGIONS = {  # by dimension and number of a cell's nodes
    (2, 4): ("quad", fe.RegionQuad), (2, 3): ("triangle", fe.RegionTriangle),
    (2, 6): ("triangle6", fe.RegionQuadraticTriangle), (3, 8): ("hexahedron", fe.RegionHexahedron),
}  # fmt: skip


def peak() -> float:
    """Largest memory of this process so far [GB]; `ru_maxrss` knows what its parent had."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e9


def main(path: Path) -> dict[str, Any]:
    """Solve the problem of a file.

    Raises:
        SystemExit: the obstacle or the mesh is of another kind.
    """
    given, started = json.loads(path.read_text()), time.process_time()
    dim, data = given["dim"], np.load(path.with_name("mesh.npz"))
    points, cells, base, top = (data[key] for key in ("points", "cells", "base", "top"))
    if given["radius"] or given["order"] > 1 + (cells.shape[1] == 6):
        raise SystemExit("FElupe: this driver knows planes alone, and order 2 on curved triangles")
    kind, centre = REGIONS[dim, cells.shape[1]], len(points)
    mesh = fe.Mesh(np.vstack([points, np.zeros(dim)]), cells, kind[0])
    mesh.points_without_cells = np.array([], int)
    field = fe.FieldContainer([(fe.FieldPlaneStrain if dim == 2 else fe.Field)(kind[1](mesh), dim=dim)])
    solid = fe.SolidBody(fe.LinearElastic(E=given["E"], nu=given["nu"]), field)
    area = np.prod(np.ptp(points[base], axis=0)[:-1])
    stiffness = given["penalty"] * given["E"] / given["height"] * area / len(base)
    plane = fe.ContactRigidPlane(
        field,
        base,
        centre,
        np.eye(dim)[-1],
        friction=given["mu"],
        multiplier=stiffness,
        multiplier_tangential=stiffness,
    )
    held = {"plane": fe.Boundary(field[0], mask=np.arange(centre + 1) == centre)}
    held |= {"top": fe.Boundary(field[0], mask=np.isin(np.arange(centre + 1), top))}
    step = fe.Step([solid, plane], ramp={held["top"]: np.array(given["motion"])}, boundaries=held)
    began, steps = time.process_time(), []
    for substep in step.generate(x0=field, verbose=0, tol=1e-9):
        force = plane.results.force.toarray().reshape(-1, dim)[centre]
        sticks = plane.results.active & ~plane.results.slip
        steps.append(
            {
                "iterations": int(substep.iterations),
                "normal_force": float(abs(force[-1])),
                "tangential_force": float(np.linalg.norm(force[:-1])),
                "stick_area": float(area * sticks.sum() / len(base)),
            }
        )
    return {
        "program": "FElupe",
        "version": fe.__version__,
        "seconds": time.process_time() - began,
        "start": started,
        "mesh": began - started,
        "memory": peak(),
        "dofs": dim * len(points),
        "steps": steps,
    }


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]))))
