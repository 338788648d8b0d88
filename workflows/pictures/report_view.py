"""The data of the 3D view: skin of the bodies and contact sides, and what they do in each step, as compact binary.

An array is `{"type", "data"}`, base64 of little-endian numbers; of one with a `scale` the numbers are multiples of it.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np

from stickslip.geometry.amplitude import value_at
from stickslip.geometry.arrays import EXACT, AnyArray, Array, Ints
from stickslip.geometry.keys import parse
from stickslip.geometry.obstacles.obstacle import Obstacle
from stickslip.workflows.formats.results import Results
from stickslip.workflows.formats.steps import StoredStep, read_step, three

# corners of faces by the number of corners of a cell, in VTK's order
FACES = {
    4: ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    8: ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}
CORNERS = {False: {3: 3, 6: 3, 4: 4, 9: 4}, True: {4: 4, 10: 4, 8: 8, 27: 8}}  # of a cell by its nodes, plane or solid
# a contact facet in pieces with straight sides, by whether the model is solid and by the number of its nodes
PIECES = {
    (False, 2): ((0, 1),),
    (False, 3): ((0, 2), (2, 1)),
    (True, 3): ((0, 1, 2),),
    (True, 4): ((0, 1, 2, 3),),
    (True, 6): ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    (True, 9): ((0, 4, 8, 7), (4, 1, 5, 8), (7, 8, 6, 3), (8, 5, 2, 6)),
}


def model(results: Results) -> dict[str, Any] | None:
    """Return the data of the view; None if no step's file or no mesh is there.

    Raises:
        MachineError: a step's file is damaged.
    """
    mesh, solid = results.mesh, results.solid
    if not results.steps or not {"mesh/points", "mesh/cells", "mesh/body", "mesh/bodies"} <= set(mesh):
        return None
    points, bodies = mesh["mesh/points"], [name.decode() for name in mesh["mesh/bodies"].tolist()]
    faces, owners = skin(mesh["mesh/cells"], solid)
    names = [name for name in results.scene.get("contacts") or () if f"contacts/{name}/nodes" in mesh]
    places = {name: mesh[f"contacts/{name}/nodes"] for name in names}
    shown = np.unique(np.concatenate([faces.ravel(), *places.values()]))
    local = np.full(len(points), -1)
    local[shown] = np.arange(len(shown))
    each = 6 * len(shown) + 2 * len(faces) + sum(5 * len(nodes) for nodes in places.values())
    indices = np.array(sorted(results.steps))
    few = max(2, 3_000_000 // each)  # bytes; of a longer history, evenly chosen steps are shown
    if len(indices) > few:
        indices = indices[np.unique(np.linspace(0, len(indices) - 1, few).round().astype(int))]
    steps = [read_step(results.steps[int(index)]) for index in indices]
    length = max(float(np.abs(step.displacement[shown]).max(initial=0.0)) for step in steps) or 1.0
    stress = max(float(step.von_mises.max(initial=0.0)) for step in steps) or 1.0

    rigid = _obstacles(results, points)

    def frame(step: StoredStep) -> dict[str, Any]:
        return {
            "time": step.time,
            "index": step.index,
            "displacement": _packed(step.displacement[shown], "int16", length / 32767),
            "stress": _packed(step.von_mises[owners], "uint16", stress / 65535),
            "contacts": {
                name: {"pressure": _packed(c.pressure, "float32"), "status": _packed(c.status, "int8")}
                for name, c in step.contacts.items()
                if name in places
            },
            "obstacles": {
                name: _packed(_motion(results, name, one, step), "float32") for name, (one, *_) in rigid.items()
            },
        }

    contacts = [
        {
            "name": name,
            "nodes": _packed(local[places[name]], "uint32"),
            "facets": _packed(pieces(mesh[f"contacts/{name}/cells"], solid), "uint32"),
        }
        for name in names
    ]
    return {
        "solid": solid,
        "units": {unit: results.units(unit) for unit in ("m", "Pa")},
        "bodies": bodies,
        "points": _packed(points[shown], "float32"),
        "width": faces.shape[1],
        "pieceWidth": 3 if solid else 2,
        "faces": _packed(local[faces], "uint32"),
        "owners": _packed(mesh["mesh/body"][owners], "uint8" if len(bodies) < 256 else "uint32"),
        "contacts": contacts,
        "obstacles": [
            {"name": name, "points": _packed(corners, "float32"), "pieces": _packed(pieces, "uint32")}
            for name, (_, corners, pieces) in rigid.items()
        ],
        "frames": [frame(step) for step in steps],
        "left_out": len(results.steps) - len(steps),
        "factors": factors(float(np.ptp(points, axis=0).max()), length),
    }


def _obstacles(results: Results, points: Array) -> dict[str, tuple[Obstacle, Array, Ints]]:
    """By name the obstacles, with points (n, 3) [m] and triangles or segments of their surfaces at rest."""
    given = results.scene.get("obstacles") or {}
    if not given:
        return {}
    from stickslip.workflows.pictures.rigid import Rigid, surfaces  # VTK takes a second to start

    dim = 3 if results.solid else 2
    kinds: dict[str, Obstacle] = {name: parse(Obstacle, table, ("obstacles", name)) for name, table in given.items()}
    at_rest = [Rigid(each, np.zeros(dim), 0.0) for each in kinds.values()]
    found = dict[str, tuple[Obstacle, Array, Ints]]()
    for (name, each), surface in zip(kinds.items(), surfaces(three(points), at_rest, 1.0), strict=True):
        if surface.n_points:
            cells = (surface.triangulate().faces.reshape(-1, 4) if dim == 3 else surface.lines.reshape(-1, 3))[:, 1:]
            found[name] = each, np.asarray(surface.points, float), cells
    return found


def _motion(results: Results, name: str, obstacle: Obstacle, step: StoredStep) -> Array:
    """Motion (4, 3) of an obstacle as an affine map: its translation [m], then the rows of its linear part [-]."""
    dim = 3 if results.solid else 2
    told = results.reported[step.index - 1].get("obstacles", {}) if step.index <= len(results.reported) else {}
    motion = np.zeros((4, 3))
    motion[0, :dim] = told.get(name, {}).get("displacement", np.zeros(dim))
    if obstacle.rotation is not None:
        angle = value_at(obstacle.rotation.angle, step.time, float(results.scene["steps"]["end"]))
        origin, *axes = obstacle.rotation.displacement(np.vstack([np.zeros(dim), np.eye(dim)]), angle)
        motion[0, :dim] += origin
        motion[1 : 1 + dim, :dim] = (np.array(axes) - origin).T
    return motion


def skin(cells: Ints, solid: bool) -> tuple[Ints, Ints]:
    """Faces (f, k) that belong to one cell alone, and their cells (f,); of a plane body the cells themselves.

    Cells are straight, on their corners; nodes in VTK's order.
    """
    corners = cells[:, : CORNERS[solid][cells.shape[1]]]
    if not solid:
        return corners, np.arange(len(cells))
    table = np.array(FACES[corners.shape[1]])
    faces = corners[:, table].reshape(-1, table.shape[1])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    outer = np.sort(first[count == 1])
    return faces[outer], outer // len(table)


def pieces(facets: Ints, solid: bool) -> Ints:
    """Contact facets as line segments (f, 2), or as triangles (f, 3)."""
    cut = facets[:, np.array(PIECES[solid, facets.shape[1]])].reshape(-1, len(PIECES[solid, facets.shape[1]][0]))
    return np.concatenate([cut[:, [0, 1, 2]], cut[:, [0, 2, 3]]]) if cut.shape[1] == 4 else cut


def factors(size: float, largest: float) -> dict[str, Any]:
    """Factors on the displacement to choose from, and the place of the first one.

    >>> factors(1.0, 0.03)["values"]
    [0.0, 1.0, 2.0, 5.0, 10.0]
    >>> factors(1.0, 1e-3)
    {'values': [0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0], 'start': 6}
    """
    wanted = 1.0 if largest >= 0.02 * size else 0.05 * size / largest  # from 2 % on it is seen
    rounds = [step * 10.0**decade for decade in range(15) for step in (1.0, 2.0, 5.0)]
    start = max(k for k, factor in enumerate(rounds) if factor <= wanted * (1 + EXACT))
    return {"values": [0.0, *rounds[: start + 4]], "start": start + 1}


def unpacked(array: Mapping[str, Any]) -> AnyArray:
    """The numbers of an array of the page, flat."""
    numbers = np.frombuffer(base64.b64decode(array["data"]), np.dtype(array["type"]).newbyteorder("<"))
    return numbers * array["scale"] if "scale" in array else numbers


def _packed(values: AnyArray, kind: str, scale: float | None = None) -> dict[str, Any]:
    numbers = np.asarray(values if scale is None else np.round(values / scale))
    data = base64.b64encode(numbers.astype(np.dtype(kind).newbyteorder("<")).tobytes()).decode()
    return {"type": kind, "data": data} | ({} if scale is None else {"scale": scale})
