"""Files in the FCLIB format: every storage kind, local and global problems, and what is wrong with a file."""

import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import sparse

from shared.discrete import KINDS, local, random_problem, stored, write
from stickslip.geometry.errors import SceneError
from stickslip.solvers.interface.discrete import discrete_problem
from stickslip.solvers.stepping.discrete_chain import solve
from stickslip.workflows.formats.fclib import LocalProblem, ReducedProblem, read_problem, write_local, write_solved


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
