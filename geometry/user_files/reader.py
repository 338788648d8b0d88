"""A user's file is read by gmsh in a child process, which it may crash, keep busy for ever or make run its commands.

The parent asks a `Question` and gets an `Outline` or a `RawMesh`; any failure is one line of a GeometryError. The child
is contained (see `contain`), unless the file is a .py program, which runs as the user's own.
"""

from __future__ import annotations

import io
import logging
import os
import pickle
import re
import signal
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from stickslip.geometry.curved_facets import Bulging
from stickslip.geometry.errors import GeometryError, GluedError, MachineError, StickslipError, shortened
from stickslip.geometry.memory import available, ended_for_memory, is_full
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.user_files.child_process import Ended, contain, end_with, run_child
from stickslip.geometry.user_files.foreign import close_skin
from stickslip.geometry.user_files.meshing import MeshOptions, mesh_parts
from stickslip.geometry.user_files.open_file import Parameter, apart, kind_of, open_file, parameter_names, unpacked
from stickslip.geometry.user_files.outline import Facets, Outline, read_outline
from stickslip.geometry.user_files.parts import Parts, Selection, find_parts
from stickslip.geometry.user_files.raw_mesh import RawMesh

log = logging.getLogger(__name__)
READING_TIME, MESHING_TIME = 50.0, 3600.0  # [s] limits for an outline and for a mesh, unless the scene has its own
CRASHES = (signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGTRAP, signal.SIGSYS)
NO_ROOM = 74  # exit code of a child whose answer cannot be written; EX_IOERR of <sysexits.h>
GMSH_SAYS = re.compile(r"^(?:Info|Warning|Error) +: .*\n?", re.MULTILINE)  # in its terminal
AT = re.compile(r"Meshing (curve|surface) ([0-9]+) \(([^,)]+)|Meshing 3D|(Done) meshing")
NO_MEMORY = "does not fit into memory; try a larger mesh_size"


@dataclass(frozen=True, kw_only=True)
class Question:
    """Question to the child process about a file: its mesh, or its outline if `mesh` is None."""

    path: Path
    dim: int
    unit: float  # length unit of the file [m]
    names: Mapping[str, Selection] = field(default_factory=dict)
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    mesh: MeshOptions | None = None
    time_limit: float | None = None  # [s]

    @property
    def contained(self) -> bool:
        """Whether its process is contained: all but .py files, which are the user's own programs."""
        return kind_of(self.path) != "py"


# What an answer is made of. A child that a file has taken over could write any pickle, and a pickle can call anything.
# The last two make arrays and scalars: numpy's versions have them in different places.
PARTS: list[Any] = [Outline, Facets, RawMesh, Bulging, np.ndarray, np.dtype]
PARTS += [np.zeros(0).__reduce__()[0], np.float64().__reduce__()[0]]
ANSWER = {(part.__module__, part.__name__): part for part in PARTS}


class AnswerReader(pickle.Unpickler):
    """Reads a pickle that is made of the classes of ANSWER, plain containers, numbers and texts."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in ANSWER:
            raise pickle.UnpicklingError(f"{module}.{name} is no part of an answer")
        return ANSWER[module, name]


def ask(question: Question) -> Outline | RawMesh:
    """Answer a question in a child process.

    Raises:
        GeometryError: the name of the file and what is wrong with it.
        MachineError: the process was ended from outside, or a disk is full.
        KeyboardInterrupt: a signal came that this process handles; the child is ended.
    """
    name, limit = question.path.name, question.time_limit or (READING_TIME if question.mesh is None else MESHING_TIME)
    with tempfile.TemporaryDirectory(prefix="stickslip-") as folder:
        asked, answered = Path(folder) / "question", Path(folder) / "answer"
        asked.write_bytes(pickle.dumps(question))
        before = ended_for_memory()
        ended = run_child(
            "stickslip.geometry.user_files.reader",
            [str(asked), str(answered)],
            Path(folder) if question.contained else None,
            limit,
        )
        content = answered.read_bytes() if ended.code == 0 and answered.exists() else b""
    at, printed = place_of(ended.printed), GMSH_SAYS.sub("", ended.printed).strip()
    if printed:
        log.info("%s printed: %s", name, shortened(printed))
    if not content:
        raise _failure(question, replace(ended, printed=printed), at, limit, ended_for_memory() > before)
    try:
        found = AnswerReader(io.BytesIO(content)).load()
    except Exception:  # of a damaged pickle: of many kinds
        raise GeometryError(
            f"{name}: gmsh's process gave an answer that cannot be read; is the file damaged?"
        ) from None
    if isinstance(found, Outline | RawMesh):
        return found
    raise GeometryError(f"{name}: {shortened(str(found).removeprefix(f'{name}: '))}")


def place_of(printed: str) -> str:
    """Return the curve or face that gmsh was at when its terminal stopped, in words; "" if it was meshing none."""
    word, number, kind, done = [("", "", "", "Done"), *AT.findall(printed)][-1]
    of = f"{word.replace('surface', 'face')} {number} ({kind})" if word else "the volumes"
    return "" if done else of


def _failure(question: Question, ended: Ended, at: str, limit: float, killed_for_memory: bool) -> StickslipError:
    """Explain why a child process gave no answer.

    Args:
        at: what it was meshing, in words.
        limit: of its time [s].
        killed_for_memory: whether the system has ended a process meanwhile because memory was out.
    """
    name, meshing, code, last = question.path.name, question.mesh is not None, ended.code, _last_line(ended.printed)
    if code is None:
        doing, way = ("meshing", "a larger mesh_size or ") if meshing else ("reading", "")
        way += "a longer geometry.time_limit, in seconds"
        where = f" and is at {at}" if at else ""
        return GeometryError(f"{name}: gmsh does not finish {doing} it within {limit:g} s{where}; try {way}")
    if code == NO_ROOM:
        return MachineError(f"{name}: what gmsh made of it cannot be written to {tempfile.gettempdir()}: {last}")
    if code >= 0:
        return GeometryError(f"{name}: gmsh ended without an answer; {last or 'the file may end it'}")
    word = signal.Signals(-code).name
    if -code == signal.SIGKILL and killed_for_memory:
        return MachineError(f"{name}: the system was out of memory, and ended gmsh ({word})")
    if -code == signal.SIGXCPU:
        return MachineError(f"{name}: gmsh took more seconds of the processor than this shell allows (ulimit -t)")
    if -code not in CRASHES:
        return MachineError(f"{name}: gmsh was ended from outside ({word}), by somebody or by a limit of this shell")
    if ended.full or "std::bad_alloc" in ended.printed:
        return GeometryError(f"{name}: {NO_MEMORY}")
    said = ", ".join(filter(None, (word, f"meshing {at}" if at else "")))
    said = f"{said}: {last}" if last else said
    return GeometryError(f"{name}: gmsh crashed on it ({said}); the file is damaged, or gmsh cannot read it")


def _last_line(printed: str) -> str:
    return shortened(printed.splitlines()[-1]) if printed else ""


def answer(question: Question) -> Outline | RawMesh:
    """Read the file in this process.

    Raises:
        GeometryError: the file cannot be read or meshed, or does not fit the scene.
    """
    with gmsh_session(gmsh_options(question)) as gmsh:
        gmsh.option.setNumber("General.Terminal", 1)  # the parent hears how far it gets
        gmsh.option.setNumber("General.Verbosity", 4)  # without bars of progress
        parts = read_parts(gmsh, question)
        if question.mesh is None:
            return read_outline(gmsh, question.dim, parts, question.unit)
        return mesh_parts(gmsh, question.dim, parts, question.mesh)


def gmsh_options(question: Question) -> list[str]:
    """Command-line options of gmsh that set the parameters of a .geo script."""
    if kind_of(question.path) != "geo":
        return []
    variables = parameter_names(question.path) if question.parameters else {}  # gmsh 4.8 knows no names of ONELAB
    return [
        word
        for name, value in question.parameters.items()
        for word in ("-setnumber", variables.get(name, name), repr(value))
    ]


def read_parts(gmsh: Gmsh, question: Question) -> Parts:
    """Open the file in the current gmsh model and find its bodies and sides."""
    open_file(gmsh, question.path, question.parameters)
    if question.mesh is None or question.names:
        close_skin(gmsh, question.dim)
    is_cad = kind_of(question.path) == "cad"
    return find_parts(gmsh, question.dim, is_cad, question.names, question.unit)


def main() -> None:
    """`python -m stickslip.geometry.user_files.reader QUESTION ANSWER PARENT`: two pickles, and a process number."""
    end_with(int(sys.argv[3]))
    asked, answered = (Path(word) for word in sys.argv[1:3])
    question: Question = pickle.loads(asked.read_bytes())  # the parent's  # noqa: S301
    with answered.open("wb") as target:  # before containment
        content = _answer_or_why_not(question, asked.parent)
        try:
            pickle.dump(content, target)
            target.flush()
        except OSError as error:
            print(error.strerror, flush=True)
            os._exit(NO_ROOM)  # closing the file would fail again


def _answer_or_why_not(question: Question, folder: Path) -> Outline | RawMesh | str:
    """The answer, or in words why there is none.

    Args:
        folder: for what is unpacked.
    """
    try:
        question = replace(question, path=unpacked(question.path, folder))
        if question.contained:
            import gmsh  # noqa: F401  starts programs to find its library

            contain(available())
        return answer(question)
    except GluedError as error:
        return f"{error}; for a contact {apart(question.path)}"
    except StickslipError as error:
        return str(error)
    except MemoryError:
        return NO_MEMORY
    except Exception as error:
        if isinstance(error, ImportError | OSError) and is_full(os.getpid()):  # gmsh's own libraries do not fit
            return NO_MEMORY
        if type(error) is not Exception:  # gmsh raises bare Exception
            return f"reading it fails: {type(error).__name__}: {error}"
        if not str(error):  # gmsh has caught an error of C++ that is none of its own
            return NO_MEMORY if is_full(os.getpid()) else "gmsh fails on it and does not say why; is the file damaged?"
        return f"gmsh says: {error}"


if __name__ == "__main__":
    main()
