"""A scene of boxes seen in a mirror: x goes to the other end of the box, and left is right."""

from __future__ import annotations

from typing import Any

import numpy as np

from stickslip.geometry.amplitude import Amplitude
from stickslip.solvers.scene.timeline import Place
from stickslip.workflows.lab.verification.hard.tables import Tables, over_drives, scaled, scene_of

BOXES = ("block", "strip", "stack", "two_blocks")
OTHER = {"left": "right", "right": "left"}


def mirrored(tables: Tables) -> Tables | None:
    """The mirror image, meshed by a grid, for only a grid is its own image; None if the shape is not its own image."""
    shape = tables["geometry"]
    if shape.get("builder") not in BOXES or shape.get("offset", 0.0) != 0.0:
        return None
    if "body_force" in tables or any("moment" in point for point in tables.get("remote_points", {}).values()):
        return None  # may be an expression; turns with the axes
    scene = scene_of(tables)
    ends = np.asarray(scene.geometry.box(scene.dim))[:, 0]
    middle = float(ends.min() + ends.max())
    found = over_drives(tables, _turned)
    found["geometry"]["cells"] = "tensor"
    for contact in found["contacts"].values():
        contact["surface"], contact["against"] = _other(contact["surface"]), _other(contact["against"])
        _mirror(contact.get("friction", {}), middle)
    for body in found["bodies"].values():
        for key in {"axis_1", "axis_2"} & body.keys():
            body[key][0] *= -1
    for table in ("supports", "loads", "probes", "obstacles", "springs", "bolts", "remote_points"):
        for entry in found.get(table, {}).values():
            _mirror(entry, middle)
    for pair in found.get("periodic", {}).values():
        pair["boundary"], pair["with"] = _other(pair["boundary"]), _other(pair["with"])
    return found


def _turned(place: Place, amplitude: Amplitude) -> Amplitude:
    """What points along x, and what turns, has the other sign."""
    return scaled(amplitude, -1.0) if place.component == "x" or place.quantity == "rotation" else amplitude


def _mirror(entry: dict[str, Any], middle: float) -> None:
    for key in ("boundary", "at", "to", "head", "nut"):
        if isinstance(entry.get(key), str):
            entry[key] = _other(entry[key])
    for table in (entry, entry.get("rotation") or {}):
        if "point" in table:
            table["point"][0] = middle - table["point"][0]
    for key in ("normal", "axis", "direction"):
        if key in entry:
            entry[key][0] *= -1


def _other(side: str) -> str:
    """
    >>> _other("block.left"), _other("block.top"), _other("table")
    ('block.right', 'block.top', 'table')
    """
    body, dot, name = side.rpartition(".")
    return f"{body}{dot}{OTHER.get(name, name)}"
