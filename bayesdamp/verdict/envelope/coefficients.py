"""Coefficients of the equation of motion, and terms' own parameters, out of rates at an amplitude."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple

import numpy as np

from bayesdamp.inference.deviation.numbers.quantities import quantity
from bayesdamp.inference.envelope.decay import Decay
from bayesdamp.inference.envelope.posterior import Draws
from bayesdamp.inference.envelope.ranking import Ranking
from bayesdamp.inference.envelope.sums import Sum
from bayesdamp.physics.amplitude.laws import POWERS, coefficients
from bayesdamp.verdict.parts import Coefficient, Estimate


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
