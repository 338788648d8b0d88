"""Any file as a geometry is meshed or refused in one line; nothing crashes, hangs or is written."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpi4py import MPI

from shared.drawn import FACES, GEO, draw, scene_data
from shared.fuzzing import accepted, fuzzed
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.scene_file.read import from_dict

SHARE = 0.4  # of the examples: each starts two processes
LIMIT = 20.0  # [s] of gmsh
WORDS = [
    "0", "-1", "1e308", "nan", "1e-9", "9" * 400, "", ";", "{", "}", "(", "*/", "/*", '"', "\n", " ", "\0", "é",
    'SystemCall "touch made";', 'Printf("x") > "made";', 'Merge "b.geo";', 'Include "b.geo";', "Mesh 2;",
    "Delete Model;", "Physical Surface", "Box(9) = {0,0,0,1,1,1};", "For i In {0:9}", "EndFor",
    "If (0)", "EndIf", "Exit;", "Abort;", "$EndElements", "$Nodes", "#10", "ISO-10303-21;", "ENDSEC;", "$",
]  # fmt: skip


@cache
def original(kind: str) -> bytes:
    with TemporaryDirectory() as folder:
        return (
            GEO.encode() if kind == ".geo" else draw(Path(folder) / f"b{kind}", 2 if kind == ".msh" else 3).read_bytes()
        )


@st.composite
def mutated(draw_from: st.DrawFn, kind: str) -> bytes:
    """A file of a kind with words, numbers or bytes of it changed, left out, repeated or exchanged."""
    text = original(kind)
    for _ in range(draw_from(st.integers(1, 3))):
        if draw_from(st.booleans()):  # words
            parts = text.split(b" ")
            i, j = (draw_from(st.integers(0, len(parts) - 1)) for _ in range(2))
            word = draw_from(st.sampled_from([*(w.encode() for w in WORDS), parts[j]]))
            text = b" ".join([*parts[:i], word, *parts[i + draw_from(st.integers(0, 1)) :]])
        elif draw_from(st.booleans()):  # lines
            lines = text.split(b"\n")
            i, j = (draw_from(st.integers(0, len(lines) - 1)) for _ in range(2))
            text = b"\n".join([*lines[:i], lines[j], *lines[i + draw_from(st.integers(0, 1)) :]])
        else:  # bytes
            at = draw_from(st.integers(0, max(0, len(text) - 1)))
            text = text[:at] + draw_from(st.binary(max_size=4)) + text[at + draw_from(st.integers(0, 4)) :]
        if draw_from(st.integers(0, 9)) == 0:
            text = text[: draw_from(st.integers(0, len(text)))]
    return text


def use(name: str, content: bytes) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        solid = name.endswith((".step", ".brep"))
        keys: dict[str, Any] = {"mesh_size": 0.5, "names": FACES} if solid else {}
        data = scene_data(path, 3 if solid else 2, "part" if solid else "block", time_limit=LIMIT, **keys)
        scene = accepted(lambda: from_dict(data))
        if scene is not None and accepted(lambda: make_plan(scene)) is not None:
            accepted(lambda: build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF))
        assert [p.name for p in Path(folder).iterdir()] == [name]


@pytest.mark.parametrize("kind", [".geo", ".msh", ".step", ".brep"])
def test_a_mutated_file(kind: str) -> None:
    @fuzzed(SHARE)
    @given(mutated(kind))
    def check(content: bytes) -> None:
        use(f"b{kind}", content)

    check()


@fuzzed(SHARE)
@given(st.sampled_from(["b.geo", "b.msh", "b.step", "b.brep", "b.geo.gz", "b.msh.gz"]), st.binary(max_size=300))
def test_any_bytes(name: str, content: bytes) -> None:
    use(name, content)
