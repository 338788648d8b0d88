"""The process that solves one rung: it reads the scene, and writes its results to the given file."""

from __future__ import annotations

import json
import sys
import time as clock
from pathlib import Path
from typing import Any

from geometry.dolfinx_versions import form_cache
from geometry.errors import GeometryError, MachineError, SceneError, SolverError
from geometry.user_files.child import end_with
from solvers.results.quantities import values
from solvers.scene.scene import Scene
from solvers.simulation.simulation import prepare
from solvers.stepping.stepper import NoEquilibriumError
from workflows.formats.aside import write_aside
from workflows.scene_file.read import from_dict


def solve(scene: Scene) -> dict[str, Any]:
    """The fields of a `Run` that this process can measure itself."""
    before, began = forms(), clock.process_time()
    try:
        found = _figures(scene)
    except SolverError as error:
        status = "no_equilibrium" if isinstance(error, NoEquilibriumError) else "not_converged"
        found = {"status": status, "sentence": str(error)}
    except (SceneError, GeometryError) as error:
        found = {"status": "refused", "sentence": str(error)}
    except MachineError as error:
        found = {"status": "out_of_memory" if "memory" in str(error) else "failed", "sentence": str(error)}
    except MemoryError:
        found = {"status": "out_of_memory", "sentence": "not enough memory"}
    return found | {"memory": peak_memory(), "cpu": clock.process_time() - began, "compiled": forms() != before}


def _figures(scene: Scene) -> dict[str, Any]:
    simulation = prepare(scene)
    residuals, law_errors, last = [0.0], [0.0], None
    for last in simulation.steps():
        residuals.append(last.residual)
        law_errors.append(last.law_error)
    assert last is not None
    counters, seconds = simulation.counters, simulation.seconds
    return {
        "status": "converged",
        "phases": vars(seconds),
        "dofs": simulation.system.constraints.free_total,
        "contact_points": sum(len(c.W_n) for c in simulation.system.contacts),
        "volume_solves": counters.volume_solves,
        "linear_iterations": counters.linear_iterations,
        "residual": max(residuals),
        "law_error": max(law_errors),
        "quantities": values(last),
    }


def peak_memory() -> float:
    """Peak memory of this process [bytes]; ru_maxrss would include what its parent held when it was started."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return 1024.0 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def forms() -> int:
    """Number of compiled forms in the cache."""
    return sum(1 for _ in form_cache().glob("*.so"))


def main() -> None:
    """`python -m workflows.cost.child SCENE.json ANSWER.json PARENT`, PARENT being a process number."""
    end_with(int(sys.argv[3]))
    task, answer = map(Path, sys.argv[1:3])
    found = solve(from_dict(json.loads(task.read_text(encoding="utf-8"))))
    write_aside(answer, json.dumps(found).encode())


if __name__ == "__main__":
    main()
