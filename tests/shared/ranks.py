"""Several ranks, with a time limit."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

LIMIT = 100  # s; a rank that waits for the others for ever must not hold up the tests
PATH = os.pathsep.join(str(Path(__file__).parents[up]) for up in (1, 2))  # shared, and the packages
MPI = {
    "PYTHONPATH": PATH,
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_hwloc_base_binding_policy": "none",  # tests side by side: do not pin their ranks to the same cores
    "OMPI_MCA_mpi_yield_when_idle": "1",
    # they share memory; Open MPI 5 would complain of TCP where there is no network; to look at others takes a second
    "OMPI_MCA_btl": "self,vader",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}
OF_A_RANK = ("OMPI_", "PMIX_")  # variables that MPI leaves; a worker of pytest has those of the process that began it
STICKSLIP = ("-m", "stickslip.workflows.commands.start")


def mpirun(
    ranks: int, words: Sequence[str], folder: Path, program: Sequence[str] = STICKSLIP, limit: int = LIMIT
) -> subprocess.CompletedProcess[str]:
    """Run Python's `program` with these words on several ranks; `timeout` ends mpirun, and mpirun its ranks."""
    process = started(ranks, words, folder, program, limit)
    out, err = process.communicate()
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


def started(
    ranks: int, words: Sequence[str], folder: Path, program: Sequence[str] = STICKSLIP, limit: int = LIMIT
) -> subprocess.Popen[str]:
    """The same, while it runs: the process of `timeout`, whose child is mpirun."""
    limited = ["timeout", "-k", "5", str(limit), "mpirun", "-n", str(ranks), "--oversubscribe"]
    return subprocess.Popen(
        [*limited, sys.executable, *program, *words],
        cwd=folder,
        env={key: value for key, value in os.environ.items() if not key.startswith(OF_A_RANK)} | MPI,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def options(overrides: Sequence[str]) -> list[str]:
    return [word for override in overrides for word in ("--set", override)]


BEFORE = "import json, numpy as np, stickslip\nfrom mpi4py import MPI\ncomm, found = MPI.COMM_WORLD, []\n"
AFTER = "\neverywhere = comm.gather(found)\nif comm.rank == 0:\n    print(json.dumps(everywhere))\n"


def each_told(scripts: Mapping[str, str], ranks: int, folder: Path) -> dict[str, Any]:
    """By name, `told` of several scripts; one mpirun for all of them."""
    if ranks == 1:
        return {name: told(script, 1, folder) for name, script in scripts.items()}
    wholes = (BEFORE + script + AFTER for script in scripts.values())
    lines = printed("\n".join(f"exec({whole!r}, {{'__name__': '__main__'}})" for whole in wholes), ranks, folder)
    return dict(zip(scripts, (json.loads(line) for line in lines if line.startswith("[")), strict=True))


def told(script: str, ranks: int, folder: Path) -> Any:
    """The list `found` that a script makes on each of several ranks; or in this process, which is one.

    The script has json, MPI, np, stickslip and `comm`.
    """
    whole = BEFORE + script + AFTER
    if ranks == 1:
        with redirect_stdout(io.StringIO()) as out:
            exec(whole, {"__name__": "__main__"})
        return json.loads(out.getvalue().splitlines()[-1])
    return json.loads(printed(whole, ranks, folder)[-1])


def printed(script: str, ranks: int, folder: Path) -> list[str]:
    """Lines that a script prints on several ranks."""
    (folder / "script.py").write_text(script, encoding="utf-8")
    done = mpirun(ranks, [], folder, ("script.py",))
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout.splitlines()
