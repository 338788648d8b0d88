"""The child process: reads a user's file with gmsh, answers what was asked, and says in one line why it cannot."""

from __future__ import annotations

import pickle
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from geometry.errors import StickslipError
from geometry.mesh.gmsh_session import gmsh_session
from geometry.protocols import Gmsh
from geometry.user_files.meshing import mesh_parts
from geometry.user_files.opening import Parameter, kind_of, open_file, unpacked
from geometry.user_files.outline import Outline, read_outline
from geometry.user_files.parts import Parts, Selection, find_parts
from geometry.user_files.raw_mesh import RawMesh


@dataclass(frozen=True, kw_only=True)
class Question:
    """What the parent asks of a file; `mesh` is what `mesh_parts` takes, None asks for the outline."""

    path: Path
    dim: int
    unit: float  # [m]
    names: Mapping[str, Selection] = field(default_factory=dict)
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    mesh: Mapping[str, Any] | None = None


def answer(question: Question) -> Outline | RawMesh:
    """Raises: GeometryError."""
    with gmsh_session(setting_words(question)) as gmsh:
        parts = read_parts(gmsh, question)
        if question.mesh is None:
            return read_outline(gmsh, question.dim, parts, question.unit)
        return mesh_parts(gmsh, question.dim, parts, **question.mesh)


def setting_words(question: Question) -> list[str]:
    """gmsh's command line for the parameters of a .geo script."""
    if kind_of(question.path) != "geo":
        return []
    return [word for name, value in question.parameters.items() for word in ("-setnumber", name, repr(value))]


def read_parts(gmsh: Gmsh, question: Question) -> Parts:
    """Open the file in the current model and find its bodies and sides."""
    with tempfile.TemporaryDirectory(prefix="stickslip-") as folder:
        open_file(gmsh, unpacked(question.path, Path(folder)), question.parameters)
    is_cad = kind_of(question.path) == "cad"
    return find_parts(gmsh, question.dim, is_cad, question.names, question.unit)


def main() -> None:
    """`python -m geometry.user_files.reader QUESTION ANSWER`, two pickles."""
    question, target = (Path(word) for word in sys.argv[1:])
    content: tuple[str, Any]
    try:
        content = ("answer", answer(pickle.loads(question.read_bytes())))
    except StickslipError as error:
        content = ("refusal", str(error))
    except MemoryError:
        content = ("refusal", "does not fit into memory")
    except Exception as error:  # gmsh raises bare Exception
        content = ("refusal", f"gmsh says: {error or type(error).__name__}")
    target.write_bytes(pickle.dumps(content))


if __name__ == "__main__":
    main()
