"""Local friction problems are read from and written to files of FCLib."""

import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import sparse

from shared.cases import often
from shared.discrete import KINDS, local, random_problem, stored, write
from shared.histories import SMALL, Stop
from stickslip.geometry.errors import SceneError
from stickslip.solvers.interface.discrete import discrete_problem
from stickslip.solvers.stepping.discrete_chain import solve
from stickslip.workflows.formats.fclib import LocalProblem, ReducedProblem, read_problem, write_local, write_solved
from stickslip.workflows.formats.steps import read_step, step_name
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read, to_dict
from stickslip.workflows.writers.writer import wanted


def global_content(
    kind: str = "columns", constraints: int = 2, **changes: Any
) -> tuple[dict[str, Any], dict[str, Any]]:
    """A global problem of eight motions and three contacts, and its parts."""
    random = np.random.default_rng(7)
    root = random.normal(size=(8, 8))
    parts = {
        "M": root @ root.T + np.eye(8),
        "H": random.normal(size=(8, 9)),
        "G": random.normal(size=(8, constraints)),
        "f": random.normal(size=8),
        "w": random.normal(size=9),
        "b": random.normal(size=constraints),
        "mu": np.array([0.2, 0.3, 0.4]),
        **changes,
    }
    matrices = {name: stored(parts[name], kind) for name in ("M", "H", *(["G"] if constraints else []))}
    vectors = {name: parts[name] for name in ("f", "w", "mu", *(["b"] if constraints else []))}
    return {"fclib_global": {"spacedim": np.array([3], np.int32), **matrices, "vectors": vectors}}, parts


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dim", [2, 3])
def test_a_local_problem_is_read_from_every_storage_kind(tmp_path: Path, kind: str, dim: int) -> None:
    W, q, mu = random_problem(0, dim=dim)
    W[np.abs(W) < 1.0] = 0.0  # so that it is sparse
    found = read_problem(write(tmp_path / "a.hdf5", local(W, q, mu, kind)))
    assert_array_equal(found.W.toarray(), W)
    assert_array_equal(found.q, q)
    assert_array_equal(found.mu, mu)
    assert found.dim == dim


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("constraints", [0, 2])
def test_a_global_problem_is_reduced(tmp_path: Path, kind: str, constraints: int) -> None:
    """Its whole solution satisfies every equation of the global problem."""
    content, parts = global_content(kind, constraints)
    stored_problem = read_problem(write(tmp_path / "a.hdf5", content))
    problem = discrete_problem(stored_problem.W, stored_problem.q, stored_problem.mu)
    p = solve(problem, "auto", 1e-12).solution.p
    r, u = problem.reactions(p), problem.velocities(p)
    others = stored_problem.others(r)
    v, multipliers = others["v"], others.get("l", np.zeros(0))
    assert set(others) == ({"v", "l"} if constraints else {"v"})
    assert_allclose(parts["M"] @ v, parts["H"] @ r + parts["G"] @ multipliers + parts["f"], atol=1e-10)
    assert_allclose(parts["G"].T @ v + parts["b"], 0.0, atol=1e-10)
    assert_allclose(u, parts["H"].T @ v + parts["w"], atol=1e-10)
    assert r.any()


def test_without_constraints_the_reduction_is_the_delassus_matrix(tmp_path: Path) -> None:
    content, parts = global_content(constraints=0)
    found = read_problem(write(tmp_path / "a.hdf5", content))
    assert isinstance(found, ReducedProblem)
    M, H = parts["M"], parts["H"]
    assert_allclose(found.W.toarray(), H.T @ np.linalg.solve(M, H), atol=1e-12)
    assert_allclose(found.q, H.T @ np.linalg.solve(M, parts["f"]) + parts["w"], atol=1e-12)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    W, q, mu = random_problem(2)
    u, r = np.arange(18.0), -np.arange(18.0)
    path, info = tmp_path / "a.hdf5", {"title": "A title", "description": "W r + q", "math_info": ""}
    write_local(path, LocalProblem(W=sparse.csr_matrix(W), q=q, mu=mu), info, {"u": u, "r": r})
    found = read_problem(path)
    assert_array_equal(found.W.toarray(), W)
    assert_array_equal(found.q, q)
    with h5py.File(path) as file:
        assert [int(file[f"fclib_local/W/{name}"][0]) for name in ("m", "n", "nz", "nzmax")] == [18, 18, -1, 18 * 18]
        assert file["fclib_local/info/title"][()].rstrip(b"\0") == b"A title"
        assert_array_equal(file["solution/r"][()], r)


def test_a_copy_has_the_solution_and_all_that_the_file_had(tmp_path: Path) -> None:
    old = {"u": np.ones(18), "r": np.ones(18)}
    source = write(tmp_path / "a.hdf5", {**local(*random_problem(2)), "solution": old, "guesses": {"number": 1}})
    before = source.read_bytes()
    write_solved(source, tmp_path / "b.hdf5", {"u": np.zeros(18), "r": np.arange(18.0)}, {"residual": 0.5})
    assert source.read_bytes() == before
    with h5py.File(tmp_path / "b.hdf5") as file:
        assert_array_equal(file["solution/r"][()], np.arange(18.0))
        assert file["solution"].attrs["residual"] == 0.5
        assert file["guesses/number"][()] == 1
    assert_array_equal(read_problem(tmp_path / "b.hdf5").q, read_problem(source).q)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.hdf5", "b.hdf5"]


def changed(at: str, value: Any) -> dict[str, Any]:
    """A sound local problem with one member replaced; None takes it away."""
    content = local(np.eye(6), np.ones(6), [0.1, 0.2])
    *groups, name = at.split("/")
    place: Any = content["fclib_local"]
    for group in groups:
        place = place[group]
    place[name] = value
    if value is None:
        del place[name]
    return content


def number(n: int) -> Any:
    return np.array([n], np.int32)


WRONG = {  # content, what the line says
    "no problem": ({"other": {"x": 1.0}}, "holds no problem of FCLIB"),
    "rolling friction": ({"fclib_global_rolling": {"spacedim": number(5)}}, "rolling friction: not supported"),
    "no spacedim": (changed("spacedim", None), "/fclib_local/spacedim is missing"),
    "spacedim 5": (changed("spacedim", number(5)), "spacedim = 5: must be 2 or 3"),
    "no W": (changed("W", None), "/fclib_local/W is missing"),
    "no entries": (changed("W/x", None), "/fclib_local/W/x is missing"),
    "no mu": (changed("vectors/mu", None), "vectors/mu is missing"),
    "no contact": (changed("vectors/mu", np.zeros(0)), "there is no contact"),
    "mu too short": (changed("vectors/mu", np.ones(1)), "sizes do not match: spacedim 3, 1 entries of mu, 6 of q"),
    "q too long": (changed("vectors/q", np.ones(7)), "sizes do not match"),
    "mu below 0": (changed("vectors/mu", np.array([0.1, -0.2])), r"entry 1 is -0\.2: must not be negative"),
    "q not a number": (changed("vectors/q", np.full(6, np.nan)), "vectors/q: entry 0 is nan: must be finite"),
    "W infinite": (changed("W/x", np.array([1.0, np.inf, 1, 1, 1, 1])), "W/x: entry 1 is inf"),
    "text for numbers": (changed("vectors/q", np.bytes_(b"six")), "does not hold numbers of the right kind"),
    "W not square": (changed("W", stored(np.ones((6, 5)), "columns")), "W is 6 x 5: must be square"),
    "W of another size": (changed("W", stored(np.eye(9), "rows")), "sizes do not match.*W is 9 x 9"),
    "W not symmetric": (changed("W", stored(np.triu(np.ones((6, 6))), "columns")), "W is not symmetric"),
    "W indefinite": (changed("W", stored(np.diag([1.0, 1, -1, 1, 1, 1]), "columns")), "diagonal entry 2 is -1"),
    "an unknown kind": (changed("W/nz", number(-3)), "nz = -3"),
    "pointers too short": (changed("W/p", np.arange(3)), "p and i do not fit a matrix of 6 x 6"),
    "indices too large": (changed("W/i", np.full(6, 6)), "p and i do not fit a matrix of 6 x 6"),
    "too few triplets": (changed("W/nz", number(9)), "nz = 9, but x, p, i have"),
    "equality constraints": (changed("V", stored(np.ones((6, 1)), "columns")), "equality constraints"),
    "H of another size": (global_content(H=np.ones((7, 9)))[0], "H has 7 rows, M 8"),
    "w of another size": (global_content(w=np.ones(8))[0], "w has 8 rows, columns of H 9"),
    "M singular": (global_content(constraints=0, M=np.zeros((8, 8)))[0], "M is (nearly )?singular"),
    "M nearly singular": (global_content(constraints=0, M=np.ones((8, 8)))[0], "M is (nearly )?singular"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_file_is_refused_with_one_line(tmp_path: Path, name: str) -> None:
    content, line = WRONG[name]
    path = write(tmp_path / "a.hdf5", content)
    with pytest.raises(SceneError, match=f"^{re.escape(str(path))}: .*{line}") as refused:
        read_problem(path)
    assert "\n" not in str(refused.value)
    assert refused.value.exit_code == 2


def test_triplets_that_can_be_read_in_two_ways_are_refused(tmp_path: Path) -> None:
    content, _ = global_content("triplets", H=np.eye(8, 9) * (np.arange(9) < 8))
    with pytest.raises(SceneError, match="cannot be told which of p and i are rows; store it in compressed columns"):
        read_problem(write(tmp_path / "a.hdf5", content))


def test_what_is_no_file_of_hdf5_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.hdf5"
    with pytest.raises(SceneError, match=r"a\.hdf5: cannot be read: No such file or directory"):
        read_problem(path)
    with pytest.raises(SceneError, match="cannot be read: Is a directory"):
        read_problem(tmp_path)
    path.write_text("not at all")
    with pytest.raises(SceneError, match=r"a\.hdf5: not an HDF5 file, or a damaged one"):
        read_problem(path)
    sound = write(tmp_path / "b.hdf5", local(np.eye(6), np.ones(6), [0.1, 0.2]))
    path.write_bytes(sound.read_bytes()[:2000])
    with pytest.raises(SceneError, match=r"a\.hdf5: not an HDF5 file, or a damaged one"):
        read_problem(path)


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
