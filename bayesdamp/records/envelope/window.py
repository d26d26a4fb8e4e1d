"""Find the free decay in an envelope record, between the end of the drive and the noise floor.

The decay of the amplitude A is described by a power law: dA/dt ∝ −A^p, with unknown exponent p.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.physics.amplitude import EXPONENT_RANGE, power_decay, power_slopes
from bayesdamp.types import Refusal

NEPER = 20.0 / np.log(10.0)
"""Number of dB in a neper (a change of the amplitude by the factor e): 20/ln 10."""
# Unless a comment says otherwise, the following thresholds are conventional.
FITTED_BLOCKS = 80
"""A decay and a noise floor are fitted to averages of blocks of successive readings; this is the largest number of
blocks."""
LEAST_DROP = 3.0
"""Smallest fall of the level in dB for a decay; with less, the record is refused. Half the amplitude is −6 dB."""
LEAST_POINTS = 6
"""Smallest number of readings of a decay; with fewer, the record is refused."""
MISFIT_RATIO = 2.0
"""To find the start of the decay, short straight lines are fitted to the level. The readings of a line are not part of
the decay if its rms misfit is more than this many times the median misfit of the lines after it. A power law, too, does
not describe the levels if its rms misfit is more than this many times the expected scatter."""
GUARD_FRACTION = 0.02
"""If other readings, such as those of a drive, precede the decay, this fraction of it is left out at its start."""
CHECKED_FRACTION = 0.05
"""A power law describes a decay only if its misfit is small over all blocks of the decay and also over the first blocks
alone, which are this fraction of all (at least `LEAST_POINTS`)."""
LEAST_SHORTENING = 0.15
"""The fit of a power law may give an earlier start of the decay than the search with straight lines, and then also an
earlier end. The earlier start is rejected if the part that is lost at the end is a decay too: if it lasts at least this
fraction of the duration of the new decay, and falls by at least LEAST_DROP."""
LEAST_DEVIATION = 0.15
"""A deviation of a level from a fit is not significant if it is at most this many dB, because nonlinear detectors cause
deviations of this size."""
ABOVE_FLOOR = 10.0
"""A decay ends where its level is this many dB above the mean power of the noise floor. Above this, the scatter of the
level caused by the floor is still nearly Gaussian, and the floor shifts the mean of ln amplitude by less than 1e-5 (for
a circular complex Gaussian floor)."""
LAG_IN_DECAY_TIMES = 0.1
"""Time between two readings of the noise floor that are compared, as a fraction of the decay time 1/rate of the
amplitude. Thermal motion of the mode itself is correlated over its decay time and hardly changes between the two
readings; detector noise does."""
FLOOR_PARTS = 8
"""Number of parts into which the readings of the noise floor are divided. The standard errors of their mean power and
semivariance follow from the scatter of the parts' means, because successive readings are correlated."""
LEAST_FLOOR_READINGS = 24
"""Smallest number of readings from which the fluctuation of the noise floor is measured; from fewer readings, only its
mean power is measured."""
CONSTANT_FLOOR_SD = 0.3
"""Relative standard deviation that is assumed for the constant part of the noise floor's power. The floor is measured
after the decay, and may have been different during it."""
MOST_BLOCKS = 600
"""Before the decay is searched for, the readings of a record are averaged in blocks of successive readings; this is the
largest number of blocks."""
COARSE_BLOCKS = 72
"""The straightest descent is the part of the record that falls most like a straight line in dB. It is searched for in
averages of blocks of successive readings; this is the largest number of blocks (`_straightest`)."""
LEAST_REMAINING = 0.4
"""The search with short straight lines gives a start of the decay. It is rejected if too little of the straightest
descent (the part that falls most like a straight line in dB) comes after it: less than this fraction of the descent's
fall in dB."""
SPARSE_READINGS = 60
"""A record with fewer readings is assumed to be a table of a decay, which begins at the highest reading. The readings
at its end are a noise floor only if there are more than four and they do not fall (`FALLING_SDS`)."""
FALLING_SDS = 3.0
"""The last readings of a record with few readings fall, and are not a noise floor, if the slope of a straight line
through them is negative by more than this many standard errors (conventional)."""
MISFIT_WEIGHT = 20.0
"""The straightest descent is the part of the record for which the fall in dB minus this factor times the rms misfit of
a straight line in dB is largest."""
SHORTEST_LINE = 10
"""To find the start of the decay, short straight lines are fitted to the level. This is the smallest number of blocks
(averages of readings) in a line."""
START_ROUNDS = 4
"""The search for the start of the decay is repeated from the start that it gave, at most this many times in all."""
LINE_FRACTION = 0.12
"""To find the start of the decay, short straight lines are fitted to the level. This is their length, as a fraction of
the duration of the straightest descent (the part of the record that falls most like a straight line in dB)."""
LINES_AHEAD = 2
"""To find the start of the decay, short straight lines are fitted to the level. The misfit of a line is compared with
the median misfit of the lines after it, but only of those within this many line lengths, because the misfit grows
towards the noise floor."""
SLOWEST_RATE, FASTEST_RATE = 0.4, 5.0
"""To find the start of the decay, short straight lines are fitted to the level. A line is not part of the decay if it
falls more slowly than `SLOWEST_RATE`, or faster than `FASTEST_RATE`, times the rate of the lines after it, and the
difference also exceeds the limit of `SLOPE_CHANGES`."""
NOISE_SCATTER, SCATTER_BLOCKS = 2.5, 15
"""The decay ends where the level scatters from block to block like noise: by more than `NOISE_SCATTER` dB (standard
deviation) over `SCATTER_BLOCKS` blocks of readings. Noise of random phase scatters by 5.6 dB."""
LEAST_LAST_READINGS, ROUGHNESS_RATIO = 8, 3.0
"""At least `LEAST_LAST_READINGS` readings at the end of a record are tested: they are a noise floor or a part of the
decay that steepens. They are a floor if their scatter from reading to reading is at least `ROUGHNESS_RATIO` times that
in the first eighth of the decay (noise of random phase scatters by 5.6 dB)."""
LEVEL_RATE = 0.15
"""To find the start of the decay, short straight lines are fitted to the level. A line that falls at less than this
fraction of the rate of the lines after it is never part of the decay, even if it is within the limit of
`SLOPE_CHANGES`."""
SLOPE_CHANGES = 3.0
"""To find the start of the decay, short straight lines are fitted to the level. A line whose rate is outside of the
limits `SLOWEST_RATE` and `FASTEST_RATE` is not part of the decay only if its rate also differs from that of the lines
after it by more than this many times the median change of the rate between lines."""


@dataclass(frozen=True)
class NoiseFloor:
    """A measured noise floor. All powers are linear: 10^(dB/10) of a level, up to a common factor (`scaled`).

    Attributes
    ----------
    power
        Mean power of the floor.
    decay
        Mean power of the decay that is still present in the readings of the floor; 0 if semivariance is NaN.
    semivariance
        Half of the mean squared difference between powers that are `LAG_IN_DECAY_TIMES` decay times apart; NaN if there
        are too few readings.
    error
        Relative standard error of semivariance / power²; NaN if semivariance is NaN.
    """

    power: float
    decay: float = 0.0
    semivariance: float = float("nan")
    error: float = float("nan")

    def scaled(self, factor: float) -> NoiseFloor:
        """Return the floor with all powers multiplied by a factor, and `semivariance` by its square."""
        return NoiseFloor(self.power * factor, self.decay * factor, self.semivariance * factor**2, self.error)

    def parts(self, slow: float) -> tuple[float, float, float, float]:
        """Separate the power of the noise floor into a fluctuating and a constant part.

        The fluctuating part, of power F, is assumed to be circular Gaussian noise. Its autocorrelation between two
        readings that are `LAG_IN_DECAY_TIMES` decay times apart is R = `slow` · exp(-LAG_IN_DECAY_TIMES). The readings
        also contain the rest of the decay, of power D = `decay`. Half of the mean squared difference between the powers
        of two such readings is then F²(1 - R²) + 2FD(1 - R). Its measured value is `semivariance`, from which F
        follows. The rest of `power` is constant.

        If this F would be larger than `power`, or if `semivariance` is NaN, all of `power` is fluctuating.

        Parameters
        ----------
        slow
            Fraction of the fluctuating power that changes slowly, over a decay time (thermal motion of the mode), from
            0 to 1. The rest is independent between the two readings (detector noise).

        Returns
        -------
        fluctuating, constant : float
            The two powers, in the unit of `power`.
        constant_sd : float
            Standard deviation of the constant power; 0 in the two cases above.
        log_weight : float
            Log likelihood of `slow`, up to a constant, so that several values of `slow` can be compared. The fraction
            of the power that is constant has a uniform prior, and is integrated out. If `semivariance` is larger than
            its value s for F = `power`, the log likelihood is -½ (ln(`semivariance`/s) / `error`)². It is 0 if
            `semivariance` is NaN.
        """
        if not np.isfinite(self.semivariance):
            return self.power, 0.0, 0.0, 0.0
        correlation = slow * np.exp(-LAG_IN_DECAY_TIMES)
        a, b = 1.0 - correlation**2, (1.0 - correlation) * self.decay
        fluctuating = (np.sqrt(b * b + a * self.semivariance) - b) / a
        if fluctuating <= self.power:
            constant = self.power - fluctuating
            sd = float(np.hypot(CONSTANT_FLOOR_SD * constant, 0.5 * self.error * fluctuating))
            return float(fluctuating), float(constant), sd, float(np.log(fluctuating / self.power))
        most = a * self.power**2 + 2.0 * b * self.power
        return self.power, 0.0, 0.0, float(-0.5 * (np.log(self.semivariance / most) / self.error) ** 2)


def measure_floor(t: np.ndarray, power: np.ndarray, decay: np.ndarray, rate: float) -> NoiseFloor:
    """Measure the noise floor in the readings after a decay.

    Parameters
    ----------
    t
        Times in s, shape (n,).
    power, decay
        Power of the readings, and power of the fitted decay at these times, shape (n,), both linear (not in dB) and in
        the same unit.
    rate
        Mean decay rate -d ln A/dt of the amplitude A in 1/s.

    Returns
    -------
    NoiseFloor
        The floor. Its power is the mean of `power` minus the mean of `decay`, but at least a tenth of the mean of
        `power`. If there are fewer than about `LEAST_FLOOR_READINGS` readings or they do not fluctuate, only this power
        is set.
    """
    rest = float(decay.mean())
    mean = max(float(power.mean()) - rest, 0.1 * float(power.mean()))
    span = rate * float(t[-1] - t[0])
    lag = max(1, round(LAG_IN_DECAY_TIMES * (t.size - 1) / span)) if span > 0 else t.size
    if t.size < LEAST_FLOOR_READINGS + lag:
        return NoiseFloor(mean)
    squares = 0.5 * (power[lag:] - power[:-lag]) ** 2
    semivariance = float(squares.mean())
    if not semivariance > 0:
        return NoiseFloor(mean)
    # Error of semivariance / power². Each error is from the means of parts, because successive readings are correlated.
    error = np.hypot(_relative_error(squares), 2.0 * _relative_error(power))
    return NoiseFloor(mean, rest, semivariance, float(error))


def _relative_error(values: np.ndarray) -> float:
    """Return the relative standard error of the mean of correlated values (n,), from the means of FLOOR_PARTS parts."""
    means = np.array([part.mean() for part in np.array_split(values, FLOOR_PARTS)])
    return float(means.std(ddof=1)) / np.sqrt(FLOOR_PARTS) / float(means.mean())


def average_in_blocks(t: np.ndarray, y: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Average times and values (n,) in `most` blocks of about equally many samples, or in n blocks if n is smaller.

    Return mean times and mean values, (blocks,) each, and the bounds, (blocks + 1,): block i consists of the samples
    with indices bounds[i] to bounds[i + 1] − 1.
    """
    edges = np.linspace(0, t.size, min(most, t.size) + 1).round().astype(int)
    size = np.diff(edges)
    return np.add.reduceat(t, edges[:-1]) / size, np.add.reduceat(y, edges[:-1]) / size, edges


def fall_in_db(y: np.ndarray, begin: int, end: int) -> float:
    """Return by how many dB the levels y[begin:end] fall: the mean of the first 5 % of them minus that of the last 5 %.

    y: levels in dB, (n,). The result is 0 for fewer than two levels.
    """
    if end - begin < 2:
        return 0.0
    part = max(1, (end - begin) // 20)
    return float(y[begin : begin + part].mean() - y[end - part : end].mean())


@dataclass(frozen=True, eq=False)
class Levels:
    """The levels of a record against time, and their means in blocks of successive readings.

    t: times in s, (n,). y: levels in dB, (n,). tb, yb: mean times and mean levels of the blocks, (blocks,). edges,
    (blocks + 1,): block i consists of the readings with indices edges[i] to edges[i + 1] − 1.
    """

    t: np.ndarray
    y: np.ndarray
    tb: np.ndarray
    yb: np.ndarray
    edges: np.ndarray


@dataclass(frozen=True, eq=False)
class DecayFit:
    """A power-law decay of the amplitude plus a noise floor, fitted to the levels from a start block on.

    Attributes
    ----------
    x
        ln of the decay's amplitude at each block from the start block to the last block of the record.
    floor
        Power of the floor, linear (not in dB).
    floor_at
        Index, among all blocks of the record, of the first one in which the power of the decay is below that of the
        floor; the number of blocks if there is none.
    stop
        1 + index of the last reading that was fitted.
    scale
        Level in dB to which amplitude and floor are relative.
    """

    x: np.ndarray
    floor: float
    floor_at: int
    stop: int
    scale: float


def power_law_start(levels: Levels, begin: int, end: int) -> int:
    """Return the index of the block at which the decay starts, from fits of a power law and a noise floor.

    The start `begin` from the search with straight lines may be too late, because dry friction and drag curve the level
    in dB. This function searches the blocks before `begin`, by bisection, for the first block from which a power law
    and a floor describe the levels, and adds a margin (`GUARD_FRACTION`) unless this is the first block of the record.
    The result is `begin` itself if the fall of the decay in dB would increase by less than `LEAST_DROP`.

    levels: levels of the record and their blocks. begin, end: indices of the first block of the decay, according to
    straight lines, and of the block after its last one.
    """
    y = levels.yb
    low, first = -1, begin
    while first - low > 1:
        middle = (low + first) // 2
        if power_law_holds(levels, middle):
            first = middle
        else:
            low = middle
    if fall_in_db(y, first, end) - fall_in_db(y, begin, end) < LEAST_DROP:
        return begin
    return first + (max(1, round(GUARD_FRACTION * (end - first))) if first > 0 else 0)


def power_law_holds(levels: Levels, at: int) -> bool:
    """Return whether a power law and a noise floor, fitted from block `at` on, describe the levels until the floor.

    They do if their rms misfit is at most `MISFIT_RATIO` times the expected scatter, which is `LEAST_DEVIATION`
    combined with the scatter that the floor causes. This must be true for all blocks until the floor, and also for the
    first of them alone (`CHECKED_FRACTION`).
    """
    fit = fit_power_law(levels, at)
    x = fit.x[: max(fit.floor_at - at, LEAST_POINTS)]
    off = levels.yb[at : at + x.size] - fit.scale - 10.0 * np.log10(np.exp(2.0 * x) + fit.floor)
    z = off / np.hypot(LEAST_DEVIATION, NEPER * np.sqrt(0.5 * fit.floor) * np.exp(-x))
    first = z[: max(LEAST_POINTS, round(CHECKED_FRACTION * z.size))]
    return bool(max(np.mean(z**2), np.mean(first**2)) <= MISFIT_RATIO**2)


def fit_power_law(levels: Levels, begin: int) -> DecayFit:
    """Fit a power law dA/dt = −c A^p plus a constant noise power to the levels (dB) from block `begin` on.

    It is a robust least-squares fit to the logs of mean powers in up to `FITTED_BLOCKS` blocks. If the decay reaches
    the floor after some time, readings after twice this time are left out.
    """
    t, y = levels.t, levels.y
    start, stop = int(levels.edges[begin]), y.size
    scale = float(y[start:].max())
    x, floor_at, floor, p = np.zeros(0), levels.tb.size, 0.0, None
    for _ in range(2):
        powers = 10.0 ** ((y[start:stop] - scale) / 10.0)
        tc, power, _ = average_in_blocks(t[start:stop], powers, FITTED_BLOCKS)
        p = _fit_decay_and_floor(tc - t[start], power, p)
        times = levels.tb[begin:] - t[start]
        x = power_decay(times, p[0], p[1] - (p[2] - 1.0) * p[0], p[2])
        floor = float(np.exp(p[3]))
        reached = np.flatnonzero(np.exp(2.0 * x) < floor)
        if not reached.size:
            break
        # Fit again only up to twice the time at which the floor is reached, because the floor may change later.
        floor_at = begin + int(reached[0])
        stop = int(np.searchsorted(t, t[start] + 2.0 * float(times[reached[0]])))
        stop = min(max(stop, start + LEAST_POINTS), y.size)
        if stop >= y.size:
            break
    return DecayFit(x, floor, floor_at, stop, scale)


def _fit_decay_and_floor(t: np.ndarray, power: np.ndarray, begin: np.ndarray | None) -> np.ndarray:
    """Fit a power law and a floor to powers (n,), linear and relative to about the largest power, at times t (s), (n,).

    Return an array (4,): ln of the amplitude A and ln of the decay rate −d ln A/dt (1/s) at time 0, the exponent p of
    dA/dt ∝ −A^p, and ln of the floor's power. begin: start values of these four; None to try three different exponents.
    """
    level = 5.0 * np.log(power)
    tail = float(np.median(power[-max(2, power.size // 8) :]))
    x0 = 0.5 * float(np.log(power[:3].mean()))
    fallen = np.flatnonzero(0.5 * np.log(power) < 0.5 * (x0 + 0.5 * np.log(tail)))
    half = float(t[fallen[0]]) if fallen.size and fallen[0] > 0 else float(t[-1])
    depth = max(0.5 * (x0 - 0.5 * np.log(tail)), 0.05)
    # Tolerance: 0.3 dB, and the scatter that a floor of random phase causes.
    width = np.hypot(0.3, 5.0 * np.sqrt(0.5 * tail / np.maximum(power, tail)))

    def signal(p: np.ndarray) -> np.ndarray:
        return np.exp(2.0 * power_decay(t, p[0], p[1] - (p[2] - 1.0) * p[0], p[2]))

    def residuals(p: np.ndarray) -> np.ndarray:
        return (5.0 * np.log(signal(p) + np.exp(p[3])) - level) / width

    def jacobian(p: np.ndarray) -> np.ndarray:
        decay, floor = signal(p), np.exp(p[3])
        columns = np.column_stack([2.0 * decay[:, None] * power_slopes(t, p), np.full(t.size, floor)])
        return columns * (5.0 / ((decay + floor) * width))[:, None]

    low, high = [-30.0, -60.0, EXPONENT_RANGE[0], -80.0], [10.0, 60.0, EXPONENT_RANGE[1], 1.0]
    starts = [] if begin is None else [begin]
    for exponent in (1.0, 0.2, 1.8) if begin is None else ():
        # The initial rate with which ln A falls by `depth` in the time `half`.
        q = exponent - 1.0
        rate = depth if q == 0.0 else np.expm1(q * depth) / q
        starts.append(np.array([x0, np.log(rate / max(half, 1e-300)), exponent, np.log(tail)]))
    fits = [
        scipy.optimize.least_squares(
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
    """The part of an envelope record that is the free decay.

    Attributes
    ----------
    start, stop
        Index of its first reading, and 1 + index of its last reading.
    floor
        Noise floor after the decay, in powers 10^(dB/10); None if the record does not reach it or none was found.
    why
        Two clauses for a sentence, on how the start and the stop were chosen, such as "starts with the record".
    """

    start: int
    stop: int
    floor: NoiseFloor | None
    why: tuple[str, ...]


def find_window(t: np.ndarray, y: np.ndarray) -> EnvelopeWindow:
    """Find the free decay in levels y (dB) at times t (s), both of shape (n,).

    The search begins with the straightest descent, the part that falls most like a straight line in dB. From there it
    goes back to the start of the decay and forward to the noise floor. A power law may give an earlier start
    (`power_law_start`). With fewer than `SPARSE_READINGS` readings, the decay goes from the highest one to the noise
    floor, or to the end of the record. Raises Refusal if the level falls by less than `LEAST_DROP`, or if the decay has
    fewer than `LEAST_POINTS` readings.
    """
    if t.size < LEAST_POINTS:
        raise Refusal(f"only {t.size} readings; an envelope needs at least {LEAST_POINTS}")
    levels = Levels(t, y, *average_in_blocks(t, y, MOST_BLOCKS))
    yb = levels.yb
    if t.size < SPARSE_READINGS:
        # A table of few readings is a decay from its highest reading on.
        top = int(np.argmax(y))
        if t.size - top < LEAST_POINTS:
            raise Refusal(
                f"only {t.size - top} readings from the highest one on; at least {LEAST_POINTS} are needed"
            )
        end, floor = _follow_on(levels, top)
        begins = "starts with the record" if top == 0 else f"starts at {t[top]:.4g} s, the highest reading"
        return _window_of(levels, top, end, floor, begins)
    first, last = _straightest(levels)
    begin, broken = first, first > 0
    for _ in range(START_ROUNDS):
        before = begin
        begin, broken = _follow_back(levels, begin, last)
        if abs(begin - before) <= 1:
            break
    end, floor = _follow_on(levels, begin)
    core = fall_in_db(yb, first, last + 1)
    if fall_in_db(yb, begin, end) < LEAST_DROP or fall_in_db(yb, begin, last) < LEAST_REMAINING * core:
        # The start from short lines leaves hardly any decay.
        begin, broken = first, first > 0
        end, floor = _follow_on(levels, begin)
    earlier = power_law_start(levels, begin, end)
    if earlier != begin:
        behind, lower = _follow_on(levels, earlier)
        # Reject the earlier start if the level still falls in what would be the floor (LEAST_SHORTENING).
        short = end - max(begin, behind) < LEAST_SHORTENING * (behind - earlier)
        if short or min(fall_in_db(yb, begin, end), fall_in_db(yb, behind, end)) < LEAST_DROP:
            begin, broken, end, floor = earlier, earlier > 0, behind, lower
    begins = "starts with the record"
    if broken:
        at = t[int(levels.edges[begin])]
        begins = f"starts at {at:.4g} s, because the readings before are not part of the decay"
    return _window_of(levels, begin, end, floor, begins)


def _window_of(levels: Levels, begin: int, end: int, floor: NoiseFloor | None, begins: str) -> EnvelopeWindow:
    """Return the window that consists of the blocks `begin` to `end` − 1 of `levels`.

    floor: the noise floor, None if the record does not reach it. begins: clause on how the start was chosen. Raises
    Refusal if the window has too few readings or its level falls too little.
    """
    start, stop = int(levels.edges[begin]), int(levels.edges[end])
    if stop - start < LEAST_POINTS:
        raise Refusal(
            f"only {stop - start} readings are between start and noise floor; at least {LEAST_POINTS} are needed"
        )
    drop = fall_in_db(levels.yb, begin, end)
    if drop < LEAST_DROP:
        raise Refusal(f"the level falls by only {max(drop, 0):.1f} dB; at least {LEAST_DROP:g} dB are needed")
    ends = "ends with the record"
    if floor is not None:
        ends = f"ends at {levels.t[stop - 1]:.4g} s, {ABOVE_FLOOR:g} dB above the noise floor"
    elif stop < levels.t.size:
        ends = f"ends at {levels.t[stop - 1]:.4g} s"
    return EnvelopeWindow(start, stop, floor, (begins, ends))


def window_between(t: np.ndarray, y: np.ndarray, start: float | None, stop: float | None) -> EnvelopeWindow:
    """Return the window from start to stop (both included), in s of the record's times.

    t, y: times in s and levels in dB, (n,). If start or stop is None, `find_window` gives its value. The noise floor
    always comes from `find_window`; it is None if that finds no decay. Raises Refusal if fewer than `LEAST_POINTS`
    readings are between start and stop, or if one of them is None and no decay is found.
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
            f"only {max(0, behind - first)} readings are between start and stop; at least {LEAST_POINTS} are needed"
        )
    if start is not None:
        begins = f"starts at {t[first]:.4g} s, as specified"
    if stop is not None:
        ends = f"ends at {t[behind - 1]:.4g} s, as specified"
    return EnvelopeWindow(first, behind, window.floor, (begins, ends))


def _straightest(levels: Levels) -> tuple[int, int]:
    """Return the indices of the first and the last block (both included) of the straightest descent.

    This is the part of the record whose fall in dB minus `MISFIT_WEIGHT` times the misfit of a straight line is
    largest. The powers of the blocks are averaged. Levels below that at the end of the record are raised to it, so that
    dips of the noise floor do not count as a descent. Raises Refusal if the level never falls.
    """
    powers = 10.0 ** ((levels.yb - levels.yb.max()) / 10.0)
    t, power, edges = average_in_blocks(levels.tb, powers, COARSE_BLOCKS)
    y = 10.0 * np.log10(power)
    y = np.maximum(y, 10.0 * np.log10(power[-max(1, y.size // 12) :].mean()))
    i, j = np.triu_indices(t.size + 1, k=min(4, t.size))
    slope, rms = _lines(t, y, i, j)
    falls = slope * (t[i] - t[j - 1])
    best = int(np.argmax(falls - MISFIT_WEIGHT * rms))
    if not falls[best] > 0:
        raise Refusal("the level never falls; give a record of a decay")
    return int(edges[i[best]]), int(edges[j[best]]) - 1


def _follow_back(levels: Levels, first: int, last: int) -> tuple[int, bool]:
    """Return the index of the block at which the decay begins, and whether other readings precede it.

    Short straight lines are fitted to the levels, going back from the straight part (blocks `first` to `last`). The
    first line that fits worse or has another rate contains readings that are not part of the decay. If the straight
    part is too short for such lines, the decay begins with it.
    """
    t, y = levels.tb, levels.yb
    span = last - first + 1
    width = max(SHORTEST_LINE, round(LINE_FRACTION * span))
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
        odd = not SLOWEST_RATE <= ratio <= FASTEST_RATE and abs(slope[at - 1] - rate) > SLOPE_CHANGES * wobble
        usual = float(np.median(rms[at : at + LINES_AHEAD * width]))
        if odd or ratio < LEVEL_RATE or rms[at - 1] > max(MISFIT_RATIO * usual, LEAST_DEVIATION / 3):
            near = slice(max(0, at - width), min(at + 2 * width, last + 1))
            t, y = t[near], y[near]
            corners = np.arange(3, t.size - 2)
            if corners.size:  # the block that separates the two straight lines that fit best
                rms_before = _lines(t, y, np.zeros_like(corners), corners)[1]
                rms_after = _lines(t, y, corners, np.full_like(corners, t.size))[1]
                squares = corners * rms_before**2 + (t.size - corners) * rms_after**2
                at = max(at, near.start + int(corners[np.argmin(squares)]))
            return min(at + max(1, round(GUARD_FRACTION * span)), last - 3), True
        at -= 1
    return 0, False


def _lines(t: np.ndarray, y: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit k straight lines to levels y (dB) at times t (s), both (n,), and return their slopes and rms misfits.

    Line i is fitted to the levels with indices `low[i]` to `high[i]` − 1; low, high: (k,). The slopes are in dB/s, the
    rms misfits in dB, (k,) each.
    """
    t = t - t.mean()
    sums = [np.concatenate([[0.0], np.cumsum(term)]) for term in (np.ones_like(t), t, t * t, y, y * t, y * y)]
    n, st, stt, sy, sty, syy = (total[high] - total[low] for total in sums)
    spread = np.maximum(stt - st * st / n, 1e-300)
    slope = (sty - st * sy / n) / spread
    return slope, np.sqrt(np.maximum(syy - sy * sy / n - slope * slope * spread, 0.0) / n)


def _follow_on(levels: Levels, begin: int) -> tuple[int, NoiseFloor | None]:
    """Return the index of the block after the decay's last one, and the noise floor after it, in powers 10^(dB/10).

    A power law and a floor are fitted to the levels from `begin`, the first block of the decay, on. The decay ends
    where it is `ABOVE_FLOOR` dB above the floor, or earlier if levels scatter like noise. The floor is None if the
    record ends before the decay reaches it, or if what looks like a floor may belong to the decay.
    """
    t, y, tb, yb, edges = levels.t, levels.y, levels.tb, levels.yb, levels.edges
    count, fit = tb.size, fit_power_law(levels, begin)
    x, floor, floor_at, stop, scale = fit.x, fit.floor, fit.floor_at, fit.stop, fit.scale
    behind = slice(int(edges[floor_at]), stop)
    measured = NoiseFloor(floor)
    if t.size < SPARSE_READINGS:  # the last readings of a table may be part of the decay
        late = stop - behind.start
        if late <= 4:
            return count, None
        slope, rms = _lines(t, y, np.array([behind.start]), np.array([stop]))
        if -slope[0] * float(t[behind].std()) * np.sqrt(late - 2.0) > FALLING_SDS * rms[0]:
            return count, None
    if stop - behind.start > 4:
        power = 10.0 ** ((y[behind] - scale) / 10.0)
        floor = max(floor, float(power.mean()))
        rest = np.exp(2.0 * np.interp(t[behind], tb[begin:], x))
        took = float(tb[floor_at] - tb[begin])
        rate = float(x[0] - x[floor_at - begin]) / took if took > 0 else 0.0
        measured = measure_floor(t[behind], power, rest, rate)
    end, after = count, yb[begin:]
    if after.size >= 2 * SCATTER_BLOCKS:  # end the decay where levels scatter like noise
        bends = (after[1:-1] - 0.5 * (after[:-2] + after[2:])) ** 2 / 1.5
        scatter = np.convolve(bends, np.ones(SCATTER_BLOCKS) / SCATTER_BLOCKS, "valid")
        wild = np.flatnonzero(scatter > NOISE_SCATTER**2)
        end = min(count, begin + int(wild[0]) + SCATTER_BLOCKS // 2) if wild.size else count
    if floor_at == count and floor < 10.0 ** (-ABOVE_FLOOR / 10.0) * np.exp(2.0 * x[-1]):
        return end, None
    if _steepens(t, y, int(edges[begin]), int(edges[floor_at]), stop):
        return end, None
    above = np.flatnonzero(np.exp(2.0 * x) < 10.0 ** (ABOVE_FLOOR / 10.0) * floor)
    end = min(end, begin + int(above[0])) if above.size else end
    return end, measured.scaled(10.0 ** (scale / 10.0))


def _steepens(t: np.ndarray, y: np.ndarray, begin: int, floor_at: int, stop: int) -> bool:
    """Return whether the readings from `floor_at` (or the last few) to `stop` belong to the decay, not to a floor.

    They belong to the decay, which then steepens more than any power law, under two conditions: they fall faster than
    the readings before `floor_at`, and they are not much rougher than the first eighth of the decay. t: times in s,
    (n,). y: levels in dB, (n,). begin: index of the first reading of the decay. floor_at: index of the first reading
    tested. stop: 1 + index of the last one.
    """
    floor_at = min(floor_at, stop - LEAST_LAST_READINGS)
    before = slice(max(begin, floor_at - max(SHORTEST_LINE, (floor_at - begin) // 4)), floor_at)
    if before.stop - before.start < LEAST_POINTS:
        return False
    parts = (slice(floor_at, stop), before)
    slope, usual = (float(np.polyfit(t[part] - t[floor_at], y[part], 1)[0]) for part in parts)
    early, late = y[begin : begin + max((floor_at - begin) // 8, LEAST_LAST_READINGS)], y[floor_at:stop]
    # Roughness from third differences, in which a smooth curve hardly appears.
    rough_early, rough_late = (float(np.median(np.abs(np.diff(part, 3)))) for part in (early, late))
    return slope < usual < 0.0 and rough_late < ROUGHNESS_RATIO * rough_early
