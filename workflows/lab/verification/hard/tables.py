"""A scene as plain tables: read coarser, its values in time changed, and what `--set` needs to make it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from stickslip import read
from stickslip.geometry.amplitude import Amplitude, listed_times, value_at
from stickslip.solvers.scene.scene import over
from stickslip.solvers.scene.timeline import Place
from stickslip.workflows.scene_file.read import from_dict, to_dict

Tables = dict[str, Any]  # of a scene file, every default filled in
SIZES = ("mesh_size", "contact_mesh_size", "lower_mesh_size", "inner_mesh_size", "edge_mesh_size")
COARSER = 1.4  # times the mesh sizes of a ready scene: a variation then takes about a second
CORNERS = 4  # listed times that are kept of a long history
COUNT = 6  # equal steps, at most
BARE = re.compile(r"[A-Za-z0-9_-]+")
MODULI = ("E", "E_1", "E_2", "E_3")  # keys of Young's moduli


def ready(name: str) -> Tables:
    """A ready scene on a coarser mesh, cut after its first `CORNERS` listed times, or a part as small of a clock's."""
    tables = to_dict(read(name))
    for key in sizes(tables):
        tables["geometry"][key] *= COARSER
    tables["output"]["pictures"] = False
    steps, times = tables["steps"], corners(tables)[:CORNERS]
    steps["count"] = max(1, min(COUNT, round(steps["count"] * times[-1] / steps["end"])))
    steps["end"] = steps["end"] / CORNERS if steps.get("clock") else min(times[-1], steps["end"])
    return tables


def lasting(steps: Tables, end: float, count: int) -> Tables:
    """Steps up to another time: as many equal ones, or those of the same clock.

    >>> lasting({"end": 1.0, "count": 1, "clock": {"error": 1e-4}}, 2.0, 6)
    {'end': 2.0, 'count': 1, 'clock': {'error': 0.0001}}
    """
    return steps | {"end": end, "count": 1 if steps.get("clock") else count}


def sizes(tables: Tables) -> list[str]:
    """Keys of [geometry] that are mesh sizes."""
    return [key for key in SIZES if key in tables["geometry"]]


def corners(tables: Tables) -> list[float]:
    """Times that tables list, and the end [s], increasing; t = 0 is left out."""
    scene = from_dict(tables)
    listed = {t for amplitude in scene.drives().values() for t in listed_times(amplitude)}
    return sorted({t for t in listed if 0 < t < scene.steps.end} | {scene.steps.end})


def over_drives(tables: Tables, change: Callable[[Place, Amplitude], Amplitude], bounds: bool = False) -> Tables:
    """Change every value in time; friction bounds only if `bounds`."""
    return to_dict(
        over(from_dict(tables), lambda place, a: a if place.table == "contacts" and not bounds else change(place, a))
    )


def scaled(amplitude: Amplitude, factor: float) -> Amplitude:
    """
    >>> scaled(((0.0, 0.0), (1.0, 2.0)), 3.0)
    ((0.0, 0.0), (1.0, 6.0))
    """
    if isinstance(amplitude, float | int):
        return amplitude * factor
    return tuple((time, value * factor) for time, value in amplitude)


def resolved(amplitude: Amplitude, end: float, times: list[float]) -> tuple[tuple[float, float], ...]:
    """A table of the same values at t = 0 and at these times."""
    return tuple((time, value_at(amplitude, time, end)) for time in (0.0, *times))


def extent(tables: Tables) -> float:
    """Largest size of the bodies' box [m]."""
    scene = from_dict(tables)
    return float(np.ptp(scene.geometry.box(scene.dim), axis=0).max())


def softest(tables: Tables) -> float:
    """Smallest Young's modulus [Pa]."""
    return float(min(body[key] for body in tables["bodies"].values() for key in MODULI if key in body))


def stiffen(body: Tables, factor: float) -> None:
    """Multiply all moduli of a body."""
    for key in (*MODULI, "G_12", "G_13", "G_23"):
        if key in body:
            body[key] *= factor


def travel(tables: Tables) -> float:
    """Largest prescribed displacement [m], or a thousandth of the extent where only forces act."""
    scene = from_dict(tables)
    moved = [
        abs(value_at(a, time, scene.steps.end))
        for place, a in scene.drives().items()
        if place.quantity == "displacement"
        for time in scene.requested_times()
    ]
    return max(moved, default=0.0) or 1e-3 * extent(tables)


def frictions(tables: Tables, key: str = "law") -> Iterator[Tables]:
    """The friction tables that have a key."""
    for contact in tables["contacts"].values():
        if key in contact.get("friction", {}):
            yield contact["friction"]


def times(value: Any, factor: float) -> Any:
    """A number, an expression or a vector times a factor; or a coefficient by pressure, a table.

    >>> times([[0.0, 0.8], [1.5e5, 0.4]], 0.5), times([0.0, 2.0], 0.5), times("x", 0.5)
    ([[0.0, 0.4], [150000.0, 0.2]], [0.0, 1.0], '0.5*(x)')
    """
    if isinstance(value, list):
        return [[each[0], each[1] * factor] if isinstance(each, list) else each * factor for each in value]
    return f"{factor!r}*({value})" if isinstance(value, str) else value * factor


def overrides(before: Mapping[str, Any], after: Mapping[str, Any], at: str = "") -> list[str]:
    """Overrides for `--set` that make one scene of the other; a table that loses a key is written whole.

    >>> overrides({"steps": {"end": 1.0, "count": 2}}, {"steps": {"end": 1.0, "count": 1}})
    ['steps.count=1']
    >>> overrides({"loads": {"top": {"pressure": 1.0}}}, {"loads": {}})
    ['loads={}']
    """
    found = []
    for key, value in after.items():
        own, path = before.get(key), f"{at}{key}"
        if own == value:
            continue
        plain = all(BARE.fullmatch(word) for word in value) if isinstance(value, Mapping) else False
        if plain and isinstance(own, Mapping) and set(own) <= set(value):
            found += overrides(own, value, f"{path}.")
        else:
            found.append(f"{path}={toml(value)}")
    return found


def toml(value: Any) -> str:
    """A value in one line of TOML.

    >>> toml({"law": "coulomb", "mu": 0.5, "in time": [[0, True]]})
    '{law = "coulomb", mu = 0.5, "in time" = [[0, true]]}'
    """
    if isinstance(value, Mapping):
        entries = (f"{key if BARE.fullmatch(key) else json.dumps(key)} = {toml(entry)}" for key, entry in value.items())
        return f"{{{', '.join(entries)}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml, value))}]"
    return json.dumps(value)
