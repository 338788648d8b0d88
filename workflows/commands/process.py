"""What the command line knows of its process: the signals that stop it, and whether it speaks; nothing is imported."""

from __future__ import annotations

import os
import signal

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)
STOPPED = 130  # exit code


def speaks() -> bool:
    """Whether this process prints: rank 0 only."""
    return os.environ.get("OMPI_COMM_WORLD_RANK", os.environ.get("PMI_RANK", "0")) == "0"
