"""Scenes drawn at random from families, each as a scene file of a second or so, and as two far finer ones.

A family is a shape that is pressed, pushed or heated; its sizes, mesh, materials, laws, history and order are drawn.
The finer scenes are of order 2, with smaller cells and more steps; the finest is the truth, the other tells its doubt.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from stickslip.geometry.mesh.mesh import write_msh
from stickslip.workflows.lab.verification.hard.tables import Tables, sizes, toml
from stickslip.workflows.scene_file.read import from_dict

FINER = {(2, 1): 6.0, (2, 2): 6.0, (3, 1): 2.0, (3, 2): 3.0}  # of the truth's cells, by dimension and order
DOUBT = 1.5  # times the truth's cells, and half its steps: the mesh that tells how well it is known
MORE = 16  # times the steps
RUN, TRUTH, SECOND = "run", "truth", "second"  # names of the three scene files
Knots = Sequence[tuple[float, float, float]]  # time, share of the pressing, share of the push aside


class Dice:
    """Random numbers of three digits, so that scene files can be read."""

    def __init__(self, *seed: int) -> None:
        self._random = np.random.default_rng(seed)

    def between(self, low: float, high: float) -> float:
        return float(f"{self._random.uniform(low, high):.3g}")

    def one_of(self, *options: Any) -> Any:
        return options[int(self._random.integers(len(options)))]

    def mixed(self, number: int) -> list[int]:
        return self._random.permutation(number).tolist()


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """One scene of a family."""

    name: str
    tables: Tables
    outline: str = ""  # text of the .geo file that the scene names
    meshed: bool = False  # whether the scene names a file of its mesh instead of a shape
    finer: float = 1.0  # times the usual fineness of the truth

    @property
    def of_family(self) -> str:
        return self.name.partition("_")[2]

    @property
    def cells(self) -> tuple[float, float]:
        """Mesh sizes of the second and of the truth, in those of the scene."""
        order, dim = self.tables["geometry"]["order"], 3 if self.tables["model"] == "3d" else 2
        fine = 1 / (FINER[dim, order] * self.finer)
        return DOUBT * fine, fine

    def files(self, folder: Path) -> dict[str, Path]:
        """Write the scene and the two finer ones."""
        second, fine = self.cells
        folder.mkdir(parents=True, exist_ok=True)
        if self.outline:
            (folder / "shape.geo").write_text(self.outline, encoding="utf-8")
        return {
            RUN: self._file(folder / f"{RUN}.toml", self.tables),
            TRUTH: self._file(folder / f"{TRUTH}.toml", finer(self.tables, fine, MORE)),
            SECOND: self._file(folder / f"{SECOND}.toml", finer(self.tables, second, MORE // 2)),
        }

    def _file(self, path: Path, tables: Tables) -> Path:
        if self.meshed and path.stem == RUN:
            scene = from_dict(tables)
            write_msh(scene.geometry, scene.request(), path.with_suffix(".msh"))
            tables = {**tables, "geometry": {"file": f"{RUN}.msh", "order": tables["geometry"]["order"]}}
        path.write_text(written(tables), encoding="utf-8")
        return path


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
    """A scene file.

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
    plain = [f"{key} = {toml(value)}\n" for key, value in tables.items() if not isinstance(value, Mapping)]
    parts = ["".join(plain)]
    for name, table in tables.items():
        if isinstance(table, Mapping):
            named = all(isinstance(value, Mapping) for value in table.values())
            rows = {f"{name}.{key}": value for key, value in table.items()} if named else {name: table}
            parts += [
                "".join([f"[{key}]\n", *(f"{k} = {toml(v)}\n" for k, v in row.items())]) for key, row in rows.items()
            ]
    return "\n".join(parts)


def drawn(seed: int) -> Iterator[Drawn]:
    """Scenes without end; each family comes up once before one comes up again."""
    names = list(FAMILIES)
    index = 0
    while True:
        for k in Dice(seed, index).mixed(len(names)):
            yield draw(names[k], seed, index)
            index += 1


def draw(family: str, seed: int, index: int) -> Drawn:
    """The scene of a family that a seed and a number tell."""
    dice = Dice(seed, index, *family.encode())
    found = FAMILIES[family](dice)
    tables = found.tables
    tables["title"] = f"Drawn from {family}, seed {seed}, number {index}"
    tables["geometry"].setdefault("order", dice.one_of(1, 1, 1, 2, 2))
    tables.setdefault("steps", {"end": 1.0, "count": 1})
    tables["output"] = {"pictures": False, "error": True}
    return Drawn(**{**vars(found), "name": f"{index:03d}_{family}"})


# what scenes are made of


def body(dice: Dice, E: float, model: str = "") -> Tables:
    """A material; one in ten plane bodies is orthotropic."""
    if model.startswith("plane") and dice.between(0, 1) < 0.1:
        shares = {"E_2": dice.between(0.1, 1), "E_3": dice.between(0.1, 1), "G_12": dice.between(0.1, 0.4)}
        angle = dice.between(0, pi)
        return {"E_1": E, **{key: share * E for key, share in shares.items()}, "nu_12": 0.3, "nu_13": 0.3, "nu_23": 0.3,
                "axis_1": [float(np.cos(angle)), float(np.sin(angle))]}  # fmt: skip
    return {"E": E, "nu": dice.one_of(0.0, 0.2, 0.3, 0.3, 0.35, 0.45, 0.49)}


def laws(dice: Dice, E: float, strain: float, travel: float) -> Tables:
    """Laws of a contact; pressures are about E times the strain, and slips about the travel [m]."""
    p, mu = E * strain, dice.between(0.1, 0.6)
    friction = dice.one_of(
        *[{"law": "coulomb", "mu": mu}] * 5,
        {"law": "coulomb", "mu": mu, "k_T": dice.between(2, 20) * p / travel},
        {"law": "capped_coulomb", "mu": mu, "s_max": dice.between(0.5, 1.2) * mu * p},
        {"law": "cohesion", "a": dice.between(0.05, 0.2) * mu * p, "mu": mu},
        {"law": "static_kinetic", "mu_s": mu, "mu_k": dice.between(0.6, 0.9) * mu, "slip_length": travel},
        {"law": "slip_dependent", "mu": [[0.0, mu], [travel, dice.between(1, 1.5) * mu]]},
        {"law": "pressure_dependent", "mu": [[0.0, mu], [2 * p, dice.between(0.6, 1) * mu]]},
        None,
        None,
    )
    found: Tables = {"friction": friction} if friction else {}
    if dice.between(0, 1) < 0.15:
        found["normal"] = {"law": "compliance", "c_n": dice.between(5, 50) * p / travel, "m_n": dice.one_of(1.0, 1.5)}
    return found


def history(dice: Dice) -> Knots:
    """Pressed; then pushed aside, or to and fro, or let go; or both at once."""
    return dice.one_of(
        [(1, 1, 0)],
        [(1, 1, 1)],
        [(1, 1, 0), (2, 1, 1)],
        [(1, 1, 0), (2, 1, 1)],
        [(1, 1, 0), (2, 1, 1), (3, 1, dice.between(-1, 0.5))],
        [(1, 1, 0), (2, dice.between(0.2, 0.8), 0)],
        [(1, 1, 0), (2, dice.between(0.5, 1.3), 1)],
    )


def pressing(knots: Knots, amount: float) -> list[list[float]]:
    return [[0.0, 0.0], *([float(t), share * amount] for t, share, _ in knots)]


def aside(knots: Knots, amount: float) -> list[list[float]]:
    return [[0.0, 0.0], *([float(t), share * amount] for t, _, share in knots)]


def steps(dice: Dice, knots: Knots) -> Tables:
    end = float(knots[-1][0])
    return {"end": end, "count": int(end) * dice.one_of(1, 2, 2, 3)}


def modulus(dice: Dice) -> float:
    return dice.one_of(1.0, 100.0, 7e4, 2.1e11)


def on_plane(
    dice: Dice,
    geometry: Tables,
    slave: str,
    top: str,
    size: float,
    strain: float,
    model: str,
    obstacle: Tables | None = None,
    probe: Sequence[float] = (),
    supports: Tables | None = None,
    slip: float = 1.0,
) -> Tables:
    """One body that its moved top presses on an obstacle.

    Args:
        size: of the body [m].
        strain: the way of the top over the size.
        slip: the way aside over that of the pressing; 0: straight down.
    """
    dim, E, knots, name = 3 if model == "3d" else 2, modulus(dice), history(dice), slave.split(".")[0]
    down = strain * size
    way = slip * dice.between(0.15, 0.9) * down
    moved = {"xyz"[dim - 1]: pressing(knots, -down)}
    moved |= {"x": aside(knots, way)} if slip else {}
    moved |= {"y": aside(knots, 0.5 * way)} if slip and dim == 3 and dice.one_of(True, False) else {}
    plane = {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}
    return {
        "model": model,
        "geometry": geometry,
        "bodies": {name: body(dice, E, model)},
        "obstacles": {"ground": obstacle or plane},
        "contacts": {"base": {"surface": slave, "against": "ground", **laws(dice, E, strain, 0.3 * down)}},
        "supports": {"top": {"boundary": top, "displacement": moved}, **(supports or {})},
        "probes": {"inside": {"point": list(probe)}},
        "steps": steps(dice, knots),
    }


def joined(
    dice: Dice,
    geometry: Tables,
    sides: Sequence[str],
    size: float,
    strain: float,
    model: str,
    probe: Sequence[float],
    supports: Tables | None = None,
    slip: float = 1.0,
) -> Tables:
    """Two bodies, the upper one pressed on the lower one by its top.

    Args:
        sides: of the contact, upper and lower; then those that are moved and held.
    """
    up, low, top, base = sides
    found = on_plane(dice, geometry, up, top, size, strain, model, probe=probe, supports=supports, slip=slip)
    del found["obstacles"]
    found["contacts"]["base"]["against"] = low
    E = next(value for key, value in found["bodies"][up.split(".")[0]].items() if key in ("E", "E_1"))
    found["bodies"][low.split(".")[0]] = body(dice, E * dice.one_of(0.2, 1.0, 1.0, 5.0), model)
    dim = 3 if model == "3d" else 2
    held = {axis: 0.0 for axis in "xyz"[:dim]} if slip else {"xyz"[dim - 1]: 0.0}
    found["supports"]["base"] = {"boundary": base, "displacement": held}
    return found


def plane(dice: Dice) -> str:
    return dice.one_of("plane strain", "plane stress")


def cells(dice: Dice) -> str:
    return dice.one_of("simplex", "simplex", "tensor")


# families


def _box(dice: Dice, tallest: float = 1.0) -> tuple[float, float, Tables]:
    """Length and height of a block, and its shape."""
    length, height = dice.between(1, 3), dice.between(0.5, tallest)
    size = height / dice.between(3, 6)
    found = {"builder": "block", "length": length, "height": height, "mesh_size": size, "cells": cells(dice)}
    return length, height, found | ({"contact_mesh_size": 0.5 * size} if dice.one_of(True, False) else {})


def block(dice: Dice) -> Drawn:
    length, height, shape = _box(dice)
    probe = (0.4 * length, 0.5 * height)
    strain = dice.between(0.003, 0.03)
    return Drawn(
        name="", tables=on_plane(dice, shape, "block.bottom", "block.top", height, strain, plane(dice), probe=probe)
    )


def mesh_file(dice: Dice) -> Drawn:
    """A block, two blocks or a wedge whose mesh is read from a file."""
    found = dice.one_of(block, two_blocks, wedge)(dice)
    return Drawn(name="", tables=found.tables, meshed=True)


def floating(dice: Dice) -> Drawn:
    """A block that loads press and friction alone holds."""
    length, height, shape = _box(dice)
    E, knots = modulus(dice), history(dice)
    p, mu = E * dice.between(0.003, 0.03), dice.between(0.3, 0.7)
    friction = dice.one_of(
        {"law": "coulomb", "mu": mu},
        {"law": "static_kinetic", "mu_s": mu, "mu_k": 0.9 * mu, "slip_length": 0.1 * p * height / E},
    )
    push = 0.6 * mu * p * length / height * dice.between(0.3, 1)
    tables = {
        "model": plane(dice),
        "geometry": shape,
        "bodies": {"block": {"E": E, "nu": dice.between(0, 0.49)}},
        "obstacles": {"ground": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        "contacts": {"base": {"surface": "block.bottom", "against": "ground", "friction": friction}},
        "loads": {
            "top": {"boundary": "block.top", "traction": ["0", f"-{p!r}*(1 + {dice.between(-0.5, 0.5)}*(2*x/{length!r} - 1))*min(t, 1)"]},
            "side": {"boundary": "block.right", "traction": [[[t, 0.3 * share] for t, share in aside([k for k in knots], push)], 0.0]},
        },
        "probes": {"inside": {"point": [0.4 * length, 0.5 * height]}},
        "steps": steps(dice, knots),
    }  # fmt: skip
    return Drawn(name="", tables=tables)


def stack(dice: Dice) -> Drawn:
    """Blocks that stand on each other by their weight, then are tilted."""
    count, height, mu = dice.one_of(2, 3), dice.between(0.3, 0.6), dice.between(0.3, 0.6)
    rho, E = 2000.0, dice.one_of(1e6, 1e7)
    names = [f"block_{k + 1}" for k in range(count)]
    partners = ["floor", *(f"{name}.top" for name in names)]
    return Drawn(
        name="",
        tables={
            "model": "plane strain",
            "geometry": {"builder": "stack", "count": count, "length": 1.0, "height": height, "cells": cells(dice),
                         "mesh_size": height / dice.one_of(2, 3), "mesh_ratio": dice.between(0.6, 1.5)},
            "bodies": {name: {"E": E * dice.one_of(1, 1, 3), "nu": dice.between(0, 0.45), "density": rho} for name in names},
            "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
            "contacts": {
                f"joint_{k + 1}": {"surface": f"{name}.bottom", "against": partners[k],
                                   "friction": {"law": "coulomb", "mu": mu}}
                for k, name in enumerate(names)
            },
            "gravity": {"acceleration": [[[0, 0], [1, 0], [2, 9.81 * mu * dice.between(0.2, 0.8)]], [[0, 0], [1, -9.81]]]},
            "probes": {"inside": {"point": [0.3, 0.4 * height]}},
            "steps": {"end": 2.0, "count": dice.one_of(2, 4)},
        },
    )  # fmt: skip


def receding(dice: Dice) -> Drawn:
    """A strip that a load in its middle presses, so that its ends lift; with the load the part that touches stays."""
    height, E = dice.between(0.3, 0.6), modulus(dice)
    length, p = height * dice.between(8, 12), E * dice.between(0.003, 0.02)
    knots = history(dice)
    load = f"-{p!r}*exp(-((x - {length / 2!r})/{dice.between(0.3, 1) * height!r})**2)"
    bed = dice.one_of({"friction": {"law": "coulomb", "mu": dice.between(0.1, 0.5)}}, {})
    contact = {"surface": "block.bottom", "against": "ground", **bed}
    tables = {
        "model": plane(dice),
        "geometry": {"builder": "block", "length": length, "height": height, "mesh_size": height / dice.between(2, 4),
                     "contact_mesh_size": height / dice.between(4, 6)},
        "bodies": {"block": {"E": E, "nu": dice.between(0, 0.49)}},
        "obstacles": {"ground": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        "contacts": {"base": contact},
        "loads": {"top": {"boundary": "block.top", "traction": ["0", f"{load}*min(t, 1)"]}},
        "springs": {"held": {"at": "block.left", "stiffness": [1e-4 * E, 0.0]}},
        "probes": {"inside": {"point": [0.45 * length, 0.5 * height]}},
        "steps": steps(dice, [(1, 1, 0)] if not bed else knots[:1]),
    }  # fmt: skip
    return Drawn(name="", tables=tables)


def two_blocks(dice: Dice) -> Drawn:
    """Blocks whose meshes do not match, one longer or shifted."""
    length, height = dice.between(1, 2), dice.between(0.4, 0.8)
    low = dice.between(0.4, 0.8)
    shape = {"builder": "two_blocks", "length": length, "height": height, "lower_height": low, "cells": cells(dice),
             "lower_length": length * dice.one_of(1.0, 1.0, 1.6), "mesh_size": height / dice.between(3, 5)}  # fmt: skip
    shape["lower_mesh_size"] = shape["mesh_size"] * dice.between(0.7, 1.4)
    sides = ("upper.bottom", "lower.top", "upper.top", "lower.bottom")
    probe = (0.4 * length, 0.5 * height)
    return Drawn(
        name="",
        tables=joined(dice, shape, sides, height + low, dice.between(0.003, 0.02), plane(dice), probe),
    )


def block_on_waves(dice: Dice) -> Drawn:
    """A block on a wavy foundation: contact spreads from the crests."""
    length, height, shape = _box(dice)
    wave, strain = length / dice.one_of(1, 2, 3), dice.between(0.005, 0.02)
    crest = dice.between(0.2, 0.8) * strain * height
    shape["contact_mesh_size"] = wave / dice.between(10, 16)
    obstacle = {"shape": "graph", "height": f"{crest!r}*(cos({2 * pi / wave!r}*x) - 1)"}
    probe = (0.4 * length, 0.5 * height)
    return Drawn(
        name="",
        tables=on_plane(dice, shape, "block.bottom", "block.top", height, strain, plane(dice), obstacle, probe),
    )


def _dome(dice: Dice, builder: str) -> Tables:
    """Size 1; contact is about a sixth of it wide where it is pressed by 3 %."""
    return {
        "builder": builder,
        "radius": 1.0,
        "mesh_size": dice.between(0.12, 0.2),
        "contact_mesh_size": dice.between(0.03, 0.05),
        "contact_radius": 0.25,
    }


def half_disc(dice: Dice) -> Drawn:
    tables = on_plane(dice, _dome(dice, "half_disc"), "disc.arc", "disc.top", 1.0, dice.between(0.02, 0.04), plane(dice),
                      probe=(0.1, 0.2), slip=0.8)  # fmt: skip
    return Drawn(name="", tables=tables)


def one_node(dice: Dice) -> Drawn:
    """A disc so coarse that one node touches, or two."""
    shape = {"builder": "half_disc", "radius": 1.0, "mesh_size": dice.between(0.15, 0.25)}
    tables = on_plane(
        dice, shape, "disc.arc", "disc.top", 1.0, dice.between(0.005, 0.02), plane(dice), probe=(0.1, 0.4)
    )
    return Drawn(name="", tables=tables, finer=1.5)


def ring_between_planes(dice: Dice) -> Drawn:
    """A ring that two planes squeeze; at first a node touches each."""
    E, knots, mu = modulus(dice), history(dice), dice.between(0.1, 0.4)
    down = dice.between(0.02, 0.08)
    planes = {
        "floor": {"shape": "plane", "point": [0.0, -1.0], "normal": [0.0, 1.0]},
        "lid": {"shape": "plane", "point": [0.0, 1.0], "normal": [0.0, -1.0],
                "displacement": {"y": pressing(knots, -down), "x": aside(knots, dice.between(0.1, 0.5) * down)}},
    }  # fmt: skip
    size = dice.between(0.08, 0.15)
    return Drawn(
        name="",
        tables={
            "model": plane(dice),
            "geometry": {"builder": "ring", "inner_radius": dice.between(0.6, 0.8), "outer_radius": 1.0, "mesh_size": size,
                         "contact_mesh_size": dice.one_of(0.5, 1.0) * size, "cells": cells(dice)},
            "bodies": {"ring": body(dice, E, "plane")},
            "obstacles": planes,
            "contacts": {"outside": {"surface": "ring.outer", "against": ["floor", "lid"], "friction": {"law": "coulomb", "mu": mu}}},
            "probes": {"inside": {"point": [0.9, 0.0]}},
            "steps": steps(dice, knots),
        },
        finer=1.5,
    )  # fmt: skip


def cylinders(dice: Dice) -> Drawn:
    shape = _dome(dice, "cylinders") | {"lower_radius": dice.one_of(1.0, 1.5, 3.0)}
    shape["lower_mesh_size"] = shape["mesh_size"] * dice.between(0.8, 1.4)
    sides = ("upper.arc", "lower.arc", "upper.top", "lower.base")
    return Drawn(
        name="", tables=joined(dice, shape, sides, 1.0, dice.between(0.02, 0.05), plane(dice), (0.1, 0.2), slip=0.5)
    )


def punch(dice: Dice, model: str = "") -> Drawn:
    """A large block under a flat punch, whose edges it cannot bear, or under a roller."""
    E, knots, axial = modulus(dice), history(dice), model == "axisymmetric"
    flat, strain = dice.one_of(True, False), dice.between(0.01, 0.03)
    shape = {"builder": "half_space", "size": 8.0, "contact_half_width": 1.0, "mesh_size": 2.0,
             "contact_mesh_size": dice.between(0.12, 0.2), "symmetric": axial}  # fmt: skip
    down, round_one = 2.0 * strain if flat else strain, "sphere" if axial else "cylinder"
    moved = {"y": pressing(knots, -down)} | ({} if axial else {"x": aside(knots, dice.between(0.2, 0.6) * down)})
    radius = dice.between(4, 8)
    tip = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, -1.0]} if flat else {
        "shape": round_one, "center" if axial else "point": [0.0, radius], "radius": radius}  # fmt: skip
    supports = {"axis": {"boundary": "half_space.axis", "displacement": {"x": 0.0}}} if axial else {}
    return Drawn(
        name="",
        tables={
            "model": model or plane(dice),
            "geometry": shape,
            "bodies": {"half_space": body(dice, E, model)},
            "obstacles": {"punch": tip | {"displacement": moved}},
            "contacts": {"face": {"surface": "half_space.contact", "against": "punch", **laws(dice, E, strain, 0.3 * down)}},
            "supports": {"bottom": {"boundary": "half_space.bottom", "displacement": {"x": 0.0, "y": 0.0}}, **supports},
            "probes": {"inside": {"point": [0.3, -0.5]}},
            "steps": steps(dice, knots),
        },
    )  # fmt: skip


def shaft_in_ring(dice: Dice) -> Drawn:
    """A rigid shaft, too large or too small, pushed off centre and turned."""
    E, knots, inner = modulus(dice), history(dice), 1.0
    over = dice.one_of(1, -1) * dice.between(0.002, 0.01)
    down = dice.between(0.5, 1) * abs(over) + 2 * max(-over, 0.0)
    return Drawn(
        name="",
        tables={
            "model": plane(dice),
            "geometry": {"builder": "ring", "inner_radius": inner, "outer_radius": dice.between(1.4, 2),
                         "mesh_size": dice.between(0.15, 0.25), "contact_mesh_size": dice.between(0.08, 0.12), "cells": cells(dice)},
            "bodies": {"ring": body(dice, E, "plane")},
            "obstacles": {"shaft": {"shape": "cylinder", "point": [0.0, 0.0], "radius": inner + over,
                                    "displacement": {"y": pressing(knots, -down)},
                                    "rotation": {"point": [0.0, 0.0], "angle": aside(knots, down)}}},
            "contacts": {"bore": {"surface": "ring.inner", "against": "shaft", **laws(dice, E, abs(over), 0.3 * down)}},
            "supports": {"housing": {"boundary": "ring.outer", "displacement": {"x": 0.0, "y": 0.0}}},
            "probes": {"inside": {"point": [0.0, -1.2]}},
            "steps": steps(dice, knots),
        },
    )  # fmt: skip


def heated_ring(dice: Dice) -> Drawn:
    """A quarter of a ring in a rigid bore, heated, its hole under pressure."""
    E, size = modulus(dice), dice.between(0.2, 0.4)
    hot = {"expansion": 1e-5, "temperature": dice.one_of(100.0, "100*(1 + 0.5*x)", [[0, 0], [1, 100.0], [2, 40.0]])}
    load = {"hole": {"boundary": "ring.inner", "pressure": E * dice.between(0, 2e-3)}}
    return Drawn(
        name="",
        tables={
            "model": plane(dice),
            "geometry": {"builder": "ring", "inner_radius": 1.0, "outer_radius": 2.0, "angle": 90, "mesh_size": size,
                         "cells": cells(dice)},
            "bodies": {"ring": {"E": E, "nu": dice.between(0, 0.49)}},
            "obstacles": {"bore": {"shape": "cylinder", "point": [0.0, 0.0], "radius": 2.0 + dice.one_of(0.0, 2e-4), "inside": True}},
            "contacts": {"fit": {"surface": "ring.outer", "against": "bore", **laws(dice, E, 1e-3, 1e-3)}},
            "supports": {"x": {"boundary": "ring.x_axis", "displacement": {"y": 0.0}},
                         "y": {"boundary": "ring.y_axis", "displacement": {"x": 0.0}}},
            "thermal": {"ring": hot},
            "loads": load,
            "probes": {"inside": {"point": [1.1, 0.9]}},
            "steps": {"end": 2.0, "count": dice.one_of(2, 4)},
        },
    )  # fmt: skip


def rings(dice: Dice) -> Drawn:
    """Rings with interference or clearance, the inner one moved; a quarter if it moves along an axis alone."""
    E, knots, over = modulus(dice), history(dice), dice.one_of(1, -1) * dice.between(5e-4, 3e-3)
    quarter = over < 0
    shape = {"builder": "rings", "inner_radius": 0.4, "radius": 1.0, "outer_radius": dice.between(2, 3), "interference": over,
             "mesh_size": dice.between(0.2, 0.35), "cells": cells(dice), "angle": 90 if quarter else 360}  # fmt: skip
    shape |= {"inner_mesh_size": dice.between(0.15, 0.3)} if dice.one_of(True, False) else {}
    down = (1.5 - np.sign(over)) * abs(over) * dice.between(0.5, 2)
    supports: Tables = {"rim": {"boundary": "outer.outside", "displacement": {"x": 0.0, "y": 0.0}}}
    moved = {"y": pressing(knots, float(down))}
    if quarter:
        supports |= {f"axis_{k}": {"boundary": f"{k}.y_axis", "displacement": {"x": 0.0}} for k in ("inner", "outer")}
        supports |= {"pin": {"boundary": "inner.x_axis", "displacement": moved}}
    else:
        supports |= {
            "pin": {"boundary": "inner.inside", "displacement": moved | {"x": aside(knots, 0.5 * float(down))}}
        }
    return Drawn(
        name="",
        tables={
            "model": plane(dice),
            "geometry": shape,
            "bodies": {"inner": body(dice, E, "plane"), "outer": body(dice, E * dice.one_of(0.3, 1.0), "plane")},
            "contacts": {"fit": {"surface": "outer.inside", "against": "inner.outside", **laws(dice, E, abs(over), abs(over))}},
            "supports": supports,
            "probes": {"inside": {"point": [0.5, 1.2]}},
            "steps": steps(dice, knots),
        },
    )  # fmt: skip


def wedge(dice: Dice) -> Drawn:
    """A wedge between two planes, pressed by a force and let go in part."""
    angle, E, knots = dice.between(10, 35), modulus(dice), dice.one_of([(1, 1, 0)], [(1, 1, 0), (2, 0.3, 0)])
    normal = [float(np.cos(np.radians(angle))), float(np.sin(np.radians(angle)))]
    shape = {"builder": "wedge", "half_angle": angle, "bottom_width": dice.between(0.6, 1.2), "height": 1.0,
             "mesh_size": dice.between(0.15, 0.25), "cells": cells(dice)}  # fmt: skip
    sides = {"left": (-1, normal), "right": (1, [-normal[0], normal[1]])}
    force = E * dice.between(0.01, 0.05)
    return Drawn(
        name="",
        tables={
            "model": plane(dice),
            "geometry": shape,
            "bodies": {"wedge": {"E": E, "nu": dice.between(0, 0.49)}},
            "obstacles": {side: {"shape": "plane", "point": [sign * shape["bottom_width"] / 2, 0.0], "normal": n}
                          for side, (sign, n) in sides.items()},
            "contacts": {side: {"surface": f"wedge.{side}", "against": side, "friction": {"law": "coulomb", "mu": dice.between(0.1, 0.5)}}
                         for side in sides},
            "loads": {"top": {"boundary": "wedge.top", "force": [0.0, pressing(knots, -force)]}},
            "probes": {"inside": {"point": [0.0, 0.3]}},
            "steps": steps(dice, knots),
        },
    )  # fmt: skip


def heated_block(dice: Dice) -> Drawn:
    """Two blocks of different expansion, pressed and heated: their interface slips from the ends."""
    found = two_blocks(dice)
    knots = [(1, 1, 0), (2, 1, 0)]
    E = max(table.get("E", table.get("E_1")) for table in found.tables["bodies"].values())
    top = found.tables["supports"].pop("top")["boundary"]
    hot = [[0, 0], [1, 0], [2, dice.between(100, 300)], *([[3, 50.0]] if dice.one_of(True, False) else [])]
    found.tables["thermal"] = {"upper": {"expansion": 2e-5, "temperature": hot}}
    found.tables["loads"] = {"top": {"boundary": top, "pressure": pressing(knots, E * dice.between(1e-3, 4e-3))}}
    mu = dice.between(0.3, 0.6)
    found.tables["contacts"]["base"] = {
        "surface": "upper.bottom",
        "against": "lower.top",
        "friction": {"law": "coulomb", "mu": mu},
    }
    found.tables["steps"] = {"end": float(hot[-1][0]), "count": dice.one_of(1, 2) * int(hot[-1][0])}
    return found


def tied(dice: Dice) -> Drawn:
    """Two blocks tied where their meshes do not match, or bilateral with given friction."""
    found = two_blocks(dice)
    law = dice.one_of("tied", "bilateral")
    contact = found.tables["contacts"]["base"]
    contact |= {"normal": {"law": law}}
    contact.pop("friction", None)
    if law == "bilateral":
        E = found.tables["bodies"]["upper"].get("E", found.tables["bodies"]["upper"].get("E_1"))
        contact["friction"] = {"law": "tresca", "bound": E * dice.between(5e-4, 3e-3)}
    return found


def notched(dice: Dice) -> Drawn:
    """A block with a round notch in its left side, or with round lower corners."""
    r, E = dice.between(0.15, 0.25), 0.0
    notch = dice.one_of(True, False)
    if notch:
        y = 0.5
        points = [(0, 0), (2, 0), (2, 1), (0, 1), (0, y + r), (r, y), (0, y - r), (0, y)]
        lines = "Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 5};\n"
        lines += "Circle(5) = {5, 8, 6}; Circle(6) = {6, 8, 7}; Line(7) = {7, 1};\nCurve Loop(1) = {1:7};\n"
        names = {"bottom": "1", "right": "2", "top": "3", "notch": "5, 6"}
    else:
        points = [(r, 0), (2 - r, 0), (2, r), (2, 1), (0, 1), (0, r), (2 - r, r), (r, r)]
        lines = "Line(1) = {1, 2}; Circle(2) = {2, 7, 3}; Line(3) = {3, 4}; Line(4) = {4, 5}; Line(5) = {5, 6};\n"
        lines += "Circle(6) = {6, 8, 1};\nCurve Loop(1) = {1:6};\n"
        names = {"bottom": "1, 2, 6", "right": "3", "top": "4"}
    outline = outlined(points, lines + 'Plane Surface(1) = {1};\nPhysical Surface("block") = {1};\n', names, "block")
    shape = {"file": "shape.geo", "mesh_size": dice.between(0.15, 0.25), "contact_mesh_size": dice.between(0.08, 0.14)}
    tables = on_plane(
        dice, shape, "block.bottom", "block.top", 1.0, dice.between(0.005, 0.02), plane(dice), probe=(r + 0.1, 0.5)
    )
    return Drawn(name="", tables=tables, outline=outline)


def outlined(points: Sequence[tuple[float, float]], lines: str, sides: Mapping[str, str], body: str = "") -> str:
    """Text of a .geo file."""
    text = 'SetFactory("OpenCASCADE");\n'
    text += "".join(f"Point({k}) = {{{x!r}, {y!r}, 0}};\n" for k, (x, y) in enumerate(points, 1)) + lines
    kind = "Curve" if body else "Surface"
    return text + "".join(
        f'Physical {kind}("{body and body + "."}{side}") = {{{tags}}};\n' for side, tags in sides.items()
    )


def ball(dice: Dice) -> Drawn:
    """A ball on a plane, in its meridian plane."""
    shape = _dome(dice, "half_disc") | {"symmetric": True}
    axis = {"axis": {"boundary": "disc.axis", "displacement": {"x": 0.0}}}
    tables = on_plane(dice, shape, "disc.arc", "disc.top", 1.0, dice.between(0.02, 0.05), "axisymmetric", probe=(0.1, 0.2),
                      supports=axis, slip=0.0)  # fmt: skip
    return Drawn(name="", tables=tables)


def axial_punch(dice: Dice) -> Drawn:
    return punch(dice, "axisymmetric")


def pressed_hub(dice: Dice) -> Drawn:
    """A hub on a longer shaft, with interference, in their meridian plane; the shaft is then pushed along."""
    radius, hub, E, knots = (
        dice.between(0.4, 0.8),
        dice.between(0.5, 1),
        modulus(dice),
        dice.one_of([(1, 1, 0)], [(1, 1, 0), (2, 1, 1)]),
    )
    over = dice.between(5e-4, 2e-3)
    text = f"""SetFactory("OpenCASCADE");
Rectangle(1) = {{0, -0.5, 0, {radius}, 2}};
Rectangle(2) = {{{radius}, 0, 0, {hub}, 1}};
Physical Surface("shaft") = {{1}}; Physical Surface("hub") = {{2}};
Physical Curve("shaft.seat") = {{2}}; Physical Curve("shaft.axis") = {{4}}; Physical Curve("shaft.end") = {{1}};
Physical Curve("hub.bore") = {{8}}; Physical Curve("hub.foot") = {{5}};
"""
    return Drawn(
        name="",
        tables={
            "model": "axisymmetric",
            "geometry": {"file": "shape.geo", "mesh_size": dice.between(0.12, 0.2), "contact_mesh_size": dice.between(0.06, 0.1)},
            "bodies": {"shaft": {"E": E, "nu": 0.3}, "hub": {"E": E * dice.one_of(0.4, 1.0), "nu": dice.between(0.2, 0.4)}},
            "contacts": {"fit": {"surface": "hub.bore", "against": "shaft.seat", "gap": -over, "friction": {"law": "coulomb", "mu": dice.between(0.1, 0.3)}}},
            "supports": {"axis": {"boundary": "shaft.axis", "displacement": {"x": 0.0}},
                         "end": {"boundary": "shaft.end", "displacement": {"y": aside(knots, dice.between(0.2, 0.6) * over) if len(knots) > 1 else 0.0}},
                         "foot": {"boundary": "hub.foot", "displacement": {"y": 0.0}}},
            "probes": {"inside": {"point": [radius + 0.1, 0.3]}},
            "steps": steps(dice, knots),
        },
        outline=text,
    )  # fmt: skip


def cube(dice: Dice) -> Drawn:
    shape = {"builder": "block", "length": 1.0, "width": dice.between(0.8, 1.2), "height": dice.between(0.6, 1),
             "mesh_size": dice.between(0.2, 0.34), "cells": cells(dice)}  # fmt: skip
    tables = on_plane(
        dice, shape, "block.bottom", "block.top", 1.0, dice.between(0.005, 0.03), "3d", probe=(0.4, 0.4, 0.3)
    )
    return Drawn(name="", tables=tables)


def turntable(dice: Dice) -> Drawn:
    """A slab on a table that turns: slip has another direction at every node."""
    found = cube(dice).tables
    found["geometry"]["height"] = 0.4
    found["supports"]["top"]["displacement"] = {"x": 0.0, "y": 0.0, "z": [[0.0, 0.0], [1.0, -4e-3]]}
    turn = {
        "angle": [[0.0, 0.0], [1.0, 0.0], [2.0, dice.between(2e-3, 8e-3)]],
        "point": [0.5, 0.4, 0.0],
        "axis": [0.0, 0.0, 1.0],
    }
    found["obstacles"]["ground"]["rotation"] = turn
    found["probes"]["inside"]["point"] = [0.4, 0.4, 0.2]
    found["contacts"]["base"] = {
        "surface": "block.bottom",
        "against": "ground",
        "friction": {"law": "coulomb", "mu": dice.between(0.2, 0.5)},
    }
    found["steps"] = {"end": 2.0, "count": dice.one_of(2, 4)}
    return Drawn(name="", tables=found)


def blocks_3d(dice: Dice) -> Drawn:
    shape = {"builder": "two_blocks", "length": 1.0, "width": 0.8, "height": 0.5, "lower_height": 0.4,
             "lower_length": dice.one_of(1.0, 1.4), "mesh_size": dice.between(0.22, 0.34), "cells": cells(dice)}  # fmt: skip
    shape["lower_mesh_size"] = shape["mesh_size"] * dice.between(0.8, 1.3)
    sides = ("upper.bottom", "lower.top", "upper.top", "lower.bottom")
    return Drawn(name="", tables=joined(dice, shape, sides, 0.9, dice.between(0.003, 0.02), "3d", (0.4, 0.4, 0.2)))


def half_ball(dice: Dice) -> Drawn:
    """A quarter of half a ball, of tetrahedra."""
    shape = {"builder": "half_ball", "radius": 1.0, "symmetry": "quarter", "mesh_size": dice.between(0.35, 0.5),
             "contact_mesh_size": dice.between(0.07, 0.1), "contact_radius": 0.25}  # fmt: skip
    held = {k: {"boundary": f"ball.{k}_plane", "displacement": {k: 0.0}} for k in "xy"}
    tables = on_plane(dice, shape, "ball.cap", "ball.top", 1.0, dice.between(0.03, 0.05), "3d", probe=(0.1, 0.1, 0.3),
                      supports=held, slip=0.0)  # fmt: skip
    return Drawn(name="", tables=tables)


def hub_3d(dice: Dice) -> Drawn:
    """A quarter of a hub on a quarter of a shaft, of tetrahedra: a press fit on a curved side."""
    E, over, radii = modulus(dice), dice.between(5e-4, 2e-3), (0.3, 1.0, dice.between(1.6, 2))
    text = 'SetFactory("OpenCASCADE");\nPoint(1) = {0, 0, 0};\n'
    for n, low, high in ((10, *radii[:2]), (20, *radii[1:])):
        points = ((low, 0), (high, 0), (0, high), (0, low))
        text += "".join(f"Point({n + k}) = {{{x}, {y}, 0}};\n" for k, (x, y) in enumerate(points))
        text += f"Line({n}) = {{{n}, {n + 1}}}; Circle({n + 1}) = {{{n + 1}, 1, {n + 2}}};\n"
        text += f"Line({n + 2}) = {{{n + 2}, {n + 3}}}; Circle({n + 3}) = {{{n + 3}, 1, {n}}};\n"
        text += f"Curve Loop({n}) = {{{n}:{n + 3}}}; Plane Surface({n}) = {{{n}}};\n"
    for n, name in ((10, "shaft"), (20, "hub")):
        text += f'o[] = Extrude {{0, 0, 0.5}} {{ Surface{{{n}}}; }};\nPhysical Volume("{name}") = {{o[1]}};\n'
        sides = {"bottom": n, "top": "o[0]", "front": "o[2]", "outside": "o[3]", "left": "o[4]", "inside": "o[5]"}
        text += "".join(f'Physical Surface("{name}.{side}") = {{{tag}}};\n' for side, tag in sides.items())
    planes = {"front": "y", "left": "x", "bottom": "z"} | dice.one_of({"top": "z"}, {})
    tables = {
        "model": "3d",
        "geometry": {"file": "shape.geo", "mesh_size": dice.between(0.3, 0.4)},
        "bodies": {
            "shaft": {"E": E, "nu": 0.3},
            "hub": {"E": E * dice.one_of(0.5, 1.0), "nu": dice.between(0.2, 0.35)},
        },
        "contacts": {"fit": {"surface": "hub.inside", "against": "shaft.outside", "gap": -over}},
        "supports": {
            f"{name}_{side}": {"boundary": f"{name}.{side}", "displacement": {axis: 0.0}}
            for name in ("shaft", "hub")
            for side, axis in planes.items()
        },
        "probes": {"inside": {"point": [0.9, 0.9, 0.25]}},
    }
    return Drawn(name="", tables=tables, outline=text)


FAMILIES: Mapping[str, Callable[[Dice], Drawn]] = {
    family.__name__: family
    for family in (
        block, mesh_file, floating, stack, receding, two_blocks, block_on_waves, half_disc, one_node, ring_between_planes,
        cylinders, punch, shaft_in_ring, heated_ring, rings, wedge, heated_block, tied, notched, ball, axial_punch,
        pressed_hub, cube, turntable, blocks_3d, half_ball, hub_3d,
    )
}  # fmt: skip
