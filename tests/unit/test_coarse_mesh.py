"""A coarse mesh beside tells what smooth forces do on the fine one, or is not made where it would not pay."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from shared.drawn import GEO, draw, scene_data
from stickslip.solvers.interface.coarse_mesh import LEAST, CoarseMesh
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.prepare import prepare_surface
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.methods.surface_uzawa import LearningIteration
from stickslip.solvers.metrics import surface_metric
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.system.system import System
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict, read

Array = NDArray[np.float64]
SceneOf = Callable[..., Scene]
SystemOf = Callable[[Scene], System]
BASE = {"base": {"surface": "block.bottom", "against": "foundation"}}


def block(scene_of: SceneOf, dim: int, n: int, floating: bool = False) -> Scene:
    top = {"boundary": "block.top", "displacement": dict.fromkeys("xyz"[:dim], 0.0)}
    size = {"mesh_size": 1 / n, "cells": "tensor"}
    return scene_of(dim, size, contacts=BASE, supports={} if floating else {"top": top})


def condensed(system: System) -> CondensedSurface:
    surface = prepare_surface(system, FactorisedVolume(system.K_B, system.interface.dofs, Counters()))
    assert isinstance(surface, CondensedSurface)
    return surface


SCENES: dict[str, Callable[[SceneOf], Scene]] = {
    "block": lambda make: block(make, 2, 16),
    "cube": lambda make: block(make, 3, 6),
    "two bodies": lambda make: read("two_blocks", ["geometry.mesh_size=0.25", "geometry.contact_mesh_size=0.12"]),
    "one held, one not, curved": lambda make: read(
        "cylinders", ["geometry.mesh_size=2.0", "geometry.contact_mesh_size=0.12"]
    ),
    "floating in the plane": lambda make: block(make, 2, 16, floating=True),
    "floating in space": lambda make: block(make, 3, 6, floating=True),
}


@pytest.mark.parametrize("name", SCENES)
def test_smooth_forces_do_about_what_it_says(name: str, scene_of: SceneOf, system_of: SystemOf) -> None:
    """Cells twice as large, of order 1: their energy is wrong by a few percent where the force is a parabola."""
    fine = system_of(SCENES[name](scene_of))
    coarse, exact = CoarseMesh.beside(fine), condensed(fine)
    assert coarse is not None
    assert coarse.system.constraints.free_total <= LEAST * fine.constraints.free_total
    forces, displacements = coarse.smooth_responses(fine, exact.R, exact.rho)
    true = exact.flexibility @ forces
    work, true_work = forces.T @ displacements, forces.T @ true
    acting = np.diag(true_work) > 1e-12 * np.diag(true_work).max()  # flat sides: the square of 0 is 0
    assert acting.sum() >= 3 * fine.mesh.dim  # 1, x, x² for each component, at least
    assert_allclose(np.diag(work)[acting], np.diag(true_work)[acting], rtol=0.15 if fine.mesh.dim == 2 else 0.2)
    assert_allclose(work, true_work, rtol=0, atol=0.1 * np.abs(true_work).max())
    assert not displacements[:, ~acting].any()


def test_a_rigid_motion_is_answered_by_the_augmentation_of_the_fine_bodies(
    scene_of: SceneOf, system_of: SystemOf
) -> None:
    fine = system_of(block(scene_of, 2, 16, floating=True))
    coarse, exact = CoarseMesh.beside(fine), condensed(fine)
    assert coarse is not None
    for rho in (exact.rho, 7 * exact.rho):
        forces, displacements = coarse.smooth_responses(fine, exact.R, rho)
        assert_allclose(exact.R.T @ displacements, exact.R.T @ forces / rho, atol=1e-12 * np.abs(forces).max() / rho)


def test_the_method_begins_with_what_it_says(scene_of: SceneOf, system_of: SystemOf) -> None:
    """The metric alone is wrong by half for smooth forces, primed it is right."""
    fine = system_of(block(scene_of, 3, 6))
    coarse, exact, metric = CoarseMesh.beside(fine), condensed(fine), surface_metric(fine)
    assert coarse is not None
    smooth = coarse.smooth_responses(fine, exact.R, exact.rho)
    primed = LearningIteration(metric=metric, smooth=lambda: smooth)._primed()
    press = smooth[0][:, 2]  # of a constant normal traction
    true = press @ exact.flexibility @ press
    assert abs(press @ primed(press) / true - 1) < 0.1
    assert abs(press @ metric(press) / true - 1) > 0.2


def test_a_mesh_file_has_no_coarse_mesh_beside(system_of: SystemOf, tmp_path: Path) -> None:
    data = scene_data(draw(tmp_path / "b.msh", 2))
    assert CoarseMesh.beside(system_of(from_dict(data))) is None
    (tmp_path / "b.geo").write_text(GEO)
    drawn_anew = scene_data(tmp_path / "b.geo", mesh_size=0.2)
    assert CoarseMesh.beside(system_of(from_dict(drawn_anew))) is not None


@pytest.mark.parametrize(("n", "there"), [(2, True), (1, False)])
def test_no_coarse_mesh_where_it_is_hardly_coarser(n: int, there: bool, scene_of: SceneOf, system_of: SystemOf) -> None:
    fine = system_of(block(scene_of, 2, n))
    coarse = CoarseMesh.beside(fine)
    assert (coarse is not None) == there


def test_its_work_stands_in_the_result(tmp_path: Path) -> None:
    words = ["geometry.mesh_size=0.2", "output.error=false", "output.pictures=false"]
    solver = 'solver={ method = "surface-uzawa", surface = "matrix-free" }'
    _, result = run(read("cube", [*words, solver]), tmp_path / "out")
    work = result["counters"]["coarse_mesh"]
    assert work["factorisations"] == 1
    assert work["volume_solves"] > 0
