"""The bodies without a matrix on the surface: the displacement asked for, as exact as asked for."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from solvers.condensed import CondensedSurface
from solvers.counters import Counters
from solvers.iterative_volume import IterativeVolume
from solvers.matrix_free import MatrixFreeSurface
from solvers.nouns.scene import Scene
from solvers.prepare import prepare_surface
from solvers.system import System
from solvers.volume import Volume
from workflows.scene import read

Array = NDArray[np.float64]
SceneOf = Callable[..., Scene]
SystemOf = Callable[[Scene], System]
BASE = {"base": {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": 0.3}}}
PUSH = {"push": {"boundary": "block.right", "pressure": 0.1}}


def block(scene_of: SceneOf, dim: int, order: int = 1, cells: str = "tensor", floating: bool = False) -> Scene:
    top = {"boundary": "block.top", "displacement": dict(zip("xyz"[:dim], (0.01, -0.1, -0.05), strict=False))}
    size = {"mesh_size": 0.0625 if dim == 2 else 0.25, "order": order, "cells": cells}
    return scene_of(dim, size, contacts=BASE, supports={} if floating else {"top": top}, loads=PUSH)


def driven(scene_of: SceneOf) -> Scene:
    plane = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "force": {"x": 0.01, "y": 0.2}}
    return replace(block(scene_of, 2), obstacles=scene_of(2, obstacles={"foundation": plane}).obstacles)


SCENES: dict[str, Callable[[SceneOf], Scene]] = {
    "quadrilaterals": lambda make: block(make, 2),
    "triangles of order 2": lambda make: block(make, 2, 2, "simplex"),
    "hexahedra": lambda make: block(make, 3),
    "tetrahedra": lambda make: block(make, 3, 1, "simplex"),
    "hexahedra of order 2": lambda make: block(make, 3, 2),
    "floating in the plane": lambda make: block(make, 2, floating=True),
    "floating in space": lambda make: block(make, 3, floating=True),
    "driven obstacle": driven,
    "two bodies": lambda make: read("two_blocks", ["geometry.mesh_size=0.25", "geometry.contact_mesh_size=0.12"]),
    "one held, one not": lambda make: read("cylinders", ["geometry.mesh_size=2.0", "geometry.contact_mesh_size=0.12"]),
    "three held by contact": lambda make: read("stack"),
    "turned supports": lambda make: read("arch", ["geometry.mesh_size=0.4"]),
}


@pytest.fixture(scope="module", params=SCENES)
def both(request: pytest.FixtureRequest, scene_of: SceneOf, system_of: SystemOf) -> tuple[Any, Any, System]:
    """The same bodies condensed and not, with the same augmentation."""
    system = system_of(SCENES[request.param](scene_of))
    exact = prepare_surface(system, Volume(system.K_B, system.contact_dofs, Counters()))
    free = prepare_surface(replace(system, counters=Counters()), IterativeVolume(system))
    exact.rho = free.rho
    return exact, free, system


def load_of(surface: Any, system: System, error: float = 0.0) -> Any:
    f = system.T.createVecRight()
    system.T.multTranspose(system.load(1.0) - system.K * system.prescribed(1.0), f)
    return surface.load(f, system.driving_force(1.0), error)


def test_displacement_is_that_of_the_condensed_surface(both: tuple[Any, Any, System]) -> None:
    exact, free, system = both
    assert isinstance(exact, CondensedSurface)
    assert isinstance(free, MatrixFreeSurface)
    force = np.random.default_rng(0).normal(size=exact.size)
    u_c = exact.displacement(force)
    assert_allclose(free.displacement(force), u_c, rtol=0, atol=1e-10 * np.abs(u_c).max())
    given = load_of(exact, system)
    size = np.abs(given.free).max()
    found = load_of(free, system, 1e-10 * size)
    assert_allclose(found.free, given.free, rtol=0, atol=1e-10 * size)
    assert_allclose(found.resultant, given.resultant, rtol=0, atol=1e-11 * found.magnitude)
    assert_allclose(free.R.T @ found.f_c, found.resultant, rtol=0, atol=1e-13 * found.magnitude)
