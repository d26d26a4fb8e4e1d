"""Nested sampling (nautilus), which takes nothing from importance or bridge sampling: the referee."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
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
        reflected = target.reflected
        try:
            expected = log_evidence_about(mode)
        except Refusal:
            expected = None
        # A reflected score has its half-normal prior, twice the normal one, on its side of zero.
        doubled = reflected.sum() * np.log(2.0)
        density = Density(
            reflected,
            lambda z: mode.likelihood.log_posteriors(z) - standard_normal(z),
            lambda z: mode.likelihood.log_posteriors(z) + doubled,
            mode.z,
            mode.factor,
        )
        return integrated(model, self.name, density, seed, expected)


@dataclass(frozen=True)
class Density:
    """What is integrated. reflected: which scores must not be negative, (d,); posterior: log of prior times likelihood
    at scores (n, d); likelihood: the same over a density N(0, 1) of each score, folded where it is reflected; mode:
    scores, (d,), factor: of a normal's covariance about it, (d, d)."""

    reflected: np.ndarray
    likelihood: Map
    posterior: Map
    mode: np.ndarray
    factor: np.ndarray


def integrated(model: str, method: str, of: Density, seed: int, expected: float | None) -> Evidence:
    """The evidence of a density. expected: roughly its log, where that is known."""
    began = time.perf_counter()
    reflected, top = of.reflected, float(of.likelihood(of.mode[None])[0])
    needed = None if expected is None else top - expected
    sampler, done = _explored(
        lambda u: scores(u, reflected), lambda z: _finite(of.likelihood(z)), reflected.size, seed, needed
    )
    count, how = sampler.n_like, ""
    if not done and count < MOST:
        points, density = around(of)
        top = float(density(np.where(reflected, np.abs(of.mode), of.mode)[None])[0])
        sampler, done = _explored(points, density, reflected.size, seed)
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
        method=method,
        log_evidence=float(np.asarray(sampler.log_z)),
        stderr=effective**-0.5,
        diagnostic=f"{effective:.0f} effective draws of {count} likelihoods{how}",
        evaluations=int(count),
        seconds=time.perf_counter() - began,
        outcome=outcome,
    )


def standard_normal(z: np.ndarray) -> np.ndarray:
    """Log density N(0, 1) of scores z, (n, d), in every direction: (n,)."""
    return -0.5 * np.sum(z**2, axis=1) - 0.5 * z.shape[1] * LOG_2PI


def _finite(log: np.ndarray) -> np.ndarray:
    return np.maximum(np.nan_to_num(log, nan=-np.inf), FAINTEST)


def scores(u: np.ndarray, reflected: np.ndarray) -> np.ndarray:
    """Scores of points of the unit cube, both (..., d): normal, or half-normal where reflected."""
    return ndtri(np.where(reflected, 0.5 * (1.0 + u), u))


def around(of: Density) -> tuple[Map, Map]:
    """A normal distribution about a mode: points of the unit cube, (n, d), to its scores; and of scores, (n, d), the
    log of prior times likelihood over its density, whose integral over it is the evidence."""
    reflected = of.reflected
    centre, factor = np.where(reflected, np.abs(of.mode), of.mode), WIDER * of.factor
    log_det = np.linalg.slogdet(factor)[1]

    def density(z: np.ndarray) -> np.ndarray:
        normal = np.linalg.solve(factor, (z - centre).T)
        of_normal = -0.5 * np.sum(normal**2, axis=0) - 0.5 * centre.size * LOG_2PI - log_det
        found = of.posterior(z) - of_normal
        return _finite(np.where(np.all(z[:, reflected] >= 0.0, axis=1), found, -np.inf))

    return lambda u: centre + ndtri(u) @ factor.T, density


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
            before, fallen = fallen, _fallen(sampler)
            legs = (MOST - sampler.n_like) / LEG
            slow = needed is not None and needed - fallen > legs * (fallen - before)
            if slow and not sampler.explored and before > 0.0:
                return sampler, False


def _fallen(sampler: Sampler) -> float:
    """Nats by which the volume of the innermost bound is below the prior's."""
    known = sampler.shell_log_v[np.isfinite(sampler.shell_log_v)]
    return -float(known.min()) if known.size else 0.0


PLUGIN = Nested()
