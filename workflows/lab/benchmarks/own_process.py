"""Measurements are made on one thread, in a process of their own that returns its memory."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from multiprocessing import get_context
from typing import TypeVar

from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.run.watch import LOGGERS

Found = TypeVar("Found")


def apart(function: Callable[..., Found], *arguments: object) -> Found:
    """Return what a function finds in a process of its own, which tells nothing of its iterations."""
    os.environ.update(ONE_THREAD)  # before numpy starts them
    with get_context("spawn").Pool(1, silence) as child:
        return child.apply(function, arguments)


def silence() -> None:
    """Say nothing of iterations."""
    for name in LOGGERS:
        logging.getLogger(name).propagate = False  # FFCx has given the root logger a handler
