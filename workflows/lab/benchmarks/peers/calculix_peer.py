"""CalculiX on the problem of the price benchmark, in 3D: `python calculix_peer.py problem.json`, with ccx in the path.

The plane is one large hexahedron that is held. Contact face to face with a linear penalty, friction with a stick slope:
of CalculiX's kinds of contact the one whose forces came closest. Its C3D8 is not quite our hexahedron. Prints one line
of JSON; seconds are of the processor for the whole program, with reading its input.
"""

import json
import re
import resource
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from stickslip.workflows.formats.templates import render

PENALTY = 1e3  # stiffness of contact and stick, in units of E / height; with 1e4 it does not converge
FACES = {1: (0, 1, 2, 3), 2: (4, 5, 6, 7), 3: (0, 1, 4, 5), 4: (1, 2, 5, 6), 5: (2, 3, 6, 7), 6: (3, 0, 7, 4)}
PLATE = [[x, y, z] for z in (-1.0, 0.0) for x, y in ((-1, -1), (2, -1), (2, 2), (-1, 2))]  # [m] nodes of the plane


def deck(given: dict[str, Any], data: Any) -> str:
    """Return the input file; its numbers begin with 1.

    Args:
        given: problem.json.
        data: mesh.npz.
    """
    points, cells = data["points"], data["cells"]
    below = np.isin(cells, data["base"])
    sides = {side: (data[side] + 1).tolist() for side in ("base", "top")}  # in place of their names
    numbers = (
        given
        | sides
        | {
            "nodes": np.vstack([points, PLATE]).tolist(),
            "cells": (cells + 1).tolist(),
            "plate": [len(points) + corner for corner in range(1, 9)],
            "faces": [f"{e + 1},S{face}" for face, c in FACES.items() for e in np.flatnonzero(below[:, c].all(axis=1))],
            "stiffness": PENALTY * given["E"] / given["height"],
        }
    )
    return render("lab/benchmarks/templates/calculix.inp", **numbers)


def results(folder: Path) -> list[dict[str, float]]:
    """Forces [N], penetration [m] and iterations at the end of each step, from the files of a job."""
    status = [line.split() for line in (folder / "job.sta").read_text().splitlines()[2:]]
    text = (folder / "job.dat").read_text()
    found = []
    for number in (1, 2):
        end = rf"time\s+0\.{number}000000E\+01\s+"
        force = np.array(re.findall(rf"set TOP and {end}(.*)", text)[-1].split(), float)
        block = re.findall(rf"set BASENODES and {end}((?:\s*\d+(?:\s+\S+){{3}}\n)+)", text)[-1]
        depth = -min(float(line.split()[3]) for line in block.strip().splitlines())
        found.append(
            {
                "iterations": sum(int(row[3]) for row in status if int(row[0]) == number),
                "normal_force": float(abs(force[-1])),
                "tangential_force": float(np.linalg.norm(force[:-1])),
                "penetration": max(depth, 0.0),
            }
        )
    return found


def main(path: Path) -> dict[str, Any]:
    """Solve the problem of a file, in a folder beside it."""
    given, folder = json.loads(path.read_text()), path.with_name("calculix")
    folder.mkdir(exist_ok=True)
    if given["dim"] != 3:
        raise SystemExit("CalculiX: contact is measured in 3D alone")
    with np.load(path.with_name("mesh.npz")) as data:
        (folder / "job.inp").write_text(deck(given, data))
        dofs = data["points"].size
    ccx = shutil.which("ccx")
    if ccx is None:
        raise SystemExit("CalculiX: ccx is not installed")
    done = subprocess.run([ccx, "job"], cwd=folder, capture_output=True, text=True, check=False)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode or "*ERROR" in done.stdout:
        raise SystemExit("CalculiX: " + " ".join(re.findall(r"\*ERROR.*", done.stdout) or ["failed"]))
    version = subprocess.run([ccx, "-v"], capture_output=True, text=True, check=False).stdout.split()[-1]
    return {
        "program": "CalculiX",
        "version": version,
        "seconds": used.ru_utime + used.ru_stime,
        "start": 0.0,
        "mesh": 0.0,
        "memory": used.ru_maxrss * 1024 / 1e9,
        "dofs": dofs,
        "steps": results(folder),
    }


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]))))
