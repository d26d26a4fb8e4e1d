"""Densities at many scores, in batches of one size so that all of them share a compilation."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from bayesdamp.inference.model.compiled import compiled
from bayesdamp.inference.model.target import Context, Target
from bayesdamp.priors import log_prior_of

if TYPE_CHECKING:
    from jax import Array

CHUNK = 250


def in_batches(fun: Callable[[Any], Array], z: np.ndarray) -> np.ndarray:
    """fun, of batches (CHUNK, d) to (CHUNK,), over scores z, (n, d): shape (n,)."""
    padded = np.pad(z, ((0, -len(z) % CHUNK), (0, 0)), mode="edge")
    return np.concatenate([np.asarray(fun(c)) for c in np.split(padded, len(padded) // CHUNK)])[: len(z)]


def log_posterior(target: Target, context: Context, z: np.ndarray) -> np.ndarray:
    """Log prior plus log likelihood at scores z, (n, d), on the context's plan; −∞ where the trajectory escapes."""
    batch = compiled(target.layout).batch
    density = in_batches(lambda part: batch(context, part), z)
    return np.where(np.isfinite(density), density, -np.inf)


def log_prior(target: Target, z: np.ndarray) -> np.ndarray:
    """Log density of scores z, (..., d), shape (...); of reflected ones as if they could have either sign."""
    none = np.zeros(len(target.names), bool)
    return log_prior_of(z, none, target.shared, np.asarray(target.scales))


def log_likelihood(target: Target, context: Context, z: np.ndarray) -> np.ndarray:
    """Log density of the record at scores z, (n, d), in nats."""
    return log_posterior(target, context, z) - log_prior(target, z)
