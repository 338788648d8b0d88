"""Files cut short or with bytes changed: each gives a valid mesh or one line with exit code 2, and nothing else."""

import random
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from shared.drawn import FACES, GEO, PY, draw, scene_data
from stickslip.geometry.errors import GeometryError, SceneError
from stickslip.geometry.mesh.cell_quality import worst_quality
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.user_files import reader
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.commands.cli import guarded
from stickslip.workflows.scene_file.read import from_dict

FEW, MANY = 4, 25  # damaged files of each kind, half of them cut short, half with a byte changed
SIGNS = b"0123456789.-(){};,\x00\xff"  # what hurts most
WORKERS = 2
PATIENCE = 30.0  # s, for a script that a changed byte makes run for ever


def originals(folder: Path) -> Iterator[tuple[Path, dict[str, Any]]]:
    """A file of each kind with its scene."""
    msh = draw(folder / "b.msh", 2)
    yield msh, scene_data(msh)
    step = draw(folder / "b.step")
    yield step, scene_data(step, 3, "part", mesh_size=2.0, names=FACES)
    for name, text, more in (("b.geo", GEO, {}), ("b.py", PY, {"mesh_size": 0.5, "length": 4.0})):
        path = folder / name
        path.write_text(text)
        yield path, scene_data(path, **more)


def damaged(content: bytes, count: int, draw_lots: random.Random) -> Iterator[bytes]:
    """The content, damaged in so many ways, which the seed of `draw_lots` fixes."""
    for index in range(count):
        if index % 2:
            yield content[: draw_lots.randrange(len(content))]
        else:
            changed = bytearray(content)
            changed[draw_lots.randrange(len(content))] = draw_lots.choice(SIGNS)
            yield bytes(changed)


def outcome(data: dict[str, Any]) -> tuple[Scene | None, str]:
    """The scene if its file still says what it should, else the line that says why not."""
    try:
        return from_dict(data), ""
    except (SceneError, GeometryError) as error:
        return None, str(error)


def mesh_or_line(scene: Scene) -> str:
    """Mesh the scene: why it cannot be done, or nothing."""
    try:
        mesh = build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF)
    except (SceneError, GeometryError) as error:
        return str(error)
    assert np.isfinite(mesh.box()).all()
    assert worst_quality(mesh.domain, mesh.degree) > 0
    return ""


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])
def test_damaged_files_give_a_mesh_or_one_line(count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "READING_TIME", PATIENCE)
    draw_lots, scenes = random.Random(2026), []
    for path, data in originals(tmp_path):
        for index, content in enumerate(damaged(path.read_bytes(), count, draw_lots)):
            file = tmp_path / f"{path.suffix[1:]}{index:02}{path.suffix}"
            file.write_bytes(content)
            scenes.append(data | {"geometry": data["geometry"] | {"file": str(file)}})
    assert len(scenes) == 4 * count
    with ThreadPoolExecutor(WORKERS) as pool:
        outcomes = list(pool.map(outcome, scenes))
    survivors = [scene for scene, _ in outcomes if scene is not None]
    refused = [line for _, line in outcomes if line]
    assert len(refused) > 0.4 * len(scenes)  # files that are cut short hold no mesh, but for the last bytes
    late = [mesh_or_line(scene) for scene in survivors[::6]]
    assert "" in late
    for line in filter(None, refused + late):
        assert "\n" not in line
        assert "Traceback" not in line
        assert str(tmp_path) not in line  # the file's name is enough


def test_a_damaged_file_ends_the_command_with_code_2(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = draw(tmp_path / "b.msh", 2)
    path.write_bytes(path.read_bytes()[:2000])
    assert guarded(lambda: from_dict(scene_data(path))) == 2
    out, err = capfd.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("stickslip: b.msh: ")
