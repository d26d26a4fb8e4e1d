"""Thin records with far more samples than their oscillation needs, by a filter that shifts no phase."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.records.cleaning.clock import robust_step
from bayesdamp.records.record import RawRecord

MOST = 100_000
"""Samples above which a record is thinned: a quarter of an hour at 100 Hz, two seconds of sound."""
PER_CYCLE, LEAST_PER_CYCLE = 100.0, 20.0
"""Samples a cycle after thinning, and the fewest where a record has very many cycles."""
PASS = 0.7
"""Share of the new Nyquist frequency up to which the filter is flat, so 35 overtones pass at 100 samples a cycle."""
ATTENUATION = 90.0
"""dB from the new Nyquist frequency on. For a Kaiser window it is the ripple below as well: 3e-5."""
HEARD = 1e-3
"""Share of the largest spectral density that a frequency must have to be preserved: -30 dB."""
UNEVEN = 2.0
"""Samples, or ticks of the clock that stamps them, by which a stamp may be off an even clock."""


def decimated(raw: RawRecord) -> RawRecord:
    """Return the record with as many samples as its oscillation needs, itself where it has no more than `MOST`.

    The times of the result are in s of the file's own; a note in the provenance describes the filter. The first and
    last samples, for which the filter lacks neighbours, are left out. A record that is not evenly sampled stays as it
    is. The remaining noise and rounding error are those within the band that passes.
    """
    rows = raw.rows - raw.rows[0] if raw.rows.size else np.arange(raw.y.size)
    if raw.y.size <= MOST or rows[-1] != raw.y.size - 1:  # rows are missing in between
        return raw
    if raw.t is not None:
        gaps = np.diff(raw.t)
        if np.any(gaps < 0) or raw.t[-1] == raw.t[0]:
            return raw
        step, off = robust_step(rows, raw.t)
        if not step > 0 or off > UNEVEN * max(step, float(np.median(gaps[gaps > 0]))):
            return raw
        start, rate = float(np.mean(raw.t) - step * np.mean(rows)), 1 / step
    elif raw.rate is not None:
        start, rate = 0.0, raw.rate
    else:
        return raw
    level = raw.y - np.mean(raw.y)
    length = min(level.size, 2 ** int(np.log2(level.size / 4)))
    frequency, power = scipy.signal.welch(level, rate, nperseg=length, detrend="linear")
    power[:2] = 0.0  # drift
    if not power.max() > 0:
        return raw
    peak = float(frequency[int(np.argmax(power))])
    highest = float(frequency[np.flatnonzero(power > HEARD * power.max())[-1]])
    cycles = peak * raw.y.size / rate
    per_cycle = float(np.clip(MOST / cycles, LEAST_PER_CYCLE, PER_CYCLE))
    factor = int(rate / max(per_cycle * peak, 2 * highest / PASS))
    if factor < 2:
        return raw
    y, first = thinned(raw.y, factor)
    t = start + (first + factor * np.arange(y.size)) / rate
    note = (
        f"Of {raw.y.size} samples at {rate:.6g} Hz, more than the oscillation needs, {y.size} at "
        f"{rate / factor:.6g} Hz remain, after a filter that shifts no phase and is flat to 1e-4 up to "
        f"{PASS * rate / factor / 2:.4g} Hz; the noise is that within this band."
    )
    before = raw.provenance
    provenance = replace(
        before,
        notes=(*before.notes, note),
        first_line=None,  # samples no longer belong to lines of the file
        more={**before.more, "decimation": factor},
    )
    return replace(raw, t=t, y=y, rate=None, rows=np.empty(0, int), provenance=provenance)


def thinned(y: np.ndarray, factor: int) -> tuple[np.ndarray, int]:
    """Return every factor-th value after a low-pass filter about each sample, so that no phase shifts.

    The filter is flat within 1e-4 up to PASS of the new Nyquist frequency, and attenuates by ATTENUATION above it.

    Parameters
    ----------
    y
        Equally spaced values, (n,).
    factor
        By which the number of samples falls.

    Returns
    -------
    tuple
        The values that have all their neighbours, and the index in y of the first of them.

    References
    ----------
    A. V. Oppenheim and R. W. Schafer, Discrete-Time Signal Processing, 7.5: FIR filters by a Kaiser window.
    """
    width = (1 - PASS) / factor
    half = int(np.ceil((ATTENUATION - 7.95) / (2.285 * np.pi * width) / 2))
    kaiser: Any = ("kaiser", 0.1102 * (ATTENUATION - 8.7))
    taps = np.asarray(scipy.signal.firwin(2 * half + 1, (1 + PASS) / 2 / factor, window=kaiser))
    middle = float(np.mean(y))
    # Sample k of this is centred on sample k - half of y.
    whole = scipy.signal.upfirdn(taps, y - middle, 1, 1)
    return whole[2 * half : y.size : factor] + middle, half
