"""Families that scenes are drawn from: a shape that is pressed, pushed or heated, and all the rest left to chance.

Sizes, meshes, materials, laws, histories are drawn; lengths are about 1 m. Each family is a function of random numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import pi
from typing import Any, TypeVar

import numpy as np

from stickslip.workflows.lab.verification.hard.tables import Tables

T = TypeVar("T")
Knots = Sequence[tuple[float, float, float]]  # time, share of the pressing, share of the push aside
FLOOR = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
FLOOR_3D = {"shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
OCC = 'SetFactory("OpenCASCADE");\n'


class Dice:
    """Random numbers of three digits, so that scene files can be read."""

    def __init__(self, *seed: int) -> None:
        self._random = np.random.default_rng(seed)

    def between(self, low: float, high: float) -> float:
        return float(f"{self._random.uniform(low, high):.3g}")

    def one_of(self, *options: T) -> T:
        return options[int(self._random.integers(len(options)))]

    def mixed(self, number: int) -> list[int]:
        return [int(k) for k in self._random.permutation(number)]

    def chance(self, share: float) -> bool:
        return bool(self.between(0, 1) < share)


@dataclass(frozen=True)
class Member:
    """One scene of a family."""

    tables: Tables
    outline: str = ""  # text of the .geo file that the scene names
    meshed: bool = False  # whether the scene names a file of its mesh instead of a shape
    finer: float = 1.0  # times the usual fineness of the truth


def body(dice: Dice, E: float, model: str = "") -> Tables:
    """A material; one in ten plane bodies is orthotropic."""
    if model.startswith("plane") and dice.chance(0.1):
        angle, moduli = (
            dice.between(0, pi),
            {"E_1": E, "E_2": dice.between(0.1, 1) * E, "E_3": dice.between(0.1, 1) * E},
        )
        others = {"G_12": dice.between(0.1, 0.4) * E, "nu_12": 0.3, "nu_13": 0.3, "nu_23": 0.3}
        return moduli | others | {"axis_1": [float(np.cos(angle)), float(np.sin(angle))]}
    return {"E": E, "nu": dice.one_of(0.0, 0.2, 0.3, 0.3, 0.35, 0.45, 0.49)}


def coulomb(dice: Dice) -> Tables:
    return {"friction": {"law": "coulomb", "mu": dice.between(0.1, 0.6)}}


def laws(dice: Dice, p: float, travel: float) -> Tables:
    """Laws of a contact where pressures are about p [Pa] and slips about the travel [m]."""
    mu = dice.between(0.1, 0.6)
    friction = dice.one_of(
        *[{"law": "coulomb", "mu": mu}] * 5,
        {"law": "coulomb", "mu": mu, "k_T": dice.between(2, 20) * p / travel},
        {"law": "capped_coulomb", "mu": mu, "s_max": dice.between(0.5, 1.2) * mu * p},
        {"law": "cohesion", "a": dice.between(0.05, 0.2) * mu * p, "mu": mu},
        {"law": "static_kinetic", "mu_s": mu, "mu_k": dice.between(0.6, 0.9) * mu, "slip_length": travel},
        {"law": "slip_dependent", "mu": [[0.0, mu], [travel, dice.between(1, 1.5) * mu]]},
        {"law": "pressure_dependent", "mu": [[0.0, mu], [2 * p, dice.between(0.6, 1) * mu]]},
        *[None] * 2,
    )
    found: Tables = {"friction": friction} if friction else {}
    if dice.chance(0.15):
        found["normal"] = {"law": "compliance", "c_n": dice.between(5, 50) * p / travel, "m_n": dice.one_of(1.0, 1.5)}
    return found


def history(dice: Dice) -> Knots:
    """Pressed; then pushed aside, or to and fro, or let go; or both at once."""
    return dice.one_of(
        [(1, 1, 0)],
        [(1, 1, 1)],
        *[[(1, 1, 0), (2, 1, 1)]] * 2,
        [(1, 1, 0), (2, 1, 1), (3, 1, dice.between(-1, 0.5))],
        [(1, 1, 0), (2, dice.between(0.2, 0.8), 0)],
        [(1, 1, 0), (2, dice.between(0.5, 1.3), 1)],
    )


def pressing(knots: Knots, amount: float) -> list[list[float]]:
    return [[0.0, 0.0], *([float(t), share * amount] for t, share, _ in knots)]


def aside(knots: Knots, amount: float) -> list[list[float]]:
    return [[0.0, 0.0], *([float(t), share * amount] for t, _, share in knots)]


def steps(dice: Dice, end: float, most: int = 3) -> Tables:
    return {"end": float(end), "count": int(end) * dice.one_of(1, 2, most)}


def modulus(dice: Dice) -> float:
    return dice.one_of(1.0, 100.0, 7e4, 2.1e11)


def plane(dice: Dice) -> str:
    return dice.one_of("plane strain", "plane stress")


def cells(dice: Dice) -> str:
    return dice.one_of("simplex", "simplex", "tensor")


def inside(*point: float) -> Tables:
    return {"inside": {"point": list(point)}}


def pressed(dice: Dice, model: str, shape: Tables, slave: str, top: str, strain: float, push: float = 1.0) -> Tables:
    """One body whose moved top presses it on a plane.

    Args:
        strain: way of the top [m], and about the strain of the body.
        push: largest way aside over that; 0: straight down.
    """
    E, knots, name, flat = modulus(dice), history(dice), slave.partition(".")[0], model != "3d"
    moved: Tables = {"y" if flat else "z": pressing(knots, -strain)}
    if push:
        moved |= {} if flat else {"y": 0.0}  # without friction nothing else holds it
        moved |= {
            axis: aside(knots, dice.between(0.15, 0.9) * push * strain)
            for axis in dice.one_of("x", "x" if flat else "xy")
        }
    return {
        "model": model,
        "geometry": shape,
        "bodies": {name: body(dice, E, model)},
        "obstacles": {"ground": FLOOR if flat else FLOOR_3D},
        "contacts": {"base": {"surface": slave, "against": "ground", **laws(dice, E * strain, 0.3 * strain)}},
        "supports": {"top": {"boundary": top, "displacement": moved}},
        "steps": steps(dice, knots[-1][0], 3 if flat else 2),
    }  # fmt: skip


def joined(dice: Dice, model: str, shape: Tables, sides: Sequence[str], strain: float, push: float = 1.0) -> Tables:
    """Two bodies, the upper one pressed on the lower one by its top.

    Args:
        sides: of the contact, of the upper and the lower body; then those that are moved and held.
    """
    upper, lower, top, base = sides
    found = pressed(dice, model, shape, upper, top, strain, push)
    del found["obstacles"]
    found["contacts"]["base"]["against"] = lower
    found["bodies"]["lower"] = body(dice, stiffness(found) * dice.one_of(0.2, 1.0, 1.0, 5.0), model)
    found["supports"]["base"] = {"boundary": base, "displacement": dict.fromkeys("xyz" if model == "3d" else "xy", 0.0)}
    return found


def stiffness(tables: Tables) -> float:
    """Young's modulus of the first body."""
    of = next(iter(tables["bodies"].values()))
    return float(of.get("E") or of["E_1"])


def _box(dice: Dice) -> Tables:
    height = dice.between(0.5, 1)
    size = height / dice.between(3, 6)
    fine = {"contact_mesh_size": 0.5 * size} if dice.chance(0.5) else {}
    return {
        "builder": "block",
        "length": dice.between(1, 3),
        "height": height,
        "mesh_size": size,
        "cells": cells(dice),
        **fine,
    }


def block(dice: Dice) -> Member:
    tables = pressed(dice, plane(dice), _box(dice), "block.bottom", "block.top", dice.between(0.002, 0.02))
    return Member(tables | {"probes": inside(0.4, 0.25)})


def mesh_file(dice: Dice) -> Member:
    """A block, two blocks or a wedge whose mesh is read from a file."""
    return Member(dice.one_of(block, two_blocks, wedge)(dice).tables, meshed=True)


def floating(dice: Dice) -> Member:
    """A block that loads press, the more so at one end, and that friction alone holds."""
    shape, E, knots, friction = _box(dice), modulus(dice), history(dice), coulomb(dice)
    p, length = E * dice.between(0.003, 0.03), shape["length"]
    push = 0.2 * friction["friction"]["mu"] * p * length / shape["height"] * dice.between(0.3, 1)
    load = f"-{p!r}*(1 + {dice.between(-0.5, 0.5)}*(2*x/{length!r} - 1))*min(t, 1)"
    return Member({
        "model": plane(dice),
        "geometry": shape,
        "bodies": {"block": body(dice, E)},
        "obstacles": {"ground": FLOOR},
        "contacts": {"base": {"surface": "block.bottom", "against": "ground", **friction}},
        "loads": {
            "top": {"boundary": "block.top", "traction": ["0", load]},
            "side": {"boundary": "block.right", "traction": [aside(knots, push), 0.0]},
        },
        "probes": inside(0.4, 0.25),
        "steps": steps(dice, knots[-1][0]),
    })  # fmt: skip


def stack(dice: Dice) -> Member:
    """Blocks that stand on each other by their weight, then are tilted."""
    count, height, friction, E = dice.one_of(2, 3), dice.between(0.3, 0.6), coulomb(dice), dice.one_of(1e6, 1e7)
    names = [f"block_{k + 1}" for k in range(count)]
    partners = ["floor", *(f"{name}.top" for name in names)]
    tilt = [[0.0, 0.0], [1.0, 0.0], [2.0, 9.81 * friction["friction"]["mu"] * dice.between(0.2, 0.8)]]
    shape = {"builder": "stack", "count": count, "length": 1.0, "height": height, "cells": cells(dice)}
    return Member({
        "model": "plane strain",
        "geometry": shape | {"mesh_size": height / dice.one_of(2, 3), "mesh_ratio": dice.between(0.6, 1.5)},
        "bodies": {name: body(dice, E * dice.one_of(1, 1, 3)) | {"density": 2000.0} for name in names},
        "obstacles": {"floor": FLOOR},
        "contacts": {
            f"joint_{k + 1}": {"surface": f"{name}.bottom", "against": partners[k], **friction}
            for k, name in enumerate(names)
        },
        "gravity": {"acceleration": [tilt, [[0.0, 0.0], [1.0, -9.81]]]},
        "probes": inside(0.3, 0.4 * height),
        "steps": steps(dice, 2, 2),
    })  # fmt: skip


def receding(dice: Dice) -> Member:
    """Half a strip that a load on its middle presses, so that its end lifts."""
    height, E = dice.between(0.3, 0.6), modulus(dice)
    length, p = height * dice.between(3, 5), E * dice.between(0.003, 0.02)
    friction = coulomb(dice) if dice.chance(0.5) else {}
    load = f"-{p!r}*exp(-(x/{dice.between(0.3, 1) * height!r})**2)*min(t, 1)"
    sizes = {"mesh_size": height / dice.between(2, 4), "contact_mesh_size": height / dice.between(4, 6)}
    return Member({
        "model": plane(dice),
        "geometry": {"builder": "block", "length": length, "height": height, **sizes},
        "bodies": {"block": body(dice, E)},
        "obstacles": {"ground": FLOOR},
        "contacts": {"base": {"surface": "block.bottom", "against": "ground", **friction}},
        "loads": {"top": {"boundary": "block.top", "traction": ["0", load]}},
        "supports": {"middle": {"boundary": "block.left", "displacement": {"x": 0.0}}},
        "probes": inside(0.1 * length, 0.5 * height),
        "steps": steps(dice, 1),
    })  # fmt: skip


def two_blocks(dice: Dice) -> Member:
    """Blocks whose meshes do not match, one of them longer or not."""
    length, height, size = dice.between(1, 2), dice.between(0.4, 0.8), dice.between(0.1, 0.2)
    shape = {"builder": "two_blocks", "length": length, "height": height, "lower_height": dice.between(0.4, 0.8),
             "lower_length": length * dice.one_of(1.0, 1.6), "mesh_size": size, "cells": cells(dice),
             "lower_mesh_size": size * dice.between(0.7, 1.4)}  # fmt: skip
    sides = ("upper.bottom", "lower.top", "upper.top", "lower.bottom")
    return Member(joined(dice, plane(dice), shape, sides, dice.between(0.003, 0.02)) | {"probes": inside(0.4, 0.2)})


def heated_blocks(dice: Dice) -> Member:
    """Two blocks, pressed, then one is heated: their interface slips from the ends."""
    found = two_blocks(dice).tables
    top = found["supports"].pop("top")["boundary"]
    heat = [[0.0, 0.0], [1.0, 0.0], [2.0, dice.between(100, 300)], *dice.one_of([[3.0, 50.0]], [])]
    p = stiffness(found) * dice.between(1e-3, 4e-3)
    contact = {"surface": "upper.bottom", "against": "lower.top", **coulomb(dice)}
    return Member(found | {
        "contacts": {"base": contact},
        "thermal": {"upper": {"expansion": 2e-5, "temperature": heat}},
        "loads": {"top": {"boundary": top, "pressure": [[0.0, 0.0], [1.0, p]]}},
        "steps": steps(dice, heat[-1][0], 2),
    })  # fmt: skip


def tied(dice: Dice) -> Member:
    """Two blocks tied where their meshes do not match, or bilateral with a given bound of friction."""
    found = two_blocks(dice).tables
    bound = {"law": "tresca", "bound": stiffness(found) * dice.between(5e-4, 3e-3)}
    law: Tables = {"normal": {"law": "bilateral"}, "friction": bound}
    law = {"normal": {"law": "tied"}} if dice.chance(0.5) else law
    return Member(found | {"contacts": {"base": {"surface": "upper.bottom", "against": "lower.top", **law}}})


def on_waves(dice: Dice) -> Member:
    """A block on a wavy foundation: contact spreads from the crests."""
    shape, strain = _box(dice), dice.between(0.005, 0.02)
    wave, crest = shape["length"] / dice.one_of(1, 2, 3), dice.between(0.2, 0.8) * strain
    shape["contact_mesh_size"] = min(wave / dice.between(10, 16), shape["mesh_size"])
    found = pressed(dice, plane(dice), shape, "block.bottom", "block.top", strain)
    ground = {"shape": "graph", "height": f"{crest!r}*(cos({2 * pi / wave!r}*x) - 1)"}
    return Member(found | {"obstacles": {"ground": ground}, "probes": inside(0.4, 0.25)})


def _dome(dice: Dice, builder: str, **more: Any) -> Tables:
    """Size 1; contact is about a sixth of it wide where it is pressed by 3 %."""
    sizes = {
        "mesh_size": dice.between(0.12, 0.2),
        "contact_mesh_size": dice.between(0.03, 0.05),
        "contact_radius": 0.25,
    }
    return {"builder": builder, "radius": 1.0, **sizes, **more}


def half_disc(dice: Dice) -> Member:
    found = pressed(dice, plane(dice), _dome(dice, "half_disc"), "disc.arc", "disc.top", dice.between(0.02, 0.04), 0.8)
    return Member(found | {"probes": inside(0.1, 0.2)})


def one_node(dice: Dice) -> Member:
    """A disc so coarse that one node touches, or two."""
    shape = {"builder": "half_disc", "radius": 1.0, "mesh_size": dice.between(0.15, 0.25)}
    found = pressed(dice, plane(dice), shape, "disc.arc", "disc.top", dice.between(0.005, 0.02))
    return Member(found | {"probes": inside(0.1, 0.4)}, finer=1.5)


def squeezed_ring(dice: Dice) -> Member:
    """A ring that two planes squeeze and drag; at first a node touches each."""
    knots, down, size = history(dice), dice.between(0.02, 0.08), dice.between(0.08, 0.15)
    moved = {"y": pressing(knots, -down), "x": aside(knots, dice.between(0.1, 0.5) * down)}
    shape = {"builder": "ring", "inner_radius": dice.between(0.6, 0.8), "outer_radius": 1.0, "cells": cells(dice),
             "mesh_size": size, "contact_mesh_size": dice.one_of(0.5, 1.0) * size}  # fmt: skip
    return Member({
        "model": plane(dice),
        "geometry": shape,
        "bodies": {"ring": body(dice, modulus(dice), "plane")},
        "obstacles": {
            "floor": {**FLOOR, "point": [0.0, -1.0]},
            "lid": {"shape": "plane", "point": [0.0, 1.0], "normal": [0.0, -1.0], "displacement": moved},
        },
        "contacts": {"outside": {"surface": "ring.outer", "against": ["floor", "lid"], **coulomb(dice)}},
        "probes": inside(0.9, 0.0),
        "steps": steps(dice, knots[-1][0]),
    })  # fmt: skip


def cylinders(dice: Dice) -> Member:
    shape = _dome(dice, "cylinders", lower_radius=dice.one_of(1.0, 1.5, 3.0))
    shape["lower_mesh_size"] = shape["mesh_size"] * dice.between(0.8, 1.4)
    sides = ("upper.arc", "lower.arc", "upper.top", "lower.base")
    return Member(joined(dice, plane(dice), shape, sides, dice.between(0.02, 0.05), 0.5) | {"probes": inside(0.1, 0.2)})


def punch(dice: Dice, model: str = "") -> Member:
    """A large block under a flat punch, whose edges it cannot bear, or under a roller or a ball."""
    E, knots, axial, strain = modulus(dice), history(dice), model == "axisymmetric", dice.between(0.01, 0.03)
    radius, flat = dice.between(4, 8), dice.chance(0.5)
    down = 2 * strain if flat else strain
    moved = {"y": pressing(knots, -down)} | ({} if axial else {"x": aside(knots, dice.between(0.2, 0.6) * down)})
    ball = {"shape": "sphere", "center": [0.0, radius]} if axial else {"shape": "cylinder", "point": [0.0, radius]}
    tip = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, -1.0]} if flat else ball | {"radius": radius}
    axis = {"axis": {"boundary": "half_space.axis", "displacement": {"x": 0.0}}} if axial else {}
    return Member({
        "model": model or plane(dice),
        "geometry": {"builder": "half_space", "size": 8.0, "contact_half_width": 1.0, "mesh_size": 2.0,
                     "contact_mesh_size": dice.between(0.12, 0.2), "symmetric": axial},
        "bodies": {"half_space": body(dice, E, model)},
        "obstacles": {"punch": tip | {"displacement": moved}},
        "contacts": {
            "face": {"surface": "half_space.contact", "against": "punch", **laws(dice, E * strain, 0.3 * down)}
        },
        "supports": {"bottom": {"boundary": "half_space.bottom", "displacement": {"x": 0.0, "y": 0.0}}, **axis},
        "probes": inside(0.3, -0.5),
        "steps": steps(dice, knots[-1][0]),
    })  # fmt: skip


def axial_punch(dice: Dice) -> Member:
    return punch(dice, "axisymmetric")


def shaft_in_ring(dice: Dice) -> Member:
    """A rigid shaft, too large or too small, pushed off centre and turned."""
    E, knots, over = modulus(dice), history(dice), dice.one_of(1, -1) * dice.between(0.002, 0.01)
    down = dice.between(0.5, 1) * abs(over) + 2 * max(-over, 0.0)
    turn = {"point": [0.0, 0.0], "angle": aside(knots, down)}
    return Member({
        "model": plane(dice),
        "geometry": {"builder": "ring", "inner_radius": 1.0, "outer_radius": dice.between(1.4, 2), "cells": cells(dice),
                     "mesh_size": dice.between(0.15, 0.25), "contact_mesh_size": dice.between(0.08, 0.12)},
        "bodies": {"ring": body(dice, E, "plane")},
        "obstacles": {"shaft": {"shape": "cylinder", "point": [0.0, 0.0], "radius": 1 + over, "rotation": turn,
                                "displacement": {"y": pressing(knots, -down)}}},
        "contacts": {"bore": {"surface": "ring.inner", "against": "shaft", **laws(dice, E * abs(over), 0.3 * down)}},
        "supports": {"housing": {"boundary": "ring.outer", "displacement": {"x": 0.0, "y": 0.0}}},
        "probes": inside(0.0, -1.2),
        "steps": steps(dice, knots[-1][0]),
    })  # fmt: skip


def heated_ring(dice: Dice) -> Member:
    """A quarter of a ring in a rigid bore, heated, its hole under pressure."""
    E, heat = modulus(dice), dice.one_of(100.0, "100*(1 + 0.5*x)", [[0.0, 0.0], [1.0, 100.0], [2.0, 40.0]])
    bore = {"shape": "cylinder", "point": [0.0, 0.0], "radius": 2.0 + dice.one_of(0.0, 2e-4), "inside": True}
    return Member({
        "model": plane(dice),
        "geometry": {"builder": "ring", "inner_radius": 1.0, "outer_radius": 2.0, "angle": 90, "cells": cells(dice),
                     "mesh_size": dice.between(0.2, 0.4)},
        "bodies": {"ring": body(dice, E)},
        "obstacles": {"bore": bore},
        "contacts": {"fit": {"surface": "ring.outer", "against": "bore", **laws(dice, 1e-3 * E, 1e-3)}},
        "supports": {"x": {"boundary": "ring.x_axis", "displacement": {"y": 0.0}},
                     "y": {"boundary": "ring.y_axis", "displacement": {"x": 0.0}}},
        "thermal": {"ring": {"expansion": 1e-5, "temperature": heat}},
        "loads": {"hole": {"boundary": "ring.inner", "pressure": E * dice.between(0, 2e-3)}},
        "probes": inside(1.1, 0.9),
        "steps": steps(dice, 2, 2),
    })  # fmt: skip


def rings(dice: Dice) -> Member:
    """Rings with interference, or a quarter of them with clearance, the inner one moved."""
    E, knots, over = modulus(dice), history(dice), dice.between(5e-4, 3e-3)
    loose, down, model = dice.chance(0.5), over * dice.between(0.2, 1), plane(dice)
    moved: Tables = {"y": pressing(knots, 3 * down)} if loose else {"y": pressing(knots, down), "x": aside(knots, down)}
    symmetry = {f"{k}_axis": {"boundary": f"{k}.y_axis", "displacement": {"x": 0.0}} for k in ("inner", "outer")}
    inner = {"inner_mesh_size": dice.between(0.15, 0.3)} if dice.chance(0.5) else {}
    return Member({
        "model": model,
        "geometry": {"builder": "rings", "inner_radius": 0.4, "radius": 1.0, "outer_radius": dice.between(2, 3),
                     "interference": -over if loose else over, "mesh_size": dice.between(0.2, 0.35), **inner,
                     "cells": cells(dice), "angle": 90 if loose else 360},
        "bodies": {"inner": body(dice, E, model), "outer": body(dice, E * dice.one_of(0.3, 1.0), model)},
        "contacts": {"fit": {"surface": "outer.inside", "against": "inner.outside", **laws(dice, E * over, over)}},
        "supports": {
            "rim": {"boundary": "outer.outside", "displacement": {"x": 0.0, "y": 0.0}},
            "pin": {"boundary": "inner.x_axis" if loose else "inner.inside", "displacement": moved},
            **(symmetry if loose else {}),
        },
        "probes": inside(0.5, 1.2),
        "steps": steps(dice, knots[-1][0]),
    })  # fmt: skip


def wedge(dice: Dice) -> Member:
    """A wedge between two planes, pressed by a force and let go in part."""
    angle, E, width = dice.between(10, 35), modulus(dice), dice.between(0.6, 1.2)
    knots: Knots = dice.one_of([(1, 1, 0)], [(1, 1, 0), (2, 0.3, 0)])
    normal = [float(np.cos(np.radians(angle))), float(np.sin(np.radians(angle)))]
    signs = {"left": 1, "right": -1}
    return Member({
        "model": plane(dice),
        "geometry": {"builder": "wedge", "half_angle": angle, "bottom_width": width, "height": 1.0,
                     "cells": cells(dice), "mesh_size": dice.between(0.15, 0.25)},
        "bodies": {"wedge": body(dice, E)},
        "obstacles": {
            side: {"shape": "plane", "point": [-sign * width / 2, 0.0], "normal": [sign * normal[0], normal[1]]}
            for side, sign in signs.items()
        },
        "contacts": {side: {"surface": f"wedge.{side}", "against": side, **coulomb(dice)} for side in signs},
        "loads": {"top": {"boundary": "wedge.top", "force": [0.0, pressing(knots, -E * dice.between(0.01, 0.05))]}},
        "probes": inside(0.0, 0.3),
        "steps": steps(dice, knots[-1][0]),
    })  # fmt: skip


def rounded(dice: Dice) -> Member:
    """A block with a round notch in its left side, or with round lower corners."""
    r = dice.between(0.15, 0.25)
    if dice.chance(0.5):
        points = [(0, 0), (2, 0), (2, 1), (0, 1), (0, 0.5 + r), (r, 0.5), (0, 0.5 - r), (0, 0.5)]
        lines = "Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 5};\n"
        lines += "Circle(5) = {5, 8, 6}; Circle(6) = {6, 8, 7}; Line(7) = {7, 1}; Curve Loop(1) = {1:7};\n"
        bottom, top = "1", "3"
    else:
        points = [(r, 0), (2 - r, 0), (2, r), (2, 1), (0, 1), (0, r), (2 - r, r), (r, r)]
        lines = "Line(1) = {1, 2}; Circle(2) = {2, 7, 3}; Line(3) = {3, 4}; Line(4) = {4, 5}; Line(5) = {5, 6};\n"
        lines += "Circle(6) = {6, 8, 1}; Curve Loop(1) = {1:6};\n"
        bottom, top = "1, 2, 6", "4"
    lines += (
        f'Plane Surface(1) = {{1}};\nPhysical Surface("block") = {{1}};\nPhysical Curve("block.top") = {{{top}}};\n'
    )
    lines += f'Physical Curve("block.bottom") = {{{bottom}}};\n'
    shape = {"file": "shape.geo", "mesh_size": dice.between(0.15, 0.25), "contact_mesh_size": dice.between(0.08, 0.14)}
    found = pressed(dice, plane(dice), shape, "block.bottom", "block.top", dice.between(0.005, 0.02))
    return Member(found | {"probes": inside(r + 0.1, 0.5)}, OCC + _points(points) + lines)


def _points(points: Sequence[tuple[float, float]], first: int = 1) -> str:
    return "".join(f"Point({k}) = {{{x}, {y}, 0}};\n" for k, (x, y) in enumerate(points, first))


def ball(dice: Dice) -> Member:
    """A ball on a plane, in its meridian plane."""
    shape = _dome(dice, "half_disc", symmetric=True)
    found = pressed(dice, "axisymmetric", shape, "disc.arc", "disc.top", dice.between(0.02, 0.05), 0.0)
    found["supports"]["axis"] = {"boundary": "disc.axis", "displacement": {"x": 0.0}}
    return Member(found | {"probes": inside(0.1, 0.2)})


def pressed_hub(dice: Dice) -> Member:
    """A hub on a longer shaft, with interference, in their meridian plane; the shaft is then pushed along, or not."""
    radius, E, over, size = dice.between(0.4, 0.8), modulus(dice), dice.between(5e-4, 2e-3), dice.between(0.12, 0.2)
    knots: Knots = dice.one_of([(1, 1, 0)], [(1, 1, 0), (2, 1, 1)])
    text = f"""Rectangle(1) = {{0, -0.5, 0, {radius}, 2}};
Rectangle(2) = {{{radius}, 0, 0, {dice.between(0.5, 1)}, 1}};
Physical Surface("shaft") = {{1}}; Physical Surface("hub") = {{2}};
Physical Curve("shaft.seat") = {{2}}; Physical Curve("shaft.axis") = {{4}}; Physical Curve("shaft.end") = {{1}};
Physical Curve("hub.bore") = {{8}}; Physical Curve("hub.foot") = {{5}};
"""
    return Member({
        "model": "axisymmetric",
        "geometry": {"file": "shape.geo", "mesh_size": size, "contact_mesh_size": 0.5 * size},
        "bodies": {"shaft": body(dice, E), "hub": body(dice, E * dice.one_of(0.4, 1.0))},
        "contacts": {"fit": {"surface": "hub.bore", "against": "shaft.seat", "gap": -over, **coulomb(dice)}},
        "supports": {
            "axis": {"boundary": "shaft.axis", "displacement": {"x": 0.0}},
            "end": {"boundary": "shaft.end", "displacement": {"y": aside(knots, dice.between(0.2, 0.6) * over)}},
            "foot": {"boundary": "hub.foot", "displacement": {"y": 0.0}},
        },
        "probes": inside(radius + 0.1, 0.3),
        "steps": steps(dice, knots[-1][0]),
    }, OCC + text)  # fmt: skip


def cube(dice: Dice) -> Member:
    shape = {"builder": "block", "length": 1.0, "width": dice.between(0.8, 1.2), "height": dice.between(0.6, 1),
             "mesh_size": dice.between(0.2, 0.34), "cells": cells(dice)}  # fmt: skip
    found = pressed(dice, "3d", shape, "block.bottom", "block.top", dice.between(0.005, 0.03))
    return Member(found | {"probes": inside(0.4, 0.4, 0.3)})


def turntable(dice: Dice) -> Member:
    """A slab on a table that turns: slip has another direction at every node."""
    found = cube(dice).tables
    turn = {
        "angle": aside([(1, 1, 0), (2, 1, 1)], dice.between(2e-3, 8e-3)),
        "point": [0.5, 0.4, 0.0],
        "axis": [0.0, 0.0, 1.0],
    }
    moved = {"x": 0.0, "y": 0.0, "z": [[0.0, 0.0], [1.0, -4e-3]]}
    return Member(found | {
        "geometry": found["geometry"] | {"height": 0.4},
        "obstacles": {"ground": FLOOR_3D | {"rotation": turn}},
        "contacts": {"base": {"surface": "block.bottom", "against": "ground", **coulomb(dice)}},
        "supports": {"top": {"boundary": "block.top", "displacement": moved}},
        "probes": inside(0.4, 0.4, 0.2),
        "steps": steps(dice, 2, 2),
    })  # fmt: skip


def blocks_3d(dice: Dice) -> Member:
    size = dice.between(0.22, 0.34)
    shape = {"builder": "two_blocks", "length": 1.0, "width": 0.8, "height": 0.5, "lower_height": 0.4,
             "lower_length": dice.one_of(1.0, 1.4), "mesh_size": size, "lower_mesh_size": size * dice.between(0.8, 1.3),
             "cells": cells(dice)}  # fmt: skip
    sides = ("upper.bottom", "lower.top", "upper.top", "lower.bottom")
    return Member(joined(dice, "3d", shape, sides, dice.between(0.003, 0.02)) | {"probes": inside(0.4, 0.4, 0.2)})


def half_ball(dice: Dice) -> Member:
    """A quarter of half a ball, of tetrahedra."""
    shape = {"builder": "half_ball", "radius": 1.0, "symmetry": "quarter", "mesh_size": dice.between(0.35, 0.5),
             "contact_mesh_size": dice.between(0.07, 0.1), "contact_radius": 0.25}  # fmt: skip
    found = pressed(dice, "3d", shape, "ball.cap", "ball.top", dice.between(0.03, 0.05), 0.0)
    found["supports"] |= {f"{k}_plane": {"boundary": f"ball.{k}_plane", "displacement": {k: 0.0}} for k in "xy"}
    return Member(found | {"probes": inside(0.1, 0.1, 0.3)})


def shaft_and_hub(inner: float, radius: float, outer: float, height: float) -> str:
    """Text of a .geo file: quarters of a shaft and of a hub on it, whose sides have names."""
    text = OCC + "Point(1) = {0, 0, 0};\n"
    for n, low, high in ((10, inner, radius), (20, radius, outer)):
        text += _points([(low, 0), (high, 0), (0, high), (0, low)], n)
        text += f"Line({n}) = {{{n}, {n + 1}}}; Circle({n + 1}) = {{{n + 1}, 1, {n + 2}}};\n"
        text += f"Line({n + 2}) = {{{n + 2}, {n + 3}}}; Circle({n + 3}) = {{{n + 3}, 1, {n}}};\n"
        text += f"Curve Loop({n}) = {{{n}:{n + 3}}}; Plane Surface({n}) = {{{n}}};\n"
    for n, name in ((10, "shaft"), (20, "hub")):
        text += f'o[] = Extrude {{0, 0, {height}}} {{ Surface{{{n}}}; }};\nPhysical Volume("{name}") = {{o[1]}};\n'
        sides = {"bottom": n, "top": "o[0]", "front": "o[2]", "outside": "o[3]", "left": "o[4]", "inside": "o[5]"}
        text += "".join(f'Physical Surface("{name}.{side}") = {{{tag}}};\n' for side, tag in sides.items())
    return text


def rollers(planes: Mapping[str, str]) -> Tables:
    """Supports of a shaft and a hub on planes, by the axes across them."""
    return {
        f"{name}_{side}": {"boundary": f"{name}.{side}", "displacement": {axis: 0.0}}
        for name in ("shaft", "hub")
        for side, axis in planes.items()
    }


def hub_3d(dice: Dice) -> Member:
    """A quarter of a hub on a quarter of a shaft, of tetrahedra: a press fit on a curved side."""
    E, over, outline = modulus(dice), dice.between(5e-4, 2e-3), shaft_and_hub(0.3, 1.0, dice.between(1.6, 2), 0.5)
    planes = {"front": "y", "left": "x", "bottom": "z"} | dice.one_of({"top": "z"}, {})
    return Member({
        "model": "3d",
        "geometry": {"file": "shape.geo", "mesh_size": dice.between(0.3, 0.4)},
        "bodies": {"shaft": body(dice, E), "hub": body(dice, E * dice.one_of(0.5, 1.0))},
        "contacts": {"fit": {"surface": "hub.inside", "against": "shaft.outside", "gap": -over}},
        "supports": rollers(planes),
        "probes": inside(0.9, 0.9, 0.25),
        "steps": {"end": 1.0, "count": 1},
    }, outline)  # fmt: skip


FAMILIES: Mapping[str, Callable[[Dice], Member]] = {
    family.__name__: family
    for family in (
        block, mesh_file, floating, stack, receding, two_blocks, heated_blocks, tied, on_waves, half_disc, one_node,
        squeezed_ring, cylinders, punch, axial_punch, shaft_in_ring, heated_ring, rings, wedge, rounded, ball,
        pressed_hub, cube, turntable, blocks_3d, half_ball, hub_3d,
    )
}  # fmt: skip
