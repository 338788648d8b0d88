"""Compiled forms: a compilation that was killed holds up nobody, one that goes on is left alone."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import pytest

from shared.processes import running, wait_for
from shared.ranks import mpirun
from stickslip.geometry.errors import MachineError
from stickslip.geometry.form_cache import LOCK, find_cache, once, patient, remove_left_over

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
