"""Define a raw record (before cleaning), the unit in which it is read, and the unwrapping of angles."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from bayesdamp.records.columns import OscillationMeasure, measure_oscillation
from bayesdamp.types import Provenance
from bayesdamp.units import UNITS

GUESSED = "counts"
"""Unit of a record whose unit is not known, and whose values are too large for an angle in rad."""
HALF_TURN, FULL_TURN = math.pi, 360.0
"""Values without a stated unit are not taken for radians if their amplitude is above `HALF_TURN` (a pendulum would go
over the top), and not for degrees if it is above `FULL_TURN` (conventional)."""
_ANGLE = re.compile(
    r"^$|angle|angular|theta|phi|alpha|roll|pitch|yaw|tilt|pendul|rotation|encoder|winkel|angolo|[θφϕα]",
    re.IGNORECASE,
)
"""Column names that may stand for an angle; a column without a name may be an angle too."""
# An angle counts as wrapped (jumping by a whole turn) under these conditions; all values are conventional.
MIN_JUMPS = 3
"""Values count as a wrapped angle only if they have at least this many jumps by a turn."""
JUMP_TOLERANCE = 0.1
"""The step from one value to the next counts as a jump if it differs from a turn by less than this fraction of a
turn."""
MAX_SPAN = 1.001
"""Largest range of the values of a wrapped angle, in turns; values with a larger one are not unwrapped."""
MAX_STEP = 0.25
"""Largest step of a wrapped angle other than the jumps, in turns; values with a larger one are not unwrapped."""
MAX_EXCESS = 1.5
"""A jump of a wrapped angle must differ from a turn by at most this multiple of the largest step other than the jumps;
the difference is the change of the angle between the two samples."""
MIN_SPAN = 3.0
"""An unwrapped angle must span more than this multiple of its largest step other than the jumps. A signal that is noise
about two levels spans less."""


@dataclass(frozen=True)
class RawRecord:
    """A record as it is in its file, before cleaning.

    Parameters
    ----------
    t
        Times in s, shape (n,); None if there is a sampling rate instead.
    y
        The recorded quantity in the file's unit, shape (n,).
    rate
        Sampling rate in Hz, given by the user or stated in the file; None if there are times.
    rows
        Row of each sample in the file, shape (n,), counted from 0 at the first row of numbers.
    provenance
        How the record was read.
    run
        Label of the run in the file; "" if the file has no runs.
    channel
        Name of the column, without the run.
    unit
        Unit of the displacement that the file states: a name in UNITS if the unit is known, else as it is written; ""
        if the file states none.
    quantity
        "angle", "velocity", "acceleration", or "" if the file does not state it.
    columns
        Columns of the times (None without times) and of the values, by name or number from 1.
    choice
        Sentence on the choice among the file's columns; "" if there was no choice.
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
    choice: str = ""

    @cached_property
    def oscillation(self) -> OscillationMeasure:
        """Return coarse measures of the oscillation in y: period in samples, size in the unit of y, and its kind."""
        return measure_oscillation(self.y)


def choose_unit(unit: str | None, quantity: str | None, stated: str, what: str) -> tuple[str, str]:
    """Return unit and quantity of a record: those that the user gives, else those of the file, else an angle in rad.

    unit, quantity: given by the user, None if not given. stated, what: unit and quantity that the file states, "" if it
    states none. If the given unit belongs to only one quantity, as g to acceleration, this quantity is used instead of
    the file's. A unit of the file that is not in UNITS is not used: rad is returned instead.
    """
    only = UNITS[unit].quantity if unit in UNITS else None
    chosen = unit or (stated if stated in UNITS else "rad")
    return chosen, quantity or only or what or "angle"


def unit_or_guess(raw: RawRecord, unit: str | None, quantity: str | None) -> tuple[str, str]:
    """Return the unit and the quantity of a record's values: those given, else those of the file, else a guess.

    They are those of `choose_unit`, which guesses an angle in rad. But if no unit is given, the file states none, and
    half the range of an angle exceeds π, the unit is "deg" if the column's name allows an angle (or is empty) and half
    the range is at most 360, else "counts" (of a sensor).
    """
    resolved, what = choose_unit(unit, quantity, raw.unit, raw.quantity)
    if unit is not None or raw.unit or what != "angle" or half_swing(raw) <= HALF_TURN:
        return resolved, what
    return ("deg" if _ANGLE.search(raw.channel) and half_swing(raw) <= FULL_TURN else GUESSED), what


def half_swing(raw: RawRecord) -> float:
    """Return half of the range of a record's values, in the unit of the file."""
    return float(np.ptp(raw.y)) / 2


def count_jumps(y: np.ndarray, turn: float) -> int:
    """Return how often values y (n,) jump by a turn; 0 if they are not a wrapped angle. turn: a turn in the unit of y.

    A rectangular signal is not a wrapped angle: without its jumps it is constant, or noise.
    """
    if y.size < 2 or not 0 < np.ptp(y) <= MAX_SPAN * turn:
        return 0
    steps = np.diff(y)
    jumped = np.abs(np.abs(steps) - turn) < JUMP_TOLERANCE * turn
    many = int(jumped.sum())
    largest = np.abs(steps[~jumped]).max(initial=0.0)
    missed = np.abs(np.abs(steps[jumped]) - turn).max(initial=0.0)
    if many < MIN_JUMPS or largest > MAX_STEP * turn or missed > MAX_EXCESS * largest:
        return 0
    return many if np.ptp(np.unwrap(y, period=turn)) > MIN_SPAN * largest else 0


def unwrap(raw: RawRecord, unit: str, quantity: str) -> RawRecord:
    """Return the record with its wrapped angle unwrapped, and a note; a record without jumps by a turn is unchanged.

    An encoder's angle jumps at the end of its scale, for example between 360 and 0 degrees. unit, quantity: those in
    which the record is read; only an "angle" in a unit of angles is unwrapped, or one without any unit (`GUESSED`), for
    which turns of 360 and of 2π are tried.
    """
    if quantity != "angle" or unit not in UNITS:
        return raw
    if UNITS[unit].base == "rad":
        turns = [2 * math.pi / UNITS[unit].factor]
    else:
        turns = [360.0, 2 * math.pi] if unit == GUESSED and not raw.unit else []
    for turn in turns:
        if many := count_jumps(raw.y, turn):
            note = (
                f"The angle was wrapped: it jumps by a turn ({turn:.6g}) {many} times. The jumps are removed; if the "
                "values are not angles, give their unit."
            )
            before = raw.provenance
            y = np.unwrap(raw.y, period=turn)
            return replace(raw, y=y, provenance=replace(before, notes=(*before.notes, note)))
    return raw
