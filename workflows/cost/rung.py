"""One rung of the ladder: mesh level, order, method and tolerance; and its scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt
from typing import Literal
from urllib.parse import quote

from stickslip.geometry.errors import SceneError, prefixed
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Output
from stickslip.workflows.scene_file.read import with_method

RATIO = sqrt(2)  # between the cells of neighbouring levels


@dataclass(frozen=True, order=True)
class Rung:
    """Level 0 has the mesh sizes of the scene; each further level divides them by RATIO."""

    order: Literal[1, 2]
    method: str  # name, or name and keys, see `with_method`
    level: int
    tolerance: float

    @property
    def factor(self) -> float:
        """Mesh size over that of the scene."""
        return float(RATIO**-self.level)

    @property
    def chain(self) -> tuple[int, str]:
        """What stays fixed while the mesh is refined: order, method."""
        return self.order, self.method

    @property
    def name(self) -> str:
        """Name of its file, different for each rung."""
        method = quote(self.method, safe="+=")
        return f"order{self.order}_{method}_level{self.level:+03d}_{self.tolerance:.0e}"

    def scene(self, scene: Scene) -> Scene:
        """The scene as this rung solves it, without pictures.

        Raises:
            SceneError: its geometry offers no size to refine, or refuses this one.
        """
        with prefixed("geometry"):
            geometry = replace(scene.geometry.refined(self.factor), order=self.order)
        solver = replace(with_method(scene.solver, self.method), tolerance=self.tolerance)
        return replace(scene, geometry=geometry, solver=solver, output=Output(pictures=False, error=False))


def mesh_size(scene: Scene) -> float:
    """Edge length where bodies touch [m].

    Raises:
        SceneError: the geometry is a file that says none.
    """
    found = scene.geometry.contact_mesh_size or scene.geometry.mesh_size
    if found is None:
        raise SceneError("geometry.mesh_size: missing, there is none to refine")
    return float(found)
