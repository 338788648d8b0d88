"""Scenes drawn at random from families, each as a scene file of a second or so, and as two far finer ones.

The finer ones are of order 2, with smaller cells and more steps: the finest is the truth, the other tells its doubt.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stickslip.geometry.errors import require
from stickslip.geometry.mesh.mesh import write_msh
from stickslip.workflows.lab.verification.accuracy.families import FAMILIES, Dice, Member
from stickslip.workflows.lab.verification.hard.tables import Tables, sizes, toml
from stickslip.workflows.scene_file.read import from_dict, read, to_dict

FINER = {("2d", 1): 8.0, ("2d", 2): 8.0, ("3d", 1): 3.0, ("3d", 2): 4.0}  # of the truth's cells, by model and order
DOUBT = 1.5  # times the truth's cells, and half its steps: the run that tells how well it is known
MORE = 16  # times the steps
RUN, TRUTH, SECOND = "run", "truth", "second"  # names of the scene files
FIRST = "first"  # order 2 on the run's cells: what grows from there on has no limit


@dataclass(frozen=True)
class Drawn:
    """One scene of a family, with its order."""

    name: str
    member: Member

    @property
    def order(self) -> int:
        return int(self.member.tables["geometry"]["order"])

    @property
    def cells(self) -> tuple[float, float]:
        """Mesh sizes of the second run and of the truth, in those of the scene."""
        model = "3d" if self.member.tables["model"] == "3d" else "2d"
        fine = 1 / (FINER[model, self.order] * self.member.finer)
        return DOUBT * fine, fine

    def files(self, folder: Path) -> dict[str, Path]:
        """Write the scene, that of order 2 on its cells, and the two finer ones."""
        own, (second, fine) = self.member.tables, self.cells
        folder.mkdir(parents=True, exist_ok=True)
        if self.member.outline:
            (folder / "shape.geo").write_text(self.member.outline, encoding="utf-8")
        found = {
            TRUTH: finer(own, fine, MORE),
            SECOND: finer(own, second, MORE // 2),
            FIRST: finer(own, 1.0, 1),
            RUN: own,
        }
        if self.member.meshed:
            scene = from_dict(own)
            write_msh(scene.geometry, scene.request(), folder / f"{RUN}.msh")
            found[RUN] = own | {"geometry": {"file": f"{RUN}.msh", "order": self.order}}
        paths = {key: folder / f"{key}.toml" for key in found}
        for key, tables in found.items():
            paths[key].write_text(written(tables), encoding="utf-8")
        return paths


def finer(tables: Tables, factor: float, more: int) -> Tables:
    """The same of order 2, with mesh sizes times a factor, in so many times the steps, without stated errors."""
    found = deepcopy(tables)
    for key in sizes(tables):
        found["geometry"][key] *= factor
    found["geometry"]["order"] = 2
    found["steps"]["count"] *= more
    found["output"]["error"] = False
    return found


def written(tables: Tables) -> str:
    """Text of a scene file.

    >>> print(written({"model": "3d", "steps": {"end": 1.0}, "loads": {"top": {"pressure": 2.0}}}))
    model = "3d"
    <BLANKLINE>
    [steps]
    end = 1.0
    <BLANKLINE>
    [loads.top]
    pressure = 2.0
    <BLANKLINE>
    """
    parts: dict[str, Mapping[str, Any]] = {
        "": {k: value for k, value in tables.items() if not isinstance(value, Mapping)}
    }
    for name, table in tables.items():
        if isinstance(table, Mapping):
            named = all(isinstance(value, Mapping) for value in table.values())
            parts |= {f"[{name}.{key}]\n": value for key, value in table.items()} if named else {f"[{name}]\n": table}
    return "\n".join(
        head + "".join(f"{key} = {toml(value)}\n" for key, value in part.items()) for head, part in parts.items()
    )


def of_file(path: Path) -> Drawn:
    """The scene of a file, which is judged like a drawn one.

    Raises:
        SceneError: it cannot be read, or has no mesh sizes.
    """
    tables = to_dict(read(path))
    require(bool(sizes(tables)), f"{path}: geometry.mesh_size", None, "is needed, for the truth has smaller cells")
    tables["output"] |= {"pictures": False, "error": True}
    return Drawn(path.stem, Member(tables))


def drawn(seed: int) -> Iterator[Drawn]:
    """Scenes without end; each family comes up once before one comes up again."""
    names, index = list(FAMILIES), 0
    while True:
        for k in Dice(seed, index).mixed(len(names)):
            yield draw(names[k], seed, index)
            index += 1


def draw(family: str, seed: int, index: int) -> Drawn:
    """The scene of a family that a seed and a number tell."""
    dice = Dice(seed, index, *family.encode())
    member, name = FAMILIES[family](dice), f"{index:03d}_{family}"
    tables = member.tables
    tables["title"] = f"Drawn from {family}, seed {seed}, number {index}"
    tables["geometry"]["order"] = dice.one_of(1, 1, 1, 2, 2)
    tables["output"] = {"pictures": False, "error": True}
    return Drawn(name, member)
