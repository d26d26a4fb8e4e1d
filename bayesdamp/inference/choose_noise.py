"""Which noise model a record's residuals speak for: evidence in the noise parameters, the trajectory held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jax import numpy as jnp
from scipy.optimize import minimize

from bayesdamp.inference.noise import NOISES
from bayesdamp.signals.features import Features

STEP = 0.02
"""Scores over which second differences are taken."""
LEAST = 1.0
"""Nats by which a model with more parameters must lead: below that a tie, which the simpler one wins."""


@dataclass(frozen=True)
class Choice:
    """The noise model of a record; log_evidence: nats by model, all at the same residuals; why: one sentence."""

    noise: str
    log_evidence: dict[str, float]
    why: str


def choose_noise(
    r: np.ndarray, gaps: np.ndarray, features: Features, among: Sequence[str] = ("gaussian", "correlated")
) -> Choice:
    """The noise model that residuals r (n,), with gaps (s, (n − 1,)) between them, speak for.

    Laplace's evidence over each model's own parameters under its default priors. among: from the simplest on.
    """
    found = {name: _log_evidence(name, r, gaps, features) for name in among}
    best = among[0]
    for name in among[1:]:
        if found[name] > found[best] + LEAST:
            best = name
    others = [f"{name} by {found[best] - found[name]:.1f}" for name in among if name != best]
    why = f"Noise is taken as {best.replace('_', ' ')}: ahead of {', '.join(others)} nats on the best fit's residuals"
    return Choice(best, found, why + ".")


def _log_evidence(name: str, r: np.ndarray, gaps: np.ndarray, features: Features) -> float:
    noise = NOISES.get(name)
    priors = noise.priors(features)
    residuals, between = jnp.asarray(r), jnp.asarray(gaps)

    def height(z: np.ndarray) -> float:
        p = {n: prior.value(x) for (n, prior), x in zip(priors.items(), z, strict=True)}
        value = float(noise.log_likelihood(residuals, between, p))
        normal = -0.5 * float(z @ z) - 0.5 * z.size * np.log(2 * np.pi)
        return value + normal if np.isfinite(value) else -1e300

    start = noise.start(r, gaps)
    z = np.array([float(np.clip(p.score(start[n]), -6.0, 6.0)) for n, p in priors.items()])
    z = minimize(lambda x: -height(x), z, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-4}).x
    axes = STEP * np.eye(z.size)
    hessian = np.array([[_mixed(height, z, a, b) for b in axes] for a in axes]) / STEP**2
    sign, log_det = np.linalg.slogdet(-hessian)
    if sign <= 0:
        return -np.inf
    return height(z) + 0.5 * z.size * float(np.log(2 * np.pi)) - 0.5 * float(log_det)


def _mixed(height, z: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    return 0.25 * (height(z + a + b) - height(z + a - b) - height(z - a + b) + height(z - a - b))
