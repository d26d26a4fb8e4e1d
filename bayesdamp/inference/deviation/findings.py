"""The numbers that a verdict is made of, from a weighing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.gaussian.tempered import Sampled
from bayesdamp.inference.deviation.numbers.bounds import bounds_of_others
from bayesdamp.inference.deviation.numbers.curves import (
    at_share,
    balanced_frequency,
    natural_frequency,
    orbit_of,
    ratio_at,
    share_of_time,
)
from bayesdamp.inference.deviation.numbers.deviations import (
    left_over,
    midline_drift,
    off_laws,
    over_laws,
    size_of,
    unnamed_share,
)
from bayesdamp.inference.deviation.numbers.draws import (
    DRAWS,
    CandidateDraws,
    Quantity,
    drawn_from,
    draws_of,
    noise_sds,
    probabilities,
    quantity,
    shares_of,
)
from bayesdamp.inference.deviation.numbers.free import FreeCurve, free_curve
from bayesdamp.inference.deviation.numbers.rivals import LEAST_EXPONENT, MOST_EXPONENT
from bayesdamp.inference.deviation.weighing import CandidateResult, Weighing
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import Prior
from bayesdamp.types import Ratio, summed

SENSOR = 0.002
"""Relative standard deviation of every rate, at least: the sensor's linearity and the clock's."""
CURVE = 12
"""Amplitudes of a curve."""
RARE = 1e-3
"""Probability of rivals with another form of damping from which rates are averaged over them too."""
FEW = 200
"""Draws, about, of a frequency."""
AS_WIDE = 0.7
"""Width of an interval relative to the prior's own from which the record does not determine a parameter
(conventional)."""
TIED, LOOSE = 0.98, 0.2
"""Correlation from which two parameters cannot be told apart, where both have a half interval of at least this share of
their value (conventional)."""
INSIDE = 0.95
"""Share of the draws in the shortest interval."""
QUANTILES = {"q2.5": 0.025, "q25": 0.25, "median": 0.5, "q75": 0.75, "q97.5": 0.975}


@dataclass(frozen=True)
class Findings:
    """A weighing in numbers, before anything is decided.

    Attributes
    ----------
    damping, exact : mapping of str to float
        Probability of each sum (its terms joined by +) under laws that hold approximately, and exactly.
    exotic : mapping of str to float
        Probability of sums with another form of damping.
    exponent : Quantity, optional
        Of a power law in the velocity.
    restoring : mapping of str to float
        Probability of each law.
    term : mapping of str to float
        Probability of each term, over all candidates that have it.
    ratios, curve : tuple of Ratio
        Damping ratios at the amplitudes asked for, and over all amplitudes of the record.
    frequency : Quantity
        Of small oscillations, in Hz.
    energy : mapping of str to Quantity
        Share of the dissipated energy by term.
    bound : mapping of str to float
        95 % upper limit of the share of a term that is absent from the likeliest sum, if added to it.
    deviation, restoring_deviation : Quantity
        Energy-weighted mean of the relative deviation of the damping and restoring laws.
    other : float
        95 % upper limit of the share of any other form.
    coefficients : mapping of str to Quantity
        Under the likeliest sum.
    best : Candidate
        The likeliest candidate.
    unexplained, noise : float
        Rms of what the likeliest candidate leaves beyond noise, and of the noise, as shares of the amplitude.
    amplitudes : tuple of float
        First and last of the record, in rad or m.
    cycles : float
        Number of cycles.
    free : FreeCurve, optional
        The damping curve without a law.
    unnamed : Quantity, optional
        Share of the energy that no sum of the terms explains.
    untold, tied : tuple
        Parameters of the likeliest sum that the record does not determine, and pairs of which it determines only a
        combination.
    exponents : tuple of float
        Quantiles of the exponent, equidistant in probability; none where there is no exponent.
    midline : float
        Drift of the midline over the record, as a share of the first amplitude; 0 where it is not significant.
    frequency_at : Quantity, optional
        Of oscillations at the last of the ratios' amplitudes, in Hz.
    over_laws : tuple of Quantity
        The damping at the ratios' amplitudes over that of the law itself.
    over_curve : tuple of (float, float)
        Mean and sd of the log of the same along the curve, about the deviation's mean over the knots.
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
    best: MotionCandidate
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
    """Return amplitudes near the first, the middle (in the logarithm) and near the last one of the record."""
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
    """Compute the numbers of a weighing.

    Parameters
    ----------
    weighing : Weighing
        Of all candidates.
    amplitudes : sequence of float, optional
        At which the damping ratio is given, in rad or m; by default three of the record.
    approximate : bool
        Under laws that hold approximately, with the sensor's floor; else exactly, without it.
    sensor : float
        Relative sd of the sensor.
    seed : int
        Of the random streams.
    """
    rng, data, terms = np.random.default_rng(seed), weighing.data, weighing.terms
    exact_all = probabilities(weighing, True)
    everything = probabilities(weighing, False) if approximate else exact_all
    compared = {r.candidate for r in weighing.results}
    exotic = {c: p for c, p in everything.items() if c not in compared}
    chosen = probabilities(weighing, not approximate, forms=False)
    wanted = tuple(amplitudes) if amplitudes is not None else default_amplitudes(weighing)
    along = tuple(map(float, np.geomspace(data.amplitude, data.final_amplitude, CURVE)))
    drawn = drawn_from(weighing, chosen, approximate, rng)
    # Rates, frequencies and deviations are those of all candidates, other forms of damping included.
    every = drawn_from(weighing, everything, approximate, rng) if sum(exotic.values()) > RARE else drawn
    best = max(chosen, key=lambda c: chosen[c])
    shares = shares_of(weighing, drawn)
    absent = _bounds(weighing, best, approximate, rng)
    forms = bounds_of_others(weighing, weighing.result(best), approximate, np.random.default_rng([seed, 1]))
    size_g = np.concatenate([size_of(d.result, d.g) for d in every])
    size_h = np.concatenate([size_of(d.result, d.h) for d in every])
    floor = sensor if approximate else 0.0
    curve = tuple(ratio_at(weighing, every, a, floor, rng) for a in along)
    ratios = tuple(ratio_at(weighing, every, a, floor, rng) for a in wanted)
    over, over_curve, unnamed = (), (), None
    if approximate:
        over = over_laws(every, wanted, np.random.default_rng([seed, 3]))
        over_curve = off_laws(every, along, np.random.default_rng([seed, 4]))
        unnamed = unnamed_share(drawn, along)
    of_best = next((d for d in drawn if d.result.candidate == best), None)
    exponent = quantity(np.array(weighing.exponents)) if weighing.exponents else None
    untold = _undetermined(of_best) if of_best is not None else ()
    if exponent and exponent.high - exponent.low > 0.95 * AS_WIDE * (MOST_EXPONENT - LEAST_EXPONENT):
        untold = (*untold, "exponent")
    likeliest = max(everything, key=lambda c: everything[c])
    leading = weighing.result(likeliest)
    unexplained, noise = left_over(leading)
    return Findings(
        damping={n: p * (1 - sum(exotic.values())) for n, p in _summed(chosen).items()},
        exact=_summed({c: p for c, p in exact_all.items() if c in compared}),
        exotic=_summed(exotic),
        exponent=exponent,
        restoring=_summed(chosen, 1),
        term={t: sum(p for c, p in everything.items() if t in c.damping) for t in terms},
        ratios=ratios,
        curve=curve,
        frequency=_frequency(every),
        energy={t: quantity(shares[:, i]) for i, t in enumerate(terms)},
        bound=forms | absent,
        deviation=quantity(size_g),
        restoring_deviation=quantity(size_h),
        other=float(np.quantile(size_g, 0.95)),
        coefficients=_coefficients(weighing, of_best) if of_best is not None else {},
        best=best,
        unexplained=unexplained,
        noise=noise,
        amplitudes=(data.amplitude, data.final_amplitude),
        cycles=data.cycles,
        free=free_curve(weighing, best.restoring, curve, np.random.default_rng([seed, 2])),
        unnamed=unnamed,
        untold=untold,
        tied=_inseparable(of_best) if of_best is not None else (),
        exponents=weighing.exponents,
        midline=midline_drift(leading),
        frequency_at=_frequency_at(every, wanted[-1]) if wanted else None,
        over_laws=over,
        over_curve=over_curve,
    )


def _summed(each: Mapping[MotionCandidate, float], part: int = 0) -> dict[str, float]:
    """Return probabilities by damping sum, or with `part` 1 by law, the largest first."""
    return summed({c.name: p for c, p in each.items()}, part)


def _frequency(drawn: Sequence[CandidateDraws]) -> Quantity:
    """Return the frequency of small oscillations in Hz: the restoring law's, with the deviation at the record's end."""
    values = []
    for d in drawn:
        name = d.result.candidate.restoring
        for row, h in zip(_thinned(d.law), _thinned(d.h[:, -1]), strict=True):
            at = _rest_of_draw(d.result, row)
            values.append(natural_frequency(name, row, at, d.result.data.amplitude) * (1 + h) / (2 * np.pi))
    return quantity(np.array(values))


def _frequency_at(drawn: Sequence[CandidateDraws], amplitude: float) -> Quantity | None:
    """Return the frequency in Hz at an amplitude of the record, deviation included; None where no orbit has it."""
    values = []
    for d in drawn:
        orbit = orbit_of(d.result, amplitude)
        if orbit is None:
            continue
        name, centre = d.result.candidate.restoring, d.result.law
        at = _rest_of_draw(d.result, centre)
        # The error of the first harmonic is that at the mode.
        scale = orbit.frequency / max(balanced_frequency(name, centre, at, amplitude), 1e-300)
        share = share_of_time(d.result, amplitude)
        for row, h in zip(_thinned(d.law), _thinned(at_share(d.h, share)), strict=True):
            at = _rest_of_draw(d.result, row)
            values.append(scale * balanced_frequency(name, row, at, amplitude) * (1 + h) / (2 * np.pi))
    return quantity(np.array(values)) if values else None


def _thinned(draws: np.ndarray) -> np.ndarray:
    """Return about `FEW` of the draws (n, ...), which are in the order of their hyperparameters: some of each."""
    return draws[:: max(1, len(draws) // FEW)]


def _rest_of_draw(result: CandidateResult, law: np.ndarray) -> float:
    """Return the equilibrium of one draw of a restoring law's parameters.

    A record of velocity or acceleration does not determine it: each draw has its own, and the frequency about that.
    """
    names = LAWS.get(result.candidate.restoring).parameters
    if "rest_angle" in names:
        return float(law[names.index("rest_angle")])
    return result.data.rest_under(result.candidate.restoring, law)


def _bounds(
    weighing: Weighing, best: MotionCandidate, approximate: bool, rng: np.random.Generator
) -> dict[str, float]:
    """Return 95 % upper limits of the share of each term that the likeliest sum lacks, if it were added to that sum."""
    same_law = [r for r in weighing.results if r.candidate.restoring == best.restoring]
    bounds = {}
    for i, term in enumerate(weighing.terms):
        larger = [r for r in same_law if set(r.candidate.damping) == {*best.damping, term}]
        if term in best.damping or not larger or (approximate and larger[0].weighed is None):
            continue
        shares = shares_of(weighing, [draws_of(larger[0], DRAWS // 4, approximate, rng)])
        bounds[term] = float(np.quantile(shares[:, i], 0.95))
    return bounds


def _coefficients(weighing: Weighing, d: CandidateDraws) -> dict[str, Quantity]:
    """Return the inferred parameters of a candidate's damping and restoring law."""
    sds = noise_sds(weighing, d.result).tolist()
    by_name = dict(zip(d.result.fit.parameters.free_names, sds, strict=True))
    values = np.column_stack([d.coefficients, d.further, d.law])
    names = d.result.solver.names[: values.shape[1]]
    return {name: quantity(values[:, i], by_name[name]) for i, name in enumerate(names) if name in by_name}


def _undetermined(d: CandidateDraws) -> tuple[str, ...]:
    """Return the terms' own parameters whose interval is as wide as that of their prior."""
    priors, solver, names = d.result.fit.parameters.priors, d.result.solver, []
    for i, name in enumerate(solver.further):
        if name in solver.inferred and name in priors:
            low, high = np.quantile(d.further[:, i], (0.025, 0.975))
            if as_wide(priors[name], float(low), float(high)):
                names.append(name)
    return tuple(names)


def as_wide(prior: Prior, low: float, high: float) -> bool:
    """Return whether an interval is nearly as wide as the prior's own, in the prior's scores."""
    whole = 2.24 - 0.03 if prior.reflected else 2 * 1.96
    return float(prior.score(high) - prior.score(low)) > AS_WIDE * whole


def _inseparable(d: CandidateDraws) -> tuple[tuple[str, str], ...]:
    """Return pairs of a candidate's coefficients and own parameters of which the record determines a combination."""
    priors, solver = d.result.fit.parameters.priors, d.result.solver
    names = (*solver.names[: len(solver.terms)], *solver.further)
    values = np.column_stack([d.coefficients, d.further])
    free = [i for i, name in enumerate(names) if name in priors and values[:, i].std() > 0]
    pairs = []
    for i, j in combinations(free, 2):
        loose = all(1.96 * values[:, k].std() > LOOSE * abs(values[:, k].mean()) for k in (i, j))
        if loose and abs(np.corrcoef(values[:, i], values[:, j])[0, 1]) > TIED:
            pairs.append((names[i], names[j]))
    return tuple(pairs)


def posterior_of(
    weighing: Weighing, result: CandidateResult, sampled: Sampled
) -> tuple[dict[str, object], np.ndarray]:
    """Summarise the draws of a candidate's motions.

    Returns
    -------
    dict
        `parameters`: name to mean, sd, quantiles and the shortest interval; sd_noise is what the noise alone would
        cause if the laws were exact, sd_law the rest. `deviation`: of the damping law, energy-weighted, (2.5 %,
        median, 97.5 %). `unexplained`: rms of what the plain fit leaves beyond noise, as a share of the amplitude.
        `log_evidence` and `stderr` in nats, and diagnostics.
    ndarray, shape (n, p)
        The inferred parameters of each draw.
    """
    parameters = result.fit.parameters
    d, n = parameters.free.size, result.solver.knots.size
    values = parameters.values(sampled.draws[:, :d])[:, parameters.free]
    rows = zip(parameters.free_names, values.T, noise_sds(weighing, result), strict=True)
    sizes = size_of(result, sampled.draws[:, d : d + n]) if sampled.draws.shape[1] > d else np.zeros(1)
    summary = {
        "parameters": {name: _summary(own, float(noise)) for name, own, noise in rows},
        "deviation": np.quantile(sizes, (0.025, 0.5, 0.975)).tolist(),
        "unexplained": left_over(result)[0],
        "log_evidence": sampled.log_evidence,
        "stderr": sampled.stderr,
        "acceptance": sampled.acceptance,
        "temperatures": sampled.temperatures,
    }
    return summary, values


def _summary(values: np.ndarray, noise: float) -> dict[str, float]:
    """Return mean, sd and its parts, quantiles and the shortest interval of draws (n,)."""
    sd = float(np.std(values, ddof=1))
    noise = min(noise, sd)
    ordered = np.sort(values)
    inside = int(np.ceil(INSIDE * values.size))
    widths = ordered[inside - 1 :] - ordered[: values.size - inside + 1]
    first = int(np.argmin(widths))
    return {
        "mean": float(np.mean(values)),
        "sd": sd,
        "sd_noise": noise,
        "sd_law": float(np.sqrt(sd**2 - noise**2)),
        **{name: float(np.quantile(values, q)) for name, q in QUANTILES.items()},
        "hdi_low": float(ordered[first]),
        "hdi_high": float(ordered[first + inside - 1]),
    }
