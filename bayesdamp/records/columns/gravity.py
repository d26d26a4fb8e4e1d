"""Accelerations that contain gravity: of a pendulum's sensor, the axis that points to the pivot.

The pull of a pendulum's string is largest twice in a cycle, and its mean depends on the swing: gravity loses, and what
turns the sensor gains. Nothing that moves to and fro along a line has an acceleration whose mean does (Newton).
"""

from __future__ import annotations

from enum import Enum

import numpy as np

from bayesdamp.records.columns.names import unit_said
from bayesdamp.records.columns.swings import LARGEST, Swing, swing
from bayesdamp.records.files.contents import Column
from bayesdamp.units import UNITS

_ABOUT_G, _ABOUT_TWICE = 0.25, 0.1
"""Share by which a mean acceleration may differ from gravity (a wide swing lowers it), and share by which one period,
known coarsely, may differ from twice another."""
WINDOWS = 6
"""Cycles of a pendulum in which the mean is compared with the swing, at least (conventional)."""
FOLLOWS, ALIKE = (0.1, 1.2), 0.9
"""By how much the mean changes as a share of the change of the swing, and their correlation at least. For small swings
the share is (2k - 1)/(2k + 1) of a sensor at k of the pendulum's length: 1/3 at its end, -1 at the pivot."""


def along(column: Column) -> bool:
    """Return whether a column's mean is that of gravity, and nothing says that it is not an acceleration."""
    gravity, (unit, quantity) = UNITS["g"].factor, unit_said(column)
    y = column.values[np.isfinite(column.values)]
    if not y.size or np.abs(y).max() > LARGEST:
        return False
    mean = abs(float(y.mean()))
    if unit in UNITS and UNITS[unit].base == "m" and quantity == "acceleration":
        return abs(mean * UNITS[unit].factor / gravity - 1) < _ABOUT_G
    return not unit and quantity in ("", "acceleration") and abs(mean / gravity - 1) < _ABOUT_G


def across(columns: list[Column], seen: dict[int, Swing]) -> list[Column]:
    """Leave out accelerations that contain gravity where another axis oscillates at half their frequency."""

    def doubled(column: Column) -> bool:
        others = [c for c in columns if unit_said(c) == unit_said(column) and not along(c)]
        return any(abs(seen[id(c)].period / seen[id(column)].period / 2 - 1) < _ABOUT_TWICE for c in others)

    return [c for c in columns if not (along(c) and doubled(c))]


TWICE = (
    "its mean is gravity's and follows the swing, as along a pendulum's string: it swings at twice the pendulum's "
    "frequency; the axis along the swing has the pendulum's own."
)


class Pull(Enum):
    """What the mean of an acceleration that contains gravity does while the swing dies down."""

    CONSTANT = "stays"
    FOLLOWS = "follows the swing"
    UNCLEAR = "is too uncertain to say"


def pull(column: Column) -> Pull | None:
    """Return what the mean of an acceleration along gravity does from its largest swing on, cycle by cycle.

    None where a column is not such an acceleration, or does not swing. Where no unit is said, it is one if its mean
    follows the swing.
    """
    if not along(column) or not (seen := swing(column.values)).swings:
        return None
    found = _pull(np.abs(column.values[np.isfinite(column.values)]), round(2 * seen.period))
    return found if unit_said(column)[0] or found is Pull.FOLLOWS else None


def _pull(y: np.ndarray, width: int) -> Pull:
    """What the mean of values y (n,) does that swing twice in `width` samples."""
    if not 4 <= width <= y.size // WINDOWS:
        return Pull.UNCLEAR
    windows = y[: y.size // width * width].reshape(-1, width)
    sizes = np.sqrt(2) * windows.std(axis=1)
    at = int(np.argmax(sizes))
    size, mean = sizes[at:] - sizes[at:].mean(), windows[at:].mean(axis=1) - windows[at:].mean()
    if size.size < WINDOWS or not size @ size * (mean @ mean) > 0:
        return Pull.UNCLEAR
    slope = float(size @ mean / (size @ size))
    error = float(np.linalg.norm(mean - slope * size) / np.linalg.norm(size) / np.sqrt(size.size - 2))
    if abs(slope) + 2 * error < FOLLOWS[0]:
        return Pull.CONSTANT
    alike = abs(slope) * np.linalg.norm(size) > ALIKE * np.linalg.norm(mean)
    return Pull.FOLLOWS if alike and FOLLOWS[0] <= abs(slope) <= FOLLOWS[1] else Pull.UNCLEAR
