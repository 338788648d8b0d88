"""The folder of a cost study: every finished run is written at once; an interrupted study is resumed from it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from stickslip.geometry.errors import DamagedError, FolderError
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.cost.run_record import Run, from_plain
from stickslip.workflows.formats.files import make_folder, write_json
from stickslip.workflows.formats.marker import read_checked_json
from stickslip.workflows.run.folder import RUNS, SCENE, ResultsFolder
from stickslip.workflows.scene_file.identity import DECIDES_NOTHING, identity, refuse_changes


class StudyFolder(ResultsFolder):
    """The folder is filled beside its final place and renamed when the study is finished."""

    def __init__(self, target: Path, scene: Scene, resume: bool) -> None:
        """
        Raises:
            FolderError: something else stands there; or there is nothing to resume, or runs that nobody resumes.
            SceneError: the scene to resume was another one.
            MachineError: a file to resume from is damaged, or another one.
        """
        super().__init__(target)
        plain = identity(scene, DECIDES_NOTHING)
        source = next((f for f in (self.work, self.place) if (f / SCENE).is_file()), None) if resume else None
        if resume and source is None:
            raise FolderError(f"{target}: holds no cost study to resume; leave out --resume")
        self.runs: list[Run] = []  # finished ones, in the order in which they were made
        if source is not None:
            refuse_changes(read_checked_json(source / SCENE), plain, target)
            self.runs = sorted(map(_run, (source / RUNS).glob("order*.json")), key=lambda run: run.number)
        if source == self.work:
            self.take_up(source)
        else:
            self.start()
            self.declare([SCENE, f"{RUNS}/"])
            make_folder(self.work / RUNS)
            for run in self.runs:
                self.keep(run)
            write_json(self.work / SCENE, plain)  # last: from now on the study is resumed from here

    def keep(self, run: Run) -> None:
        """Write a finished run; it is safe when this returns."""
        name = f"{RUNS}/{run.rung.name}.json"
        self.declare([name])
        write_json(self.work / name, asdict(run))


def _run(path: Path) -> Run:
    """A finished run, whose rung is in the name of its file."""
    try:
        run = from_plain(read_checked_json(path))
    except (KeyError, TypeError):
        run = None
    if run is None or run.rung.name != path.stem:
        raise DamagedError(f"{path}: is not that run: damaged, or another one")
    return run
