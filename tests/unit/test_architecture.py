"""docs/architecture.md is true: its floors, its paths, and its examples, each one new file in a copy of the house."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from textwrap import dedent
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
EXAMPLES = {  # heading: room, and what the file imports
    "Builder": ("geometry/builders", ["stickslip.geometry.builders.cuboid: Cuboid, grid"]),
    "Obstacle": ("geometry/obstacles", ["stickslip.geometry.obstacles.obstacle: Obstacle"]),
    "Law": ("solvers/laws", ["stickslip.solvers.laws.law: FrictionLaw, touched"]),
    "Effect": (
        "solvers/effects",
        [
            "stickslip.geometry.amplitude: Amplitude",
            "stickslip.solvers.effects.effect: Effect",
            "stickslip.solvers.fem.terms: InitialStrain",
            "stickslip.solvers.scene.scene: EffectTable",
            "stickslip.solvers.scene.timeline: Place",
        ],
    ),
    "Method": (
        "solvers/methods",
        [
            "stickslip.solvers.methods.method: Applicability",
            "stickslip.solvers.methods.method: Stateless",
            "stickslip.solvers.classical.uzawa: FixedStep, Outer, Solved",
            "stickslip.solvers.iteration: ignore",
        ],
    ),
    "Writer": ("workflows/writers", ["stickslip.workflows.writers.writer: Writer"]),
}
SCRIPT = """
    import json
    import os
    import stickslip
    from stickslip.workflows.scene_file.read import from_dict

    assert stickslip.__file__.startswith(os.getcwd())
    scene = from_dict({
        "model": "plane strain",
        "geometry": {"builder": "slab", "length": 1.0, "height": 1.0, "mesh_size": 0.5},
        "bodies": {"slab": {"E": 100.0, "nu": 0.0}},
        "obstacles": {"wall": {"shape": "wall", "at": 1.0}},
        "contacts": {"end": {"surface": "slab.right", "against": "wall", "friction": {"law": "sticky", "a": 0.0}}},
        "supports": {
            "left": {"boundary": "slab.left", "displacement": {"x": 0.0}},
            "base": {"boundary": "slab.bottom", "displacement": {"y": 0.0}},
        },
        "output": {"error": False},
        "heat": {"strain": [[0.0, 0.0], [0.37, 0.01], [1.0, 0.02]]},
    })
    steps = list(stickslip.steps(scene))
    found = {
        "public": [name for name in ("Slab", "Wall", "Sticky", "Heat") if name in dir(stickslip)],
        "times": [step.time for step in steps],
        "forces": [step.contacts["end"].normal_force for step in steps],
    }

    coarse = ["geometry.mesh_size=1.0", "geometry.contact_mesh_size=1.0", "output.error=false", "output.pictures=false"]
    loose = [*coarse, "solver.tolerance=1e-6"]
    for method in ("patient", "condensed-newton"):
        *_, last = stickslip.steps(stickslip.read("block", [*loose, f"solver.method={method}"]))
        found[method] = last.iterations, last.contacts["base"].normal_force

    stickslip.run(stickslip.read("block", coarse), "results/block")
    found["written"] = open("results/block/forces.txt").read()
    print(json.dumps(found))
"""
ALWAYS = ["dataclasses: dataclass", "typing: Annotated, Literal", "stickslip.geometry.keys: Key"]


def example(name: str) -> str:
    """The code below a heading, as a file."""
    found = re.search(rf"^\*\*{name}\*\*.*?```python\n(.*?)```", PAGE, re.DOTALL | re.MULTILINE)
    lines = (line.partition(": ") for line in ALWAYS + EXAMPLES[name][1])
    imports = [f"from {module} import {names}" for module, _, names in lines]
    return "\n".join([f'"""{name}."""', "import numpy as np", *imports, "", found[1]])


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the script finds in a copy of the house that has all examples in their rooms."""
    folder = tmp_path_factory.mktemp("house")
    for package in ("geometry", "solvers", "workflows"):
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(
        ROOT / "stickslip", folder / "stickslip", symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
    )
    for name, (room, _) in EXAMPLES.items():
        (folder / room / f"added_{name.lower()}.py").write_text(example(name), encoding="utf-8")
    run = subprocess.run(
        [sys.executable, "-c", dedent(SCRIPT)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    content: dict[str, Any] = json.loads(run.stdout.splitlines()[-1])
    return content


def test_the_page_is_short_and_its_paths_exist() -> None:
    assert len(PAGE.splitlines()) <= 120
    named = {path for path in re.findall(r"[\w./]+", PAGE) if "/" in path and Path(path).suffix}
    named |= {f"tests/unit/{name}" for name in re.findall(r"`(test_\w+\.py)`", PAGE)}
    named |= {f"docs/{name}" for name in re.findall(r"\]\((\w+\.svg)\)", PAGE)}
    assert len(named) > 10
    assert not {path for path in named if not (ROOT / path).is_file()}


def test_builder_obstacle_law_and_effect_are_one_file_each(found: dict[str, Any]) -> None:
    """A heated slab between its support and a wall: p = E eps / (1 - nu^2) in plane strain, free along y, nu = 0."""
    assert found["public"] == ["Slab", "Wall", "Sticky", "Heat"]
    assert found["times"] == [0.37, 1.0]  # the corner of the effect's table is hit
    assert found["forces"] == pytest.approx([1.0, 2.0], rel=1e-6)  # E eps times the height, to the solver's tolerance


def test_a_method_is_one_file(found: dict[str, Any]) -> None:
    (slow, mine), (fast, reference) = found["patient"], found["condensed-newton"]
    assert slow > fast
    assert mine == pytest.approx(reference, rel=1e-4)  # a residual of 1e-6, times the condition of the block


def test_a_writer_is_one_file(found: dict[str, Any]) -> None:
    lines = found["written"].splitlines()
    assert [line.split()[0] for line in lines] == ["1.0", "2.0"]
