"""A scene for an assembly that has none yet: names of bodies and sides, contacts, sizes, and a first load."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from stickslip.geometry.arrays import CLOSE, SLIGHT, Array
from stickslip.geometry.errors import GeometryError
from stickslip.geometry.shape import Model
from stickslip.geometry.units import LENGTHS, Units
from stickslip.geometry.user_files.open_file import declared_unit
from stickslip.geometry.user_files.outline import Outline
from stickslip.geometry.user_files.parts import FACET_WORD, numbered
from stickslip.geometry.user_files.touching import WITHIN, Pair, Side, named, touching
from stickslip.geometry.user_files.user_file import AROUND, UserFile
from stickslip.workflows.formats.templates import render

THREADED = ("nut", "mutter", "din934", "iso4032")  # ends of words in names of bodies that have a thread
BONDED = ("weld", "glue", "adhesive", "bond", "solder")
ENDS = {2: ("left", "right", "bottom", "top"), 3: ("left", "right", "front", "back", "bottom", "top")}
ASIDE = 0.7  # largest cosine of the angle between an axis and a cylinder's
STEEL, STEEL_SI = ((210e9, "Pa"), (7850.0, "kg/m³")), ("210e9", "7850.0")  # E and density
POINTS = {2: 100, 3: 600}  # of contact
LONGEST = 3  # bodies in the name of a side


@dataclass(frozen=True, eq=False)
class Assembly:
    """Bodies and pairs that are found in a geometry file."""

    path: Path
    geometry: UserFile
    model: Model
    units: Units
    outline: Outline
    pairs: tuple[Pair, ...]

    @property
    def dim(self) -> int:
        return 3 if self.model == "3d" else 2


def assembly(path: Path, unit: str | None, within: float | None, units: str = "SI") -> Assembly:
    """Read a geometry file, solid or plane.

    Args:
        unit: of its coordinates; None: mm of a STEP file, else that of the scene.
        within: distance up to which sides are paired, in the scene's unit; None: see `touching`.
        units: of the scene.

    Raises:
        GeometryError, SceneError: the file is missing or wrong.
    """
    of = Units.of(units)
    length_unit = unit or declared_unit(path) or (of.length if of.length in LENGTHS else None)
    geometry = UserFile(file=str(path), length_unit=length_unit).measured_in(of)  # type: ignore[arg-type]  # is checked
    try:
        return from_geometry(path, geometry, "3d", of, within)
    except GeometryError as error:
        if "a 3d model is made of them" not in str(error):
            raise
    return from_geometry(path, geometry, "plane strain", of, within)


def from_geometry(path: Path, geometry: UserFile, model: Model, units: Units, within: float | None) -> Assembly:
    """The pairs of a geometry whose model is known."""
    dim = 3 if model == "3d" else 2
    outline = geometry.outline(dim)
    return Assembly(path, geometry, model, units, outline, tuple(touching(outline, dim, within)))


def proposed_law(pair: Pair, found: Assembly) -> tuple[str, str]:
    """The law that a pair probably has, `tied` or `unilateral`, and why."""
    words = [word for side in (pair.one, pair.other) for word in side.body.split("_")]
    if pair.kind == "cylinder" and pair.exact and pair.fit <= 0:
        if any(word.endswith(THREADED) for word in words):
            return "tied", "threaded, by the name of a body"
        if _is_nut(pair, found):
            return "tied", "threaded, by the shape of a nut"
    if any(word.startswith(BONDED) for word in words):
        return "tied", "bonded, by the name of a body"
    return "unilateral", ""


def _is_nut(pair: Pair, found: Assembly) -> bool:
    """Whether the body around is a small one, without a gap on the shaft, that is pressed by planes alone.

    Its outer radius is at most 2.5 times that of its bore.
    """
    bore = min((pair.one, pair.other), key=lambda side: side.form.radius)
    shaft = pair.other if bore is pair.one else pair.one
    others = [
        p
        for p in found.pairs
        if bore.body in (p.one.body, p.other.body) and shaft.body not in (p.one.body, p.other.body)
    ]
    if not others or any(p.kind != "plane" for p in others):
        return False
    corners = np.concatenate([f.corners.reshape(-1, 3) for f in found.outline.entities if f.bodies == (bore.body,)])
    outer = np.linalg.norm(np.cross(corners - bore.form.point, bore.form.axis), axis=1).max()
    return bool(outer <= -2.5 * bore.form.radius)


@dataclass(frozen=True, eq=False)
class Bolt:
    """A body with a thread in a nut, and two planes between which it clamps."""

    body: str
    nuts: tuple[str, ...]
    ends: tuple[Array, Array]  # (3,) on its axis, between the planes [m]
    force: float  # [N]
    why: str


def bolts(found: Assembly) -> list[Bolt]:
    """Bodies that are probably bolts: their threads are in nuts, and head and nut, or two nuts, press on planes."""
    nuts: dict[Side, list[str]] = {}
    for pair in found.pairs:
        if proposed_law(pair, found)[1].startswith("threaded"):
            bore, shank = sorted((pair.one, pair.other), key=lambda side: side.form.radius)
            nuts.setdefault(shank, []).append(bore.body)
    listed, size = [], float(np.linalg.norm(np.ptp(found.outline.box, axis=0)))
    for shank, own in nuts.items():
        axis, at = shank.form.axis * np.sign(shank.form.axis.sum() or 1.0), shank.form.point
        pressed = [
            (side.body, float((side.form.point - at) @ axis))
            for pair in found.pairs
            for side, other in ((pair.one, pair.other), (pair.other, pair.one))
            if pair.kind == "plane" and side.body in (shank.body, *own) and other.body not in (shank.body, *own)
            if abs(abs(side.form.axis @ axis) - 1) < SLIGHT
        ]
        levels = [level for _, level in pressed]
        if not levels or max(levels) == min(levels):
            continue
        # half of the grip, in its middle, is shortened: there nothing but tension acts on the bolt
        middle, half = (max(levels) + min(levels)) / 2, (max(levels) - min(levels)) / 4
        headed = any(body == shank.body for body, _ in pressed)
        area = np.pi * shank.form.radius**2
        listed.append(
            Bolt(
                body=shank.body,
                nuts=tuple(own),
                ends=(_rounded(at + (middle - half) * axis, size), _rounded(at + (middle + half) * axis, size)),
                force=float(area * found.units.amount(100e6 if headed else 10e6, "Pa", "--units")),
                why="head and nut" if headed else "between nuts",
            )
        )
    return listed


def _rounded(point: Array, size: float) -> Array:
    """A point of an assembly of a size, without what is rounding."""
    return np.asarray((point / size).round(9) * size + 0.0)


def scene_text(found: Assembly, target: Path, units: str = "SI") -> str:
    """TOML of a scene that can be run.

    Args:
        target: where it will be written, for the path of the geometry's file.
        units: of the scene.

    Raises:
        SceneError: the units are not known, so that there are no numbers of steel in them.
    """
    steel = [f"{found.units.amount(value, of, '--units'):.6g}" for value, of in STEEL] if units != "SI" else STEEL_SI
    names, ends, word = side_names(found), _ends(found), FACET_WORD[found.dim]
    size, fine = sizes(found)
    new = {side: name for side, name in {**names, **ends}.items() if not side.name}
    every = len(found.pairs) > 10  # then they are one contact
    if every:
        new = {side: name for side, name in ends.items() if not side.name}
    labels = numbered(f"{pair.one.body}_{pair.other.body}" for pair in found.pairs)
    held, down, why = _held(found, list(ends))
    return render(
        "scene_file/templates/assembly.toml",
        text=json.dumps,
        name=found.path.name,
        model=found.model,
        units=units,
        file=_relative(found.path, target),
        length_unit=found.geometry.length_unit,
        size="" if size is None else f"{size:.3g}",
        fine="" if fine is None else f"{fine:.3g}",
        sides=[(name, [f"{word} {number}" for number in side.numbers]) for side, name in new.items()],
        bodies=found.outline.bodies,
        steel=steel,
        contacts=[
            _contact(pair, label, slave, names, found)
            for pair, label, slave in zip(found.pairs, labels, slaves(found.pairs), strict=True)
            if not every
        ],
        between=_between(found) if every else {},
        bolts=_bolts(found),
        why=why,
        held=ends[held] if held else "",
        axes="xyz"[: found.dim],
        pull=", ".join(f"{x:.4g}" for x in down[: found.dim]),
    )


def _bolts(found: Assembly) -> list[dict[str, str]]:
    """Return the numbers of each bolt as text, ready to tighten."""
    return [
        {
            "body": bolt.body,
            "ends": ", ".join(f"[{', '.join(f'{x:.6g}' for x in end)}]" for end in bolt.ends),
            "force": f"{bolt.force:.3g}",
            "why": bolt.why,
        }
        for bolt in (bolts(found) if found.dim == 3 else ())
    ]


def _contact(pair: Pair, label: str, slave: Side, names: Mapping[Side, str], found: Assembly) -> dict[str, Any]:
    """Return the words and numbers of a contact's table."""
    one, other = (pair.other, pair.one) if slave is pair.other else (pair.one, pair.other)
    law, why = proposed_law(pair, found)
    gap = f"{pair.fit:.6g}" if pair.exact else ""
    return {"label": label, "one": names[one], "other": names[other], "law": law, "why": why, "gap": gap}


def _between(found: Assembly) -> dict[str, Any]:
    """Return the words and numbers of one contact between all bodies, and of the pairs that differ."""
    of_bodies, bodies = dict[tuple[str, str], list[Pair]](), [*found.outline.bodies]
    for pair in found.pairs:
        one, other = sorted((pair.one.body, pair.other.body), key=bodies.index)
        of_bodies.setdefault((one, other), []).append(pair)
    gaps, chords, pairs = dict[tuple[str, str], str](), [0.0], dict[str, dict[str, str]]()
    for both, meeting in of_bodies.items():
        tied = [said for kind, said in (proposed_law(pair, found) for pair in meeting) if kind == "tied"]
        if tied:
            pairs[".".join(both)] = {"law": "tied", "why": tied[0]}
            continue
        fits = {f"{pair.fit:.6g}" for pair in meeting}
        gaps[both] = fits.pop() if len(fits) == 1 and all(pair.exact for pair in meeting) else ""
        # twice by how much chords of the cells on a circle, of both sides, leave it
        chords += [2 * (1 - np.cos(np.pi / AROUND)) * abs(p.one.form.radius) for p in meeting if p.kind == "cylinder"]
    usual = max(dict.fromkeys(gaps.values()), key=[*gaps.values()].count, default="")
    for both, gap in gaps.items():
        if gap != usual and gap:
            pairs[".".join(both)] = {"law": "", "gap": gap}
    reach = max(WITHIN * float(np.linalg.norm(np.ptp(found.outline.box, axis=0))), *chords)
    return {"count": len(found.pairs), "gap": usual, "reach": f"{reach:.3g}", "pairs": pairs}


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


def slaves(pairs: Sequence[Pair]) -> list[Side]:
    """Which side of each pair carries the tractions: each side in one pair, where that can be, and small ones first."""
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
    return [sides[c] if cost[k, c] < never else pairs[k].one for k, c in enumerate(chosen)]


def sizes(found: Assembly) -> tuple[float | None, float | None]:
    """Edge lengths [m] of cells, and of those where bodies meet, two at least across a pair.

    None where the file has its own mesh or sizes.
    """
    size, dim = found.geometry.size(found.dim), found.dim
    if size is None or not found.pairs:
        return size, None
    areas = [pair.area for pair in found.pairs if pair.area > 0]  # not of those that touch in a point alone
    if not areas:
        return size, None
    area, smallest = sum(areas), min(areas)
    fine = min((area / POINTS[dim]) ** (1 / (dim - 1)), smallest ** (1 / (dim - 1)) / 2)
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
        if np.linalg.norm(high - low) < 0.3 * whole:
            continue
        for number, word in enumerate(ENDS[dim]):
            axis, upper = divmod(number, 2)
            near = np.abs(boxes[:, :, axis] - (high if upper else low)[axis]).max(axis=1) <= CLOSE * whole
            flat = tuple(face for face, at_end in zip(faces, near, strict=True) if at_end and face.number not in used)
            if flat and f"{body}.{word}" not in taken:
                ends[Side.of(body, flat, dim)] = f"{body}.{word}"
    return ends


def _held(found: Assembly, ends: Sequence[Side]) -> tuple[Side | None, Array, str]:
    """The side that is held, if there is one, gravity (3,) [m/s²], and what its weight does.

    It presses the largest of the plane pairs if the lower body of the two is held; without a plane it acts across the
    axis of the largest of the cylinders.
    """
    small = {name for bolt in bolts(found) for name in (bolt.body, *bolt.nuts)}
    flat = [pair for pair in found.pairs if pair.kind == "plane"]
    round_ = [pair for pair in found.pairs if pair.kind == "cylinder"]
    ways = [(-np.eye(3)[found.dim - 1], "")]  # directions of gravity, and the body that it presses on
    why = "its weight"
    if flat:
        pair, why = max(flat, key=lambda pair: pair.area), "its weight presses the largest of the planes"
        ways = [(pair.one.form.axis, pair.other.body), (-pair.one.form.axis, pair.one.body)]
    elif round_:
        along = max(round_, key=lambda pair: pair.area).one.form.axis
        across = [axis for axis in np.eye(3)[: found.dim][::-1] if abs(axis @ along) < ASIDE]
        ways, why = [(-across[0], "")], "its weight acts across the largest of the cylinders"

    def fits(way: tuple[Array, str], side: Side) -> tuple[bool, bool, bool, bool, float]:
        down, lower = way
        below = bool(side.form.kind == "plane" and side.form.axis @ down > ASIDE)
        return side.body not in small, side.body == lower, bool(down[found.dim - 1] <= 0), below, side.area

    choices = [(way, side) for way in ways for side in ends]
    (down, _), held = max(choices, key=lambda choice: fits(*choice)) if choices else (ways[0], None)
    return held, np.asarray((found.units.amount(9.81, "m/s²", "--units") * down).round(6) + 0.0), why


def _relative(path: Path, target: Path) -> str:
    """The geometry's file as the scene names it: relative if it lies beside the scene or below."""
    absolute, folder = path.absolute(), target.absolute().parent
    inside = os.path.commonpath([absolute, folder]) == str(folder)
    return os.path.relpath(absolute, folder) if inside else str(absolute)
