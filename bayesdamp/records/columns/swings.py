"""Whether a column swings and dies down, coarsely: enough to tell a record from what stands beside it in a file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.records.oscillation.spectrum import coarse_period

SHARE = 0.3
"""As in `free_decay`: the share of an oscillation in a record."""
CYCLES = 2.5
"""Periods below which a column drifts rather than swings."""
FALL = 0.8
"""The swing at the end of a record that dies down is below this share of its largest."""
AGAIN = 0.2
"""Share of its largest swing by which a free decay does not grow once it has begun to fall (conventional)."""
SMOOTHED = 3
"""Periods over which a swing is averaged before it is asked whether it grows."""
ALIKE = 0.9999
"""Correlation of two columns that are one signal in two units."""
LARGEST = 1e100
"""Of a value that can be computed with: squares of it must not overflow."""


@dataclass(frozen=True)
class Swing:
    """period: in samples; share: of the oscillation in the column; size: the largest swing, its standard deviation in
    the column's unit; last: that at the end; cycles: periods in the column; again: the most that it grows after its
    largest, as a share of that; filled: in how many periods, about, its power is."""

    period: float
    share: float
    size: float
    last: float
    cycles: float = 0.0
    again: float = 0.0
    filled: float = 0.0

    @property
    def lasts(self) -> bool:
        """Whether it swings for more than the two periods that one spike can touch."""
        return self.filled >= CYCLES

    @property
    def swings(self) -> bool:
        """Whether one frequency has most of its power, over enough cycles."""
        return self.share >= SHARE and self.cycles >= CYCLES

    @property
    def dies(self) -> bool:
        """Whether its last amplitude is well below its first."""
        return self.last < FALL * self.size

    @property
    def grows_again(self) -> bool:
        """Whether it swells once more after it has died down, as beats and the residuals of a fit do."""
        return self.again > AGAIN


def swing(y: np.ndarray) -> Swing:
    """The swing of values y (n,), equally spaced; NaN is left out."""
    y = np.asarray(y[np.isfinite(y)], float)
    scale = float(np.abs(y).max()) if y.size else 0.0
    if y.size < 10 or not 0 < scale < LARGEST or np.ptp(y) == 0:
        return Swing(np.inf, 0.0, 0.0, 0.0)
    y = y / scale - np.mean(y / scale)
    period, share = coarse_period(np.arange(y.size, dtype=float), y)
    width = int(min(max(round(period), 4), y.size // 2))
    windows = y[: y.size // width * width].reshape(-1, width)
    sizes = windows.std(axis=1)
    late = max(sizes.size // 5, 1)
    last = float(np.median(sizes[-late:])) * scale
    filled = float(np.sum(sizes**2) ** 2 / np.sum(sizes**4))
    return Swing(period, share, float(sizes.max()) * scale, last, y.size / period, _growth(sizes), filled)


def _growth(sizes: np.ndarray) -> float:
    """The most that sizes (n,), one a period, grow after their largest, as a share of that, but for scatter."""
    if sizes.size < 2 * SMOOTHED or sizes.max() <= 0:
        return 0.0
    smooth = np.convolve(sizes, np.full(SMOOTHED, 1 / SMOOTHED), "valid")
    falling = smooth[int(np.argmax(smooth)) :]
    return float((falling - np.minimum.accumulate(falling)).max() / smooth.max())


def proportional(a: np.ndarray, b: np.ndarray) -> bool:
    """Return whether b (n,) is a (n,) in another unit or with another zero."""
    if a.size != b.size:
        return False
    both = np.isfinite(a) & np.isfinite(b)
    with np.errstate(all="ignore"):  # of a constant column, and of one that overflows
        return int(both.sum()) >= 10 and bool(abs(np.corrcoef(a[both], b[both])[0, 1]) > ALIKE)
