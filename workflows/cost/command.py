"""The command `stickslip cost`: climb the ladder, evaluate the runs, write tables and pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from stickslip.geometry.errors import SceneError
from stickslip.geometry.memory import available
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.cost.ladder import Budget, climb, ladder_of, retry
from stickslip.workflows.cost.measure import measure
from stickslip.workflows.cost.progress import Teller
from stickslip.workflows.cost.run_record import Run, Rung, with_estimates
from stickslip.workflows.cost.study import Study, check, chosen, truth_of
from stickslip.workflows.cost.study_folder import StudyFolder
from stickslip.workflows.cost.tables import Line, comparison, headline, lines, plain, sentence, summary, write_csv
from stickslip.workflows.formats.files import write_json
from stickslip.workflows.run.ranks import Interrupt, refuse_mpirun


@dataclass(frozen=True)
class Answer:
    """End of the study: exit code and sentences."""

    exit_code: int
    sentence: str  # the price of the first quantity
    complaint: str = ""  # notes for standard error


def cost(
    scene: Scene,
    target: Path,
    budget: float,
    asked: Sequence[str],
    resume: bool,
    teller: Teller,
    named: Sequence[str] = (),
) -> Answer:
    """Study the scene and write the results to `target`.

    Args:
        asked: names of quantities; empty: the usual ones.
        named: names of methods to lay side by side; empty: the scene's, or those that may be cheapest.

    Raises:
        SceneError: known before the first run; nothing is written.
        MachineError: the disk is full.
    """
    if not 0 < budget < math.inf:
        raise SceneError(f"--budget {budget:g}: must be positive, in seconds")
    refuse_mpirun("cost: measures runs on one core")
    check(asked, scene)
    ladder, notes = ladder_of(scene, named)
    kept, limits = StudyFolder(target, scene, resume), Budget(budget, 0.8 * available(), scene.dim)
    runs = retry(kept.runs, limits)
    with Interrupt() as interrupt, teller:

        def solve(rung: Rung, seconds: float) -> Run | None:
            what = f"order {rung.order}, {rung.method}, cells x {rung.factor:.3g}"
            teller.next(what, budget - limits.left(runs), len(runs))
            with suppress(KeyboardInterrupt):
                return None if interrupt.pressed else measure(scene, rung, seconds)
            return None

        def keep(run: Run) -> None:
            kept.keep(run)
            teller.done(run)

        teller.line(*[f"{len(runs)} finished runs are taken over"] * bool(runs), *notes)
        whole, left_out = climb(ladder, runs, limits, solve, keep)
        teller.line(*left_out)
        if not runs:
            kept.abandon()
            if not whole:
                raise KeyboardInterrupt
            return Answer(3, "No run fits into the budget.", "give it a larger --budget")
        studies = judge(scene, runs, asked, ladder.tolerance)
        beside = lines(runs, ladder.methods, ladder.tolerance) if named else []
        compared = comparison(beside, ladder.methods)
        kept.declare(["cost.csv", "cost.json", "cost_methods.png", *(study.picture for study in studies)])
        write_csv(kept.work / "cost.csv", runs, studies)
        status = "complete" if whole else "interrupted"
        content = summary(scene, runs, studies, status, budget, [*notes, *left_out])
        if named:
            content |= {"side_by_side": plain(beside, ladder.methods), "comparison": compared}
        write_json(kept.work / "cost.json", content)
        if scene.output.pictures:
            _draw(kept.work, scene, studies, beside, ladder.methods, compared)
        place = kept.finish()
    teller.line(*_warnings(runs, studies))
    teller.table(studies)
    teller.methods(beside, ladder.methods)
    if compared:
        teller.line(compared)
    teller.line(f"results in {place}: cost.csv, cost.json, a picture of each quantity")
    return _ending(whole, runs, "\n".join(map(sentence, studies)) if asked and studies else headline(studies))


def judge(scene: Scene, runs: Sequence[Run], asked: Sequence[str], tolerance: float) -> list[Study]:
    """A study of every quantity that has a reference value."""
    converged = tuple(run for run in with_estimates(runs) if run.converged)
    if not converged:
        return []
    truths = [truth_of(name, runs, scene.exact, tolerance) for name in chosen(asked, scene, runs)]
    return [Study(truth, converged, tolerance) for truth in truths if truth is not None]


def core_share(runs: Sequence[Run]) -> float:
    """CPU time over elapsed time: 1 if nothing else ran on the core."""
    elapsed = sum(run.seconds for run in runs)
    return sum(run.cpu for run in runs if run.phases) / elapsed if elapsed else 1.0


def _ending(whole: bool, runs: Sequence[Run], said: str) -> Answer:
    meshes: dict[tuple[int, str], set[int]] = {}
    for run in runs:
        if run.converged:
            meshes.setdefault(run.rung.chain, set()).add(run.rung.level)
    if not whole:
        return Answer(130, said, "interrupted; the finished runs are kept, go on with --resume")
    if max((len(levels) for levels in meshes.values()), default=0) < 2:
        if not meshes and runs:
            return Answer(3, said, f"no run converged; the first one: {runs[0].sentence}")
        return Answer(3, said, "fewer than 2 meshes of one method were solved; give it a larger --budget")
    return Answer(0, said)


def _warnings(runs: Sequence[Run], studies: Sequence[Study]) -> Iterator[str]:
    """Yield what makes the seconds or a reference value doubtful."""
    if (share := core_share(runs)) < 0.9:
        yield f"warning: the machine was busy, the runs got {100 * share:.0f} % of a core: read seconds with care"
    yield from (study.truth.warning for study in studies if study.truth.warning)


def _draw(
    folder: Path, scene: Scene, studies: Sequence[Study], beside: Sequence[Line], methods: Sequence[str], said: str
) -> None:
    from stickslip.workflows.cost.pictures import draw, draw_methods

    for study in studies:
        if study.truth.meshes > 1:
            draw(folder, scene.title, study, scene.labels)
    if beside:
        draw_methods(folder, scene.title, beside, methods, said, scene.labels)
