"""The process that solves members of a sweep one after the other; bodies that stay the same are prepared once."""

from __future__ import annotations

import json
import sys
import time as clock
from pathlib import Path
from typing import Any

from stickslip.geometry.errors import StickslipError
from stickslip.geometry.user_files.child_process import end_with
from stickslip.solvers.simulation.simulation import Bodies, Simulation
from stickslip.workflows.formats.files import read_json
from stickslip.workflows.run.folder import BEGUN, OF_MEMBER, place_of, work_of
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.identity import DECIDES_NOTHING, identity
from stickslip.workflows.scene_file.read import from_dict


class Bench:
    """Runs scenes, and keeps the bodies of the last one for the next."""

    def __init__(self) -> None:
        self._bodies: Bodies | None = None

    def __call__(self, plain: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Ending of a scene's run: its status, what there is to say, and its seconds."""
        began = clock.perf_counter()
        try:
            scene = from_dict(plain)
            begun = [read_json(place / BEGUN).get("scene") for place in (work_of(folder), place_of(folder))]
            same = identity(scene, DECIDES_NOTHING) in begun
            watch = Watch(on_prepared=self._keep)
            outcome, _ = run(scene, folder, watch, resume=same, bodies=self._bodies, former=OF_MEMBER)
            ended = {"status": outcome.status, "sentence": outcome.sentence}
        except StickslipError as error:
            ended = {"status": "failed", "sentence": str(error)}
        return ended | {"seconds": clock.perf_counter() - began}

    def forget(self) -> None:
        """Free the memory of the bodies."""
        self._bodies = None

    def _keep(self, simulation: Simulation) -> None:
        self._bodies = simulation.bodies


def main() -> None:
    """`python -m stickslip.workflows.sweep.child TASK.json ANSWERS PROCESS`; PROCESS: the parent.

    The task lists the folder, scene and bodies of each member; each answer is a line of its own, in their order.
    """
    end_with(int(sys.argv[3]))
    bench, before = Bench(), ""
    with Path(sys.argv[2]).open("a", encoding="utf-8") as answers:
        for member in json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")):
            if member["bodies"] != before:
                bench.forget()
            before = member["bodies"]
            answers.write(json.dumps(bench(member["scene"], Path(member["folder"]))) + "\n")
            answers.flush()


if __name__ == "__main__":
    main()
