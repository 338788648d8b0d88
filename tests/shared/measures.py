"""Closed forms of the areas, lengths and volumes of the builders' shapes."""

from math import cos, pi, radians, tan
from typing import Any

from stickslip.geometry.builders.assembly import Assembly, Part


def measures(shape: Any, dim: int) -> dict[str, float]:
    """Body and sides (as body.side) -> volume and areas [m^d, m^(d-1)]."""
    if isinstance(shape, Assembly):
        return {name: size for body, part in shape.parts().items() for name, size in placed(body, part, dim).items()}
    return {
        "block": cuboid,
        "strip": cuboid,
        "half_disc": half_disc,
        "half_ball": half_ball,
        "half_space": half_space,
        "ring": ring,
        "wedge": wedge,
        "sector": sector,
    }[kind(shape)](shape, dim)


def kind(shape: Any) -> str:
    """Its builder's name; a sector is a part of an arch only."""
    return str(getattr(shape, "builder", "sector"))


def placed(body: str, part: Part, dim: int) -> dict[str, float]:
    """A part of an assembly under the names that it has there."""
    own = measures(part.shape, dim)
    ((there, sides),) = part.shape.bodies(dim).items()
    return {body: own[there]} | {f"{body}.{part.renamed.get(n, n)}": own[f"{there}.{n}"] for n in sides}


def cuboid(shape: Any, dim: int) -> dict[str, float]:
    length, width, height = shape.length, shape.width or 1.0, shape.height
    area = {"left": width * height, "front": length * height, "bottom": length * width}
    sides = area | {"right": area["left"], "back": area["front"], "top": area["bottom"]}
    kept = [side for side in sides if dim == 3 or side not in ("front", "back")]
    body = kind(shape)
    return {body: length * width * height} | {f"{body}.{side}": sides[side] for side in kept}


def wedge(shape: Any, dim: int) -> dict[str, float]:
    angle, low, height = radians(shape.half_angle), shape.bottom_width, shape.height
    top = low + 2 * height * tan(angle)
    walls = dict.fromkeys(("wedge.left", "wedge.right"), height / cos(angle))
    return {"wedge": height * (low + top) / 2, "wedge.bottom": low, "wedge.top": top} | walls


def half_disc(shape: Any, dim: int) -> dict[str, float]:
    r, part = shape.radius, 0.5 if shape.symmetric else 1.0
    found = {"disc": part * pi * r**2 / 2, "disc.arc": part * pi * r, "disc.top": part * 2 * r}
    return found | ({"disc.axis": r} if shape.symmetric else {})


def half_ball(shape: Any, dim: int) -> dict[str, float]:
    r, part = shape.radius, 0.25 if shape.symmetry == "quarter" else 1.0
    found = {"ball": part * 2 / 3 * pi * r**3, "ball.cap": part * 2 * pi * r**2, "ball.top": part * pi * r**2}
    planes = dict.fromkeys(("ball.x_plane", "ball.y_plane"), pi * r**2 / 4)
    return found | (planes if shape.symmetry == "quarter" else {})


def half_space(shape: Any, dim: int) -> dict[str, float]:
    size, a = shape.size, shape.contact_half_width
    across = size if shape.symmetric else 2 * size
    top, contact = (across, across * a / size) if dim == 2 else (across**2, pi * a**2)
    side = size if dim == 2 else size * across
    names = (["axis"] if shape.symmetric else ["left"]) + ["right", *(["front", "back"] if dim == 3 else [])]
    found = {"contact": contact, "top": top - contact, "bottom": top} | dict.fromkeys(names, side)
    return {"half_space": top * size} | {f"half_space.{name}": value for name, value in found.items()}


def ring(shape: Any, dim: int) -> dict[str, float]:
    inner, outer, part = shape.inner_radius, shape.outer_radius, shape.angle / 360
    found = {"ring": pi * (outer**2 - inner**2), "ring.inner": 2 * pi * inner, "ring.outer": 2 * pi * outer}
    axes = dict.fromkeys(("ring.x_axis", "ring.y_axis"), outer - inner)
    return {name: part * value for name, value in found.items()} | (axes if shape.angle == 90 else {})


def sector(shape: Any, dim: int) -> dict[str, float]:
    inner, outer, turn = shape.inner_radius, shape.outer_radius, pi * (shape.end - shape.start) / 180
    sides = {"left": outer - inner, "right": outer - inner, "inside": turn * inner, "outside": turn * outer}
    return {"sector": turn * (outer**2 - inner**2) / 2} | {f"sector.{name}": size for name, size in sides.items()}


def bend(shape: Any) -> float:
    """Largest angle [rad] that one cell spans on a circle of the shape: what its facets miss."""
    if isinstance(shape, Assembly):
        return max(bend(part.shape) for part in shape.parts().values())
    radius = {"half_disc": "radius", "half_ball": "radius", "ring": "outer_radius", "sector": "outer_radius"}.get(
        kind(shape)
    )
    if kind(shape) == "half_space":
        return float(shape.fine_size / shape.contact_half_width)  # in 3D its contact part is a disc
    return float(shape.mesh_size / getattr(shape, radius)) if radius else 0.0


def facets_miss(shape: Any) -> float:
    """Bound of the relative error of areas and volumes, theta being the angle that a cell spans; rounding if straight.

    A polygon misses theta^2 / 6 of its disc, more than of its circle; for parabolas the power is four. Twice that:
    gmsh's edges are up to 1.4 times as long as asked.
    """
    return 1e-12 + bend(shape) ** (2 * shape.order) / (3 if shape.order == 1 else 100)
