"""The problems: verification problems of the house and ready scenes, on meshes so coarse that their errors show."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import pi
from typing import Literal

import numpy as np

from stickslip import Builder, Coulomb, Scene, Unilateral, read
from stickslip.workflows.lab.verification.cases import (
    cattaneo,
    circular_drive,
    column,
    hertz,
    punch,
    raous,
    shear_lag,
    sheared_column,
    shrink_fit,
)
from stickslip.workflows.lab.verification.cases.shrink_fit import JOINT
from stickslip.workflows.scene_file.read import from_dict

MESHES = (2.25, 1.5, 1.0)  # times the mesh sizes of a problem's scene
METHOD = "condensed-newton"
PUSHED = "supports.top.displacement={x=[[0, 0], [1, 0], [2, 0.006]], y=[[0, 0], [1, -0.03]]}"
Values = Mapping[str, float]  # by the name of a number


@dataclass(frozen=True, kw_only=True)
class Problem:
    """A scene that is solved on the meshes `MESHES`, and once on a far finer one."""

    scene: Callable[[], Scene]  # on the finest of the meshes
    fine: float = 1 / 3  # times its mesh sizes: the mesh of the truth, of order 2
    long: bool = True  # whether the truth can be had in 16 times the steps
    exact: Values | None = None  # known values of the last step, in place of the truth's
    source: str = ""  # of the exact values

    def meshed(self, order: Literal[1, 2], factor: float) -> Scene:
        """The scene in an order, its mesh sizes times a factor."""
        scene = self.scene()
        assert isinstance(scene.geometry, Builder)
        return replace(scene, geometry=replace(scene.geometry.refined(factor), order=order))


def ready(name: str, *overrides: str) -> Callable[[], Scene]:
    """A ready scene."""
    return lambda: read(name, overrides)


def _pressed() -> Scene:
    return column.scene(dim=2, method=METHOD, c_n=column.C_N[2], m=2, g=column.GAP, top=0.01, mesh_size=0.2)


def _sheared() -> Scene:
    drawn = sheared_column.scene(
        dim=2,
        method=METHOD,
        E=sheared_column.E,
        friction=Coulomb(mu=sheared_column.MU),
        path=sheared_column.TOP[:, None],
    )
    return replace(drawn, geometry=replace(drawn.geometry, mesh_size=0.2))


def _circle() -> Scene:
    angles = 2 * pi * np.arange(17) / 16
    path = circular_drive.DRIVE.radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return sheared_column.scene(
        dim=3, method=METHOD, E=circular_drive.E, friction=Coulomb(mu=sheared_column.MU), path=path
    )


def _punch(bonded: bool) -> Callable[[], Scene]:
    if bonded:
        cut = punch.Cut(method=METHOD, normal=punch.BONDED, fine=0.05, edge=0.02, size=20.0)
    else:
        cut = punch.Cut(
            method=METHOD,
            normal=punch.PRESSED,
            friction=Coulomb(mu=0.3),
            fine=0.1,
            edge=0.05,
            size=20.0,
            symmetric=True,
        )
    return lambda: punch.scene(cut)


def _hertz(touch: hertz.Touch) -> Callable[[], Scene]:
    return lambda: hertz.scene(touch)


def _cattaneo() -> Scene:
    path = [(0.0, -cattaneo.DOWN), (cattaneo.ASIDE / 2, -cattaneo.DOWN), (cattaneo.ASIDE, -cattaneo.DOWN)]
    return cattaneo.scene(cattaneo.Two(cells=9.0, order=1, ratio=cattaneo.RATIO), path)


def _shear_lag() -> Scene:
    return shear_lag.scene(METHOD, friction=shear_lag.COULOMB, normal=Unilateral(), n=100)


def _shrink_fit() -> Scene:
    return shrink_fit.scene(shrink_fit.Press(order=1, cells=0.05, ratio=1.5))


def _turntable() -> Scene:
    """A square block on a table that turns and moves: slip has another direction at every node."""
    return from_dict(
        {
            "model": "3d",
            "geometry": {"builder": "block", "length": 0.1, "width": 0.1, "height": 0.02, "mesh_size": 0.01},
            "bodies": {"block": {"E": 1e9, "nu": 0.0}},
            "obstacles": {
                "table": {
                    "shape": "plane",
                    "point": [0.0, 0.0, 0.0],
                    "normal": [0.0, 0.0, 1.0],
                    "rotation": {"angle": [[1, 0], [2, 0.02]], "point": [0.05, 0.05, 0.0], "axis": [0.0, 0.0, 1.0]},
                    "displacement": {"x": [[1, 0], [2, 5e-4]]},
                }
            },
            "contacts": {
                "base": {"surface": "block.bottom", "against": "table", "friction": {"law": "coulomb", "mu": 0.3}}
            },
            "supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0, "z": [[1, -1e-5]]}}},
            "steps": {"end": 2.0, "count": 2},
            "solver": {"method": METHOD},
        }
    )


def _fit() -> Values:
    p = shrink_fit.exact(shrink_fit.Press()).p
    area = pi / 2 * JOINT
    return {
        "contacts.joint.normal_force": p * area,
        "contacts.joint.max_pressure": p,
        "contacts.joint.contact_area": area,
    }


def _column() -> Values:
    state = column.driven_by_displacement(M=column.M, U=0.01, g=column.GAP, c_n=column.C_N[2], m=2)
    return {
        "contacts.base.normal_force": state.pressure,
        "contacts.base.max_pressure": state.pressure,
        "contacts.base.max_penetration": state.penetration,
    }


PROBLEMS: Mapping[str, Problem] = {
    "turntable": Problem(scene=_turntable, fine=0.5, long=False),
    "column": Problem(scene=_pressed, exact=_column(), source="closed form"),
    "sheared_column": Problem(scene=_sheared),
    "circular_drive": Problem(scene=_circle, fine=0.5),
    "punch_bonded": Problem(scene=_punch(bonded=True)),
    "punch_friction": Problem(scene=_punch(bonded=False)),
    "hertz_plane": Problem(scene=_hertz(hertz.Touch(model="plane strain", load=hertz.ROLLER, cells=12.0, order=1))),
    "hertz_axisymmetric": Problem(scene=_hertz(hertz.Touch(cells=12.0, order=1))),
    "hertz_3d": Problem(scene=_hertz(hertz.Touch(model="3d", cells=4.5, order=1)), fine=0.5),
    "cattaneo": Problem(scene=_cattaneo),
    "shear_lag": Problem(scene=_shear_lag),
    "shrink_fit": Problem(scene=_shrink_fit, exact=_fit(), source="Lamé"),
    "raous": Problem(scene=lambda: raous.scene(METHOD, steps=2, n=32)),
    "block": Problem(scene=ready("block")),
    "two_blocks": Problem(scene=ready("two_blocks")),
    "cube": Problem(scene=ready("cube", "geometry.mesh_size=0.16666666666666666"), long=False),
    "half_space": Problem(scene=ready("half_space", "steps.count=4")),
    "half_disc": Problem(scene=ready("half_disc", PUSHED, "steps.end=2.0", "steps.count=6")),
    "half_ball": Problem(
        scene=ready("half_ball", "geometry.mesh_size=0.3", "geometry.contact_mesh_size=0.04", "steps.count=2"),
        long=False,
    ),
    "fretting": Problem(scene=ready("fretting", "steps.end=6.0", "steps.count=6")),
    "shaft": Problem(scene=ready("shaft")),
    "sliding": Problem(scene=ready("sliding", "geometry.mesh_size=0.05", "geometry.lower_mesh_size=0.04")),
    "foundation": Problem(scene=ready("foundation")),
    "strip": Problem(scene=ready("strip")),
}
