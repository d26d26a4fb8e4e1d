"""A drive that was held at one level before the release, where the level alone shows no step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayesdamp.envelope.model.candidates import Blocks, fit_rates
from bayesdamp.envelope.model.law import ClosedForm
from bayesdamp.envelope.model.laws import SUMS

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
    three dampings, which fits much better than such a decay from the start; 0 where it does not."""
    n = b.t.size
    if n < FEWEST:
        return 0
    seen = np.sqrt(b.floor.power) if b.floor is not None else 0.0
    inverse = np.diag(1.0 / np.maximum(LEAST, np.exp(-b.x) * seen))

    law = ClosedForm(SUMS[-1])

    def misfit(held: int) -> float:
        shifted = replace(b, t=np.maximum(b.t - b.t[held], 0.0))
        x0, rates, _ = fit_rates(shifted, law, inverse)
        off = inverse @ (b.x - law.decay(shifted.t, x0, rates))
        return float(off @ off)

    tried = range(FIRST, n // 2, EACH)
    left = [misfit(held) for held in tried]
    best = int(np.argmin(left))
    return tried[best] + 1 if left[best] < BETTER * misfit(0) else 0
