"""A record before it is cleaned: its samples, the unit that they are read in, and the unwrapping of an angle."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from bayesdamp.records.columns import Swing, measure_swing
from bayesdamp.types import Provenance
from bayesdamp.units import UNITS

HALF_TURN, FULL_TURN = math.pi, 360.0
"""Amplitudes beyond which values without a stated unit are hardly an angle: in rad (a pendulum goes over the top), in
degrees."""
_ANGLE = re.compile(
    r"^$|angle|angular|theta|phi|alpha|roll|pitch|yaw|tilt|pendul|rotation|encoder|winkel|angolo|[θφϕα]",
    re.IGNORECASE,
)
"""Names of columns that may hold an angle; so may a column without a name."""
FEWEST = 3
"""Jumps from which on an angle is taken to be wrapped."""
NEAR = 0.1
"""Share of a turn by which a jump may miss it: the step that the angle itself takes meanwhile."""
SCALE = 1.001
"""Number of turns that the values span at most."""
SMALL = 0.25
"""Share of a turn below which all other steps are."""
ALIKE = 1.5
"""Multiple of the largest other step by which a jump may miss a turn: the angle moves there as it does elsewhere."""
WIDE = 3.0
"""Multiple of the largest other step that the unwrapped angle spans; noise about two levels spans less."""


@dataclass(frozen=True)
class RawRecord:
    """A record as its file has it.

    Parameters
    ----------
    t
        The file's own times in s, shape (n,), or None where there is a sampling rate instead.
    y
        The recorded quantity in the file's unit, shape (n,).
    rate
        The sampling rate in Hz, given or stated by the file, where t is None.
    rows
        The row of the file with each sample, counted from 0 at its first row of numbers, shape (n,).
    provenance
        How it was read.
    run
        The file's own label of the run; empty where the file has none.
    channel
        The column's name without the run.
    unit
        The displacement's unit in UNITS that the file or the caller states, else as the file writes it; empty where
        nobody states it.
    quantity
        "angle", "velocity", "acceleration", or empty where nobody states it.
    columns
        What to ask for to get these columns again: (times or None, values), by name or number from 1.
    repeat
        Whether the file states that it is one of several runs of the same thing.
    choice
        The sentence on the choice among the file's columns, empty where there was none.
    why
        Those of the notes that say which columns the times and values are.
    began
        The file's time in s of the first sample, where it counts from an epoch and t from that sample; else 0.
    """

    t: np.ndarray | None
    y: np.ndarray
    rate: float | None = None
    rows: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    provenance: Provenance = field(default_factory=Provenance)
    run: str = ""
    channel: str = ""
    unit: str = ""
    quantity: str = ""
    columns: tuple[str | int | None, str | int | None] = (None, None)
    repeat: bool = False
    choice: str = ""
    why: tuple[str, ...] = ()
    began: float = 0.0

    @cached_property
    def swing(self) -> Swing:
        """How its values swing."""
        return measure_swing(self.y)


def resolved_unit(unit: str | None, quantity: str | None, stated: str, what: str) -> tuple[str, str]:
    """Return the unit and the quantity: those given, else the file's (stated, what), else an angle in rad."""
    only = UNITS[unit].quantity if unit in UNITS else None
    chosen = unit or (stated if stated in UNITS else "rad")
    return chosen, quantity or only or what or "angle"


def read_as(raw: RawRecord, unit: str | None, quantity: str | None) -> tuple[str, str]:
    """Return the unit and the quantity that a record is read in.

    As `resolved_unit`, but values without a stated unit that are too large for radians are degrees where the column's
    name allows an angle, else a sensor's counts.
    """
    resolved, what = resolved_unit(unit, quantity, raw.unit, raw.quantity)
    if unit is not None or raw.unit or what != "angle" or half_swing(raw) <= HALF_TURN:
        return resolved, what
    return ("deg" if _ANGLE.search(raw.channel) and half_swing(raw) <= FULL_TURN else "counts"), what


def half_swing(raw: RawRecord) -> float:
    """Return half of the range of a record's values, in the file's unit."""
    return float(np.ptp(raw.y)) / 2


def count_jumps(y: np.ndarray, turn: float) -> int:
    """Return how often values y (n,) jump by a turn, 0 where they are not a wrapped angle.

    A rectangular signal is not one: without its jumps it is constant, or noise.
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


def unwrapped(raw: RawRecord, unit: str, quantity: str) -> RawRecord:
    """Return the record without jumps by a turn, with a note; the record itself where it has none.

    An encoder's angle jumps at the end of its scale, between 0 and 360 degrees. The turn is that of the unit, and 360
    or 2π where no unit is known.
    """
    if quantity != "angle" or unit not in UNITS:
        return raw
    if UNITS[unit].base == "rad":
        turns = [2 * math.pi / UNITS[unit].factor]
    else:
        turns = [] if raw.unit else [360.0, 2 * math.pi]
    for turn in turns:
        if many := count_jumps(raw.y, turn):
            note = (
                f"The angle was wrapped: it jumps by a turn ({turn:.6g}) {many} times, and is unwrapped; give the "
                "unit if it is not an angle."
            )
            before = raw.provenance
            y = np.unwrap(raw.y, period=turn)
            return replace(raw, y=y, provenance=replace(before, notes=(*before.notes, note)))
    return raw
