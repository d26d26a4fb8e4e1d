"""Sums of damping terms for an envelope: which ones it can distinguish, their decay laws, evidence and probabilities.

Some terms have inferred parameters besides their coefficient, such as an exponent. Their posterior is represented by
points from adaptive multiple importance sampling: each round of points is from a normal distribution fitted to all
earlier points, and all points are weighted against the mixture of these distributions (J.-M. Cornuet, J.-M. Marin, A.
Mira and C. P. Robert, Scand. J. Stat. 39, 798 (2012)). The points come from a low-discrepancy sequence instead of
random numbers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np
from scipy.optimize import nnls
from scipy.special import ndtri

from bayesdamp.inference.deviation.draws import Quantity
from bayesdamp.inference.deviation.least_squares import LeastSquaresFit
from bayesdamp.inference.deviation.linear import MEAN_G, PROBABILITY_EXACT
from bayesdamp.inference.envelope.candidates import (
    Blocks,
    EnvelopeCandidate,
    fit_candidate,
    fit_rates,
    power_law_evidence,
)
from bayesdamp.inference.envelope.posterior import DRIFT, SENSOR
from bayesdamp.numerics.weights import effective_size, normalise
from bayesdamp.physics.amplitude import (
    FORMS,
    POWERS,
    SUMS,
    DecayLaw,
    Scale,
    Shape,
    are_proportional,
    log_loss,
)
from bayesdamp.physics.damping import TERMS, DampingTerm
from bayesdamp.priors import FURTHER_TERM, SHARED_SCALES, odds
from bayesdamp.records.envelope.window import ABOVE_FLOOR
from bayesdamp.types import InputError

HOPELESS_NATS = 25.0
"""The evidence of every sum of damping terms is computed first with only one of the possible noises. If the log
evidence is then more than this many nats below that of the best sum, the other noises are not tried for this sum,
because they change it by a few nats only."""
POSTERIOR_POINTS = 24
"""Number of points that represent the posterior of the parameters that a sum's terms have besides their
coefficients."""
FIRST_ROUNDS = 6
"""Number of rounds of importance sampling in the search for the best fit of a sum whose terms have parameters besides
their coefficients."""
LEAST_RELATIVE_RATE = 0.01
"""In fits and priors a term's coefficient is expressed by the decay rate that it causes at the reference amplitude. If
that rate is below `LEAST_RELATIVE_RATE` times the term's largest rate along the decay, this multiple of the largest
rate is used instead."""
STEEPEST_POWER = 3.0
"""Exponent p of the steepest decay dA/dt ∝ -A^p that a damping term of the package causes; it is that of cubic
damping."""
TABLE_MARGIN = 3.0
"""Decay laws are integrated numerically over ln A (A is the amplitude). The steps are small in the range of the
readings and, at both its ends, over a further difference of ln A of this size."""
POINTS_PER_ROUND = 16
"""Number of points that are added in each round of importance sampling of the parameters that terms have besides their
coefficients."""
MOST_ROUNDS = 12
"""Greatest number of rounds of importance sampling of the parameters that terms have besides their coefficients. A
posterior that is a thousand times narrower than the prior needs eight."""
ENOUGH_EFFECTIVE = 32.0
"""Importance sampling of the parameters that terms have besides their coefficients ends when the effective number of
points reaches this."""
VARIANCE_FACTOR = 1.5
"""In each round of importance sampling the points are drawn from a normal distribution. Its covariance is that of the
weighted points of earlier rounds times this factor, so that it is wider than the posterior."""
FLATTENING_STEP = 0.8
"""Between rounds of importance sampling a normal distribution is fitted to the weighted points. Before this, their
weights are raised to a power: starting from 1, the power is multiplied by this factor until the effective number of
points suffices for the fit."""
LARGEST_SCORE = 5.0
"""Largest absolute value of the coordinates of points in importance sampling; points beyond are moved to it. The
coordinates are parameters as standard normal scores."""
MOST_TERMS = 3
"""Greatest number of terms in a sum of damping terms for an envelope; a decay cannot distinguish more, and a larger sum
is refused."""
ASSUMPTIONS = (
    "Each term's equivalent damping ratio at the amplitude in the middle of the fall in dB has a half-normal prior. "
    "Its scale is unknown and the same for all terms of a sum: all orders of magnitude between "
    f"{SHARED_SCALES[0]:g} and {SHARED_SCALES[-1]:g} are equally probable. Where the frequency is not known, the "
    "rates have the same prior, with the geometric middle of its scales at 1/duration of the decay.",
    f"Prior odds of a sum: 1 for a single term, times {FURTHER_TERM:g} for each further term. The sums cubic and "
    f"viscous + cubic, which are compared by default, have {odds(FORMS[0], True, len(FORMS)):g} times these odds.",
    f"The law holds exactly with probability {PROBABILITY_EXACT:g}. Otherwise its rate is multiplied by 1 + g, where g "
    f"varies randomly with time, with the sd τ. The prior of τ is exponential with the mean {MEAN_G:g}.",
    f"Every rate is known to {100 * SENSOR:g} % (sd) at best (detector, clock). Readings in dB may also contain "
    f"{DRIFT:g} dB of drift or nonlinearity of the detector over half of the decay.",
    f"Readings down to {ABOVE_FLOOR:g} dB above the noise floor are used. The quoted Q and rate are those of the law, "
    "averaged over the first half of the fall in dB; the values at three amplitudes include the deviation.",
)
COMPARED_AMPLITUDES = 65
"""Number of amplitudes, evenly spaced in their logarithm, at which two decay laws are compared."""
SAME_LAW_RMS = 1e-4
"""Two decay laws count as equal if the root mean square of the relative difference of their rates is at most this."""
EXCLUDED_NATS = 7.0
"""Two sums are reported as indistinguishable only if the log posterior probability of the less probable one is at most
this many nats below that of the most probable sum."""
Sums = tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Sum:
    """A sum of damping terms, prepared for one envelope.

    Attributes
    ----------
    terms
        Names of the damping terms.
    start, low
        ln(A/A_ref) at the start of the decay and at its lowest reading; A_ref is the reference amplitude.
    scale
        Amplitude at the start and angular frequency, on which the priors of the terms' parameters depend.
    other
        Whether the sum is another form of damping (see `is_other_form`), with smaller prior odds.
    """

    terms: tuple[str, ...]
    start: float = 0.0
    low: float = 0.0
    scale: Scale = field(default_factory=Scale)
    other: bool = False

    @cached_property
    def each(self) -> tuple[DampingTerm, ...]:
        """The damping terms of the sum as objects, in the order of `terms`."""
        return tuple(map(TERMS.get, self.terms))

    @property
    def name(self) -> str:
        """Name of the sum: its terms, joined by +, such as `viscous+coulomb`."""
        return "+".join(self.terms)

    @property
    def log_prior(self) -> float:
        """Log of the prior odds of this sum against viscous damping, in nats; not above 0."""
        return float(np.log(odds(self.terms, self.other, len(FORMS))))

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of inferred parameters of each term besides its coefficient."""
        return tuple(len(term.inferred) for term in self.each)

    @property
    def count(self) -> int:
        """Number of inferred parameters of all terms together, without the coefficients."""
        return sum(self.counts)

    def scores_of(self, scores: Sequence[float], term: int) -> tuple[float, ...]:
        """Return the scores that belong to the parameters of term number `term` (from 0), without the coefficient.

        scores: standard normal scores of the parameters of all terms in sequence.
        """
        first = sum(self.counts[:term])
        return tuple(float(z) for z in scores[first : first + self.counts[term]])

    def law(self, scores: Sequence[float] = ()) -> DecayLaw:
        """Return the decay law of the sum for given values of its terms' parameters other than the coefficients.

        scores: these parameters as standard normal scores, of all terms in sequence; () if there are none.

        The law gives each term a shape s, a function of x = ln(A/A_ref) that is 1 at the reference amplitude A_ref (x =
        0). A term other than viscous, Coulomb and quadratic damping can have a rate at A_ref below
        `LEAST_RELATIVE_RATE` of its largest rate along the decay. Its shape is then relative to this fraction of the
        largest rate, so that s(0) < 1.
        """

        def shape(term: int) -> Shape:
            if self.terms[term] in POWERS:
                return _power(POWERS[self.terms[term]])
            own = self.scores_of(scores, term)
            loss, unit = log_loss(self.each[term], own, self.scale), self.unit_rate(term, own)
            return lambda x: np.exp(loss(x - self.start) - unit)

        shapes = tuple(map(shape, range(len(self.terms))))
        return DecayLaw(self.terms, shapes, self.low - TABLE_MARGIN, self.start + TABLE_MARGIN)

    def unit_rate(self, term: int, scores: tuple[float, ...], scale: Scale | None = None) -> float:
        """Return ln of the decay rate (1/s) that a term with a coefficient of 1 causes at the reference amplitude.

        If this rate is below `LEAST_RELATIVE_RATE` times the largest rate along the decay, the result is ln of this
        multiple of the largest rate. term: index of the term in the sum. scores: standard normal scores of the term's
        other parameters. scale: amplitude at the start and angular frequency; by default those of the sum.
        """
        loss = log_loss(self.each[term], scores, scale or self.scale)
        along = loss(np.append(np.linspace(self.low, self.start, 33), 0.0) - self.start)
        return float(max(along[-1], along.max() + np.log(LEAST_RELATIVE_RATE)))


def is_other_form(terms: tuple[str, ...], sums: Sequence[tuple[str, ...]]) -> bool:
    """Return whether a sum is one of `FORMS` and is compared with all seven sums of the usual dampings (`SUMS`).

    Its prior odds are then a share of those of other forms (`priors.odds`). sums: all sums that are compared.
    """
    return terms in FORMS and set(SUMS) <= set(sums)


def further_terms(sums: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """Return the names of terms in sums other than viscous, Coulomb and quadratic damping, in order of first use."""
    return tuple(dict.fromkeys(t for terms in sums for t in terms if t not in POWERS))


def list_assumptions(sums: Sequence[tuple[str, ...]], left_out: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the assumptions behind an answer from these sums as sentences for a report.

    Parameters
    ----------
    sums : sequence of tuple of str
        Names of the terms of each sum. A sentence lists the sums unless they are those compared by default.
    left_out : sequence of str
        Sentences that say which sums are left out and why; they are included in the result.
    """
    by_default = tuple(sums) == (*SUMS, *FORMS)
    compared = () if by_default else (f"Damping sums compared: {', '.join(map('+'.join, sums))}.",)
    inferred = [p for name in further_terms(sums) for p in TERMS.get(name).inferred]
    each = ", ".join(f"{p.name} {p.prior(1.0, 1.0).describe()}" for p in inferred)
    further = (
        "Further parameters of terms have the terms' own priors, here in units of the amplitude at the start and the "
        f"angular frequency: {each}.",
    )
    return (*compared, *left_out, *(further if inferred else ()), *ASSUMPTIONS)


def distinguishable_sums(sums: Sequence[tuple[str, ...]]) -> tuple[Sums, tuple[str, ...]]:
    """Return the sums that an envelope can distinguish, and for each sum that is left out a sentence why.

    Two terms cannot be distinguished if the energies that they dissipate in a cycle are proportional to each other at
    all amplitudes. A sum that contains two such terms is left out. Of sums that differ only by such terms, or by the
    order of terms, the first is kept. The sums keep their order. For all seven sums of viscous, Coulomb and quadratic
    damping, `SUMS` and then `FORMS` are returned.

    Raises
    ------
    InputError
        If a sum has more than `MOST_TERMS` terms, if there is no term with a given name, if a term dissipates no
        energy, or if no sum is left.
    """
    if set(sums) == set(SUMS):
        return (*SUMS, *FORMS), ()

    for asked in sums:
        if len(asked) > MOST_TERMS:
            raise InputError(
                f"damping {'+'.join(asked)}: a sum for an envelope has at most {MOST_TERMS} terms; leave one out"
            )
    terms = list(dict.fromkeys([*POWERS, *(t for asked in sums for t in asked)]))
    for name in terms:
        if not TERMS.get(name).inferred:
            log_loss(TERMS.get(name))
    first = {
        t: next(u for u in terms if u == t or are_proportional(TERMS.get(u), TERMS.get(t))) for t in terms
    }
    distinguished: dict[frozenset[str], tuple[str, ...]] = {}
    left_out = []
    for asked in dict.fromkeys(sums):
        distinct, name = frozenset(first[t] for t in asked), "+".join(asked)
        if len(distinct) < len(asked):
            twins = " and ".join(t for t in asked if sum(first[u] == first[t] for u in asked) > 1)
            left_out.append(f"{name} is left out: {twins} dissipate the same energy at every amplitude.")
        elif distinct in distinguished:
            same = "+".join(distinguished[distinct])
            left_out.append(
                f"{name} is left out: it dissipates the same energy as {same} at every amplitude."
            )
        else:
            distinguished[distinct] = asked
    if not distinguished:
        raise InputError(f"damping: no sum is left to compare. {left_out[0]} Name other sums")
    return tuple(distinguished.values()), tuple(left_out)


def loosest_fit(b: Blocks, sums: Sequence[Sum], inverse: np.ndarray) -> tuple[DecayLaw, float, np.ndarray]:
    """Return a decay law that fits at least as well as any of the sums, with its fitted start and rates.

    The fit with the smallest sum of squares is chosen among these: viscous, Coulomb and quadratic damping together; the
    decay dA/dt ∝ −A³; and each sum that contains a term other than those three. Those of the three terms that its law
    lacks are added with rates of 0.

    inverse: matrix that whitens the noise, (n, n). Returns the law, ln(A/A_ref) at the start, and the rates c_i of its
    terms in 1/s (see `DecayLaw`). The noise is inferred from its residuals (`decay.infer_noises`).
    """
    every = Sum(SUMS[-1], b.ends[0], float(b.x.min())).law()
    steep = replace(every, terms=("steep",), each=(_power(STEEPEST_POWER),))
    fits = [(law, fit_rates(b, law, inverse)) for law in (every, steep)]
    fits += [_fit_sum(b, s, inverse) for s in sums if further_terms([s.terms])]
    law, fit = min(fits, key=lambda pair: pair[1].squares)
    more = tuple(term for term in SUMS[-1] if term not in law.terms)
    shapes = tuple(_power(POWERS[term]) for term in more)
    law = replace(law, terms=law.terms + more, each=law.each + shapes)
    return law, float(fit.values[-1]), np.append(fit.values[:-1], np.zeros(len(more)))


def _fit_sum(b: Blocks, s: Sum, inverse: np.ndarray) -> tuple[DecayLaw, LeastSquaresFit]:
    """Fit a sum of damping terms; return its decay law and the fit of its rates.

    inverse: matrix that whitens the noise, (n, n). If terms have parameters besides their coefficients, they are fitted
    too: `importance_points` chooses values of them, and the fit with the smallest sum of squares is returned.
    """

    @cache
    def at(scores: tuple[float, ...]) -> tuple[DecayLaw, LeastSquaresFit]:
        law = s.law(scores)
        return law, fit_rates(b, law, inverse)

    if not s.count:
        return at(())
    explored = importance_points(lambda z: -0.5 * at(z)[1].squares, s.count, FIRST_ROUNDS)
    return min((at(tuple(z)) for z in explored.points.tolist()), key=lambda pair: pair[1].squares)


def _power(power: float) -> Shape:
    """Return the shape of the decay dA/dt ∝ −A^power, the function x ↦ e^((power − 1) x) of x = ln(A/A_ref).

    The shape is the decay rate at x, relative to the rate at the reference amplitude A_ref.
    """
    return lambda x: np.exp((power - 1.0) * x)


def compare_sums(b: Blocks, sums: Sequence[Sum]) -> list[EnvelopeCandidate]:
    """Compute the evidence of every sum with the first of the possible noises, and of the better sums with all of them.

    If a sum is more than `HOPELESS_NATS` below the best one with the first noise, the other noises are not tried for
    it. A sum whose terms have parameters besides their coefficients gives several candidates, each with other values of
    these parameters. The values are points that represent their posterior.

    Parameters
    ----------
    b : Blocks
        The readings with their possible noises.
    sums : sequence of Sum
        The sums.

    Returns
    -------
    list of EnvelopeCandidate
        The candidates of all sums, in the order of the sums.
    """
    roughly = replace(b, noises=b.noises[:1])
    first = [
        importance_points(lambda z, s=s: fit_candidate(roughly, s.law(z)).total, s.count)
        if s.count
        else fit_candidate(roughly, s.law())
        for s in sums
    ]
    totals = [known.log_integral if isinstance(known, WeightedPoints) else known.total for known in first]
    most = max(totals)
    candidates = []
    for s, known, total in zip(sums, first, totals, strict=True):
        tried = b if total > most - HOPELESS_NATS else roughly
        if isinstance(known, EnvelopeCandidate):
            candidates.append(fit_candidate(tried, known.law, known, log_share=s.log_prior))
            continue
        points, times = np.unique(known.resample(POSTERIOR_POINTS), axis=0, return_counts=True)
        for scores, count in zip(map(tuple, points.tolist()), times, strict=True):
            law = s.law(scores)
            alone = fit_candidate(roughly, law)
            # Each point represents a fraction of the evidence of its sum. With the other noises, this fraction changes
            # by the same factor as the evidence at the point.
            log_fraction = total - alone.total + np.log(count / POSTERIOR_POINTS) + s.log_prior
            candidates.append(fit_candidate(tried, law, alone, scores, float(log_fraction)))
    return candidates


@dataclass(frozen=True)
class WeightedPoints:
    """Points with weights that represent a density, which need not be normalised.

    points: coordinates of n points, (n, e). log_weight: log weights, (n,), such that the sum of the weights estimates
    the integral of the density.
    """

    points: np.ndarray
    log_weight: np.ndarray

    @property
    def log_integral(self) -> float:
        """Log of the integral of the density, in nats."""
        return float(np.logaddexp.reduce(self.log_weight))

    def resample(self, count: int) -> np.ndarray:
        """Choose `count` of the points, (count, e), with repetition; with equal weights they represent the density.

        They are the points at equidistant quantiles of the density along the direction in which it is widest.
        """
        weight = normalise(self.log_weight)
        off = self.points - weight @ self.points
        widest = np.linalg.eigh((off.T * weight) @ off)[1][:, -1]
        order = np.argsort(self.points @ widest)
        cumulative = np.cumsum(normalise(self.log_weight[order]))
        at = np.searchsorted(cumulative, (np.arange(count) + 0.5) / count)
        return self.points[order][np.minimum(at, len(order) - 1)]


def importance_points(
    log_likelihood: Callable[[tuple[float, ...]], float], count: int, rounds: int = MOST_ROUNDS
) -> WeightedPoints:
    """Represent the posterior density of standard normal scores (N(0, 1) prior times likelihood) by weighted points.

    Parameters
    ----------
    log_likelihood : callable
        Function that returns the log likelihood in nats for a tuple of scores.
    count : int
        Number of scores.
    rounds : int
        Greatest number of rounds of sampling; sampling ends earlier if the effective number of points reaches
        `ENOUGH_EFFECTIVE`.

    Returns
    -------
    WeightedPoints
        The points of all rounds.
    """
    # An additive recurrence is a low-discrepancy sequence in the unit cube. Its steps are powers of 1/x, where
    # x^(count + 1) = x + 1 (M. Roberts 2018; the golden ratio for one score).
    root = 2.0
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (count + 1))
    steps = root ** -np.arange(1.0, count + 1)
    prior = (np.zeros(count), np.eye(count))
    proposals: list[tuple[np.ndarray, np.ndarray]] = [prior]
    points, logs = np.empty((0, count)), np.empty(0)
    while True:
        mean, cholesky = proposals[-1]
        numbers = np.arange(len(points) + 1, len(points) + POINTS_PER_ROUND + 1)[:, None]
        uniform_points = (0.5 + numbers * steps) % 1.0
        drawn = np.clip(ndtri(uniform_points) @ cholesky.T + mean, -LARGEST_SCORE, LARGEST_SCORE)
        points = np.vstack([points, drawn])
        logs = np.append(logs, [log_likelihood(tuple(z)) for z in drawn.tolist()])
        mixture = np.logaddexp.reduce([_log_normal(points, *proposal) for proposal in proposals], axis=0)
        log_weight = logs + _log_normal(points, *prior) - mixture - np.log(POINTS_PER_ROUND)
        if effective_size(log_weight) >= ENOUGH_EFFECTIVE or len(proposals) >= rounds:
            return WeightedPoints(points, log_weight)
        # The next normal distribution is fitted to the points, with weights flattened until enough points have weight.
        flattening = 1.0
        while effective_size(flattening * log_weight) < 2.0 + 2.0 * count:
            flattening *= FLATTENING_STEP
        weight = normalise(flattening * log_weight)
        mean = weight @ points
        off = points - mean
        covariance = VARIANCE_FACTOR * (off.T * weight) @ off
        # A small diagonal keeps the covariance positive definite if the points lie in a plane or nearly coincide.
        covariance += 1e-10 * np.eye(count) + 1e-4 * np.diag(np.diag(covariance))
        proposals.append((mean, np.linalg.cholesky(covariance)))


def _log_normal(points: np.ndarray, mean: np.ndarray, cholesky: np.ndarray) -> np.ndarray:
    """Return the log density, (n,), of a normal distribution at points, (n, d).

    mean: (d,). cholesky: lower Cholesky factor of its covariance, (d, d).
    """
    z = np.linalg.solve(cholesky, (points - mean).T)
    log_det = np.log(np.diag(cholesky)).sum()
    return -0.5 * np.sum(z * z, axis=0) - log_det - 0.5 * mean.size * np.log(2 * np.pi)


@dataclass(frozen=True, eq=False)
class Ranking:
    """Sums of damping terms compared on an envelope: their candidates and evidence.

    Attributes
    ----------
    sums, candidates
        The sums, and the candidates of all sums.
    log_evidence
        Log evidence plus log prior odds of each sum in nats, with the deviation from the law integrated out, (sums,).
    log_exact
        Log of the part of this evidence that is from the exact law (no deviation), including its prior probability,
        (sums,).
    """

    sums: tuple[Sum, ...]
    candidates: tuple[EnvelopeCandidate, ...]
    log_evidence: np.ndarray
    log_exact: np.ndarray

    @property
    def probability(self) -> np.ndarray:
        """Posterior probability of each sum, (sums,), in the order of `sums`; they add up to 1."""
        return normalise(self.log_evidence)

    @property
    def best(self) -> Sum:
        """The most probable sum of damping terms."""
        return self.sums[int(np.argmax(self.log_evidence))]

    @property
    def best_exact(self) -> Sum:
        """The most probable sum of damping terms if their laws are assumed to be exact (no deviation)."""
        return self.sums[int(np.argmax(self.log_exact))]

    @property
    def fitted(self) -> EnvelopeCandidate:
        """The most probable candidate of the most probable sum.

        A sum has several candidates if a term has a parameter such as an exponent: one for each of several values.
        """
        of_best = (c for c in self.candidates if c.name == self.best.name)
        return max(of_best, key=lambda c: c.total + c.log_share)

    @property
    def exact(self) -> float:
        """Posterior probability that the damping law is exact (no deviation), averaged over all sums."""
        return float(np.exp(np.logaddexp.reduce(self.log_exact) - np.logaddexp.reduce(self.log_evidence)))

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of all terms in the sums, starting with those of viscous, Coulomb and quadratic damping that occur."""
        terms = dict.fromkeys(term for s in self.sums for term in s.terms)
        return tuple(sorted(terms, key=lambda term: (*POWERS, *terms).index(term)))

    @property
    def by_sum(self) -> dict[str, float]:
        """Posterior probability of each sum, by its name (terms joined by +)."""
        return {s.name: float(p) for s, p in zip(self.sums, self.probability, strict=True)}

    @property
    def by_term(self) -> dict[str, float]:
        """Posterior probability that a term is present (total of all sums that contain it), by name of the term."""
        each = list(zip(self.sums, self.probability, strict=True))
        return {term: float(sum(p for s, p in each if term in s.terms)) for term in self.terms}


def rank_sums(sums: Sequence[Sum], candidates: Sequence[EnvelopeCandidate]) -> Ranking:
    """Compute the evidence of each sum of damping terms from its candidates, and return the ranking of the sums.

    The evidence of a sum is the total of its candidates, including the prior odds in their `log_share`. The sums keep
    their order. Candidates belong to the sum with their name; each sum must have at least one candidate.
    """

    def by_sum(logs: Sequence[float]) -> np.ndarray:
        """Return the log of the total evidence of the candidates of each sum of damping terms, (sums,).

        logs: log evidence of each candidate, in nats.
        """
        each_sum = [[z for z, c in zip(logs, candidates, strict=True) if c.name == s.name] for s in sums]
        return np.array([np.logaddexp.reduce(each) for each in each_sum])

    log_evidence = by_sum([c.total + c.log_share for c in candidates])
    log_exact = by_sum([c.total_exact + c.log_share for c in candidates])
    return Ranking(tuple(sums), tuple(candidates), log_evidence, log_exact)


def indistinguishable(ranking: Ranking) -> tuple[tuple[str, str], ...]:
    """Return pairs of sums (by name) whose decays are nearly the same, so that only the priors decide between them.

    One sum of each pair is the most probable one. The first sum of a pair has parameters besides its coefficients, the
    second has none. The first has at least as many parameters in all as the second. (A simpler law that is a special
    case of another is distinguished by its evidence.) The limits are `SAME_LAW_RMS` for the difference of the laws and
    `EXCLUDED_NATS` for that of the log posterior probabilities. The result is empty if there are no such pairs.
    """
    best, most = ranking.best, ranking.log_evidence.max()
    near = [s for s, z in zip(ranking.sums, ranking.log_evidence, strict=True) if z > most - EXCLUDED_NATS]
    pairs = []
    for a, b in [*((best, s) for s in near), *((s, best) for s in near)]:
        if a.count == 0 or b.count > 0 or len(a.terms) + a.count < len(b.terms):
            continue
        law = b.law()
        for c in ranking.candidates:
            if c.name != a.name:
                continue
            x = np.linspace(c.fit[0], c.fit[-1], COMPARED_AMPLITUDES)
            losses = law.shapes(x) / np.maximum(c.law.rate(x, c.rates), 1e-300)
            if nnls(losses.T, np.ones(x.size))[1] > SAME_LAW_RMS * np.sqrt(x.size):
                break
        else:
            pairs.append((a.name, b.name))
    return tuple(pairs)


@dataclass(frozen=True)
class PowerFit:
    """A fit of the power law dA/dt = -c A^p, where A is the amplitude divided by the reference amplitude.

    exponent: median and 95 % interval of p. odds: log Bayes factor, in nats, of the power law against all sums of
    damping terms together. Their common evidence is the mean, weighted by the prior probabilities of the sums.
    """

    exponent: Quantity
    odds: float


def fit_power_law(b: Blocks, ranking: Ranking) -> PowerFit:
    """Fit a power law to the decay, and compute its Bayes factor against all ranked sums of damping terms together."""
    log_evidence, exponent = power_law_evidence(b)
    prior = np.logaddexp.reduce([s.log_prior for s in ranking.sums])
    return PowerFit(exponent, float(log_evidence - np.logaddexp.reduce(ranking.log_evidence) + prior))


def power_candidates(b: Blocks) -> list[EnvelopeCandidate]:
    """Fit the damping term `power` (force ∝ |v|^p); return candidates with several values of p.

    The values of p are points that represent its posterior. If a power law describes a decay better than all sums,
    decay rates are drawn from these candidates too.
    """
    return compare_sums(b, [Sum(("power",), b.ends[0], float(b.x.min()))])
