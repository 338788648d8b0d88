"""One rung is solved in a separate process on one thread, so that its time and memory are measured alone."""

from __future__ import annotations

import json
import re
import signal
import sys
import tempfile
import time as clock
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stickslip.geometry.dolfinx_versions import CACHE
from stickslip.geometry.errors import GeometryError, MachineError, SceneError, SolverError
from stickslip.geometry.memory import peak
from stickslip.geometry.user_files.child_process import Ended, end_with, run_child
from stickslip.solvers.results.step_result import Errors, StepResult, names_of, values
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import prepare
from stickslip.solvers.stepping.stepper import NoEquilibriumError
from stickslip.workflows.cost.run_record import Run, Rung, mesh_size
from stickslip.workflows.formats.files import read_json, write_aside, write_json
from stickslip.workflows.scene_file.read import from_dict, to_dict

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def measure(scene: Scene, rung: Rung, seconds: float) -> Run:
    """Solve the rung, a second time if the first one compiled forms.

    Args:
        seconds: time limit [s], after which the process is ended.

    Raises:
        KeyboardInterrupt: a signal came that this process handles.
    """
    run = _once(scene, rung, seconds)
    if not run.compiled or not run.converged or run.spent >= seconds:
        return run
    again = _once(scene, rung, seconds - run.spent)
    # a time that includes compilation is better than no time
    return replace(again if again.converged else run, spent=run.spent + again.spent)


def _once(scene: Scene, rung: Rung, seconds: float) -> Run:
    began = clock.perf_counter()
    try:
        mine = rung.scene(scene)
    except SceneError as error:
        return Run(rung=rung, status="refused", sentence=str(error))
    with tempfile.TemporaryDirectory(prefix="stickslip_") as place:
        task, answer = (Path(place) / name for name in ("scene.json", "answer.json"))
        write_json(task, to_dict(mine))
        # errors of time steps depend little on the mesh, and what the estimate takes beside a run
        more = ["errors"] if rung.level <= 0 and rung.tolerance == scene.solver.tolerance else []
        ended = run_child(
            "stickslip.workflows.cost.measure", [str(task), str(answer), *more], None, seconds, **ONE_THREAD
        )
        common: dict[str, Any] = {"rung": rung, "h": mesh_size(mine), "spent": clock.perf_counter() - began}
        if ended.code is None:
            return Run(**common, status="out_of_time", sentence=f"stopped after {seconds:.0f} s")
        found = read_json(answer) or _broken(ended)
        return Run(**common, start=common["spent"] - found.pop("lasted", common["spent"]), **found)


def _broken(ended: Ended) -> dict[str, Any]:
    """Say how a process without an answer ended."""
    lines = ended.printed.splitlines() or [f"ended with code {ended.code}"]
    memory = ended.full or ended.code == -signal.SIGKILL or re.search("MemoryError|Out of memory", ended.printed)
    return {"status": "out_of_memory" if memory else "failed", "sentence": lines[-1]}


def solve(scene: Scene, errors: bool = False) -> dict[str, Any]:
    """The fields of a `Run` that this process can measure itself; and how long that has lasted [s].

    Args:
        errors: whether errors are estimated too, beside its seconds.
    """
    before, began, now = forms(), clock.process_time(), clock.perf_counter()
    try:
        found = _figures(scene, errors)
    except SolverError as error:
        status = "no_equilibrium" if isinstance(error, NoEquilibriumError) else "not_converged"
        found = {"status": status, "sentence": str(error)}
    except (SceneError, GeometryError) as error:
        found = {"status": "refused", "sentence": str(error)}
    except MachineError as error:
        found = {"status": "out_of_memory" if "memory" in str(error) else "failed", "sentence": str(error)}
    except MemoryError:
        found = {"status": "out_of_memory", "sentence": "not enough memory"}
    measured = {"memory": peak(), "cpu": clock.process_time() - began, "compiled": forms() != before}
    return measured | found | {"lasted": clock.perf_counter() - now}


def _figures(scene: Scene, errors: bool) -> dict[str, Any]:
    began = clock.process_time()
    simulation = prepare(scene)
    residuals, law_errors, steps = [0.0], [0.0], list[StepResult]()
    for step in simulation.steps():
        residuals.append(step.residual)
        law_errors.append(step.law_error)
        steps = [*(one.without_fields() for one in steps), step]
    last, counters = steps[-1], simulation.counters
    found = {
        "status": "converged",
        "cpu": clock.process_time() - began,
        "memory": peak(),
        "phases": dict(vars(simulation.seconds)),
        "dofs": simulation.system.constraints.free_total,
        "contact_points": sum(len(c.W_n) for c in simulation.system.contacts),
        "volume_solves": counters.volume_solves,
        "linear_iterations": counters.linear_iterations,
        "residual": max(residuals),
        "law_error": max(law_errors),
        "quantities": values(last),
    }
    if not errors:
        return found
    now = clock.perf_counter()
    told = dict(_of_time_steps(simulation.errors(steps)[-1]))
    found["estimate"] = clock.perf_counter() - now
    return found | {"time_steps": told or dict(_of_time_steps(simulation.time_step_errors(steps)[-1]))}


def _of_time_steps(errors: Errors) -> Iterator[tuple[str, float]]:
    """Errors of the time steps, in the unit of each number; of those that are known."""
    for key, parts in errors.items():
        if parts.time_step is not None:
            for name, axis in names_of(key, parts.time_step):
                yield name, float(np.asarray(parts.time_step)[() if axis is None else axis])


def forms() -> int:
    """Number of compiled forms in the cache."""
    return sum(1 for _ in CACHE.glob("*.so"))


def main() -> None:
    """`python -m stickslip.workflows.cost.measure SCENE.json ANSWER.json [errors] PROCESS`; PROCESS: the parent."""
    task, answer, *more, parent = sys.argv[1:]
    end_with(int(parent))
    found = solve(from_dict(read_json(Path(task))), "errors" in more)
    write_aside(Path(answer), json.dumps(found).encode())


if __name__ == "__main__":
    main()
