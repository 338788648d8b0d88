"""The process that solves one rung: it reads the scene, and writes its results to the given file."""

from __future__ import annotations

import json
import sys
import time as clock
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stickslip.geometry.dolfinx_versions import form_cache
from stickslip.geometry.errors import GeometryError, MachineError, SceneError, SolverError
from stickslip.geometry.memory import peak
from stickslip.geometry.user_files.child_process import end_with
from stickslip.solvers.results.step_result import StepResult, names_of, values
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.solvers.stepping.stepper import NoEquilibriumError
from stickslip.workflows.formats.aside import write_aside
from stickslip.workflows.scene_file.read import from_dict


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
    return sum(1 for _ in form_cache().glob("*.so"))


def main() -> None:
    """`python -m stickslip.workflows.cost.child SCENE.json ANSWER.json PROCESS [time-steps]`; PROCESS: the parent."""
    end_with(int(sys.argv[3]))
    task, answer = map(Path, sys.argv[1:3])
    found = solve(from_dict(json.loads(task.read_text(encoding="utf-8"))), "time-steps" in sys.argv[4:])
    write_aside(answer, json.dumps(found).encode())


if __name__ == "__main__":
    main()
