"""A drive that was held at one level before the release, where the level alone shows no step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from bayesdamp.inference.envelope.candidates import Blocks, fit_rates
from bayesdamp.physics.amplitude.law import ClosedForm
from bayesdamp.physics.amplitude.laws import EXPONENTS, SUMS, power_decay, power_slopes

FEWEST = 30
"""Blocks from which on it is looked for."""
FIRST, EACH = 2, 3
"""Blocks that are tried: from FIRST on to half of all, every so many."""
BETTER = 0.75
"""Share of the misfit of a decay from the start on that a held level before it has to leave at most."""
LEAST = 0.02
"""Scatter of ln A at least, a percentage that laws and detectors are off."""


def held_blocks(b: Blocks) -> int:
    """How many blocks at the start are a drive's: the level stands there and decays from then on by the sum of all
    three dampings, which fits much better than these, or rising friction, from the start on; 0 where it does not."""
    n = b.t.size
    if n < FEWEST:
        return 0
    seen = np.sqrt(b.floor.power) if b.floor is not None else 0.0
    inverse = np.diag(1.0 / np.maximum(LEAST, np.exp(-b.x) * seen))

    law = ClosedForm(SUMS[-1])

    rates: np.ndarray | None = None

    def misfit(held: int) -> float:
        nonlocal rates
        found = fit_rates(replace(b, t=np.maximum(b.t - b.t[held], 0.0)), law, inverse, rates)
        rates = np.maximum(found.values[:-1], 1e-3 * b.mean_rate)  # the next fit is near
        return found.squares

    tried = range(FIRST, n // 2, EACH)
    left = [misfit(held) for held in tried]
    best = int(np.argmin(left))
    better = left[best] < BETTER * misfit(0) and left[best] < BETTER * _by_rising_friction(b, inverse)
    return tried[best] + 1 if better else 0


def _by_rising_friction(b: Blocks, inverse: np.ndarray) -> float:
    """Misfit of a decay from the start on by one power of the amplitude below 0: friction that rises towards rest stays
    long and then falls fast, as a held level does, and no sum of the three dampings describes it."""

    def off(p: np.ndarray) -> np.ndarray:
        return inverse @ (b.x - power_decay(b.t, p[0], p[1] - (p[2] - 1.0) * p[0], p[2]))

    def slopes(p: np.ndarray) -> np.ndarray:
        return -inverse @ power_slopes(b.t, p)

    steepest, top = EXPONENTS[0], b.ends[0]
    q = 0.5 * steepest - 1.0
    rate = np.expm1(q * (top - b.ends[1])) / (q * b.duration)  # which falls by as much in the time
    begin = np.array([top, np.log(rate), q + 1.0])
    bounds = np.array([-np.inf, -np.inf, steepest]), np.array([np.inf, np.inf, 0.0])
    found = least_squares(off, begin, slopes, bounds=bounds, x_scale=[1.0, 1.0, 0.3], max_nfev=60)  # type: ignore[arg-type]
    return 2.0 * float(found.cost)
