"""Define the units of recorded quantities."""

from __future__ import annotations

import math
from dataclasses import dataclass

_PER = {"angle": "", "velocity": "/s", "acceleration": "/s²", "envelope": ""}
"""Text that follows the unit of displacement in the unit of each quantity, such as /s."""


@dataclass(frozen=True)
class Unit:
    """A unit of displacement.

    base: unit in which we compute: rad, m, or the unit itself for a sensor of unknown scale. factor: size of the unit
    in the base. quantity: if it is a unit of velocity or acceleration (rpm, g), that quantity; None for a unit of
    displacement. written: other ways of writing it in column names, in small letters.
    """

    name: str
    base: str
    factor: float
    quantity: str | None = None
    written: tuple[str, ...] = ()

    @property
    def translates(self) -> bool:
        """Return whether the displacement is not an angle, so that laws of a pendulum do not apply."""
        return self.base != "rad"

    @property
    def physical(self) -> bool:
        """Return whether the scale is known (rad or m), so that forces and energies follow if the inertia is known."""
        return self.base in ("rad", "m")

    @property
    def scale(self) -> float:
        """Return the size of the base unit in this unit, 1 / factor."""
        return 1.0 / self.factor

    @property
    def displacement(self) -> Unit:
        """Return the unit of displacement amplitudes: this unit, or its base for a unit of velocity or acceleration."""
        return self if self.quantity is None else UNITS[self.base]

    def quantity_name(self, quantity: str) -> str:
        """Return the name of a recorded quantity, such as "velocity".

        For the quantity "angle" (a displacement) it depends on the base of this unit: "angle" (rad), "position" (m) or
        "signal".
        """
        if quantity != "angle":
            return quantity
        return {"rad": "angle", "m": "position"}.get(self.base, "signal")

    def of(self, quantity: str) -> str:
        """Return the unit of a quantity if the displacement has this unit, such as "mm/s".

        For a unit that is itself one of this quantity, such as rpm of a velocity, return its own name.
        """
        return self.name if quantity == self.quantity else self.name + _PER[quantity]


DEGREES = ("degree", "degrees", "°", "grad", "grados", "gradi", "degré", "degrés", "degres")
"""Ways of writing degrees in column names."""
UNITS = {
    unit.name: unit
    for unit in (
        Unit("rad", "rad", 1.0, None, ("radian", "radians", "radiant")),
        Unit("mrad", "rad", 1e-3, None, ("milliradian", "milliradians")),
        Unit("deg", "rad", math.pi / 180, None, DEGREES),
        Unit("rpm", "rad", math.pi / 30, "velocity", ("1/min",)),
        Unit("dps", "rad", math.pi / 180, "velocity"),
        Unit("m", "m", 1.0, None, ("meter", "meters", "metre", "metres")),
        Unit("cm", "m", 1e-2, None, ("centimeter", "centimeters", "centimetre", "centimetres", "zentimeter")),
        Unit("mm", "m", 1e-3, None, ("millimeter", "millimeters", "millimetre", "millimetres")),
        Unit("um", "m", 1e-6, None, ("µm", "μm", "micron", "microns", "micrometer", "micrometre")),
        Unit("in", "m", 0.0254, None, ("inch", "inches")),
        Unit("ft", "m", 0.3048, None, ("foot", "feet")),
        Unit("g", "m", 9.80665, "acceleration", ("g0", "gn")),
        Unit("mg", "m", 9.80665e-3, "acceleration"),
        Unit("V", "V", 1.0, None, ("volt", "volts")),
        Unit("mV", "V", 1e-3, None, ("millivolt", "millivolts")),
        Unit("px", "px", 1.0, None, ("pixel", "pixels")),
        Unit("counts", "counts", 1.0, None, ("count", "adc", "lsb", "a.u.", "au", "arb. units", "arb.u.")),
    )
}
"""Units by name, as in study files and options."""
DECIBELS = ("dB", "dBm", "dBV", "dBu", "dBmV", "dBuV", "dBW", "dBA", "dBFS", "dBc")
"""Units of the levels of envelopes, 20 log10 of the amplitude."""


def unit_named(name: str) -> Unit:
    """Return the unit with a name; an unknown one, such as dBm of an envelope, is its own base."""
    return UNITS.get(name) or Unit(name, name, 1.0)


def quantity_unit(unit: str, quantity: str) -> str:
    """Return `Unit.of(quantity)` of the unit with this name. Raises KeyError if it is not in `UNITS`."""
    return UNITS[unit].of(quantity)


def level_unit(unit: str) -> str:
    """Return the unit of an envelope's levels: "dB of 1 V" for unit "V"; a unit of DECIBELS is returned unchanged."""
    return unit if unit in DECIBELS else f"dB of 1 {unit}"
