"""Residuals of a record against trajectories, and how they look to its noise model."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES, NoiseModel
from bayesdamp.physics.solver.plan import Plan


def residual(target: Target, plan: Plan, z: np.ndarray) -> np.ndarray:
    """Record minus trajectory at scores z, (d,): shape (n,), in the unit of the record."""
    return target.signal.y - plan.at_samples(target.oscillator, target.all_values(z))


def residuals(target: Target, plan: Plan, z: np.ndarray) -> np.ndarray:
    """The same at many scores, (m, d): shape (m, n)."""
    every = {**{n: np.full(len(z), float(v)) for n, v in target.known.items()}, **target.values(z)}
    return target.signal.y - plan.many_at_samples(target.oscillator, every)


def whitened(target: Target, r: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return residuals r, (n,) or (m, n), as independent standard scores at scores z, (d,) or (m, d)."""
    noise, gaps, values = _noise(target, z)
    return noise.whiten(r, gaps, values)


def log_density(target: Target, r: np.ndarray, z: np.ndarray) -> float:
    """Return the log density of residuals r, (n,), at scores z, (d,), in nats; −∞ where it is not finite."""
    noise, gaps, values = _noise(target, z)
    with np.errstate(all="ignore"):
        log = float(noise.log_likelihood(r, gaps, values))
    return log if np.isfinite(log) else -np.inf


def information(target: Target, change: np.ndarray, z: np.ndarray) -> float:
    """Return the noise's Fisher information about a shift of the record by `change`, (n,), at scores z, (d,).

    The shift costs half as many nats.
    """
    noise, gaps, values = _noise(target, z)
    return float(np.sum(np.square(noise.information_root(change, gaps, values))))


def _noise(target: Target, z: np.ndarray) -> tuple[NoiseModel, np.ndarray, dict[str, np.ndarray]]:
    """Return the noise model, the gaps (s) and the values of its parameters and constants at scores z, (..., d)."""
    noise = NOISES.get(target.noise)
    every = {**{n: np.asarray(float(v)) for n, v in target.known.items()}, **target.values(z)}
    values = {n: every[n] for n in (*noise.parameters, *noise.constants)}
    return noise, np.diff(target.signal.t), values
