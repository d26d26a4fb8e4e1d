"""What is said of a decay under all its sums."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.envelope.answer.coefficients import coefficients_of
from bayesdamp.envelope.answer.decay import Decay
from bayesdamp.envelope.answer.exponent import PowerLaw, by_power, power_law
from bayesdamp.envelope.answer.posterior import DRIFT, SENSOR, Draws, draw
from bayesdamp.envelope.answer.ranking import Ranking, ranked
from bayesdamp.envelope.answer.untold import untold
from bayesdamp.envelope.likelihood import RateLikelihood, likelihood_of
from bayesdamp.envelope.model.candidates import Candidate
from bayesdamp.envelope.model.sums import Sum, weighed
from bayesdamp.envelope.records.one_law import NEPER
from bayesdamp.envelope.results import AtAmplitude, Curve, Cut, EnvelopeResult, Estimated, Range, estimated
from bayesdamp.envelope.words import FEW, remarks, sentence

APPROXIMATE = 0.25
"""Deviation (95 % bound) up to which a sum is said to hold approximately."""
POWER_LAW = np.log(20.0)
"""Log Bayes factor from which a power law is said to describe a decay better than every sum."""
ASKED = (0.15, 0.5, 0.85)
"""Where in the decay's fall in dB rates are quoted."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """Draws with the law's deviation and the sensor's error, and given that it holds exactly, without that error."""

    whole: Draws
    plain: Draws


@dataclass(frozen=True)
class Verdict:
    """grade: see `EnvelopeResult`; decided: whether a sum is named outright; by_power: whether one power of the
    amplitude describes the decay instead."""

    grade: str
    decided: bool
    by_power: bool


def answer(decay: Decay, sums: Sequence[Sum], seed: int) -> EnvelopeResult:
    """The damping of a decay by these sums. seed: of the draws."""
    ranking = ranked(sums, weighed(decay.blocks, sums, decay.noises, decay.inverse))
    power = power_law(decay, ranking)
    rng = np.random.default_rng([seed, decay.blocks.t.size])
    drawn = _drawn(decay, ranking.candidates, ranking.terms, rng)
    deviation = _range(drawn.whole.deviation)
    alike = untold(ranking)
    verdict = _verdict(ranking, power, deviation, decay.blocks.t.size, bool(alike))
    found = _found(decay, ranking, verdict, drawn, _rated(decay, ranking, verdict, drawn, rng))
    found = replace(found, exponent=power.exponent, power_law=power.odds, deviation=deviation)
    said = remarks(found, decay.record, decay.readings, decay.fall, alike)
    return replace(found, sentence=sentence(found, alike), remarks=said)


def _drawn(
    decay: Decay, candidates: Sequence[Candidate], terms: Sequence[str], rng: np.random.Generator
) -> Drawn:
    b, amplitudes = decay.blocks, _amplitudes(decay)
    whole = draw(b, candidates, terms, amplitudes, rng, _sensor(decay))
    return Drawn(whole, draw(b, candidates, terms, amplitudes, rng, sensor=0.0, exact=True))


def _rated(decay: Decay, ranking: Ranking, verdict: Verdict, drawn: Drawn, rng: np.random.Generator) -> Drawn:
    """What rates are read from: those by laws that the record does not follow are none of its own."""
    if not verdict.by_power or "power" in ranking.terms:
        return drawn
    return _drawn(decay, [*ranking.candidates, *by_power(decay)], (*ranking.terms, "power"), rng)


def _verdict(ranking: Ranking, power: PowerLaw, deviation: Range, blocks: int, alike: bool) -> Verdict:
    """blocks: of the decay; alike: whether a sum that was weighed loses as the most probable one does."""
    inexact = "approximate" if deviation.high <= APPROXIMATE else "deviates"
    grade = "exact" if ranking.exact >= 0.5 else inexact
    by_sum = ranking.decided and grade != "deviates"
    instead = power.odds > POWER_LAW and blocks >= FEW and not by_sum
    return Verdict("deviates" if instead else grade, by_sum and not instead and not alike, instead)


def _found(decay: Decay, ranking: Ranking, verdict: Verdict, drawn: Drawn, rated: Drawn) -> EnvelopeResult:
    """All but the exponent, the deviation and what is said."""
    best = ranking.best
    misfit, scatter = _misfit(decay, ranking.fitted)
    return EnvelopeResult(
        name=decay.record.name,
        grade=verdict.grade,
        sentence="",
        decided=verdict.decided,
        damping=best.name,
        probability=ranking.by_sum[best.name],
        probabilities=ranking.by_sum,
        terms=ranking.by_term,
        frequency=decay.record.frequency,
        rate=estimated(rated.whole.whole, rated.plain.whole),
        quality_factor=_quality(decay, rated.whole.whole, rated.plain.whole),
        at=_at(decay, rated),
        energy={term: _range(drawn.whole.energy[:, i]) for i, term in enumerate(ranking.terms)},
        probability_exact=ranking.exact,
        unexplained_pct=100 * misfit,
        noise_pct=100 * scatter,
        coefficients=coefficients_of(
            decay.record, best, ranking.sums, ranking.candidates, drawn.whole, drawn.plain, decay.reference
        ),
        cut=_cut(decay),
        curve=_curve(decay, ranking.fitted),
        likelihoods=_likelihoods(decay, ranking),
    )


def _likelihoods(decay: Decay, ranking: Ranking) -> dict[str, RateLikelihood]:
    plain = {one.name for one in ranking.sums if not one.count}
    return {
        c.name: likelihood_of(c, decay.blocks, decay.reference, decay.record.unit)
        for c in ranking.candidates
        if c.name in plain
    }


def _range(draws: np.ndarray) -> Range:
    middle, low, high = (float(q) for q in np.quantile(draws, [0.5, 0.025, 0.975]))
    return Range(middle, low, high)


def _amplitudes(decay: Decay) -> np.ndarray:
    """ln(A/A_ref) at which rates are quoted."""
    top, bottom = decay.blocks.ends
    return np.array([top + share * (bottom - top) for share in ASKED])


def _sensor(decay: Decay) -> float:
    """Relative sd of any rate that the record does not tell."""
    return float(np.hypot(SENSOR, DRIFT / (0.5 * decay.fall))) if decay.record.logarithmic else SENSOR


def _quality(decay: Decay, whole: np.ndarray, plain: np.ndarray) -> Estimated | None:
    """Q of rates in 1/s, None where the frequency is not known."""
    return estimated(decay.omega / 2 / whole, decay.omega / 2 / plain) if decay.omega else None


def _at(decay: Decay, rated: Drawn) -> tuple[AtAmplitude, ...]:
    found = []
    for i, x in enumerate(_amplitudes(decay)):
        whole, plain = rated.whole.at[:, i], rated.plain.at[:, i]
        amplitude, unit = decay.record.amplitude((x + decay.reference) * NEPER)
        ratio = estimated(whole / decay.omega, plain / decay.omega) if decay.omega else None
        quality = _quality(decay, whole, plain)
        found.append(AtAmplitude(float(amplitude), unit, estimated(whole, plain), ratio, quality))
    return tuple(found)


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


def _curve(decay: Decay, fitted: Candidate) -> Curve:
    b, t = decay.blocks, decay.record.t[decay.first : decay.window.stop]
    # The blocks' own clock starts at the first one's middle.
    return Curve(
        b.t + float(t.min()) + 0.5 * (b.t[1] - b.t[0]) * (b.each > 1),
        (b.x + decay.reference) * NEPER,
        (fitted.fit + decay.reference) * NEPER,
        np.sqrt(np.diag(decay.noises[0][1])) * NEPER,
    )


def _misfit(decay: Decay, fitted: Candidate) -> tuple[float, float]:
    """Root mean squares, relative to the amplitude and weighted by its square, of what the fit leaves and of noise."""
    weight = np.exp(2.0 * fitted.fit)
    weight = weight / weight.sum()
    off = decay.blocks.x - fitted.fit
    off = off - weight @ off
    return float(np.sqrt(weight @ off**2)), float(np.sqrt(weight @ np.diag(decay.noises[0][1])))
