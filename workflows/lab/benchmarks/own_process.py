"""Measurements are made on one thread, in a process of their own that returns its memory, and kept in files."""

from __future__ import annotations

import json
import logging
import os
import subprocess
from collections.abc import Callable, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.run.watch import LOGGERS

Found = TypeVar("Found")
Run = dict[str, Any]  # what a measurement has found, as JSON


def apart(function: Callable[..., Found], *arguments: object) -> Found:
    """Return what a function finds in a process of its own, which tells nothing of its iterations."""
    os.environ.update(ONE_THREAD)  # before numpy starts them
    with get_context("spawn").Pool(1, silence) as child:
        return child.apply(function, arguments)


def silence() -> None:
    """Say nothing of iterations."""
    for name in LOGGERS:
        logging.getLogger(name).propagate = False  # FFCx has given the root logger a handler


def child(command: Sequence[str], limit: float, **environment: str) -> Run:
    """Return the answer of a program on one thread, or why there is none; it is stopped after ten times the limit."""
    whole = os.environ | ONE_THREAD | environment
    try:
        done = subprocess.run(command, capture_output=True, text=True, env=whole, timeout=10 * limit, check=False)
    except subprocess.TimeoutExpired:
        return {"status": f"took more than {10 * limit:g} s"}
    if done.returncode:
        return {"status": (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]}
    found: Run = json.loads(done.stdout.splitlines()[-1])
    return {"status": "converged"} | found


def kept(path: Path, measure: Callable[[], Found]) -> Found:
    """Return what a file keeps of an earlier measurement; if there is none, measure, and keep it there."""
    if not path.exists():
        write_aside(path, json.dumps(measure(), default=float, allow_nan=False).encode())
    found: Found = json.loads(path.read_text(encoding="utf-8"))
    return found
