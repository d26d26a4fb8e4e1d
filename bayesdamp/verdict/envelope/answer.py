"""What is said of a decay under all its sums."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from bayesdamp.inference.deviation.numbers.quantities import quantity
from bayesdamp.inference.envelope.candidates import Candidate
from bayesdamp.inference.envelope.decay import Curve, Decay
from bayesdamp.inference.envelope.exponent import by_power, power_law
from bayesdamp.inference.envelope.likelihood import RateLikelihood, likelihood_of
from bayesdamp.inference.envelope.posterior import DRIFT, SENSOR, Draws, draw
from bayesdamp.inference.envelope.ranking import ranked
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


def answer(decay: Decay, sums: Sequence[Sum], seed: int) -> Answer:
    """Return the damping of a decay by these sums. seed: of the draws."""
    b = decay.blocks
    ranking = ranked(sums, weighed(b, sums, decay.noises, decay.inverse))
    power = power_law(decay, ranking)
    rng = np.random.default_rng([seed, b.t.size])
    top, bottom = b.ends
    amplitudes = np.array([top + share * (bottom - top) for share in ASKED])
    # Of any rate that the record does not tell.
    sensor = float(np.hypot(SENSOR, DRIFT / (0.5 * decay.fall))) if decay.record.logarithmic else SENSOR

    def drawn(candidates: Sequence[Candidate], terms: Sequence[str]) -> tuple[Draws, Draws]:
        """Return draws with the law's deviation and the sensor's error, and without both."""
        whole = draw(b, candidates, terms, amplitudes, rng, sensor)
        return whole, draw(b, candidates, terms, amplitudes, rng, sensor=0.0, exact=True)

    by_laws = drawn(ranking.candidates, ranking.terms)
    deviation = interval_of(quantity(by_laws[0].deviation))
    alike = untold(ranking)
    inexact = Grade.APPROXIMATE if deviation.high <= thresholds.DEVIATES else Grade.DEVIATES
    grade = Grade.EXACT if ranking.exact >= thresholds.LIKELY_EXACT else inexact
    decided = ranking.by_sum[ranking.best.name] >= thresholds.DECIDED and ranking.best_exact is ranking.best
    by_sum = decided and grade is not Grade.DEVIATES
    one_power = power.odds > thresholds.POWER_LAW and b.t.size >= thresholds.FEW_READINGS and not by_sum
    whole, plain = by_laws
    if (
        one_power and "power" not in ranking.terms
    ):  # laws that the record does not follow have no rates of its own
        whole, plain = drawn([*ranking.candidates, *by_power(decay)], (*ranking.terms, "power"))
    best, frequency, omega = ranking.best, decay.record.frequency, decay.omega
    probabilities = {name: min(p, thresholds.CAP) for name, p in ranking.by_sum.items()}
    first = probabilities.pop(best.name)
    unexplained, noise = decay.misfit(ranking.fitted.fit)
    shares = zip(ranking.by_term.items(), map(quantity, by_laws[0].energy.T), strict=True)

    def at(kind: type[Kind], of: Callable[[np.ndarray], np.ndarray]) -> tuple[Kind, ...]:
        """Return what follows from the rates at the amplitudes."""
        each = zip(amplitudes, of(whole.at).T, of(plain.at).T, strict=True)
        sizes = ((decay.amplitude(x), estimate_of(draws, also)) for x, draws, also in each)
        return tuple(kind(*place, e.value, e.sd_noise, e.sd_law, e.low, e.high) for place, e in sizes)

    verdict = Verdict(
        record=decay.record.name,
        grade=Grade.DEVIATES if one_power else grade,
        decided=by_sum and not alike,
        damping=best.name,
        probability=first,
        rivals=rivals_of({best.name: first, **probabilities}, {}),
        frequency=Interval(frequency, frequency, frequency, "Hz") if frequency else None,
        exponent=interval_of(power.exponent),
        damping_ratio=at(DampingRatio, lambda rates: rates / omega) if omega else (),
        energy=tuple(Share(term, q.value, q.low, q.high, p) for (term, p), q in shares),
        deviation=deviation,
        unexplained_pct=100 * unexplained,
        noise_pct=100 * noise,
        coefficients=coefficients_of(decay, best, ranking, *by_laws),
        window=_window(decay),
        quantity="envelope",
        rate=estimate_of(whole.whole, plain.whole, "1/s"),
        quality_factor=estimate_of(omega / 2 / whole.whole, omega / 2 / plain.whole) if omega else None,
        decay_rate=at(AtAmplitude, lambda rates: rates),
        quality_factor_at=at(AtAmplitude, lambda rates: omega / 2 / rates) if omega else (),
        probability_exact=ranking.exact,
        power_law=power.odds,
    )
    verdict = replace(verdict, remarks=remarks(verdict, decay, ranking, alike), sentence=sentence(verdict))
    curve = decay.curve(*ranking.fitted.curve(decay.blocks))
    without_parameters = {one.name for one in ranking.sums if not one.count}
    plain_sums = [c for c in ranking.candidates if c.name in without_parameters]
    likelihoods = {c.name: likelihood_of(c, b, decay.reference, decay.record.unit) for c in plain_sums}
    return Answer(verdict, curve, likelihoods)


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
