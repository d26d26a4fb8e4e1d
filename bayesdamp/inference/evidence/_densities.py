"""Densities at many scores, in batches of one size so that they share a compilation."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from bayesdamp.inference.mode import Mode
from bayesdamp.inference.target import LOG_2PI, Target, compiled

CHUNK = 250


def log_posterior(target: Target, mode: Mode, z: np.ndarray) -> np.ndarray:
    """Log prior plus log likelihood at scores z, (n, d), on the mode's plan; −∞ where the trajectory escapes."""
    padded = np.pad(z, ((0, -len(z) % CHUNK), (0, 0)), mode="edge")
    batch = compiled(target.layout).batch
    chunks = np.split(padded, len(padded) // CHUNK)
    density = np.concatenate([np.asarray(batch(mode.context, jnp.asarray(c))) for c in chunks])[: len(z)]
    return np.where(np.isfinite(density), density, -np.inf)


def log_likelihood(target: Target, mode: Mode, z: np.ndarray) -> np.ndarray:
    """The same without the prior."""
    return log_posterior(target, mode, z) + 0.5 * np.sum(z**2, axis=-1) + 0.5 * z.shape[-1] * LOG_2PI


def folded_log_posterior(target: Target, mode: Mode, y: np.ndarray) -> np.ndarray:
    """The density of scores y, (n, d), of which the folded ones are not negative: they have all the mass of both
    mirror images on one side, log 2 more each."""
    return log_posterior(target, mode, y) + np.sum(target.layout.folded) * np.log(2.0)
