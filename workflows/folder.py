"""The results folder: a run works beside it and replaces it whole at the end; nothing of the user's is lost."""

from __future__ import annotations

import shutil
from pathlib import Path

from geometry.errors import FolderError
from workflows.writers.aside import disk_errors, make_folder

MARK = "run.log"  # every folder that a run has made holds it


class ResultsFolder:
    """`target` is where the results will stand, `work` where they grow until then."""

    def __init__(self, target: Path) -> None:
        """
        Raises:
            FolderError: something that is not a run's results stands there.
        """
        if target.name in ("", ".."):
            raise FolderError(f"-o {target}: name a folder that may be made and replaced, for example results/mine")
        self.target = target
        self.work = target.with_name(f".{target.name}.running")
        for folder in (target, self.work, self._old):
            if folder.exists() and not _ours(folder):
                raise FolderError(f"{folder}: is not the result of a run and not empty; choose another folder with -o")

    @property
    def _old(self) -> Path:
        return self.target.with_name(f"{self.target.name}.1")

    def start(self) -> Path:
        """An empty working folder; what a run that was killed left there is removed."""
        with disk_errors(self.work):
            shutil.rmtree(self.work, ignore_errors=True)
        make_folder(self.work)
        (self.work / MARK).touch()
        return self.work

    def finish(self) -> Path:
        """Put the results in place by rename; the former ones are kept as `.1`."""
        with disk_errors(self.target):
            if self.target.exists():
                shutil.rmtree(self._old, ignore_errors=True)
                self.target.rename(self._old)
            self.work.rename(self.target)
        return self.target

    def abandon(self) -> None:
        """Leave no trace of a run that did not reach its first step."""
        shutil.rmtree(self.work, ignore_errors=True)


def _ours(folder: Path) -> bool:
    return folder.is_dir() and (not any(folder.iterdir()) or (folder / MARK).is_file())
