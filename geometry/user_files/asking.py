"""Asking a child process about a user's file: whatever the file does to gmsh ends as one line here."""

from __future__ import annotations

import logging
import os
import pickle
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from geometry.errors import GeometryError
from geometry.user_files.reader import Question

log = logging.getLogger(__name__)
READING_TIME = 300.0  # s; no file that people work with takes as long to read
ROOT = Path(__file__).resolve().parents[2]


def ask(question: Question) -> Any:
    """The reader's answer.

    Raises:
        GeometryError: the file's name and what is wrong with it.
    """
    name = question.path.name
    with tempfile.TemporaryDirectory(prefix="stickslip-") as folder:
        asked, told = Path(folder) / "question", Path(folder) / "answer"
        asked.write_bytes(pickle.dumps(question))
        try:
            done = subprocess.run(
                [sys.executable, "-m", "geometry.user_files.reader", str(asked), str(told)],
                env=child_environment(),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                timeout=READING_TIME if question.mesh is None else None,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise GeometryError(f"{name}: gmsh does not come to an end with it in {READING_TIME:g} s") from None
        said = done.stdout.decode(errors="replace").strip()
        if said:
            log.info("%s said: %s", name, said)
        if not told.exists():
            raise GeometryError(f"{name}: {_ending(done.returncode, said)}")
        kind, content = pickle.loads(told.read_bytes())
    if kind == "refusal":
        raise GeometryError(f"{name}: {' '.join(str(content).split())}")
    return content


def child_environment() -> dict[str, str]:
    """Ours, with the folder where a child finds these packages."""
    return os.environ | {
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    }


def _ending(code: int, said: str) -> str:
    if code < 0:
        return f"gmsh crashed on it ({signal.Signals(-code).name}); the file is damaged, or gmsh cannot read it"
    return f"gmsh ended without an answer; {said.splitlines()[-1] if said else 'the file may end it'}"
