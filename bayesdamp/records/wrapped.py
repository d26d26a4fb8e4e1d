"""An angle that jumps by a turn where it passes the end of its scale, as an encoder does between 0 and 360 degrees."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from bayesdamp.records.record import RawRecord
from bayesdamp.units import UNITS

FEWEST = 3
"""Jumps from which on it is told."""
NEAR = 0.1
"""Share of a turn by which a jump may miss it: the step that the angle itself takes meanwhile."""
SCALE = 1.001
"""Of a turn, what the values span at most."""
SMALL = 0.25
"""Share of a turn below which all other steps are."""
ALIKE = 1.5
"""Times the largest other step by which a jump may miss a turn: the angle moves there as it does elsewhere."""
WIDE = 3.0
"""Times the largest other step that the angle spans once it is unwrapped; noise about two levels spans less."""


def jumps(y: np.ndarray, turn: float) -> int:
    """How often values y (n,) jump by a turn, 0 where they are no wrapped angle.

    A rectangular signal is none: without its jumps nothing, or noise, is left of it.
    """
    if y.size < 2 or not 0 < np.ptp(y) <= SCALE * turn:
        return 0
    steps = np.diff(y)
    jumped = np.abs(np.abs(steps) - turn) < NEAR * turn
    many = int(jumped.sum())
    largest = np.abs(steps[~jumped]).max(initial=0.0)
    missed = np.abs(np.abs(steps[jumped]) - turn).max(initial=0.0)
    if many < FEWEST or largest > SMALL * turn or missed > ALIKE * largest:
        return 0
    return many if np.ptp(np.unwrap(y, period=turn)) > WIDE * largest else 0


def turn_of(raw: RawRecord, unit: str, quantity: str) -> tuple[float, int]:
    """Return the turn by which a record in a unit jumps, in that unit, and how often; 0 times where it does not.

    The turn is that of the unit, and 360 or 2π where no unit is known.
    """
    if quantity != "angle" or unit not in UNITS:
        return 0.0, 0
    if UNITS[unit].base == "rad":
        turns = [2 * math.pi / UNITS[unit].factor]
    else:
        turns = [] if raw.unit else [360.0, 2 * math.pi]
    found = ((turn, jumps(raw.y, turn)) for turn in turns)
    return next(((turn, many) for turn, many in found if many), (0.0, 0))


def unwrapped(raw: RawRecord, unit: str, quantity: str) -> RawRecord:
    """Return the record without jumps by a turn, with a note; the record itself where it has none."""
    turn, many = turn_of(raw, unit, quantity)
    if not many:
        return raw
    before = raw.provenance
    note = (
        f"It is an angle that was wrapped: it jumps by a turn ({turn:.6g}) {many} times, and is unwrapped; give its "
        "unit where it is not an angle."
    )
    y = np.unwrap(raw.y, period=turn)
    return replace(raw, y=y, provenance=replace(before, notes=(*before.notes, note)))
