"""gmsh's window, opened in a child process: gmsh ends its process if the display does not respond."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from stickslip.geometry.errors import MachineError, StickslipError
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.shape import Request, Shape
from stickslip.geometry.user_files.child_process import child_environment, restrict_files
from stickslip.geometry.user_files.open_file import unpacked
from stickslip.geometry.user_files.reader import gmsh_options, read_parts
from stickslip.geometry.user_files.user_file import UserFile

NO_WINDOW = 3  # exit code of the child


def open_window(shape: Shape, request: Request) -> None:
    """Show the geometry in gmsh's window until it is closed.

    Raises:
        MachineError: there is no display, or gmsh was built without its window.
    """
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if not display:
        raise MachineError("--gui: there is no display here (DISPLAY is not set); try --list, or gmsh elsewhere")
    with tempfile.TemporaryDirectory(prefix="stickslip-") as folder:
        pickled = Path(folder) / "pickled"
        pickled.write_bytes(pickle.dumps((shape, request)))
        words = [sys.executable, "-P", "-m", "stickslip.geometry.user_files.window", str(pickled)]
        done = subprocess.run(words, env=child_environment(), capture_output=True, check=False)
    if done.returncode == NO_WINDOW:
        raise MachineError("--gui: this gmsh was built without its window (FLTK); try --list")
    if done.returncode:
        raise MachineError(f"--gui: gmsh could not open its window on the display {display}; try --list")


def main() -> int:
    """`python -m stickslip.geometry.user_files.window FILE`, a pickled shape and request; returns the exit code."""
    shape, request = pickle.loads(Path(sys.argv[1]).read_bytes())  # the parent's  # noqa: S301
    question = shape.question(request.dim) if isinstance(shape, UserFile) else None
    if question and question.contained:
        import gmsh as _  # noqa: F401  starts programs to find its library

        restrict_files((question.path.parent, Path("/dev"), Path(sys.argv[1]).parent))  # the user may save there
        question = replace(question, path=unpacked(question.path, Path(sys.argv[1]).parent))
    with gmsh_session(gmsh_options(question) if question else ()) as gmsh:
        if "Fltk" not in gmsh.option.getString("General.BuildOptions").split():
            return NO_WINDOW
        try:
            if question:
                read_parts(gmsh, question)
            else:
                shape.put(gmsh, request)
        except StickslipError:  # show a file without names too: the user may add them there
            pass
        gmsh.fltk.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
