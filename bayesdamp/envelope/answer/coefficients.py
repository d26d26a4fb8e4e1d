"""Coefficients of the equation of motion, and terms' own parameters, out of rates at an amplitude."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from bayesdamp.envelope.answer.posterior import Draws
from bayesdamp.envelope.model.candidates import Candidate
from bayesdamp.envelope.model.laws import POWERS, coefficients
from bayesdamp.envelope.model.sums import Sum
from bayesdamp.envelope.records.record import EnvelopeRecord
from bayesdamp.envelope.results import Coefficient, Estimated, estimated


def coefficients_of(
    record: EnvelopeRecord,
    best: Sum,
    sums: Sequence[Sum],
    candidates: Sequence[Candidate],
    draws: Draws,
    plain: Draws,
    reference: float,
) -> tuple[Coefficient, ...]:
    """Of the most probable sum's terms, over all sums that have them; relative to the amplitude at the start where the
    record has no scale. reference: ln of the reference amplitude in the record's unit."""
    omega = 2.0 * np.pi * record.frequency if record.frequency else None
    amplitude = float(np.exp(-best.start if record.logarithmic else reference))
    unit = "A_start" if record.logarithmic else _root(record.unit)
    found: list[Coefficient] = []
    for term in best.terms:
        if term in POWERS:
            have, also = (one.rates[term] for one in (draws, plain))
            name, values, of = coefficients([term], have[None], amplitude, omega)[0]
            same = coefficients([term], also[None], amplitude, omega)[0][1] if also.size else values
            found.append(Coefficient(name, of.format(unit), estimated(values, same)))
        else:
            found += _registered(term, best, sums, candidates, (draws, plain), amplitude, omega, unit)
    return tuple(found)


def _registered(
    name: str,
    best: Sum,
    sums: Sequence[Sum],
    candidates: Sequence[Candidate],
    draws: tuple[Draws, Draws],
    amplitude: float,
    omega: float | None,
    unit: str,
) -> list[Coefficient]:
    """A registered term's coefficient and own parameters; without a frequency its rate at the start, and what of its
    parameters has no time in it."""
    from bayesdamp.envelope.terms.loss import Scale, parameter

    by_name = {one.name: one for one in sums}
    term = best.each[best.terms.index(name)]
    assert best.scale is not None
    scale = Scale(amplitude * float(np.exp(best.start)), omega or 1.0)
    if best.scale.amplitude != 1.0:  # it has a size of its own
        scale = Scale(best.scale.amplitude, scale.frequency)
        unit = "rad" if unit in ("rad", "mrad", "deg") else "m"
    own, units = {}, {}
    for k, one in enumerate(candidates):
        if name not in one.terms:
            continue
        place, sum_ = one.terms.index(name), by_name[one.name]
        own[k] = sum_.own(one.scores, place)
        log_rate = sum_.unit_rate(place, own[k], scale)
        at_start = float(np.log(one.law.shapes(np.array([sum_.start]))[place, 0]))
        units[k] = at_start if omega is None else -log_rate

    def estimate(value: Callable[[int], float], rates: bool = False) -> Estimated:
        every = []
        for one in draws:
            places = one.candidate[np.isin(one.candidate, list(own))]
            values = np.array([value(int(k)) for k in places])
            every.append(values * one.rates[name] if rates else values)
        return estimated(every[0], every[1] if every[1].size else every[0])

    coefficient = estimate(lambda k: float(np.exp(units[k])), rates=True)
    found = [
        Coefficient(f"rate_{name}", "1/s", coefficient)
        if omega is None
        else Coefficient(term.parameter, term.unit.replace("rad", unit), coefficient)
    ]
    for i, one in enumerate(term.inferred):
        if omega is not None or "s" not in one.unit.replace("rad", ""):
            values = estimate(lambda k, i=i, one=one: parameter(one, own[k][i], scale))
            found.append(Coefficient(one.name, one.unit.replace("rad", unit), values))
    return found


def _root(unit: str) -> str:
    """The amplitude's unit where its power's is given."""
    return f"√{unit}" if unit in ("W", "mW", "uW", "nW", "pW") else unit.replace("^2", "").replace("2", "")
