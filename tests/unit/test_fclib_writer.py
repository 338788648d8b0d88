"""Output fclib: what another program solves from the files is what the run has found."""

import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import often
from shared.histories import SMALL, Stop
from stickslip.geometry.errors import SceneError
from stickslip.solvers.interface.discrete import discrete_problem
from stickslip.solvers.stepping.discrete_chain import solve
from stickslip.workflows.formats.fclib import read_problem
from stickslip.workflows.formats.steps import read_step, step_name
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read, to_dict
from stickslip.workflows.writers.writer import wanted

COARSE = ["geometry.mesh_size=1.0", "geometry.contact_mesh_size=0.5"]
EXPORT = ["output.pictures=false", "output.fclib=true", "solver.tolerance=1e-12", "solver.surface=condensed"]
CASES = {
    "block": COARSE,
    "block with a gap": [*COARSE, "contacts.base.gap_offset=0.02"],
    "block without friction": [*COARSE, "contacts.base.friction={law='coulomb', mu=0.0}"],
    "cube": ["geometry.mesh_size=0.34"],
    "two_blocks": ["geometry.mesh_size=1.0", "geometry.lower_mesh_size=1.0", "geometry.contact_mesh_size=0.25"],
    "raous": ["geometry.mesh_size=20e-3"],
}


def scene_of(case: str, *words: str) -> Any:
    return read(case.split()[0], [*CASES.get(case, []), *EXPORT, *words])


@pytest.mark.parametrize("case", often(CASES, ("block without friction", "cube", "two_blocks")))
def test_solving_the_files_gives_the_tractions_of_the_run(tmp_path: Path, case: str) -> None:
    scene = scene_of(case)
    outcome, _ = run(scene, tmp_path / "out")
    assert outcome.status == "converged"
    files = sorted((tmp_path / "out" / "fclib").iterdir())
    assert [path.name for path in files] == [f"{k:06d}.hdf5" for k in range(1, len(scene.requested_times()) + 1)]
    simulation = prepare(scene)
    cone, W = simulation.stepper.cone, simulation.stepper.surface.W
    d = scene.dim
    for index, path in enumerate(files, start=1):
        stored = read_problem(path)
        problem = discrete_problem(stored.W, stored.q, stored.mu)
        found = solve(problem, "auto", 1e-12)
        assert found.solved
        r = problem.reactions(found.solution.p).reshape(-1, d)
        step = read_step(tmp_path / "out" / step_name(index))
        forces = W * step.p
        size = np.abs(forces).max()
        (place,) = cone.places
        assert_allclose(r[:, 0], forces[place.normal], atol=1e-7 * size)
        if place.tangential.start < place.tangential.stop:
            free = place.rows.free.ravel()
            assert_allclose(r[:, 1:].ravel()[free], forces[place.tangential][free], atol=1e-7 * size)
        with h5py.File(path) as file:  # the run's own answer
            assert_allclose(file["solution/r"][()].reshape(-1, d), r, atol=1e-7 * size)
            u = file["solution/u"][()]
        assert_allclose(stored.W @ file_r(path) + stored.q, u, atol=1e-12 * np.abs(u).max())


def file_r(path: Path) -> Any:
    with h5py.File(path) as file:
        return file["solution/r"][()]


def test_friction_matters_in_the_files(tmp_path: Path) -> None:
    scene = scene_of("block")
    run(scene, tmp_path / "out")
    stored = read_problem(tmp_path / "out" / "fclib" / "000002.hdf5")
    assert set(stored.mu) == {0.3}
    with_it, without = (
        solve(discrete_problem(stored.W, stored.q, mu), "auto", 1e-10).solution.p for mu in (stored.mu, 0 * stored.mu)
    )
    assert np.abs(with_it - without).max() > 0.1 * np.abs(with_it).max()


def test_a_resumed_run_has_the_files_of_all_its_steps(tmp_path: Path) -> None:
    """Stopped without this output, gone on with it; a file of a step that a crash has taken is removed."""
    scene = read("block", [*SMALL, "output.fclib=true"])
    plain = read("block", SMALL)
    run(scene, tmp_path / "whole")
    run(plain, tmp_path / "out", Watch(on_step=Stop(after=3)))
    extra = tmp_path / "out" / "fclib" / "000005.hdf5"
    extra.parent.mkdir()
    extra.write_bytes(b"left over")
    outcome, _ = run(scene, tmp_path / "out", resume=True)
    assert outcome.status == "converged"
    one, other = (sorted((tmp_path / name / "fclib").iterdir()) for name in ("whole", "out"))
    assert [path.name for path in one] == [path.name for path in other]
    for a, b in zip(one, other, strict=True):
        assert_allclose(read_problem(a).q, read_problem(b).q, atol=1e-12)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["contacts.base.normal={law='compliance', c_n=20.0, m_n=1.0}"], 'contacts.base.normal is not "unilateral"'),
        (["contacts.base.friction={law='tresca', bound=0.1}"], 'contacts.base.friction is neither "coulomb"'),
        (["contacts.base.friction={law='coulomb', mu=0.3, k_T=5.0}"], "without k_T nor absent"),
        (["contacts.base.sliding=true"], "contacts.base.sliding changes the contact points"),
        (["solver.surface=matrix-free", "solver.method=surface-uzawa"], "needs solver.surface = condensed"),
    ],
)
def test_what_the_format_cannot_say_is_refused_before_meshing(words: list[str], why: str) -> None:
    with pytest.raises(SceneError, match=f"^output.fclib = True: .*{re.escape(why)}"):
        wanted(read("block", ["output.fclib=true", *words]))


def test_what_only_the_assembled_scene_tells_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="contact alone holds a body"):
        run(read("arch", ["output.fclib=true", "output.pictures=false"]), tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_a_scene_that_does_not_ask_is_as_before() -> None:
    scene = read("block")
    assert "fclib" not in str(to_dict(scene))
    assert "FclibFiles" not in {kind.__name__ for kind in wanted(scene)}
