"""Several ring-downs of one specimen: their common Q (or rate), and how far they scatter beyond their intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bayesdamp.envelope.results import EnvelopeResult
from bayesdamp.envelope.specimen import joint_damping
from bayesdamp.envelope.words import noun_of, number, probability_words


@dataclass(frozen=True)
class Pooled:
    """value, sd, low, high: the common `quantity`; next_low, next_high: of one more record; records: how many have one;
    between: sd between records beyond their own, relative; standardised: mean square of the standardised differences, 1
    where intervals are honest; damping, probability, probabilities: of the sums, with one set of coefficients for all
    records; spread: relative, of the damping between records, with its 95 % interval."""

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
    next_low: float = float("nan")
    next_high: float = float("nan")
    damping: str = ""
    probability: float = float("nan")
    probabilities: Mapping[str, float] = field(default_factory=dict)
    spread: tuple[float, float, float] = (float("nan"), float("nan"), float("nan"))


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
    joint = joint_damping(found)
    first, probability = next(iter(joint.probabilities.items())) if joint else ("", float("nan"))
    spread = joint.spread if joint else (between, between, between)
    wide = float(np.sqrt(sd**2 + max(spread[0], between) ** 2))
    next_low, next_high = float(np.exp(mean - 1.96 * wide)), float(np.exp(mean + 1.96 * wide))
    named = f"{noun_of(first)} (probability {probability_words(probability)}), " if joint else ""
    differs, least, most = (f"{100 * value:.2g}" for value in spread)
    said = (
        f"{x.size} records of one specimen: {named}{what} = {number(value)}{unit} ± {100 * sd:.2g} % "
        f"(95 %: {number(low)} to {number(high)}); one more record would have {number(next_low)} to "
        f"{number(next_high)}. Between records the damping differs by {differs} % (95 %: {least} to {most} %); the "
        f"standardised variance of the records' own values is {standardised:.1f}."
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
        next_low,
        next_high,
        first,
        probability,
        joint.probabilities if joint else {},
        spread,
    )
