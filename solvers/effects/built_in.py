"""Effects without a table of their own: rows of the plan that contacts, bodies and steps of the scene switch on."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import get_args, get_type_hints

from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.laws import FrictionLaw, NormalLaw
from stickslip.solvers.scene.material import Orthotropic
from stickslip.solvers.scene.scene import Scene


class Row(Effect):
    """An effect whose work is done elsewhere: here are the keys that switch it on, and what it adds."""

    def __init__(
        self, name: str, keys: Callable[[Scene], Iterable[str]], adds: Callable[[Scene], str] = lambda scene: ""
    ) -> None:
        self.name, self._keys, self._adds = name, keys, adds  # type: ignore[misc]

    def because(self, scene: Scene) -> str | None:
        return ", ".join(self._keys(scene)) or None

    def adds(self, scene: Scene) -> str:
        return self._adds(scene)


def _with_law(key: str, kind: type[object], scene: Scene) -> Iterable[str]:
    """Keys of the contacts with a law of a kind under a key, which is `normal` or `friction`."""
    changes = {
        f'{name}.pairs."{pair}"': change for name, c in scene.contacts.items() for pair, change in c.pairs.items()
    }
    tables = {**scene.contacts, **changes}.items()
    return (f"contacts.{name}.{key}" for name, c in tables if isinstance(getattr(c, key), kind))


def _of_friction(scene: Scene) -> str:
    """Cost of each law beside Coulomb's."""
    friction = [contact.friction for contact in scene.pairs.values() if contact.friction is not None]
    laws = {getattr(law, law.tag): law for law in friction}
    rows = f"{scene.dim - 1} row{'s' * (scene.dim > 2)} a point"
    return "; ".join(f"{name}: {rows}{_more(law)}" for name, law in laws.items())


def _more(law: FrictionLaw) -> str:
    again = ", each step again until mu is that of its" if law.remembers and not law.drags else ", with mu of its"
    again = f"{again} {law.remembers}" if law.remembers else ""
    return again + (", measured along its directions" if law.orthotropic else "")


def _averaged(scene: Scene) -> Iterable[str]:
    """Nearly incompressible bodies, whose dilatation is averaged, see `stickslip.solvers.fem.mean_dilatation`."""
    bodies = scene.bodies.items() if scene.model != "plane stress" else ()
    return (f"bodies.{name}.nu = {body.near_incompressible:g}" for name, body in bodies if body.averages)


def _pairs(scene: Scene) -> Iterable[str]:
    """Contacts between deformable surfaces."""
    for name, c in scene.contacts.items():
        if c.between is not None:
            yield f"contacts.{name}.between"
        elif not scene.obstacles.keys() >= set(c.partners):
            yield f"contacts.{name}.against"


def _orthotropic(scene: Scene) -> Iterable[str]:
    return (f"bodies.{name}.E_1" for name, body in scene.bodies.items() if isinstance(body, Orthotropic))


def _history(scene: Scene) -> Iterable[str]:
    """More than one step; each starts from the state of the one before."""
    times = scene.requested_times()
    return [f"steps: {len(times)} times are requested"] * (len(times) > 1)


EFFECTS = (
    Row(
        "contact",
        lambda scene: (f"contacts.{name}" for name in scene.contacts),
        lambda scene: "a problem on the surface, one row a point",
    ),
    *(Row(get_args(get_type_hints(law)["law"])[0], partial(_with_law, "normal", law)) for law in NormalLaw.kinds),
    Row("friction", partial(_with_law, "friction", FrictionLaw), _of_friction),
    Row(
        "slide",
        lambda scene: (
            f"contacts.{name}.{key}"
            for name, c in scene.contacts.items()
            for key in ("slide", "slide_speed")
            if getattr(c, key) is not None
        ),
        lambda scene: "friction turns to it: out of the plane nothing sticks, in the plane it is that of a film",
    ),
    Row(
        "wear",
        lambda scene: (f"contacts.{name}.wear" for name, c in scene.contacts.items() if c.wear),
        lambda scene: "a worn depth a point; with friction each step again until its slip is that which wears",
    ),
    Row("multibody", _pairs, lambda scene: "a search of opposite points, and integrals over both sides"),
    Row(
        "sliding",
        lambda scene: (f"contacts.{name}.sliding" for name, c in scene.contacts.items() if c.sliding),
        lambda scene: "search and integrals again in each step",
    ),
    Row("quasistatic", _history, lambda scene: "steps with the bodies prepared once"),
    Row(
        "orthotropic",
        _orthotropic,
        lambda scene: "another form of these bodies' stiffness, with as many entries; no unknowns",
    ),
    Row(
        "mean_dilatation",
        _averaged,
        lambda scene: (
            f"nodes two cells apart are coupled: up to {6 if scene.dim == 2 else 15} times the entries of the stiffness"
        ),
    ),
)
