"""Convert a raw record to a signal: the free decay in it, in base units, with times in s and notes on what was done.

Over whole cycles of a free decay, the mean of a velocity or an acceleration is zero. From this follows the zero offset
of a sensor for these quantities.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.formatting import percentage
from bayesdamp.plugins import nearest
from bayesdamp.records.cleaning.clock import clock_times, robust_step
from bayesdamp.records.cleaning.window import free_decay, window_of_other_motion
from bayesdamp.records.files.contents import unit_and_quantity
from bayesdamp.records.oscillation.anomalies import is_clipped, is_rectified, is_tone_burst
from bayesdamp.records.oscillation.features import Features, features
from bayesdamp.records.oscillation.noise import coarse_periods
from bayesdamp.records.record import RawRecord, unwrap
from bayesdamp.types import UNITS, InputError, Refusal, Signal

OFFSET_SIGMAS = 3.0
"""The zero offset of a sensor is significant, and is subtracted, if it exceeds this many of its standard errors
(conventional)."""
DRIFT_TURNS, LEAST_DRIFT, DRIFT_STRAIGHT, DRIFT_BETTER = 12, 0.003, 0.985, 2.0
"""A drift of a displacement's zero is subtracted if the record has at least `DRIFT_TURNS` turning points, the drift is
more than `LEAST_DRIFT` of the largest amplitude over the record, a straight line in time explains at least the fraction
`DRIFT_STRAIGHT` of the variance of the means over cycles, and a line in the squared amplitude leaves at least
`DRIFT_BETTER` times as much (chosen on simulated records)."""
MAX_TURNS, MAX_TURNS_NAMED = 0.5, 3.0
"""If the amplitude of an angle is more than `MAX_TURNS` turns (of 360°), a warning says that the values may have
another unit. If the column's name states the unit, the limit is `MAX_TURNS_NAMED` turns (conventional)."""
PLURAL = {"angle": "displacements", "velocity": "velocities", "acceleration": "accelerations"}
"""Plural words for the values of each quantity, in messages."""
CLIPPED = (
    "its peaks are cut off: the values stay at the end of the sensor's range; record it with a larger range, or give a "
    "start after {:.6g} s, where the clipping ends"
)
RECTIFIED = (
    "it returns to 0 in each half-cycle and never crosses it: it is rectified or squared; record it with its sign, "
    "or reverse the sign of every second half-cycle"
)
TONE_BURST = (
    "its amplitude rises in the same way as it falls: it is a tone burst, whose shape comes from its source and not "
    "from damping; give a record without excitation, or the start and stop of a free decay in this one"
)
MOST_SAMPLES = 100_000
"""Records with more samples than this are decimated (conventional)."""
SAMPLES_PER_CYCLE, LEAST_SAMPLES_PER_CYCLE = 100.0, 20.0
"""Decimation aims at `SAMPLES_PER_CYCLE` samples in a cycle. If the result would then have more than `MOST_SAMPLES`
samples, decimation aims at fewer, but at least `LEAST_SAMPLES_PER_CYCLE` in a cycle."""
PASS_BAND = 0.7
"""The decimation filter is flat up to this fraction of the new Nyquist frequency; at 100 samples a cycle, 35 harmonics
pass."""
ATTENUATION = 90.0
"""Attenuation of the decimation filter in dB above the new Nyquist frequency. The filter's ripple in the pass band is
equally small: 3e-5."""
PRESERVED_DENSITY = 1e-3
"""Decimation preserves all frequencies at which the spectral density is more than this fraction of its maximum (−30 dB;
conventional)."""
FEWEST_CYCLES = 1.95
"""Smallest number of cycles with which a part of a record is used (two, less a margin; conventional)."""
FEWEST_LEVELS = 6
"""Smallest number of different values (recording levels) that a free decay must have. With five, 3 of 5 intervals did
not contain the true damping ratio, with six, 2 of 13 (simulated pendulums)."""
MAX_STEPS_OFF = 2.0
"""A record is decimated only if all of its time stamps differ from equally spaced times by at most this many sampling
steps."""


def recording_step(y: np.ndarray) -> float:
    """Return the step to which the values y (n,) were rounded when recorded, in their unit; 0 if there is no such step.

    The multiples of the step may be rounded again, as for a step of 0.088° that is written with two decimals. If there
    are only two different values, the step is their difference.
    """
    values = np.unique(y)
    if values.size < 3:
        return float(np.ptp(values))
    gaps = np.diff(values)
    gaps = gaps[gaps > 1e-9 * float(np.ptp(values))]
    values = values[0] + np.concatenate([[0.0], np.cumsum(gaps)])
    small = gaps[gaps < 1.5 * gaps.min()]
    if small.size < max(2, 0.02 * gaps.size):
        return 0.0
    step, start, count = float(small.mean()), 0.0, gaps
    for _ in range(3):
        count = np.concatenate([[0], np.cumsum(np.round(gaps / step))])
        step, start = (float(c) for c in np.polyfit(count, values, 1))
    return step if np.quantile(np.abs(values - start - step * count), 0.95) < 0.2 * step else 0.0


def sensor_offset(signal: Signal, features: Features) -> float:
    """Return the zero offset of a velocity or acceleration sensor, in the unit of y; 0 if it is not significant.

    The offset is the mean of the values over whole cycles between turning points. The midline of the turning points is
    not used, because an asymmetric force shifts it. The result is 0 also for a displacement, whose equilibrium may be
    anywhere, and for fewer than five turning points.

    signal: the record. features: its features, as the function `features` returns them.
    """
    if signal.quantity == "angle" or features.turning_times.size < 5:
        return 0.0
    means = _cycle_means(signal, features.turning_times)
    offset = float(np.mean(means))
    error = np.hypot(np.std(means) / means.size**0.5, features.roughness / signal.t.size**0.5)
    return offset if abs(offset) > OFFSET_SIGMAS * error else 0.0


def _cycle_means(signal: Signal, turns: np.ndarray) -> np.ndarray:
    """Return means of y over one and a half cycles around every half cycle, (k − 3,), between turning times (k,)."""
    t, y = signal.t, signal.y
    sums = np.concatenate([[0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(t))])
    i = np.clip(np.searchsorted(t, turns) - 1, 0, t.size - 2)
    after, slope = turns - t[i], (y[i + 1] - y[i]) / (t[i + 1] - t[i])
    integral = sums[i] + after * (y[i] + 0.5 * after * slope)
    means = (integral[2:] - integral[:-2]) / (turns[2:] - turns[:-2])
    # The decay makes a mean from maximum to maximum too large, and one from minimum to minimum too small: average both.
    return (means[1:] + means[:-1]) / 2


def sensor_drift(signal: Signal, features: Features) -> float:
    """Return the rate at which the zero of a displacement drifts in a straight line, in the unit of y per s.

    It is that of a straight line through the means over cycles. The result is 0 for a velocity or acceleration, for few
    turning points, for a small drift and for one that is not straight. It is also 0 if the squared amplitude explains
    the means nearly as well, as for an asymmetric spring, whose middle moves as the motion decays. The limits are those
    of `DRIFT_TURNS`.

    signal: the record. features: its features, as the function `features` returns them.
    """
    turns, sizes = features.turning_times, features.turning_amplitudes
    if signal.quantity != "angle" or turns.size < DRIFT_TURNS:
        return 0.0
    means, at = _cycle_means(signal, turns), (turns[1:-2] + turns[2:-1]) / 2
    squares = sizes[1:-2] * sizes[2:-1]
    slope, by_squares = (float(np.polyfit(x, means, 1)[0]) for x in (at, squares))
    left, otherwise = np.var(means - slope * at), np.var(means - by_squares * squares)
    straight = left < (1 - DRIFT_STRAIGHT) * np.var(means) and otherwise > DRIFT_BETTER * left
    return slope if straight and abs(slope) * signal.t[-1] > LEAST_DRIFT * sizes.max() else 0.0


def clean(
    raw: RawRecord,
    *,
    name: str,
    unit: str = "rad",
    quantity: str = "angle",
    clock: str = "auto",
    start: str | float = "auto",
    stop: str | float = "auto",
) -> Signal:
    """Return the free decay in a record, as a signal in the base unit of `unit` (rad, m, or V and the like).

    With start and stop "auto", a record that is not a free decay of one oscillator (beats, growth, excitation) is
    accepted too. It is used from its largest value, or from its start, to its end (`window_of_other_motion`).

    A significant zero offset of a velocity or acceleration sensor is subtracted (`sensor_offset`), and a drift of the
    zero of a displacement in a straight line (`sensor_drift`). A wrapped angle is unwrapped (`unwrap`), and a very long
    record is decimated (`decimate`). Outliers are not removed.

    Parameters
    ----------
    raw
        The record as it was read.
    name
        Name of the record in messages and results.
    unit
        Unit of the displacement, a name in UNITS (a velocity is then in this unit per s, an acceleration per s²), or a
        unit of the quantity itself, such as rpm. It and `quantity` replace what the record states, even by default.
    quantity
        "angle", "velocity" or "acceleration".
    clock
        How the times follow from the time stamps: "as_logged" (unchanged), "uniform" (equal steps, fitted to the
        stamps), or "auto" (uniform if the stamps are rounded or many of them repeat, else as logged).
    start, stop
        Start and stop in s of the file's times (from 0 if the file has no times or counts them from an epoch), or
        "auto" for the start and the stop of the free decay.

    Returns
    -------
    Signal
        The part that is used. Its times begin at 0; its provenance contains notes, warnings, and the start and the stop
        in s of the file's times.

    Raises
    ------
    InputError
        If the record has no free decay of at least two periods (see also `free_decay`); if it is constant, clipped,
        rectified or a tone burst; if its times are unusable (`clock_times`); or if an argument is invalid.
    """
    scale, base = known_unit(unit, quantity, name)
    raw = decimate(unwrap(raw, unit, quantity))
    times, clock_notes = clock_times(raw, clock, name)
    a, b = _samples_between(times, start, stop, name)
    step = recording_step(raw.y) * scale
    t, y = times[a : b + 1], raw.y[a : b + 1] * scale
    if np.ptp(y) == 0:
        raise InputError("the values between start and stop are constant; choose another part", name)
    if is_rectified(y):
        raise InputError(RECTIFIED, name)
    seek_start, seek_stop = start == "auto", stop == "auto"
    periods = coarse_periods(t, y)
    window = window_of_other_motion(t, y, periods[0][0]) if seek_start and seek_stop else None
    if window is not None:
        # A body that is held before its release can be mistaken for another motion; then the part does not oscillate.
        part = slice(window.first, window.last + 1)
        try:
            cycles = features(Signal(t[part] - t[part][0], y[part], quantity, base, name, step)).cycles
        except Refusal:
            cycles = 0.0
        window = window if cycles >= FEWEST_CYCLES else None
    if window is None:
        if seek_start and seek_stop and is_tone_burst(t, y, periods[0][0]):
            raise InputError(TONE_BURST, name)
        window = free_decay(t, y, periods, step, seek_start, seek_stop, name)
    first, last = a + window.first, a + window.last
    t, y = times[first : last + 1], raw.y[first : last + 1] * scale
    if step and (levels := round(float(np.ptp(y)) / step) + 1) < FEWEST_LEVELS:
        few = f"its decay has only {levels} different values"
        raise InputError(f"{few}; record it with a finer resolution", name)
    signal = Signal(t - t[0], y, quantity, base, name, step)
    try:
        measured = features(signal)
        offset, drift = sensor_offset(signal, measured), sensor_drift(signal, measured)
        if offset or drift:
            signal = replace(signal, y=y - offset - drift * signal.t)
            measured = features(signal)
    except Refusal as error:
        part = f"the part from {t[0]:.4g} to {t[-1]:.4g} s is not a free decay that can be used"
        raise InputError(f"{part}: {error}", name) from None
    if is_clipped(signal.y, measured.samples_per_cycle):
        extreme = np.isin(signal.y, (signal.y.min(), signal.y.max()))
        free = t[min(int(np.flatnonzero(extreme)[-1]) + 1, t.size - 1)]
        raise InputError(CLIPPED.format(free), name)
    cycles, period = measured.cycles, measured.period
    if cycles < FEWEST_CYCLES:
        raise InputError(f"has {cycles:.1f} periods of free decay; at least two are needed", name)
    rate = (t.size - 1) / float(t[-1] - t[0])
    label = UNITS[unit].of(quantity)
    notes, warnings = [*raw.provenance.notes, *clock_notes, *window.notes], list(raw.provenance.warnings)
    named = unit_and_quantity(raw.provenance.value_column)
    # Compare base unit and factor, not the names: deg/s and dps are the same unit.
    if named is not None and (*known_unit(*named, name), named[1]) != (scale, base, quantity):
        warnings.append(
            f"the column is named {raw.provenance.value_column!r}, but its values are used as {PLURAL[quantity]} in "
            f"{label}; if this is wrong, give another unit or quantity."
        )
    turns = measured.amplitude / (2 * np.pi)
    if base == "rad" and turns > (MAX_TURNS if named is None else MAX_TURNS_NAMED):
        warnings.append(
            f"it swings by {turns:.2g} turns to either side when its values are read in {unit}; if they have another "
            "unit (such as degrees or volts), give the unit."
        )
    if step:
        notes.append(f"The values are rounded to steps of {step / scale:.4g} {label}.")
    if offset:
        notes.append(
            f"The sensor's zero, {offset / scale:.4g} {label}, is subtracted: it follows from the values, because "
            "their mean over whole cycles of a free decay is zero."
        )
    if drift:
        share = abs(drift) * float(signal.t[-1]) / measured.amplitude
        notes.append(
            f"A drift of the zero in a straight line, by {percentage(share)} % of the first amplitude over the record, "
            "is subtracted."
        )
    periods = float(t[-1] - t[0]) / period
    clear = f", of which {cycles:.1f} are above the noise" if periods > cycles + 1 else ""
    notes.append(
        f"Used: {t.size} samples at {rate:.5g} Hz, {max(periods, cycles):.1f} cycles of {period:.4g} s{clear}."
    )
    provenance = replace(
        raw.provenance,
        warnings=tuple(warnings),
        notes=tuple(notes),
        unit=unit,
        start=float(t[0]),
        stop=float(t[-1]),
        offset=offset,
        drift=drift,
        decays=window.decays,
    )
    return replace(signal, provenance=provenance)


def known_unit(unit: str, quantity: str, where: str) -> tuple[float, str]:
    """Return the factor that converts a value in `unit` to its base unit, and the name of the base unit.

    For "deg" these are π/180 and "rad"; for "rpm", which gives rad/s, π/30 and "rad". The `quantity` is only checked.
    where: name of the record, for messages. Raises InputError for an unknown unit or quantity.
    """
    if unit not in UNITS:
        raise InputError(f"unknown unit {unit!r}{nearest(unit, list(UNITS))}", where)
    if quantity not in PLURAL:
        raise InputError(f"unknown quantity {quantity!r}{nearest(quantity, list(PLURAL))}", where)
    return UNITS[unit].factor, UNITS[unit].base


def _samples_between(t: np.ndarray, start: str | float, stop: str | float, name: str) -> tuple[int, int]:
    """Return the indices of the first and last sample (both included) between start and stop.

    t: times of the samples in s, (n,). start, stop: times in s on the same clock, or "auto" for the start or the end of
    the record. name: name of the record, for messages. Raises InputError if start or stop is invalid, or if there are
    fewer than ten samples between them.
    """
    bounds = [float(t[0]), float(t[-1])]
    for i, (what, at) in enumerate((("start", start), ("stop", stop))):
        if isinstance(at, str):
            if at != "auto":
                raise InputError(f'{what} must be "auto" or a number of seconds, not {at!r}', name)
        elif not np.isfinite(at) or not t[0] - 1e-9 <= at <= t[-1] + 1e-9:
            raise InputError(
                f"{what} = {at:g} s is outside the record, which goes from {t[0]:.8g} to {t[-1]:.8g} s", name
            )
        else:
            bounds[i] = float(at)
    if "auto" not in (start, stop) and bounds[0] >= bounds[1]:
        raise InputError(f"start = {bounds[0]:g} s must be before stop = {bounds[1]:g} s", name)
    slack = 1e-6 * float(t[-1] - t[0]) / t.size
    a, b = int(np.searchsorted(t, bounds[0] - slack)), int(np.searchsorted(t, bounds[1] + slack)) - 1
    if b - a + 1 < 10:
        raise InputError(
            f"there are only {max(b - a + 1, 0)} samples between start and stop; at least 10 are needed", name
        )
    return a, b


def decimate(raw: RawRecord) -> RawRecord:
    """Reduce the samples of a record with more than `MOST_SAMPLES` to as many as its oscillation needs.

    The oscillation needs about `SAMPLES_PER_CYCLE` samples a cycle, or more if its spectrum contains higher
    frequencies. In records of many cycles fewer are used, but at least `LEAST_SAMPLES_PER_CYCLE`. The values are
    low-pass filtered first; a note in the provenance describes the filter. The filter lacks neighbours for the first
    and last samples, so these are left out. The result has times instead of a rate, and its `rows` are empty.

    A record is returned unchanged if it is shorter, is not uniformly sampled (`MAX_STEPS_OFF`), or needs more than half
    of its samples.
    """
    rows = raw.rows - raw.rows[0] if raw.rows.size else np.arange(raw.y.size)
    if raw.y.size <= MOST_SAMPLES or rows[-1] != raw.y.size - 1:  # rows are missing
        return raw
    if raw.t is not None:
        gaps = np.diff(raw.t)
        if np.any(gaps < 0) or raw.t[-1] == raw.t[0]:
            return raw
        step, off = robust_step(rows, raw.t)
        if not step > 0 or off > MAX_STEPS_OFF * max(step, float(np.median(gaps[gaps > 0]))):
            return raw
        start, rate = float(np.mean(raw.t) - step * np.mean(rows)), 1 / step
    elif raw.rate is not None:
        start, rate = 0.0, raw.rate
    else:
        return raw
    level = raw.y - np.mean(raw.y)
    length = min(level.size, 2 ** int(np.log2(level.size / 4)))
    frequency, power = scipy.signal.welch(level, rate, nperseg=length, detrend="linear")
    power[:2] = 0.0  # ignore slow drift
    if not power.max() > 0:
        return raw
    peak = float(frequency[int(np.argmax(power))])
    highest = float(frequency[np.flatnonzero(power > PRESERVED_DENSITY * power.max())[-1]])
    cycles = peak * raw.y.size / rate
    per_cycle = float(np.clip(MOST_SAMPLES / cycles, LEAST_SAMPLES_PER_CYCLE, SAMPLES_PER_CYCLE))
    factor = int(rate / max(per_cycle * peak, 2 * highest / PASS_BAND))
    if factor < 2:
        return raw
    y, first = filter_and_decimate(raw.y, factor)
    t = start + (first + factor * np.arange(y.size)) / rate
    note = (
        f"The {raw.y.size} samples at {rate:.6g} Hz, more than the oscillation needs, are reduced to {y.size} at "
        f"{rate / factor:.6g} Hz with a zero-phase filter that is flat within 1e-4 up to "
        f"{PASS_BAND * rate / factor / 2:.4g} Hz; the noise is that within this band."
    )
    before = raw.provenance
    provenance = replace(
        before,
        notes=(*before.notes, note),
        first_line=None,  # samples no longer correspond to lines of the file
    )
    return replace(raw, t=t, y=y, rate=None, rows=np.empty(0, int), provenance=provenance)


def filter_and_decimate(y: np.ndarray, factor: int) -> tuple[np.ndarray, int]:
    """Filter values with a symmetric (zero-phase) low-pass filter, and return every `factor`-th of the filtered values.

    The filter is flat within 1e-4 up to the fraction `PASS_BAND` of the new Nyquist frequency. Above the new Nyquist
    frequency it attenuates by `ATTENUATION` dB.

    Parameters
    ----------
    y
        Equally spaced values, (n,).
    factor
        Factor by which the number of samples is reduced.

    Returns
    -------
    tuple
        The filtered values, one for every `factor`-th sample of y that has enough neighbours for the filter (none if y
        is shorter than the filter), and the index in y of the first of these samples.

    References
    ----------
    A. V. Oppenheim and R. W. Schafer, Discrete-Time Signal Processing, 7.5: FIR filters by a Kaiser window.
    """
    size, beta = scipy.signal.kaiserord(ATTENUATION, (1 - PASS_BAND) / factor)
    half = size // 2
    kaiser: Any = ("kaiser", beta)
    taps = np.asarray(scipy.signal.firwin(2 * half + 1, (1 + PASS_BAND) / 2 / factor, window=kaiser))
    middle = float(np.mean(y))
    # Sample k of the result is centred on sample k - half of y.
    return scipy.signal.upfirdn(taps, y - middle, 1, 1)[2 * half : y.size : factor] + middle, half
