"""A ready scene solved, and its files read as a stranger reads them."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from shared.command import result, table
from stickslip import Scene, read
from stickslip.workflows.run.run import run

COARSER = 2.5  # times the mesh sizes of the ready scenes: what is tested holds on every mesh
SIZES = ("mesh_size", "contact_mesh_size", "lower_mesh_size", "inner_mesh_size")
OF_FILES = {
    "crack": {"fine": 0.1, "coarse": 2.0},
    "split_clamp": {"size": 1.0},
}  # sizes that .geo files have by default
FEWER = {  # steps, of scenes that have many for the accuracy of their dissipation
    "axisymmetric": 4,
    "dam": 12,
    "disc_brake": 6,
    "fretting_wear": 10,
    "half_ball": 2,
    "half_disc": 8,
    "half_space": 4,
    "hysteresis": 22,
    "ring": 5,
    "spheres": 2,
    "spruce": 8,
    "stick_slip": 12,
    "worn_roller": 6,
}
ZERO = 1e-8  # the tolerance of the ready scenes: balances hold to it, relative to their largest term
ROUNDING = 1e-12
Json = dict[str, Any]


@dataclass(frozen=True)
class Solved:
    """A ready scene, solved."""

    scene: Scene
    folder: Path
    result: Json

    @property
    def contacts(self) -> Iterator[tuple[Json, str, Json]]:
        for step in self.result["steps"]:
            for name in self.scene.pairs:
                yield step, name, step["contacts"][name]

    def rows(self, name: str) -> list[dict[str, str]]:
        """Rows of a CSV file."""
        return table(self.folder / name)

    def points(self, name: str, time: float) -> dict[str, Any]:
        """Columns of contact_NAME.csv at a time; vectors as (n, d)."""
        rows = [row for row in self.rows(f"contact_{name}.csv") if float(row["time"]) == time]
        columns: dict[str, Any] = {"status": np.array([row["status"] for row in rows])}
        for key in ("weight", "gap", "pressure"):
            columns[key] = np.array([float(row[key]) for row in rows])
        for key in ("traction", "slip", "slip_increment", "lambda"):
            columns[key] = np.array([[float(row[f"{key}_{a}"]) for a in "xyz"[: self.scene.dim]] for row in rows])
        columns["x"] = np.array([[float(row[a]) for a in "xyz"[: self.scene.dim]] for row in rows])
        return columns


def coarse(name: str) -> list[str]:
    """Overrides for a coarser mesh, fewer steps, a probe more, and no pictures (they have tests of their own)."""
    scene = read(name)
    sizes = OF_FILES.get(name) or {key: getattr(scene.geometry, key, None) for key in SIZES}
    held = scene.supports or scene.sections.get("elastic_support", {})
    contact, support = (next(iter(table.values()), None) for table in (scene.contacts, held))
    alone = support is None or contact.against in scene.obstacles  # else another body may reach over the contact side
    side = contact.surface if alone else support.boundary
    corner = list(support.point) if side is None else scene.geometry.sample(side, scene.dim)[0][0].tolist()
    return [
        *([f"steps.count={FEWER[name]}"] if name in FEWER else []),
        *(f"geometry.{key}={COARSER * size}" for key, size in sizes.items() if size is not None),
        f"probes.seat={{point={corner}}}",
        "output.pictures=false",
    ]


def solve(scene: Scene, folder: Path) -> Solved:
    """Run it, and read result.json back as a stranger would."""
    run(scene, folder)
    return Solved(scene, folder, result(folder))
