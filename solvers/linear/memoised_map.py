"""A costly linear map of distributed vectors, known on the span of those it has met."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from geometry.arrays import Array
from solvers.parallel.serialise import Own

KEPT = 8  # vectors; loads that turn steadily through more directions than that gain nothing
ROUNDING = 1e-13  # what is left of a vector, beside it, when it lies in the span


class MemoisedMap:
    """Calls the map for the part of a vector that is new only; load steps that differ by a factor cost one call."""

    def __init__(self, apply: Callable[[Any], Array], size: int) -> None:
        """
        Args:
            apply: the map of a PETSc vector to (size,).
        """
        self._apply, self._size = apply, size
        self._met: list[tuple[Any, Array]] = []  # orthonormal vectors, and what the map makes of them

    def __call__(self, vector: Any) -> Array:
        """The map of a PETSc vector, exact to rounding; collective."""
        rest, size, image = vector.copy(), vector.norm(), np.zeros(self._size)
        for _ in range(2):  # Gram-Schmidt, twice: the rest of a vector in the span is rounding then
            for direction, its_image in self._met:
                part = rest.dot(direction)
                rest.axpy(-part, direction)
                image += part * its_image
        length = rest.norm()
        if length > ROUNDING * size:
            rest.scale(1 / length)
            its_image = self._apply(rest)
            image += length * its_image
            if len(self._met) < KEPT:
                self._met.append((rest, its_image))
        return image

    def snapshot(self) -> dict[str, Any]:
        """All that was met; see `restore`."""
        return {"vectors": [Own(v.array_r) for v, _ in self._met], "images": [image for _, image in self._met]}

    def restore(self, snapshot: dict[str, Any], like: Any) -> None:
        """Know what a `snapshot` holds, each vector laid out like that one."""
        self._met = []
        for own, image in zip(snapshot["vectors"], snapshot["images"], strict=True):
            vector = like.duplicate()
            vector.array[:] = own
            self._met.append((vector, image))
