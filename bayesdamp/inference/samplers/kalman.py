"""Online estimation: an unscented Kalman filter with static damping parameters, and its restarts."""

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
"""Mean and sd of a reflected score under its prior."""
PASSES = 20
SETTLED = 0.01
"""Shift of the final mean between two passes, in its sds, at which restarting ends."""
SHOWN = 300
"""Number of times at which a running estimate is stored."""


@dataclass(frozen=True)
class Online:
    """The filter's estimates of the k moving scores.

    Means and sds after each sample, (n, k), and the last covariance, (k, k).
    """

    means: np.ndarray
    sds: np.ndarray
    covariance: np.ndarray


def filter_online(target: Target, mode: Mode) -> Online:
    """Run the filter once from the priors, with each sample used once and in its turn.

    The state is (scores, θ, θ̇) without process noise. Its sigma points, 2(k + 2) at √(k + 2) sds with equal weights
    (Julier and Uhlmann's with κ = 0), are drawn again after each sample and moved to the next one by the kernel. A
    reflected score starts with mean and sd of a half-normal: about zero the filter would see no slope. A scale that
    coefficients share is fixed at 1, a damping ratio of 0.1. The sd of the noise is that of the mode.
    """
    index, signal = target.moving, target.signal
    k, order = index.size, QUANTITIES.index(signal.quantity)
    reflected = target.reflected[index]
    mean = np.where(reflected, HALF_NORMAL[0], 0.0)
    sd = np.where(reflected, HALF_NORMAL[1], 1.0)
    noise, z, motions = target.all_values(mode.z)["noise_sd"], mode.z.copy(), mode.likelihood.motions

    def values(u: np.ndarray) -> dict[str, float]:
        z[index] = u  # the noise's own scores stay at the mode
        return target.all_values(z)

    def moved(x: np.ndarray, gap: float) -> tuple[np.ndarray, float]:
        p = {**values(x[:k]), "theta0": float(x[k]), "omega0": float(x[k + 1])}
        state = motions.after(p, gap)
        return np.concatenate([x[:k], state[:2]]), float(state[order])

    away = math.sqrt(k) * np.diag(sd)
    started = [(u, values(u)) for u in np.concatenate([mean + away, mean - away])]
    points = np.array([[*u, p["theta0"], p["omega0"]] for u, p in started])
    mean = points.mean(axis=0)
    covariance = (points - mean).T @ (points - mean) / (2 * k)
    means, sds = np.empty((signal.t.size, k)), np.empty((signal.t.size, k))
    for i, (y, gap) in enumerate(zip(signal.y.tolist(), np.r_[0.0, np.diff(signal.t)].tolist(), strict=True)):
        # By eigenvectors of the correlations: at first θ and θ̇ follow from the scores, and no Cholesky factor exists.
        sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        lengths, axes = np.linalg.eigh(covariance / sd[:, None] / sd)
        away = math.sqrt(mean.size) * sd[:, None] * axes * np.sqrt(np.maximum(lengths, 0.0))
        pairs = [moved(x, gap) for x in np.concatenate([mean + away.T, mean - away.T])]
        points, predicted = np.array([x for x, _ in pairs]), np.array([v for _, v in pairs])
        mean, expected = points.mean(axis=0), float(predicted.mean())
        about, off = points - mean, predicted - expected
        variance = float(np.mean(off**2)) + noise**2
        gain = about.T @ off / off.size / variance
        mean = mean + gain * (y - expected)
        covariance = about.T @ about / off.size - variance * np.outer(gain, gain)
        covariance = 0.5 * (covariance + covariance.T)
        means[i], sds[i] = mean[:k], np.sqrt(np.maximum(np.diag(covariance)[:k], 0.0))
        if not np.all(np.isfinite(covariance)):
            means[i:], sds[i:] = np.nan, np.nan
            break
    return Online(means, sds, covariance[:k, :k])


@dataclass(frozen=True)
class Restarted:
    """The last pass of the restarted filter.

    Means (n, k) and covariances (n, k, k) of the moving scores after each sample, without truncation at zero; `final`:
    the distribution after the whole record; `passes`: their number.
    """

    means: np.ndarray
    covariances: np.ndarray
    final: TruncatedNormal
    passes: int


class Kalman(Sampler):
    """Running estimates of static parameters together with θ and θ̇, and the posterior at their end.

    The first pass is the online one: an unscented Kalman filter from the priors, without process noise. Priors are wide
    compared with a record, so the filter cannot correct later what it infers from the early samples: its damping is off
    by up to several sds. The filter is therefore run again from the priors over the same record, with its sigma points
    one sd to each side of where the pass before ended, until the final mean settles (iterated posterior linearisation:
    García-Fernández, Svensson and Särkkä, IEEE Transactions on Automatic Control 62, 2017). Static parameters and no
    process noise make such a pass a linear Kalman filter whose measurements are the trajectories of the sigma points.
    Coefficients are reflected at zero: the final normal is truncated there.

    The sd of the noise is not filtered: it is drawn from its Laplace approximation at the mode. The scale that the
    coefficients' priors share is fixed: in the first pass at a damping ratio of 0.1, in the others where it is most
    probable given the mode. Apart from these, only the length of the solver's steps is taken from the mode. Noise is
    independent and normal.
    """

    name = "kalman"
    approximate = True

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Return draws from an unscented Kalman filter and its restarts. Raises Refusal under exact friction."""
        if target.oscillator.switches and target.known.get("epsilon") == 0.0:
            raise Refusal(
                "kalman needs ε above 0, because its sigma points do not stick; give epsilon, or leave it free"
            )
        if target.deviation is not None:
            raise Refusal(
                'not applicable: kalman assumes that laws hold exactly; give deviation "none" to use it'
            )
        if target.noise != "gaussian":
            raise Refusal(f"kalman assumes independent and normal noise, and here it is {target.noise}")
        online = filter_online(target, mode)
        last = _restart(target, mode, online)
        index = target.moving
        rng = np.random.default_rng(settings.seed)
        n = settings.chains * settings.draws
        sd = 1.0 / np.sqrt(np.diag(mode.information))
        white = rng.standard_normal((n, mode.z.size))
        z, log_density = mode.z + white * sd, -0.5 * white**2
        z[:, index] = last.final.draw(rng, n)
        log_density = np.delete(log_density, index, axis=1).sum(axis=1) + last.final.log_density(z[:, index])
        names = tuple(target.names[i] for i in index)
        passes = {"passes": last.passes}
        posterior = approximate_posterior(self.name, target, mode, z, log_density, settings, more=passes)
        # Means and sds in natural units against time, (m, k): coefficients are truncated at zero, each on its own.
        at = np.unique(np.linspace(0, target.signal.t.size - 1, SHOWN).astype(int))
        sds = np.sqrt(np.diagonal(last.covariances, axis1=1, axis2=2))
        arrays = {"running/t": target.signal.t[at]}
        for label, means, spread in (("online", online.means, online.sds), ("restarted", last.means, sds)):
            pairs = [natural(target.priors[n], means[at, i], spread[at, i]) for i, n in enumerate(names)]
            arrays[f"running/{label}/mean"] = np.stack([m for m, _ in pairs], axis=1)
            arrays[f"running/{label}/sd"] = np.stack([s for _, s in pairs], axis=1)
        return replace(posterior, running=names, arrays=arrays)


def _restart(target: Target, mode: Mode, online: Online) -> Restarted:
    """Run passes from the priors with sigma points where the pass before ended.

    Raises Refusal where they do not settle.
    """
    index = target.moving
    k, y = len(index), target.signal.y
    reflected = target.reflected[index]
    noise = target.all_values(mode.z)["noise_sd"]
    # One shared scale represents all of them near the mode.
    scale = mode.near.scales[0]
    prior = np.diag(np.where(target.shared[index], scale**-2.0, 1.0))
    # The first pass may end on the mirrored side of a reflected score.
    side = np.where(reflected & (online.means[-1] < 0), -1.0, 1.0)
    if not (np.all(np.isfinite(online.means[-1])) and np.all(np.diag(online.covariance) > 0)):
        raise Refusal("the filter lost the motion in its first pass: its covariance is no longer positive")
    now = TruncatedNormal(side * online.means[-1], side[:, None] * online.covariance * side, reflected)
    for passes in range(1, PASSES + 1):
        mean, factor = now.moments
        points = np.tile(mode.z, (2 * k + 1, 1))
        points[:, index] = np.concatenate([mean[None], mean + factor.T, mean - factor.T])
        motions = y - mode.likelihood.residuals(points)
        if not np.all(np.isfinite(motions)):
            raise Refusal("the restarted filter met a motion that escapes")
        # Each sample as a linear function of the scores: its expected value, slope and residual variance.
        middle, above, below = motions[0], motions[1 : k + 1], motions[k + 1 :]
        expected = middle + 0.5 * np.sum(above + below - 2 * middle, axis=0)
        rise = 0.5 * (above - below)
        whole = 0.5 * np.sum((above - expected) ** 2 + (below - expected) ** 2, axis=0)
        left = whole + (1 - k) * (middle - expected) ** 2 - np.sum(rise**2, axis=0)
        slope, variance = np.linalg.solve(factor.T, rise).T, np.maximum(left, 0.0)
        weight = 1.0 / (noise**2 + variance)
        pull = np.cumsum((weight * (y - expected + slope @ mean))[:, None] * slope, axis=0)
        gathered = np.cumsum(weight[:, None, None] * slope[:, :, None] * slope[:, None, :], axis=0)
        covariances = np.linalg.inv(prior + gathered)
        means = np.einsum("nij,nj->ni", covariances, pull)
        now = TruncatedNormal(means[-1], covariances[-1], reflected)
        new, width = now.moments
        if np.max(np.abs(np.linalg.solve(width, new - mean))) < SETTLED:
            return Restarted(means, covariances, now, passes)
    raise Refusal(f"the restarted filter did not settle in {PASSES} passes")


def natural(prior: Prior, mean: np.ndarray, sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and sd of a parameter whose score is normal, (m,), and truncated at zero where it is reflected."""
    x, w = np.polynomial.legendre.leggauss(64)
    mean = np.abs(mean) if prior.reflected else mean
    share = log_ndtr(mean / sd) if prior.reflected else np.zeros(mean.size)
    tail = share[:, None] + np.log(0.5 * (1 - x))
    values = np.asarray(prior.value(mean[:, None] - sd[:, None] * ndtri_exp(tail)))
    first = values @ (0.5 * w)
    return first, np.sqrt((values - first[:, None]) ** 2 @ (0.5 * w))


PLUGIN = Kalman()
