"""The folder of a suite's page, picture and rows: what the disk refuses is one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stickslip.geometry.errors import MachineError


def made(folder: Path) -> None:
    """Make the folder, before hours are spent on what is to stand there.

    Raises:
        MachineError: it cannot be made.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Write into the folder inside the block.

    Raises:
        MachineError: the disk refuses.
    """
    try:
        yield
    except OSError as error:
        raise MachineError(f"{folder}: cannot be written: {error.strerror}") from None
