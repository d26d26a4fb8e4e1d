"""What is said of a decay under all its sums."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.envelope.coefficients import coefficients_of
from bayesdamp.envelope.model.candidates import Blocks, Candidate, weigh_power
from bayesdamp.envelope.model.laws import POWERS
from bayesdamp.envelope.model.noise import Noise
from bayesdamp.envelope.model.posterior import DRIFT, SENSOR, Draws, draw
from bayesdamp.envelope.model.sums import Sum, sums_on, weighed
from bayesdamp.envelope.records.one_law import NEPER
from bayesdamp.envelope.records.record import EnvelopeRecord
from bayesdamp.envelope.records.window import Window
from bayesdamp.envelope.results import AtAmplitude, Curve, Cut, EnvelopeResult, Range, estimated
from bayesdamp.envelope.words import FEW, remarks, sentence

DECIDED = 0.95
APPROXIMATE = 0.25
"""Deviation (95 % bound) up to which a sum is said to hold approximately."""
POWER_LAW = np.log(20.0)
"""Log Bayes factor from which a power law is said to describe a decay better than every sum."""
ASKED = (0.15, 0.5, 0.85)
"""Where in the decay's fall in dB rates are quoted."""


@dataclass(frozen=True, eq=False)
class Decay:
    """The free decay of a record: its window, its first reading, its blocks, and ln of their reference amplitude in the
    record's unit."""

    record: EnvelopeRecord
    window: Window
    first: int
    blocks: Blocks
    reference: float

    @property
    def omega(self) -> float | None:
        """rad/s."""
        return 2.0 * np.pi * self.record.frequency if self.record.frequency else None


def answer(
    decay: Decay, sums: Sequence[Sum], noises: list[tuple[Noise, np.ndarray]], inverse: np.ndarray, seed: int
) -> EnvelopeResult:
    """The damping of a decay by these sums, noises with the covariance of readings each, and the inverse triangle in
    which fits are sought."""
    record, b, reference, omega = decay.record, decay.blocks, decay.reference, decay.omega
    candidates = weighed(b, sums, noises, inverse)
    names = [one.name for one in sums]
    log_z = _by_sum(names, candidates, [c.total + c.log_share for c in candidates])
    log_exact = _by_sum(names, candidates, [c.total_exact + c.log_share for c in candidates])
    probability = np.exp(log_z - log_z.max())
    probability /= probability.sum()
    best = int(np.argmax(probability))
    fitted = max((c for c in candidates if c.name == names[best]), key=lambda c: c.total + c.log_share)
    there = dict.fromkeys(term for one in sums for term in one.terms)
    terms = sorted(there, key=lambda term: (*POWERS, *there).index(term))
    decided = bool(probability[best] > DECIDED and np.argmax(log_exact) == best)
    probability_exact = float(np.exp(np.logaddexp.reduce(log_exact) - np.logaddexp.reduce(log_z)))
    top, bottom = b.ends
    amplitudes = np.array([top + share * (bottom - top) for share in ASKED])
    rng = np.random.default_rng([seed, b.t.size])
    sensor = _sensor(record, 0.5 * (top - bottom) * NEPER)

    def drawn(every: Sequence[Candidate], names: Sequence[str]) -> tuple[Draws, Draws]:
        whole = draw(b, every, names, amplitudes, rng, sensor)
        return whole, draw(b, every, names, amplitudes, rng, sensor=0.0, exact=True)

    draws, plain = drawn(candidates, terms)
    power_z, power_mean, power_variance = weigh_power(b, noises, inverse)
    prior = np.logaddexp.reduce([one.log_prior for one in sums])
    odds = float(np.logaddexp.reduce(power_z) - np.logaddexp.reduce(log_z) + prior)
    low, middle, high = np.quantile(draws.deviation, [0.025, 0.5, 0.975])
    deviation = Range(float(middle), float(low), float(high))
    grade = (
        "exact"
        if probability_exact >= 0.5
        else "approximate"
        if deviation.high <= APPROXIMATE
        else "deviates"
    )
    by_power = odds > POWER_LAW and b.t.size >= FEW and not (decided and grade != "deviates")
    if by_power and "power" not in terms:
        # Rates by laws that the record does not follow are none of its own.
        rated, rated_plain = drawn([*candidates, *_by_power(b, noises, inverse)], (*terms, "power"))
    else:
        rated, rated_plain = draws, plain
    misfit, scatter = _misfit(b, fitted, noises)
    found = EnvelopeResult(
        name=record.name,
        grade="deviates" if by_power else grade,
        sentence="",
        decided=decided and not by_power and grade != "deviates",
        damping=names[best],
        probability=float(probability[best]),
        probabilities={n: float(p) for n, p in zip(names, probability, strict=True)},
        terms={
            t: float(sum(p for one, p in zip(sums, probability, strict=True) if t in one.terms))
            for t in terms
        },
        frequency=record.frequency,
        rate=estimated(rated.whole, rated_plain.whole),
        quality_factor=estimated(omega / 2 / rated.whole, omega / 2 / rated_plain.whole) if omega else None,
        at=tuple(
            _at(record, (amplitudes[i] + reference) * NEPER, rated.at[:, i], rated_plain.at[:, i], omega)
            for i in range(amplitudes.size)
        ),
        energy={
            term: Range(*(float(q) for q in np.quantile(draws.energy[:, i], [0.5, 0.025, 0.975])))
            for i, term in enumerate(terms)
        },
        exponent=_mixture_range(power_z, power_mean, power_variance, 0.0, 3.0),
        power_law=odds,
        deviation=deviation,
        probability_exact=probability_exact,
        unexplained_pct=100 * misfit,
        noise_pct=100 * scatter,
        coefficients=coefficients_of(record, sums[best], sums, candidates, draws, plain, reference),
        cut=_cut(decay),
        curve=_curve(decay, fitted, noises),
    )
    said = remarks(found, record, decay.window.stop - decay.first, (top - bottom) * NEPER)
    return replace(found, sentence=sentence(found), remarks=said)


def _by_sum(names: Sequence[str], candidates: Sequence[Candidate], logs: Sequence[float]) -> np.ndarray:
    """ln of the sum over each sum's candidates."""
    return np.array(
        [
            np.logaddexp.reduce([one for one, c in zip(logs, candidates, strict=True) if c.name == name])
            for name in names
        ]
    )


def _by_power(b: Blocks, noises: list[tuple[Noise, np.ndarray]], inverse: np.ndarray) -> list[Candidate]:
    """One power of the velocity, as a term."""
    from bayesdamp.envelope.terms.loss import Scale

    return weighed(b, sums_on([("power",)], Scale(), b.ends[0], float(b.x.min())), noises, inverse)


def _cut(decay: Decay) -> Cut:
    record, window, first = decay.record, decay.window, decay.first
    why = list(window.why)
    if first > window.start:
        why[0] = (
            f"starts at {record.t[first]:.4g} s, where the reading before it is no continuation of the decay"
        )
    floor = 10.0 * np.log10(window.floor.power) if window.floor is not None else float("nan")
    return Cut(
        float(record.t[first]), float(record.t[window.stop - 1]), first, window.stop, tuple(why), float(floor)
    )


def _curve(decay: Decay, fitted: Candidate, noises: list[tuple[Noise, np.ndarray]]) -> Curve:
    b, t = decay.blocks, decay.record.t[decay.first : decay.window.stop]
    # The blocks' own clock starts at the first one's middle.
    return Curve(
        b.t + float(t.min()) + 0.5 * (b.t[1] - b.t[0]) * (b.each > 1),
        (b.x + decay.reference) * NEPER,
        (fitted.fit + decay.reference) * NEPER,
        np.sqrt(np.diag(noises[0][1])) * NEPER,
    )


def _sensor(record: EnvelopeRecord, fall: float) -> float:
    """Relative sd of any rate that the record does not tell. fall: dB of half of the decay."""
    return float(np.hypot(SENSOR, DRIFT / fall)) if record.logarithmic else SENSOR


def _at(
    record: EnvelopeRecord, level: float, draws: np.ndarray, plain: np.ndarray, omega: float | None
) -> AtAmplitude:
    amplitude, unit = record.amplitude(level)
    ratio = estimated(draws / omega, plain / omega) if omega else None
    quality = estimated(omega / 2 / draws, omega / 2 / plain) if omega else None
    return AtAmplitude(float(amplitude), unit, estimated(draws, plain), ratio, quality)


def _mixture_range(
    log_weight: np.ndarray, mean: np.ndarray, variance: np.ndarray, least: float, most: float
) -> Range:
    """Median and 95 % interval of a mixture of normals cut off at both ends."""
    weight = np.exp(log_weight - log_weight.max())
    grid = np.linspace(least, most, 3001)
    density = np.zeros_like(grid)
    for w, m, v in zip(weight, mean, variance, strict=True):
        if w > 1e-5:
            density += w / np.sqrt(v) * np.exp(-0.5 * (grid - m) ** 2 / v)
    total = np.cumsum(density)
    if not total[-1] > 0:  # narrower than the grid, or beyond an end of it
        centre = float(np.clip(weight @ mean / weight.sum(), least, most))
        return Range(centre, centre, centre)
    low, middle, high = (float(q) for q in np.interp([0.025, 0.5, 0.975], total / total[-1], grid))
    return Range(middle, low, high)


def _misfit(b: Blocks, c: Candidate, noises: list[tuple[Noise, np.ndarray]]) -> tuple[float, float]:
    """Root mean squares, relative to the amplitude and weighted by its square, of what the fit leaves and of noise."""
    weight = np.exp(2.0 * c.fit)
    weight = weight / weight.sum()
    off = b.x - c.fit
    off = off - weight @ off
    return float(np.sqrt(weight @ off**2)), float(np.sqrt(weight @ np.diag(noises[0][1])))
