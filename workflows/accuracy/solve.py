"""What solves a scene and leaves its results: one run, or rounds of runs where numbers are asked to be accurate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stickslip.geometry.mesh_sizes import SizeField
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Bodies
from stickslip.workflows.accuracy.rounds import Rounds
from stickslip.workflows.run import run as once
from stickslip.workflows.run.result import Outcome
from stickslip.workflows.run.watch import Watch


def run(
    scene: Scene,
    folder: str | Path,
    watch: Watch | None = None,
    resume: bool = False,
    keep: once.Keep | None = None,
    sizes: SizeField | None = None,
    bodies: Bodies | None = None,
    began: float | None = None,
) -> tuple[Outcome, dict[str, Any]]:
    """Run a scene and leave its results in `folder`; collective.

    Where the scene has goals, `accuracy.goals`, rounds of runs follow until they are reached or the budget is spent;
    the status of one that has not reached them is "inaccurate". With `keep` or `sizes` it is one run all the same.

    Args:
        scene: what to solve.
        folder: where the results stand at the end; former ones are kept beside it.
        watch: what is told while the run works; absent: nobody.
        resume: go on where an earlier run of the same scene was stopped there, if there is one.
        keep: asked once all steps are solved, on every rank, with the errors of their numbers: whether the results are
            kept. None: they are.
        sizes: mesh sizes instead of those of the scene, on rank 0.
        bodies: of an earlier simulation, see `prepare`; rounds make their own.
        began: `time.perf_counter()` when the program began, whose imports count too; None: it begins here.

    Returns:
        How it ended, and the content of result.json; that is empty, and the status "abandoned", if they are not kept.

    Raises:
        SceneError, GeometryError: known before solving; nothing is written.
        MachineError: the results cannot be written, or a step to resume from is damaged.
    """
    watch = watch or Watch()
    if scene.accuracy.goals and keep is None and sizes is None:
        return Rounds(scene, watch.on_round)(folder, watch, resume)
    return once.run(scene, folder, watch, resume, keep, sizes, bodies, began)
