"""The folder of a cost study: every finished run is written at once; an interrupted study is resumed from it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from stickslip.geometry.errors import FolderError
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.cost.run_record import Run, from_plain
from stickslip.workflows.cost.study import Study
from stickslip.workflows.formats.files import make_folder, write_json
from stickslip.workflows.run.folder import RUNS, SCENE, ResultsFolder
from stickslip.workflows.scene_file.identity import DECIDES_NOTHING, identity, refuse_changes


class StudyFolder:
    """The folder is filled beside its final place and renamed when the study is finished."""

    def __init__(self, target: Path, scene: Scene, resume: bool) -> None:
        """
        Raises:
            FolderError: something else stands there; or there is nothing to resume, or runs that nobody resumes.
            SceneError: the scene to resume was another one.
        """
        self._folder, plain = ResultsFolder(target), identity(scene, DECIDES_NOTHING)
        source = next((f for f in (self._folder.work, self._folder.place) if (f / SCENE).is_file()), None)
        if resume and source is None:
            raise FolderError(f"{target}: holds no cost study to resume; leave out --resume")
        if resume and source is not None:
            refuse_changes(json.loads((source / SCENE).read_text(encoding="utf-8")), plain, target)
        self.runs = _runs(source / RUNS) if resume and source is not None else []
        if resume and source == self._folder.work:
            self._folder.take_up(source)
        else:
            self._folder.start()
            self._folder.declare([SCENE, f"{RUNS}/"])
            make_folder(self.path / RUNS)
            for run in self.runs:
                self.keep(run)
            write_json(self.path / SCENE, plain)  # last: from now on the study is resumed from here

    @property
    def path(self) -> Path:
        """Folder in which the study is working."""
        return self._folder.work

    def keep(self, run: Run) -> None:
        """Write a finished run; it is safe when this returns."""
        name = f"{RUNS}/{run.rung.name}.json"
        self._folder.declare([name])
        write_json(self.path / name, run.plain())

    def declare(self, studies: Iterable[Study]) -> None:
        """Say which tables and pictures will be made of the studies."""
        pictures = (study.picture for study in studies)
        self._folder.declare(["cost.csv", "cost.json", "cost_methods.png", *pictures])

    def finish(self) -> Path:
        """Put the folder in its place; the former one is kept as `.1`."""
        return self._folder.finish()

    def abandon(self) -> None:
        """Remove the folder of a study without runs."""
        self._folder.abandon()


def _runs(folder: Path) -> list[Run]:
    """All finished runs, in the order in which they were made."""
    found = [from_plain(json.loads(path.read_text(encoding="utf-8"))) for path in folder.glob("order*.json")]
    return sorted(found, key=lambda run: run.number)
