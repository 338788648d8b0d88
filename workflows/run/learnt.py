"""What methods have learnt, learnt/000012.0.bin of rank 0: beside the newest two steps only, for it can be large.

It serves the same ranks alone, so each keeps its own part: nothing is gathered. A step names the files that belong to
it by its reference: their number, and the checksum of each rank's.
"""

from __future__ import annotations

from collections.abc import Container
from contextlib import suppress
from pathlib import Path
from typing import Any

from stickslip.solvers.parallel.serialise import Plain
from stickslip.workflows.formats.aside import disk_errors, make_folder
from stickslip.workflows.formats.serialised import PlainFile, read_plain
from stickslip.workflows.run.collective import all_act, raise_together

FOLDER = "learnt"


class LearntFiles:
    """Those of the last two steps; what is the same as at the step before is not written again."""

    def __init__(self, folder: Path, comm: Any, before: str = "", last: str = "") -> None:
        """
        Args:
            before, last: references of the last two steps.
        """
        self._folder, self._comm, self._two = folder / FOLDER, comm, (before, last)

    def write(self, index: int, learnt: Plain) -> str:
        """Bring it to the disk before the step's file: the step's reference; collective.

        Raises:
            MachineError: a disk is full; on all ranks.
        """
        file, last = PlainFile(learnt), self._two[1]
        sums = self._comm.allgather(file.checksum)
        if last.split()[1:] != sums:
            last = " ".join([f"{index:06d}", *sums])

            raise_together(self._comm, lambda: make_folder(self._folder))
            all_act(self._comm, lambda: file.write(self._folder / _name(last, self._comm.rank)))
        self._two = self._two[1], last
        return last

    def read(self) -> Plain | None:
        """What belongs to the last step; None on all ranks if one's is lost, or if they were others; collective."""
        last = self._two[1]
        sums, rank = last.split()[1:], self._comm.rank
        if len(sums) != self._comm.size:
            return None
        found = read_plain(self._folder / _name(last, rank), sums[rank])
        return found if all(self._comm.allgather(found is not None)) else None

    def forget(self) -> None:
        """Remove the files of earlier steps, of all ranks; rank 0, when the last step is safe."""
        numbers = {reference.partition(" ")[0] for reference in self._two}
        _remove(self._folder, numbers)


def remove_learnt(folder: Path) -> None:
    """Of a run that is done and certified: nothing will go on from here, nor be estimated again.

    Raises:
        MachineError: no permission.
    """
    _remove(folder / FOLDER, ())
    with suppress(OSError):  # the user keeps something there, or there is none
        (folder / FOLDER).rmdir()


def _remove(folder: Path, but: Container[str]) -> None:
    """Remove the files of all steps but some."""
    with disk_errors(folder):
        for path in folder.glob(f"{'[0-9]' * 6}.*.bin"):
            if path.name[:6] not in but:
                path.unlink()


def is_kept(folder: Path, reference: str) -> bool:
    """Whether every rank's file is there, and whole."""
    sums = reference.split()[1:]
    files = (folder / FOLDER / _name(reference, rank) for rank in range(len(sums)))
    return bool(sums) and all(read_plain(path, total) is not None for path, total in zip(files, sums, strict=True))


def _name(reference: str, rank: int) -> str:
    return f"{reference.partition(' ')[0]}.{rank}.bin"
