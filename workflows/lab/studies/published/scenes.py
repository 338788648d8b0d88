"""The ready scenes `block` and `cube` with n cells over the height, any friction, sheared far enough to slip."""

from __future__ import annotations

import json
from typing import Any

from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.scene_file.read import read

PRESSED = {2: 0.1, 3: 0.05}  # m, in the first step
DRAGGED = {2: 0.05, 3: 0.02}  # m, in the second
PULL = 2.0  # shear over (mu times indentation) at which a part of the base slips, for any mu


def slipping(dim: int, mu: float) -> float:
    """Shear displacement [m] at which a part of the base slips."""
    return round(PULL * mu * PRESSED[dim], 9)


def scene(
    dim: int,
    n: int,
    mu: float = 0.3,
    normal: str = "unilateral",
    drag: float | None = None,
    sticks: bool = False,
    given: float | None = None,
    **solver: Any,
) -> Scene:
    """
    Args:
        sticks: without a bound of friction.
        given: that bound itself [Pa], whatever mu.
        normal: "unilateral" or "compliance", of 20 Pa/m: twenty times as stiff as the body over its depth, or more.
        drag: m, absent as the ready scene has it.
        solver: keys of [solver].
    """
    size, pressed, dragged = (2.0 if dim == 2 else 1.0) / n, PRESSED[dim], DRAGGED[dim] if drag is None else drag
    across = f", y = [[0, 0], [1, 0], [2, {dragged / 2!r}]]" if dim == 3 else ""
    down = f"{'xyz'[dim - 1]} = [[0, 0], [1, {-pressed!r}]]"
    law = '{ law = "compliance", c_n = 20.0, m_n = 1.0 }' if normal == "compliance" else f'{{ law = "{normal}" }}'
    keys = ", ".join(f"{key} = {_toml(value)}" for key, value in ({"tolerance": 1e-6} | solver).items())
    friction = '{ law = "stick" }' if sticks else f'{{ law = "coulomb", mu = {mu!r} }}'
    if given is not None:
        friction = f'{{ law = "tresca", bound = [[0, {given!r}]] }}'
    settings = [
        f"geometry.mesh_size={size!r}",
        'geometry.cells="tensor"',
        f"supports.top.displacement={{ x = [[0, 0], [1, 0], [2, {dragged!r}]]{across}, {down} }}",
        f"contacts.base.friction={friction}",
        f"contacts.base.normal={law}",
        f"solver={{ {keys} }}",
    ]
    if dim == 2:
        settings.append(f"geometry.contact_mesh_size={size!r}")
    return read("block" if dim == 2 else "cube", settings)


def _toml(value: Any) -> str:
    return json.dumps(value)
