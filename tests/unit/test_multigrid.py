"""Multigrid of a stiffness matrix."""

from collections.abc import Callable

import numpy as np
from numpy.testing import assert_array_equal

from stickslip.geometry.arrays import Array
from stickslip.solvers.linear.multigrid import multigrid
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.system.floating_modes import near_nullspace
from stickslip.solvers.system.system import System

BASE = {"base": {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": 0.3}}}


def test_it_is_set_up_once_even_if_its_matrix_was_changed_for_a_while(
    scene_of: Callable[..., Scene], system_of: Callable[[Scene], System]
) -> None:
    system = system_of(scene_of(3, contacts=BASE))
    K = system.K_B.copy()  # as `system` keeps its own
    pc = multigrid(K, False, lambda: near_nullspace(system), "test_")
    r, z = K.createVecLeft(), K.createVecRight()
    r.array[:] = np.random.default_rng(0).standard_normal(r.getLocalSize())

    def cycle() -> Array:
        pc.apply(r, z)
        return z.array_r.copy()

    before = cycle()
    K.scale(2.0)  # with another matrix it would be half as much
    assert_array_equal(cycle(), before)
