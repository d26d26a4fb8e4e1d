"""A sampler that estimates constant parameters by an unscented Kalman filter, which is repeated until it converges."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import log_ndtr, ndtri_exp

from bayesdamp.inference.coordinates.truncated_normal import TruncatedNormal
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._approximation import approximate_posterior
from bayesdamp.inference.samplers._sampler import Sampler, Settings
from bayesdamp.physics.kernel.solve import QUANTITIES
from bayesdamp.priors import Prior
from bayesdamp.types import Posterior, Refusal

HALF_NORMAL = (math.sqrt(2 / math.pi), math.sqrt(1 - 2 / math.pi))
"""Mean and standard deviation of the half-normal prior of a score that cannot be negative, with which the filter
starts."""
MOST_PASSES = 20
"""Greatest number of passes of the Kalman filter over the record; if it has not converged by then, sampling ends with a
Refusal."""
SETTLED_SDS = 0.01
"""The filter has converged if the mean after the last sample changes from one pass to the next by less than this, in
posterior standard deviations."""
STORED_TIMES = 300
"""Number of times in the record at which the running estimates of the Kalman filter are stored."""


@dataclass(frozen=True)
class FilterPass:
    """Estimates of the k parameters of the motion after each of the n samples of a record.

    Parameters are represented by scores, which have a standard normal prior. means, covariances: of the scores after
    each sample, before the truncation at zero, (n, k) and (n, k, k); nan from the sample at which the filter diverged.
    """

    means: np.ndarray
    covariances: np.ndarray


def filter_online(target: Target, mode: Mode) -> FilterPass:
    """Estimate the k parameters of the motion after each sample, by one pass of an unscented Kalman filter.

    The filter starts from the priors. The estimates are nan from the sample at which it diverges.

    The state consists of the parameters as standard normal scores, θ and θ̇, without process noise. After each sample,
    2(k + 2) sigma points at √(k + 2) standard deviations with equal weights (Julier and Uhlmann, κ = 0) are computed
    and propagated to the next sample by the ODE solver. The score of a coefficient that cannot be negative starts with
    the mean and sd of a half-normal prior, because the derivative by it is zero at zero. The common prior scale of
    coefficients is fixed at 1 (a damping ratio of 0.1). The parameters of the noise have their values at the mode.
    """
    index, signal = target.moving, target.signal
    k, order = index.size, QUANTITIES.index(signal.quantity)
    reflected = target.reflected[index]
    mean = np.where(reflected, HALF_NORMAL[0], 0.0)
    sd = np.where(reflected, HALF_NORMAL[1], 1.0)
    noise, z, motions = target.all_values(mode.z)["noise_sd"], mode.z.copy(), mode.likelihood.motions

    def values(u: np.ndarray) -> dict[str, float]:
        z[index] = u  # the scores of the noise stay at the mode
        return target.all_values(z)

    def propagate(x: np.ndarray, gap: float) -> tuple[np.ndarray, float]:
        p = {**values(x[:k]), "theta0": float(x[k]), "omega0": float(x[k + 1])}
        state = motions.after(p, gap)
        return np.concatenate([x[:k], state[:2]]), float(state[order])

    away = math.sqrt(k) * np.diag(sd)
    started = [(u, values(u)) for u in np.concatenate([mean + away, mean - away])]
    points = np.array([[*u, p["theta0"], p["omega0"]] for u, p in started])
    mean = points.mean(axis=0)
    covariance = (points - mean).T @ (points - mean) / (2 * k)
    means, covariances = np.full((signal.t.size, k), np.nan), np.full((signal.t.size, k, k), np.nan)
    for i, (y, gap) in enumerate(zip(signal.y.tolist(), np.r_[0.0, np.diff(signal.t)].tolist(), strict=True)):
        # At first θ and θ̇ are functions of the scores, so the covariance is singular and has no Cholesky factor:
        # sigma points are along the eigenvectors of the correlation matrix.
        sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        lengths, axes = np.linalg.eigh(covariance / sd[:, None] / sd)
        away = math.sqrt(mean.size) * sd[:, None] * axes * np.sqrt(np.maximum(lengths, 0.0))
        pairs = [propagate(x, gap) for x in np.concatenate([mean + away.T, mean - away.T])]
        points, predicted = np.array([x for x, _ in pairs]), np.array([v for _, v in pairs])
        mean, expected = points.mean(axis=0), float(predicted.mean())
        about, off = points - mean, predicted - expected
        variance = float(np.mean(off**2)) + noise**2
        gain = about.T @ off / off.size / variance
        mean = mean + gain * (y - expected)
        covariance = about.T @ about / off.size - variance * np.outer(gain, gain)
        covariance = 0.5 * (covariance + covariance.T)
        if not np.all(np.isfinite(covariance)):
            break
        means[i], covariances[i] = mean[:k], covariance[:k, :k]
    return FilterPass(means, covariances)


class Kalman(Sampler):
    """Kalman filter that estimates constant parameters while the record goes on, and their posterior at its end.

    The first pass gives the online estimates, by an unscented Kalman filter that starts from the priors. Because the
    priors are wide, its linearisation in the early samples is poor, and its damping is wrong by up to several standard
    deviations. The filter is therefore repeated over the record from the priors, with sigma points one standard
    deviation about the result of the pass before, until the final mean converges (iterated posterior linearisation:
    García-Fernández, Svensson and Särkkä, IEEE Transactions on Automatic Control 62, 2017). Without process noise such
    a pass is a linear Kalman filter on the trajectories of the sigma points. The final normal distribution is truncated
    where a coefficient is zero.

    The noise must be independent and normal. Its standard deviation is drawn from Laplace's approximation at the mode.
    The common prior scale of coefficients is fixed: in the first pass at a damping ratio of 0.1, then at its most
    probable value given the mode.
    """

    name = "kalman"
    approximate = True

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Return draws from the distribution of the parameters after the last sample, and the running estimates.

        The running estimates are in `Posterior.arrays`: times `running/t` in s, and mean and sd of the parameters in
        `Posterior.running` after these samples, of the first pass (`running/online/...`) and of the last one
        (`running/restarted/...`), (times, parameters) each, in the units of the parameters.

        Raises Refusal for dry friction that changes its sign abruptly (ε = 0), if the model allows for deviations from
        its laws, for noise that is not Gaussian, and if the filter diverges or does not converge.
        """
        if target.oscillator.switches and target.known.get("epsilon") == 0.0:
            raise Refusal(
                "kalman does not apply to exact dry friction (epsilon 0), because sigma points cannot represent "
                "sticking; give epsilon a value above 0, or leave it free"
            )
        if target.deviation is not None:
            raise Refusal(
                'not applicable: kalman assumes exact laws of damping and force; use deviation "none"'
            )
        if target.noise != "gaussian":
            raise Refusal(
                f"kalman assumes independent, normal noise, but the noise model is {target.noise}; use nuts"
            )
        online = filter_online(target, mode)
        last, passes = _repeat(target, mode, online)
        index = target.moving
        final = TruncatedNormal(last.means[-1], last.covariances[-1], target.reflected[index])
        rng = np.random.default_rng(settings.seed)
        n = settings.chains * settings.draws
        sd = 1.0 / np.sqrt(np.diag(mode.information))
        white = rng.standard_normal((n, mode.z.size))
        z, log_density = mode.z + white * sd, -0.5 * white**2
        z[:, index] = final.draw(rng, n)
        log_density = np.delete(log_density, index, axis=1).sum(axis=1) + final.log_density(z[:, index])
        names = tuple(target.names[i] for i in index)
        more = {"passes": passes}
        posterior = approximate_posterior(self.name, target, mode, z, log_density, settings, more=more)
        # Running means and sds in natural units, (m, k); each coefficient is truncated at zero separately.
        at = np.unique(np.linspace(0, target.signal.t.size - 1, STORED_TIMES).astype(int))
        arrays = {"running/t": target.signal.t[at]}
        for label, result in (("online", online), ("restarted", last)):
            means = result.means[at]
            sds = np.sqrt(np.maximum(np.diagonal(result.covariances[at], axis1=1, axis2=2), 0.0))
            pairs = [natural_moments(target.priors[n], means[:, i], sds[:, i]) for i, n in enumerate(names)]
            arrays[f"running/{label}/mean"] = np.stack([m for m, _ in pairs], axis=1)
            arrays[f"running/{label}/sd"] = np.stack([s for _, s in pairs], axis=1)
        return replace(posterior, running=names, arrays=arrays)


def _repeat(target: Target, mode: Mode, online: FilterPass) -> tuple[FilterPass, int]:
    """Repeat the filter over the record from the priors until its final mean converges.

    Returns the last pass, and the number of passes. online: estimates of the first pass; the sigma points of the next
    pass are about its final estimate. Raises Refusal if the first pass diverged, if a motion is unbounded, or if the
    filter does not converge in `MOST_PASSES`.
    """
    index = target.moving
    k, y = len(index), target.signal.y
    reflected = target.reflected[index]
    noise = target.all_values(mode.z)["noise_sd"]
    # The common scale is fixed at its most probable value near the mode.
    scale = mode.near.scales[0]
    prior = np.diag(np.where(target.shared[index], scale**-2.0, 1.0))
    # The first pass may end at a negative value of a reflected score, which is equivalent.
    side = np.where(reflected & (online.means[-1] < 0), -1.0, 1.0)
    if not np.all(np.diag(online.covariances[-1]) > 0):
        raise Refusal(
            "the Kalman filter diverged in its first pass: its covariance is not positive definite; use nuts"
        )
    now = TruncatedNormal(side * online.means[-1], side[:, None] * online.covariances[-1] * side, reflected)
    for passes in range(1, MOST_PASSES + 1):
        mean, factor = now.moments
        points = np.tile(mode.z, (2 * k + 1, 1))
        points[:, index] = np.concatenate([mean[None], mean + factor.T, mean - factor.T])
        motions = y - mode.likelihood.residuals(points)
        if not np.all(np.isfinite(motions)):
            raise Refusal("the repeated Kalman filter reached parameters with an unbounded motion; use nuts")
        # Approximate each sample as a linear function of the scores: expected value, slope, and residual variance.
        middle, above, below = motions[0], motions[1 : k + 1], motions[k + 1 :]
        expected = middle + 0.5 * np.sum(above + below - 2 * middle, axis=0)
        half_difference = 0.5 * (above - below)
        whole = 0.5 * np.sum((above - expected) ** 2 + (below - expected) ** 2, axis=0)
        left = whole + (1 - k) * (middle - expected) ** 2 - np.sum(half_difference**2, axis=0)
        slope, variance = np.linalg.solve(factor.T, half_difference).T, np.maximum(left, 0.0)
        weight = 1.0 / (noise**2 + variance)
        weighted_sum = np.cumsum((weight * (y - expected + slope @ mean))[:, None] * slope, axis=0)
        information = np.cumsum(weight[:, None, None] * slope[:, :, None] * slope[:, None, :], axis=0)
        covariances = np.linalg.inv(prior + information)
        means = np.einsum("nij,nj->ni", covariances, weighted_sum)
        now = TruncatedNormal(means[-1], covariances[-1], reflected)
        new, width = now.moments
        if np.max(np.abs(np.linalg.solve(width, new - mean))) < SETTLED_SDS:
            return FilterPass(means, covariances), passes
    raise Refusal(f"the repeated Kalman filter did not converge in {MOST_PASSES} passes; use nuts")


def natural_moments(prior: Prior, mean: np.ndarray, sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return means and sds of a parameter, in its unit, from those of its score, which is normal; (m,) each.

    mean, sd: means and sds of the score, (m,) each. The score is the parameter transformed to a standard normal prior.
    If the parameter cannot be negative (`prior.reflected`), the absolute value of the mean is used, and the score is
    truncated at zero.
    """
    x, w = np.polynomial.legendre.leggauss(64)
    mean = np.abs(mean) if prior.reflected else mean
    log_inside = log_ndtr(mean / sd) if prior.reflected else np.zeros(mean.size)
    tail = log_inside[:, None] + np.log(0.5 * (1 - x))
    values = np.asarray(prior.value(mean[:, None] - sd[:, None] * ndtri_exp(tail)))
    first = values @ (0.5 * w)
    return first, np.sqrt((values - first[:, None]) ** 2 @ (0.5 * w))


PLUGIN = Kalman()
