"""Sums that no envelope tells apart whatever it shows: one loses as the other does, at each value of its parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.optimize import nnls

from bayesdamp.inference.envelope.candidates import Candidate
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
    return tuple((a.name, b.name) for a, b in pairs if _could_be(a, b) and _loses_as(ranking, a, b))


def _could_be(a: Sum, b: Sum) -> bool:
    return a.count > 0 and b.count == 0 and len(a.terms) + a.count >= len(b.terms)


def _loses_as(ranking: Ranking, a: Sum, b: Sum) -> bool:
    own = [c for c in ranking.candidates if c.name == a.name]
    law = b.law()
    for x, speed in _losses(own):
        shapes = law.shapes(x) / speed
        if nnls(shapes.T, np.ones(x.size))[1] > SAME * np.sqrt(x.size):
            return False
    return True


def _losses(candidates: Sequence[Candidate]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """(x, -dx/dt) along each one's fit."""
    for c in candidates:
        x = np.linspace(c.fit[0], c.fit[-1], ALONG)
        yield x, np.maximum(c.law.rate(x, c.rates), 1e-300)
