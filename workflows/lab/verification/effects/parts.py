"""The effects and friction laws, each with the tables of a small scene that call for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from stickslip.solvers import effects

Tables = dict[str, Any]
COULOMB = {"law": "coulomb", "mu": 0.3}
SOFT = {"law": "compliance", "c_n": 1e6, "m_n": 2.0}


def block(dim: int, pressed: float | str = -0.02) -> Tables:
    """A unit cube or square that its top holds, presses and shears; one step."""
    width = {"width": 1.0} if dim == 3 else {}
    top = dict.fromkeys("xyz"[:dim], 0.0) | {"x": 0.005, "xyz"[dim - 1]: pressed}
    return {
        "model": "3d" if dim == 3 else "plane strain",
        "geometry": {"builder": "block", "length": 1.0, "height": 1.0, "mesh_size": 0.25 if dim == 3 else 0.125}
        | width,
        "bodies": {"block": {"E": 1000.0, "nu": 0.3, "density": 1.0}},
        "supports": {"top": {"boundary": "block.top", "displacement": top}},
    }


def touching(dim: int, **contact: Any) -> Tables:
    """What puts it on a floor."""
    floor = {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}
    base = {"surface": "block.bottom", "against": "floor", **contact}
    return {"obstacles": {"floor": floor}, "contacts": {"base": base}}


STEPS = {"steps": {"count": 3, "seconds": True}}
SCENES: Mapping[str, Tables] = {
    name: tables
    for dim in (2, 3)
    for name, tables in {
        f"held, {dim}D": block(dim),
        f"tilted, {dim}D": block(dim, "0.03*x-0.02") | touching(dim),
        f"rubbing, {dim}D": block(dim) | touching(dim, friction=COULOMB) | STEPS,
    }.items()
}


@dataclass(frozen=True, kw_only=True)
class Part:
    """What a scene may call for."""

    calls: Tables  # what calls for it, beside or instead of tables of its base
    base: str = "rubbing, 2D"
    serves: tuple[str, ...] = ()  # files that serve it alone


LINKS = "solvers/fem/springs.py"
TWO_BLOCKS = {
    "geometry": {"builder": "two_blocks", "length": 1.0, "height": 1.0, "mesh_size": 0.125},
    "bodies": {name: block(2)["bodies"]["block"] for name in ("upper", "lower")},
    "obstacles": {},
    "contacts": {"base": {"surface": "upper.bottom", "against": "lower.top", "friction": COULOMB}},
    "supports": {
        "top": {"boundary": "upper.top", "displacement": block(2)["supports"]["top"]["displacement"]},
        "foot": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0}},
    },
}
SLIDING = TWO_BLOCKS | {"contacts": {"base": TWO_BLOCKS["contacts"]["base"] | {"sliding": True}}}
EFFECTS: Mapping[str, Part] = {
    "contact": Part(base="held, 2D", calls=touching(2), serves=("solvers/contact/coupling.py",)),
    "unilateral": Part(base="held, 2D", calls=touching(2), serves=()),
    "compliance": Part(
        base="tilted, 2D",
        calls=touching(2, normal=SOFT),
        serves=(),
    ),
    "bilateral": Part(
        base="tilted, 2D", calls=touching(2, normal={"law": "bilateral"}), serves=()
    ),
    "tied": Part(base="tilted, 2D", calls=touching(2, normal={"law": "tied"}), serves=()),
    "friction": Part(base="tilted, 3D", calls=touching(3, friction=COULOMB), serves=()),
    "quasistatic": Part(base="held, 2D", calls=STEPS),
    "multibody": Part(calls=TWO_BLOCKS, serves=("solvers/contact/mortar.py", "solvers/contact/coupling.py")),
    "sliding": Part(calls=SLIDING, serves=("solvers/stepping/pairs.py",)),
    "gravity": Part(calls={"gravity": {"acceleration": [0.0, -9.81]}}),
    "body_force": Part(calls={"body_force": {"block": {"force": ["sin(pi*x)", 0.0]}}}),
    "centrifugal": Part(calls={"centrifugal": {"speed": 1.0}}),
    "elastic_support": Part(calls={"elastic_support": {"wall": {"boundary": "block.left", "normal": 100.0}}}),
    "periodic": Part(calls={"periodic": {"walls": {"boundary": "block.right", "with": "block.left"}}}),
    "thermal": Part(
        calls={"thermal": {"block": {"expansion": 1e-4, "temperature": "10*y"}}},
        serves=("solvers/system/applied_loads.py",),
    ),
    "springs": Part(
        calls={"springs": {"wall": {"at": "block.left", "stiffness": [100.0, 0.0]}}}, serves=(LINKS,)
    ),
    "bolts": Part(
        calls={
            "bolts": {
                "bolt": {
                    "head": "block.right", "nut": "block.left", "axis": [1.0, 0.0], "stiffness": 100.0, "force": 3.0
                }
            }
        },
        serves=(LINKS, "solvers/stepping/tightening.py"),
    ),
    "remote_points": Part(
        calls={
            "remote_points": {
                "top": {
                    "boundary": "block.top", "point": [0.5, 2.0], "coupling": "rigid",
                    "displacement": {"x": 0.005, "y": -0.02}, "rotation": {"z": 0.0},
                }
            },
            "supports": {},
        },
        serves=("solvers/fem/remote_points.py",),
    ),
    "mean_dilatation": Part(
        calls={"bodies": {"block": {"E": 1000.0, "nu": 0.4999, "density": 1.0}}},
        serves=("solvers/fem/mean_dilatation.py",),
    ),
    "orthotropic": Part(
        calls={
            "bodies": {
                "block": {
                    "E_1": 1000.0, "E_2": 80.0, "E_3": 50.0, "G_12": 60.0, "nu_12": 0.4, "nu_13": 0.4, "nu_23": 0.4,
                    "axis_1": [2.0, 1.0], "density": 1.0,
                }
            }
        },
        serves=("solvers/scene/material.py", "solvers/metrics.py"),
    ),
    **{effect.name: Part(calls=dict(effect.example)) for effect in effects.EFFECTS if effect.example},
}  # fmt: skip

NEEDS: Tables = {"compliance": {"normal": SOFT}}  # laws that need more of the contact
WEAKENS = ("solvers/laws/slip_dependent.py", "solvers/stepping/law_memory.py")
LAWS: Mapping[str, Part] = {
    law: Part(
        base=f"rubbing, {dim}D",
        calls=touching(dim, friction={"law": law, **keys}, **NEEDS.get(law, {})),
        serves=serves,
    )
    for law, dim, keys, serves in (
        ("coulomb", 2, {"mu": 0.2}, ()),
        ("tresca", 2, {"bound": [[0.0, 3.0]]}, ()),
        ("stick", 2, {}, ()),
        ("capped_coulomb", 2, {"mu": 0.3, "s_max": 3.0}, ()),
        ("compliance", 2, {"c_T": 100.0, "m_T": 1.0}, ()),
        ("cohesion", 2, {"a": 0.5, "mu": 0.2}, ()),
        ("pressure_dependent", 2, {"mu": [[0.0, 0.4], [40.0, 0.2]]}, ("solvers/laws/pressure_dependent.py",)),
        ("slip_dependent", 2, {"mu": [[0.0, 0.3], [0.02, 0.2]]}, WEAKENS),
        ("rate_dependent", 2, {"mu": [[0.0, 0.2], [0.1, 0.3]]}, ("solvers/laws/rate_dependent.py",)),
        ("static_kinetic", 2, {"mu_s": 0.3, "mu_k": 0.2, "slip_length": 0.02}, WEAKENS),
        (
            "orthotropic_coulomb", 3, {"mu_1": 0.3, "mu_2": 0.1, "axis": [1.0, 0.0, 0.0]},
            (),
        ),
    )
}  # fmt: skip
