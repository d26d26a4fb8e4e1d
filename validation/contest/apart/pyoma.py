"""Estimate the damping ratio by pyOMA2 with its defaults, on a single record of a free decay.

The methods are stochastic subspace identification (SSI) and enhanced frequency domain decomposition (EFDD). They use
correlations of the record; the correlation of a decay is a decay with the same damping ratio. The default band widths
of pyOMA2, in Hz, are meant for buildings, so time is scaled to an oscillation at 2 Hz, which does not change the ratio.
The record is decimated to ten or more samples in a cycle. The checks of mode shapes are not defined for one channel, so
SSI runs without them. EFDD does not accept a single channel; the velocity is its second channel.
"""

import sys

import numpy as np
from pyoma2.algorithms import EFDD, SSI  # pyright: ignore[reportMissingImports]
from pyoma2.setup import SingleSetup  # pyright: ignore[reportMissingImports]
from serve import serve
from shared import even, spectral_peak

FREQUENCY = 2.0
PER_CYCLE = 10
ORDER = 10
"""Highest model order of SSI, for which pyOMA2 has no default."""
NO_SHAPES = {"xi_max": 0.2, "mpc_lim": None, "mpd_lim": None, "CoV_max": None}
SEGMENT = 1024
"""Length in samples of the segments whose spectra EFDD averages (pyOMA2's default); a shorter record is one segment."""


def answer(method, t, y, amplitudes):
    """Return {"values": [the damping ratio, repeated for each amplitude]} for a record (t in s, y in rad).

    method: "ssi" or "efdd". Raises ValueError if it finds no stable mode near the spectral peak.
    """
    grid, values = even(t, y)
    frequency = spectral_peak(grid, values)
    rate = FREQUENCY / (frequency * (grid[1] - grid[0]))
    channels = [values] if method == "ssi" else [values, np.gradient(values, grid) / (2 * np.pi * frequency)]
    setup = SingleSetup(np.stack(channels, axis=1), fs=rate)
    setup.detrend_data()
    factor = int(rate / FREQUENCY / PER_CYCLE)
    if factor > 1:
        setup.decimate_data(q=factor)
    if method == "ssi":
        algorithm = SSI(name="it", ordmax=ORDER, hc=NO_SHAPES)
    else:
        algorithm = EFDD(name="it", nxseg=min(SEGMENT, len(setup.data)))
    setup.add_algorithms(algorithm)
    setup.run_by_name("it")
    setup.mpe("it", sel_freq=[FREQUENCY])
    ratios = np.ravel(algorithm.result.Xi)
    if not (ratios.size and ratios[0] > 0):
        raise ValueError("no stable mode near the spectral peak")
    return {"values": [float(ratios[0])] * len(amplitudes)}


if __name__ == "__main__":
    serve(lambda *record: answer(sys.argv[1], *record), 120.0)
