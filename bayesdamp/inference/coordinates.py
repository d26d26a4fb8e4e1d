"""Coordinates in which a posterior is nearly standard normal.

A score is a parameter that is transformed so that its prior is standard normal. Three maps lead from scores to the
coordinates u:

1. `NoiseMap` replaces the scores of two parameters of correlated noise by numbers whose posterior is nearly normal. The
   result is called level scores.
2. `Shear` straightens a curved ridge of the posterior in the parameters of the motion. The result is called straight
   scores.
3. `Whitening` subtracts the mean and divides by a Cholesky factor of the covariance. The result is u.

A parameter with a half-normal prior depends only on the absolute value of its score. Such a score is called reflected
and is restricted to values ≥ 0. The boundary, where it is 0, is called a wall. `TruncatedNormal` is a normal
distribution of scores with such walls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.mode import Mode, maximise
from bayesdamp.inference.model.likelihood import Likelihood, Line
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.numerics.levenberg_marquardt import Maximum
from bayesdamp.numerics.orthant import draw
from bayesdamp.types import Refusal

if TYPE_CHECKING:
    from scipy.interpolate import PPoly


LEAST_INSIDE = 0.02
"""`TruncatedNormal.draw` draws from a normal distribution and rejects draws in which a score that must be ≥ 0 is
negative. If less than this fraction of the draws is accepted, it uses the approximate sampler `numerics.orthant.draw`
instead."""
MOMENT_DRAWS = 20_000
"""Number of draws with which `TruncatedNormal.moments` computes a mean and a covariance."""
FAR_WALL_SDS = 8.0
"""`TruncatedNormal` does not restrict a score to values ≥ 0 if its mean is at least this many standard deviations above
zero, because negative values are then practically impossible."""


class TruncatedNormal:
    """A normal distribution of d scores, truncated at zero, whose log density has a given gradient at a point.

    Scores are parameters transformed so that their priors are standard normal.

    Parameters
    ----------
    at, gradient : ndarray, shape (d,)
        The point, and the gradient there. The mean before the truncation is at + covariance @ gradient.
    covariance : ndarray, shape (d, d)
        The covariance before the truncation.
    reflected : ndarray of bool, shape (d,)
        Which scores are restricted to values ≥ 0: those of parameters with half-normal priors. The restriction is
        ignored for scores whose mean is at least `FAR_WALL_SDS` sds above zero; the attribute `walls` contains the
        indices of the scores for which it is not ignored.
    """

    def __init__(
        self, at: np.ndarray, gradient: np.ndarray, covariance: np.ndarray, reflected: np.ndarray
    ) -> None:
        self.mean, self.covariance = at + covariance @ gradient, 0.5 * (covariance + covariance.T)
        self.walls = np.flatnonzero(reflected & (self.mean < FAR_WALL_SDS * np.sqrt(np.diag(covariance))))

    @cached_property
    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean, (d,), and lower Cholesky factor of the covariance, (d, d), of the truncated distribution.

        The effect of the restriction is estimated from `MOMENT_DRAWS` draws with a fixed seed. Raises LinAlgError if a
        covariance is not positive definite.
        """
        mean, covariance, walls = self.mean, self.covariance, self.walls
        if walls.size:
            inner = covariance[np.ix_(walls, walls)]
            rng = np.random.default_rng(0)  # a fixed seed: the moments only define coordinates
            inside = draw(rng, mean[walls], np.linalg.cholesky(inner), np.arange(walls.size), MOMENT_DRAWS)
            # Regression of all scores on the restricted ones.
            regression = covariance[:, walls] @ np.linalg.inv(inner)
            mean = mean + regression @ (inside.mean(axis=0) - mean[walls])
            change = np.cov(inside.T, ddof=1).reshape(inner.shape) - inner
            covariance = covariance + regression @ change @ regression.T
        return mean, np.linalg.cholesky(covariance)

    def draw(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Return n draws of the truncated distribution, (n, d).

        Normal draws are rejected unless they meet the restriction, so that the draws are independent. If a fraction of
        less than `LEAST_INSIDE` meets it, the draws come from `numerics.orthant.draw` instead; these can contain equal
        draws.
        """
        factor = np.linalg.cholesky(self.covariance)
        draws = np.empty((0, self.mean.size))
        while len(draws) < n:
            z = self.mean + rng.standard_normal((max(n, 1000), self.mean.size)) @ factor.T
            inside = np.all(z[:, self.walls] >= 0, axis=1)
            if np.mean(inside) < LEAST_INSIDE:
                return draw(rng, self.mean, factor, self.walls, n)
            draws = np.concatenate([draws, z[inside]])
        return draws[:n]


def truncated_near(likelihood: Likelihood, z: np.ndarray, factor: np.ndarray) -> TruncatedNormal:
    """Return a truncated normal whose log density has the same gradient at z, (d,), as the log posterior.

    Its covariance before the truncation is factor @ factor.T. Reflected scores (those with half-normal priors) in z are
    first replaced by their absolute values, and the distribution is restricted to values ≥ 0 of these scores.
    """
    reflected = likelihood.target.reflected
    at = np.where(reflected, np.abs(z), z)
    return TruncatedNormal(at, likelihood.gradient(at)[1], factor @ factor.T, reflected)


def negative_hessian(
    gradient: Callable[[np.ndarray], np.ndarray], at: np.ndarray, factor: np.ndarray, step: float
) -> np.ndarray:
    """Return the negative Hessian, (d, d), of a function by coordinates u that are linear in x: x = at + factor @ u.

    It is computed at u = 0 by central differences of the gradient.

    Parameters
    ----------
    gradient : callable
        Function that returns the gradient, (d,), by x at a point x, (d,).
    at : ndarray, shape (d,)
        The point x at u = 0.
    factor : ndarray, shape (d, d)
        Derivatives of x by u.
    step : float
        Step of the differences, in u.
    """
    rows = [gradient(at - step * column) - gradient(at + step * column) for column in factor.T]
    hessian = np.stack(rows) @ factor / (2 * step)
    return 0.5 * (hessian + hessian.T)


FIRST_STEP, STEP_GROWTH = 0.3, 1.2
"""Steps in `NoiseMap.of`, which computes the posterior of the second of the two noise parameters in `NoiseModel.tied`
by maximising over all other parameters at a sequence of its values. The first step away from the mode is `FIRST_STEP`
posterior sds, and each further step is longer by the factor `STEP_GROWTH`."""
RIDGE_END_NATS = 16.0
"""`NoiseMap.of` extends the steps of a noise parameter until the log density is this many nats below its maximum: 5.7
sds of a normal distribution."""
MOST_STEPS = 40
"""Largest number of steps of a noise parameter, in `NoiseMap.of`, to each side of the mode."""
LEAST_STEPS = 4
"""If `NoiseMap.of` can compute the posterior of a noise parameter at no more values than this, the map changes no
parameter."""
PARTS_PER_STEP = 8
"""`NoiseMap.of` computes the log density of a noise parameter at values in steps, and interpolates between them to
integrate it. This is the number of parts into which it divides each step."""
LARGEST_LEVEL = 4.5
"""`NoiseMap.table` maps the level score of a noise parameter (the standard normal quantile of its marginal posterior)
to its score. The table has points up to this absolute value of the level score; beyond, it is continued linearly."""
LINEAR_END = 1000.0
"""`NoiseMap.table` is continued by straight lines up to this absolute value of its argument, the standard normal
quantile of a noise parameter's marginal posterior (conventional)."""
NEWTON_STEPS = 6
"""Number of Newton steps with which `NoiseMap.level` inverts the map of a noise parameter (four are enough)."""
RIDGE_DIMENSIONS = 2
"""Number of wide scores. These are the standard normal scores of the motion's parameters with the largest posterior
sds; a curved ridge of the posterior may extend along them."""
CURVATURE_SDS = 1.5
"""A ridge is a set of values of the motion's parameters that fit about equally well. `shear_of` measures the curvature
of such a ridge at this distance from the mode, in posterior sds."""
VISIBLE_BEND = 0.02
"""`shear_of` straightens a curved ridge of the posterior only if, one sd from the mode, the ridge is at least this far
from its tangent, in posterior sds."""
HESSIAN_STEP = 0.5
"""Step of the differences of gradients that give Hessians of the log posterior, in posterior sds. If a coefficient must
not be negative, zero is about one sd or more from its mean, so that no step crosses zero."""
LEAST_CURVATURE = 0.1
"""Smallest eigenvalue of the log posterior's negative Hessian that `whitening_of` uses, in coordinates in which the
Gauss–Newton Hessian is approximately the identity. It replaces smaller eigenvalues."""


@dataclass(frozen=True)
class NoiseMap:
    """A map from level scores to scores, for two parameters of the noise whose posterior is not normal.

    Scores are parameters transformed so that their priors are standard normal. Level scores are new coordinates in
    which the posterior is nearly normal. The two parameters are those that the noise model declares as `tied`. The
    second of them, such as a correlation time, can have a very skew posterior; its level score is the standard normal
    quantile of its marginal posterior. The level score of the first parameter is its score minus a shift: the change of
    its most probable value with the second parameter. All other level scores are equal to the scores.

    Attributes
    ----------
    first, second : int
        Indices of the two parameters among all scores.
    table : PPoly or None
        Score of the second parameter and shift of the first, as functions of the level score of the second; None if the
        map is the identity.
    """

    first: int = 0
    second: int = 0
    table: PPoly | None = None

    @classmethod
    def of(cls, target: Target, mode: Mode) -> NoiseMap:
        """Return the map for the posterior `target`, whose mode is `mode`.

        At many values of the second noise parameter, the log posterior is maximised over all other parameters.
        Laplace's approximation at these maxima gives the marginal posterior of the second parameter; the standard
        normal quantile of its cumulative probability is the level score of the second parameter. The position of each
        maximum gives the shift of the first parameter.

        The map is the identity in each of these cases: the noise model has no `tied` parameters; not both of them are
        inferred; one of them has a half-normal prior (a reflected score); the model allows for deviations from its
        laws; or at most `LEAST_STEPS` maxima can be computed.
        """
        tied = NOISES.get(target.noise).tied
        if tied is None or not set(tied) <= set(target.names) or mode.linear is not None:
            return cls()
        first, second = map(target.names.index, tied)
        if target.reflected[first] or target.reflected[second]:
            return cls()
        scores, log_densities, firsts = _profile(target, mode, first, second)
        if scores.size <= LEAST_STEPS:
            return cls()
        away = np.diff(scores)[:, None] * np.arange(PARTS_PER_STEP) / PARTS_PER_STEP
        fine = np.append((scores[:-1, None] + away).ravel(), scores[-1])
        log_densities = scipy.interpolate.Akima1DInterpolator(scores, log_densities)(fine)
        density = np.exp(log_densities - np.max(log_densities))
        parts = 0.5 * (density[1:] + density[:-1]) * np.diff(fine)
        # The standard normal quantile of the cumulative probability. Each half is summed from its own end, so that the
        # tails are accurate. Both ends are infinite.
        below = np.append(0.0, np.cumsum(parts)) / parts.sum()
        above = np.append(np.cumsum(parts[::-1])[::-1], 0.0) / parts.sum()
        lower, upper = (scipy.special.ndtri(np.minimum(tail, 0.5)) for tail in (below, above))
        level = np.where(below < above, lower, -upper)
        inside = np.abs(level) < LARGEST_LEVEL
        shift = scipy.interpolate.Akima1DInterpolator(scores, firsts)(fine) - mode.z[first]
        level, values = level[inside], np.stack([fine, shift], axis=1)[inside]
        # Monotone interpolation between the points, linear extrapolation beyond them.
        low = values[0] - (values[1] - values[0]) / (level[1] - level[0]) * (level[0] + LINEAR_END)
        high = values[-1] + (values[-1] - values[-2]) / (level[-1] - level[-2]) * (LINEAR_END - level[-1])
        level = np.concatenate([[-LINEAR_END], level, [LINEAR_END]])
        values = np.concatenate([[low], values, [high]])
        return cls(first, second, scipy.interpolate.PchipInterpolator(level, values))

    def scores(self, level: np.ndarray) -> np.ndarray:
        """Convert level scores to standard normal scores, (..., d) each.

        Level scores are coordinates in which the posterior is nearly normal. They differ from the scores only for two
        parameters of the noise (see the class). Beyond `LARGEST_LEVEL` the map is continued linearly.
        """
        if self.table is None:
            return level
        scores, values = level.copy(), self.table(level[..., self.second])
        scores[..., self.first] += values[..., 1]
        scores[..., self.second] = values[..., 0]
        return scores

    def level(self, scores: np.ndarray) -> np.ndarray:
        """Convert standard normal scores to level scores, (..., d) each, by Newton's method.

        Level scores replace the scores of two noise parameters by numbers whose posterior is nearly normal; all other
        level scores are equal to the scores (see the class).
        """
        if self.table is None:
            return scores
        level, wanted = scores.copy(), scores[..., self.second]
        interval = np.clip(np.searchsorted(self._knots, wanted, side="right") - 1, 0, self._knots.size - 2)
        low, high = self.table.x[interval], self.table.x[interval + 1]
        v = np.interp(wanted, self._knots, self.table.x)
        for _ in range(NEWTON_STEPS):
            v = np.clip(v - (self.table(v)[..., 0] - wanted) / self._rate(v)[..., 0], low, high)
        level[..., self.second] = v
        level[..., self.first] -= self.table(v)[..., 1]
        return level

    def slope(self, level: np.ndarray) -> np.ndarray:
        """Return the derivatives of standard normal scores by level scores, (..., d, d).

        level: the level scores, (..., d). Element [..., i, j] is the derivative of score i by level score j. Level
        scores replace the scores of two noise parameters by numbers whose posterior is nearly normal; all other level
        scores are equal to the scores (see the class).
        """
        slope = np.zeros((*level.shape, level.shape[-1])) + np.eye(level.shape[-1])
        if self.table is not None:
            rate = self._rate(level[..., self.second])
            slope[..., self.second, self.second] = rate[..., 0]
            slope[..., self.first, self.second] = rate[..., 1]
        return slope

    def log_volume(self, level: np.ndarray) -> np.ndarray:
        """Return the log determinant of the derivatives of scores by level scores, (...), at level scores (..., d).

        Added to the log density of standard normal scores, it gives the log density of level scores at the same point
        (see `NoiseMap`). It is 0 for the identity.
        """
        if self.table is None:
            return np.zeros(level.shape[:-1])
        return np.log(self._rate(level[..., self.second])[..., 0])

    def volume_slope(self, level: np.ndarray) -> np.ndarray:
        """Return the derivatives of `log_volume` by the level scores (see the class) at a point `level`, (d,) each."""
        slope = np.zeros(level.size)
        if self.table is not None:
            x = level[self.second]
            slope[self.second] = self._second_derivative(x)[0] / self._rate(x)[0]
        return slope

    @cached_property
    def _knots(self) -> np.ndarray:
        """Standard normal scores of the second noise parameter at the points of `table`, (m,), in increasing order."""
        assert self.table is not None
        return self.table(self.table.x)[:, 0]

    @cached_property
    def _rate(self) -> PPoly:
        """First derivatives of `table` by its argument, the level score of the second noise parameter."""
        assert self.table is not None
        return self.table.derivative()

    @cached_property
    def _second_derivative(self) -> PPoly:
        """Second derivatives of `table` by its argument, the level score of the second noise parameter."""
        return self._rate.derivative()


def ridge_point(mode: Mode, reflected: np.ndarray, z: np.ndarray, others: np.ndarray) -> Maximum:
    """Maximise the log posterior over some of the standard normal scores, with the others fixed.

    The common prior scale of damping coefficients is fixed at a typical value near the mode (`Mode.near`). Whether the
    search has converged is not checked.

    Parameters
    ----------
    mode : Mode
        Mode of the posterior.
    reflected : ndarray of bool, shape (d,)
        Which scores must not be negative.
    z : ndarray, shape (d,)
        Values of the fixed scores, and start of the search for the others.
    others : ndarray of int, shape (k,)
        Indices of the scores that vary.

    Returns
    -------
    Maximum
        The maximum; its `x` and `information` contain only the scores `others`, (k,) and (k, k).

    Raises
    ------
    Refusal
        If the log posterior at the maximum is not finite.
    """

    def at(inner: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        whole = z.copy()
        whole[others] = inner
        value, gradient, information = mode.near.curvature(whole)
        return value, gradient[others], information[np.ix_(others, others)]

    top = maximise(at, reflected[others], z[others])
    if not np.isfinite(top.value):
        raise Refusal("the log posterior on the ridge is not finite")
    return top


def _profile(target: Target, mode: Mode, first: int, second: int) -> np.ndarray:
    """Compute the marginal posterior of the second of two tied noise parameters, in steps to both sides of the mode.

    At each value of this parameter, the log posterior is maximised over all other parameters. A side ends at
    `RIDGE_END_NATS`, after `MOST_STEPS` steps, or where the posterior is not finite. first, second: indices of the two
    parameters.

    Returns an array, (3, m), for the m values; m is 0 if the posterior at the mode is not finite. Its rows are the
    standard normal scores of the second parameter, increasing; their marginal log density by Laplace's approximation,
    up to a constant; and the most probable score of the first parameter given each.
    """
    others = np.setdiff1d(np.arange(mode.z.size), [second])
    index = int(np.searchsorted(others, first))
    points: list[tuple[float, float, float]] = []
    for sign in (-1.0, 1.0):
        z, step, highest = mode.z.copy(), FIRST_STEP * float(mode.sd()[second]), -np.inf
        for _ in range(MOST_STEPS):
            try:
                top = ridge_point(mode, target.reflected, z, others)
            except Refusal:
                break
            z[others] = top.x
            log_density = top.value - 0.5 * float(np.linalg.slogdet(top.information)[1])
            points.append((float(z[second]), log_density, float(top.x[index])))
            highest = max(highest, log_density)
            if log_density < highest - RIDGE_END_NATS:
                break
            z[second] += sign * step
            step *= STEP_GROWTH
    _, unique = np.unique([p[0] for p in points], return_index=True)  # both sides begin at the mode
    return np.reshape(points, (-1, 3))[unique].T


@dataclass(frozen=True)
class Shear:
    """A map from straight scores, in which a curved ridge of the posterior is straight, to standard normal scores.

    A shear with unit determinant leads from straight scores to level scores; the map of the noise parameters
    (`NoiseMap`) leads from these to standard normal scores. Level scores are straight scores plus a quadratic form, ½
    aᵀ C a. Here a, (k,), are the wide scores minus their values at `centre`; `shear_of` chooses the wide scores, which
    have large posterior sds. Each level score has its own matrix C, which is zero for the wide scores and for those
    that must not be negative.

    Attributes
    ----------
    centre : ndarray, shape (d,)
        Point at which the quadratic form and its derivative are zero.
    wide : ndarray of int, shape (k,)
        Indices of the wide scores, along which the ridge extends.
    curve : ndarray, shape (d, k, k)
        The matrices C of the quadratic form, one for each score.
    noise : NoiseMap
        The map of the parameters of the noise.

    References
    ----------
    The twisted normal of Haario, Saksman and Tamminen, 1999; a coupling of Dinh, 2014.
    """

    centre: np.ndarray
    wide: np.ndarray
    curve: np.ndarray
    noise: NoiseMap

    @classmethod
    def of_noise(cls, target: Target, mode: Mode) -> Shear:
        """Return a `Shear` that straightens no ridge and only maps the noise parameters (`NoiseMap`)."""
        d, none = mode.z.size, np.arange(0)
        return cls(np.zeros(d), none, np.zeros((d, 0, 0)), NoiseMap.of(target, mode))

    def scores(self, straight: np.ndarray) -> np.ndarray:
        """Convert straight scores to standard normal scores, (..., d) each.

        Straight scores are coordinates in which a curved ridge of the posterior is straight.
        """
        return self.noise.scores(self.level(straight))

    def level(self, straight: np.ndarray) -> np.ndarray:
        """Convert straight scores to level scores, (..., d) each.

        Straight scores are coordinates in which a curved ridge of the posterior is straight. Level scores are standard
        normal scores, except for two noise parameters (see `NoiseMap`).
        """
        return straight + self._shift(straight) if self.wide.size else straight

    def straight(self, scores: np.ndarray) -> np.ndarray:
        """Convert standard normal scores to straight scores, (..., d) each.

        Straight scores are coordinates in which a curved ridge of the posterior is straight.
        """
        level = self.noise.level(scores)
        return level - self._shift(level) if self.wide.size else level

    def slope(self, straight: np.ndarray) -> np.ndarray:
        """Return the derivatives of standard normal scores (rows) by straight scores (columns), (d, d).

        straight: the straight scores at one point, (d,): coordinates in which a curved ridge of the posterior is
        straight.
        """
        return self.noise.slope(self.level(straight)) @ (np.eye(straight.size) + self._bending(straight))

    def log_volume(self, straight: np.ndarray) -> np.ndarray:
        """Return the log determinant of the derivatives of standard normal scores by straight scores, (...).

        Added to the log density of standard normal scores, it gives the log density of straight scores at the same
        point. straight: the straight scores, (..., d), in which a curved ridge of the posterior is straight.
        """
        return self.noise.log_volume(self.level(straight))

    def volume_slope(self, straight: np.ndarray) -> np.ndarray:
        """Return the derivatives of `log_volume` by the d straight scores, (d,), at one point `straight`, (d,)."""
        slope = self.noise.volume_slope(self.level(straight))
        return slope + slope @ self._bending(straight)

    def _bending(self, straight: np.ndarray) -> np.ndarray:
        """Return the derivatives of `_shift` (rows) by straight scores (columns), (d, d).

        straight: one point in straight scores, (d,), in which a curved ridge of the posterior is straight.
        """
        bending = np.zeros((straight.size, straight.size))
        bending[:, self.wide] = self.curve @ (straight - self.centre)[self.wide]
        return bending

    def _shift(self, z: np.ndarray) -> np.ndarray:
        """Return the quadratic form, (..., d), that is added to straight scores to get level scores (see `Shear`).

        z: straight or level scores, (..., d). Both give the same result, because it depends only on the wide scores,
        which are equal in both.
        """
        away = z[..., self.wide] - self.centre[self.wide]
        both = away[..., :, None] * away[..., None, :]
        size = self.wide.size**2
        return 0.5 * both.reshape(*both.shape[:-2], size) @ self.curve.reshape(-1, size).T


def shear_of(target: Target, mode: Mode) -> Shear | None:
    """Return the shear that straightens the ridge of a posterior; None if its bend is below `VISIBLE_BEND`.

    A ridge occurs if the record determines only one combination of parameters, such as gravity and stiffness of the
    horizontal pendulum. It extends along the wide scores: the standard normal scores of the motion's parameters
    (without half-normal priors) with the largest posterior sds. The first wide score has the largest sd, the next one
    the largest conditional sd given the first. For each value of the wide scores, the ridge is the maximum of the
    posterior over all other scores. Its curvature is measured by second differences at `CURVATURE_SDS` posterior sds
    from the mode.

    None is also returned if there are fewer than `RIDGE_DIMENSIONS` wide scores, if all other scores have half-normal
    priors, or if the posterior on the ridge is not finite. NUTS, bridge sampling and importance sampling use the shear
    if their results without it are poor.
    """
    reflected, d = target.reflected, mode.z.size
    covariance = mode.factor @ mode.factor.T
    moving = [n in target.oscillator.parameters for n in target.names]
    among, remaining = np.flatnonzero(~reflected & moving), covariance.copy()
    widest: list[int] = []
    for _ in range(min(RIDGE_DIMENSIONS, among.size)):
        i = int(among[int(np.argmax(np.diag(remaining)[among]))])
        if remaining[i, i] <= 1e-12:
            break
        widest.append(i)
        remaining = remaining - np.outer(remaining[:, i], remaining[:, i]) / remaining[i, i]
    wide = np.array(widest, int)
    others = np.setdiff1d(np.arange(d), wide)
    if wide.size < min(RIDGE_DIMENSIONS, d) or np.all(reflected[others]):
        return None
    root = np.linalg.cholesky(covariance[np.ix_(wide, wide)])
    noise, k = NoiseMap.of(target, mode), wide.size
    curve = np.zeros((d, k, k))
    try:
        top = _ridge(target, mode, noise, wide, others, np.zeros(k))
        for a in range(k):
            for b in range(a + 1):
                step = CURVATURE_SDS * (root[:, a] + root[:, b]) / (2 if a == b else np.sqrt(2))
                ends = [_ridge(target, mode, noise, wide, others, sign * step) for sign in (1, -1)]
                curve[others, a, b] = curve[others, b, a] = (ends[0] + ends[1] - 2 * top) / CURVATURE_SDS**2
    except Refusal:
        return None
    curve[reflected] = 0.0
    # The second derivative along (e_a + e_b)/√2 is the mixed derivative plus half the sum of the other two.
    for a in range(k):
        for b in range(a):
            curve[:, a, b] = curve[:, b, a] = curve[:, a, b] - 0.5 * (curve[:, a, a] + curve[:, b, b])
    sheared = np.linalg.solve(mode.factor, noise.slope(noise.level(mode.z)) @ curve.reshape(d, -1))
    if 0.5 * np.max(np.abs(sheared)) < VISIBLE_BEND:
        return None
    inverse = np.linalg.inv(root)
    curve = np.einsum("jab,ac,bd->jcd", curve, inverse, inverse)
    return Shear(mode.z.copy(), wide, curve, noise)


def _ridge(
    target: Target, mode: Mode, noise: NoiseMap, wide: np.ndarray, others: np.ndarray, step: np.ndarray
) -> np.ndarray:
    """Return the point of a posterior's ridge at which the wide scores differ from the mode by `step`.

    The posterior is maximised over the other scores, with the wide ones fixed. wide, others: indices of the k wide
    scores, along which the ridge extends (see `Shear`), and of the d − k others. step: change of the wide scores, (k,).
    The result contains only the scores `others`, (d − k,), as level scores (see `NoiseMap`). Raises Refusal if the
    posterior is not finite there.
    """
    information = np.linalg.inv(mode.factor @ mode.factor.T)
    inner = information[np.ix_(others, others)]
    z = mode.z.copy()
    z[wide] += step
    z[others] -= np.linalg.solve(inner, information[np.ix_(others, wide)] @ step)
    z[others] = ridge_point(mode, target.reflected, z, others).x
    return noise.level(z)[others]


@dataclass(frozen=True)
class Whitening:
    """The map from coordinates u, in which the posterior is nearly N(0, I), to straight scores, centre + factor @ u.

    NUTS and emcee move in u. Straight scores are coordinates in which a curved ridge of the posterior is straight;
    `shear` maps them to standard normal scores.

    Attributes
    ----------
    centre : ndarray, shape (d,)
        Straight scores at u = 0.
    factor : ndarray, shape (d, d)
        Cholesky factor of the approximate posterior covariance of straight scores.
    lacking : ndarray, shape (d, d)
        Difference of two negative Hessians of the log posterior by straight scores, at the centre: the full one minus
        that for a motion that is linearised there. It is 0 if one of them is not finite or was not computed.
    good : bool
        False if one of these two Hessians is not finite (NUTS then uses exact gradients); True also if they were not
        computed.
    shear : Shear
        Map from straight scores to standard normal scores.
    """

    centre: np.ndarray
    factor: np.ndarray
    lacking: np.ndarray
    good: bool
    shear: Shear

    def straight(self, u: np.ndarray) -> np.ndarray:
        """Convert coordinates u to straight scores, centre + factor @ u, (..., d) each.

        The posterior is nearly N(0, I) in u. Straight scores are coordinates in which a curved ridge of the posterior
        is straight.
        """
        return self.centre + u @ self.factor.T

    def scores(self, u: np.ndarray) -> np.ndarray:
        """Convert coordinates u, in which the posterior is nearly N(0, I), to standard normal scores, (..., d) each."""
        return self.shear.scores(self.straight(u))

    def log_volume(self, u: np.ndarray) -> np.ndarray:
        """Return the log determinant of the derivatives of standard normal scores by straight scores, (...).

        u: coordinates, (..., d), in which the posterior is nearly N(0, I). Straight scores are centre + factor @ u; the
        log determinant of `factor`, a constant, is not included.
        """
        return self.shear.log_volume(self.straight(u))

    def whitened(self, z: np.ndarray) -> np.ndarray:
        """Convert standard normal scores z to coordinates u, in which the posterior is nearly N(0, I), (m, d) each."""
        return np.linalg.solve(self.factor, (self.shear.straight(z) - self.centre).T).T


def whitening_of(target: Target, mode: Mode, shear: Shear | None = None) -> Whitening:
    """Return coordinates in which a posterior is nearly standard normal, from gradient and full Hessian near its mode.

    If the Hessian is not finite, the Gauss–Newton covariance is used instead (`Whitening.good` is then False). If the
    model allows for deviations from its laws, the posterior is a mixture that one Hessian does not describe; mean and
    covariance are then those of the draws in `Mode.linear`.

    Parameters
    ----------
    target : Target
        The record, the model and its priors.
    mode : Mode
        Mode of the posterior.
    shear : Shear, optional
        Map that straightens the ridge of the posterior, from `shear_of`; by default only the map of the noise
        parameters.

    Returns
    -------
    Whitening
        The map between these coordinates and the standard normal scores of the parameters.
    """
    d = mode.z.size
    shear = Shear.of_noise(target, mode) if shear is None else shear
    if mode.linear is not None:
        level = shear.straight(mode.linear.draws)
        factor = np.linalg.cholesky(np.atleast_2d(np.cov(level.T)))
        return Whitening(level.mean(axis=0), factor, np.zeros((d, d)), True, shear)
    centre, factor = truncated_about(target, mode, shear).moments
    whole = negative_hessian(lambda x: slope_at(mode.near, shear, x), centre, factor, HESSIAN_STEP)
    line, level = mode.near.line(shear.scores(centre)), shear.level(centre)
    linear = negative_hessian(
        lambda x: slope_along(mode.near, line, shear.noise, level + x - centre), centre, factor, HESSIAN_STEP
    )
    if not (np.all(np.isfinite(whole)) and np.all(np.isfinite(linear))):
        return Whitening(centre, factor, np.zeros((d, d)), False, shear)
    values, vectors = np.linalg.eigh(whole)
    inverse = np.linalg.inv(factor)
    root = factor @ vectors / np.sqrt(np.maximum(values, LEAST_CURVATURE))
    normal = TruncatedNormal(centre, slope_at(mode.near, shear, centre), root @ root.T, target.reflected)
    return Whitening(centre, normal.moments[1], inverse.T @ (whole - linear) @ inverse, True, shear)


def expansion(target: Target, mode: Mode, shear: Shear) -> tuple[np.ndarray, np.ndarray]:
    """Return the centre, (d,), and the Cholesky factor of the covariance, (d, d), of a normal distribution at the mode.

    Both are in straight scores, in which a curved ridge of the posterior is straight. The centre is the mode. Scores
    with half-normal priors are replaced by their absolute values, at least 1e-12. The covariance is that of
    `Mode.factor`. There is one exception: if `shear` maps the noise parameters, it makes the second of them standard
    normal; this score then has mean 0 and variance 1 and is independent of the others.
    """
    at = shear.straight(np.where(target.reflected, np.maximum(np.abs(mode.z), 1e-12), mode.z))
    if shear.noise.table is None:
        return at, mode.factor
    second, rest = shear.noise.second, np.delete(np.arange(at.size), shear.noise.second)
    factor = np.eye(at.size)
    root = np.linalg.qr(np.linalg.solve(shear.slope(at), mode.factor)[rest].T)[1]
    factor[np.ix_(rest, rest)] = (root * np.sign(np.diag(root))[:, None]).T
    at[second] = 0.0
    return at, factor


def slope_at(likelihood: Likelihood, shear: Shear, at: np.ndarray) -> np.ndarray:
    """Return the gradient, (d,), of the log posterior density of straight scores at one point `at`, (d,).

    Straight scores are coordinates in which a curved ridge of the posterior is straight; `shear` maps them to standard
    normal scores. Because the density is per unit of straight scores, the log determinant of this map is part of it.
    """
    return likelihood.gradient(shear.scores(at))[1] @ shear.slope(at) + shear.volume_slope(at)


def slope_along(likelihood: Likelihood, line: Line, noise: NoiseMap, level: np.ndarray) -> np.ndarray:
    """Return the gradient, (d,), of the log posterior density of level scores at one point `level`, (d,).

    Level scores are standard normal scores, except for two noise parameters (see `NoiseMap`). The motion is not
    computed there but extrapolated from `line`, the motion linearised at another point. A linear motion has no curved
    ridge, so only the map of the noise parameters, `noise`, applies.
    """
    along = likelihood.gradient_along(line, noise.scores(level))
    return along @ noise.slope(level) + noise.volume_slope(level)


def truncated_about(target: Target, mode: Mode, shear: Shear) -> TruncatedNormal:
    """Return a truncated normal distribution of straight scores near the mode.

    Straight scores are coordinates in which a curved ridge of the posterior is straight. Before the truncation the
    distribution has the covariance of `expansion`; its log density has the same gradient as the log posterior at the
    centre of `expansion`. Scores with half-normal priors are restricted to values ≥ 0.
    """
    at, factor = expansion(target, mode, shear)
    return TruncatedNormal(at, slope_at(mode.near, shear, at), factor @ factor.T, target.reflected)


def whitening_under(mode: Mode, combination: int, shear: Shear) -> Whitening:
    """Return coordinates in which a posterior is nearly standard normal, given one combination of hyperparameters.

    Hyperparameters are the sizes (prior standard deviations) and correlation lengths of the deviations of damping and
    frequency from the laws; `combination` is the index of one combination in `Target.deviation`, from 0. Mean and
    covariance come from the gradient and the Gauss–Newton information of this conditional log posterior at the mode;
    scores of half-normal priors are restricted to values ≥ 0. shear: map from straight to standard normal scores, which
    the result contains; it changes the mean but not the covariance.
    """
    reflected, d = mode.likelihood.target.reflected, mode.z.size
    at = np.where(reflected, np.maximum(np.abs(mode.z), 1e-12), mode.z)
    _, gradient, information = mode.near.under(combination).curvature(at)
    centre, factor = TruncatedNormal(at, gradient, np.linalg.inv(information), reflected).moments
    return Whitening(shear.straight(centre), factor, np.zeros((d, d)), True, shear)
