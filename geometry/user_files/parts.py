"""Bodies and sides of a gmsh model: which entities each name stands for."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from inspect import signature

import numpy as np

from stickslip.geometry.arrays import CLOSE, Array, Ints
from stickslip.geometry.errors import GeometryError, nearest
from stickslip.geometry.protocols import Gmsh

NAME = re.compile(r"[a-z][a-z0-9_]*")
SIDE = re.compile(r"([a-z][a-z0-9_]*)\.[a-z][a-z0-9_]*")
NAMELESS = re.compile(r"Open CASCADE STEP translator [0-9. ]+$")  # OpenCASCADE's name of a part without a name
CELL_WORD, FACET_WORD = {2: "surface", 3: "volume"}, {2: "edge", 3: "face"}
SAMPLES = 17  # points along a curve, and along each parameter of a face
Selection = Sequence[str] | Mapping[str, Sequence[float]]  # ["face 12", ...] or { box = [...] }


@dataclass(frozen=True)
class Parts:
    """Tags of the gmsh entities of each body and of each side (named body.side)."""

    bodies: dict[str, list[int]]
    sides: dict[str, list[int]]


def find_parts(gmsh: Gmsh, dim: int, named_by_entity: bool, names: Mapping[str, Selection], unit: float) -> Parts:
    """Find the bodies and sides of the current gmsh model.

    Args:
        named_by_entity: if the model has no physical groups, bodies are the parts of the CAD file with their names.
        names: the scene's `[geometry.names]`: new names of bodies, and sides, as body.side, that it adds.
        unit: length of the model's unit [m].

    Raises:
        GeometryError: the dimension does not fit, or a name is missing, malformed, unknown or used twice.
    """
    _check_dimension(gmsh, dim)
    groups = [(gmsh.model.getPhysicalName(dim, tag), tag) for _, tag in gmsh.model.getPhysicalGroups(dim)]
    named_by_entity = named_by_entity and not groups
    bodies = _bodies_by_entity(gmsh, dim) if named_by_entity else _bodies_by_group(gmsh, dim, groups)
    sides = _sides_by_group(gmsh, dim, bodies)
    if named_by_entity:
        sides |= _sides_by_entity(gmsh, dim, bodies)
    bodies, sides = _renamed(bodies, sides, {name: of for name, of in names.items() if "." not in name})
    for name, selection in names.items():
        if "." in name:
            _add_side(gmsh, dim, bodies, sides, name, _select(gmsh, dim, name, selection, unit))
    return Parts(bodies, sides)


def _renamed(
    bodies: dict[str, list[int]], sides: dict[str, list[int]], names: Mapping[str, Selection]
) -> tuple[dict[str, list[int]], dict[str, list[int]]]:
    """Bodies and sides with the new names of bodies; a name for several makes them one body."""
    new: dict[str, str] = {}
    for name, selection in names.items():
        key = f'names."{name}"'
        if not NAME.fullmatch(name):
            raise GeometryError(f"{key}: a body's name is made of a-z, 0-9 and _, and begins with a letter")
        if not selection:
            raise GeometryError(f"{key}: the list is empty")
        for old in selection:
            if isinstance(selection, Mapping) or old not in bodies:
                hint = nearest(old, bodies)
                raise GeometryError(f'{key}: expected names that the file gives to bodies, not "{old}"; {hint}')
            if old in new:
                raise GeometryError(f"{key}: {old} is {new[old]} already")
            new[old] = name
    for name in names:
        if name in bodies and name not in new:
            raise GeometryError(f'names."{name}": the file has another body of this name')
    found: dict[str, list[int]] = {}
    for body, tags in bodies.items():
        found.setdefault(new.get(body, body), []).extend(tags)
    moved: dict[str, list[int]] = {}
    for side, tags in sides.items():
        body, own = side.split(".")
        moved.setdefault(f"{new.get(body, body)}.{own}", []).extend(tags)
    return found, moved


def _check_dimension(gmsh: Gmsh, dim: int) -> None:
    """Raise GeometryError unless the model has volumes in 3D, or only surfaces at z = 0 in 2D."""
    if not gmsh.model.getEntities(dim):
        raise GeometryError(f"has no {CELL_WORD[dim]}s, and a {'3d' if dim == 3 else 'plane'} model is made of them")
    if dim == 2:
        if gmsh.model.getEntities(3):
            raise GeometryError('holds volumes, and a plane model is made of surfaces; write model = "3d"')
        x = np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3))
        if np.abs(x[:, 2]).max() > CLOSE * np.ptp(x, axis=0).max() + 2e-7:  # gmsh enlarges boxes by 1e-7
            raise GeometryError(f"lies at z = {x[0, 2]:g} to {x[1, 2]:g}, and a plane model lies at z = 0")


def _bodies_by_group(gmsh: Gmsh, dim: int, groups: list[tuple[str, int]]) -> dict[str, list[int]]:
    """Bodies are the physical groups, given as pairs of name and tag."""
    if not groups:
        raise GeometryError(f"names no body: a body is a physical group of {CELL_WORD[dim]}s with a name")
    bodies: dict[str, list[int]] = {}
    owner: dict[int, str] = {}
    for name, tag in groups:
        if not NAME.fullmatch(name):
            raise GeometryError(
                f'physical {CELL_WORD[dim]} "{name}" ({tag}): a body\'s name is made of a-z, 0-9 and _, and begins '
                "with a letter"
            )
        bodies[name] = [int(e) for e in gmsh.model.getEntitiesForPhysicalGroup(dim, tag)]
        for entity in bodies[name]:
            if owner.setdefault(entity, name) != name:
                raise GeometryError(f"{CELL_WORD[dim]} {entity} is in two bodies, {owner[entity]} and {name}")
    return bodies


def _bodies_by_entity(gmsh: Gmsh, dim: int) -> dict[str, list[int]]:
    """Each volume (3D) or surface (2D) is a body, with the name that the CAD file gives it."""
    entities = [tag for _, tag in gmsh.model.getEntities(dim)]
    labels = numbered(label(gmsh.model.getEntityName(dim, tag), "part") for tag in entities)
    return {name: [tag] for name, tag in zip(labels, entities, strict=True)}


def _sides_by_group(gmsh: Gmsh, dim: int, bodies: Mapping[str, list[int]]) -> dict[str, list[int]]:
    """Sides are the named physical groups of facets."""
    sides: dict[str, list[int]] = {}
    for _, tag in gmsh.model.getPhysicalGroups(dim - 1):
        name = gmsh.model.getPhysicalName(dim - 1, tag)
        if name:
            _add_side(
                gmsh, dim, bodies, sides, name, [int(e) for e in gmsh.model.getEntitiesForPhysicalGroup(dim - 1, tag)]
            )
    return sides


def _sides_by_entity(gmsh: Gmsh, dim: int, bodies: Mapping[str, list[int]]) -> dict[str, list[int]]:
    """Each named face (edge in 2D) of a CAD file is a side of the body that it bounds."""
    found: list[tuple[str, int]] = []
    for body, (entity,) in bodies.items():
        for _, tag in gmsh.model.getBoundary([(dim, entity)], oriented=False):
            name = gmsh.model.getEntityName(dim - 1, tag)
            if name:
                found.append((f"{body}.{label(name, 'side')}", tag))
    labels = numbered(name for name, _ in found)
    return {name: [tag] for name, (_, tag) in zip(labels, found, strict=True)}


def label(name: str, default: str) -> str:
    """Name for scenes made from the last component of a path in a CAD file; `default` if it has no name.

    >>> [label(name, "part") for name in ("Shapes/Rhino Product", "", "Assembly/3-Jaw")]
    ['rhino_product', 'part', 'part_3_jaw']
    """
    if NAMELESS.search(name):
        return default
    plain = re.sub(r"[^a-z0-9]+", "_", name.split("/")[-1].lower()).strip("_")
    if not plain:
        return default
    return plain if plain[0].isalpha() else f"{default}_{plain}"


def numbered(names: Iterable[str]) -> list[str]:
    """Make names unique by numbers.

    >>> numbered(["bolt", "ring", "bolt"])
    ['bolt', 'ring', 'bolt_2']
    """
    seen: Counter[str] = Counter()
    found: list[str] = []
    for name in names:
        seen[name] += 1
        while (numbered := name if seen[name] == 1 else f"{name}_{seen[name]}") in found:
            seen[name] += 1
        found.append(numbered)
    return found


def _add_side(
    gmsh: Gmsh, dim: int, bodies: Mapping[str, list[int]], sides: dict[str, list[int]], name: str, entities: list[int]
) -> None:
    """Add a side to `sides` after its name and entities are checked."""
    match = SIDE.fullmatch(name)
    if match is None:
        raise GeometryError(
            f'side "{name}": a side is named body.side, of a-z, 0-9 and _, such as {next(iter(bodies))}.base'
        )
    if match[1] not in bodies:
        raise GeometryError(f'side "{name}": no such body; {nearest(match[1], bodies)}')
    if name in sides:
        raise GeometryError(f'side "{name}": the file has a side of this name already')
    for other, taken in sides.items():
        for entity in set(taken) & set(entities):
            raise GeometryError(f"{FACET_WORD[dim]} {entity} is in two sides, {other} and {name}")
    sides[name] = entities


def _select(gmsh: Gmsh, dim: int, name: str, selection: Selection, unit: float) -> list[int]:
    """Tags of the entities that `[geometry.names]` selects for a side; `unit` is that of the model [m]."""
    word, known = FACET_WORD[dim], [int(tag) for _, tag in gmsh.model.getEntities(dim - 1)]
    known = [
        tag for tag in known if len(gmsh.model.mesh.getElementTypes(dim - 1, tag))
    ] or known  # a mesh may list others
    key = f'names."{name}"'
    if isinstance(selection, Mapping):
        box = np.reshape(np.asarray(selection["box"], float), (2, 3)) / unit
        slack = CLOSE * np.ptp(np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3)), axis=0).max()
        points = {tag: _points_on(gmsh, dim - 1, tag) for tag in known}
        inside = [
            tag for tag, x in points.items() if len(x) and np.all(x >= box[0] - slack) and np.all(x <= box[1] + slack)
        ]
        if not inside:
            raise GeometryError(f"{key}: no {word} lies wholly inside the box; see --list")
        return inside
    found = []
    for text in selection:
        match = re.fullmatch(rf"{word} ([0-9]+)", text)
        if match is None or int(match[1]) not in known:
            raise GeometryError(
                f'{key}: "{text}" is not there; expected "{word} {min(known)}" to "{word} {max(known)}", see --list'
            )
        found.append(int(match[1]))
    if not found:
        raise GeometryError(f"{key}: the list is empty")
    return sorted(set(found))


def _points_on(gmsh: Gmsh, dim: int, tag: int) -> Array:
    """Points (n, 3) on an entity; gmsh's bounding boxes are larger, they contain the control points of curves."""
    rows = [np.asarray(nodes, np.int64) for nodes in gmsh.model.mesh.getElements(dim, tag)[2]]
    if rows:
        return nodes_at(gmsh, dim, tag, np.concatenate(rows))
    found = [_points_on(gmsh, dim - 1, t) for _, t in gmsh.model.getBoundary([(dim, tag)], oriented=False) if dim > 1]
    low, high = gmsh.model.getParametrizationBounds(dim, tag)
    if len(low) == dim:
        axes = [np.linspace(a, b, SAMPLES) for a, b in zip(low, high, strict=True)]
        at = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dim)
        if dim == 2:  # the parameters are those of the untrimmed surface
            newer = "parametric" in signature(gmsh.model.isInside).parameters  # it takes coordinates, unless told
            more = (True,) if newer else ()
            at = at[[bool(gmsh.model.isInside(dim, tag, list(x), *more)) for x in at]]
        found.append(np.reshape(gmsh.model.getValue(dim, tag, at.ravel()), (-1, 3)))
    return np.concatenate([np.zeros((0, 3)), *found])


def nodes_at(gmsh: Gmsh, dim: int, tag: int, numbers: Ints) -> Array:
    """Coordinates (..., 3) of nodes, given by tag, of an entity's elements; a file may list them in another entity."""
    known, x, _ = gmsh.model.mesh.getNodes(dim, tag, includeBoundary=True)
    if not np.isin(numbers, known).all():
        known, x, _ = gmsh.model.mesh.getNodes()
    if not np.isin(numbers, known).all():
        raise GeometryError("a cell refers to a node that does not exist")
    order = np.argsort(known)
    at = order[np.searchsorted(np.asarray(known, np.int64)[order], numbers)]
    return np.asarray(np.reshape(x, (-1, 3))[at])
