"""Compute the Cramér–Rao bound: the smallest standard deviation that an unbiased estimator can have."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayesdamp.estimators.shared import free_names, oscillator
from bayesdamp.physics.trajectories import Trajectories
from bayesdamp.types import Problem

SINGULAR = 1e-8
"""Combinations of parameters whose singular value is below this fraction of the largest are not determined by the
record (measured: rounding gives 1e-9 for such a combination; a pendulum without known parameters has 1e-5)."""


def cramer_rao(
    problem: Problem,
    parameters: Mapping[str, float],
    times: np.ndarray,
    noise_sd: float,
    quantity: str = "angle",
) -> dict[str, float]:
    """Compute the Cramér–Rao bound: the smallest standard deviation of an unbiased estimate of each unknown parameter.

    For independent normal noise the Fisher information is JᵀJ/σ², where J (n, k) has the derivatives of the n samples
    by the k unknowns: the damping coefficients, and every restoring parameter, theta0 and omega0 that is not in
    `problem.system.known`. Known parameters, parameters of damping terms other than their coefficients, and the width ε
    of the smoothed sign in dry friction have no error.

    Parameters
    ----------
    problem
        The damping terms, and the known parameters of the system.
    parameters
        The true value of every parameter of the oscillator, by name (`Oscillator.parameters`).
    times
        Times of the samples, s, shape (n,), not decreasing; the motion starts at times[0].
    noise_sd
        Standard deviation of the noise, in the unit of the quantity.
    quantity
        "angle", "velocity" or "acceleration".

    Returns
    -------
    dict
        The bound by parameter, in the parameter's unit; inf if the record does not determine the parameter.

    Raises
    ------
    ValueError
        If the noise is not positive or the trajectory diverges.
    """
    osc = oscillator(problem)
    if not noise_sd > 0:
        raise ValueError(f"noise_sd = {noise_sd!r} must be positive: without noise there is no bound")
    p = {name: float(parameters[name]) for name in osc.parameters}
    names = (*osc.coefficients, *free_names(problem))
    slopes = Trajectories(osc, times, quantity, p, 0.0).with_slopes(p, names)[1]
    if not np.all(np.isfinite(slopes)):
        raise ValueError("the trajectory is unbounded for these parameters, so there is no Cramér–Rao bound")

    # Columns of J in units of the noise, then scaled to unit length.
    j = slopes.T / noise_sd
    scale = np.linalg.norm(j, axis=0)
    informed = scale > 0
    _, singular, v = np.linalg.svd(j[:, informed] / scale[informed], full_matrices=False)
    undetermined_directions = singular <= SINGULAR * singular.max(initial=0.0)
    inverse = np.where(undetermined_directions, 0.0, 1 / np.where(undetermined_directions, 1.0, singular))
    variance = np.full(len(names), np.inf)
    variance[informed] = np.sum((v.T * inverse) ** 2, axis=1) / scale[informed] ** 2
    undetermined = np.any(np.abs(v.T[:, undetermined_directions]) > 1e-6, axis=1)
    variance[np.flatnonzero(informed)[undetermined]] = np.inf
    return dict(zip(names, np.sqrt(variance).tolist()))
