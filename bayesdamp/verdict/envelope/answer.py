"""What is said of a decay under all its sums: its numbers, coefficients of the equation of motion, and remarks."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from typing import TypeVar

import numpy as np

from bayesdamp.inference.deviation.numbers.draws import quantity
from bayesdamp.inference.envelope.candidates import Candidate
from bayesdamp.inference.envelope.decay import Curve, Decay
from bayesdamp.inference.envelope.posterior import DRIFT, SENSOR, Draws, RateLikelihood, draw, likelihood_of
from bayesdamp.inference.envelope.ranking import Ranking, by_power, power_law, ranked, untold
from bayesdamp.inference.envelope.sums import Sum, weighed
from bayesdamp.physics.amplitude.laws import POWERS, coefficients
from bayesdamp.physics.damping import PAPER_TERMS, twins_of
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.decide import interval_of, rivals_of
from bayesdamp.verdict.parts import (
    AtAmplitude,
    Coefficient,
    DampingRatio,
    Estimate,
    Grade,
    Interval,
    Share,
    Window,
)
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import by_ten, named, sentence


def remarks(v: Verdict, decay: Decay, ranking: Ranking, alike: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """A sentence each. alike: names of sums of which the first loses as the second does."""
    record = decay.record
    said = list(record.notes)
    if record.frequency is None:
        said.append(
            "The frequency is not known (--frequency HZ, or a line `% Frequency [Hz]: ...`): rates, but no Q."
        )
    if record.logarithmic:
        paper = all(term in PAPER_TERMS for term in ranking.terms)
        which = "Coulomb and quadratic" if paper else "all but viscous"
        said.append(f"Amplitudes have no scale: {which} coefficients are relative to that at the start.")
    for term in v.damping.split("+"):
        twins = " or ".join(named(twin) for twin in twins_of(term))
        if twins:
            said.append(
                f"An envelope cannot tell {named(term)} damping from {twins} damping, for they lose alike at every "
                f"amplitude: any part of what is called {named(term)} may be {twins}."
            )
    said += [
        f"Here {named(one)} damping loses as {named(other)} damping does at every amplitude: an envelope cannot tell "
        "them apart, and their probabilities are what was held possible before."
        for one, other in alike
    ]
    if ranking.best_exact is not ranking.best:
        said.append(
            f"If the damping followed its law exactly, {named(ranking.best_exact.name)} would be ahead."
        )
    if decay.readings < thresholds.FEW_READINGS:
        said.append(f"{decay.readings} readings only: the noise is hardly known.")
    if decay.fall < thresholds.SHALLOW:
        said.append(
            f"The level falls by {decay.fall:.1f} dB only: dampings are hardly told apart below "
            f"{thresholds.SHALLOW:g}."
        )
    if v.window is not None and not math.isfinite(v.window.floor_db):
        said.append("No noise floor is seen behind the decay: its power is inferred from the decay alone.")
    if v.power_law > thresholds.POWER_LAW and not v.decided and decay.readings >= thresholds.FEW_READINGS:
        said.append(
            "A single power law of the amplitude describes the decay better than every sum: rates are by it "
            "(--damping power, or cubic where the power is near 3, weigh it)."
        )
    stated = _stated_quality(decay)
    if stated is not None and v.quality_factor is not None:
        ours = v.quality_factor
        off = (ours.value - stated) / max(math.hypot(ours.sd_noise, ours.sd_law), 1e-300)
        side = "below" if off > 0 else "above"
        said.append(f"The file's head states Q = {by_ten(f'{stated:.4g}')}, {abs(off):.1f} sd {side} this.")
    return tuple(said)


def _stated_quality(decay: Decay) -> float | None:
    """Q as the head of the file has it."""
    facts = decay.record.facts.items()
    text = next((text for name, text in facts if name.lower().startswith("quality factor")), "")
    try:
        return float(text.split()[0])
    except (ValueError, IndexError):
        return None


def estimate_of(draws: np.ndarray, plain: np.ndarray, unit: str = "") -> Estimate:
    """Of draws (n,), and of those by the readings' noise alone."""
    q = quantity(draws, min(float(np.std(plain)), float(np.std(draws))))
    return Estimate(q.value, q.sd_noise, q.sd_law, q.low, q.high, unit)


def coefficients_of(
    decay: Decay, best: Sum, ranking: Ranking, draws: Draws, plain: Draws
) -> tuple[Coefficient, ...]:
    """Of the most probable sum's terms, over all sums that have them; relative to the amplitude at the start where the
    record has no scale."""
    record, omega = decay.record, decay.omega
    amplitude = float(np.exp(-best.start if record.logarithmic else decay.reference))
    unit = record.unit.replace("^2", "").replace("2", "")
    if record.logarithmic or record.unit in ("W", "mW", "uW", "nW", "pW"):
        unit = "A_start" if record.logarithmic else f"√{record.unit}"
    found: list[Coefficient] = []
    for term in best.terms:
        if term in POWERS:
            have, also = (one.rates[term] for one in (draws, plain))
            name, values, of = coefficients([term], have[None], amplitude, omega)[0]
            same = coefficients([term], also[None], amplitude, omega)[0][1] if also.size else values
            found.append(_coefficient(name, of.format(unit), values, same))
        else:
            found += _registered(term, best, ranking, (draws, plain), amplitude, omega, unit)
    return tuple(found)


def _registered(
    name: str,
    best: Sum,
    ranking: Ranking,
    draws: tuple[Draws, Draws],
    amplitude: float,
    omega: float | None,
    unit: str,
) -> list[Coefficient]:
    """A registered term's coefficient and own parameters; without a frequency its rate at the start, and what of its
    parameters has no time in it."""
    from bayesdamp.physics.amplitude.loss import Scale, parameter

    by_name = {one.name: one for one in ranking.sums}
    term = best.each[best.terms.index(name)]
    assert best.scale is not None
    scale = Scale(amplitude * float(np.exp(best.start)), omega or 1.0)
    if best.scale.amplitude != 1.0:  # it has a size of its own
        scale = Scale(best.scale.amplitude, scale.frequency)
        unit = "rad" if unit in ("rad", "mrad", "deg") else "m"
    own, units = {}, {}
    for k, one in enumerate(ranking.candidates):
        if name not in one.terms:
            continue
        place, sum_ = one.terms.index(name), by_name[one.name]
        own[k] = sum_.own(one.scores, place)
        log_rate = sum_.unit_rate(place, own[k], scale)
        at_start = float(np.log(one.law.shapes(np.array([sum_.start]))[place, 0]))
        units[k] = at_start if omega is None else -log_rate

    def coefficient(called: str, of: str, value: Callable[[int], float], rates: bool = False) -> Coefficient:
        every = []
        for one in draws:
            places = one.candidate[np.isin(one.candidate, list(own))]
            values = np.array([value(int(k)) for k in places])
            every.append(values * one.rates[name] if rates else values)
        return _coefficient(called, of, every[0], every[1] if every[1].size else every[0])

    called, of = (
        (f"rate_{name}", "1/s") if omega is None else (term.parameter, term.unit.replace("rad", unit))
    )
    found = [coefficient(called, of, lambda k: float(np.exp(units[k])), rates=True)]
    for i, one in enumerate(term.inferred):
        if omega is not None or "s" not in one.unit.replace("rad", ""):
            of = one.unit.replace("rad", unit)
            found.append(coefficient(one.name, of, lambda k, i=i, one=one: parameter(one, own[k][i], scale)))
    return found


def _coefficient(name: str, unit: str, draws: np.ndarray, plain: np.ndarray) -> Coefficient:
    return Coefficient(name, *astuple(estimate_of(draws, plain, unit)))


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
