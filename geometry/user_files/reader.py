"""A user's file is read by gmsh in a child process, since the file may crash gmsh or keep it busy for ever.

The parent asks a `Question` and gets an `Outline` or a `RawMesh`; any failure is one line of a GeometryError.
"""

from __future__ import annotations

import logging
import os
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from geometry.errors import GeometryError, StickslipError
from geometry.mesh.gmsh_session import gmsh_session
from geometry.protocols import Gmsh
from geometry.user_files.meshing import MeshOptions, mesh_parts
from geometry.user_files.open_file import Parameter, kind_of, open_file, unpacked
from geometry.user_files.outline import Outline, read_outline
from geometry.user_files.parts import Parts, Selection, find_parts
from geometry.user_files.raw_mesh import RawMesh

log = logging.getLogger(__name__)
READING_TIME = 300.0  # [s] limit for an outline, far more than any usual file needs
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


def ask(question: Question) -> Outline | RawMesh:
    """Answer a question in a child process.

    Raises:
        GeometryError: the name of the file and what is wrong with it.
    """
    name = question.path.name
    with tempfile.TemporaryDirectory(prefix="stickslip-") as folder:
        asked, answered = Path(folder) / "question", Path(folder) / "answer"
        asked.write_bytes(pickle.dumps(question))
        try:
            done = subprocess.run(
                [sys.executable, "-m", "geometry.user_files.reader", str(asked), str(answered)],
                env=child_environment(),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                timeout=READING_TIME if question.mesh is None else None,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise GeometryError(f"{name}: gmsh does not finish reading it within {READING_TIME:g} s") from None
        printed = done.stdout.decode(errors="replace").strip()
        if printed:
            log.info("%s printed: %s", name, printed)
        if not answered.exists():
            raise GeometryError(f"{name}: {_why_it_ended(done.returncode, printed)}")
        content = pickle.loads(answered.read_bytes())
    if isinstance(content, Outline | RawMesh):
        return content
    raise GeometryError(f"{name}: {' '.join(str(content).split())}")


def child_environment() -> dict[str, str]:
    """Our environment variables; a child process finds these packages by its PYTHONPATH."""
    return os.environ | {
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    }


def _why_it_ended(code: int, printed: str) -> str:
    """Reason why a child process gave no answer, from its exit code and output."""
    if code < 0:
        return f"gmsh crashed on it ({signal.Signals(-code).name}); the file is damaged, or gmsh cannot read it"
    return f"gmsh ended without an answer; {printed.splitlines()[-1] if printed else 'the file may end it'}"


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
    with tempfile.TemporaryDirectory(prefix="stickslip-") as folder:
        open_file(gmsh, unpacked(question.path, Path(folder)), question.parameters)
    is_cad = kind_of(question.path) == "cad"
    return find_parts(gmsh, question.dim, is_cad, question.names, question.unit)


def main() -> None:
    """`python -m geometry.user_files.reader QUESTION ANSWER`: two pickles; the answer is a text if it fails."""
    question, target = (Path(word) for word in sys.argv[1:])
    content: Outline | RawMesh | str
    try:
        content = answer(pickle.loads(question.read_bytes()))
    except StickslipError as error:
        content = str(error)
    except MemoryError:
        content = "does not fit into memory"
    except Exception as error:  # gmsh raises bare Exception
        content = f"gmsh says: {error or type(error).__name__}"
    target.write_bytes(pickle.dumps(content))


if __name__ == "__main__":
    main()
