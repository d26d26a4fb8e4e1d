"""pyOMA2, stochastic subspace identification (SSI) or enhanced frequency domain decomposition (EFDD), by its defaults.

A decay's correlation is a decay of the same ratio. Widths in Hz are those of buildings, so time is scaled to an
oscillation at 2 Hz, which changes no ratio; the record is decimated to ten samples a cycle or more. Of one channel the
checks of mode shapes are not defined, so SSI goes without them, and EFDD, which takes no single channel, has the
velocity as its second.
"""

import sys

import numpy as np
from even import even, spectral_peak
from pyoma2.algorithms import EFDD, SSI  # pyright: ignore[reportMissingImports]
from pyoma2.setup import SingleSetup  # pyright: ignore[reportMissingImports]
from serve import serve

FREQUENCY = 2.0
PER_CYCLE = 10
ORDER = 10
"""Highest model order; it has no default."""
NO_SHAPES = {"xi_max": 0.2, "mpc_lim": None, "mpd_lim": None, "CoV_max": None}
SEGMENT = 1024
"""Its default; a record that is shorter is one segment."""


def answer(method, t, y, amplitudes):
    """One ratio for every amplitude."""
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
        made = SSI(name="it", ordmax=ORDER, hc=NO_SHAPES)
    else:
        made = EFDD(name="it", nxseg=min(SEGMENT, len(setup.data)))
    setup.add_algorithms(made)
    setup.run_by_name("it")
    setup.mpe("it", sel_freq=[FREQUENCY])
    found = np.ravel(made.result.Xi)
    if not (found.size and found[0] > 0):
        raise ValueError("no stable mode near the spectrum's peak")
    return {"values": [float(found[0])] * len(amplitudes)}


if __name__ == "__main__":
    serve(lambda *record: answer(sys.argv[1], *record), 120.0)
