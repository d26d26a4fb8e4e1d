"""Units that a record may come in."""

from __future__ import annotations

import math
from dataclasses import dataclass

_PER = {"angle": "", "velocity": "/s", "acceleration": "/s²", "envelope": ""}


@dataclass(frozen=True)
class Unit:
    """A unit of displacement.

    base: the unit that is computed in: rad, m, or the unit itself where a sensor's scale is not known.
    factor: of the base in one of it. quantity: the only one that it is a unit of, so that "/s" or "/s²" is not added;
    None for a displacement's. written: how the names of columns may say it, besides its own name, in small letters.
    """

    name: str
    base: str
    factor: float
    quantity: str | None = None
    written: tuple[str, ...] = ()

    @property
    def translates(self) -> bool:
        """Whether what moves is taken to move along a line: a pendulum's laws need an angle."""
        return self.base != "rad"

    @property
    def physical(self) -> bool:
        """Whether forces and energies follow from it where an inertia is known."""
        return self.base in ("rad", "m")

    @property
    def scale(self) -> float:
        """Of it in one of the base."""
        return 1.0 / self.factor

    @property
    def displacement(self) -> Unit:
        """The unit that amplitudes are told in: the base where this one is of another quantity alone."""
        return self if self.quantity is None else UNITS[self.base]

    def called(self, quantity: str) -> str:
        """What is recorded in it: an angle, a position along a line, a sensor's signal, or their derivative."""
        if quantity != "angle":
            return quantity
        return {"rad": "angle", "m": "position"}.get(self.base, "signal")

    def of(self, quantity: str) -> str:
        """How values of this quantity are labelled."""
        return self.name if quantity == self.quantity else self.name + _PER[quantity]


UNITS = {
    unit.name: unit
    for unit in (
        Unit("rad", "rad", 1.0, None, ("radian", "radians", "radiant")),
        Unit("mrad", "rad", 1e-3, None, ("milliradian", "milliradians")),
        Unit(
            "deg",
            "rad",
            math.pi / 180,
            None,
            ("degree", "degrees", "°", "grad", "grados", "gradi", "degré", "degrés", "degres"),
        ),
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
"""By name, as a study's or the command's `unit` says it."""


def unit_named(name: str) -> Unit:
    """Return the unit of this name; of one that only an envelope has, such as dBm, its numbers stay as they are."""
    return UNITS.get(name) or Unit(name, name, 1.0)


def quantity_unit(unit: str, quantity: str) -> str:
    """Unit of the recorded quantity where the displacement has this unit."""
    return UNITS[unit].of(quantity)
