"""The layer of cells next to the contact gives less than the bodies do, and all that they give where it is the body."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.linalg import eigh, null_space

from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.prepare import prepare_surface
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.metrics import ContactLayer
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.system.system import System
from stickslip.workflows.scene_file.read import read

Array = NDArray[np.float64]
SceneOf = Callable[..., Scene]
SystemOf = Callable[[Scene], System]
BASE = {"base": {"surface": "block.bottom", "against": "foundation"}}
WHOLE = 100  # cells: more than there are one below the other


def block(scene_of: SceneOf, dim: int, order: int = 1, cells: str = "tensor", floating: bool = False) -> Scene:
    top = {"boundary": "block.top", "displacement": dict.fromkeys("xyz"[:dim], 0.0)}
    size = {"mesh_size": 0.125 if dim == 2 else 0.25, "cells": cells, "order": order}
    return scene_of(dim, size, contacts=BASE, supports={} if floating else {"top": top})


def bodies(system: System) -> tuple[Array, Array]:
    """(K_B + rho R R^T)^-1 on the contact dofs, and R."""
    surface = prepare_surface(system, FactorisedVolume(system.K_B, system.interface.dofs, Counters()))
    assert isinstance(surface, CondensedSurface)
    return surface.flexibility, surface.R


def given(system: System, cells: int) -> Array:
    layer = ContactLayer(system, cells)
    F = layer(np.eye(len(system.interface.dofs)))
    assert_allclose(F[:, 0], layer(np.eye(len(F))[0]), rtol=0, atol=1e-14 * np.abs(F).max())
    assert_allclose(F, F.T, rtol=0, atol=1e-12 * np.abs(F).max())
    return F


SCENES: dict[str, Callable[[SceneOf], Scene]] = {
    "quadrilaterals": lambda make: block(make, 2),
    "triangles of order 2": lambda make: block(make, 2, 2, "simplex"),
    "hexahedra": lambda make: block(make, 3),
    "tetrahedra": lambda make: block(make, 3, 1, "simplex"),
    "two bodies": lambda make: read("two_blocks", ["geometry.mesh_size=0.25", "geometry.contact_mesh_size=0.12"]),
    "floating in the plane": lambda make: block(make, 2, floating=True),
    "floating in space": lambda make: block(make, 3, floating=True),
}


@pytest.mark.parametrize("name", SCENES)
def test_it_gives_less_than_the_bodies_and_more_the_deeper_it_is(
    name: str, scene_of: SceneOf, system_of: SystemOf
) -> None:
    """What is held gives less. Only forces in balance compare where bodies float: other ones move them as a whole."""
    system = system_of(SCENES[name](scene_of))
    F, R = bodies(system)
    balanced = null_space(R.T) if R.shape[1] else np.eye(len(F))
    depths = [given(system, cells) for cells in (1, 2)] + [F]
    for less, more in pairwise(depths):
        ratio = eigh(balanced.T @ less @ balanced, balanced.T @ more @ balanced, eigvals_only=True)
        assert ratio[-1] <= 1 + 1e-8
        assert 0 < ratio[0] < 0.9  # a smooth force is carried deeper than that


@pytest.mark.parametrize("name", [name for name in SCENES if "floating" not in name])
def test_it_is_exact_where_it_is_the_whole_of_the_bodies(name: str, scene_of: SceneOf, system_of: SystemOf) -> None:
    system = system_of(SCENES[name](scene_of))
    F, _ = bodies(system)
    assert_allclose(given(system, WHOLE), F, rtol=0, atol=1e-9 * np.abs(F).max())


@pytest.mark.parametrize("dim", [2, 3])
def test_springs_hold_a_floating_body_that_is_layer_altogether(
    dim: int, scene_of: SceneOf, system_of: SystemOf
) -> None:
    system = system_of(block(scene_of, dim, floating=True))
    F, _ = bodies(system)
    values = np.linalg.eigvalsh(given(system, WHOLE))
    assert values[0] > 0
    assert values[-1] < 1e3 * np.abs(F).max()  # without them, 1e16 and more


def test_local_forces_are_given_way_to_as_by_the_bodies(scene_of: SceneOf, system_of: SystemOf) -> None:
    """The roughest force there is, +1 and -1 in turns, is not felt below two cells."""
    system = system_of(block(scene_of, 2))
    F, _ = bodies(system)
    rough = np.zeros(len(F))
    rough[1::2] = (-1.0) ** np.arange(len(F) // 2)
    assert_allclose(rough @ given(system, 2) @ rough, rough @ F @ rough, rtol=0.05)
    assert rough @ given(system, 2) @ rough < rough @ F @ rough
