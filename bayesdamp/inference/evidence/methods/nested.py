"""Nested sampling (nautilus), which takes nothing from importance or bridge sampling: the referee."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtri

from bayesdamp.inference.evidence._method import Draws, EvidenceMethod
from bayesdamp.inference.fit.laplace import log_evidence_about
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.types import OK, Evidence, Refusal

if TYPE_CHECKING:
    from nautilus import Sampler

LIVE = 500
EFFECTIVE = 2500
"""Effective draws to end with: an error of 0.02 nats."""
MOST = 400_000
"""Likelihoods after which a run gives up."""
LEG = 20_000
"""Likelihoods after which it is asked whether a run from the prior will come to its end."""
WIDER = 5.0
"""Around a mode, the standard deviations of what is sampled from in those of the posterior's normal."""
BATCH = 250
"""Likelihoods that are asked for at a time."""
MISSED = 3.0
"""Nats by which its highest likelihood may stay below the mode's; of so many draws one comes within a nat."""
LOG_2PI = float(np.log(2 * np.pi))
FAINTEST = -1e300
"""What a trajectory that escapes counts as: the sampler takes no infinities."""

Map = Callable[[np.ndarray], np.ndarray]


class Nested(EvidenceMethod):
    """Importance nested sampling (Lange, Monthly Notices of the Royal Astronomical Society 525, 2023) over the prior.

    The unit cube is mapped to normal scores, half-normal ones where they are reflected: mirror modes do not arise. The
    prior of coefficients that share a scale is another: its ratio to this one is part of the likelihood. One parameter
    alone gets an idle one beside it, as the sampler needs two. Bounds are ellipsoids without the networks that nautilus
    offers: these take fewer likelihoods, but likelihoods are cheap here, and a small one was seen to cut the peak off
    and call the rest finished. So the highest likelihood is held against the mode's.

    A record of many cycles under wide priors is a needle that this would not find: where the prior's volume falls too
    slowly for the likelihoods that are left, it begins anew from a normal distribution five times as wide as the
    posterior about the mode, and says so. The integral is the same; other modes are not looked for.
    """

    name = "nested"

    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        """By importance nested sampling (nautilus; Lange 2023)."""
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
            found = likelihood.folded(z) - standard_normal(left.T) + np.linalg.slogdet(factor)[1]
            return _finite(np.where(np.all(z[:, reflected] >= 0.0, axis=1), found, -np.inf))

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
            how = ", around the mode: from the prior it would not come to its end"
        effective, seen = float(np.asarray(sampler.n_eff)), max(float(np.max(x)) for x in sampler.log_l)
        outcome = OK
        if not done:
            outcome = f"not to be trusted: not finished after {count} likelihoods"
        elif top - seen > MISSED:
            outcome = f"not to be trusted: it missed a mode {top - seen:.0f} nats above all that it saw"
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
    """Log density N(0, 1) of scores z, (n, d), in every direction: (n,)."""
    return -0.5 * np.sum(z**2, axis=1) - 0.5 * z.shape[1] * LOG_2PI


def _finite(log: np.ndarray) -> np.ndarray:
    return np.maximum(np.nan_to_num(log, nan=-np.inf), FAINTEST)


def _explored(
    points: Map, density: Map, d: int, seed: int, needed: float | None = None
) -> tuple[Sampler, bool]:
    """A sampler after its run, and whether that came to its end.

    needed: nats by which its volume has to fall; where that would take too many likelihoods, the run ends early.
    """
    from nautilus import Sampler

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of bounds that cannot be split further
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
