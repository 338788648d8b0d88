"""Commands that solve in one process, or start processes of their own."""

from __future__ import annotations

import os

from stickslip.geometry.errors import SceneError

SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")  # that mpirun sets


def refuse_mpirun(why: str) -> None:
    """Refuse ranks of `mpirun`.

    Args:
        why: the command, and why it takes none.

    Raises:
        SceneError: it was started by mpirun.
    """
    if any(size in os.environ for size in SIZES):
        raise SceneError(f"{why}; start it without mpirun")
