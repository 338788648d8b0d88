"""Shapes of assemblies [mm], drawn by gmsh: scenes name this file as their geometry, with `kind`, a function of it.

A function draws solids, or plane faces, and returns them by name; those of a name are numbered, if there are several.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

Part = tuple[int, int]  # dimension and tag
Parts = dict[str, list[Part]]
LEFT_RIGHT = (-1, 1)


class Drawing:
    """What is drawn by gmsh's kernel of solids; coordinates [mm]."""

    def __init__(self, occ: Any) -> None:
        self.occ = occ

    def box(self, *limits: float) -> Part:
        """Draw a box between the limits along x, y and z."""
        x, y, z = np.reshape(limits, (3, 2))
        return 3, self.occ.addBox(x[0], y[0], z[0], *np.ptp([x, y, z], axis=1))

    def rod(self, radius: float, low: float, high: float, x: float = 0.0, y: float = 0.0) -> Part:
        """Draw a cylinder along z."""
        return 3, self.occ.addCylinder(x, y, low, 0, 0, high - low, radius)

    def disc(self, radius: float, x: float = 0.0) -> Part:
        """Draw a plane disc."""
        return 2, self.occ.addDisk(x, 0, 0, radius, radius)

    def plate(self, *limits: float) -> Part:
        """Draw a rectangle between the limits along x and y."""
        x, y = np.reshape(limits, (2, 2))
        return 2, self.occ.addRectangle(x[0], y[0], 0, *np.ptp([x, y], axis=1))

    def face(self, points: Sequence[Sequence[float]]) -> Part:
        """Draw a plane polygon."""
        tags = [self.occ.addPoint(*point, 0) for point in points]
        lines = [self.occ.addLine(a, b) for a, b in zip(tags, tags[1:] + tags[:1], strict=True)]
        return 2, self.occ.addPlaneSurface([self.occ.addCurveLoop(lines)])

    def prism(self, points: Sequence[Sequence[float]], height: float) -> Part:
        """Draw a polygon that is extruded along z."""
        made: list[Part] = self.occ.extrude([self.face(points)], 0, 0, height)
        return max(made)

    def cut(self, part: Part, *others: Part) -> Part:
        """Take others away from a part; they go."""
        return self.occ.cut([part], others)[0][0]  # type: ignore[no-any-return]

    def fuse(self, part: Part, *others: Part) -> Part:
        """Make one of several."""
        return self.occ.fuse([part], others)[0][0]  # type: ignore[no-any-return]

    def tube(self, inner: float, outer: float, low: float, high: float) -> Part:
        """Draw a tube along z."""
        return self.cut(self.rod(outer, low, high), self.rod(inner, low, high))

    def bolt(self, radius: float, low: float, high: float, x: float, y: float) -> Part:
        """Draw a bolt along z with its head, from `high` upwards, and its nut, from `low` downwards."""
        head, wide = radius, 2 * radius
        shank = self.rod(radius, low - head, high + head, x, y)
        return self.fuse(shank, self.rod(wide, low - head, low, x, y), self.rod(wide, high, high + head, x, y))

    def bored(self, part: Part, radius: float, places: Sequence[tuple[float, ...]]) -> Part:
        """Bore holes along z."""
        return self.cut(part, *(self.rod(radius, -1e3, 1e3, *place) for place in places))


def clevis(draw: Drawing) -> Parts:
    """A pin with .02 mm of clearance in a clevis and a lug."""
    lug = draw.fuse(draw.box(0, 80, -25, 25, -8, 8), draw.rod(25, -8, 8))
    fork = draw.fuse(draw.box(-90, 0, -25, 25, -18, 18), draw.rod(25, -18, 18))
    fork = draw.cut(fork, draw.box(-70, 30, -26, 26, -9, 9))
    lug, fork = (draw.bored(part, 10.02, [(0, 0)]) for part in (lug, fork))
    return {"lug": [lug], "clevis": [fork], "pin": [draw.rod(10, -20, 20)]}


def hinge(draw: Drawing) -> Parts:
    """A strap between two forks, on pins with .01 mm of clearance."""
    pins = [(28.0 * side, 0.0) for side in LEFT_RIGHT]
    arms = [(sorted((18 * s, 70 * s)), sorted((16 * s, 44 * s))) for s in LEFT_RIGHT]
    forks = [draw.cut(draw.box(*arm, -10, 10, -10, 10), draw.box(*slot, -11, 11, -4.5, 4.5)) for arm, slot in arms]
    parts = [draw.bored(part, 5.01, pins) for part in (draw.box(-40, 40, -10, 10, -4, 4), *forks)]
    return {"strap": parts[:1], "fork": parts[1:], "pin": [draw.rod(5, -11, 11, *pin) for pin in pins]}


def ball(draw: Drawing) -> Parts:
    """A ball on a stem in a deep socket, with .05 mm of clearance."""
    occ = draw.occ
    socket = draw.cut(draw.box(-10, 10, -10, 10, -14, 2), (3, occ.addSphere(0, 0, 0, 8.05)))
    return {"socket": [socket], "ball": [draw.fuse((3, occ.addSphere(0, 0, 0, 8)), draw.rod(4, 0, 20))]}


def blade(draw: Drawing) -> Parts:
    """The dovetail root of a blade in the slot of a disc."""
    root = [(5, 30), (5, -1), (11, -7), (11, -12)]
    slot = [(25, -30), (25, 0), (6, 0), (6, -2), (12, -8), (12, -14)]
    blade, disc = (draw.prism(half + [(-x, y) for x, y in half[::-1]], 20) for half in (root, slot))
    return {"blade": [blade], "disc": [disc]}


def wedge(draw: Drawing) -> Parts:
    """A wedge of 8 degrees between a block and a wall."""
    slope = np.tan(np.radians(8))
    block = draw.prism([(10, 0), (40, 0), (40, 40), (10 + 40 * slope, 40)], 20)
    driven = draw.prism([(0, 0), (10, 0), (10 + 42 * slope, 42), (0, 42)], 20)
    return {"wedge": [driven], "block": [block], "wall": [draw.box(-30, 0, 0, 40, 0, 20)]}


def flange(draw: Drawing) -> Parts:
    """Two flanged tubes with a gasket between them, four bolts in holes with .3 mm of clearance."""
    places = list(product((-29.0, 29.0), repeat=2))
    lower = draw.fuse(draw.tube(15, 50, 0, 10), draw.tube(15, 22, -20, 1))
    upper = draw.fuse(draw.tube(15, 50, 12, 22), draw.tube(15, 22, 21, 42))
    lower, upper = (draw.bored(part, 4.3, places) for part in (lower, upper))
    bolts = [draw.bolt(4, 0, 22, *place) for place in places]
    return {"lower": [lower], "upper": [upper], "gasket": [draw.tube(20, 32, 10, 12)], "bolt": bolts}


def lap(draw: Drawing) -> Parts:
    """Two plates, four bolts in holes with .3 mm of clearance."""
    places = list(product((-10.0, 10.0), (-12.0, 12.0)))
    plates = (draw.box(-80, 20, -25, 25, 0, 8), draw.box(-20, 80, -25, 25, 8, 16))
    bolts = [draw.bolt(4, 0, 16, *place) for place in places]
    return {"plate": [draw.bored(plate, 4.3, places) for plate in plates], "bolt": bolts}


def rings(draw: Drawing) -> Parts:
    """A ring that is .02 mm too large is pressed into another one."""
    return {"inner": [draw.tube(12, 20.02, 0, 16)], "outer": [draw.tube(20, 30, -5, 15)]}


def base(draw: Drawing) -> Parts:
    """A column on a base plate, held to concrete by four anchors with feet."""
    places = list(product((-45.0, 45.0), repeat=2))
    anchors, holes = ([draw.bolt(6, -60, 12, *place) for place in places] for _ in range(2))
    plate = draw.bored(draw.box(-60, 60, -60, 60, 0, 12), 6.5, places)
    concrete = draw.cut(draw.box(-90, 90, -90, 90, -90, 0), *holes)
    column = draw.fuse(plate, draw.box(-20, 20, -20, 20, 11, 80))
    return {"concrete": [concrete], "column": [column], "anchor": anchors}


def chain(draw: Drawing) -> Parts:
    """Four links through each other, each across the next; of the first and the last one half."""
    links = [(3, draw.occ.addTorus(14 * k, 0, 0, 10, 3)) for k in range(4)]
    draw.occ.rotate(links[1::2], 0, 0, 0, 1, 0, 0, np.pi / 2)
    links[0] = draw.cut(links[0], draw.box(-20, 0, -20, 20, -20, 20))
    links[3] = draw.cut(links[3], draw.box(42, 62, -20, 20, -20, 20))
    return {"link": links}


def bearing(draw: Drawing) -> Parts:
    """Eight balls in the grooves of two rings."""
    angles = 2 * np.pi * np.arange(8) / 8
    balls = [(3, draw.occ.addSphere(18 * np.cos(angle), 18 * np.sin(angle), 0, 4)) for angle in angles]
    outer = draw.cut(draw.tube(20.5, 28, -9, 6), (3, draw.occ.addTorus(0, 0, 0, 17.8, 4.2)))
    inner = draw.cut(draw.tube(8, 15.5, -6, 9), (3, draw.occ.addTorus(0, 0, 0, 18.2, 4.2)))
    return {"inner": [inner], "outer": [outer], "ball": balls}


def gears(draw: Drawing) -> Parts:
    """Two gears of twelve teeth, of which one turns the other; plane."""
    count, module, angle, play = 12, 4.0, np.radians(20), 0.01
    pitch = count * module / 2
    radii = np.linspace(pitch * np.cos(angle), pitch + module, 8)
    turned = np.arccos(radii[0] / radii)
    half = np.pi / count / 2 - play / 2 + (np.tan(angle) - angle) - (np.tan(turned) - turned)
    radii, half = np.append(pitch - 1.25 * module, radii), np.append(half[0], half)
    tooth = np.concatenate([radii * np.exp(-1j * half), radii[::-1] * np.exp(1j * half[::-1])])

    def gear(x: float, turn: float) -> Part:
        points = np.concatenate([tooth * np.exp(1j * (2 * np.pi * k / count + turn)) for k in range(count)]) + x
        return draw.cut(draw.face(np.column_stack([points.real, points.imag]).tolist()), draw.disc(8, x))

    return {"gear": [gear(0.0, 0.0), gear(2 * pitch, np.pi / count + play)]}


def drum(draw: Drawing) -> Parts:
    """A band half around a drum; plane."""
    around = draw.fuse(draw.disc(53), draw.plate(-53, 53, -50, 0))
    band = draw.cut(around, draw.disc(50), draw.plate(-50, 50, -60, 0), draw.plate(49, 60, -60, -40))
    return {"drum": [draw.cut(draw.disc(50), draw.disc(20))], "band": [band]}


def arch(draw: Drawing) -> Parts:
    """Forty dry stones over a right angle; plane."""
    ends = np.exp(1j * np.pi * np.linspace(0.75, 0.25, 41))
    corners = np.stack([2000 * ends[:-1], 2300 * ends[:-1], 2300 * ends[1:], 2000 * ends[1:]], axis=1)
    return {"stone": [draw.face(np.column_stack([each.real, each.imag]).tolist()) for each in corners]}


def wall(draw: Drawing) -> Parts:
    """Two hundred dry stones in twenty courses on the ground; plane."""
    places = [(200 * k + 50 * (-1) ** course, 100 * course) for course in range(20) for k in range(10)]
    stones = [draw.plate(x, x + 200, y, y + 100) for x, y in places]
    return {"stone": stones, "ground": [draw.plate(-200, 2200, -200, 0)]}


def logs(draw: Drawing) -> Parts:
    """Two logs in a tray with .3 mm of room to each side and .4 mm between them, a third one on both; plane."""
    tray = draw.cut(draw.plate(-25, 25, -5, 30), draw.plate(-20.5, 20.5, 0, 31))
    places = [(-10.2, 10.0), (10.2, 10.0), (0.0, 10.0 + np.sqrt(20**2 - 10.2**2))]
    return {"tray": [tray], "log": [(2, draw.occ.addDisk(x, y, 0, 10, 10)) for x, y in places]}


def cone(draw: Drawing) -> Parts:
    """A plug in a bush, both with a cone of 2.9 degrees, pushed into it."""
    occ = draw.occ
    bush = draw.cut(draw.rod(20, 0, 20), (3, occ.addCone(0, 0, -1, 0, 0, 24, 9.8, 12.2)))
    return {"bush": [bush], "plug": [(3, occ.addCone(0, 0, -3.5, 0, 0, 28, 9.45, 12.25))]}


def cross(draw: Drawing) -> Parts:
    """The cross of a universal joint in two yokes, with .02 mm of clearance."""
    occ = draw.occ
    pins = draw.fuse(draw.rod(4, -16, 16), (3, occ.addCylinder(-16, 0, 0, 32, 0, 0, 4)))
    lower = draw.fuse(*(draw.box(-6, 6, *yz) for yz in ((-8, 8, 8, 16), (-8, 8, -16, -8), (-24, -8, -16, 16))))
    upper = draw.fuse(*(draw.box(*xy, -6, 6) for xy in ((8, 16, -8, 8), (-16, -8, -8, 8), (-16, 16, 8, 24))))
    upper = draw.cut(upper, (3, occ.addCylinder(-30, 0, 0, 60, 0, 0, 4.02)))
    return {"cross": [pins], "yoke": [draw.bored(lower, 4.02, [(0, 0)]), upper]}


def build(model: Any, parameters: dict[str, Any]) -> None:
    """Draw the shape that the parameter `kind` names."""
    parts: Parts = globals()[parameters["kind"]](Drawing(model.occ))
    model.occ.synchronize()
    for name, found in parts.items():
        for number, (dim, tag) in enumerate(found, start=1):
            group = model.addPhysicalGroup(dim, [tag])
            model.setPhysicalName(dim, group, f"{name}_{number}" if len(found) > 1 else name)
