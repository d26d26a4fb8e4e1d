"""Estimate the damping ratio by pyEMA (sdypy-EMA), the least-squares complex frequency method, with its defaults.

pyEMA needs a frequency response; the spectrum of a free decay has the same poles. Its frequency band of 50 Hz to 10 kHz
is meant for hammer tests, so time is scaled to an oscillation at 500 Hz, which does not change the damping ratio. The
record is decimated to ten or more samples in a cycle. The result is the stable pole nearest to the spectral peak.
"""

import numpy as np
from scipy.signal import decimate
from sdypy.EMA import Model  # pyright: ignore[reportMissingImports]
from serve import serve
from shared import even, spectral_peak

FREQUENCY = 500.0
PER_CYCLE = 10
LEAST = 512
"""Number of samples that pyEMA's default model order of 100 needs; a shorter record is padded with zeros."""


def answer(t, y, amplitudes):
    """Return {"values": [the damping ratio, repeated for each amplitude]} for a record (t in s, y in rad).

    Raises ValueError if pyEMA finds no stable pole near the spectral peak.
    """
    grid, values = even(t, y)
    rate = FREQUENCY / (spectral_peak(grid, values) * (grid[1] - grid[0]))
    values = values - values.mean()
    factor = int(rate / FREQUENCY / PER_CYCLE)
    if factor > 1:
        values, rate = decimate(values, factor), rate / factor
    n = max(values.size, LEAST)
    model = Model(np.fft.rfft(values, n)[None, :], np.fft.rfftfreq(n, 1 / rate), frf_form="receptance")
    model.get_poles(show_progress=False)
    model.select_closest_poles([FREQUENCY])
    ratio = float(np.ravel(model.nat_xi)[0])
    if not ratio > 0:
        raise ValueError("no stable pole near the spectral peak")
    return {"values": [ratio] * len(amplitudes)}


if __name__ == "__main__":
    serve(answer, 120.0)
