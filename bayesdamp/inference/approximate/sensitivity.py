"""What the evidence of a law that holds approximately depends on: prior widths, and half of the record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayesdamp.inference.approximate.evidence import by_importance
from bayesdamp.inference.approximate.law import Approximate
from bayesdamp.inference.checks.forecast import Ahead
from bayesdamp.inference.curves.weighted import resampled
from bayesdamp.inference.deviation.sampled.marginal import marginal_of
from bayesdamp.inference.deviation.single import first_half, under
from bayesdamp.inference.evidence.prediction import Prediction
from bayesdamp.inference.evidence.widths import Widths, against_width
from bayesdamp.priors import Prior
from bayesdamp.types import Evidence, Refusal

Array = NDArray[np.float64]
DRAWS = 500
"""Motions behind a prediction: its sd is good to a thirtieth of itself."""


def over_widths(law: Approximate, y: Array, log_weights: Array, seed: int) -> Widths:
    """Evidence under narrower and wider priors of the damping coefficients; y, log_weights: as `by_importance` leaves
    them."""

    def anew(priors: Mapping[str, Prior], seed: int) -> Evidence:
        one = under(law.single, priors)
        return by_importance(replace(law, single=one), "", "", seed)

    priors = {n: law.single.found.priors[n] for n in law.names}
    coefficients = [n for n in law.oscillator.coefficients if n in priors]
    return against_width(priors, coefficients, y, log_weights, anew, seed)


def predict(law: Approximate, model: str, method: str, seed: int) -> Prediction:
    """Importance evidence on the first half, and its draws, each with deviations given that half, carried on over the
    second: there the deviations are what their prior makes of the first half's. Times are from the first sample.

    Raises Refusal where the first half has no posterior, or no draw goes on.
    """
    rng, half = np.random.default_rng(seed), replace(law, single=first_half(law.single))
    found = by_importance(half, model, method, seed)
    chosen = found.arrays["y"][resampled(found.arrays["log_weights"], DRAWS, rng)]
    target = marginal_of(half.single.weighing, half.single.result)
    motions = law.motions(target.with_deviations(chosen, rng))
    motions = motions[np.all(np.isfinite(motions), axis=1)]
    if not len(motions):
        raise Refusal("no motion that fits the first half goes on through the second")
    weighing, count = law.single.weighing, half.single.weighing.data.y.size
    second = motions[:, count:]
    centre, noise = second.mean(axis=0), weighing.variance / weighing.inflation  # of one sample
    ahead = Ahead(weighing.data.y[count:] - centre, np.sqrt(second.var(axis=0) + noise))
    return Prediction(
        start=float(weighing.data.t[count]),
        centre=centre,
        sd=ahead.sd,
        rms=ahead.rms,
        expected=ahead.expected,
        coverage=ahead.coverage,
        evidence=replace(found, arrays={}),
    )
