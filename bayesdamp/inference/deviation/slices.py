"""Linear models in slices of the range of one damping parameter, such as an exponent, from which sampling starts.

The motion is far from linear in a parameter that a damping term has besides its coefficient, such as a Stribeck
velocity or the exponent of a power law. At a fixed value of this parameter it is nearly linear in all others. So the
range of the parameter's standard normal score, a, is cut into slices of equal width. At the middle of each slice we
find the mode of all other parameters and linearise the motion about it (compare the integration over hyperparameters by
H. Rue, S. Martino and N. Chopin, J. R. Stat. Soc. B 71, 319, 2009).

Letters in this module: c is the standard normal score of the coefficient of the term with the parameter a. This term
may have a further parameter that multiplies c; s is its score, and t = s c / pivot, where the pivot is c at the mode in
the slice. Without such a parameter, t = c.

The exponent p of a damping force c |v|^p is inferred from such slices: the log evidence is interpolated between them. A
model that is linear in p would fail unless the record determines p well, because p and the log deviation of the
damping, g, are nearly degenerate. A g that changes with the amplitude has the same effect as another p, and along this
degeneracy the coefficient c follows a curve.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.deviation.candidate import (
    MotionCandidate,
    exact_model,
    linearise,
    linearise_at_mode,
    refit,
)
from bayesdamp.inference.deviation.draws import orbits_of, unit_works
from bayesdamp.inference.deviation.linear import LinearModel, LinearPosterior, linear_posterior
from bayesdamp.inference.deviation.model_comparison import CandidateResult, ModelComparison
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.kernel import Solver
from bayesdamp.priors import Prior

SLICE_WIDTH = 1.0
"""Width of a slice of the range of one damping parameter, such as an exponent, in posterior sds of its standard normal
score (where this sd is above 1, in units of 1). With this width the sum over slices has no visible error: for a normal
density the relative error of the sum is 2 exp(−2π²)."""
ONE_SLICE_SD = 0.05
"""Smallest posterior sd of a damping parameter's standard normal score for which `slice_proposal` cuts the parameter's
range into slices; it is relative to the prior sd. Below it one linear model is enough (measured at 0.01: the effective
number of draws is 98 %)."""
LARGEST_SCORE = 4.0
"""Largest absolute value of the standard normal score of the sliced damping parameter at the middle of a slice; there
are no slices further out (conventional)."""
LAST_NATS = 8.0
"""On each side of the mode, slices of a damping parameter's range are added until the log evidence of a slice is this
many nats below that of the best slice (conventional). The log evidence includes the prior of the parameter."""
MOST_SLICES = 12
"""Largest number of slices of a damping parameter's range on either side of the mode (conventional)."""
MOST_GROWTH = 1.0
"""Limit of the slopes of a slice (`Slice.slopes`): across a slice they change the logarithm of the standard normal
score with the index `SlicedProposal.size` by at most this; larger slopes are reduced (conventional). These occur where
the record determines only a combination of the sliced damping parameter and this score."""
LEAST_COEFFICIENT = 1e-3
"""Lower bound of a coefficient's standard normal score c, relative to its value at the mode of the slice (the pivot),
in the formula s = t pivot / c of `SlicedProposal` (conventional). For smaller c, s would overflow."""
MOVING_SDS = 3.0
"""The mode of a coefficient moves with the sliced damping parameter only if it is more than this many posterior sds
above zero (conventional). The score `SlicedProposal.size` always moves."""


@dataclass(frozen=True)
class Slice:
    """A slice of the range of a damping parameter, such as an exponent, with the linear model at its middle.

    a is the standard normal score of this parameter; it is fixed in the linear model. The other unknowns are the
    remaining d − 1 scores, and the deviations g (log damping) and h (relative frequency) from the laws.

    Attributes
    ----------
    middle : float
        The value of a at which the motion is linearised.
    model, posterior
        The linear model as a function of the other unknowns, and its posterior. If the term has a score s that
        multiplies its coefficient, the model has t in place of s (see `SlicedProposal`).
    slopes : ndarray, shape (d − 1,)
        Derivatives by a of the mode of the other scores, divided by the score `SlicedProposal.size`; 0 for coefficients
        whose mode is near zero (`MOVING_SDS`).
    pivot : float
        Constant in t = s c / pivot: the score c of the term's coefficient at the mode of this slice; 1 if
        `SlicedProposal.product` is None.
    """

    middle: float
    model: LinearModel
    posterior: LinearPosterior
    slopes: np.ndarray
    pivot: float


@dataclass(frozen=True)
class SlicedProposal:
    """The distribution from which sampling starts: a mixture of posteriors of linear models, one for each slice.

    A slice is a part of the range of one damping parameter, such as an exponent; a is the standard normal score of this
    parameter. u, (K,), contains all unknowns of a candidate: its scores, then the deviations from the laws. Draws are
    made in other coordinates w, (K,), in which the motion is more nearly linear. w contains a too, at the middle of a
    slice; `redraw_within_slice` moves it within the slice. Two transformations lead from w to u:

    - w contains t where u contains s. c is the score of the coefficient of the term with the parameter a. If the term
      has a further parameter that multiplies c (such as the static excess of friction), s is the score of this
      parameter. The force is linear in c and t = s c / pivot, but not in c and s. Without such a parameter t is c.
    - The mode of the other scores depends on a. If a is not at the middle, they are shifted by their slopes times the
      distance of a from the middle, times the score to which the effect of a on the force is proportional. This score
      is t, or c if a itself multiplies c; the score itself is multiplied by exp(slope · distance).

    Attributes
    ----------
    parameters : Parameters
        Priors and names of the scores in u.
    place : int
        Index of a among the scores.
    product : tuple of int, optional
        Indices of c and s; None if there is no parameter s.
    size : int
        Index, in w, of the score to which the effect of a on the force is proportional (t or c).
    width : float
        Width of each slice, in units of a.
    slices : tuple of Slice
        The slices, by rising `middle`.
    """

    parameters: Parameters
    place: int
    product: tuple[int, int] | None
    size: int
    width: float
    slices: tuple[Slice, ...]

    @property
    def own(self) -> int:
        """Index of the score `size` (t or c, see the class) among the scores without the sliced parameter's score a."""
        return self.size - (self.size > self.place)

    @property
    def _middles(self) -> np.ndarray:
        return np.array([s.middle for s in self.slices])

    @property
    def _logs(self) -> np.ndarray:
        """Return for each of k slices the log of its evidence times its prior probability, in nats, (k,)."""
        prior = -0.5 * self._middles**2 - 0.5 * np.log(2 * np.pi)
        return np.array([s.posterior.log_evidence for s in self.slices]) + prior + np.log(self.width)

    @property
    def log_evidence(self) -> float:
        """Log of the sum over all slices of evidence times prior probability, in nats."""
        return float(np.logaddexp.reduce(self._logs))

    @property
    def middle(self) -> np.ndarray:
        """Posterior mean of w, (K,), in the most probable mixture component of the most probable slice.

        w: a candidate's unknowns, in coordinates in which the motion is nearly linear (see the class). A component is
        one of the normal distributions whose mixture is the posterior of a slice. The cut-off of coefficients at zero
        is ignored.
        """
        part = self.slices[int(np.argmax(self._logs))]
        return np.insert(part.posterior.top_mean, self.place, part.middle)

    def _split(self, w: np.ndarray) -> Iterator[tuple[np.ndarray, Slice, np.ndarray, np.ndarray]]:
        """Yield the draws w, (n, K), slice by slice.

        w: a candidate's unknowns, in coordinates in which the motion is nearly linear (see the class). For each slice
        that has m > 0 draws, yield a tuple of:

        - the indices of these draws in w, (m,);
        - the slice;
        - the distance of the sliced parameter's standard normal score from the middle of the slice, (m,);
        - the other elements of these draws, (m, K − 1).
        """
        which = np.rint((w[:, self.place] - self.slices[0].middle) / self.width).astype(int)
        for i in np.unique(which):
            rows = np.flatnonzero(which == i)
            part = self.slices[i]
            yield rows, part, w[rows, self.place] - part.middle, np.delete(w[rows], self.place, axis=1)

    def draws(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw w, (count, K); return also the index of each draw's component in the mixture of its slice, (count,).

        w: a candidate's unknowns, in coordinates in which the motion is nearly linear (see the class). In all draws the
        sliced parameter is at the middle of a slice. The draws are ordered by slice. The posterior of each slice is a
        mixture of normal distributions (components).
        """
        numbers = rng.multinomial(count, np.exp(self._logs - self.log_evidence))
        rows, combos = [], []
        for part, number in zip(self.slices, numbers, strict=True):
            if number:
                others, combo = part.posterior.draws(number, rng)
                rows.append(np.insert(others, self.place, part.middle, axis=1))
                combos.append(combo)
        return np.concatenate(rows), np.concatenate(combos)

    def crank_nicolson_step(
        self, u: np.ndarray, combos: np.ndarray, step: float, rng: np.random.Generator
    ) -> np.ndarray:
        """Return draws w, (n, K), after a random Crank–Nicolson step, which leaves the proposal distribution as it is.

        w: a candidate's unknowns, in coordinates in which the motion is nearly linear (see the class). The sliced
        parameter does not move. u: the draws w before the step. combos: index of each draw's mixture component within
        its slice, (n,). step: size of the step in posterior sds, between 0 and 1. Scores of coefficients may become
        negative.
        """
        new = u.copy()
        for rows, part, off, others in self._split(u):
            others = part.posterior.crank_nicolson_step(others, combos[rows], step, rng)
            new[rows] = np.insert(others, self.place, part.middle + off, axis=1)
        return new

    def redraw_within_slice(self, w: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return a copy of draws w, (n, K), in which the sliced parameter is drawn again, uniformly in its slice.

        w: a candidate's unknowns, in coordinates in which the motion is nearly linear (see the class). Its other
        elements do not change.
        """
        new = w.copy()
        for rows, part, *_ in self._split(w):
            new[rows, self.place] = part.middle + self.width * rng.uniform(-0.5, 0.5, rows.size)
        return new

    def scores(self, w: np.ndarray) -> np.ndarray:
        """Convert draws w, (n, K), to the candidate's standard normal scores and deviations from the laws, (n, K).

        w: a candidate's unknowns, in coordinates in which the motion is nearly linear (see the class).
        """
        return self._scores(w)[0]

    def _scores(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Convert draws w to u, both (n, K), and return also the log determinant of the Jacobian ∂u/∂w, (n,).

        w: a candidate's unknowns, in coordinates in which the motion is nearly linear (see the class). u contains the
        standard normal scores of the candidate's parameters, then its deviations from the laws.
        """
        u, log = w.copy(), np.zeros(len(w))
        others = np.delete(np.arange(self.parameters.free.size), self.place)
        for rows, part, off, _ in self._split(w):
            moves = off[:, None] * part.slopes
            growth = moves[:, self.own].copy()
            moves[:, self.own] = np.expm1(growth)
            u[np.ix_(rows, others)] += moves * w[rows, self.size, None]
            log[rows] = growth
            if self.product is not None:
                c, s = self.product
                scale = part.pivot / np.maximum(u[rows, c], LEAST_COEFFICIENT * part.pivot)
                u[rows, s] *= scale
                log[rows] += np.log(scale)
        return u, log

    def log_ratio(self, w: np.ndarray, squares: np.ndarray, variance: float) -> np.ndarray:
        """Return the log importance weights of draws w, (n,): log posterior minus log proposal density.

        w: a candidate's unknowns, in coordinates in which the motion is nearly linear (see the class). The mean weight
        is the evidence with exact motions divided by that of the linear models. For exact motions the equation of
        motion is solved for each draw. squares: sums of squared residuals of the exact motions at `scores(w)`, (n,).
        variance: variance of the noise, in the record's unit squared.
        """
        d, p = self.parameters.free.size, self.parameters
        u, volume = self._scores(w)
        linear, at_middle = np.empty(len(w)), w[:, :d].copy()
        for rows, part, _, others in self._split(w):
            linear[rows] = part.model.squares(others)
            at_middle[rows, self.place] = part.middle
        prior = p.log_prior(u[:, :d]) - p.log_prior(at_middle) + p.log_prior_ratio(u[:, :d])
        return 0.5 * (linear - squares) / variance + prior + volume


def slice_proposal(
    comparison: ModelComparison, result: CandidateResult, base: Parameters, posterior: LinearPosterior
) -> SlicedProposal | None:
    """Build the distribution from which the sampling of a candidate starts, in slices of one damping parameter.

    The sliced parameter is an own parameter of a damping term, such as an exponent: the one whose standard normal score
    has the largest posterior sd. Parameters with half-normal priors are not considered.

    Parameters
    ----------
    comparison : ModelComparison
        The comparison on the record.
    result : CandidateResult
        The candidate's result.
    base : Parameters
        Priors and names of the scores.
    posterior : LinearPosterior
        The posterior of the linear model about the mode, in the coordinates of `base`.

    Returns
    -------
    SlicedProposal or None
        None if no parameter can be sliced, if the record determines it well (`ONE_SLICE_SD`), or if the first slice, at
        the mode, cannot be computed.
    """
    d = base.free.size
    own = np.array([name in result.solver.inferred for name in base.free_names])
    leading = np.flatnonzero(own & ~base.positive)
    if not leading.size:
        return None
    mode = posterior.top_mean
    sds = posterior.sds(np.eye(d, mode.size))
    place = int(leading[np.argmax(sds[leading])])
    if sds[place] < ONE_SLICE_SD:
        return None
    mode[:d][base.positive] = np.maximum(mode[:d][base.positive], 0.0)
    width = SLICE_WIDTH * min(float(sds[place]), 1.0)
    proposal = SlicedProposal(base, place, *_product_and_size(result, base, place), width, ())
    middle = float(np.clip(mode[place], -LARGEST_SCORE, LARGEST_SCORE))
    first = _slice_at(comparison, result, proposal, middle, np.delete(mode, place))
    if first is None:
        return None
    slices, best = [first[0]], _log_weight(first[0])
    for side in (1.0, -1.0):
        at, u = first
        for i in range(1, MOST_SLICES + 1):
            a, start = middle + side * i * width, u.copy()
            start[: d - 1] += side * width * at.slopes * u[proposal.own]
            new = _slice_at(comparison, result, proposal, a, start) if abs(a) <= LARGEST_SCORE else None
            if new is None:
                break
            at, u = new
            slices.append(at)
            best = max(best, _log_weight(at))
            if _log_weight(at) < best - LAST_NATS:
                break
    return replace(proposal, slices=tuple(sorted(slices, key=lambda s: s.middle)))


def _product_and_size(
    result: CandidateResult, base: Parameters, place: int
) -> tuple[tuple[int, int] | None, int]:
    """Return the attributes `product` and `size` of `SlicedProposal` for the sliced parameter with the index `place`.

    product: indices of two standard normal scores: that of the term's coefficient, and that of another parameter that
    multiplies it; None if the term has no such parameter. size: index of this other parameter; but of the coefficient
    if there is no other parameter, or if the sliced parameter multiplies the coefficient too.
    """
    names = base.free_names
    term = next(
        t for t in map(TERMS.get, result.candidate.damping) if names[place] in [p.name for p in t.inferred]
    )
    c, simple = names.index(term.parameter), [n for n, _ in term.reduces if n in names and n != names[place]]
    if not simple:
        return None, c
    s = names.index(simple[0])
    return (c, s), c if names[place] in dict(term.reduces) else s


def _log_weight(part: Slice) -> float:
    """Return the log evidence of a slice plus the log prior density of the sliced parameter at the middle of the slice.

    The density is that of the parameter's standard normal score. The result is in nats, up to a constant.
    """
    return part.posterior.log_evidence - 0.5 * part.middle**2


def _slice_at(
    comparison: ModelComparison,
    result: CandidateResult,
    proposal: SlicedProposal,
    a: float,
    start: np.ndarray,
) -> tuple[Slice, np.ndarray] | None:
    """Return the slice of a proposal with its middle at the score a, and the mode of the other unknowns, (K − 1,).

    a is the standard normal score of the sliced damping parameter. The other unknowns are the remaining scores and the
    deviations from the laws. proposal: supplies parameters, indices and width; the slices that it already has are not
    used. start: point from which the mode is searched, (K − 1,).

    Return None if no motion can be linearised there. Return None also if the coefficient is 0 at the mode and the term
    has another parameter that multiplies it (`SlicedProposal.product`).
    """
    base, place, product = proposal.parameters, proposal.place, proposal.product
    data, solver, own = comparison.data, result.solver, proposal.own
    name = base.free_names[place]
    fixed = base.with_fixed(name, float(base.priors[name].value(np.asarray(a))))
    d = fixed.free.size
    z = np.where(fixed.positive, np.maximum(start[:d], 0.0), start[:d])
    fit = replace(result.fit, parameters=fixed, z=z)
    if result.linearisation is None:
        fit = refit(solver, data, fit)
        if fit is None:
            return None
        model, u = exact_model(fit), fit.z
    else:
        about = linearise(solver, data, fit, np.concatenate([z, start[d:]]))
        mode = None if about is None else linearise_at_mode(solver, data, fit, result.variance, about)
        if mode is None:
            return None
        model, u = mode.model, mode.u
    pivot, matrix = 1.0, np.eye(u.size)
    if product is not None:
        # Express the model by c and t = s c / pivot instead of c and s.
        c, s = (i - (i > place) for i in product)
        pivot = float(u[c])
        if pivot <= 0:
            return None
        matrix[s, c] = -u[s] / pivot
        model = model.transform(u, matrix)
    posterior = linear_posterior(model, result.grid(), result.variance, comparison.samples)
    # How the mode of some scores moves with a; the other scores and the deviations are fixed.
    square = model.root[:, :d].T @ model.root[:, :d] / result.variance + np.eye(d)
    sds = np.sqrt(np.diagonal(np.linalg.inv(square)))
    moves = ~fixed.positive | (u[:d] > MOVING_SDS * sds)
    moves[own] = True
    largest = u[:d].copy()
    largest[own] = size = max(u[own], sds[own])
    largest = u[:d] + matrix[:d, :d] @ (largest - u[:d])
    z = np.insert(largest, place, a)
    g, h = np.split(u[d:], 2) if u.size > d else (None, None)
    motion = solver.solve(base.values(z), fit.active, None if g is None else np.expm1(g), h)
    if motion is None:
        return None
    columns = base.by_scores(motion.tangents, z)
    others = np.delete(columns, place, axis=1) @ matrix[:d, :d]
    pull = others.T @ columns[:, place] / result.variance
    slopes = np.zeros(d)
    slopes[moves] = -np.linalg.solve(square[np.ix_(moves, moves)], pull[moves]) / size
    slopes *= min(1.0, MOST_GROWTH / max(proposal.width * abs(slopes[own]), 1e-300))
    return Slice(a, model, posterior, slopes, pivot), u


LEAST_EXPONENT, MOST_EXPONENT = 0.0, 3.0
"""Lower and upper end of the uniform prior of the exponent p of a damping force c |v|^p, in `exponent_quantiles`, and
limits of the exponents at which fits start (conventional). The prior of the damping term `power` is a little wider."""
ROUNDED = 0.002
"""A power |v|^p of the velocity with p < 1 is smoothed near v = 0. This is the largest width of the smoothed range, as
a fraction of the peak velocity. A larger width would change the power at small amplitudes."""
ASIDE = (0.0, -0.4, 0.4)
"""Exponents at which fits of a power law start, minus the local exponent of the best candidate (conventional). The
local exponent is the slope of its log damping force against log velocity at the middle amplitude."""
NEAR = 1.5
"""Ratio of two amplitudes to the middle amplitude: one is larger and one smaller by this factor (conventional). The
damping at both gives the local exponent, the slope of the log damping force against log velocity."""
DRAWS = 4000
"""Number of draws of the exponent from the posterior of the linear model about the mode (conventional). They are used
if one linear model is enough (`ONE_SLICE_SD`)."""
MOST_ABOVE = 7.0
"""A smooth interpolation of log evidences that exceeds the largest of them by at least this, in nats, is replaced by a
monotonic one (conventional). Next to a drop of thousands of nats the smooth one overshoots."""
LEVELS = (np.arange(400) + 0.5) / 400
"""Equidistant probabilities at which quantiles of the exponent of a power law are returned; the 400 quantiles serve as
draws."""
POINTS = 3001
"""Number of equidistant exponents at which the posterior of a power law's exponent is interpolated between the slices
(conventional)."""


def exponent_quantiles(comparison: ModelComparison) -> tuple[float, ...]:
    """Return quantiles of the exponent p of a damping force c |v|^p, at the probabilities `LEVELS`.

    The coefficient and all other unknowns are integrated out. The restoring law is that of the best candidate. The
    prior of the exponent is the user's or, by default, uniform from `LEAST_EXPONENT` to `MOST_EXPONENT`. If the record
    determines the exponent so well that one linear model is enough (`ONE_SLICE_SD`), the quantiles are those of draws
    from its posterior.

    The 400 quantiles rise and serve as draws of p. The result is empty if the comparison has no result with this force
    as the only damping under this law, if p is known, or if the range of p has fewer than two slices that could be
    computed.
    """
    if not comparison.results:
        return ()
    alone = MotionCandidate(("power",), comparison.best.candidate.restoring)
    result = next((r for r in (*comparison.results, *comparison.forms) if r.candidate == alone), None)
    if result is None or "exponent" not in result.fit.parameters.priors:
        return ()
    parameters, prior = result.fit.parameters, result.fit.parameters.priors["exponent"]
    proposal = slice_proposal(comparison, result, parameters, result.posterior)
    if proposal is None:
        scores = result.posterior.draws(DRAWS, np.random.default_rng(0))[0][
            :, parameters.free_names.index("exponent")
        ]
        if np.std(scores) >= ONE_SLICE_SD:
            return ()
        return tuple(np.quantile(prior.value(scores), LEVELS).tolist())
    p = prior.value(np.array([part.middle for part in proposal.slices]))
    log = np.array([part.posterior.log_evidence for part in proposal.slices])
    return _quantiles(p, log, comparison.priors.get("exponent")) if p.size > 1 else ()


def power_solver(comparison: ModelComparison, p: float) -> Solver:
    """Return the solver of the best candidate's restoring law with a power |v|^p as an additional damping term.

    It solves the rival whose only damping is this power. The exponent remains a parameter of the solver. The argument p
    only sets the width of the velocity range in which forces are smoothed at v = 0. For p < 1 this width is at most
    `ROUNDED` of the peak velocity; otherwise it is that of the original solver.
    """
    plain = comparison.solvers[comparison.best.candidate.restoring]
    narrow = min(plain.epsilon, ROUNDED * comparison.reference.peak_velocity)
    # For p ≥ 1 the usual width has no effect on the power, and a narrow one would need ten times as many steps.
    terms = tuple(dict.fromkeys([*plain.terms, "power"]))
    return replace(plain, terms=terms, epsilon=narrow if p < 1 else plain.epsilon)


def exponent_starts(comparison: ModelComparison) -> list[float]:
    """Return three exponents p at which fits of a damping force c |v|^p start, each limited to 0 to 3.

    The first is 1 + d log ζ / d log A at the middle amplitude, where ζ(A) is the damping ratio of the best candidate at
    amplitude A. The others are smaller and larger (`ASIDE`). The list is empty if the best candidate cannot oscillate,
    or loses no energy, at one of the two amplitudes from which the derivative is computed (`NEAR`).
    """
    best, middle = comparison.best, comparison.data.middle
    solver = comparison.solvers[best.candidate.restoring]
    ratios = []
    for orbit in orbits_of(best, [middle.amplitude * NEAR, middle.amplitude / NEAR]):
        if orbit is None:
            return []
        works = unit_works(orbit, solver, best.further, best.fit.active)[0]
        ratios.append(float(works @ best.values[: works.size]) / orbit.energy)
    if min(ratios) <= 0:
        return []
    steep = 1 + float(np.log(ratios[0] / ratios[1])) / (2 * np.log(NEAR))
    return np.clip(steep + np.array(ASIDE), LEAST_EXPONENT, MOST_EXPONENT).tolist()


def _quantiles(p: np.ndarray, log: np.ndarray, prior: Prior | None) -> tuple[float, ...]:
    """Return the 400 rising quantiles of the exponent p of a power law at `LEVELS`, which serve as draws of p.

    p: rising exponents, (m,), m ≥ 2. log: log evidences at these, in nats, (m,), between which the log evidence is
    interpolated. prior: that of the exponent; None for a uniform one from `LEAST_EXPONENT` to `MOST_EXPONENT`. The
    posterior is zero outside the first and the last exponent.
    """
    low, high = np.clip(p[[0, -1]], LEAST_EXPONENT, MOST_EXPONENT) if prior is None else p[[0, -1]]
    grid = np.linspace(low, high, POINTS)
    values = scipy.interpolate.PchipInterpolator(p, log)(grid)
    if p.size > 2:
        smooth = scipy.interpolate.Akima1DInterpolator(p, log, method="makima", extrapolate=True)(grid)
        # PCHIP is monotonic between two exponents, so it never overshoots.
        values = smooth if smooth.max() < log.max() + MOST_ABOVE else values
    if prior is not None:
        values = values + prior.log_density(grid)
    density = np.exp(values - values.max())
    total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    # Add a slope, so that the cumulative probability can be inverted everywhere.
    return tuple(np.interp(LEVELS, total / total[-1] + 1e-12 * np.arange(POINTS), grid).tolist())
