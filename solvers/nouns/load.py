"""A load on a side: traction, pressure or resultant force."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from geometry.amplitude import Amplitude, check
from geometry.errors import SceneError
from geometry.keys import Key, Noun


@dataclass(frozen=True, kw_only=True)
class Load(Noun):
    """Exactly one of traction, pressure, force."""

    boundary: Annotated[str, Key("-", "side, as body.side")]
    traction: Annotated[tuple[Amplitude, ...] | None, Key("Pa", "force per area, by component")] = None
    pressure: Annotated[Amplitude | None, Key("Pa", "positive pushes inward")] = None
    force: Annotated[tuple[Amplitude, ...] | None, Key("N", "resultant, spread evenly; per metre in plane models")] = (
        None
    )

    def __post_init__(self) -> None:
        given = [key for key in ("traction", "pressure", "force") if getattr(self, key) is not None]
        if len(given) != 1:
            raise SceneError(
                f"{' / '.join(given) or 'traction / pressure / force'}: exactly one of the three is needed"
            )
        for amplitude in self.amplitudes():
            check(amplitude, given[0])

    def amplitudes(self) -> tuple[Amplitude, ...]:
        if self.pressure is not None:
            return (self.pressure,)
        return self.traction or self.force or ()
