"""Meshes are reported, resolved, cut into sets and compiled for."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import warnings
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial import Delaunay

from shared.problems import scene_of, two_blocks
from shared.processes import running, wait_for
from shared.ranks import mpirun
from stickslip.geometry.bisection import bisection, sets_beside
from stickslip.geometry.errors import MachineError
from stickslip.geometry.form_cache import LOCK, find_cache, once, patient, remove_left_over
from stickslip.geometry.mesh.cell_quality import worst_quality
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.solvers.accuracy.errors import BLIND, elements_touched, unresolved
from stickslip.solvers.results.step_result import Quantity
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import prepare as estimating
from stickslip.workflows.lab.verification.cases import hertz
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.run.mesh_report import can_touch, report_mesh
from stickslip.workflows.run.warnings import doubts
from stickslip.workflows.scene_file.read import from_dict


@pytest.mark.parametrize(
    ("dim", "cells", "order", "expected"),
    [
        (2, "tensor", 1, 1.0),
        (3, "tensor", 2, 1.0),
        (2, "simplex", 1, np.sqrt(3) / 2),  # half a square: 2 |J| / |J|^2 = 4 A / (sum of squared edges / sqrt(3))
        (2, "simplex", 2, np.sqrt(3) / 2),
    ],
)
def test_quality_of_squares_and_of_cubes(dim: int, cells: str, order: int, expected: float) -> None:
    scene = scene_of(dim, {"cells": cells, "order": order})
    mesh = build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF)
    assert worst_quality(mesh.domain, mesh.degree) == pytest.approx(expected)


def test_a_flattened_cell_has_a_poor_quality() -> None:
    scene = scene_of(2, {"cells": "tensor"})
    mesh = build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF)
    mesh.domain.geometry.x[:, 1] *= 0.1
    assert worst_quality(mesh.domain, mesh.degree) == pytest.approx(
        2 * 0.1 / (1 + 0.1**2)
    )  # a rectangle of sides 1 and 0.1


def test_prescribed_motion_closes_gaps_up_to_its_size() -> None:
    supports = {"top": {"boundary": "block.top", "displacement": {"y": [[0, 0], [0.5, -0.2], [1, 0]]}}}
    scene = scene_of(supports=supports)
    assert can_touch(scene, np.array([-0.1, 0.0, 0.19, 0.21]), 2.0).tolist() == [True, True, True, False]


POINT = {"boundary": "block.top", "point": [0.5, 0.5]}
ROLLER = {"shape": "plane", "point": [0.0, -1.0], "normal": [0.0, 1.0]}


@pytest.mark.parametrize(
    ("tables", "closes"),
    [
        ({"loads": {"top": {"boundary": "block.top", "pressure": 1.0}}}, True),
        ({"obstacles": {"foundation": ROLLER | {"force": {"y": 1.0}}}}, True),
        ({"remote_points": {"lid": POINT | {"coupling": "distributing", "force": {"y": -1.0}}}}, True),
        ({"remote_points": {"lid": POINT | {"coupling": "distributing", "moment": {"z": -1.0}}}}, True),
        ({"remote_points": {"lid": POINT | {"coupling": "rigid", "rotation": {"z": 0.1}}}}, True),
        ({"remote_points": {"lid": POINT | {"coupling": "distributing", "force": {"y": 0.0}}}}, False),
        ({}, False),
    ],
)
def test_what_pushes_closes_the_least_gap_and_indents(tables: dict[str, Any], closes: bool) -> None:
    gap = np.array([0.5, 0.519, 0.521])  # 1 % of 2 m beyond the smallest
    assert can_touch(scene_of(**tables), gap, 2.0).tolist() == [closes, closes, False]


LOAD, RADII, E, NU = 500.0, (0.01, 0.1), 210e6, 0.3
EXACT = hertz.cylinder(LOAD, 1 / sum(1 / r for r in RADII), hertz.plane_strain(E, NU) / 2)


def rollers(order: int, lower: float, swap: bool = False) -> Scene:
    """A roller on a larger one, with elements of 3e-5 m at the pole; those of the larger one have `lower` [m]."""
    sides = ["lower.arc", "upper.arc"] if swap else ["upper.arc", "lower.arc"]
    return from_dict({
        "model": "plane strain",
        "geometry": {
            "builder": "cylinders", "radius": RADII[0], "lower_radius": RADII[1], "symmetric": True, "order": order,
            "mesh_size": 0.01 * 3e-5 / lower, "lower_mesh_size": 0.01,
            "contact_mesh_size": 3e-5, "contact_radius": 4e-4,
        },
        "bodies": {"upper": {"E": E, "nu": NU}, "lower": {"E": E, "nu": NU}},
        "contacts": {"pole": {"surface": sides[0], "against": sides[1]}},
        "supports": {
            "axis": {"boundary": "upper.axis", "displacement": {"x": 0.0}},
            "axis2": {"boundary": "lower.axis", "displacement": {"x": 0.0}},
            "base": {"boundary": "lower.base", "displacement": {"y": 0.0}},
        },
        "loads": {"top": {"boundary": "upper.top", "force": [0.0, -LOAD / 2]}},
    })  # fmt: skip


@pytest.mark.parametrize(("order", "swap"), [(1, False), pytest.param(2, False, marks=pytest.mark.slow), (2, True)])
def test_an_unresolved_contact_is_warned_of_with_large_errors(order: int, swap: bool) -> None:
    simulation = estimating(rollers(order, lower=1.5e-3, swap=swap))
    (step,) = simulation.steps()
    (found,), (rows,) = simulation.errors([step]), simulation.system.contacts
    contact = step.contacts["pole"]
    assert unresolved(rows, contact)
    for name, true in (("max_pressure", EXACT.p0), ("contact_area", EXACT.a)):
        value, error = getattr(contact, name), found[Quantity("contacts", "pole", name)].total
        assert error >= max(value, 0.7 * abs(value - true))
    force = found[Quantity("contacts", "pole", "normal_force")].total
    assert force < 0.1 * contact.normal_force  # that is the load
    warning, *_ = doubts(simulation, [step])
    assert "too few for the maximum pressure; refine geometry.lower_mesh_size" in warning
    assert ("elements of lower.arc across" in warning) is not swap


def test_a_side_of_two_elements_is_warned_of_alone() -> None:
    simulation = estimating(rollers(2, lower=1e-4))
    (step,) = simulation.steps()
    (found,), (rows,) = simulation.errors([step]), simulation.system.contacts
    own, other = elements_touched(rows, step.contacts["pole"])
    assert own == pytest.approx(EXACT.a / 3e-5, rel=0.15)
    assert other == pytest.approx(EXACT.a / 1e-4, rel=0.25)
    error = found[Quantity("contacts", "pole", "max_pressure")].total
    assert 0.7 * abs(step.contacts["pole"].max_pressure - EXACT.p0) < error < 0.02 * EXACT.p0
    assert f"has only {other:.2g} elements of lower.arc across" in next(doubts(simulation, [step]))


@pytest.mark.parametrize("dim", [2, 3])
def test_elements_of_flat_sides_are_counted(dim: int) -> None:
    down = dict.fromkeys("xyz"[:dim], 0.0) | {"xyz"[dim - 1]: -0.1}
    shape = {"length": 1.0, "height": 1.0, "width": 1.0, "lower_mesh_size": 1.0, "cells": "tensor"}
    if dim == 2:
        del shape["width"]
    bodies = {name: {"E": 1.0, "nu": 0.0} for name in ("upper", "lower")}
    scene = two_blocks(dim, down, geometry=shape, bodies=bodies)
    simulation = prepare(scene)
    (step,) = simulation.steps()
    (rows,) = simulation.system.contacts
    assert elements_touched(rows, step.contacts["joint"]) == pytest.approx((4.0, 1.0))
    assert BLIND < 1  # one element that is covered wholly is no unresolved contact
    assert not unresolved(rows, step.contacts["joint"])
    assert not list(doubts(simulation, [step]))
    report = report_mesh(scene, simulation.mesh, 0, [rows]).contacts["joint"]
    assert (report.elements_across, report.other_elements_across) == (4, 1)
    assert report.other_size == pytest.approx(4.0)


def grid(*shape: int) -> np.ndarray:
    return np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in shape), indexing="ij"), axis=-1).reshape(-1, len(shape))


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 64])
def test_sets_are_as_large_as_each_other(count: int) -> None:
    points = np.random.default_rng(1).normal(size=(1001, 3))
    sizes = np.bincount(bisection(points, count), minlength=count)
    assert sizes.max() - sizes.min() <= 1 + np.log2(count)


def test_more_sets_than_points_leave_some_empty() -> None:
    assert np.unique(bisection(grid(3, 1), 5)).size == 3
    assert not len(bisection(np.zeros((0, 2)), 5))


def test_a_layer_of_cells_at_one_height_is_cut_along_a_line() -> None:
    noise = np.random.default_rng(2).normal(scale=1e-15, size=(9 * 9 * 9, 3))  # as gmsh leaves it
    found = bisection(grid(9, 9, 9) + noise, 2).reshape(9, 9, 9)
    cut = sum(int(np.count_nonzero(np.diff(found, axis=axis))) for axis in range(3))
    assert cut <= 9 * 9 + 9 + 1  # a plane, with a step of one cell across it and one along the line


def test_cuts_are_across_the_longest_extent() -> None:
    found = bisection(grid(8, 2, 1), 4).reshape(8, 2)
    assert (found == np.arange(8)[:, None] // 2).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_cells_beside_another_set_are_those_that_share_a_facet_with_it(dim: int) -> None:
    cells = Delaunay(np.random.default_rng(3).random((60, dim))).simplices.astype(np.int64)
    sets = np.random.default_rng(4).integers(0, 4, len(cells))
    expected = {
        pair
        for i, j in combinations(range(len(cells)), 2)
        if sets[i] != sets[j] and len(set(cells[i]) & set(cells[j])) == dim
        for pair in ((i, sets[j]), (j, sets[i]))
    }
    assert set(zip(*sets_beside(cells, sets, dim), strict=True)) == expected


def test_hexahedra_that_share_an_edge_alone_are_not_beside_each_other() -> None:
    corners = np.array([[0, 1, 2, 3, 4, 5, 6, 7], [6, 7, 8, 9, 10, 11, 12, 13], [4, 5, 6, 7, 14, 15, 16, 17]])
    cell, beside = sets_beside(corners, np.array([0, 1, 2]), 3)
    assert list(zip(cell, beside, strict=True)) == [(0, 2), (2, 0)]


def test_one_set_has_none_beside_it() -> None:
    cell, beside = sets_beside(np.array([[0, 1, 3, 2]]), np.zeros(1, np.int64), 2)
    assert not len(cell)
    assert not len(beside)


WORDS = ["geometry.mesh_size=1.0", "output.error=false"]
PROGRAM = f"import stickslip; print(len(list(stickslip.steps(stickslip.read('block', {WORDS})))))"
LIMIT = 60  # s; FFCx itself would wait for 600


def leave_over(cache: Path) -> list[Path]:
    """As a kill in the middle leaves it: every form is begun, none is compiled."""
    found = sorted(cache.glob("*.c"))
    for path in found:
        path.write_text("")
        for other in cache.glob(f"{path.stem}.*"):
            if other != path:
                other.unlink()
    return found


def run(cache: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, "XDG_CACHE_HOME": str(cache)},
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )


@pytest.mark.slow  # of one process below
def test_forms_whose_compilation_was_killed_are_compiled_again_by_several_ranks(tmp_path: Path) -> None:
    assert run(tmp_path).stdout == "2\n"
    left = leave_over(tmp_path / "stickslip")
    assert len(left) > 1
    ranks = mpirun(2, [], tmp_path, ("-c", f"import os; os.environ['XDG_CACHE_HOME'] = {str(tmp_path)!r}; {PROGRAM}"))
    assert ranks.returncode == 0, ranks.stderr
    assert all(path.with_suffix(".c.cached").exists() for path in left)


def test_process_killed_while_it_compiles_holds_up_nobody(tmp_path: Path) -> None:
    cache = tmp_path / "stickslip"
    with running(
        [sys.executable, "-c", PROGRAM], env={**os.environ, "XDG_CACHE_HOME": str(tmp_path)}, start_new_session=True
    ) as process:
        wait_for(lambda: list(cache.glob("*.c")), "a form", process.pid)
        os.killpg(process.pid, signal.SIGKILL)
    assert [path for path in cache.glob("*.c") if not path.with_suffix(".c.cached").exists()]
    done = run(tmp_path)
    assert (done.returncode, done.stderr) == (0, "")  # a script hears nothing of the compiler


def test_form_that_a_living_process_compiles_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "libffcx_forms_a.c").touch()
    (tmp_path / "libffcx_forms_b.c").touch()
    (tmp_path / "libffcx_forms_b.c.cached").touch()
    with (tmp_path / LOCK).open("w") as other:
        fcntl.flock(other, fcntl.LOCK_SH)
        assert remove_left_over(tmp_path) == 0
        assert (tmp_path / "libffcx_forms_a.c").exists()
    assert remove_left_over(tmp_path) == 1
    assert sorted(path.name for path in tmp_path.glob("lib*")) == ["libffcx_forms_b.c", "libffcx_forms_b.c.cached"]
    assert remove_left_over(tmp_path) == 0


class OneRank:
    rank, size = 0, 1

    def barrier(self) -> None:
        """Nobody to wait for."""

    def allgather(self, said: bool) -> list[bool]:
        return [said]


class WithANewcomer(OneRank):
    """A rank beside one that has compiled nothing yet."""

    def allgather(self, said: bool) -> list[bool]:
        return [said, False]


def test_compiler_that_fails_is_said_in_one_line(tmp_path: Path) -> None:
    def fail(comm: Any) -> None:
        raise RuntimeError("command 'gcc' failed\nwith exit code 1")

    with pytest.raises(MachineError, match=r"forms cannot be compiled there: command 'gcc' failed$"):
        patient(fail, tmp_path)(OneRank())


def test_another_process_is_waited_for(tmp_path: Path) -> None:
    calls = []

    def late(comm: Any) -> str:
        calls.append(comm)
        if len(calls) < 3:
            raise TimeoutError("JIT compilation timed out, probably due to a failed previous compile.")
        return "compiled"

    assert patient(late, tmp_path)(OneRank()) == "compiled"
    assert len(calls) == 3


def test_cache_of_others_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever could write there could have a program of his own run."""
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null")
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path))
    folder, note = find_cache()
    assert (folder.parent, note.startswith(f"compiled forms are kept in {folder}")) == (tmp_path, True)
    folder.chmod(0o777)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    other, _ = find_cache()
    assert other != folder
    assert other.stat().st_mode & 0o077 == 0


def test_many_integration_points_are_no_warning(tmp_path: Path) -> None:
    """FFCx warns of 216 points in a hexahedron, which loads by expressions ask for."""

    def compiled(comm: Any) -> str:
        warnings.warn("Number of integration points per cell is: 216. Consider using ...", stacklevel=1)
        return "compiled"

    assert patient(compiled, tmp_path)(OneRank()) == "compiled"


def test_what_is_known_is_loaded_once_unless_another_rank_needs_it() -> None:
    calls = []

    def compiled(comm: Any, asked: Any, options: Any) -> int:
        calls.append(asked)
        return len(calls)

    asking = once(compiled)
    assert [asking(OneRank(), asked, options={"n": 1}) for asked in ("P1", "P2", "P1")] == [1, 2, 1]
    assert asking(OneRank(), "P1", options={"n": 2}) == 3
    assert asking(WithANewcomer(), "P1", options={"n": 1}) == 4  # compiling is collective
    assert [asking(OneRank(), ("an expression", "points"), options={}) for _ in range(2)] == [5, 6]
