"""The same meshes on other platforms: `python -m stickslip.workflows.lab.benchmarks.platforms FOLDER [PLATFORM]`.

Solves ten ready scenes on the meshes FOLDER/SCENE.msh, which the first platform writes, and keeps their figures in
FOLDER/PLATFORM.json. Then it compares all platforms found there: exit code 1 if two differ by more than rounding.
"""

from __future__ import annotations

import json
import platform
import sys
import time as clock
from collections import defaultdict
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TypedDict

import numpy as np

import stickslip
from stickslip.geometry.dolfinx_versions import DOLFINX
from stickslip.geometry.mesh.mesh import write_msh

PLANE = ["block", "cylinders", "shrink_fit", "two_blocks", "stack", "axisymmetric", "half_disc"]
SCENES = [*PLANE, "cube", "half_ball", "sphere"]
ROUNDING = 1e-9  # of the largest figure of its kind in the scene
TIMED = "cube"
Figures = dict[str, dict[str, list[float]]]  # scene -> kind of figure (force …) -> all of them, step by step


class Record(TypedDict):
    """Figures of one platform."""

    dolfinx: str
    python: str
    seconds: float  # wall time of the scene `TIMED`, forms compiled
    figures: Figures


def measured(folder: Path) -> Record:
    """Solve all scenes on the meshes in the folder; those that are missing are made."""
    figures = {name: solve(name, folder) for name in SCENES}
    began = clock.perf_counter()
    solve(TIMED, folder)
    seconds = clock.perf_counter() - began
    return Record(dolfinx=DOLFINX, python=platform.python_version(), seconds=seconds, figures=figures)


def solve(name: str, folder: Path) -> dict[str, list[float]]:
    """Figures of a ready scene by kind: forces [N], areas [m²], pressures [Pa], slips [m] and energies [J]."""
    scene, mesh = stickslip.read(name), folder / f"{name}.msh"
    if not mesh.exists():
        write_msh(scene.geometry, scene.request(), mesh)
    found = defaultdict[str, list[float]](list)
    for step in stickslip.steps(replace(scene, geometry=stickslip.UserFile(file=str(mesh)))):
        energy = step.energy
        found["energy"] += [energy.external, energy.stored, energy.contact, *energy.dissipation.tolist()]
        found["force"] += chain.from_iterable(support.force.tolist() for support in step.supports.values())
        for contact in step.contacts.values():
            found["force"] += contact.force.tolist()
            found["area"] += [contact.contact_area, contact.stick_area, contact.slip_area]
            found["pressure"] += [contact.max_pressure]
            found["slip"] += [float(abs(contact.slip).max())]
    return found


def apart(one: Figures, other: Figures) -> dict[str, float]:
    """Largest difference of two platforms in each scene, relative to the largest figure of its kind.

    >>> apart({"a": {"force": [0.0, 2.0]}}, {"a": {"force": [1.0, 2.0]}})
    {'a': 0.5}
    """
    return {
        scene: float(np.max([_apart(values, other[scene][kind]) for kind, values in kinds.items()]))
        for scene, kinds in one.items()
    }


def _apart(one: list[float], other: list[float]) -> float:
    a, b = np.array(one), np.array(other)
    return float(np.abs(a - b).max() / (np.abs(a).max() or 1.0))


def main(folder: Path, name: str = "") -> int:
    """Record this platform if it has a name; compare all with the first one, and print a table."""
    if name:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.json").write_text(json.dumps(measured(folder)), encoding="utf-8")
    found: dict[str, Record] = {p.stem: json.loads(p.read_text("utf-8")) for p in sorted(folder.glob("*.json"))}
    first = next(iter(found))
    differences = {label: apart(found[first]["figures"], record["figures"]) for label, record in found.items()}
    for label, record in found.items():
        print(f"{label}: dolfinx {record['dolfinx']}, Python {record['python']}, {TIMED} {record['seconds']:.2f} s")
        print("   " + ", ".join(f"{scene} {value:.0e}" for scene, value in differences[label].items()))
    worst = float(np.max([[*values.values()] for values in differences.values()]))
    print(f"largest difference from {first}: {worst:.1e} of the largest figure of its kind")
    return int(not worst <= ROUNDING)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), *sys.argv[2:3]))
