"""The results folder: a run works in a folder beside it, which takes its place by one rename at the end.

Earlier results are kept whole as `NAME.1`, with what the user has put there. Results that make room for them are
removed only if nothing else is among them. A link to a folder is followed and kept.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import re
import socket
import weakref
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from itertools import count
from pathlib import Path

from stickslip.geometry.errors import FolderError, MachineError
from stickslip.workflows.formats import marker
from stickslip.workflows.formats.files import disk_errors, read_json, read_regular, sync_folder
from stickslip.workflows.formats.marker import RESULT as RESULT
from stickslip.workflows.formats.steps import light_files, step_files

log = logging.getLogger(__name__)
BEGUN = "begun.json"  # what a run was begun with
FORMER, OF_MEMBER = ".1", "~1"  # how folders of former results end; no member of a sweep has the second in its name
SCENE, RUNS = "scene.json", "runs"  # of a cost study, which has no steps; the scene is written when the runs are there
FILES = (BEGUN, RESULT, "steps/", "learnt/")  # of every run, beside its log
NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)  # errors of network disks without locks
READ_ONLY = (errno.EROFS, errno.EACCES, errno.EPERM)  # errors of results that may only be read
AT_WORK = "process {pid} on {host}"  # a line of run.log


def place_of(target: Path) -> Path:
    """Return where the results stand: the target, or where a link leads.

    Raises:
        FolderError: no folder can be made there.
    """
    try:
        place = Path(os.path.realpath(target)) if target.is_symlink() else target
    except (OSError, ValueError) as error:
        raise FolderError(f"-o {target}: {getattr(error, 'strerror', None) or error}") from None
    if "\0" in place.name or place.name in ("", ".."):
        raise FolderError(f"-o {target}: name a folder that may be made and replaced, for example results/mine")
    return place


def work_of(target: Path) -> Path:
    """The folder in which a run works whose results will stand at `target`."""
    place = place_of(target)
    return place.with_name(f".{place.name}.running")


class ResultsFolder:
    """Folder `target` for the results, and folder `work` that a run fills and locks until they are complete."""

    def __init__(self, target: Path, former: str = FORMER) -> None:
        """Check that the folders are free or hold results of a run.

        Args:
            former: how the name of the folder ends in which former results are kept.

        Raises:
            FolderError: `target` holds other files, or no rename can replace it.
        """
        self.target, self.place, self.work = target, place_of(target), work_of(target)
        self._old = self.place.with_name(f"{self.place.name}{former}")
        self._gone = self.place.with_name(f".{self._old.name}.gone")  # the old ones until the new ones are there
        self.notes: tuple[str, ...] = ()  # for the user
        self._held: weakref.finalize[..., ResultsFolder] | None = None  # a call releases the lock
        try:
            for folder in self.replaced:
                if folder.is_symlink():
                    raise FolderError(f"{folder}: is a link in the way of results; remove it")
                if os.path.ismount(folder):
                    why = f"a disk is mounted at {folder}, and no rename replaces it"
                    raise FolderError(f"-o {target}: {why}; name a folder in it")
                _refuse_foreign(folder, self.place if folder == self._old else None)
        except OSError as error:
            raise FolderError(f"-o {target}: {error.strerror}") from None

    @property
    def replaced(self) -> tuple[Path, ...]:
        """Folders whose content moves or goes when the results are put in their place."""
        return self.place, self.work, self._old, self._gone

    def refuse_to_lose(self) -> None:
        """Check that neither steps nor results of another run would be lost.

        Raises:
            FolderError: another run is at work, or one that was stopped or killed has left steps; or see
                `refuse_to_replace`.
        """
        if read_json(self.place / RESULT).get("status") == "interrupted":
            self._refuse(self.place)
        if marker.is_marked(self.work):
            self.lock(self.work)
            self._refuse(self.work)
        self.refuse_to_replace()

    def refuse_to_replace(self) -> None:
        """Check that former results would not take the place of another run's.

        Raises:
            FolderError: `TARGET.1` is not known to hold former results of the target.
        """
        if (
            marker.own_files(self.place)
            and marker.own_files(self._old)
            and marker.marker_of(self._old).former != self.place.name
        ):
            self.release()
            solved = marker.is_certified(self.work / RESULT)
            raise FolderError(
                f"{self._old}: is not known to hold former results of {self.place.name}; move it away, "
                + ("and go on with --resume" if solved else "or choose another folder with -o")
            )

    def _refuse(self, folder: Path) -> None:
        """Raise FolderError if the folder holds steps, or runs of a cost study."""
        runs = [*(folder / RUNS).glob("*.json")] if (folder / SCENE).is_file() else []
        if runs:
            self.release()
            raise FolderError(
                f"{self.target}: a study that was killed has left {len(runs)} finished runs in {folder}; go on with "
                "--resume, or remove that folder, or choose another one with -o"
            )
        stored, light = step_files(folder), light_files(folder)
        if not (kept := len({*stored, *light})):
            return
        self.release()
        if not (folder / BEGUN).is_file():
            way = f"without its {BEGUN} they belong to no scene: "
        elif not stored:
            way = "none has its fields: begin again with --resume, or "
        else:
            way = "go on with --resume, or "
        raise FolderError(
            f"{self.target}: a run that was stopped has left {kept} steps in {folder}; {way}remove that folder, or "
            "choose another one with -o"
        )

    def start(self) -> Path:
        """Make an empty, locked working folder; files of a run that was killed before its first step are removed.

        Raises:
            FolderError: another run is at work, or one that was stopped or killed has left steps.
        """
        self.refuse_to_lose()
        with disk_errors(self.work):
            self.work.mkdir(parents=True, exist_ok=True)
            if not marker.is_marked(self.work):
                marker.mark(self.work)
            self.lock(self.work)
            marker.remove_own(self.work, but=marker.LOG)
            marker.mark(self.work, names=FILES, sha256={}, former="")
            os.truncate(self.work / marker.LOG, 0)
        return self.work

    def take_up(self, folder: Path) -> Path:
        """Lock `folder`, which may be the place, and make it the working folder; returns that.

        Raises:
            FolderError: another process is at work there.
        """
        self.lock(folder)
        if folder != self.work:
            with disk_errors(folder), ExitStack() as held:
                if marker.is_marked(self.work):
                    held.callback(os.close, self._locked(self.work))
                self._clear(self.work)
                folder.rename(self.work)
                sync_folder(self.work.parent)
        with disk_errors(self.work):
            marker.mark(self.work, former="", sha256={})  # what the run goes on with is checked, and grows now
        return self.work

    def declare(self, names: Iterable[str]) -> None:
        """Say which files the run will make in the working folder, see `marker.declare`."""
        with disk_errors(self.work):
            marker.declare(self.work, names)

    def lock(self, folder: Path) -> None:
        """Lock a folder against other processes until `release`; the system releases the lock of a killed process.

        Raises:
            FolderError: another process is at work there.
        """
        if self._held is None:
            self._held = weakref.finalize(self, os.close, self._locked(folder))

    def _locked(self, folder: Path) -> int:
        """Return the descriptor that holds the lock of a folder."""
        with disk_errors(folder):
            descriptor = _open_log(folder)
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
        return descriptor

    def release(self) -> None:
        """Release the lock."""
        if self._held is not None:
            self._held()
            self._held = None

    def certify(self) -> None:
        """Note the checksums of complete results: what is left of the run is to move them to their place."""
        with disk_errors(self.target):
            marker.certify(self.work)

    def finish(self) -> Path:
        """Put the results in their place, and release the lock; earlier ones are kept as `TARGET.1`.

        Raises:
            FolderError: results of another run are in the way; nothing is moved.
        """
        self.refuse_to_replace()
        with disk_errors(self.target):
            self._clear(self._gone)  # if a run was killed here
            if marker.own_files(self.place):
                try:
                    marker.mark(self.place, former=self.place.name)
                except MachineError as error:  # results that may only be read are kept all the same
                    if getattr(error.__cause__, "errno", None) not in READ_ONLY:
                        raise
                with ExitStack() as undo:
                    if self._old.exists():
                        self._old.rename(self._gone)
                        undo.callback(self._gone.rename, self._old)
                    self.place.rename(self._old)
                    undo.pop_all()
            else:
                self._clear(self.place)
            self.work.rename(self.place)
            sync_folder(self.place.parent)
            self._clear(self._gone)
        self.release()
        return self.target

    def _clear(self, folder: Path) -> None:
        """Remove a folder of results, or give it the next name that is free if it holds files of the user."""
        if next(marker.foreign(folder), None) is None:
            if folder.exists():
                marker.remove_own(folder)
            return
        names = (self.place.with_name(f"{self._old.name[:-1]}{number}") for number in count(2))
        free = next(name for name in names if not os.path.lexists(name))
        folder.rename(free)
        log.info("%s: holds files of the user; kept as %s", folder, free)

    def abandon(self) -> None:
        """Remove the files of a run without results, and release the lock."""
        with suppress(OSError):
            marker.remove_own(self.work)
        self.release()


def at_work() -> str:
    """Line of `run.log` that names the process that writes it."""
    return AT_WORK.format(pid=os.getpid(), host=socket.gethostname())


def _who(folder: Path) -> str:
    """The process that writes a folder, from its run.log."""
    text = read_regular(folder / marker.LOG).decode(errors="replace")
    said = re.findall(AT_WORK.format(pid=r"\d+", host=r"\S+"), text)
    return said[-1] if said else "another process"


def _open_log(folder: Path) -> int:
    """Descriptor of a folder's run.log, which is made if it is not there; of read-only results it can be locked too."""
    path, options = folder / marker.LOG, os.O_APPEND | os.O_NONBLOCK
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise OSError(errno.EINVAL, "not a regular file")
    try:
        return os.open(path, os.O_WRONLY | options | os.O_CREAT, 0o666)
    except OSError as error:
        if error.errno not in READ_ONLY or not path.exists():
            raise
        return os.open(path, os.O_RDONLY | options)


def _refuse_foreign(folder: Path, former_of: Path | None) -> None:
    """
    Args:
        former_of: where the results stand whose former ones would be kept there.

    Raises:
        FolderError: the folder is there, not empty, and no run has made it; or a link stands for a file of the run.
    """
    if not folder.exists() or (folder.is_dir() and all(path.name == marker.PART for path in folder.iterdir())):
        return  # empty, or a crash came before it was marked
    if folder.is_dir() and marker.is_marked(folder):
        if found := marker.strange(folder):
            raise FolderError(
                f"{found}: is a link, or no file or folder, where a run has made one; move it away, or choose another "
                "folder with -o"
            )
        return
    if folder.is_dir() and (folder / marker.LOG).is_file():
        raise FolderError(
            f"{folder}: an earlier version of stickslip made it, whose files cannot be told from yours; move it away, "
            "or choose another folder with -o"
        )
    why = f", and former results of {former_of.name} would be kept there" if former_of else ""
    raise FolderError(f"{folder}: is not the result of a run and not empty{why}; choose another folder with -o")
