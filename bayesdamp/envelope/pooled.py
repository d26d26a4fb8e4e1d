"""Several ring-downs of one specimen: their common Q (or rate), and how far they scatter beyond their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bayesdamp.envelope.results import EnvelopeResult
from bayesdamp.envelope.words import number


@dataclass(frozen=True)
class Pooled:
    """value, sd, low, high: the common `quantity`; records: how many have one; between: sd between records beyond their
    own, relative; standardised: mean square of the standardised differences, 1 where intervals are honest."""

    name: str
    quantity: str
    records: int
    value: float
    sd: float
    low: float
    high: float
    between: float
    standardised: float
    sentence: str


def pooled(name: str, found: Sequence[EnvelopeResult]) -> Pooled | None:
    """Random effects (DerSimonian & Laird 1986), in logarithms; None where fewer than two records have a decay."""
    quality = all(one.quality_factor is not None for one in found if one.rate is not None)
    each = [one.quality_factor if quality else one.rate for one in found]
    known = [one for one in each if one is not None]
    if len(known) < 2:
        return None
    x = np.log([one.value for one in known])
    v = np.array([(one.sd_noise**2 + one.sd_law**2) / one.value**2 for one in known])
    w = 1.0 / v
    mean = (w @ x) / w.sum()
    spread = float(w @ (x - mean) ** 2)
    excess = max(0.0, (spread - (x.size - 1)) / (w.sum() - (w @ w) / w.sum()))
    w = 1.0 / (v + excess)
    mean, sd = float((w @ x) / w.sum()), float(w.sum() ** -0.5)
    value, between = float(np.exp(mean)), float(np.sqrt(excess))
    low, high = float(np.exp(mean - 1.96 * sd)), float(np.exp(mean + 1.96 * sd))
    standardised = spread / (x.size - 1)
    what, unit = ("Q", "") if quality else ("decay rate", " 1/s")
    said = (
        f"{x.size} records of one specimen: {what} = {number(value)}{unit} ± {100 * sd:.2g} % "
        f"(95 %: {number(low)} to {number(high)}); between records it scatters by {100 * between:.2g} % beyond their "
        f"own intervals (standardised variance {standardised:.1f})."
    )
    return Pooled(
        name,
        "quality_factor" if quality else "rate",
        x.size,
        value,
        sd * value,
        low,
        high,
        between,
        standardised,
        said,
    )
