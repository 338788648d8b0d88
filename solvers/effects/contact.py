"""Contact: surfaces that may touch, and a row of the plan for each normal law and for friction."""

from __future__ import annotations

from typing import get_args, get_type_hints

from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.laws import FrictionLaw, NormalLaw
from stickslip.solvers.scene.scene import Scene


class _Contact(Effect):
    name = "contact"

    def because(self, scene: Scene) -> str | None:
        return ", ".join(f"contacts.{name}" for name in scene.contacts) or None

    def adds(self, scene: Scene) -> str:
        return "a problem on the surface, one row a point"


class _Law(Effect):
    """Active if a contact has a law of the given kind under `key`, which is `normal` or `friction`."""

    def __init__(self, name: str, key: str, kind: type[object]) -> None:
        self.name, self.key, self.kind = name, key, kind  # type: ignore[misc]

    def because(self, scene: Scene) -> str | None:
        of_kind = [name for name, c in scene.contacts.items() if isinstance(getattr(c, self.key), self.kind)]
        return ", ".join(f"contacts.{name}.{self.key}" for name in of_kind) or None


class _Friction(_Law):
    """What each law costs beside Coulomb's."""

    def adds(self, scene: Scene) -> str:
        friction = [contact.friction for contact in scene.contacts.values() if contact.friction is not None]
        laws = {getattr(law, law.tag): law for law in friction}
        rows = f"{scene.dim - 1} row{'s' * (scene.dim > 2)} a point"
        return "; ".join(f"{name}: {rows}{_more(law)}" for name, law in laws.items())


def _more(law: FrictionLaw) -> str:
    again = ", each step again until mu is that of its" if law.remembers and not law.drags else ", with mu of its"
    again = f"{again} {law.remembers}" if law.remembers else ""
    return again + (", measured along its directions" if law.orthotropic else "")


EFFECTS = (
    _Contact(),
    *(_Law(get_args(get_type_hints(law)["law"])[0], "normal", law) for law in NormalLaw.kinds),
    _Friction("friction", "friction", FrictionLaw),
)
