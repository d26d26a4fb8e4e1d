"""What is said of a decay under all its sums."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from bayesdamp.inference.deviation.numbers.quantities import quantity
from bayesdamp.inference.envelope.candidates import Candidate
from bayesdamp.inference.envelope.decay import Curve, Decay
from bayesdamp.inference.envelope.exponent import by_power, power_law
from bayesdamp.inference.envelope.likelihood import RateLikelihood, likelihood_of
from bayesdamp.inference.envelope.posterior import DRIFT, SENSOR, Draws, draw
from bayesdamp.inference.envelope.ranking import Ranking, ranked
from bayesdamp.inference.envelope.sums import Sum, weighed
from bayesdamp.inference.envelope.untold import untold
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.decide import interval_of, rivals_of
from bayesdamp.verdict.envelope.coefficients import coefficients_of, estimate_of
from bayesdamp.verdict.envelope.remarks import remarks
from bayesdamp.verdict.parts import AtAmplitude, DampingRatio, Grade, Interval, Share, Window
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import sentence

ASKED = (0.15, 0.5, 0.85)
"""Where in the decay's fall in dB rates are quoted."""
Kind = TypeVar("Kind", bound=AtAmplitude)


@dataclass(frozen=True, eq=False)
class Answer:
    """The verdict on an envelope; its curve, None where nothing decays; and the likelihoods of the rates, by sum, for
    an answer over several records: of those sums whose terms have no parameters beside coefficients."""

    verdict: Verdict
    curve: Curve | None = None
    likelihoods: Mapping[str, RateLikelihood] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Drawn:
    """Draws with the law's deviation and the sensor's error, and given that it holds exactly, without that error."""

    whole: Draws
    plain: Draws


def answer(decay: Decay, sums: Sequence[Sum], seed: int) -> Answer:
    """The damping of a decay by these sums. seed: of the draws."""
    ranking = ranked(sums, weighed(decay.blocks, sums, decay.noises, decay.inverse))
    power = power_law(decay, ranking)
    rng = np.random.default_rng([seed, decay.blocks.t.size])
    drawn = _drawn(decay, ranking.candidates, ranking.terms, rng)
    deviation = interval_of(quantity(drawn.whole.deviation))
    alike = untold(ranking)
    inexact = Grade.APPROXIMATE if deviation.high <= thresholds.DEVIATES else Grade.DEVIATES
    grade = Grade.EXACT if ranking.exact >= thresholds.LIKELY_EXACT else inexact
    decided = ranking.by_sum[ranking.best.name] >= thresholds.DECIDED and ranking.best_exact is ranking.best
    by_sum = decided and grade is not Grade.DEVIATES
    one_power = (
        power.odds > thresholds.POWER_LAW and decay.blocks.t.size >= thresholds.FEW_READINGS and not by_sum
    )
    rated = drawn
    if (
        one_power and "power" not in ranking.terms
    ):  # rates by laws that the record does not follow are none of its own
        rated = _drawn(decay, [*ranking.candidates, *by_power(decay)], (*ranking.terms, "power"), rng)
    best, frequency, omega = ranking.best, decay.record.frequency, decay.omega
    probabilities = {name: min(p, thresholds.CAP) for name, p in ranking.by_sum.items()}
    first = probabilities.pop(best.name)
    unexplained, noise = decay.misfit(ranking.fitted.fit)
    whole, plain = rated.whole, rated.plain
    verdict = Verdict(
        record=decay.record.name,
        grade=Grade.DEVIATES if one_power else grade,
        decided=by_sum and not alike,
        damping=best.name,
        probability=first,
        rivals=rivals_of({best.name: first, **probabilities}, {}),
        frequency=Interval(frequency, frequency, frequency, "Hz") if frequency else None,
        exponent=interval_of(power.exponent),
        damping_ratio=_at(decay, DampingRatio, whole.at / omega, plain.at / omega) if omega else (),
        energy=_energy(ranking, drawn.whole),
        deviation=deviation,
        unexplained_pct=100 * unexplained,
        noise_pct=100 * noise,
        coefficients=coefficients_of(decay, best, ranking, drawn.whole, drawn.plain),
        window=_window(decay),
        quantity="envelope",
        rate=estimate_of(whole.whole, plain.whole, "1/s"),
        quality_factor=estimate_of(omega / 2 / whole.whole, omega / 2 / plain.whole) if omega else None,
        decay_rate=_at(decay, AtAmplitude, whole.at, plain.at),
        quality_factor_at=_at(decay, AtAmplitude, omega / 2 / whole.at, omega / 2 / plain.at)
        if omega
        else (),
        probability_exact=ranking.exact,
        power_law=power.odds,
    )
    verdict = replace(verdict, remarks=remarks(verdict, decay, ranking, alike), sentence=sentence(verdict))
    curve = decay.curve(*ranking.fitted.curve(decay.blocks))
    return Answer(verdict, curve, _likelihoods(decay, ranking))


def _drawn(
    decay: Decay, candidates: Sequence[Candidate], terms: Sequence[str], rng: np.random.Generator
) -> Drawn:
    b, amplitudes = decay.blocks, _amplitudes(decay)
    whole = draw(b, candidates, terms, amplitudes, rng, _sensor(decay))
    return Drawn(whole, draw(b, candidates, terms, amplitudes, rng, sensor=0.0, exact=True))


def _likelihoods(decay: Decay, ranking: Ranking) -> dict[str, RateLikelihood]:
    plain = {one.name for one in ranking.sums if not one.count}
    return {
        c.name: likelihood_of(c, decay.blocks, decay.reference, decay.record.unit)
        for c in ranking.candidates
        if c.name in plain
    }


def _energy(ranking: Ranking, draws: Draws) -> tuple[Share, ...]:
    found = []
    for i, (term, probability) in enumerate(ranking.by_term.items()):
        share = quantity(draws.energy[:, i])
        found.append(Share(term, share.value, share.low, share.high, probability))
    return tuple(found)


def _amplitudes(decay: Decay) -> np.ndarray:
    """ln(A/A_ref) at which rates are quoted."""
    top, bottom = decay.blocks.ends
    return np.array([top + share * (bottom - top) for share in ASKED])


def _sensor(decay: Decay) -> float:
    """Relative sd of any rate that the record does not tell."""
    return float(np.hypot(SENSOR, DRIFT / (0.5 * decay.fall))) if decay.record.logarithmic else SENSOR


def _at(decay: Decay, kind: type[Kind], whole: np.ndarray, plain: np.ndarray) -> tuple[Kind, ...]:
    """Of draws at the amplitudes, (n, amplitudes)."""
    found = []
    for x, draws, also in zip(_amplitudes(decay), whole.T, plain.T, strict=True):
        of = estimate_of(draws, also)
        found.append(kind(*decay.amplitude(x), of.value, of.sd_noise, of.sd_law, of.low, of.high))
    return tuple(found)


def _window(decay: Decay) -> Window:
    record, window, first = decay.record, decay.window, decay.first
    why = list(window.why)
    if first > window.start:
        why[0] = (
            f"starts at {record.t[first]:.4g} s, where the reading before it is no continuation of the decay"
        )
    floor = 10.0 * np.log10(window.floor.power) if window.floor is not None else float("nan")
    start, stop = float(record.t[first]), float(record.t[window.stop - 1])
    cycles = (record.frequency or float("nan")) * (stop - start)
    return Window(start, stop, cycles, "; ".join(filter(None, why)), float(floor))
