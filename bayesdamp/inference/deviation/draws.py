"""Compute the probabilities of candidates, draw from their posteriors, and summarise the draws.

A candidate is a sum of damping terms under a restoring law. The draws are summarised as

- equivalent damping ratios, from the energy that the damping dissipates on undamped orbits;
- frequencies;
- the fraction of the dissipated energy for each damping term;
- the sizes of the deviations from the laws of damping and restoring force.

`midline_drift` and `unexplained_and_noise` summarise the residual of a fit instead.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import accumulate
from typing import Self

import numpy as np

from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.model_comparison import CandidateResult, ModelComparison
from bayesdamp.numerics.weights import normalise
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.forces import Force, by_kernel, on_arrays, slope_of
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.orbit import Orbit, orbit_about
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import odds
from bayesdamp.types import Friction, Ratio

POWER_TIMES = 4000
"""Number of equidistant times in a motion at which `shares_of` computes the power that each damping term dissipates."""
TOTAL_DRAWS = 4000
"""Approximate number of draws that `draw_candidates` makes from all candidates together."""
COVERED_PROBABILITY = 0.99
"""`draw_candidates` draws from the most probable candidates: the smallest number whose total probability is larger than
this."""
MOST_DISTINCT_DRAWS = 200
"""Largest number of different draws of a candidate whose terms have parameters besides their coefficients (such as an
exponent), because the energy loss must be integrated for each; the draws are repeated to reach the requested number."""
DRIFT_SDS = 5.0
"""A drift of the midline is significant if it exceeds this many of its standard deviations. This gives one false alarm
in 400 records of `LEAST_CYCLE_MEANS` cycles, and far fewer with more cycles."""
LEAST_CYCLE_MEANS = 8
"""Least number of cycles (or of blocks of cycles) for which `midline_drift` fits a straight line to their mean
residuals; with fewer, it returns a drift of 0."""
_COSINES = np.cos((np.arange(16) + 0.5) / 16 * 2 * np.pi)
"""Displacements of a harmonic motion of amplitude 1 at 16 equidistant phases, for `balanced_frequency`."""


@dataclass(frozen=True)
class Quantity:
    """Median and 95 % interval (2.5 and 97.5 % quantiles) of a number, and two parts of its standard deviation.

    All are in the unit of this number. value: the median. low, high: the ends of the interval. sd_noise: the part of
    the standard deviation that noise alone would cause if the laws of damping and restoring force were exact. sd_law:
    the other part, √(variance − sd_noise²), which deviations from the laws cause. Both are nan if unknown.
    """

    value: float
    low: float
    high: float
    sd_noise: float = float("nan")
    sd_law: float = float("nan")


def quantity(values: np.ndarray, noise: float = float("nan")) -> Quantity:
    """Return median and 95 % interval of draws, (n,), with the two parts of their sd (see `Quantity`).

    noise: the sd that noise alone would cause, in the unit of the draws; if it is larger than their sd, the part due to
    noise is their sd. It is nan if it is unknown, and both parts are then nan (see `law_part`).
    """
    low, middle, high = (float(q) for q in np.quantile(values, (0.025, 0.5, 0.975)))
    noise = min(noise, float(np.std(values)))
    return Quantity(middle, low, high, noise, law_part(float(np.var(values)), noise))


def law_part(variance: float, noise: float) -> float:
    """Return the part of an sd that deviations from the laws cause: √(variance − noise²), or 0 if this is negligible.

    It is negligible below 1e-6 of the sd, where it may be due to rounding, or if `noise` is larger than the sd.
    variance: square of the whole sd. noise: the part that noise alone causes; if it is nan, the result is nan.
    """
    excess = variance - noise**2
    return 0.0 if excess <= 1e-12 * variance else float(np.sqrt(excess))


def with_parts_of_sd(summary: Mapping[str, float], noise: float) -> dict[str, float]:
    """Return a parameter's summary with two more keys, `sd_noise` and `sd_law`: two parts of its `sd`.

    `sd_noise` is `noise`, the sd that noise alone would cause if the laws were exact, but at most the sd. `sd_law` is
    the part that is caused by deviations of the motion from the damping and restoring laws (see `law_part`).
    """
    noise = min(noise, summary["sd"])
    return {**summary, "sd_noise": noise, "sd_law": law_part(summary["sd"] ** 2, noise)}


@dataclass(frozen=True)
class CandidateDraws:
    """Draws from the posterior of one candidate (a sum of damping terms under a restoring law).

    Attributes
    ----------
    result : CandidateResult
        Fit and posterior of the candidate.
    coefficients : ndarray, shape (n, m)
        Coefficients of the solver's m terms; 0 for terms that the candidate does not have.
    further : ndarray, shape (n, e)
        Own parameters of the terms, such as exponents, and fixed reference values in their forces, in the order of
        `Solver.further`.
    law : ndarray, shape (n, r)
        Parameters of the restoring law, in the order of `RestoringLaw.parameters`.
    g, h : ndarray, shape (n, k)
        Deviations from the laws at k knots, which are equidistant in time from the start to the end of the record. The
        damping force is multiplied by exp g, and the frequency by 1 + h.
    """

    result: CandidateResult
    coefficients: np.ndarray
    further: np.ndarray
    law: np.ndarray
    g: np.ndarray
    h: np.ndarray

    @classmethod
    def of(cls, result: CandidateResult, u: np.ndarray) -> Self:
        """Convert draws u, (n, K), from a candidate's posterior to parameters in their units and to deviations g and h.

        u contains the parameters, transformed so that their priors are standard normal (scores), then the deviations
        from the laws at knots in time: g (the damping force is multiplied by exp g) and h (the frequency is multiplied
        by 1 + h). It must contain g and h under exact laws too, where they are 0.
        """
        d, solver = result.fit.z.size, result.solver
        values, m, law = result.fit.parameters.values(u[:, :d]), len(solver.terms), solver.law_places
        g, h = np.split(u[:, d:], 2, axis=1)
        return cls(result, values[:, :m], values[:, m : law.start], values[:, law], g, h)

    @cached_property
    def _step_sds(self) -> np.ndarray:
        """Return the sd of the change of g (log of a factor on the damping) between neighbouring knots in time, (n,).

        There is one sd for each draw. Its square is half the mean square of the draw's second differences, which
        contain no linear trend.
        """
        return np.sqrt(np.mean(np.diff(self.g, 2, axis=1) ** 2, axis=1) / 2)

    def between_knots(self, fraction: float, rng: np.random.Generator) -> np.ndarray:
        """Draw the random difference between g and its linear interpolation at a fraction (0 to 1) of the record, (n,).

        g is the log of a factor on the damping, known at knots equidistant in time. Between two knots it is modelled as
        a Brownian bridge. At a fraction u of the way between them, the variance of the difference is u (1 − u) times
        that of the change of g between neighbouring knots (I. Karatzas and S. E. Shreve, Brownian Motion and Stochastic
        Calculus, 1991, 5.6.B). It is 0 at a knot.
        """
        u = fraction * (self.g.shape[1] - 1) % 1.0
        return np.sqrt(u * (1 - u)) * self._step_sds * rng.standard_normal(len(self.g))

    @cached_property
    def _distinct(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the r distinct rows of `further`, (r, e), and for each draw the index of its row, (n,)."""
        return np.unique(self.further, axis=0, return_inverse=True)

    def by_further(self, function: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Evaluate a function of the terms' own parameters for each draw, but only once for each distinct set.

        Own parameters are those that a term has besides its coefficient, such as an exponent. The function is called
        with the r distinct rows of `further`, (r, e), and returns values (r, m). Return the values for the n draws, (n,
        m), or (1, m) if all draws have the same own parameters.
        """
        rows, place = self._distinct
        values = function(rows)
        return values[place.ravel()] if len(rows) > 1 else values


def candidate_probabilities(
    comparison: ModelComparison, exact: bool, forms: bool = True
) -> dict[MotionCandidate, float]:
    """Return the posterior probability of each candidate, from evidences and prior odds (`priors.odds`); the sum is 1.

    A candidate is a sum of damping terms under a restoring law. If `exact` is true, the evidences are those without
    deviations g and h from the laws. Otherwise they are those with deviations, and only candidates that could be
    linearised with deviations are included; if there are none, the probabilities are those under exact laws.

    Parameters
    ----------
    comparison : ModelComparison
        The comparison.
    exact : bool
        Whether to assume that the laws are exact; if false, deviations from them are allowed.
    forms : bool
        Whether to include the rivals, which are sums with a form of damping that is not compared.
    """
    logs: dict[MotionCandidate, float] = {}
    for r in (*comparison.results, *(comparison.forms if forms else ())):
        if exact or r.approximate_posterior is not None:
            own = exact and r.approximate_posterior is not None
            log = r.exact_posterior.log_evidence if own else r.log_evidence
            logs[r.candidate] = log + np.log(odds(r.candidate.damping, r in comparison.forms))
    if not logs:  # no candidate could be linearised with deviations
        return candidate_probabilities(comparison, True, forms)
    return dict(zip(logs, normalise(np.array(list(logs.values()))).tolist(), strict=True))


def draw_candidates(
    comparison: ModelComparison, chosen: Mapping[MotionCandidate, float], rng: np.random.Generator
) -> list[CandidateDraws]:
    """Draw from the posteriors of the most probable candidates, with numbers in proportion to their probabilities.

    chosen: probability of each candidate. The most probable candidates with a total probability of
    `COVERED_PROBABILITY` share about `TOTAL_DRAWS` draws. All others are left out, and so is a candidate with a share
    of less than half a draw. The result contains the draws of each candidate that is not left out, the most probable
    candidate first.
    """
    order = sorted(chosen.items(), key=lambda item: -item[1])
    totals = list(accumulate(p for _, p in order))
    last = next((i for i, total in enumerate(totals) if total > COVERED_PROBABILITY), len(order) - 1)
    counts = {c: round(TOTAL_DRAWS * p / totals[last]) for c, p in order[: last + 1]}
    return [draw_candidate(comparison.result(c), count, rng) for c, count in counts.items() if count]


def draw_candidate(result: CandidateResult, count: int, rng: np.random.Generator) -> CandidateDraws:
    """Return `count` draws from the posterior of one candidate.

    They are chosen at random from `result.sampled`, for which the equation of motion was solved for each draw, if these
    exist and are trusted. Otherwise they are drawn from the posterior of the linear model about the mode. If one of the
    candidate's terms has an inferred parameter besides its coefficient, such as an exponent, at most
    `MOST_DISTINCT_DRAWS` of the draws are different. Without a `linearisation`, as under exact laws, the deviations g
    and h of the draws are 0.
    """
    d, parameters, solver = result.fit.z.size, result.fit.parameters, result.solver
    few = min(count, MOST_DISTINCT_DRAWS) if set(solver.inferred) & set(parameters.free_names) else count
    if result.sampled is None or result.sampled.doubt:
        u = result.posterior.draws(few, rng)[0]
    else:
        own = result.sampled.draws
        u = own[rng.choice(len(own), few, replace=few > len(own))]
    u = u[np.arange(count) * few // count]
    if result.linearisation is None:
        u = np.pad(u[:, :d], ((0, 0), (0, 2 * solver.knots.size)))
    return CandidateDraws.of(result, u)


def shares_of(comparison: ModelComparison, drawn: Sequence[CandidateDraws]) -> np.ndarray:
    """Return the fraction of the energy lost over the record that each term dissipates, for each draw, (draws, m).

    The m terms are `comparison.terms`. The draws of all candidates follow each other; rivals must not be among them,
    because their terms are different. For all draws of a candidate the energy is computed along the same motion, that
    at the mode of its posterior. The draws' deviations g and h from the laws have no effect. The fractions of a draw
    have the sum 1, or are all 0 if it loses no energy.
    """
    from bayesdamp.physics.kernel.dense import at_times  # imports the compiler

    shares = []
    for d in drawn:
        solver, motion = comparison.solvers[d.result.candidate.restoring], d.result.motion
        times = np.linspace(motion.times[0], motion.times[-1], POWER_TIMES)
        x, v = (at_times(motion.times, motion.states, times, order) for order in (0, 1))
        power = partial(solver.works, x, v, v / POWER_TIMES, active=d.result.fit.active)
        lost = d.coefficients * d.by_further(power)
        shares.append(lost / np.maximum(lost.sum(axis=1, keepdims=True), 1e-300))
    return np.concatenate(shares)


def noise_sds(comparison: ModelComparison, result: CandidateResult) -> dict[str, float]:
    """Return, by name, the sd of each inferred parameter (in its unit) that noise alone would cause under exact laws.

    It is computed from the posterior of the linear model without deviations, before coefficients are cut off at zero:
    the root mean variance of the components of this mixture. It is scaled to the variance of the noise in the
    comparison.
    """
    parameters = result.fit.parameters
    sds = result.exact_posterior.sds(np.diag(parameters.rates(result.fit.z)))
    sds *= np.sqrt(comparison.variance / result.exact_variance)
    return dict(zip(parameters.free_names, sds.tolist(), strict=True))


def restoring_of(restoring: str, law: np.ndarray) -> Force:
    """Return the restoring force per unit of inertia for n draws of a law's parameters, (n, r).

    The function maps positions in rad or m, (..., n), to forces of the same shape. restoring: name of the law.
    """
    kernel, parameters = on_arrays(LAWS.get(restoring).kernel), tuple(law.T)
    return lambda x: kernel(x, parameters)


def natural_frequency(force: Force, rest: np.ndarray, scale: float) -> np.ndarray:
    """Return the frequencies √F′ of small oscillations about the equilibria `rest`, (n,), in rad/s; 0 if F′ < 0.

    F′ is the derivative of the restoring force. force: as `restoring_of` returns it. scale: a typical displacement in
    rad or m; F′ is a difference quotient with the step 1e-5 `scale`. `rest` is in rad or m.
    """
    return np.sqrt(np.maximum(slope_of(force, rest, 1e-5 * scale), 0.0))


def balanced_frequency(force: Force, rest: np.ndarray, amplitude: float) -> np.ndarray:
    """Return the frequencies of oscillations with an amplitude in rad or m, (n,), in rad/s, by harmonic balance.

    They follow from the first harmonic of the restoring force on a sinusoid about the equilibria `rest`, (n,), and are
    0 if this harmonic drives away from the equilibrium. The method needs only 16 values of the force for each draw. It
    is not exact, but the change of its result with the parameters of the law is accurate enough for the spread between
    draws (N. M. Krylov and N. N. Bogoliubov, 1943). force: as `restoring_of` returns it.
    """
    pull = _COSINES @ force(rest + amplitude * _COSINES[:, None])
    return np.sqrt(np.maximum(2 * pull / (len(_COSINES) * amplitude), 0.0))


def time_fraction(result: CandidateResult, amplitude: float) -> float:
    """Return the time at which a candidate's motion reaches an amplitude (rad or m), as a fraction of the record.

    An amplitude outside the range of the motion's amplitudes gets the time of the nearest one. With fewer than two half
    cycles the result is 0.5.
    """
    at, sizes = result.motion.half_cycles
    if at.size < 2:
        return 0.5
    return float(np.clip(np.interp(-np.log(amplitude), -np.log(sizes), at) / result.data.end, 0.0, 1.0))


def orbits_of(result: CandidateResult, amplitudes: Sequence[float]) -> list[Orbit | None]:
    """Return the undamped orbits with amplitudes (rad or m) under a candidate's restoring law at its posterior mode.

    An amplitude is half the distance between the turning points. All orbits are None if there is no equilibrium near
    the record's midline. An orbit is None if it would escape over a potential barrier.
    """
    name, law = result.candidate.restoring, result.law
    rest = result.data.equilibrium(name, law)
    if rest is None:
        return [None] * len(amplitudes)
    orbits = orbit_about(by_kernel(LAWS.get(name).kernel, law), rest, np.array(amplitudes))
    each = (Orbit(*values) for values in zip(*vars(orbits).values(), strict=True))
    return [orbit if np.isfinite(orbit.energy) else None for orbit in each]


def unit_works(
    orbit: Orbit, solver: Solver, further: np.ndarray, active: np.ndarray, epsilon: float | None = None
) -> np.ndarray:
    """Return the energy that each term dissipates in a cycle of an orbit, per unit coefficient and inertia, (d, m).

    Multiplied by a coefficient it is in rad²/s² or m²/s². solver: solver with the m terms. further: d rows with the
    values of the terms' parameters besides their coefficients, such as exponents, and of the fixed reference values in
    their forces, (d, e), in the order of `Solver.further`. active: mask of the terms that act, (m,); the others get 0.
    epsilon: width of the velocity range in which dry friction changes its sign, in rad/s or m/s, by default that of the
    solver.
    """
    x, v = np.concatenate([orbit.x, orbit.x]), np.concatenate([orbit.velocity, -orbit.velocity])
    return solver.works(x, v, np.concatenate([orbit.weight, -orbit.weight]), further, active, epsilon)


def ratios_per_unit(d: CandidateDraws, orbit: Orbit | None) -> np.ndarray:
    """Return the equivalent damping ratio on an orbit per unit of each coefficient, for each draw, (n, m).

    The equivalent damping ratio is the energy lost in a cycle of the undamped orbit, divided by 4π times the orbit's
    energy. The result, multiplied by the coefficients and summed over the m terms, is this ratio without deviations
    from the laws. The orbit is the same for all draws. The result is (1, m) if all draws have the same own parameters
    (those besides the coefficients, such as an exponent). It is nan, (1, m), if there is no orbit. Terms that the
    candidate does not have get 0.
    """
    solver = d.result.solver
    if orbit is None:
        return np.full((1, len(solver.terms)), np.nan)
    works = d.by_further(lambda rows: unit_works(orbit, solver, rows, d.result.fit.active))
    return works / (4 * np.pi * orbit.energy)


def at_fraction(values: np.ndarray, fraction: float) -> np.ndarray:
    """Interpolate values at equidistant knots, (n, k), linearly at a fraction (0 to 1) of the record; return (n,)."""
    k = values.shape[1]
    at = fraction * (k - 1)
    i = min(int(at), k - 2)
    return (1 - at + i) * values[:, i] + (at - i) * values[:, i + 1]


def deviations_at(
    d: CandidateDraws, amplitude: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return the deviations g and h from the laws for a candidate's draws at an amplitude (rad or m), (n,) each.

    The damping force is multiplied by exp g, and the frequency by 1 + h. Both are interpolated between knots in time,
    at the time when the motion has this amplitude, or the nearest amplitude that it has (`time_fraction`). g also
    includes a random difference from the straight line between knots (`CandidateDraws.between_knots`).
    """
    share = time_fraction(d.result, amplitude)
    return at_fraction(d.g, share) + d.between_knots(share, rng), at_fraction(d.h, share)


def ratios_at(
    comparison: ModelComparison,
    drawn: Sequence[CandidateDraws],
    amplitudes: Sequence[float],
    sensor: float,
    rng: np.random.Generator,
) -> tuple[Ratio, ...]:
    """Return median, 95 % interval and parts of the sd (`Quantity`) of the equivalent damping ratio at each amplitude.

    The ratio is the energy lost in a cycle of the undamped orbit, divided by 4π times the orbit's energy. The draws of
    all candidates are joined. Deviations multiply the ratio of each draw by exp(g) / (1 + h). The uncertain width of
    dry friction is included (`_average_over_frictions`). The sd that noise alone would cause is averaged over the
    draws. Candidates without an orbit of an amplitude are left out there; if all are, all numbers but the amplitude are
    nan.

    Parameters
    ----------
    comparison : ModelComparison
        The comparison of the candidates.
    drawn : sequence of CandidateDraws
        Draws of each candidate.
    amplitudes : sequence of float
        Amplitudes in rad or m.
    sensor : float
        Relative sd of the sensor's linearity and clock: each ratio is multiplied by a random factor with mean 1 and
        this sd; 0 for none.
    rng : numpy.random.Generator
        Random stream.
    """
    parts = []
    for d in drawn:
        orbits = orbits_of(d.result, amplitudes)
        per_unit = [ratios_per_unit(d, orbit) for orbit in orbits]
        parts.append((d, orbits, per_unit, _noise_of_ratios(comparison, d.result, per_unit)))
    summaries = []
    for i, amplitude in enumerate(amplitudes):
        values, noises = [], []
        for d, orbits, per_unit, noise in parts:
            orbit = orbits[i]
            if orbit is not None:
                ratios = _average_over_frictions(comparison, d, orbit, per_unit[i], rng)
                g, h = deviations_at(d, amplitude, rng)
                values.append(ratios * np.exp(g) / (1 + h))
                noises.append(noise[i])
        if not values:
            summaries.append(Ratio(amplitude, *(float("nan"),) * 5))
            continue
        ratios = np.concatenate(values)
        ratios = ratios * (1 + sensor * rng.standard_normal(ratios.size))
        noise = float(np.average(noises, weights=list(map(len, values))))
        q = quantity(ratios, noise)
        summaries.append(Ratio(amplitude, q.value, q.low, q.high, q.sd_noise, q.sd_law))
    return tuple(summaries)


def _noise_of_ratios(
    comparison: ModelComparison, result: CandidateResult, per_unit: Sequence[np.ndarray]
) -> np.ndarray:
    """Return the sd that noise alone would cause in a candidate's damping ratio at each of a amplitudes, (a,).

    It follows from the covariance of the coefficients in the posterior under exact laws; errors of other parameters,
    such as exponents, are not included. It is nan where there is no orbit. per_unit: results of `ratios_per_unit` at
    the amplitudes.
    """
    parameters = result.fit.parameters
    slopes = np.zeros((len(per_unit), len(parameters.names)))
    slopes[:, : len(result.solver.terms)] = [each.mean(axis=0) for each in per_unit]
    gradients = slopes[:, parameters.free] * parameters.rates(result.fit.z)
    return result.exact_posterior.sds(gradients) * np.sqrt(comparison.variance / result.exact_variance)


def _average_over_frictions(
    comparison: ModelComparison,
    d: CandidateDraws,
    orbit: Orbit,
    per_unit: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return the damping ratio of each draw, (n,), with the width ε of dry friction drawn from its posterior.

    ε is the width of the velocity range in which friction changes its sign. For each draw, one of the fits in
    `ModelComparison.frictions`, which have different ε, is chosen at random with its posterior probability. The draw's
    ratio at the solver's ε is multiplied by a quotient: the energy that all terms of the chosen fit lose in a cycle,
    divided by that of the fit whose ε is nearest to the solver's. The ratios do not change if no term of the candidate
    depends on ε (`DampingTerm.switches`), if there are no such fits (ε is known, for example), if the candidate is a
    rival, whose energy loss depends on ε in another way, or if the fit with the nearest ε loses no energy. per_unit:
    result of `ratios_per_unit` on this orbit.
    """
    ratios = np.sum(d.coefficients * per_unit, axis=1)
    solver, active, frictions = d.result.solver, d.result.fit.active, comparison.frictions
    switching = any(TERMS.get(t).switches and on for t, on in zip(solver.terms, active, strict=True))
    is_rival = any(r.candidate == d.result.candidate for r in comparison.forms)
    if not switching or not frictions or is_rival:
        return ratios
    whole = comparison.solvers[d.result.candidate.restoring]

    def lost_by(f: Friction) -> float:
        # Compare the loss of all terms together: its split among terms that the record cannot distinguish is arbitrary.
        coefficients = np.array(f.coefficients)
        works = unit_works(orbit, whole, np.array([f.further]), coefficients != 0, f.epsilon)[0]
        return float(works @ coefficients)

    usual = lost_by(min(frictions, key=lambda f: abs(f.epsilon - solver.epsilon)))
    if not usual > 0:
        return ratios
    chosen = rng.choice(len(frictions), len(ratios), p=[f.weight for f in frictions])
    used, place = np.unique(chosen, return_inverse=True)
    return ratios * np.array([lost_by(frictions[i]) / usual for i in used])[place]


def mean_deviation(result: CandidateResult, values: np.ndarray) -> np.ndarray:
    """Return for each draw the mean over the record of |deviation − mean deviation|, (n,).

    Both means are over time, weighted by the energy of the oscillation. result: the fit of a candidate; the squared
    amplitudes of its motion are the weights (all are equal if the motion has fewer than two half cycles). values:
    deviations from the law at k equidistant times from the start to the end of the record, (n, k), either g (log of a
    factor on the damping) or h (relative change of the frequency).
    """
    weight = _energies(result, values.shape[1])
    return np.abs(values - (values @ weight)[:, None]) @ weight


def ratio_over_law(
    drawn: Sequence[CandidateDraws], amplitudes: Sequence[float], rng: np.random.Generator
) -> tuple[Quantity, ...]:
    """Return median and 95 % interval of the damping divided by the damping of its law, at each amplitude (rad or m).

    The quotient is exp(g − mean of g), where g is the log of a factor on the damping; its mean over the record is
    weighted by the energy. The draws of all candidates are joined. For an amplitude outside the range of a motion, g is
    that at the nearest amplitude. The two parts of the sd (see `Quantity`) are nan.
    """
    means = [d.g @ _energies(d.result, d.g.shape[1]) for d in drawn]
    factors = []
    for a in amplitudes:
        logs = [deviations_at(d, a, rng)[0] - mean for d, mean in zip(drawn, means, strict=True)]
        factors.append(quantity(np.concatenate([np.exp(log) for log in logs])))
    return tuple(factors)


def log_ratio_over_law(
    drawn: Sequence[CandidateDraws], amplitudes: Sequence[float], rng: np.random.Generator
) -> tuple[tuple[float, float], ...]:
    """Return mean and sd of log(damping ratio / damping ratio without deviations), for each amplitude (rad or m).

    This natural logarithm is g − log(1 + h): deviations multiply the damping force by exp g and the frequency by 1 + h.
    No mean over the record is subtracted from g (unlike `ratio_over_law`). The draws of all candidates are joined.
    """
    pairs = []
    for a in amplitudes:
        deviations = [deviations_at(d, a, rng) for d in drawn]
        values = np.concatenate([g - np.log1p(h) for g, h in deviations])
        pairs.append((float(values.mean()), float(values.std())))
    return tuple(pairs)


def _energies(result: CandidateResult, knots: int) -> np.ndarray:
    """Return weights in proportion to the energy at k equidistant times of the record, with the sum 1, (k,).

    They are squared amplitudes of the candidate's motion, divided by their sum. They are all equal if the motion has
    fewer than two half cycles.
    """
    at, sizes = result.motion.half_cycles
    times = np.linspace(0, 1, knots) * result.data.end
    weight = np.ones(knots) if at.size < 2 else np.interp(times, at, sizes) ** 2
    return weight / weight.sum()


def midline_drift(result: CandidateResult) -> float:
    """Return the drift of the midline over the record, as a fraction of the first amplitude; 0 if insignificant.

    It is positive if the record rises relative to the motion. The amplitude is that of the recorded quantity. The
    residuals of the fit under exact laws are averaged over each cycle that has samples (or each block of an averaged
    record), and a straight line is fitted to these means. Their scatter about the line gives the sd of its slope. The
    drift is significant if it exceeds `DRIFT_SDS` sds and there are at least `LEAST_CYCLE_MEANS` means.
    """
    data, left, scale = result.data, result.fit.residual, result.data.recorded_amplitude
    if data.averaged is None:
        count = max(int(data.cycles), 1)
        parts = np.minimum((data.t / data.end * count).astype(int), count - 1)
        sizes = np.bincount(parts, minlength=count)
        cycles = np.flatnonzero(sizes)
        means = np.bincount(parts, left)[cycles] / sizes[cycles]
    else:
        means = data.averaged.track.separate(left)[2]
        count, cycles = means.size, np.arange(means.size)
    if means.size < LEAST_CYCLE_MEANS:
        return 0.0
    (drift, _), covariance = np.polyfit((cycles + 0.5) / count, means, 1, cov=True)
    return float(drift) / scale if abs(drift) > DRIFT_SDS * np.sqrt(covariance[0, 0]) else 0.0


def unexplained_and_noise(result: CandidateResult) -> tuple[float, float]:
    """Return the rms of the residual that neither the laws nor noise explain, and the sd of a sample's noise.

    Both are fractions of the first amplitude of the recorded quantity. The noise is the residual of the fit with
    deviations g (of the damping) and h (of the frequency) from the laws. The first number is computed from the residual
    of the fit under exact laws: the root of its mean square minus the variance of the noise. If there is no fit with
    deviations, the whole residual counts as noise. For a record that is reduced to amplitudes and phases, the first
    number uses only the amplitudes.
    """
    linearisation = result.linearisation
    left = result.fit.residual if linearisation is None else linearisation.left
    # Use only amplitudes of an averaged record: a phase that drifts over thousands of cycles is a tiny frequency error.
    residual = result.data.of_amplitude(result.fit.residual)
    clean = float(left @ left) / max(left.size - (0 if linearisation is None else linearisation.u.size), 1)
    rest = max(float(residual @ residual) / residual.size - clean, 0.0)
    amplitude, each = result.data.recorded_amplitude, result.data.thinned
    return float(np.sqrt(rest)) / amplitude, float(np.sqrt(clean * each)) / amplitude
