"""One rung is solved in a separate process on one thread, so that its time and memory are measured alone."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stickslip.geometry.dolfinx_versions import CACHE
from stickslip.geometry.errors import GeometryError, MachineError, SceneError, SolverError
from stickslip.geometry.memory import peak
from stickslip.geometry.user_files.child_process import LOOK, end_with
from stickslip.solvers.results.step_result import StepResult, names_of, values
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.solvers.stepping.stepper import NoEquilibriumError
from stickslip.workflows.cost.run_record import Run, Rung, mesh_size
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.scene_file.read import from_dict, to_dict

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
Stop = Callable[[], bool]


def measure(scene: Scene, rung: Rung, seconds: float, stop: Stop) -> Run | None:
    """Solve the rung, a second time if the first one compiled forms; None if `stop` asked for the end.

    Args:
        seconds: time limit [s], after which the process is ended.
        stop: called repeatedly; True ends the process.
    """
    run = _once(scene, rung, seconds, stop)
    if run is None or not run.compiled or not run.converged or run.spent >= seconds:
        return run
    again = _once(scene, rung, seconds - run.spent, stop)
    if again is None or not again.converged:  # a time that includes compilation is better than no time
        return again and replace(run, spent=run.spent + again.spent)
    return replace(again, spent=run.spent + again.spent)


def _once(scene: Scene, rung: Rung, seconds: float, stop: Stop) -> Run | None:
    began = clock.perf_counter()
    try:
        mine = rung.scene(scene)
    except SceneError as error:
        return Run(rung=rung, status="refused", sentence=str(error))
    with tempfile.TemporaryDirectory(prefix="stickslip_") as place:
        task, answer, errors = (Path(place) / name for name in ("scene.json", "answer.json", "errors"))
        task.write_text(json.dumps(to_dict(mine)), encoding="utf-8")
        words = [
            sys.executable,
            "-P",
            "-m",
            "stickslip.workflows.cost.measure",
            str(task),
            str(answer),
            str(os.getpid()),
        ]
        if rung.level <= 0 and rung.tolerance == scene.solver.tolerance:  # they depend little on the mesh
            words.append("time-steps")
        with errors.open("wb") as said:  # a new session, so that only the parent receives Ctrl-C
            process = subprocess.Popen(
                words, env={**os.environ, **ONE_THREAD}, stdout=said, stderr=said, start_new_session=True
            )
            try:
                ended = _wait(process, began + seconds, stop)
            finally:
                process.kill()
                process.wait()
        common: dict[str, Any] = {"rung": rung, "h": mesh_size(mine), "spent": clock.perf_counter() - began}
        if ended == "stopped":
            return None
        if ended == "late":
            return Run(**common, status="out_of_time", sentence=f"stopped after {seconds:.0f} s")
        if answer.exists():
            return Run(**common, **json.loads(answer.read_text(encoding="utf-8")))
        return Run(**common, **_broken(process.returncode, errors.read_text(errors="replace")))


def _wait(process: subprocess.Popen[bytes], until: float, stop: Stop) -> str:
    """`ended`, `late` or `stopped`."""
    while process.poll() is None:
        if stop():
            return "stopped"
        if clock.perf_counter() > until:
            return "late"
        clock.sleep(LOOK)
    return "ended"


def _broken(code: int, said: str) -> dict[str, Any]:
    """Say how a process without an answer ended."""
    lines = said.strip().splitlines() or [f"ended with code {code}"]
    memory = code == -signal.SIGKILL or "MemoryError" in said or "Out of memory" in said
    return {"status": "out_of_memory" if memory else "failed", "sentence": lines[-1]}


def solve(scene: Scene, time_steps: bool = False) -> dict[str, Any]:
    """The fields of a `Run` that this process can measure itself.

    Args:
        time_steps: whether the errors of the time steps are measured too, beside its seconds.
    """
    before, began = forms(), clock.process_time()
    try:
        found = _figures(scene, time_steps)
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
    return measured | found


def _figures(scene: Scene, time_steps: bool) -> dict[str, Any]:
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
    return found | {"time_steps": dict(_of_time_steps(simulation, steps)) if time_steps else {}}


def _of_time_steps(simulation: Simulation, steps: Sequence[StepResult]) -> Iterator[tuple[str, float]]:
    """Errors of the time steps at the last step, in the unit of each number; of those that are known."""
    for key, parts in simulation.time_step_errors(steps)[-1].items():
        if parts.time_step is not None:
            for name, axis in names_of(key, parts.time_step):
                yield name, float(np.asarray(parts.time_step)[() if axis is None else axis])


def forms() -> int:
    """Number of compiled forms in the cache."""
    return sum(1 for _ in CACHE.glob("*.so"))


def main() -> None:
    """`python -m stickslip.workflows.cost.measure SCENE.json ANSWER.json PROCESS [time-steps]`; PROCESS: the parent."""
    end_with(int(sys.argv[3]))
    task, answer = map(Path, sys.argv[1:3])
    found = solve(from_dict(json.loads(task.read_text(encoding="utf-8"))), "time-steps" in sys.argv[4:])
    write_aside(answer, json.dumps(found).encode())


if __name__ == "__main__":
    main()
