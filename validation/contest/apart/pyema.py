"""pyEMA (sdypy-EMA), the least-squares complex frequency method (LSCF), by its defaults.

It takes frequency responses; the spectrum of a free decay has a response's poles. Its band of 50 Hz to 10 kHz is that
of hammer tests, so time is scaled to an oscillation at 500 Hz, which changes no ratio; the record is decimated to ten
samples a cycle or more. Of the poles that it calls stable the one nearest to the spectrum's peak is taken.
"""

import numpy as np
from even import even, spectral_peak
from scipy.signal import decimate
from sdypy.EMA import Model  # pyright: ignore[reportMissingImports]
from serve import serve

FREQUENCY = 500.0
PER_CYCLE = 10
LEAST = 512
"""Samples that its model order of 100 takes; a shorter record is lengthened with zeros."""


def answer(t, y, amplitudes):
    """One ratio for every amplitude."""
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
    found = float(np.ravel(model.nat_xi)[0])
    if not found > 0:
        raise ValueError("no stable pole near the spectrum's peak")
    return {"values": [found] * len(amplitudes)}


if __name__ == "__main__":
    serve(answer, 120.0)
