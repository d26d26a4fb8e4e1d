"""From a raw record to a signal: SI units, a clock, the free decay cut out, and words on what was done.

Over whole cycles of a free decay velocity and acceleration are zero on the mean, which gives a sensor's zero.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayesdamp.plugins import nearest
from bayesdamp.records.cleaning.clock import clock_times
from bayesdamp.records.decay.others import no_free_decay
from bayesdamp.records.decay.window import free_decay
from bayesdamp.records.files.names import unit_and_quantity
from bayesdamp.records.oscillation.anomalies import clipped, rectified, tone_burst
from bayesdamp.records.oscillation.features import Features, features
from bayesdamp.records.oscillation.rough import residuals
from bayesdamp.records.record import RawRecord
from bayesdamp.types import InputError, Refusal, Signal
from bayesdamp.units import UNITS


def recording_step(y: np.ndarray) -> float:
    """The step in the unit of y (n,), or 0 where the values lie on no lattice.

    The lattice may be rounded in its turn (a step of 0.088° written with two decimals).
    """
    values = np.unique(y)
    if values.size < 3:
        return float(values[-1] - values[0]) if values.size == 2 else 0.0
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
    off = np.abs(values - start - step * count)
    return step if np.quantile(off, 0.95) < 0.2 * step else 0.0


CLEAR = 3.0
"""Standard errors from which an offset is one."""
HARMONICS = 3
MOST = 6
"""Highest power of time in the amplitude of the oscillation; a power for every two cycles up to that."""


def sensor_offset(signal: Signal, seen: Features) -> float:
    """The constant that is added to a recorded velocity or acceleration, in its unit; 0 where none is clear.

    Least squares over a constant and an oscillation, its overtones among it, whose amplitude and phase are polynomials
    of time. A force that is not symmetric moves the midline of turning points; the mean over a cycle it leaves at zero.
    Of a displacement nothing is known: it rests where it rests.
    """
    if signal.quantity == "angle" or seen.crossing_times.size < 3:
        return 0.0
    x = 2 * (signal.t - signal.t[0]) / (signal.t[-1] - signal.t[0]) - 1
    degree = int(np.clip(seen.cycles / 2, 1, MOST))
    half = _half_cycles(signal.t, seen.crossing_times)
    columns = [np.ones((x.size, 1))]
    for k in range(1, HARMONICS + 1):
        powers = np.polynomial.chebyshev.chebvander(x, max(degree - k + 1, 0))
        columns += [np.cos(k * np.pi * half)[:, None] * powers, np.sin(k * np.pi * half)[:, None] * powers]
    design = np.hstack(columns)
    if x.size < 2 * design.shape[1]:
        return 0.0
    inverse = np.linalg.pinv(design)
    c = inverse @ signal.y
    left = signal.y - design @ c
    scatter = float(np.sqrt(np.sum(left**2) / (x.size - design.shape[1])))
    error = scatter * float(np.linalg.norm(inverse[0]))
    return float(c[0]) if abs(c[0]) > CLEAR * error else 0.0


def _half_cycles(t: np.ndarray, crossings: np.ndarray) -> np.ndarray:
    """Half-cycles at times t, (n,), smooth through crossings (k,): those up may lie off the middle of those down."""
    middle, width = 0.5 * (t[-1] + t[0]), 0.5 * (t[-1] - t[0])
    degree = int(np.clip(crossings.size // 4, 1, 4))
    number = np.arange(crossings.size)
    alternate = (-1.0) ** number[:, None] if crossings.size > 3 else np.empty((crossings.size, 0))
    powers = np.polynomial.chebyshev.chebvander((crossings - middle) / width, degree)
    c = np.linalg.lstsq(np.hstack([powers, alternate]), number, rcond=None)[0]
    return np.polynomial.chebyshev.chebval((t - middle) / width, c[: degree + 1])


PLURAL = {"angle": "displacements", "velocity": "velocities", "acceleration": "accelerations"}
OUTLIER = 8.0
"""Standard deviations from a local harmonic fit that make an outlier."""
CLIPPED = (
    "its peaks are cut off: the values stay at the end of the sensor's range; record it with a larger range, or give a "
    "start after {:.6g} s, from which on they are not"
)
RECTIFIED = (
    "it comes back to 0 at each half-cycle and never crosses it: it is rectified or squared; record it with its sign, "
    "or turn every second half-cycle over"
)
TONE_BURST = (
    "it rises as it falls, cycle by cycle: it is a tone burst, whose shape comes from a source and not from damping; "
    "give a record of what is left to itself, or the start and stop of a free decay in this one"
)
TURNS, TURNS_SAID = 0.5, 3.0
"""Turns to either side that an angle in rad seldom swings by, and where its column says the unit (conventional)."""


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
    """The free decay in a record.

    unit: a name in UNITS, of the displacement itself (per s or s² where a velocity or an acceleration is recorded).
    clock: "auto", "as_logged" or "uniform", see `clock_times`.
    start, stop: in seconds of the file's own times (of the rebuilt clock, which begins at the file's first
    stamp, where it was rebuilt; from 0 where the file has no times or counts them from an epoch), or "auto": after
    the release, before the rest. Outliers are counted and stay; what a sensor of velocity or acceleration adds to all
    samples is taken off.
    Raises InputError, one line, where there are not two periods of an oscillation.
    """
    scale, base = known_unit(unit, quantity, name)
    times = clock_times(raw, clock, name)
    a, b = _asked(times.t, start, stop, name)
    step = recording_step(raw.y) * scale
    t, y = times.t[a : b + 1], raw.y[a : b + 1] * scale
    if np.ptp(y) == 0:
        raise InputError("the values between start and stop are constant, nothing oscillates", name)
    if rectified(y):
        raise InputError(RECTIFIED, name)
    window = no_free_decay(t, y, start == "auto", stop == "auto")
    if window is None:
        if start == "auto" and stop == "auto" and tone_burst(t, y):
            raise InputError(TONE_BURST, name)
        window = free_decay(t, y, step, start == "auto", stop == "auto", name)
    first, last = a + window.first, a + window.last
    t, y = times.t[first : last + 1], raw.y[first : last + 1] * scale
    signal = Signal(t - t[0], y, quantity, base, name, step)
    try:
        found = features(signal)
        offset = sensor_offset(signal, found)
        if offset:
            signal = replace(signal, y=y - offset)
            found = features(signal)
    except Refusal as error:
        raise InputError(str(error), name) from None
    if clipped(signal.y, found.samples_per_cycle):
        extreme = np.isin(signal.y, (signal.y.min(), signal.y.max()))
        free = t[min(int(np.flatnonzero(extreme)[-1]) + 1, t.size - 1)]
        raise InputError(CLIPPED.format(free), name)
    cycles = found.cycles
    if cycles < 1.95:
        raise InputError(f"needs at least two periods of free decay, has {cycles:.1f}", name)
    outliers = count_outliers(signal, found.period, float(found.turning_amplitudes.max()))
    rate = (t.size - 1) / float(t[-1] - t[0])
    notes, warnings = [*raw.provenance.notes, *times.notes, *window.notes], list(raw.provenance.warnings)
    said = unit_and_quantity(raw.provenance.value_column)
    # deg/s and dps are the same unit
    if said is not None and (UNITS[said[0]].base, UNITS[said[0]].factor, said[1]) != (base, scale, quantity):
        warnings.append(
            f"the column is named {raw.provenance.value_column!r}; its values are read as {PLURAL[quantity]} in "
            f"{UNITS[unit].of(quantity)}."
        )
    turns = found.amplitude / (2 * np.pi)
    if base == "rad" and turns > (TURNS if said is None else TURNS_SAID):
        warnings.append(
            f"it swings by {turns:.2g} turns to either side; if its values are not in {unit} "
            "(but in degrees, or volts), give the unit."
        )
    if step:
        notes.append(f"The values lie on steps of {step / scale:.4g} {UNITS[unit].of(quantity)}.")
    if offset:
        notes.append(
            f"The sensor's zero, {offset / scale:.4g} {UNITS[unit].of(quantity)}, is taken off: over whole cycles "
            "of a free decay the mean is zero."
        )
    if outliers:
        many = f"{outliers} sample{'s lie' if outliers > 1 else ' lies'}"
        notes.append(
            f"{many} further than {OUTLIER:g} standard deviations from a local fit and stay in the record."
        )
    periods = float(t[-1] - t[0]) / found.period
    clear = f", of which {cycles:.1f} stand out of the noise" if periods > cycles + 1 else ""
    notes.append(
        f"Kept are {t.size} samples at {rate:.5g} Hz, {max(periods, cycles):.1f} cycles of {found.period:.4g} s{clear}."
    )
    provenance = replace(
        raw.provenance,
        warnings=tuple(warnings),
        notes=tuple(notes),
        unit=unit,
        start=float(t[0]),
        stop=float(t[-1]),
        offset=offset,
        decays=window.decays,
        more={
            **raw.provenance.more,
            "quantity": quantity,
            "clock": times.used,
            "repeated_stamps": times.repeated,
            "sampling_rate": rate,
            "start_sample": first,
            "stop_sample": last,
            "samples": int(t.size),
            "record_samples": int(raw.y.size),
            "cycles": cycles,
            "period": found.period,
            "outliers": outliers,
            "step": step,
            "roughness": found.roughness,
        },
    )
    return Signal(signal.t, signal.y, quantity, base, name, step, provenance)


def known_unit(unit: str, quantity: str, where: str) -> tuple[float, str]:
    """(factor, base) of a unit. Raises InputError where it or the quantity is none."""
    if unit not in UNITS:
        raise InputError(f"unknown unit {unit!r}{nearest(unit, list(UNITS))}", where)
    if quantity not in PLURAL:
        raise InputError(f"unknown quantity {quantity!r}{nearest(quantity, list(PLURAL))}", where)
    return UNITS[unit].factor, UNITS[unit].base


def count_outliers(signal: Signal, period: float, amplitude: float) -> int:
    """Samples further than OUTLIER standard deviations of the noise from local harmonic fits.

    period in s; amplitude in the unit of y: what is smaller than a thousandth of it is no outlier.
    """
    found = np.zeros(signal.t.size, bool)
    for skipped in (0.0, 0.5 * period):  # what lies at the edge of a window pulls its fit along
        a = int(np.searchsorted(signal.t, skipped))
        if signal.t.size - a < 14:
            continue
        rest, sd, window = residuals(signal.t[a:], signal.y[a:], period)
        usual = float(np.nanmedian(sd)) if np.any(np.isfinite(sd)) else 0.0
        limit = OUTLIER * np.maximum(np.nan_to_num(sd)[window], usual)
        found[a:] |= np.abs(np.nan_to_num(rest)) > np.maximum(limit, 2 * signal.step + 1e-3 * amplitude)
    return int(found.sum())


def _asked(t: np.ndarray, start: str | float, stop: str | float, name: str) -> tuple[int, int]:
    """Indices of the first and last sample that the start and stop asked for leave."""
    bounds = []
    for what, at in (("start", start), ("stop", stop)):
        if isinstance(at, str):
            if at != "auto":
                raise InputError(f'{what} must be "auto" or a number of seconds, not {at!r}', name)
            bounds.append(None)
        elif not np.isfinite(at) or not t[0] - 1e-9 <= at <= t[-1] + 1e-9:
            raise InputError(
                f"{what} = {at:g} s lies outside the record, which goes from {t[0]:.8g} to {t[-1]:.8g} s",
                name,
            )
        else:
            bounds.append(float(at))
    if None not in bounds and bounds[0] >= bounds[1]:
        raise InputError(f"start = {bounds[0]:g} s must be before stop = {bounds[1]:g} s", name)
    slack = 1e-6 * float(t[-1] - t[0]) / t.size
    a = 0 if bounds[0] is None else int(np.searchsorted(t, bounds[0] - slack))
    b = t.size - 1 if bounds[1] is None else int(np.searchsorted(t, bounds[1] + slack)) - 1
    if b - a + 1 < 10:
        raise InputError(
            f"between start and stop are {max(b - a + 1, 0)} samples, at least 10 are needed",
            name,
        )
    return a, b
