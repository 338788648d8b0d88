"""The contract of a writer: one output of a run, found by its class."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from inspect import isabstract
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from stickslip.geometry.errors import nearest, require
from stickslip.geometry.keys import Noun, type_hints
from stickslip.geometry.protocols import Comm
from stickslip.solvers.accuracy.budget import Coarser
from stickslip.solvers.results.step_result import Errors, MeshData, StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Output
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.history import HistoryTuple


class Turn(IntEnum):
    """When a writer is called: before or after the run's own file is safe, steps/000012.h5 or, at the end, result.json.

    Writers of the same turn are called in the order of their modules' names.
    """

    BEFORE = 1  # rows that grow by each step: a crash leaves too many of them, which `resume` takes away
    AFTER = 2  # what points at the steps' files, is made from them, or may fail where the results stand
    LAST = 3  # what reads the files of other writers


@dataclass(frozen=True, kw_only=True)
class Job:
    """All that a writer knows of its run."""

    folder: Path  # a writer writes below it only, what `Writer.names` names; `write_aside` keeps it readable always
    scene: Scene
    mesh: MeshData  # on rank 0, empty elsewhere
    comm: Comm  # for writers that every rank calls
    simulation: Simulation | None = None  # that solves it, for writers that need more than its steps' results


@dataclass(frozen=True, kw_only=True)
class Ended:
    """Ending of a run."""

    status: str  # converged, doubtful, not_converged, no_equilibrium, interrupted
    steps: Sequence[StepResult]  # all of them, the last one with its fields, the others without
    errors: Sequence[Errors] | None = None  # of the numbers of each step; None: not estimated
    coarser: Coarser | None = None  # the steps on longer cells; None: not solved

    @property
    def in_haste(self) -> bool:
        """The run was told to stop, and has seconds left: what another run can do from the files has to wait."""
        return self.status == "interrupted"


@dataclass(frozen=True, kw_only=True)
class Keys(Noun):
    """Base of the keys that a writer adds to the scene's table [output]; here there are none.

    A subclass is a frozen dataclass like every table of the scene; each key has a default, with which the writer is
    not wanted: a scene that leaves the key out is the same scene as before the writer was there.
    """


class Writer(ABC):
    """One output of a run. A subclass in a module of this package is found; nothing else has to name it.

    It is made once a run with what it needs to know; then either `begin` or `resume` is called, `step` for each step
    that follows, and `finish`. An error ends the run on every rank; the steps written before are kept.

    Raises:
        MachineError: from any method: the disk is full, or a file of the results cannot be read.
    """

    kinds: ClassVar[list[type[Writer]]] = []
    turn: ClassVar[Turn] = Turn.AFTER
    collective: ClassVar[bool] = False  # called on every rank; if not, on rank 0 only
    keys: ClassVar[type[Keys]] = Keys
    reader: ClassVar[str] = ""  # what opens the files, for the last lines on the terminal: "ParaView", "scripts"
    files: ClassVar[tuple[str, ...]] = ()  # their names there, with * as in the shell

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        Writer.kinds.append(cls)

    def __init__(self, job: Job) -> None:
        """On every rank; nothing is written yet."""
        self.job = job

    @classmethod
    def wanted(cls, scene: Scene) -> bool:
        """Whether this scene asks for it; every scene does unless a subclass says otherwise."""
        return True

    def names(self) -> Sequence[str]:
        """Return the names of all files that it may write; every other file there is taken for the user's.

        A name that ends with a slash is a folder; what is written in it has a name as `marker.OF_STEP` describes them,
        with the step's number. By default it is `files`, which are named in full then.
        """
        return self.files

    def begin(self) -> None:
        """A run begins: the folder holds no results."""
        return None

    @abstractmethod
    def resume(self, steps: Sequence[StepResult]) -> None:
        """A run goes on: make of what is there what it was after the last of these steps, whatever a crash has left.

        There may be too much, too little or nothing: the earlier run may have been killed at any moment, and its scene
        may not have asked for this output. All that is needed is in the steps' files, which are sound.

        Args:
            steps: from the first on, perhaps none; the last one with its fields on rank 0, the others without.
        """

    def step(self, index: int, result: StepResult) -> None:
        """A step was solved.

        Args:
            index: of the step, from 1 on.
            result: with its fields on rank 0.
        """
        return None

    def failed(self, index: int, history: Sequence[HistoryTuple]) -> None:
        """A step could not be solved; `finish` follows.

        Args:
            index: of the step.
            history: iterations that belong to no step that was written.
        """
        return None

    def finish(self, ended: Ended) -> None:
        """The run ends, well or not; after an interruption it may go on later from what is left now."""
        return None


def registered() -> list[type[Writer]]:
    """All writers, in the order in which they are called."""
    return sorted((kind for kind in Writer.kinds if not isabstract(kind)), key=lambda kind: kind.turn)


def added_keys() -> dict[str, type[Keys]]:
    """The keys that writers add to [output], and the dataclass that declares each.

    Raises:
        TypeError: a writer adds a key that another writer or [output] itself has.
    """
    added: dict[str, type[Keys]] = {}
    own = {field.name for field in fields(Output)}
    for kind in registered():
        for field in fields(kind.keys):
            if field.name in own or added.setdefault(field.name, kind.keys) is not kind.keys:
                raise TypeError(f"{kind.__name__} adds output.{field.name}, which is there already")
    return added


def _types_and_defaults() -> dict[str, tuple[Any, Any]]:
    """Type and default of each key that a writer adds."""
    return {key: (type_hints(kind)[key], getattr(kind(), key)) for key, kind in added_keys().items()}


Output.of_writers = staticmethod(_types_and_defaults)


def wanted(scene: Scene) -> list[type[Writer]]:
    """The writers that a scene asks for, in the order in which they are called.

    Raises:
        SceneError: its output names a key that no writer has.
    """
    known = added_keys()
    for key, value in scene.output.writers.items():
        require(key in known, f"output.{key}", value, f"no writer has this key; {nearest(key, known)}")
    return [kind for kind in registered() if kind.wanted(scene)]


AnyKeys = TypeVar("AnyKeys", bound=Keys)


def keys_of(kind: type[AnyKeys], output: Output) -> AnyKeys:
    """Return what a scene says of the keys that a writer has added, with defaults filled in.

    Raises:
        SceneError: a value is wrong.
    """
    names = {field.name for field in fields(kind)}
    return kind(**{name: value for name, value in output.writers.items() if name in names})
