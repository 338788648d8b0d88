"""What a picture shows."""

from pathlib import Path

import numpy as np
from matplotlib.image import imread


def colours(path: Path) -> int:
    """Number of colours of a picture, which must not be small."""
    pixels = imread(path)
    assert pixels.shape[0] > 300
    assert pixels.shape[1] > 600
    return len(np.unique((pixels[..., :3] * 255).astype(int) @ [65536, 256, 1]))
