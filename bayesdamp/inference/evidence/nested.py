"""Nested sampling (nautilus), which knows nothing of the mode: the referee."""

from __future__ import annotations

import time
import warnings

import numpy as np
from scipy.special import ndtri

from bayesdamp.inference.batches import CHUNK, log_likelihood
from bayesdamp.inference.evidence._method import Draws, EvidenceMethod
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.target import Target
from bayesdamp.types import OK, Evidence

LIVE = 500
EFFECTIVE = 2500
"""Effective draws to end with: an error of 0.02 nats."""
MOST = 400_000
"""Likelihoods after which a run gives up."""
MISSED = 3.0
"""Nats by which its highest likelihood may stay below the mode's; of so many draws one comes within a nat."""
FAINTEST = -1e300
"""What a trajectory that escapes counts as: the sampler takes no infinities."""


class Nested(EvidenceMethod):
    """Importance nested sampling (Lange, Monthly Notices of the Royal Astronomical Society 525, 2023) over the prior.

    The unit cube is mapped to normal scores, half-normal ones where they are folded: mirror modes do not arise. One
    parameter alone gets an idle one beside it, as the sampler needs two. Bounds are ellipsoids without the networks
    that nautilus offers: these take fewer likelihoods, but likelihoods are cheap here, and a small one was seen to cut
    the peak off and call the rest finished. So the highest likelihood is held against the mode's.
    """

    name = "nested"

    def evidence(
        self, model: str, target: Target, mode: Mode, seed: int, draws: Draws | None = None
    ) -> Evidence:
        from nautilus import Sampler

        began = time.perf_counter()
        folded = np.asarray(target.layout.folded)
        d = folded.size

        def likelihood(z: np.ndarray) -> np.ndarray:
            return np.maximum(np.nan_to_num(log_likelihood(target, mode.context, z), nan=-np.inf), FAINTEST)

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of bounds that cannot be split further
            sampler = Sampler(
                lambda u: scores(u[..., :d], folded),
                likelihood,
                n_dim=max(d, 2),
                n_live=LIVE,
                n_networks=0,
                n_batch=CHUNK,
                vectorized=True,
                seed=seed,
            )
            done = sampler.run(n_eff=EFFECTIVE, n_like_max=MOST, discard_exploration=True)
        effective, top = float(np.asarray(sampler.n_eff)), max(float(np.max(x)) for x in sampler.log_l)
        missed = float(log_likelihood(target, mode.context, mode.z[None])[0]) - top
        outcome = OK
        if not done:
            outcome = f"not to be trusted: not finished after {sampler.n_like} likelihoods"
        elif missed > MISSED:
            outcome = f"not to be trusted: it missed a mode {missed:.0f} nats above all that it saw"
        return Evidence(
            model=model,
            method=self.name,
            log_evidence=float(np.asarray(sampler.log_z)),
            stderr=effective**-0.5,
            diagnostic=f"{effective:.0f} effective draws of {sampler.n_like} likelihoods",
            evaluations=int(sampler.n_like),
            seconds=time.perf_counter() - began,
            outcome=outcome,
        )


def scores(u: np.ndarray, folded: np.ndarray) -> np.ndarray:
    """Scores of points of the unit cube, both (..., d): normal, or half-normal where folded."""
    return ndtri(np.where(folded, 0.5 * (1.0 + u), u))


PLUGIN = Nested()
