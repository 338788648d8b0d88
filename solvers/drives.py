"""Every value in time that a scene contains, by its place in the scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from geometry.amplitude import Amplitude
from solvers.effects.friction import Tresca
from solvers.nouns.scene import Scene


class Place(NamedTuple):
    """supports.top.displacement.x, loads.side.pressure, obstacles.roller.rotation.angle."""

    table: str
    name: str
    quantity: str
    component: str = ""

    def __str__(self) -> str:
        return ".".join(word for word in self if word)


Change = Callable[[Place, Amplitude], Amplitude]


def drives(scene: Scene) -> dict[Place, Amplitude]:
    """All of them."""
    found: dict[Place, Amplitude] = {}
    over(scene, lambda place, amplitude: found.setdefault(place, amplitude))
    return found


def over(scene: Scene, change: Change) -> Scene:
    """The scene with every value in time changed."""

    def parts(table: str, name: str, quantity: str, values: Mapping[Any, Amplitude]) -> dict[Any, Amplitude]:
        return {axis: change(Place(table, name, quantity, axis), a) for axis, a in values.items()}

    def vector(table: str, name: str, quantity: str, values: tuple[Amplitude, ...]) -> tuple[Amplitude, ...]:
        return tuple(parts(table, name, quantity, dict(zip("xyz", values, strict=False))).values())

    supports = {
        name: replace(support, displacement=parts("supports", name, "displacement", support.displacement))
        for name, support in scene.supports.items()
    }
    loads, obstacles, contacts, sections = {}, {}, dict(scene.contacts), dict(scene.sections)
    for name, load in scene.loads.items():
        vectors = {key: getattr(load, key) for key in ("traction", "force")}
        new: dict[str, Any] = {key: vector("loads", name, key, v) for key, v in vectors.items() if v is not None}
        if load.pressure is not None:
            new["pressure"] = change(Place("loads", name, "pressure"), load.pressure)
        loads[name] = replace(load, **new)
    for name, obstacle in scene.obstacles.items():
        new = {key: parts("obstacles", name, key, getattr(obstacle, key)) for key in ("displacement", "force")}
        if obstacle.rotation is not None:
            angle = change(Place("obstacles", name, "rotation", "angle"), obstacle.rotation.angle)
            new["rotation"] = replace(obstacle.rotation, angle=angle)
        obstacles[name] = replace(obstacle, **new)
    for name, contact in scene.contacts.items():
        if isinstance(contact.friction, Tresca):
            bound = change(Place("contacts", name, "friction", "bound"), contact.friction.bound)
            contacts[name] = replace(contact, friction=replace(contact.friction, bound=bound))
    if "gravity" in sections:
        acceleration = vector("gravity", "", "acceleration", sections["gravity"].acceleration)
        sections["gravity"] = replace(sections["gravity"], acceleration=acceleration)
    return replace(scene, supports=supports, loads=loads, obstacles=obstacles, contacts=contacts, sections=sections)
