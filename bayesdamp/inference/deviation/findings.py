"""Compute from a comparison of damping models the numbers of a verdict, a posterior's summary and data for figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.draws import (
    TOTAL_DRAWS,
    CandidateDraws,
    Quantity,
    at_fraction,
    balanced_frequency,
    candidate_probabilities,
    draw_candidate,
    draw_candidates,
    log_ratio_over_law,
    mean_deviation,
    midline_drift,
    natural_frequency,
    noise_sds,
    orbits_of,
    quantity,
    ratio_over_law,
    ratios_at,
    restoring_of,
    shares_of,
    time_fraction,
    unexplained_and_noise,
    unit_works,
    with_parts_of_sd,
)
from bayesdamp.inference.deviation.forms import bound_other_forms
from bayesdamp.inference.deviation.model_comparison import CandidateResult, ModelComparison
from bayesdamp.inference.deviation.slices import LEAST_EXPONENT, MOST_EXPONENT
from bayesdamp.inference.deviation.tempered import TemperedDraws
from bayesdamp.inference.diagnostics import moments_and_quantiles
from bayesdamp.physics.forces import newton_many, slope_of
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import Prior
from bayesdamp.types import NORMAL_95, SENSOR, Ratio, sum_probabilities

CURVE_AMPLITUDES = 12
"""Number of amplitudes, from a record's first to its last, at which its damping ratio is computed for a curve."""
PROBABLE_RIVALS = 1e-3
"""If the total probability of all rivals is larger than this, they are included in the averages of damping ratios,
frequencies and deviations over the models. A rival is a sum with a form of damping that is not in the comparison."""
NEWTON_STEPS = 6
"""Number of steps of Newton's method from the equilibrium at the posterior's mode to the equilibrium for the restoring
parameters of a draw. Each step doubles the number of correct digits (conventional)."""
UNDETERMINED_WIDTH = 0.7
"""A record does not determine a parameter if the 95 % interval of its posterior is wider than this fraction of the 95 %
interval of its prior (conventional)."""
TIED_CORRELATION, LOOSE_INTERVAL = 0.98, 0.2
"""A record counts as determining only a combination of two damping parameters under two conditions (conventional). The
absolute correlation of their posterior draws is larger than `TIED_CORRELATION`. For each of the two, half the 95 %
interval is larger than `LOOSE_INTERVAL` times the absolute mean."""
MOST_PLOTTED = 3000
"""Largest number of samples in a figure, approximately. A longer record is cut into short intervals, and only the
minimum and the maximum of each interval are drawn."""


@dataclass(frozen=True)
class Findings:
    """The numbers from which a verdict is decided.

    A candidate is a compared sum of damping terms under a restoring law. A rival is a sum with another form of damping,
    which is evaluated after the candidates. The laws hold approximately: deviations multiply the damping force by exp g
    and the frequency by 1 + h. Under exact laws g = h = 0. Ratios, frequencies and deviations are those of the draws of
    all candidates and, if rivals are probable (`PROBABLE_RIVALS`), of rivals too.

    Attributes
    ----------
    damping, damping_if_exact : mapping of str to float
        Probability of each compared sum (terms joined by +) under all restoring laws together, the most probable one
        first; sums without a result are left out. `damping` allows deviations from the laws if the comparison does, and
        rivals have the rest of the probability. `damping_if_exact` assumes exact laws and no rivals; its sum is 1.
    other_forms : mapping of str to float
        Probability of each rival (terms joined by +), the most probable one first.
    exponent : Quantity, optional
        Exponent p of a damping force c |v|^p that replaces the whole sum (v: velocity); None if its posterior could not
        be computed.
    restoring : mapping of str to float
        Probability of each restoring law without rivals, the most probable law first.
    term : mapping of str to float
        Probability of each compared term: the sum over the candidates and rivals that contain it.
    ratios, curve : tuple of Ratio
        Equivalent damping ratios, at the requested amplitudes in `ratios`, and in `curve` at `CURVE_AMPLITUDES`
        amplitudes from the first to the last of the record, in equal steps of the logarithm; nan where no candidate has
        an orbit of the amplitude.
    frequency : Quantity
        Frequency of small oscillations at the end of the record (with its deviation h there), in Hz.
    energy : mapping of str to Quantity
        Fraction of the energy lost over the record that each compared term dissipates, from the joined draws of all
        candidates; it is 0 in the draws of a candidate without the term.
    bound : mapping of str to float
        95 % upper limit of the fraction of the dissipated energy, for each compared term that is not in the sum of
        `best`, and for the other forms of damping of `bound_other_forms`; a limit that cannot be computed is left out.
    deviation, restoring_deviation : Quantity
        Mean over the record of |g − mean of g|, and of |h − mean of h|, weighted by the energy; 0 under exact laws.
    other : float
        95 % upper limit of the energy fraction of any other form of damping: the 95 % quantile of the mean |g − mean of
        g| that `deviation` summarises.
    coefficients : mapping of str to Quantity
        Inferred parameters of the damping and the restoring law of `best`, by name, in units of rad (or m) and s.
    best : MotionCandidate
        The most probable candidate, without rivals.
    unexplained, noise : float
        Rms of the part of the residual under exact laws that noise does not cause, and sd of the noise of a sample, as
        fractions of the first amplitude of the recorded quantity, for the most probable candidate or rival.
    amplitudes : tuple of float
        First and last amplitude of the displacement in the used part of the record, in rad or m.
    cycles : float
        Number of cycles in the used part of the record.
    undetermined, inseparable : tuple
        Names of the damping terms' own parameters in `best` that the record does not determine, with "exponent" at the
        end if this is so for `exponent`; and pairs of damping parameters of which the record determines only a
        combination.
    midline : float
        Drift of the midline over the record, as a fraction of the first amplitude, from the residual of the most
        probable candidate or rival; 0 where it is not significant.
    frequency_at : Quantity, optional
        Frequency in Hz at the last amplitude of `ratios`, with its deviation h there; None if `ratios` is empty, or if
        no orbit has this amplitude.
    over_law : tuple of Quantity
        Damping with deviations divided by the damping of its law, at the amplitudes of `ratios` (see `ratio_over_law`);
        empty under exact laws.
    over_curve : tuple of (float, float)
        Mean and sd of log(damping ratio / damping ratio without deviations) for each amplitude of `curve`; empty under
        exact laws.
    """

    damping: Mapping[str, float]
    damping_if_exact: Mapping[str, float]
    other_forms: Mapping[str, float]
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
    undetermined: tuple[str, ...] = ()
    inseparable: tuple[tuple[str, str], ...] = ()
    midline: float = 0.0
    frequency_at: Quantity | None = None
    over_law: tuple[Quantity, ...] = ()
    over_curve: tuple[tuple[float, float], ...] = ()


def default_amplitudes(comparison: ModelComparison) -> tuple[float, float, float]:
    """Return three amplitudes of the record, in rad or m, at which damping ratios are reported by default.

    They divide the interval from the first to the last amplitude at 10, 50 and 90 % of the logarithm, the largest
    first.
    """
    data = comparison.data
    first, last = data.amplitude, max(data.final_amplitude, 1e-6 * data.amplitude)
    span = np.log(first / last)
    return tuple(float(first * np.exp(-span * share)) for share in (0.1, 0.5, 0.9))  # type: ignore[return-value]


def compute_findings(
    comparison: ModelComparison,
    amplitudes: Sequence[float] | None = None,
    *,
    sensor: float = SENSOR,
    seed: int = 0,
) -> Findings:
    """Compute the numbers of a verdict from a comparison of damping models.

    Parameters
    ----------
    comparison : ModelComparison
        The comparison, with at least one result; its field `forms` contains the rivals (sums with a form of damping
        that is not compared).
    amplitudes : sequence of float, optional
        Amplitudes at which damping ratios are computed, in rad or m; by default `default_amplitudes`. An empty sequence
        gives no ratios. `Findings.frequency_at` is for the smallest amplitude.
    sensor : float
        Relative sd of damping ratios because of the sensor's linearity and clock. It is included unless the comparison
        assumes exact laws.
    seed : int
        Seed of the random streams; equal seeds give equal numbers.
    """
    data, approximate, rng = comparison.data, comparison.approximate, np.random.default_rng(seed)
    exact = candidate_probabilities(comparison, exact=True, forms=False)
    everything = candidate_probabilities(comparison, exact=not approximate)
    chosen = candidate_probabilities(comparison, exact=not approximate, forms=False)
    compared = {r.candidate for r in comparison.results}
    other_forms = {c: p for c, p in everything.items() if c not in compared}
    wanted = tuple(amplitudes) if amplitudes is not None else default_amplitudes(comparison)
    along = tuple(map(float, np.geomspace(data.amplitude, data.final_amplitude, CURVE_AMPLITUDES)))
    drawn = draw_candidates(comparison, chosen, rng)
    # Average ratios, frequencies and deviations over all candidates, and over rivals too if they are probable.
    probable = sum(other_forms.values()) > PROBABLE_RIVALS
    every = draw_candidates(comparison, everything, rng) if probable else drawn
    best, leading = (comparison.result(max(each, key=lambda c: each[c])) for each in (chosen, everything))
    shares = shares_of(comparison, drawn)
    absent = _limits_of_absent_terms(comparison, best, rng)
    forms = bound_other_forms(comparison, best, np.random.default_rng([seed, 1]))
    size_g = np.concatenate([mean_deviation(d.result, d.g) for d in every])
    size_h = np.concatenate([mean_deviation(d.result, d.h) for d in every])
    ratios = ratios_at(comparison, every, (*along, *wanted), sensor if approximate else 0.0, rng)
    of_best = next((d for d in drawn if d.result is best), None)
    exponent = quantity(np.array(comparison.exponents)) if comparison.exponents else None
    coefficients, undetermined, inseparable = _parameters(comparison, of_best) if of_best else ({}, (), ())
    wide = 0.95 * UNDETERMINED_WIDTH * (MOST_EXPONENT - LEAST_EXPONENT)
    if exponent and exponent.high - exponent.low > wide:
        undetermined = (*undetermined, "exponent")
    unexplained, noise = unexplained_and_noise(leading)
    frequency = frequency_of_draws(every, None)
    assert frequency is not None
    return Findings(
        damping={n: p * (1 - sum(other_forms.values())) for n, p in _probability_by_name(chosen).items()},
        damping_if_exact=_probability_by_name(exact),
        other_forms=_probability_by_name(other_forms),
        exponent=exponent,
        restoring=_probability_by_name(chosen, 1),
        term={t: sum(p for c, p in everything.items() if t in c.damping) for t in comparison.terms},
        ratios=ratios[len(along) :],
        curve=ratios[: len(along)],
        frequency=frequency,
        energy={t: quantity(shares[:, i]) for i, t in enumerate(comparison.terms)},
        bound=forms | absent,
        deviation=quantity(size_g),
        restoring_deviation=quantity(size_h),
        other=float(np.quantile(size_g, 0.95)),
        coefficients=coefficients,
        best=best.candidate,
        unexplained=unexplained,
        noise=noise,
        amplitudes=(data.amplitude, data.final_amplitude),
        cycles=data.cycles,
        undetermined=undetermined,
        inseparable=inseparable,
        midline=midline_drift(leading),
        frequency_at=frequency_of_draws(every, min(wanted)) if wanted else None,
        over_law=ratio_over_law(every, wanted, np.random.default_rng([seed, 3])) if approximate else (),
        over_curve=log_ratio_over_law(every, along, np.random.default_rng([seed, 4])) if approximate else (),
    )


def _probability_by_name(each: Mapping[MotionCandidate, float], part: int = 0) -> dict[str, float]:
    """Return the total probability of each sum of damping terms (`part` = 0) or restoring law (`part` = 1), by name.

    The largest is first. each: probability of each candidate, which is a sum of damping terms under a restoring law.
    """
    return sum_probabilities({c.name: p for c, p in each.items()}, part)


def frequency_of_draws(drawn: Sequence[CandidateDraws], amplitude: float | None) -> Quantity | None:
    """Return median and 95 % interval of the frequency in Hz at an amplitude (rad or m).

    The draws of all candidates are joined. The frequency of each draw contains the factor 1 + h, where h is its
    relative deviation from the restoring law at the time when the motion has this amplitude (`time_fraction`). If
    `amplitude` is None, the result is for small oscillations, with h at the end of the record. Candidates without an
    orbit of this amplitude are left out; None if all are. The two parts of the sd (see `Quantity`) are nan.
    """
    values = []
    for d in drawn:
        name, best = d.result.candidate.restoring, d.result.law[None]
        force = restoring_of(name, d.law)
        if amplitude is None:
            h = d.h[:, -1]
            own = natural_frequency(force, _equilibria(d.result, d.law), d.result.data.amplitude)
        else:
            (orbit,) = orbits_of(d.result, [amplitude])
            if orbit is None:
                continue
            h = at_fraction(d.h, time_fraction(d.result, amplitude))
            own = balanced_frequency(force, _equilibria(d.result, d.law), amplitude)
            # Correct the error of harmonic balance by its error at the mode, where the orbit's exact period is known.
            at_mode = balanced_frequency(restoring_of(name, best), _equilibria(d.result, best), amplitude)[0]
            own = own * (2 * np.pi / float(orbit.period)) / max(at_mode, 1e-300)
        values.append(own * (1 + h) / (2 * np.pi))
    return quantity(np.concatenate(values)) if values else None


def _equilibria(result: CandidateResult, law: np.ndarray) -> np.ndarray:
    """Return the equilibria in rad or m, (n,), for n draws of the parameters of a candidate's restoring law, (n, r).

    If the law has a rest angle as a parameter, they are the rest angles of the draws, because a record of velocity or
    acceleration does not determine the equilibrium. Otherwise Newton's method starts from the equilibrium at the mode
    of the posterior; if it fails for a draw, the result is the equilibrium at the mode.
    """
    name = result.candidate.restoring
    names = LAWS.get(name).parameters
    if "rest_angle" in names:
        return law[:, names.index("rest_angle")]
    near = np.full(len(law), result.data.rest_under(name, result.law))
    force = restoring_of(name, law)
    rest = newton_many(force, near, NEWTON_STEPS)
    return np.where(np.isfinite(rest) & (slope_of(force, rest) > 0), rest, near)


def _limits_of_absent_terms(
    comparison: ModelComparison, best: CandidateResult, rng: np.random.Generator
) -> dict[str, float]:
    """Return, by name, 95 % upper limits of the energy fraction of each compared term that the best sum lacks.

    Compared terms are those of the candidates, by default viscous, Coulomb and quadratic damping. The limit is the 95 %
    quantile of the fraction of the energy, lost over the record, that the term dissipates. It is computed from draws of
    the candidate whose sum is the best sum plus this term, under the same restoring law. If this candidate has no
    result that may be compared (`ModelComparison.compares`), the term is left out. best: the most probable candidate.
    """
    restoring, damping = best.candidate.restoring, best.candidate.damping
    by_terms = {
        frozenset(r.candidate.damping): r
        for r in comparison.results
        if r.candidate.restoring == restoring and comparison.compares(r)
    }
    bounds = {}
    for i, term in enumerate(comparison.terms):
        larger = by_terms.get(frozenset((*damping, term)))
        if term not in damping and larger is not None:
            shares = shares_of(comparison, [draw_candidate(larger, TOTAL_DRAWS // 4, rng)])
            bounds[term] = float(np.quantile(shares[:, i], 0.95))
    return bounds


def _parameters(
    comparison: ModelComparison, d: CandidateDraws
) -> tuple[dict[str, Quantity], tuple[str, ...], tuple[tuple[str, str], ...]]:
    """Summarise the draws of one candidate by parameter, and find parameters that the record does not determine.

    Returns
    -------
    dict of str to Quantity
        Inferred parameters of the damping and the restoring law, by name.
    tuple of str
        Undetermined parameters: their posterior is nearly as wide as their prior (`is_as_wide_as`). Only parameters
        that damping terms have besides their coefficients can be among these.
    tuple of (str, str)
        Pairs of damping parameters of which the record determines only a combination (`TIED_CORRELATION`).
    """
    solver, priors = d.result.solver, d.result.fit.parameters.priors
    values = np.column_stack([d.coefficients, d.further, d.law]).T
    drawn = {name: own for name, own in zip(solver.names, values) if name in priors}
    noise = noise_sds(comparison, d.result)
    quantities = {name: quantity(own, noise[name]) for name, own in drawn.items()}
    own = [name for name in solver.further if name in drawn]
    loose = [
        name
        for name in (*solver.names[: len(solver.terms)], *own)
        if name in drawn and NORMAL_95 * drawn[name].std() > LOOSE_INTERVAL * abs(drawn[name].mean())
    ]
    inseparable = [
        (a, b)
        for a, b in combinations(loose, 2)
        if abs(np.corrcoef(drawn[a], drawn[b])[0, 1]) > TIED_CORRELATION
    ]
    undetermined = [
        name
        for name in own
        if name in solver.inferred
        and is_as_wide_as(priors[name], quantities[name].low, quantities[name].high)
    ]
    return quantities, tuple(undetermined), tuple(inseparable)


def is_as_wide_as(prior: Prior, low: float, high: float) -> bool:
    """Return whether a posterior's 95 % interval, from low to high, is nearly as wide as that of the prior.

    This is so if it is wider than `UNDETERMINED_WIDTH` times the interval of the prior. low and high are in the
    parameter's unit. For the comparison they are transformed so that the prior is standard normal (or its positive
    half, for a half-normal prior).
    """
    whole = 2.24 - 0.03 if prior.reflected else 2 * NORMAL_95
    return float(prior.score(high) - prior.score(low)) > UNDETERMINED_WIDTH * whole


def posterior_of(
    comparison: ModelComparison, result: CandidateResult, sampled: TemperedDraws
) -> tuple[dict[str, Any], np.ndarray]:
    """Summarise the sampled draws of a candidate; the equation of motion has been solved for each draw.

    Returns
    -------
    dict
        `parameters`: for each name a dict with mean, sd, quantiles and shortest 95 % interval (keys: see
        `diagnostics.QUANTILES`, and hdi_low, hdi_high), and the parts of the sd (`with_parts_of_sd`). `deviation`: 2.5,
        50 and 97.5 % quantiles of the mean over the record of |g − mean of g|, weighted by the energy, where g is the
        log of a factor on the damping (deviation from the law); zeros under exact laws. `unexplained`: rms of the
        residual beyond the noise as a fraction of the first amplitude, from the fit (`unexplained_and_noise`).
        `log_evidence` and its `stderr` in nats. `acceptance` and `temperatures`: see `TemperedDraws`.
    ndarray, shape (n, p)
        The inferred parameters of each draw, in their units, in the order of `Parameters.free_names`.
    """
    parameters, u = result.fit.parameters, sampled.draws
    d, n = parameters.free.size, result.solver.knots.size
    values = parameters.values(u[:, :d])[:, parameters.free]
    sizes = mean_deviation(result, u[:, d : d + n]) if u.shape[1] > d else np.zeros(1)
    noise = noise_sds(comparison, result)
    table = {
        "parameters": {
            name: with_parts_of_sd(moments_and_quantiles(own), noise[name])
            for name, own in zip(parameters.free_names, values.T, strict=True)
        },
        "deviation": np.quantile(sizes, (0.025, 0.5, 0.975)).tolist(),
        "unexplained": unexplained_and_noise(result)[0],
        "log_evidence": sampled.log_evidence,
        "stderr": sampled.stderr,
        "acceptance": sampled.acceptance,
        "temperatures": sampled.temperatures,
    }
    return table, values


def picture(comparison: ModelComparison, numbers: Findings) -> Mapping[str, np.ndarray]:
    """Return the arrays of an answer's figures, by name.

    Returns
    -------
    mapping of str to ndarray
        `t`, `record`, `fit`, `residual`, shape (p,): times in s from the first sample, recorded values, the motion of
        the best candidate (with deviations from the laws if it has any) and the difference record − fit. They are
        samples or means over windows, or the amplitudes of blocks if the record is reduced to these. If there are too
        many (`MOST_PLOTTED`), only extremes are included.

        `amplitude`, `ratio`, `low`, `high`, shape (a,): amplitudes in rad or m, the median of the damping ratio at
        each, and the ends of its 95 % interval.

        `law/SUM`, shape (a,), for each damping sum SUM with a result under the best restoring law: its damping ratio at
        `amplitude`, from the fit under exact laws.

        `work/TERM`, shape (a,), for each term of the best sum: energy that the term dissipates in a cycle at
        `amplitude`, from the same fit, per unit of inertia, in rad²/s² or m²/s².

        Values are nan where no orbit has the amplitude.
    """
    data = comparison.data
    best = comparison.result(numbers.best)
    t = data.t if data.averaged is None else data.averaged.track.middles
    y, fitted = data.of_amplitude(data.recorded), data.of_amplitude(best.motion.y)
    # Keep the minimum and the maximum of each interval, and both ends of the record.
    rows, size = np.arange(y.size), -(-y.size // (MOST_PLOTTED // 2))
    if size > 2:
        stretches = np.split(rows, range(size, y.size, size))
        extremes = [s[at] for s in stretches for at in (y[s].argmin(), y[s].argmax())]
        rows = np.unique([0, *extremes, y.size - 1])
    arrays = {"t": t[rows], "record": y[rows], "fit": fitted[rows], "residual": (y - fitted)[rows]}
    for name, of in (("amplitude", "amplitude"), ("ratio", "value"), ("low", "low"), ("high", "high")):
        arrays[name] = np.array([getattr(r, of) for r in numbers.curve])
    amplitude = arrays["amplitude"]
    terms, solver = comparison.terms, comparison.solvers[numbers.best.restoring]
    orbits = orbits_of(best, amplitude.tolist())
    energy = np.array([np.nan if o is None else o.energy for o in orbits])
    none = np.full(len(terms), np.nan)
    for r in comparison.results:
        if r.candidate.restoring != numbers.best.restoring:
            continue
        values = r.fit.values
        further = values[None, len(terms) : solver.law_places.start]
        works = [none if o is None else unit_works(o, solver, further, r.fit.active)[0] for o in orbits]
        work = values[: len(terms)] * np.array(works)
        arrays[f"law/{'+'.join(r.candidate.damping)}"] = work.sum(axis=1) / (4 * np.pi * energy)
        if r is best:
            arrays |= {f"work/{t}": work[:, i] for i, t in enumerate(terms) if t in r.candidate.damping}
    return arrays
