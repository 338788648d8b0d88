"""Nothing of a run stays in memory once Python has let it go: neither meshes nor what PETSc has made on them."""

import subprocess
import sys
from pathlib import Path

import pytest

from shared.cases import slow
from shared.ranks import mpirun
from stickslip.geometry.user_files.child_process import child_environment
from stickslip.solvers.method_registry import METHODS

RUNS = """
import gc
import weakref

from mpi4py import MPI

import stickslip
from stickslip.solvers.parallel.released import destroy_released


def solved(name, *overrides):
    simulation = stickslip.prepare(stickslip.read(name, overrides))
    for step in simulation.steps():
        assert step.contacts
    return weakref.ref(simulation.mesh)


for name in ("block", "cube"):  # modules that are imported leave reference cycles of their own
    solved(name, "{COARSE}")
gc.collect()
gc.disable()
for words in {words}:
    assert solved(*words)() is None, words
    destroy_released(MPI.COMM_WORLD)
"""
COARSE = "geometry.mesh_size=0.5"
FORMS = [("cube", COARSE, f'solver.surface="{form}"') for form in ("condensed", "matrix-free")]


def left(words: list[tuple[str, ...]]) -> str:
    """What PETSc says at the end of a process of the objects that were not destroyed."""
    environment = {**child_environment(), "PETSC_OPTIONS": "-objects_dump"}
    script = RUNS.format(words=words, COARSE=COARSE)
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("first", [0, *slow(1, 2)])
def test_every_method_and_both_forms_of_the_bodies_give_their_memory_back(first: int) -> None:
    methods = [("cube", COARSE, "output.error=false", f'solver.method="{name}"') for name in [*METHODS][first::3]]
    spheres = ("spheres", COARSE, "geometry.contact_mesh_size=0.2")
    assert left([*methods, *FORMS, spheres, ("block", "geometry.order=2")]) == ""


@pytest.mark.slow  # one rank does it above
def test_ranks_give_their_memory_back(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(RUNS.format(words=FORMS, COARSE=COARSE), encoding="utf-8")
    done = mpirun(2, ["-objects_dump"], tmp_path, (str(script),))
    assert (done.returncode, done.stdout.strip()) == (0, ""), done.stderr


ENDS = """
import sys

from petsc4py import PETSc

import stickslip.solvers.parallel.released


def end():
    kept = PETSc.Vec().createMPI(2, comm=PETSc.COMM_WORLD)  # by this frame, until PETSc has ended
    vector = PETSc.Vec().createMPI(2, comm=PETSc.COMM_WORLD)
    shown = vector.array_r
    if kept.comm.rank:
        del vector, shown  # destroyed here
    else:
        del shown, vector  # marked here: PETSc waits for the other rank
    sys.exit(3)


end()
"""


def test_ranks_end_that_have_released_a_vector_in_different_ways(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(ENDS, encoding="utf-8")
    assert mpirun(2, [], tmp_path, (str(script),)).returncode == 3
