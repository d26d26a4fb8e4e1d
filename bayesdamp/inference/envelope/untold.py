"""Sums that no envelope tells apart whatever it shows: one loses as the other does, at each value of its parameters."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from bayesdamp.inference.envelope.ranking import Ranking
from bayesdamp.inference.envelope.sums import Sum

ALONG = 65
"""Amplitudes, evenly in their logarithm."""
SAME = 1e-4
"""Root mean square difference of two relative losses that no record shows."""
EXCLUDED = 7.0
"""Nats behind the most probable sum at which the other's parameters are where their priors exclude them."""


def untold(ranking: Ranking) -> tuple[tuple[str, str], ...]:
    """Pairs of sums, the most probable one among them, of which the first loses as the second does.

    The first has parameters beside coefficients and is no simpler than the second: priors alone choose between them. A
    simpler law within a wider one is told by its evidence.
    """
    best, most = ranking.best, ranking.log_evidence.max()
    near = [one for one, z in zip(ranking.sums, ranking.log_evidence, strict=True) if z > most - EXCLUDED]
    pairs = [(best, one) for one in near] + [(one, best) for one in near]
    return tuple((a.name, b.name) for a, b in pairs if _loses_as(ranking, a, b))


def _loses_as(ranking: Ranking, a: Sum, b: Sum) -> bool:
    if a.count == 0 or b.count > 0 or len(a.terms) + a.count < len(b.terms):
        return False
    law, own = b.law(), [c for c in ranking.candidates if c.name == a.name]
    for c in own:
        x = np.linspace(c.fit[0], c.fit[-1], ALONG)
        shapes = law.shapes(x) / np.maximum(c.law.rate(x, c.rates), 1e-300)
        if nnls(shapes.T, np.ones(x.size))[1] > SAME * np.sqrt(x.size):
            return False
    return True
