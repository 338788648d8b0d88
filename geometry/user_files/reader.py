"""A user's file is read by gmsh in a child process, which it may crash, keep busy for ever or make run its commands.

The parent asks a `Question` and gets an `Outline` or a `RawMesh`; any failure is one line of a GeometryError. The child
is contained (see `containment`), unless the file is a .py program, which runs as the user's own.
"""

from __future__ import annotations

import io
import logging
import os
import pickle  # nosec B403
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from geometry.errors import GeometryError, StickslipError, shortened
from geometry.memory import available
from geometry.mesh.gmsh_session import gmsh_session
from geometry.protocols import Gmsh
from geometry.user_files.containment import contain
from geometry.user_files.meshing import MeshOptions, mesh_parts
from geometry.user_files.open_file import Parameter, kind_of, open_file, unpacked
from geometry.user_files.outline import Facets, Outline, read_outline
from geometry.user_files.parts import Parts, Selection, find_parts
from geometry.user_files.raw_mesh import RawMesh

log = logging.getLogger(__name__)
READING_TIME, MESHING_TIME = 50.0, 3600.0  # [s] limits for an outline and for a mesh, unless the scene has its own
ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, kw_only=True)
class Question:
    """What the child process is asked about a file: for its mesh, or for its outline if `mesh` is None."""

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
ANSWER = {(kind.__module__, kind.__name__): kind for kind in (Outline, Facets, RawMesh, np.ndarray, np.dtype)} | {
    ("numpy.core.multiarray", "_reconstruct"): np.core.multiarray._reconstruct,  # type: ignore[attr-defined]
    ("numpy.core.multiarray", "scalar"): np.core.multiarray.scalar,  # type: ignore[attr-defined]
}


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
    """
    name, limit = question.path.name, question.time_limit or (READING_TIME if question.mesh is None else MESHING_TIME)
    with tempfile.TemporaryDirectory(prefix="stickslip-") as folder:
        asked, answered = Path(folder) / "question", Path(folder) / "answer"
        asked.write_bytes(pickle.dumps(question))
        try:
            done = subprocess.run(
                [sys.executable, "-P", "-m", "geometry.user_files.reader", str(asked), str(answered)],
                env=child_environment(),
                cwd=folder if question.contained else None,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                timeout=limit,
                check=False,
            )
        except subprocess.TimeoutExpired:
            doing = "reading" if question.mesh is None else "meshing"
            way = "a longer geometry.time_limit, in seconds" if question.mesh is None else "a larger mesh_size"
            raise GeometryError(f"{name}: gmsh does not finish {doing} it within {limit:g} s; try {way}") from None
        printed = done.stdout.decode(errors="replace").strip()
        if printed:
            log.info("%s printed: %s", name, shortened(printed))
        content = answered.read_bytes() if answered.exists() else b""
    if not content:
        raise GeometryError(f"{name}: {_why_it_ended(done.returncode, printed)}")
    try:
        found = AnswerReader(io.BytesIO(content)).load()
    except Exception:  # of a damaged pickle: of many kinds
        raise GeometryError(
            f"{name}: gmsh's process gave an answer that cannot be read; is the file damaged?"
        ) from None
    if isinstance(found, Outline | RawMesh):
        return found
    raise GeometryError(f"{name}: {shortened(str(found).removeprefix(f'{name}: '))}")


def child_environment() -> dict[str, str]:
    """Our environment variables; a child finds these packages, and nothing in its working folder."""
    others = [place for place in os.environ.get("PYTHONPATH", "").split(os.pathsep) if os.path.isabs(place)]
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *others])}


def _why_it_ended(code: int, printed: str) -> str:
    """Reason why a child process gave no answer, from its exit code and output."""
    if code < 0:
        return f"gmsh crashed on it ({signal.Signals(-code).name}); the file is damaged, or gmsh cannot read it"
    return f"gmsh ended without an answer; {shortened(printed.splitlines()[-1]) if printed else 'the file may end it'}"


def answer(question: Question) -> Outline | RawMesh:
    """Read the file in this process.

    Raises:
        GeometryError: the file cannot be read or meshed, or does not fit the scene.
    """
    with gmsh_session(gmsh_options(question)) as gmsh:
        parts = read_parts(gmsh, question)
        if question.mesh is None:
            return read_outline(gmsh, question.dim, parts, question.unit)
        return mesh_parts(gmsh, question.dim, parts, question.mesh)


def gmsh_options(question: Question) -> list[str]:
    """Command-line options of gmsh that set the parameters of a .geo script."""
    if kind_of(question.path) != "geo":
        return []
    return [word for name, value in question.parameters.items() for word in ("-setnumber", name, repr(value))]


def read_parts(gmsh: Gmsh, question: Question) -> Parts:
    """Open the file in the current gmsh model and find its bodies and sides."""
    open_file(gmsh, question.path, question.parameters)
    is_cad = kind_of(question.path) == "cad"
    return find_parts(gmsh, question.dim, is_cad, question.names, question.unit)


def main() -> None:
    """`python -m geometry.user_files.reader QUESTION ANSWER`: two pickles; the answer is a text if it fails."""
    asked, answered = (Path(word) for word in sys.argv[1:])
    question: Question = pickle.loads(asked.read_bytes())  # the parent's  # nosec B301
    content: Outline | RawMesh | str
    with answered.open("wb") as target:  # before containment
        try:
            question = replace(question, path=unpacked(question.path, asked.parent))
            if question.contained:
                import gmsh  # noqa: F401  starts programs to find its library

                contain(available())
            content = answer(question)
        except StickslipError as error:
            content = str(error)
        except MemoryError:
            content = "does not fit into memory"
        except Exception as error:  # gmsh raises bare Exception
            content = f"gmsh says: {error or type(error).__name__}"
        pickle.dump(content, target)


if __name__ == "__main__":
    main()
