"""A gmsh of our own for a while: started, quiet, and ended however the work in it ends."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any


@contextmanager
def own_interrupt() -> Iterator[None]:
    """gmsh takes Ctrl-C for itself: at its import, its start and its end."""
    handler = signal.getsignal(signal.SIGINT)
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, handler)


@contextmanager
def gmsh_session(words: Sequence[str] = ()) -> Iterator[Any]:
    """The gmsh module with an empty model; `words` are those of gmsh's command line. Not nested.

    The user's own gmsh options are not read: a scene gives the same mesh to everybody.
    """
    import gmsh

    gmsh.initialize(["gmsh", *words], readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.AbortOnError", 0)
        gmsh.model.add("scene")
        yield gmsh
    finally:
        gmsh.finalize()
