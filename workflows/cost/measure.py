"""Run one rung in a separate process on one thread, so that its time and memory are measured alone."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time as clock
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from stickslip.geometry.errors import SceneError
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.cost.run_record import Run
from stickslip.workflows.cost.rung import Rung, mesh_size
from stickslip.workflows.scene_file.read import to_dict

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
LOOK = 0.02  # seconds between two looks at the process
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
        words = [sys.executable, "-P", "-m", "stickslip.workflows.cost.child", str(task), str(answer), str(os.getpid())]
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
    """How a process without an answer ended, in words."""
    lines = said.strip().splitlines() or [f"ended with code {code}"]
    memory = code == -signal.SIGKILL or "MemoryError" in said or "Out of memory" in said
    return {"status": "out_of_memory" if memory else "failed", "sentence": lines[-1]}
