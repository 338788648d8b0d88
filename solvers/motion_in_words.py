"""Which body a rigid motion moves most, and how, in words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from solvers.constraints import AXES
from solvers.system import System

Array = NDArray[np.float64]


def in_words(system: System, motion: Array) -> str:
    """A rigid motion of the contact dofs and driven obstacles (c,)."""
    return max(_motions(system, motion), key=lambda found: found[0])[1]


def _motions(system: System, motion: Array) -> Iterator[tuple[float, str]]:
    """How far each body moves, and how."""
    own, driven = np.split(motion, [len(motion) - len(system.driven)])
    for (name, axis), size in zip(system.driven, driven, strict=True):
        yield abs(float(size)), f"obstacles.{name} moves along {_sign(size)}{'xyz'[axis]}"
    for c in system.contacts:
        contact, moved = system.scene.contacts[c.name], (system.trace(c) @ own).reshape(c.points.shape)
        sides = np.split(moved, [len(c.surface.points)])
        for side, u in zip((contact.surface, contact.against), sides, strict=True):
            if len(u):  # a rigid obstacle has no nodes
                yield float(np.linalg.norm(u, axis=1).max()), f"bodies.{side.split('.')[0]} {_how(u)}"


def _how(u: Array) -> str:
    """Displacement (m, d) of a side, which moves as a rigid body does."""
    mean = u.mean(axis=0)
    if np.linalg.norm(u - mean, axis=1).max() > np.linalg.norm(mean):
        return "turns"
    axis = max(AXES, key=lambda name: abs(mean[AXES[name]]) if AXES[name] < len(mean) else -1.0)
    return f"moves along {_sign(mean[AXES[axis]])}{axis}"


def _sign(size: float) -> str:
    return "-" if size < 0 else ""
