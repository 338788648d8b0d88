"""Memoise a costly linear map of distributed vectors: on the span of earlier arguments it costs no call."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stickslip.geometry.arrays import LAST_DIGITS, Array
from stickslip.geometry.protocols import Vec
from stickslip.solvers.parallel.serialise import Own, Plain


class MemoisedMap:
    """Calls the map only for the part of a vector outside the known span.

    All load steps whose loads differ by a factor cost one call.
    """

    def __init__(self, apply: Callable[[Vec], Array], size: int) -> None:
        """
        Args:
            apply: the linear map of a vector to (size,); collective.
            size: length of the results.
        """
        self._apply, self._size = apply, size
        self._known: list[tuple[Vec, Array]] = []  # orthonormal vectors and their images

    def __call__(self, vector: Vec) -> Array:
        """Image (size,) of a vector, exact to rounding; collective."""
        rest, size, image = vector.copy(), vector.norm(), np.zeros(self._size)
        for _ in range(2):  # Gram-Schmidt twice: then the rest of a vector in the span is rounding
            for direction, its_image in self._known:
                part = rest.dot(direction)
                rest.axpy(-part, direction)
                image += part * its_image
        length = rest.norm()
        if length > LAST_DIGITS * size:  # remainder of a vector that lies in the span, relative to the vector
            rest.scale(1 / length)
            its_image = self._apply(rest)
            image += length * its_image
            if len(self._known) < 8:  # loads that turn steadily through more directions gain nothing from it
                self._known.append((rest, its_image))
        return image

    def snapshot(self) -> dict[str, Plain]:
        """All known vectors and their images; see `restore`."""
        return {"vectors": [Own(v.array_r) for v, _ in self._known], "images": [image for _, image in self._known]}

    def restore(self, snapshot: dict[str, Plain], like: Vec) -> None:
        """Know what a `snapshot` holds, and nothing else.

        Args:
            snapshot: see `snapshot`.
            like: a vector of the layout of the arguments.
        """
        self._known = []
        for own, image in zip(snapshot["vectors"], snapshot["images"], strict=True):
            vector = like.duplicate()
            vector.array[:] = own
            self._known.append((vector, image))
