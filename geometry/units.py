"""The units of a scene: names of what its numbers are in. They label results, and convert none of the numbers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from stickslip.geometry.errors import SceneError, shortened

# lengths in m, forces in N, pressures in Pa (pounds in lbf/in²), energies in J, masses in kg
LENGTHS = {
    "m": "1", "dm": "0.1", "cm": "0.01", "mm": "1e-3", "um": "1e-6", "nm": "1e-9", "km": "1e3", "in": "0.0254",
    "ft": "0.3048",
}  # fmt: skip
FORCES = {
    "N": "1", "uN": "1e-6", "mN": "1e-3", "kN": "1e3", "MN": "1e6", "kgf": "9.80665", "lbf": "4.4482216152605",
}  # fmt: skip
PRESSURES = {"Pa": "1", "kPa": "1e3", "MPa": "1e6", "GPa": "1e9", "TPa": "1e12", "bar": "1e5"}
POUNDS = {"psi": "1", "ksi": "1e3"}
ENERGIES = {"J": "1", "mJ": "1e-3", "kJ": "1e3", "MJ": "1e6"}
MASSES = {"kg": "1", "g": "1e-3", "t": "1e3"}
SHORT = {"SI": "m-N-Pa"}
OF_SI = re.compile(r"(?<![A-Za-z_^])(kg/m³|m|N|Pa|J)(?![A-Za-z_0-9'])")  # within a unit; m^m_n has an exponent m_n
NAMED = re.compile(r"\[[^\]\[]*\]")  # a unit in a head or a label
EXPECTED = 'expected "SI", or "LENGTH-FORCE-PRESSURE" such as "mm-N-MPa"'
SAID = re.compile(r"(?<=, in )[^;,]+$|(?<=expected a number in )[^;,]+(?=, or )")  # the unit of a number


@dataclass(frozen=True)
class Units:
    """Names of the units of length, force and pressure; the others follow. Seconds, kelvins and radians stay.

    >>> mm = Units.of("mm-N-MPa")
    >>> mm("N/m"), mm("J"), mm("kg/m³"), mm("m/s²"), mm("Pa/m^m_n"), mm("N m")
    ('N/mm', 'mJ', 't/mm³', 'mm/s²', 'MPa/mm^m_n', 'N mm')
    >>> Units.of("SI")("kg/m³"), Units.of("in-lbf-psi")("J/m"), Units.of("rod-stone-slab")("kg/m³")
    ('kg/m³', 'lbf in/in', 'stone s²/rod⁴')
    """

    length: str = "m"
    force: str = "N"
    pressure: str = "Pa"

    @classmethod
    def of(cls, text: str) -> Units:
        """The units that a scene names. Units that are not known here are taken as they are.

        Raises:
            SceneError: no such form, or the pressure is not the force over the length squared.
        """
        parts = SHORT.get(text, text).split("-")
        if len(parts) != 3 or not all(parts) or any(part != part.strip() or not part.isprintable() for part in parts):
            raise SceneError(f'units = "{shortened(text)}": {EXPECTED}')
        found = cls(*parts)
        length, force, pressure = found._known
        if length and force and pressure and pressure != force / length**2:
            fits = next((name for name, size in _pressures().items() if size == force / length**2), None)
            fits = fits or f"{found.force}/{found.length}²"
            raise SceneError(
                f'units = "{shortened(text)}": {found.force}/{found.length}² is not {found.pressure}; the pressure '
                f'that fits is {fits}: "{found.length}-{found.force}-{fits}"'
            )
        return found

    @cached_property
    def _known(self) -> tuple[Fraction | None, Fraction | None, Fraction | None]:
        """Length [m], force [N] and pressure [Pa], None of what is not known."""
        tables = ((LENGTHS, self.length), (FORCES, self.force))
        length, force = (Fraction(table[name]) if name in table else None for table, name in tables)
        return length, force, _pressures().get(self.pressure)

    @property
    def pascals(self) -> float | None:
        """The unit of pressure [Pa]; None: not known."""
        return None if self._known[2] is None else float(self._known[2])

    @property
    def metre(self) -> str:
        """The unit of length as a sentence has it."""
        return "metre" if self.length == "m" else self.length

    @property
    def energy(self) -> str:
        """The unit of energy: one with a name of its own, or force times length."""
        length, force, _ = self._known
        named = {Fraction(size): name for name, size in ENERGIES.items()}
        return named.get(length * force if length and force else Fraction(0), f"{self.force} {self.length}")

    @property
    def density(self) -> str:
        """The unit of mass per volume, of the mass to which a force gives one length per s²."""
        length, force, _ = self._known
        named = {Fraction(size): name for name, size in MASSES.items()}
        mass = named.get(force / length if length and force else Fraction(0))
        return f"{mass}/{self.length}³" if mass else f"{self.force} s²/{self.length}⁴"

    def __call__(self, unit: str) -> str:
        """Translate a unit of the SI, such as N/m."""
        pressure = f"({self.pressure})" if "/" in self.pressure and unit.startswith("Pa/") else self.pressure
        symbols = {"m": self.length, "N": self.force, "Pa": pressure, "J": self.energy, "kg/m³": self.density}
        return unit if self == SI else OF_SI.sub(lambda found: symbols[found[1]], unit)

    def label(self, text: str) -> str:
        """A head of a table or a label with its unit of the SI in brackets, in these units.

        >>> Units.of("mm-N-MPa").label("x [m], normal force [N], t [s]")
        'x [mm], normal force [N], t [s]'
        """
        return text if self == SI else NAMED.sub(lambda found: self(found[0]), text)

    def refusal(self, line: str) -> str:
        """The line of a refusal that says what unit a number has.

        >>> Units.of("mm-N-MPa").refusal("radius = -1.0: must be positive, in metres")
        'radius = -1.0: must be positive, in mm'
        """
        return line if self == SI else SAID.sub(lambda found: self(found[0].replace("metres", "m")), line)

    def metres(self, what: str) -> Fraction:
        """The unit of length [m], exactly.

        Raises:
            SceneError: it is not known; `what` begins the line.
        """
        length = self._known[0]
        if length is None:
            raise SceneError(f"{what}: {self.length} is not a length that is known here, so nothing can be converted")
        return length

    def amount(self, value: float, unit: str, what: str) -> float:
        """A number in m, m/s², N, Pa or kg/m³ as it is in these units.

        Raises:
            SceneError: length or force are not known; `what` begins the line.
        """
        length, force, _ = self._known
        if length is None or force is None:
            unknown = self.force if length else self.length
            raise SceneError(f"{what}: {unknown} is not a unit that is known here, so nothing can be converted")
        sizes = {"m": length, "m/s²": length, "N": force, "Pa": force / length**2, "kg/m³": force / length**4}
        return float(Fraction(value) / sizes[unit])


def _pressures() -> dict[str, Fraction]:
    """Pressures by name [Pa]."""
    found = {name: Fraction(size) for name, size in PRESSURES.items()}
    pound = Fraction(FORCES["lbf"]) / Fraction(LENGTHS["in"]) ** 2
    return found | {name: Fraction(size) * pound for name, size in POUNDS.items()}


SI = Units()
