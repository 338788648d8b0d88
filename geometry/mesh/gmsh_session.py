"""A gmsh session: initialised, without terminal output, and finalised even if the work in it fails."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from stickslip.geometry.arrays import SLIGHT
from stickslip.geometry.protocols import Gmsh


@contextmanager
def own_interrupt() -> Iterator[None]:
    """Restore our handler of Ctrl-C: gmsh installs its own when it is imported, initialised and finalised."""
    handler = signal.getsignal(signal.SIGINT)
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, handler)


@contextmanager
def _no_signals() -> Iterator[None]:
    """Keep gmsh from setting handlers: Ctrl-C would end the process, and outside the main thread nobody can."""
    act = signal.signal
    signal.signal = lambda number, handler: signal.getsignal(number)  # type: ignore[assignment]
    try:
        yield
    finally:
        signal.signal = act


@contextmanager
def gmsh_session(words: Sequence[str] = ()) -> Iterator[Gmsh]:
    """The initialised gmsh module with an empty model; sessions must not be nested.

    The user's own gmsh options are not read: a scene gives the same mesh for every user.

    Args:
        words: options as on gmsh's command line.
    """
    with own_interrupt(), _no_signals():
        import gmsh

        gmsh.initialize(["gmsh", *words], readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.AbortOnError", 0)
        gmsh.model.add("scene")
        yield gmsh
    finally:
        with own_interrupt(), _no_signals():
            gmsh.finalize()


def generate(gmsh: Gmsh, dim: int) -> None:
    """Mesh the current gmsh model up to a dimension.

    Curves of gmsh's own kernel have their curvature from finite differences: where sizes follow it, the mesher of
    curves would halve intervals for ever to integrate that noise as exactly as it does by default.
    """
    curves = {*gmsh.model.getEntities(1)} - {*gmsh.model.occ.getEntities(1)}
    if curves and gmsh.option.getNumber("Mesh.MeshSizeFromCurvature"):
        gmsh.option.setNumber("Mesh.LcIntegrationPrecision", SLIGHT)  # of a cell
    gmsh.model.mesh.generate(dim)
