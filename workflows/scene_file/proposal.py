"""A scene for an assembly that has none yet: names of bodies and sides, contacts, sizes, and a first load."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import GeometryError
from stickslip.geometry.shape import Model
from stickslip.geometry.user_files.open_file import declared_unit
from stickslip.geometry.user_files.outline import Outline
from stickslip.geometry.user_files.parts import FACET_WORD, numbered
from stickslip.geometry.user_files.touching import Pair, Side, named, touching
from stickslip.geometry.user_files.user_file import UserFile

THREADED = ("nut", "mutter", "din934", "iso4032")  # ends of words in names of bodies that have a thread
BONDED = ("weld", "glue", "adhesive", "bond", "solder")
ENDS = {2: ("left", "right", "bottom", "top"), 3: ("left", "right", "front", "back", "bottom", "top")}
LARGE = 0.3  # of the assembly's diagonal: bodies whose ends get names
GRAVITY = 9.81  # [m/s^2]
POINTS = {2: 100, 3: 600}  # of contact
ACROSS = 2  # cells across the smallest pair, at least
LONGEST = 3  # bodies in the name of a side


@dataclass(frozen=True, eq=False)
class Assembly:
    """What is found in a geometry file."""

    path: Path
    geometry: UserFile
    model: Model
    outline: Outline
    pairs: tuple[Pair, ...]

    @property
    def dim(self) -> int:
        return 3 if self.model == "3d" else 2


def assembly(path: Path, unit: str | None, within: float | None) -> Assembly:
    """Read a geometry file, solid or plane.

    Args:
        unit: of its coordinates; None: mm of a STEP file, else m.
        within: distance up to which sides are paired [m]; None: see `touching`.

    Raises:
        GeometryError, SceneError: the file is missing or wrong.
    """
    length_unit = unit or declared_unit(path) or "m"
    geometry = UserFile(file=str(path), length_unit=length_unit)  # type: ignore[arg-type]  # is checked
    try:
        return from_geometry(path, geometry, "3d", within)
    except GeometryError as error:
        if "a 3d model is made of them" not in str(error):
            raise
    return from_geometry(path, geometry, "plane strain", within)


def from_geometry(path: Path, geometry: UserFile, model: Model, within: float | None) -> Assembly:
    """The pairs of a geometry whose model is known."""
    dim = 3 if model == "3d" else 2
    outline = geometry.outline(dim)
    return Assembly(path, geometry, model, outline, tuple(touching(outline, dim, within)))


def proposed_law(pair: Pair) -> tuple[str, str]:
    """The law that a pair probably has, `tied` or `unilateral`, and why."""
    words = [word for side in (pair.one, pair.other) for word in side.body.split("_")]
    if pair.kind == "cylinder" and pair.exact and pair.fit <= 0 and any(word.endswith(THREADED) for word in words):
        return "tied", "threaded, by the name of a body"
    if any(word.startswith(BONDED) for word in words):
        return "tied", "bonded, by the name of a body"
    return "unilateral", ""


def scene_text(found: Assembly, target: Path) -> str:
    """TOML of a scene that can be run.

    Args:
        target: where it will be written, for the path of the geometry's file.
    """
    names, ends, word = side_names(found), _ends(found), FACET_WORD[found.dim]
    size, fine = sizes(found)
    lines = [
        f"# Written by `stickslip new --from {found.path.name}`. Materials, laws, sizes, support and load are first",
        "# proposals. Sides are named after the bodies that they touch; `stickslip contacts` draws each pair.",
        f"title = {json.dumps(f'Assembly {found.path.name}')}",
        f'model = "{found.model}"',
        "",
        "[geometry]",
        f"file = {json.dumps(_relative(found.path, target))}",
        f'length_unit = "{found.geometry.length_unit}"',
        *(
            []
            if size is None
            else [f"# mesh_size = {size:.3g}  # what it is without this key, but smaller on curved faces"]
        ),
        *([] if fine is None else [f"contact_mesh_size = {fine:.3g}"]),
    ]
    new = {side: name for side, name in {**names, **ends}.items() if not side.name}
    lines += ["", "[geometry.names]"] if new else []
    lines += [f'"{name}" = {json.dumps([f"{word} {number}" for number in side.numbers])}' for side, name in new.items()]
    lines += ["", "[bodies]  # steel"]
    lines += [f"{body} = {{ E = 210e9, nu = 0.3, density = 7850.0 }}" for body in found.outline.bodies]
    labels = numbered(f"{pair.one.body}_{pair.other.body}" for pair in found.pairs)
    for pair, label, slave in zip(found.pairs, labels, slaves(found.pairs), strict=True):
        lines += ["", *_contact(pair, label, slave, names)]
    lines += ["", "# where it is held, and what loads it: to begin with, its weight presses the largest of the planes"]
    down = _downwards(found)
    if ends:
        side = max(ends, key=lambda side: (side.form.kind == "plane" and side.form.axis @ down > 0, side.area))
        held = ", ".join(f"{axis} = 0.0" for axis in "xyz"[: found.dim])
        lines += ["[supports.base]", f'boundary = "{ends[side]}"', f"displacement = {{ {held} }}", ""]
    pull = ", ".join(f"{x:.4g}" for x in down[: found.dim])
    lines += ["[gravity]", f"acceleration = [{pull}]"]
    return "\n".join(lines) + "\n"


def _contact(pair: Pair, label: str, slave: Side | None, names: Mapping[Side, str]) -> list[str]:
    """The table of a contact."""
    one, other = (pair.other, pair.one) if slave is pair.other else (pair.one, pair.other)
    if slave is None:
        return [f"# {names[one]} and {names[other]}: left out, each is the slave of another contact; split one of them"]
    law, why = proposed_law(pair)
    lines = [f"[contacts.{label}]", f'surface = "{names[one]}"', f'against = "{names[other]}"']
    if law == "tied":
        return [*lines, f'normal = {{ law = "tied" }}  # {why}']
    lines.append('friction = { law = "coulomb", mu = 0.2 }')
    return [*lines, f"gap = {pair.fit:.6g}  # of the exact shapes"] if pair.exact else lines


def side_names(found: Assembly) -> dict[Side, str]:
    """Names of the sides of all pairs, as body.side: those of the file, or after the bodies that they meet."""
    meets: dict[Side, list[str]] = {}
    for pair in found.pairs:
        meets.setdefault(pair.one, []).append(pair.other.body)
        meets.setdefault(pair.other, []).append(pair.one.body)
    taken = [side for side in meets if not side.name]
    labels = numbered([*_names(found.outline), *(f"{side.body}.{_to(meets[side])}" for side in taken)])
    named = dict(zip(taken, labels[len(labels) - len(taken) :], strict=True))
    return {side: side.name or named[side] for side in meets}


def _names(outline: Outline) -> list[str]:
    return [f"{body}.{side}" for body, sides in outline.bodies.items() for side in sides]


def _to(bodies: Sequence[str]) -> str:
    """
    >>> _to(["nut"]), _to(["a", "b", "c", "d"])
    ('to_nut', 'to_a_b_and_2_more')
    """
    different = list(dict.fromkeys(bodies))
    if len(different) <= LONGEST:
        return "to_" + "_".join(different)
    return f"to_{'_'.join(different[: LONGEST - 1])}_and_{len(different) - LONGEST + 1}_more"


def slaves(pairs: Sequence[Pair]) -> list[Side | None]:
    """Which side of each pair carries the tractions: each side in one pair at most, small sides rather than large ones.

    None where that is impossible.
    """
    sides = list(dict.fromkeys(side for pair in pairs for side in (pair.one, pair.other)))
    if not pairs:
        return []
    largest = max(side.area for side in sides)
    never = 2.0 * len(pairs)
    cost = np.full((len(pairs), len(sides) + len(pairs)), never)  # the last columns: a pair without a slave
    for k, pair in enumerate(pairs):
        for side in (pair.one, pair.other):
            cost[k, sides.index(side)] = side.area / largest
    chosen = linear_sum_assignment(cost)[1]
    return [sides[c] if cost[k, c] < never else None for k, c in enumerate(chosen)]


def sizes(found: Assembly) -> tuple[float | None, float | None]:
    """Edge lengths [m] of cells, and of those where bodies meet; None where the file has its own mesh or sizes."""
    size, dim = found.geometry.size(found.dim), found.dim
    if size is None or not found.pairs:
        return size, None
    area = sum(pair.area for pair in found.pairs)
    smallest = min(pair.area for pair in found.pairs)
    fine = min((area / POINTS[dim]) ** (1 / (dim - 1)), smallest ** (1 / (dim - 1)) / ACROSS)
    return size, fine if fine < size else None


def _ends(found: Assembly) -> dict[Side, str]:
    """Sides that touch nothing, with their names: those of the file, and flat ends of large bodies along the axes."""
    outline, dim = found.outline, found.dim
    whole = float(np.linalg.norm(np.ptp(outline.box, axis=0)))
    used = {n for pair in found.pairs for side in (pair.one, pair.other) for n in side.numbers} | outline.side_of.keys()
    met, taken = {side.name for pair in found.pairs for side in (pair.one, pair.other)}, _names(outline)
    ends = {named(name, outline, dim): name for name in taken if name not in met}
    for body in outline.bodies:
        faces = [face for face in outline.entities if face.bodies == (body,)]
        if not faces:
            continue
        boxes = np.array([face.box for face in faces])
        low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        if np.linalg.norm(high - low) < LARGE * whole:
            continue
        for number, word in enumerate(ENDS[dim]):
            axis, upper = divmod(number, 2)
            near = np.abs(boxes[:, :, axis] - (high if upper else low)[axis]).max(axis=1) <= 1e-6 * whole
            flat = tuple(face for face, at_end in zip(faces, near, strict=True) if at_end and face.number not in used)
            if flat and f"{body}.{word}" not in taken:
                ends[Side.of(body, flat, dim)] = f"{body}.{word}"
    return ends


def _downwards(found: Assembly) -> Array:
    """Gravity (3,) [m/s^2] that presses the largest of the plane pairs; without any, along the last axis."""
    flat = [pair for pair in found.pairs if pair.kind == "plane"]
    down = max(flat, key=lambda pair: pair.area).one.form.axis if flat else -np.eye(3)[found.dim - 1]
    return np.asarray((GRAVITY * down).round(6) + 0.0)


def _relative(path: Path, target: Path) -> str:
    """The geometry's file as the scene names it: relative if it lies beside the scene or below."""
    absolute, folder = path.absolute(), target.absolute().parent
    inside = os.path.commonpath([absolute, folder]) == str(folder)
    return os.path.relpath(absolute, folder) if inside else str(absolute)
