"""The free decay in a record of an envelope: after the drive, before the noise floor, by a power of the amplitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from bayesdamp.physics.amplitude import EXPONENTS, power_decay, power_slopes
from bayesdamp.types import Refusal

NEPER = 20.0 / np.log(10.0)
"""dB."""
FITTED = 80
"""Blocks that a decay and its floor are fitted to."""
LEAST_DROP = 3.0
"""dB that a decay has to fall for its rate to be determined; a half-life is 6."""
LEAST_POINTS = 6
WORSE = 2.0
"""Multiple of the usual misfit of a short line at which it is not part of the decay."""
GUARD = 0.02
"""Share of the decay's duration left out after the release where a drive precedes it."""
CHECKED = 0.05
"""Share of a decay, at its start, that a law must fit by itself."""
WON = 0.15
"""Share of a decay's duration, or of its fall in dB, by which it must be longer to begin where a power law begins
rather than where a straight line does."""
SMALLEST = 0.15
"""dB below which a deviation is not significant: detectors are not linear to better."""
ABOVE_FLOOR = 10.0
"""dB above the mean power of the floor where a decay ends: there a Gaussian in the logarithm still describes what the
floor does to it, and its mean is right to 1e-5 (the logarithm of a circular Gaussian's power plus a constant's)."""
LAG = 0.1
"""Decay times (1/rate) between readings of a floor that are compared: thermal motion of the mode itself, which is
correlated over its decay time, hardly moves in that time, noise of a detector does."""
PARTS = 8
"""Stretches that each give the floor's swing, for its standard error."""
LEAST = 24
"""Readings below which a floor's swing is not known."""
KNOWN = 0.3
"""Relative sd of a floor's constant part near the decay, measured behind it."""
POINTS = 600
"""Blocks that a record is averaged into."""
COARSE = 72
"""Blocks among which the straightest descent is searched."""
LOST = 0.4
"""Share of the straightest descent that has to be left behind the start."""
SURE_DROP = 8.0
"""dB of descent that only a decay can cause."""
SPARSE = 60
"""Readings below which a record is a table: no release and no floor is searched."""
MISFIT_WEIGHT = 20.0
"""dB of fall that a dB of root mean square misfit of a straight line outweighs, conventional."""
NARROWEST = 10
ROUNDS = 4
SHORT = 0.12
"""Length of the short lines that find the release, as a share of the decay's duration."""
AHEAD = 2
"""Lengths of short lines ahead over which the usual misfit is taken: it grows towards the floor."""
SLOWEST, FASTEST = 0.4, 5.0
"""Multiples of the rate after it beyond which a fall is not part of the decay."""
FLAT = 0.2
"""Share of the rate before it below which a level no longer falls."""
WILD, WILD_OVER = 2.5, 15
"""dB of scatter from one block to the next, over so many, at which a level is a floor's (of random phase: 5.6)."""
LAST, ROUGHER = 8, 3.0
"""Least number of readings at a record's end that are checked for a steeper fall; multiple of the roughness of a
decay's first eighth that a floor, which scatters by 5.6 dB where it is of random phase, has at least."""
SMOOTH = 7
"""Blocks over which the level is smoothed where it is compared with the floor's."""
LEVEL = 0.15
"""As SLOWEST, the multiple below which a fall is never part of the decay, however the slope varies."""
TOLERANCE = 3.0
"""Multiple of the usual change of the slope that a slope must deviate by to be no part of the decay."""


@dataclass(frozen=True)
class SeenFloor:
    """A floor in units of the reading's power.

    power: its mean; decay: mean power of the remaining decay in the readings that it was measured from; swing: half of
    the mean square difference of readings a LAG apart (power squared), nan where there are too few readings; error:
    relative standard error of swing over power squared.
    """

    power: float
    decay: float = 0.0
    swing: float = float("nan")
    error: float = float("nan")

    def scaled(self, factor: float) -> SeenFloor:
        """Return the floor in another unit of power."""
        return SeenFloor(self.power * factor, self.decay * factor, self.swing * factor**2, self.error)

    def parts(self, slow: float) -> tuple[float, float, float, float]:
        """Separate the fluctuating and the constant power of the floor.

        Of a circular Gaussian of power F and autocorrelation R, added to an amplitude of power D, half of the mean
        square difference of powers is F²(1 - R²) + 2FD(1 - R). The rest of the mean is constant; the weight is that of
        a uniform prior for the constant's share.

        Parameters
        ----------
        slow
            Share of the fluctuations that is slow.

        Returns
        -------
        tuple[float, float, float, float]
            Fluctuating power, constant power, its sd, log weight.
        """
        if not np.isfinite(self.swing):
            return self.power, 0.0, 0.0, 0.0
        correlation = slow * np.exp(-LAG)
        a, b = 1.0 - correlation**2, (1.0 - correlation) * self.decay
        fluctuating = (np.sqrt(b * b + a * self.swing) - b) / a
        if fluctuating <= self.power:
            constant = self.power - fluctuating
            sd = float(np.hypot(KNOWN * constant, 0.5 * self.error * fluctuating))
            return float(fluctuating), float(constant), sd, float(np.log(fluctuating / self.power))
        most = a * self.power**2 + 2.0 * b * self.power
        off = np.log(self.swing / most) / self.error
        return self.power, 0.0, 0.0, float(-0.5 * off**2)


def measure_floor(t: np.ndarray, power: np.ndarray, decay: np.ndarray, rate: float) -> SeenFloor:
    """Return the floor in the readings behind a decay.

    Parameters
    ----------
    t
        Times in s, shape (n,).
    power, decay
        Power of the readings, and of the decay itself at these times, shape (n,).
    rate
        Mean -d ln A/dt of the decay in 1/s.
    """
    rest = float(decay.mean())
    mean = max(float(power.mean()) - rest, 0.1 * float(power.mean()))
    span = rate * float(t[-1] - t[0])
    lag = max(1, round(LAG * (t.size - 1) / span)) if span > 0 else t.size
    if t.size < LEAST + lag:
        return SeenFloor(mean)
    squares = 0.5 * (power[lag:] - power[:-lag]) ** 2
    swing = float(squares.mean())
    if not swing > 0:
        return SeenFloor(mean)
    # Of the swing in units of the power squared, both of which a few slow values of the floor may change.
    error = np.hypot(_relative_error(squares), 2.0 * _relative_error(power))
    return SeenFloor(mean, rest, swing, float(error))


def _relative_error(values: np.ndarray) -> float:
    """Return the relative standard error of the mean of correlated values, from those of PARTS stretches."""
    means = np.array([part.mean() for part in np.array_split(values, PARTS)])
    return float(means.std(ddof=1)) / np.sqrt(PARTS) / float(means.mean())


def blocks(t: np.ndarray, y: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return means of times and values over at most so many runs of samples, and the runs' bounds (blocks + 1,)."""
    count = min(most, t.size)
    edges = np.linspace(0, t.size, count + 1).round().astype(int)
    size = np.diff(edges)
    return np.add.reduceat(t, edges[:-1]) / size, np.add.reduceat(y, edges[:-1]) / size, edges


def fall(y: np.ndarray, begin: int, end: int) -> float:
    """Return the fall in dB from the first twentieth to the last."""
    if end - begin < 2:
        return 0.0
    part = max(1, (end - begin) // 20)
    return float(y[begin : begin + part].mean() - y[end - part : end].mean())


@dataclass(frozen=True, eq=False)
class Levels:
    """Levels over time, and their means over blocks of samples.

    t: in s, y: in dB of power, (n,); tb, yb: their means, (blocks,); edges: bounds of the blocks, (blocks + 1,).
    """

    t: np.ndarray
    y: np.ndarray
    tb: np.ndarray
    yb: np.ndarray
    edges: np.ndarray


@dataclass(frozen=True, eq=False)
class DecayFit:
    """A power of the amplitude and a floor, fitted from a block on.

    x: ln of the amplitude at the blocks; floor: its power; floor_at: the block from which the floor is visible;
    stop: the reading up to which both were fitted; scale: the level in dB that these are relative to.
    """

    x: np.ndarray
    floor: float
    floor_at: int
    stop: int
    scale: float


def power_law_start(levels: Levels, begin: int, end: int) -> int:
    """Return the block from which one power of the amplitude, and a floor, describe the level up to a block.

    Straight lines follow a decay back only as long as it is straight in dB: dry friction bends it, and drag. The search
    halves the blocks before the one that straight lines gave (begin), which is kept where little is gained.
    """
    y = levels.yb
    low, first = -1, begin
    while first - low > 1:
        middle = (low + first) // 2
        if power_law_holds(levels, middle):
            first = middle
        else:
            low = middle
    span, whole = max(end - first, 1), fall(y, first, end)
    won = whole - fall(y, begin, end)
    if won < LEAST_DROP or (begin - first < WON * span and won < WON * whole):
        return begin
    return first + (max(1, round(GUARD * span)) if first > 0 else 0)


def power_law_holds(levels: Levels, at: int) -> bool:
    """Return whether one power of the amplitude, and a floor, describe the level from a block on.

    They must also describe it right behind that block by itself.
    """
    fit = fit_power_law(levels, at)
    x = fit.x[: max(fit.floor_at - at, LEAST_POINTS)]
    off = levels.yb[at : at + x.size] - fit.scale - 10.0 * np.log10(np.exp(2.0 * x) + fit.floor)
    z = off / np.hypot(SMALLEST, NEPER * np.sqrt(0.5 * fit.floor) * np.exp(-x))
    first = z[: max(LEAST_POINTS, round(CHECKED * z.size))]
    return bool(max(np.mean(z**2), np.mean(first**2)) <= WORSE**2)


def fit_power_law(levels: Levels, begin: int) -> DecayFit:
    """Fit a power of the amplitude and a floor from a block on."""
    t, y = levels.t, levels.y
    start, stop = int(levels.edges[begin]), y.size
    scale = float(y[start:].max())
    x, floor_at, floor, p = np.zeros(0), levels.tb.size, 0.0, None
    for _ in range(2):
        tc, power, _ = blocks(t[start:stop], 10.0 ** ((y[start:stop] - scale) / 10.0), FITTED)
        p = _fit_decay_and_floor(tc - t[start], power, p)
        times = levels.tb[begin:] - t[start]
        x = power_decay(times, p[0], p[1] - (p[2] - 1.0) * p[0], p[2])
        floor = float(np.exp(p[3]))
        reached = np.flatnonzero(np.exp(2.0 * x) < floor)
        if not reached.size:
            break
        # What the floor does long after is not what it does to the decay.
        floor_at = begin + int(reached[0])
        stop = int(np.searchsorted(t, t[start] + 2.0 * float(times[reached[0]])))
        stop = min(max(stop, start + LEAST_POINTS), y.size)
        if stop >= y.size:
            break
    return DecayFit(x, floor, floor_at, stop, scale)


def _fit_decay_and_floor(t: np.ndarray, power: np.ndarray, begin: np.ndarray | None) -> np.ndarray:
    """Fit powers (n,) at times t (s); return ln of the first amplitude and rate, the exponent, and ln of the floor.

    begin: the values to start from; None for three exponents.
    """
    level = 5.0 * np.log(power)
    tail = float(np.median(power[-max(2, power.size // 8) :]))
    x0 = 0.5 * float(np.log(power[:3].mean()))
    fallen = np.flatnonzero(0.5 * np.log(power) < 0.5 * (x0 + 0.5 * np.log(tail)))
    half = float(t[fallen[0]]) if fallen.size and fallen[0] > 0 else float(t[-1])
    depth = max(0.5 * (x0 - 0.5 * np.log(tail)), 0.05)
    # A tolerance of 0.3 dB, and of what a floor of random phase does to a level.
    width = np.hypot(0.3, 5.0 * np.sqrt(0.5 * tail / np.maximum(power, tail)))

    def signal(p: np.ndarray) -> np.ndarray:
        return np.exp(2.0 * power_decay(t, p[0], p[1] - (p[2] - 1.0) * p[0], p[2]))

    def residuals(p: np.ndarray) -> np.ndarray:
        return (5.0 * np.log(signal(p) + np.exp(p[3])) - level) / width

    def jacobian(p: np.ndarray) -> np.ndarray:
        decay, floor = signal(p), np.exp(p[3])
        columns = np.column_stack([2.0 * decay[:, None] * power_slopes(t, p), np.full(t.size, floor)])
        return columns * (5.0 / ((decay + floor) * width))[:, None]

    low, high = [-30.0, -60.0, EXPONENTS[0], -80.0], [10.0, 60.0, EXPONENTS[1], 1.0]
    starts = [] if begin is None else [begin]
    for exponent in (1.0, 0.2, 1.8) if begin is None else ():
        # The rate at the start with which this law falls by `depth` in the time `half`.
        q = exponent - 1.0
        rate = depth if q == 0.0 else np.expm1(q * depth) / q
        starts.append(np.array([x0, np.log(rate / max(half, 1e-300)), exponent, np.log(tail)]))
    fits = [
        least_squares(
            residuals,
            np.clip(p, low, high),
            jacobian,  # type: ignore[arg-type]
            bounds=(low, high),
            loss="soft_l1",
            max_nfev=25,
            x_scale=[1.0, 1.0, 0.3, 1.0],
        )
        for p in starts
    ]
    return min(fits, key=lambda fit: fit.cost).x


@dataclass(frozen=True)
class EnvelopeWindow:
    """The part of a record that decays freely.

    start, stop: indices of its first sample and behind its last one. why: sentences on how they were chosen.
    floor: the noise floor measured behind it, None where the record does not reach it.
    """

    start: int
    stop: int
    floor: SeenFloor | None
    why: tuple[str, ...]


def find_window(t: np.ndarray, y: np.ndarray) -> EnvelopeWindow:
    """Find the free decay in times (s) and levels (dB of power), both of shape (n,).

    The search follows what an eye does: the longest straight descent, followed back to where it begins (the reading
    before it is above or below its continuation) and on to the noise floor. Raises Refusal where nothing decays.
    """
    if t.size < LEAST_POINTS:
        raise Refusal(f"{t.size} readings: an envelope needs at least {LEAST_POINTS}")
    if t.size < SPARSE:
        # A table of few readings, which somebody has read off a decay already: from the highest one on.
        top = int(np.argmax(y))
        if t.size - top < LEAST_POINTS:
            raise Refusal(
                f"{t.size - top} readings from the highest one on: at least {LEAST_POINTS} are needed"
            )
        _refuse_small(float(y[top] - y[-1]))
        begins = "starts with the record" if top == 0 else f"starts at {t[top]:.4g} s, the highest reading"
        return EnvelopeWindow(top, t.size, None, (begins, "ends with the record"))
    levels = Levels(t, y, *blocks(t, y, POINTS))
    yb = levels.yb
    first, last = _straightest(levels)
    core = fall(yb, first, last + 1)
    top = int(np.argmax(yb))
    # Or it falls from its highest block on, nowhere straight, by one power of the amplitude.
    bent = core < LEAST_DROP and fall(yb, top, yb.size) > SURE_DROP and power_law_holds(levels, top)
    if not bent:
        _refuse_small(core)
    begin, broken = first, first > 0
    for _ in range(ROUNDS):
        before = begin
        begin, broken = _follow_back(levels, begin, last)
        if abs(begin - before) <= 1:
            break
    end, floor = _follow_on(levels, begin)
    if core > SURE_DROP and (fall(yb, begin, end) < LEAST_DROP or fall(yb, begin, last) < LOST * core):
        begin, broken = first, first > 0  # the short lines gave a start that leaves no decay
        end, floor = _follow_on(levels, begin)
    earlier = power_law_start(levels, begin, end)
    if earlier != begin:
        behind, lower = _follow_on(levels, earlier)
        # Unless what it takes for its floor is a decay.
        if min(fall(yb, begin, end), fall(yb, behind, end)) < LEAST_DROP:
            begin, broken, end, floor = earlier, earlier > 0, behind, lower
    start, stop = int(levels.edges[begin]), int(levels.edges[end])
    begins = "starts with the record"
    if broken:
        begins = f"starts at {t[start]:.4g} s, where the reading before it does not continue the decay"
    ends = "ends with the record, above any floor" if stop == t.size else f"ends at {t[stop - 1]:.4g} s"
    if floor is not None:
        ends = f"ends at {t[stop - 1]:.4g} s, {ABOVE_FLOOR:g} dB above the noise floor"
    if stop - start < LEAST_POINTS:
        raise Refusal(f"only {stop - start} readings are between the start and the noise floor")
    _refuse_small(fall(yb, begin, end))
    return EnvelopeWindow(start, stop, floor, (begins, ends))


def _refuse_small(drop: float) -> None:
    """Raise Refusal for a fall in dB that is too small."""
    if drop < LEAST_DROP:
        raise Refusal(f"the level falls by {max(drop, 0):.1f} dB, {LEAST_DROP:g} are needed")


def bounded(t: np.ndarray, y: np.ndarray, start: float | None, stop: float | None) -> EnvelopeWindow:
    """Return the window between given bounds, in s of the record's clock; None: as `find_window` finds it.

    Raises Refusal where too few readings are between them.
    """
    try:
        window = find_window(t, y)
    except Refusal:
        if start is None or stop is None:
            raise
        window = EnvelopeWindow(0, t.size, None, ("", ""))
    first, behind = window.start, window.stop
    begins, ends = window.why
    if start is not None:
        first = int(np.searchsorted(t, start))
    if stop is not None:
        behind = int(np.searchsorted(t, stop, side="right"))
    if behind - first < LEAST_POINTS:
        raise Refusal(
            f"{max(0, behind - first)} readings are between start and stop; at least {LEAST_POINTS} are needed"
        )
    if start is not None:
        begins = f"starts at {t[first]:.4g} s, as asked"
    if stop is not None:
        ends = f"ends at {t[behind - 1]:.4g} s, as asked"
    return EnvelopeWindow(first, behind, window.floor, (begins, ends))


def _straightest(levels: Levels) -> tuple[int, int]:
    """Return the first and last block of the descent that falls farthest for the misfit of a straight line.

    Levels are means of power, and none is below that of the record's end: a floor's dips are not a descent.
    """
    t, power, edges = blocks(levels.tb, 10.0 ** ((levels.yb - levels.yb.max()) / 10.0), COARSE)
    y = 10.0 * np.log10(power)
    y = np.maximum(y, 10.0 * np.log10(power[-max(1, y.size // 12) :].mean()))
    i, j = np.triu_indices(t.size + 1, k=min(4, t.size))
    slope, rms = _lines(t, y, i, j)
    falls = slope * (t[i] - t[j - 1])
    best = int(np.argmax(falls - MISFIT_WEIGHT * rms))
    if not falls[best] > 0:
        raise Refusal("the level never falls")
    return int(edges[i[best]]), int(edges[j[best]]) - 1


def _follow_back(levels: Levels, first: int, last: int) -> tuple[int, bool]:
    """Return the block at which the decay begins, and whether something else precedes it.

    Short straight lines are fitted to the readings; going back from the straight part, the first one that fits
    worse than those do, or falls at another rate, contains readings that are not part of the decay.
    """
    t, y = levels.tb, levels.yb
    span = last - first + 1
    width = max(NARROWEST, round(SHORT * span))
    if span < width + 2:
        return first, first > 0
    begins = np.arange(t.size - width + 1)
    slope, rms = _lines(t, y, begins, begins + width)
    behind = max(first + 2, min(first + 3 * span // 5, last - width))
    known = slice(min(first + span // 4, behind - 2), behind)
    rate = float(np.median(slope[known]))
    lag = min(width, (known.stop - known.start) // 2)
    wobble = float(np.median(np.abs(np.diff(slope[known][:: max(1, lag)])))) if lag else 0.0
    at = min(first + 2 * span // 5, known.stop - 1)
    while at > 0:
        ahead = slope[at : at + width]
        rate = float(np.median(ahead[ahead < 0])) if np.any(ahead < 0) else rate
        ratio = slope[at - 1] / rate
        odd = not SLOWEST <= ratio <= FASTEST and abs(slope[at - 1] - rate) > TOLERANCE * wobble
        usual = float(np.median(rms[at : at + AHEAD * width]))
        if odd or ratio < LEVEL or rms[at - 1] > max(WORSE * usual, SMALLEST / 3):
            near = slice(max(0, at - width), min(at + 2 * width, last + 1))
            t, y = t[near], y[near]
            corners = np.arange(3, t.size - 2)
            if corners.size:  # from the corner on, a second straight line describes these readings best
                rms_before = _lines(t, y, np.zeros_like(corners), corners)[1]
                rms_after = _lines(t, y, corners, np.full_like(corners, t.size))[1]
                squares = corners * rms_before**2 + (t.size - corners) * rms_after**2
                at = max(at, near.start + int(corners[np.argmin(squares)]))
            return min(at + max(1, round(GUARD * span)), last - 3), True
        at -= 1
    return 0, False


def _lines(t: np.ndarray, y: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return slope and root mean square misfit of straight lines through readings low (k,) to, not with, high (k,)."""
    t = t - t.mean()
    terms = (np.ones_like(t), t, t * t, y, y * t, y * y)
    sums = [np.concatenate([[0.0], np.cumsum(term)]) for term in terms]
    n, st, stt, sy, sty, syy = (total[high] - total[low] for total in sums)
    spread = np.maximum(stt - st * st / n, 1e-300)
    slope = (sty - st * sy / n) / spread
    return slope, np.sqrt(np.maximum(syy - sy * sy / n - slope * slope * spread, 0.0) / n)


def _follow_on(levels: Levels, begin: int) -> tuple[int, SeenFloor | None]:
    """Return the block behind the decay's last one, and the floor that is measured behind it.

    A decay by a power of the amplitude, plus a floor, is fitted to the powers from the start on, robustly.
    """
    t, y, tb, yb, edges = levels.t, levels.y, levels.tb, levels.yb, levels.edges
    count = tb.size
    fit = fit_power_law(levels, begin)
    x, floor, floor_at, stop, scale = fit.x, fit.floor, fit.floor_at, fit.stop, fit.scale
    behind = slice(int(edges[floor_at]), stop)
    measured = SeenFloor(floor)
    if stop - behind.start > 4:
        power = 10.0 ** ((y[behind] - scale) / 10.0)
        floor = max(floor, float(power.mean()))
        rest = np.exp(2.0 * np.interp(t[behind], tb[begin:], x))
        took = float(tb[floor_at] - tb[begin])
        rate = float(x[0] - x[floor_at - begin]) / took if took > 0 else 0.0
        measured = measure_floor(t[behind], power, rest, rate)
    elif (part := (count - begin) // 8) >= 3:
        # Where the last part of the record no longer falls, its mean power is that of the floor.
        late, level = tb[begin:], yb[begin:] - scale
        last_power, power_before = 10.0 ** (level[-part:] / 10.0), 10.0 ** (level[-2 * part : -part] / 10.0)
        step = float(late[-part:].mean() - late[-2 * part : -part].mean())
        middle = slice(level.size // 2, level.size // 2 + part)
        took = float(late[middle].mean() - late[:part].mean())
        usual = float(level[:part].mean() - level[middle].mean()) / took
        if 10.0 * np.log10(power_before.mean() / last_power.mean()) < FLAT * usual * step:
            floor, floor_at = max(floor, float(last_power.mean())), count - 1
            measured = SeenFloor(floor)
    end, after = count, yb[begin:]
    if after.size >= 2 * WILD_OVER:  # where levels scatter as at a floor, a decay cannot be recognised
        bends = (after[1:-1] - 0.5 * (after[:-2] + after[2:])) ** 2 / 1.5
        wild = np.flatnonzero(np.convolve(bends, np.ones(WILD_OVER) / WILD_OVER, "valid") > WILD**2)
        end = min(count, begin + int(wild[0]) + WILD_OVER // 2) if wild.size else count
    if floor_at == count and floor < 10.0 ** (-ABOVE_FLOOR / 10.0) * np.exp(2.0 * x[-1]):
        return end, None
    if _steepens(t, y, int(edges[begin]), int(edges[floor_at]), stop):
        return end, None
    limit = 10.0 ** (ABOVE_FLOOR / 10.0) * floor
    above = np.flatnonzero(np.exp(2.0 * x) < limit)
    end = min(end, begin + int(above[0])) if above.size else end
    if end - begin > SMOOTH:
        smooth = np.convolve(yb[begin:end], np.ones(SMOOTH) / SMOOTH, "valid")
        below = np.flatnonzero(smooth - scale < 10.0 * np.log10(limit) - 3.0)
        end = begin + int(below[0]) + SMOOTH // 2 if below.size else end
    return end, measured.scaled(10.0 ** (scale / 10.0))


def _steepens(t: np.ndarray, y: np.ndarray, begin: int, floor_at: int, stop: int) -> bool:
    """Return whether readings from `floor_at` to `stop`, or the last few, are a decay rather than a floor.

    They fall faster than those before do and are no rougher than the decay's first eighth, from `begin` on: one power
    of the amplitude does not follow this decay.
    """
    floor_at = min(floor_at, stop - LAST)
    before = slice(max(begin, floor_at - max(NARROWEST, (floor_at - begin) // 4)), floor_at)
    if before.stop - before.start < LEAST_POINTS:
        return False
    slope, usual = (
        float(np.polyfit(t[part] - t[floor_at], y[part], 1)[0]) for part in (slice(floor_at, stop), before)
    )
    early, late = y[begin : begin + max((floor_at - begin) // 8, LAST)], y[floor_at:stop]
    # Third differences, which a curve hardly has.
    rough_early, rough_late = (float(np.median(np.abs(np.diff(part, 3)))) for part in (early, late))
    return slope < usual < 0.0 and rough_late < ROUGHER * rough_early
