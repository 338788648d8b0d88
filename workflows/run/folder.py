"""The results folder: a run writes to a working folder and replaces the results at the end; no user file is lost."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import re
import shutil
import socket
import weakref
from pathlib import Path

from geometry.errors import FolderError
from workflows.formats.aside import disk_errors, make_folder, sync_folder
from workflows.formats.steps import step_files

MARK = "run.log"  # every folder that a run has made holds it
NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)  # errors of network disks without locks
AT_WORK = "process {pid} on {host}"  # a line of run.log


class ResultsFolder:
    """Folder `target` for the results, and folder `work` that a run fills and locks until they are complete."""

    def __init__(self, target: Path) -> None:
        """Check that the folders are free or hold results of a run.

        Raises:
            FolderError: `target` holds other files.
        """
        if target.name in ("", ".."):
            raise FolderError(f"-o {target}: name a folder that may be made and replaced, for example results/mine")
        self.target = target
        self.work = target.with_name(f".{target.name}.running")
        self.notes: tuple[str, ...] = ()  # for the user
        self._held: weakref.finalize[..., ResultsFolder] | None = None  # a call releases the lock
        for folder in (target, self.work, self._old):
            if folder.exists() and not _ours(folder):
                raise FolderError(f"{folder}: is not the result of a run and not empty; choose another folder with -o")

    @property
    def replaced(self) -> tuple[Path, ...]:
        """Folders whose content moves or goes when the results are put in their place."""
        return self.target, self.work, self._old, self._rubbish

    @property
    def _old(self) -> Path:
        return self.target.with_name(f"{self.target.name}.1")

    @property
    def _rubbish(self) -> Path:
        return self.target.with_name(f".{self.target.name}.1.removed")

    def refuse_to_lose(self) -> None:
        """Check that no steps of another run would be lost.

        Raises:
            FolderError: another run is at work, or one that was stopped or killed has left steps.
        """
        if _interrupted(self.target):
            self._refuse(self.target)
        if self.work.exists():
            self.lock(self.work)
            self._refuse(self.work)

    def _refuse(self, folder: Path) -> None:
        """Raise FolderError if the folder holds steps."""
        if kept := len(step_files(folder)):
            self.release()
            raise FolderError(
                f"{self.target}: a run that was stopped has left {kept} steps in {folder}; go on with --resume, or "
                "remove that folder, or choose another one with -o"
            )

    def start(self) -> Path:
        """Make an empty, locked working folder; files of a run that was killed before its first step are removed.

        Raises:
            FolderError: another run is at work, or one that was stopped or killed has left steps.
        """
        self.refuse_to_lose()
        make_folder(self.work)
        self.lock(self.work)
        with disk_errors(self.work):
            for path in self.work.iterdir():
                if path.is_dir():
                    shutil.rmtree(path)
                elif path.name != MARK:
                    path.unlink()
            (self.work / MARK).write_text("", encoding="utf-8")
        return self.work

    def take_up(self, folder: Path) -> Path:
        """Lock `folder`, which may be the target, and rename it to the working folder; returns the working folder.

        Raises:
            FolderError: another process is at work there.
        """
        self.lock(folder)
        if folder != self.work:
            with disk_errors(folder):
                folder.rename(self.work)
                sync_folder(folder.parent)
        return self.work

    def lock(self, folder: Path) -> None:
        """Lock a folder against other processes until `release`; the system releases the lock of a killed process.

        Raises:
            FolderError: another process is at work there.
        """
        if self._held is not None:
            return
        with disk_errors(folder):
            descriptor = os.open(folder / MARK, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                if error.errno not in NO_LOCKS:
                    os.close(descriptor)
                    if not isinstance(error, BlockingIOError):
                        raise
                    raise FolderError(
                        f"{self.target}: {_who(folder)} is writing it; choose another folder with -o"
                    ) from None
                self.notes = (f"{folder}: this disk has no locks: make sure that no other run writes there",)
        self._held = weakref.finalize(self, os.close, descriptor)

    def release(self) -> None:
        """Release the lock."""
        if self._held is not None:
            self._held()
            self._held = None

    def finish(self) -> Path:
        """Rename the working folder to the target, and release the lock; earlier results are kept as `TARGET.1`."""
        with disk_errors(self.target):
            if self.target.exists():
                if self._old.exists():  # renamed first: a killed process may leave it half removed
                    shutil.rmtree(self._rubbish, ignore_errors=True)
                    self._old.rename(self._rubbish)
                self.target.rename(self._old)
                shutil.rmtree(self._rubbish, ignore_errors=True)
            self.work.rename(self.target)
        self.release()
        return self.target

    def abandon(self) -> None:
        """Remove the working folder of a run without results, and release the lock."""
        shutil.rmtree(self.work, ignore_errors=True)
        self.release()


def at_work() -> str:
    """Line of `run.log` that names the process that writes it."""
    return AT_WORK.format(pid=os.getpid(), host=socket.gethostname())


def _who(folder: Path) -> str:
    """The process that writes a folder, from its run.log."""
    said = re.findall(AT_WORK.format(pid=r"\d+", host=r"\S+"), (folder / MARK).read_text(encoding="utf-8"))
    return said[-1] if said else "another process"


def _interrupted(folder: Path) -> bool:
    """Whether the folder holds the results of an interrupted run."""
    path = folder / "result.json"
    if not path.is_file():
        return False
    try:
        found = json.loads(path.read_text(encoding="utf-8", errors="replace"))
    except ValueError:
        return False
    return isinstance(found, dict) and found.get("status") == "interrupted"


def _ours(folder: Path) -> bool:
    """Whether a folder is empty or made by a run."""
    return folder.is_dir() and (not any(folder.iterdir()) or (folder / MARK).is_file())
