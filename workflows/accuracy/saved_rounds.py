"""The finished rounds of a scene, beside the place of its results: rounds that were stopped go on behind them."""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from stickslip.geometry.errors import FolderError, MachineError
from stickslip.geometry.mesh_sizes import SizeField
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.accuracy.goals import Standing
from stickslip.workflows.accuracy.level import Level, Round
from stickslip.workflows.formats.files import disk_errors, read_json, read_regular, write_aside
from stickslip.workflows.formats.marker import is_marked, remove_own
from stickslip.workflows.run.folder import BEGUN, ResultsFolder, place_of
from stickslip.workflows.run.resume import VERSIONS, run_of
from stickslip.workflows.scene_file.identity import DECIDES_NOTHING, identity, refuse_changes

ABOUT = "stickslip_rounds"  # array of the file that holds all but the sizes, as JSON; it tells the file from others


class SavedRounds:
    """A file of all finished rounds and the level of the next one; on rank 0."""

    def __init__(self, target: Path, scene: Scene) -> None:
        """
        Args:
            target: where the results will stand.

        Raises:
            FolderError: a file of somebody else has its name.
        """
        place = place_of(target)
        self._target, self._scene = target, identity(scene, DECIDES_NOTHING)
        self.path = place.with_name(f".{place.name}.rounds")
        self._about = self._read() if self.path.exists() else None

    def refuse_to_lose(self) -> None:
        """
        Raises:
            FolderError: there are rounds, and nobody asks to go on with them.
        """
        if self._about is not None and not self._about["complete"]:
            raise FolderError(
                f"{self._target}: rounds that were stopped have left {len(self._about['done'])} finished ones in "
                f"{self.path}; go on with --resume, or remove that file, or choose another folder with -o"
            )

    def load(self) -> tuple[list[Round], Level] | None:
        """Finished rounds and the level of the next one; None: there are none. Remains of the last one are removed.

        Raises:
            SceneError: they are of another scene.
            FolderError: they are of another version.
        """
        if self._about is None:
            return None
        refuse_changes(self._about["scene"], self._scene, self._target)
        for name, now in VERSIONS.items():
            if self._about["versions"].get(name) != now:
                raise FolderError(f"--resume: {self._target} was begun with another version of {name}; this is {now}")
        self._clear(self._about["finished"])
        level = Level(**self._about["level"])
        with np.load(io.BytesIO(read_regular(self.path)), allow_pickle=False) as arrays:
            if "sizes" in arrays:
                level = replace(level, sizes=SizeField(arrays["points"], arrays["cells"], arrays["sizes"]))
        return [_round(one) for one in self._about["done"]], level

    def keep(self, done: list[Round], level: Level, finished: str, complete: bool) -> None:
        """Write all that is known after a round, before its results are thrown away.

        Args:
            level: of the next round.
            finished: name of the run that was the last round, see `run_of`.
            complete: whether its results stay instead, for the budget is spent: then they may be replaced.

        Raises:
            MachineError: it cannot be written.
        """
        about: dict[str, Any] = {
            "scene": self._scene,
            "versions": VERSIONS,
            "finished": finished,
            "level": _plain(level),
        }
        about["complete"] = complete
        about["done"] = [asdict(replace(one, level=replace(one.level, sizes=None))) for one in done]
        arrays = {} if level.sizes is None else vars(level.sizes)
        file = io.BytesIO()
        np.savez(file, **{ABOUT: np.array(json.dumps(about))}, **arrays)
        write_aside(self.path, file.getvalue())

    def remove(self) -> None:
        """Nothing is left to go on with."""
        with disk_errors(self.path):
            self.path.unlink(missing_ok=True)

    def _read(self) -> dict[str, Any]:
        try:
            with np.load(io.BytesIO(read_regular(self.path)), allow_pickle=False) as arrays:
                found: dict[str, Any] = json.loads(str(arrays[ABOUT]))
                return found
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            raise FolderError(
                f"{self.path}: cannot be read, or holds no rounds; move it away, or choose another folder with -o"
            ) from None

    def _clear(self, finished: str) -> None:
        """Remove the steps of the last finished round, which a crash has left in the working folder."""
        results = ResultsFolder(self._target)
        begun = read_json(results.work / BEGUN)
        if is_marked(results.work) and begun and run_of(begun) == finished:
            results.lock(results.work)
            try:
                with disk_errors(results.work):
                    remove_own(results.work)
            except MachineError:
                results.release()
                raise
        results.release()


def _plain(level: Level) -> dict[str, Any]:
    """All but the sizes."""
    return {key: value for key, value in vars(level).items() if key != "sizes"}


def _round(plain: dict[str, Any]) -> Round:
    return Round(**{**plain, "level": Level(**plain["level"]), "goals": [Standing(**one) for one in plain["goals"]]})
