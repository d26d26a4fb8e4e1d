"""What a weighing says: the numbers that a verdict is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.deviation.candidate import Candidate
from bayesdamp.inference.deviation.numbers.bounds import bounds_of_others
from bayesdamp.inference.deviation.numbers.curves import (
    at_share,
    orbit_of,
    ratio_at,
    share_of_time,
    values_of,
)
from bayesdamp.inference.deviation.numbers.deviations import (
    left_over,
    midline_drift,
    off_laws,
    over_laws,
    size_of,
)
from bayesdamp.inference.deviation.numbers.draws import (
    DRAWS,
    Drawn,
    Quantity,
    drawn_from,
    draws_of,
    probabilities,
    quantity,
    shares_of,
)
from bayesdamp.inference.deviation.numbers.exponent import LEAST, MOST
from bayesdamp.inference.deviation.numbers.free import FreeCurve, free_curve
from bayesdamp.inference.deviation.numbers.unnamed import AS_WIDE, tied, unnamed_share, untold
from bayesdamp.inference.deviation.orbit import balanced_frequency, natural_frequency
from bayesdamp.inference.deviation.sampled.table import noise_sds
from bayesdamp.inference.deviation.weighing import Weighing
from bayesdamp.physics.restoring import LAWS
from bayesdamp.types import Ratio, summed

SENSOR = 0.002
"""Relative standard deviation below which no rate is known: the sensor's linearity and the clock's."""
CURVE = 12
"""Amplitudes of a curve."""
RARE = 1e-3
"""Probability of rivals with another form of damping from which rates are averaged over them too."""


@dataclass(frozen=True)
class Findings:
    """A weighing in numbers, before anything is decided.

    damping, exact: probability of each sum (its terms joined by +) under laws that hold approximately, and exactly.
    exotic: of sums with another form of damping. exponent: of a power law in the velocity. restoring: of each law.
    term: of each term, summed over all that was weighed that has it. ratios: at the amplitudes asked for, curve: over
    all.
    energy: share of the dissipated energy by term; bound: 95 % upper limit of an absent one's beside the likeliest sum.
    deviation, restoring_deviation: energy-weighted mean of the relative deviation of the damping and restoring laws.
    other: 95 % upper limit of the share of any other form. coefficients: under the likeliest sum. unexplained, noise:
    root mean square of what the likeliest candidate leaves beyond noise, and of the noise, as shares of the amplitude.
    free: the damping curve without a law; unnamed: share of the energy that no sum of the terms explains; untold, tied:
    parameters of the likeliest sum that the record does not tell, and pairs that it tells only together; exponents:
    quantiles of the exponent, equidistant in probability, none where there is no exponent; midline: by how much it
    drifts over the record, as a share of the first amplitude, 0 where that is not seen. frequency: of small
    oscillations, frequency_at: at the last of the ratios' amplitudes, Hz. over_laws: how many times the law's own the
    damping is at the ratios' amplitudes; over_curve: mean and sd of the logarithm of the same along the curve, about
    the deviation's mean over the knots.
    """

    damping: Mapping[str, float]
    exact: Mapping[str, float]
    exotic: Mapping[str, float]
    exponent: Quantity | None
    restoring: Mapping[str, float]
    term: Mapping[str, float]
    ratios: tuple[Ratio, ...]
    curve: tuple[Ratio, ...]
    frequency: Quantity
    energy: Mapping[str, Quantity]
    bound: Mapping[str, float]
    deviation: Quantity
    restoring_deviation: Quantity
    other: float
    coefficients: Mapping[str, Quantity]
    best: Candidate
    unexplained: float
    noise: float
    amplitudes: tuple[float, float]
    cycles: float
    free: FreeCurve | None = None
    unnamed: Quantity | None = None
    untold: tuple[str, ...] = ()
    tied: tuple[tuple[str, str], ...] = ()
    exponents: tuple[float, ...] = ()
    midline: float = 0.0
    frequency_at: Quantity | None = None
    over_laws: tuple[Quantity, ...] = ()
    over_curve: tuple[tuple[float, float], ...] = ()


def default_amplitudes(weighing: Weighing) -> tuple[float, float, float]:
    """Near the first, the middle (in the logarithm) and near the last amplitude of the record."""
    data = weighing.data
    first, last = data.amplitude, max(data.final_amplitude, 1e-6 * data.amplitude)
    span = np.log(first / last)
    return tuple(float(first * np.exp(-span * share)) for share in (0.1, 0.5, 0.9))  # type: ignore[return-value]


def findings(
    weighing: Weighing,
    amplitudes: Sequence[float] | None = None,
    *,
    approximate: bool = True,
    sensor: float = SENSOR,
    seed: int = 0,
) -> Findings:
    """The numbers of a weighing. amplitudes: where the damping ratio is asked for; three of the record by default.

    approximate: under laws that hold approximately, with the sensor's floor; else exactly, without.
    """
    rng = np.random.default_rng(seed)
    exact_all = probabilities(weighing, True)
    everything = probabilities(weighing, False) if approximate else exact_all
    own = {r.candidate for r in weighing.results}
    exotic = sum(p for c, p in everything.items() if c not in own)
    chosen = probabilities(weighing, not approximate, forms=False)
    wanted = tuple(amplitudes) if amplitudes is not None else default_amplitudes(weighing)
    drawn = drawn_from(weighing, chosen, approximate, rng)
    # Rates, frequencies and deviations are those of all that was weighed, other forms of damping among it.
    every = drawn_from(weighing, everything, approximate, rng) if exotic > RARE else drawn
    best = max(chosen, key=lambda c: chosen[c])
    result = next(r for r in weighing.results if r.candidate == best)
    terms = next(iter(weighing.solvers.values())).terms
    shares = shares_of(weighing, drawn)
    damping = _summed(chosen)
    absent = _bounds(weighing, best, approximate, terms, rng)
    forms = bounds_of_others(weighing, result, approximate, np.random.default_rng([seed, 1]))
    size = np.concatenate([size_of(weighing, d.result, d.g) for d in every])
    size_h = np.concatenate([size_of(weighing, d.result, d.h) for d in every])
    curve = tuple(ratio_at(weighing, every, a, sensor if approximate else 0.0, rng) for a in _grid(weighing))
    solver = weighing.solvers[best.restoring]
    of_best = next((d for d in drawn if d.result.candidate == best), None)
    exponent = quantity(np.array(weighing.exponents)) if weighing.exponents else None
    likeliest = max(everything, key=lambda c: everything[c])
    leading = next(r for r in (*weighing.results, *weighing.forms) if r.candidate == likeliest)
    unexplained, noise = left_over(weighing, leading)
    return Findings(
        damping={n: p * (1 - exotic) for n, p in damping.items()},
        exotic=_summed({c: p for c, p in everything.items() if c not in own}),
        exponent=exponent,
        exponents=weighing.exponents,
        exact=_summed({c: p for c, p in exact_all.items() if c in own}),
        restoring=_summed(chosen, 1),
        term={t: sum(p for c, p in everything.items() if t in c.damping) for t in terms},
        ratios=tuple(ratio_at(weighing, every, a, sensor if approximate else 0.0, rng) for a in wanted),
        curve=curve,
        frequency=_frequency(weighing, every),
        frequency_at=_frequency_at(weighing, every, wanted[-1]) if wanted else None,
        energy={t: quantity(shares[:, i]) for i, t in enumerate(terms)},
        bound=forms | absent,
        deviation=quantity(size),
        over_laws=over_laws(weighing, every, wanted, np.random.default_rng([seed, 3])) if approximate else (),
        over_curve=off_laws(weighing, every, _grid(weighing), np.random.default_rng([seed, 4]))
        if approximate
        else (),
        restoring_deviation=quantity(size_h),
        other=float(np.quantile(size, 0.95)),
        coefficients=_coefficients(weighing, drawn, best),
        best=best,
        unexplained=unexplained,
        midline=midline_drift(weighing, leading),
        noise=noise,
        amplitudes=(weighing.data.amplitude, weighing.data.final_amplitude),
        cycles=weighing.data.cycles,
        free=free_curve(weighing, best.restoring, curve, np.random.default_rng([seed, 2])),
        unnamed=unnamed_share(weighing, drawn, _grid(weighing)) if approximate else None,
        untold=(
            *(untold(of_best, solver) if of_best is not None else ()),
            # Where its interval is as wide as what was assumed.
            *(
                ["exponent"]
                if exponent and exponent.high - exponent.low > 0.95 * AS_WIDE * (MOST - LEAST)
                else []
            ),
        ),
        tied=tied(of_best, solver) if of_best is not None else (),
    )


def _summed(found: Mapping[Candidate, float], part: int = 0) -> dict[str, float]:
    """Probabilities by damping sum, or with `part` 1 by law, the largest first."""
    return summed({c.name: p for c, p in found.items()}, part)


def _grid(weighing: Weighing) -> tuple[float, ...]:
    """Amplitudes of a curve, from the record's first to its last."""
    data = weighing.data
    return tuple(map(float, np.geomspace(data.amplitude, data.final_amplitude, CURVE)))


def _frequency(weighing: Weighing, drawn: Sequence[Drawn]) -> Quantity:
    """Return the frequency of small oscillations in Hz: the restoring law's, deviating as at the record's end."""
    values = []
    for d in drawn:
        name = d.result.candidate.restoring
        # Draws come by their hyperparameters: some of each. The deviation is that of the smallest oscillations.
        every = slice(None, None, max(1, len(d.law) // 200))
        for row, h in zip(d.law[every], d.h[every, -1], strict=True):
            at = _rest_of_draw(weighing, name, row)
            values.append(natural_frequency(name, row, at, weighing.data.amplitude) * (1 + h) / (2 * np.pi))
    return quantity(np.array(values))


def _frequency_at(weighing: Weighing, drawn: Sequence[Drawn], amplitude: float) -> Quantity | None:
    """Of the oscillation when it has an amplitude of the record, deviation included; None where no orbit has it."""
    values = []
    for d in drawn:
        orbit = orbit_of(weighing, d.result, amplitude)
        if orbit is None:
            continue
        name, centre = d.result.candidate.restoring, values_of(d.result)[d.result.solver.law_places]
        at = _rest_of_draw(weighing, name, centre)
        # The first harmonic's error is that of the mode.
        scale = orbit.frequency / max(balanced_frequency(name, centre, at, amplitude), 1e-300)
        every = slice(None, None, max(1, len(d.law) // 200))
        share = share_of_time(weighing, d.result, amplitude)
        for row, h in zip(d.law[every], at_share(d.h, share)[every], strict=True):
            at = _rest_of_draw(weighing, name, row)
            values.append(scale * balanced_frequency(name, row, at, amplitude) * (1 + h) / (2 * np.pi))
    return quantity(np.array(values)) if values else None


def _rest_of_draw(weighing: Weighing, restoring: str, law: np.ndarray) -> float:
    """Return the equilibrium of one draw of a restoring law's parameters.

    A record of velocity or acceleration does not determine it: each draw has its own, and the frequency about that.
    """
    names = LAWS.get(restoring).parameters
    if "rest_angle" in names:
        return float(law[names.index("rest_angle")])
    return weighing.data.rest_under(restoring, law)


def _bounds(
    weighing: Weighing, best: Candidate, approximate: bool, terms: tuple[str, ...], rng: np.random.Generator
) -> dict[str, float]:
    """95 % upper limits of the share of each term that the likeliest sum lacks, were it there beside that sum."""
    found = {}
    for term in terms:
        wanted = {*best.damping, term}
        beside = (
            r
            for r in weighing.results
            if set(r.candidate.damping) == wanted and r.candidate.restoring == best.restoring
        )
        result = next(beside, None)
        if term in best.damping or result is None or (approximate and result.weighed is None):
            continue
        shares = shares_of(weighing, [draws_of(weighing, result, DRAWS // 4, approximate, rng)])
        found[term] = float(np.quantile(shares[:, terms.index(term)], 0.95))
    return found


def _coefficients(weighing: Weighing, drawn: Sequence[Drawn], best: Candidate) -> dict[str, Quantity]:
    names = weighing.solvers[best.restoring].names
    d = next((d for d in drawn if d.result.candidate == best), None)
    if d is None:
        return {}
    sds = noise_sds(weighing, d.result).tolist()
    by_name = dict(zip(d.result.fit.parameters.free_names, sds, strict=True))
    values = np.column_stack([d.coefficients, d.further, d.law])
    return {
        name: quantity(values[:, i], by_name[name])
        for i, name in enumerate(names[: values.shape[1]])
        if name in by_name
    }
