"""The units of records."""

from __future__ import annotations

import math
from dataclasses import dataclass

_PER = {"angle": "", "velocity": "/s", "acceleration": "/s²", "envelope": ""}


@dataclass(frozen=True)
class Unit:
    """A unit of displacement.

    base: the unit of computation: rad, m, or the unit itself where a sensor's scale is not known. factor: its size in
    the base. quantity: the only quantity that it is a unit of, without "/s" or "/s²"; None for a unit of displacement.
    written: other names in the names of columns, in small letters.
    """

    name: str
    base: str
    factor: float
    quantity: str | None = None
    written: tuple[str, ...] = ()

    @property
    def translates(self) -> bool:
        """Whether the motion is along a line: a pendulum's laws need an angle."""
        return self.base != "rad"

    @property
    def physical(self) -> bool:
        """Whether forces and energies follow from it with a known inertia."""
        return self.base in ("rad", "m")

    @property
    def scale(self) -> float:
        """Return the size of the base in this unit."""
        return 1.0 / self.factor

    @property
    def displacement(self) -> Unit:
        """Return the unit of amplitudes: the base where this one is a unit of another quantity only."""
        return self if self.quantity is None else UNITS[self.base]

    def called(self, quantity: str) -> str:
        """Return the name of a quantity in this unit: angle, position, signal, or their derivative."""
        if quantity != "angle":
            return quantity
        return {"rad": "angle", "m": "position"}.get(self.base, "signal")

    def of(self, quantity: str) -> str:
        """Return the label of values of a quantity."""
        return self.name if quantity == self.quantity else self.name + _PER[quantity]


DEGREES = ("degree", "degrees", "°", "grad", "grados", "gradi", "degré", "degrés", "degres")
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
"""Units by name, as in a study or as an option."""


def unit_named(name: str) -> Unit:
    """Return the unit with a name; one that only envelopes have, such as dBm, is its own base."""
    return UNITS.get(name) or Unit(name, name, 1.0)


def quantity_unit(unit: str, quantity: str) -> str:
    """Return the unit of the recorded quantity where the displacement has this unit."""
    return UNITS[unit].of(quantity)
