"""What methods have learnt, learnt/000012.h5: beside the newest two steps only, for it can be larger than they are."""

from __future__ import annotations

import shutil
from collections.abc import Collection
from pathlib import Path

from geometry.errors import MachineError
from solvers.plain import Plain
from workflows.writers.aside import disk_errors, make_folder
from workflows.writers.hdf5 import checksum, read_arrays, write_arrays
from workflows.writers.plain_arrays import BYTES, TEXT, from_arrays, to_arrays

FOLDER = "learnt"


class LearntFiles:
    """Each step names the file that belongs to it; one that would say the same as the last is not written."""

    def __init__(self, folder: Path, last: str = "") -> None:
        """
        Args:
            last: what `write` returned for the last step.
        """
        self._folder, self._last = folder / FOLDER, last

    def write(self, index: int, learnt: Plain) -> str:
        """Bring it to the disk before the step's file: its name and checksum.

        Raises:
            MachineError: the disk is full.
        """
        arrays = to_arrays(learnt, {})
        total = checksum(arrays, {})
        if self._last.partition(" ")[2] == total:
            return self._last
        name = f"{index:06d}.h5"
        make_folder(self._folder)
        write_arrays(self._folder / name, arrays, {})
        self._last = f"{name} {total}"
        return self._last

    def read(self, reference: str) -> Plain | None:
        """What `write` was given; None if it is lost."""
        name, _, total = reference.partition(" ")
        try:
            arrays, _ = read_arrays(self._folder / name)
        except MachineError:
            return None
        return from_arrays(arrays[TEXT], arrays[BYTES], {}) if checksum(arrays, {}) == total else None

    def keep_only(self, references: Collection[str]) -> None:
        """Remove the files that none of these name."""
        names = {reference.partition(" ")[0] for reference in references}
        with disk_errors(self._folder):
            for path in self._folder.glob("*"):
                if path.name not in names:
                    path.unlink()

    def remove(self) -> None:
        """The run is done: nothing will go on from here."""
        shutil.rmtree(self._folder, ignore_errors=True)
