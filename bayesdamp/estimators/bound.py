"""The Cramér–Rao bound: the smallest standard deviation that an unbiased estimator can have."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayesdamp.estimators.shared import free_names, oscillator
from bayesdamp.physics.kernel.solve import QUANTITIES
from bayesdamp.physics.trajectories import Trajectories
from bayesdamp.types import Problem

SINGULAR = 1e-8
"""Directions of the scaled parameters with singular values below this share of the largest are not determined
(measured: rounding leaves 1e-9 of such a direction, and a pendulum of which nothing is known has 1e-5)."""


def cramer_rao(
    problem: Problem,
    parameters: Mapping[str, float],
    times: np.ndarray,
    noise_sd: float,
    quantity: str = "angle",
) -> dict[str, float]:
    """Compute the smallest standard deviation of each unknown parameter.

    The Fisher information of samples with independent normal noise is JᵀJ/σ², J (n, k) the derivatives of the
    samples by the unknowns: the damping coefficients and those of the restoring parameters, theta0 and omega0
    that are not in `problem.system.known`. What is known, and ε, is taken as exact.

    Parameters
    ----------
    problem
        The damping terms, and what is known of the system.
    parameters
        The true value of every parameter of the oscillator.
    times
        Times of the samples, s, shape (n,), not decreasing; the motion starts at times[0].
    noise_sd
        Standard deviation of the noise, in the unit of the quantity.
    quantity
        "angle", "velocity" or "acceleration".

    Returns
    -------
    dict
        Parameter to its bound, in the parameter's unit; inf if the record does not determine the parameter.

    Raises
    ------
    ValueError
        If a parameter is missing, the noise is not positive, the quantity is unknown or the trajectory escapes.
    """
    osc = oscillator(problem)
    missing = [name for name in osc.parameters if name not in parameters]
    if missing:
        raise ValueError(f"parameter {missing[0]!r} is missing; needed are {', '.join(osc.parameters)}")
    if not noise_sd > 0:
        raise ValueError(f"noise_sd = {noise_sd!r} must be positive: without noise there is no bound")
    if quantity not in QUANTITIES:
        raise ValueError(f"quantity {quantity!r} is none of {', '.join(QUANTITIES)}")
    p = {name: float(parameters[name]) for name in osc.parameters}
    names = (*osc.coefficients, *free_names(problem))
    slopes = Trajectories(osc, times, quantity, p, 0.0).with_slopes(p, names)[1]
    if not np.all(np.isfinite(slopes)):
        raise ValueError("the trajectory escapes: it has no bound")

    j = slopes.T / noise_sd
    scale = np.linalg.norm(j, axis=0)
    informed = scale > 0
    _, singular, v = np.linalg.svd(j[:, informed] / scale[informed], full_matrices=False)
    lost = singular <= SINGULAR * singular.max(initial=0.0)
    inverse = np.where(lost, 0.0, 1 / np.where(lost, 1.0, singular))
    variance = np.full(len(names), np.inf)
    variance[informed] = np.sum((v.T * inverse) ** 2, axis=1) / scale[informed] ** 2
    undetermined = np.any(np.abs(v.T[:, lost]) > 1e-6, axis=1)
    variance[np.flatnonzero(informed)[undetermined]] = np.inf
    return dict(zip(names, np.sqrt(variance).tolist()))
