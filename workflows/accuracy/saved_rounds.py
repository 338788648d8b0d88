"""The finished rounds of a scene, beside the place of its results: rounds that were stopped go on behind them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from stickslip.geometry.errors import FolderError, MachineError
from stickslip.solvers.parallel.serialise import deserialise, serialise
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.accuracy.level import Level, Round
from stickslip.workflows.formats.files import disk_errors, read_json
from stickslip.workflows.formats.hdf5 import read_arrays, write_arrays
from stickslip.workflows.formats.marker import is_marked, remove_own
from stickslip.workflows.formats.serialised import BYTES, TEXT, from_arrays, to_arrays
from stickslip.workflows.run.folder import BEGUN, ResultsFolder, place_of
from stickslip.workflows.run.resume import VERSIONS, run_of
from stickslip.workflows.scene_file.identity import DECIDES_NOTHING, identity, refuse_changes


@dataclass(frozen=True, kw_only=True)
class Saved:
    """All that is known after a round."""

    scene: dict[str, Any]  # see `identity`
    versions: dict[str, str]
    finished: str  # name of the run that was the last round, see `run_of`
    complete: bool  # whether its results stay, for the budget is spent: then they may be replaced
    level: Level  # of the next round
    done: list[Round]  # without their sizes


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
        self._saved = self._read() if self.path.exists() else None

    def refuse_to_lose(self) -> None:
        """
        Raises:
            FolderError: there are rounds, and nobody asks to go on with them.
        """
        if self._saved is not None and not self._saved.complete:
            raise FolderError(
                f"{self._target}: rounds that were stopped have left {len(self._saved.done)} finished ones in "
                f"{self.path}; go on with --resume, or remove that file, or choose another folder with -o"
            )

    def load(self) -> tuple[list[Round], Level] | None:
        """Finished rounds and the level of the next one; None: there are none. Remains of the last one are removed.

        Raises:
            SceneError: they are of another scene.
            FolderError: they are of another version.
        """
        if self._saved is None:
            return None
        refuse_changes(self._saved.scene, self._scene, self._target)
        for name, now in VERSIONS.items():
            if self._saved.versions.get(name) != now:
                raise FolderError(f"--resume: {self._target} was begun with another version of {name}; this is {now}")
        self._clear(self._saved.finished)
        return self._saved.done, self._saved.level

    def keep(self, done: list[Round], level: Level, finished: str, complete: bool) -> None:
        """Write all that is known after a round, before its results are thrown away; see `Saved`.

        Raises:
            MachineError: it cannot be written.
        """
        rounds = [replace(one, level=replace(one.level, sizes=None)) for one in done]
        about: dict[str, Any] = {"finished": finished, "complete": complete, "level": level, "done": rounds}
        saved = Saved(scene=self._scene, versions=VERSIONS, **about)
        write_arrays(self.path, to_arrays(serialise(saved), {}), {})

    def remove(self) -> None:
        """Nothing is left to go on with."""
        with disk_errors(self.path):
            self.path.unlink(missing_ok=True)

    def _read(self) -> Saved:
        try:
            arrays, _ = read_arrays(self.path)
            return deserialise(Saved, from_arrays(arrays[TEXT], arrays[BYTES], {}))
        except (MachineError, KeyError, TypeError, ValueError):
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
