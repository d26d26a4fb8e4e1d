"""Nested sampling (nautilus), which is independent of importance and bridge sampling and decides between them."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtri

from bayesdamp.inference.evidence._method import Draws, EvidenceMethod
from bayesdamp.inference.mode import Mode, log_evidence_about
from bayesdamp.inference.model.target import Target
from bayesdamp.types import OK, Evidence, Refusal

if TYPE_CHECKING:
    from nautilus import Sampler

LIVE = 500
EFFECTIVE = 2500
"""Effective draws at the end: an error of 0.02 nats."""
MOST = 400_000
"""Likelihoods after which a run gives up."""
LEG = 20_000
"""Likelihoods between checks of whether a run from the prior can finish."""
WIDER = 5.0
"""Standard deviations of the normal distribution about a mode that is sampled, in those of the posterior's normal."""
BATCH = 250
"""Likelihoods in a batch."""
MISSED = 3.0
"""Nats by which the highest likelihood may be below the mode's; one of so many draws comes within a nat of it."""
LOG_2PI = float(np.log(2 * np.pi))
FAINTEST = -1e300
"""Log density of a motion that escapes: the sampler does not accept infinities."""

Map = Callable[[np.ndarray], np.ndarray]


class Nested(EvidenceMethod):
    """Importance nested sampling (Lange, Monthly Notices of the Royal Astronomical Society 525, 2023) over the prior.

    The unit cube is mapped to normal scores, half-normal ones where they are reflected, so that no mirror modes arise.
    Coefficients that share a scale have another prior, whose ratio to this one is part of the likelihood. A single
    parameter gets an idle second one, because the sampler needs two. Bounds are ellipsoids, without the networks that
    nautilus offers: networks need fewer likelihoods, but likelihoods are cheap here, and a small network was seen to
    cut off the peak and to report the rest as finished. The highest likelihood is therefore compared with the mode's.

    Under wide priors, the posterior of a record of many cycles is too narrow to be found. Where the prior's volume
    falls too slowly for the remaining likelihoods, the run starts again from a normal distribution about the mode that
    is five times as wide as the posterior, and says so. The integral is the same, without other modes.
    """

    name = "nested"

    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """Compute the evidence by importance nested sampling (nautilus; Lange 2023)."""
        reflected, likelihood = target.reflected, mode.likelihood
        best = np.where(reflected, np.abs(mode.z), mode.z)
        try:
            expected = log_evidence_about(mode)
        except Refusal:
            expected = None

        def over_prior(z: np.ndarray) -> np.ndarray:
            return _finite(likelihood.log_posteriors(z) - standard_normal(z))

        def over_normal(z: np.ndarray) -> np.ndarray:
            """Return the log of prior times likelihood over the density of the normal distribution about the mode."""
            left = np.linalg.solve(factor, (z - best).T)
            log = likelihood.folded(z) - standard_normal(left.T) + np.linalg.slogdet(factor)[1]
            return _finite(np.where(np.all(z[:, reflected] >= 0.0, axis=1), log, -np.inf))

        top, factor = float(over_prior(mode.z[None])[0]), WIDER * mode.factor
        needed = None if expected is None else top - expected
        # A reflected score has its half-normal prior, twice the normal one, on its side of zero.
        sampler, done = _explored(
            lambda u: ndtri(np.where(reflected, 0.5 * (1.0 + u), u)), over_prior, best.size, seed, needed
        )
        count, how = sampler.n_like, ""
        if not done and count < MOST:
            top = float(over_normal(best[None])[0])
            sampler, done = _explored(lambda u: best + ndtri(u) @ factor.T, over_normal, best.size, seed)
            count += sampler.n_like
            how = ", around the mode: from the prior the run would not finish"
        effective, highest = float(np.asarray(sampler.n_eff)), max(float(np.max(x)) for x in sampler.log_l)
        outcome = OK
        if not done:
            outcome = f"not to be trusted: not finished after {count} likelihoods"
        elif top - highest > MISSED:
            gap = f"{top - highest:.0f} nats above all of its points"
            outcome = f"not to be trusted: it missed a mode {gap}"
        return Evidence(
            model=model,
            method=self.name,
            log_evidence=float(np.asarray(sampler.log_z)),
            stderr=effective**-0.5,
            diagnostic=f"{effective:.0f} effective draws of {count} likelihoods{how}",
            evaluations=int(count),
            outcome=outcome,
        )


def standard_normal(z: np.ndarray) -> np.ndarray:
    """Return the log density, (n,), of scores z, (n, d), under N(0, 1) in every direction."""
    return -0.5 * np.sum(z**2, axis=1) - 0.5 * z.shape[1] * LOG_2PI


def _finite(log: np.ndarray) -> np.ndarray:
    return np.maximum(np.nan_to_num(log, nan=-np.inf), FAINTEST)


def _explored(
    points: Map, density: Map, d: int, seed: int, needed: float | None = None
) -> tuple[Sampler, bool]:
    """Run a sampler, and return it and whether it finished.

    needed: nats by which its volume has to fall; where that would take too many likelihoods, the run ends early.
    """
    from nautilus import Sampler

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # bounds that cannot be split further
        sampler = Sampler(
            lambda u: points(u[..., :d]),
            density,
            n_dim=max(d, 2),
            n_live=LIVE,
            n_networks=0,
            n_batch=BATCH,
            vectorized=True,
            seed=seed,
        )
        fallen = 0.0
        while True:
            limit = MOST if needed is None else min(MOST, sampler.n_like + LEG)
            done = bool(sampler.run(n_eff=EFFECTIVE, n_like_max=limit, discard_exploration=True))
            if done or sampler.n_like >= MOST:
                return sampler, done
            known = sampler.shell_log_v[np.isfinite(sampler.shell_log_v)]
            # Nats by which the volume of the innermost bound is below the prior's.
            before, fallen = fallen, -float(known.min()) if known.size else 0.0
            legs = (MOST - sampler.n_like) / LEG
            slow = needed is not None and needed - fallen > legs * (fallen - before)
            if slow and not sampler.explored and before > 0.0:
                return sampler, False


PLUGIN = Nested()
