"""The results folder: a run works beside it and replaces it whole at the end; nothing of the user's is lost."""

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
NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)  # what some network disks answer
AT_WORK = "process {pid} on {host}"  # a line of it


class ResultsFolder:
    """`target` is where the results will stand, `work` where they grow until then, locked by the process at work."""

    def __init__(self, target: Path) -> None:
        """
        Raises:
            FolderError: something that is not a run's results stands there.
        """
        if target.name in ("", ".."):
            raise FolderError(f"-o {target}: name a folder that may be made and replaced, for example results/mine")
        self.target = target
        self.work = target.with_name(f".{target.name}.running")
        self.notes: tuple[str, ...] = ()  # for the user
        self._held: weakref.finalize[..., ResultsFolder] | None = None  # called, it closes what is locked
        for folder in (target, self.work, self._old):
            if folder.exists() and not _ours(folder):
                raise FolderError(f"{folder}: is not the result of a run and not empty; choose another folder with -o")

    @property
    def _old(self) -> Path:
        return self.target.with_name(f"{self.target.name}.1")

    @property
    def _rubbish(self) -> Path:
        return self.target.with_name(f".{self.target.name}.1.removed")

    def refuse_to_lose(self) -> None:
        """
        Raises:
            FolderError: another run is at work, or one that was stopped or killed has left steps.
        """
        if _interrupted(self.target):
            self._refuse(self.target)
        if self.work.exists():
            self.lock(self.work)
            self._refuse(self.work)

    def _refuse(self, folder: Path) -> None:
        if kept := len(step_files(folder)):
            self.release()
            raise FolderError(
                f"{self.target}: a run that was stopped has left {kept} steps in {folder}; go on with --resume, or "
                "remove that folder, or choose another one with -o"
            )

    def start(self) -> Path:
        """An empty working folder; what a run that was killed before its first step left there is removed.

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
        """Work on in `folder`, which may be the target."""
        self.lock(folder)
        if folder != self.work:
            with disk_errors(folder):
                folder.rename(self.work)
                sync_folder(folder.parent)
        return self.work

    def lock(self, folder: Path) -> None:
        """Keep other processes out until `release`; the system does that when this one is killed.

        Raises:
            FolderError: another one is at work there.
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
                self.notes = (f"{folder}: this disk knows no locks: see that no other run writes there",)
        self._held = weakref.finalize(self, os.close, descriptor)

    def release(self) -> None:
        """Let others in."""
        if self._held is not None:
            self._held()
            self._held = None

    def finish(self) -> Path:
        """Put the results in place by rename; the former ones are kept as `.1`."""
        with disk_errors(self.target):
            if self.target.exists():
                if self._old.exists():  # out of the way first: a kill may leave it half removed
                    shutil.rmtree(self._rubbish, ignore_errors=True)
                    self._old.rename(self._rubbish)
                self.target.rename(self._old)
                shutil.rmtree(self._rubbish, ignore_errors=True)
            self.work.rename(self.target)
        self.release()
        return self.target

    def abandon(self) -> None:
        """Leave no trace of what has not come to anything."""
        shutil.rmtree(self.work, ignore_errors=True)
        self.release()


def at_work() -> str:
    """What `run.log` says of the process that writes it."""
    return AT_WORK.format(pid=os.getpid(), host=socket.gethostname())


def _who(folder: Path) -> str:
    said = re.findall(AT_WORK.format(pid=r"\d+", host=r"\S+"), (folder / MARK).read_text(encoding="utf-8"))
    return said[-1] if said else "another process"


def _interrupted(folder: Path) -> bool:
    """Whether the results of a run that was stopped stand there."""
    path = folder / "result.json"
    if not path.is_file():
        return False
    try:
        found = json.loads(path.read_text(encoding="utf-8", errors="replace"))
    except ValueError:
        return False
    return isinstance(found, dict) and found.get("status") == "interrupted"


def _ours(folder: Path) -> bool:
    return folder.is_dir() and (not any(folder.iterdir()) or (folder / MARK).is_file())
