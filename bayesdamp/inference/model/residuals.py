"""Residuals of a record against trajectories, and how they look to its noise model."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.numerics.lazily import jax
from bayesdamp.physics.solver.plan import Plan


def residual(target: Target, plan: Plan, z: np.ndarray) -> np.ndarray:
    """Record minus trajectory at scores z, (d,): shape (n,), in the unit of the record."""
    return target.signal.y - plan.at_samples(target.oscillator, target.all_values(z))


def residuals(target: Target, plan: Plan, z: np.ndarray) -> np.ndarray:
    """The same at many scores, (m, d): shape (m, n)."""
    every = {**{n: np.full(len(z), float(v)) for n, v in target.known.items()}, **target.values(z)}
    return target.signal.y - plan.many_at_samples(target.oscillator, every)


def whitened(target: Target, r: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Residuals r, (n,) or (m, n), as independent standard scores under the noise at scores z, (d,) or (m, d)."""
    one, many = _whitening(target.noise)
    values = _noise_values(target, z)
    gaps = np.diff(target.signal.t)
    if z.ndim == 1:
        return np.asarray(one(r, gaps, values))
    values = {n: np.broadcast_to(v, len(z)) for n, v in values.items()}
    return np.asarray(many(r, gaps, values))


def log_density(target: Target, r: np.ndarray, z: np.ndarray) -> float:
    """Log density of residuals r, (n,), at scores z, (d,), in nats; −∞ where there is none."""
    found = float(log_density_under(target.noise)(r, np.diff(target.signal.t), _noise_values(target, z)))
    return found if np.isfinite(found) else -np.inf


def information(target: Target, change: np.ndarray, z: np.ndarray) -> float:
    """The noise's Fisher information about a shift of the record by `change`, (n,), at scores z, (d,): a shift by it
    is worth half as many nats."""
    root = _information_root(target.noise)(change, np.diff(target.signal.t), _noise_values(target, z))
    return float(np.sum(np.square(root)))


def _noise_values(target: Target, z: np.ndarray) -> Mapping[str, np.ndarray]:
    noise = NOISES.get(target.noise)
    wanted = (*noise.parameters, *noise.constants)
    every = {**{n: np.asarray(float(v)) for n, v in target.known.items()}, **target.values(z)}
    return {n: every[n] for n in wanted}


@lru_cache(maxsize=16)
def _whitening(name: str):
    """Compiled, of a noise model: whitened residuals, and those of many; no solver is in them."""
    noise = NOISES.get(name)
    return jax.jit(noise.whiten), jax.jit(jax.vmap(noise.whiten, in_axes=(0, None, 0)))


@lru_cache(maxsize=16)
def _information_root(name: str):
    return jax.jit(NOISES.get(name).information_root)


@lru_cache(maxsize=16)
def log_density_under(name: str):
    """Compiled, of a noise model: (residuals (n,), gaps (n − 1,), its values by name) to the log density in nats."""
    return jax.jit(NOISES.get(name).log_likelihood)
