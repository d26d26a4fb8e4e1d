"""Compute the evidence by nested sampling with nautilus; it decides if importance and bridge sampling disagree."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtri

from bayesdamp.inference.evidence._method import Draws, EvidenceMethod
from bayesdamp.inference.mode import Mode, log_evidence_about
from bayesdamp.inference.model.target import Target
from bayesdamp.types import OK, Evidence

if TYPE_CHECKING:
    from nautilus import Sampler

LIVE_POINTS = 500
"""Number of live points of nested sampling (conventional)."""
EFFECTIVE_DRAWS = 2500
"""Effective number of posterior draws at which a run of nested sampling ends; the log evidence then has a standard
error of 0.02 nats."""
MAX_LIKELIHOODS = 400_000
"""Number of evaluations of the likelihood after which an unfinished run of nested sampling is stopped; its result is
then unreliable."""
LIKELIHOODS_PER_CHECK = 20_000
"""After each of this many evaluations of the likelihood, it is estimated whether a run that starts from the prior can
finish within `MAX_LIKELIHOODS`; if not, the run ends."""
WIDE_FACTOR = 5.0
"""If a run of nested sampling from the prior cannot finish, a second one starts from a normal distribution about the
mode, which is wider than the posterior by this factor."""
LIKELIHOODS_PER_BATCH = 250
"""Number of points at which nested sampling evaluates the likelihood in one call."""
MAX_GAP_NATS = 3.0
"""A run of nested sampling has missed the mode if the largest likelihood of all its points is more than this many nats
below the likelihood at the mode. A run that found the mode has points within about a nat of it, because it ends with
`EFFECTIVE_DRAWS` draws. The likelihood here is the posterior density divided by the prior of the sampler."""
LOG_2PI = float(np.log(2 * np.pi))
LEAST_LOG_DENSITY = -1e300
"""Log density (nats) that replaces −∞ and nan, such as for an unbounded motion, because the sampler does not accept
infinities."""

Map = Callable[[np.ndarray], np.ndarray]


class NestedSampling(EvidenceMethod):
    """Importance nested sampling (Lange, Monthly Notices of the Royal Astronomical Society 525, 2023) from the prior.

    The unit cube of the sampler is mapped to standard normal scores of the parameters. Scores of coefficients that
    cannot be negative are mapped to the positive half of a normal distribution; otherwise the posterior would have a
    second, mirrored mode at negative scores. Coefficients with a common, unknown prior scale have another prior than
    N(0, 1); the ratio of the two is part of the likelihood. A model with one parameter gets a second one without
    effect, because the sampler needs two. The bounds of the sampler are ellipsoids. (Its neural networks need fewer
    likelihoods, but a small network was seen to cut off the peak and to report success. Therefore the largest
    likelihood of the run is compared with that at the mode.)

    If the prior is so much wider than the posterior that the run cannot finish, a second run starts from a normal
    distribution about the mode, five times as wide as the posterior. Its integral is the same, but it can miss other
    modes.
    """

    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Compute the evidence by nested sampling from the prior or, if this cannot finish, from around the mode.

        The outcome is not "ok" if the last run does not finish within `MAX_LIKELIHOODS`, or if it missed the mode
        (`MAX_GAP_NATS`). `draws` are not used.
        """
        reflected, likelihood = target.reflected, mode.likelihood
        best = np.where(reflected, np.abs(mode.z), mode.z)
        factor = WIDE_FACTOR * mode.factor

        def over_prior(z: np.ndarray) -> np.ndarray:
            """Return log(prior times likelihood / standard normal density), (n,), at scores z, (n, d)."""
            return _finite(likelihood.log_posteriors(z) - standard_normal(z))

        def over_normal(z: np.ndarray) -> np.ndarray:
            """Return log(prior times likelihood / density of the wide normal), (n,), at scores z, (n, d).

            The normal is about the mode, with the Cholesky factor `factor` of its covariance.
            """
            left = np.linalg.solve(factor, (z - best).T)
            log = likelihood.folded(z) - standard_normal(left.T) + np.linalg.slogdet(factor)[1]
            return _finite(np.where(np.all(z[:, reflected] >= 0.0, axis=1), log, -np.inf))

        top = float(over_prior(mode.z[None])[0])
        # The posterior's volume is about exp(evidence - top) times the prior's volume.
        needed = top - log_evidence_about(mode)
        # The quantile of a half-normal at u is that of the normal at (1 + u)/2.
        sampler, done = run_sampler(
            lambda u: ndtri(np.where(reflected, 0.5 * (1.0 + u), u)), over_prior, best.size, seed, needed
        )
        count, fallback_note = sampler.n_like, ""
        if not done and count < MAX_LIKELIHOODS:  # the run ended early, because it could not finish
            top = float(over_normal(best[None])[0])
            sampler, done = run_sampler(lambda u: best + ndtri(u) @ factor.T, over_normal, best.size, seed)
            count += sampler.n_like
            fallback_note = ", started around the mode, because a run from the prior would not finish"
        effective, highest = float(np.asarray(sampler.n_eff)), max(float(np.max(x)) for x in sampler.log_l)
        outcome = OK
        if not done:
            outcome = f"not to be trusted: not finished after {count} evaluations of the likelihood"
        elif top - highest > MAX_GAP_NATS:
            gap = f"{top - highest:.0f} nats above that of all its points"
            outcome = f"not to be trusted: the run missed the mode, whose log density is {gap}"
        return Evidence(
            model=model,
            method=self.name,
            log_evidence=float(np.asarray(sampler.log_z)),
            stderr=effective**-0.5,
            diagnostic=f"{effective:.0f} effective draws from {count} evaluations of the likelihood{fallback_note}",
            evaluations=int(count),
            outcome=outcome,
        )


def standard_normal(z: np.ndarray) -> np.ndarray:
    """Return the standard normal log density, (n,), of scores z, (n, d)."""
    return -0.5 * np.sum(z**2, axis=1) - 0.5 * z.shape[1] * LOG_2PI


def _finite(log: np.ndarray) -> np.ndarray:
    """Return log densities in which −∞, nan and all values below `LEAST_LOG_DENSITY` are replaced by this value."""
    return np.maximum(np.nan_to_num(log, nan=-np.inf), LEAST_LOG_DENSITY)


def run_sampler(
    points: Map, density: Map, d: int, seed: int, needed: float | None = None
) -> tuple[Sampler, bool]:
    """Run nautilus (without neural networks); return its sampler and whether it reached `EFFECTIVE_DRAWS`.

    points: map from the unit cube, (n, d), to scores, (n, d). density: function that returns, at scores, the log of the
    integrand divided by the density from which `points` draws, (n,). d: number of scores. needed: estimate, in nats, of
    the log of the prior's volume divided by the posterior's. The run ends early if its progress shows that it would
    need more than `MAX_LIKELIHOODS` evaluations to shrink the volume this much. None for no such check.
    """
    from nautilus import Sampler

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings about bounds that cannot be split further
        sampler = Sampler(
            lambda u: points(u[..., :d]),
            density,
            n_dim=max(d, 2),
            n_live=LIVE_POINTS,
            n_networks=0,
            n_batch=LIKELIHOODS_PER_BATCH,
            vectorized=True,
            seed=seed,
        )
        log_compression = 0.0
        while True:
            limit = MAX_LIKELIHOODS
            if needed is not None:
                limit = min(limit, sampler.n_like + LIKELIHOODS_PER_CHECK)
            done = bool(sampler.run(n_eff=EFFECTIVE_DRAWS, n_like_max=limit, discard_exploration=True))
            if done or sampler.n_like >= MAX_LIKELIHOODS:
                return sampler, done
            known = sampler.shell_log_v[np.isfinite(sampler.shell_log_v)]
            # Nats by which the log volume of the innermost bound is below that of the unit cube.
            before, log_compression = log_compression, -float(known.min()) if known.size else 0.0
            checks = (MAX_LIKELIHOODS - sampler.n_like) / LIKELIHOODS_PER_CHECK
            slow = needed is not None and needed - log_compression > checks * (log_compression - before)
            if slow and not sampler.explored and before > 0.0:
                return sampler, False


PLUGIN = NestedSampling()
