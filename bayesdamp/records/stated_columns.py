"""Which columns of a file hold times and values, and in which unit, where the file says it."""

from __future__ import annotations

import math
import re

import numpy as np

from bayesdamp.records.record import RawRecord
from bayesdamp.units import UNITS

HALF_TURN, FULL_TURN = math.pi, 360.0
"""Amplitudes beyond which values of which no unit is said are hardly an angle: in rad (a pendulum goes over the top),
in degrees."""
_ANGLE = re.compile(
    r"^$|angle|angular|theta|phi|alpha|roll|pitch|yaw|tilt|pendul|rotation|encoder|winkel|angolo|[θφϕα]",
    re.IGNORECASE,
)
"""Names of columns that may hold an angle; so may one without a name."""


def resolved_unit(unit: str | None, quantity: str | None, said: str, what: str) -> tuple[str, str]:
    """The unit and the quantity: those given, else those that a file says, else an angle in rad."""
    only = UNITS[unit].quantity if unit in UNITS else None
    chosen = unit or (said if said in UNITS else "rad")
    return chosen, quantity or only or what or "angle"


def read_as(raw: RawRecord, unit: str | None, quantity: str | None) -> tuple[str, str]:
    """The unit and the quantity that a record is read in: as `resolved_unit`, but for values of which nobody says a
    unit and which are too large for radians: those are degrees where the column's name allows an angle, else a sensor's
    counts."""
    found, what = resolved_unit(unit, quantity, raw.unit, raw.quantity)
    if unit is not None or raw.unit or what != "angle" or half_swing(raw) <= HALF_TURN:
        return found, what
    return ("deg" if _ANGLE.search(raw.channel) and half_swing(raw) <= FULL_TURN else "counts"), what


def half_swing(raw: RawRecord) -> float:
    """Half of what the values of a record span, in the file's unit."""
    return float(np.ptp(raw.y)) / 2
