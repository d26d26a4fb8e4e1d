"""Fit the solution of the equation of motion (the trajectory) to a record by least squares, from an initial estimate.

This is the second stage of every estimator. `cramer_rao` computes the smallest standard deviation that an unbiased
estimator can have."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bayesdamp.estimators.shared import (
    checked_features,
    decay_start,
    free_names,
    noise_level,
    oscillator,
    ratios_per_unit,
    start_parameters,
)
from bayesdamp.numerics.levenberg_marquardt import Expansion, Schedule, Step, levenberg_marquardt
from bayesdamp.physics.oscillator import Oscillator, Trajectories
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import OK, Estimate, Problem, Refusal, Signal, quantity_unit

MOST_RESIDUAL = 1.1
"""A misfit is reported if the rms of the residual, divided by the standard deviation of the record's noise, exceeds
this number plus 5/√(2n), which is five standard errors of this ratio for n samples."""
MOST_CORRELATION = 0.1
"""A misfit is reported if the autocorrelation of the residual at a lag of a twelfth of a period exceeds both this
number and 5/√n, which is five standard errors for n samples."""
LEAST_RESIDUAL = 1e-5
"""No misfit is reported if the rms residual is at most this fraction of the amplitude (numerical errors are much
smaller)."""
TOLERANCE = 1e-11
"""Largest error of a computed trajectory, as a fraction of the amplitude. It is so small for two reasons: records
without noise are fitted to their last digits, and the sum of squares stays smooth if the record hardly determines a
combination of parameters."""
STEPS = 400
"""Greatest number of Levenberg–Marquardt steps of a fit; if they are not enough, the outcome says that the fit did not
converge."""
SCHEDULE = Schedule(less=0.1, more=10.0)
"""Factors by which λ, the damping parameter of a Levenberg–Marquardt search, is multiplied after a step: `less` if the
step lowers the sum of squares, otherwise `more`. Such large factors are possible because the residuals are nearly
linear near the minimum."""
UNDETERMINED = 1e-7
"""The record does not determine a combination of parameters if the combination's singular value is at most this
fraction of the largest one. These are the singular values of the Jacobian, whose columns are scaled to unit length. The
number is about the relative error of the Jacobian."""
SMALL_CHANGE, SMALL_STEP, SMALL_GAIN = 1e-9, 1e-13, 1e-12
"""Limits of convergence. A search ends if a step changes the residuals by at most the first number (relative to their
norm), or lowers the sum of squares by less than the third (relative to this sum). If a step does not lower it, the
search also ends if each parameter changed by at most the second number (relative to its value)."""


class Minimum(NamedTuple):
    """The result of a search for the minimum of a sum of squares.

    x: values of the k parameters at the minimum, (k,). cost: lowest sum of squares; ∞ if the residuals at the start are
    not finite. evaluations: number of evaluations of the residuals and their Jacobian. converged: whether a limit of
    convergence ended the search; False if it ended without success, for example after the largest number of steps.
    """

    x: np.ndarray
    cost: float
    evaluations: int
    converged: bool


@dataclass(frozen=True)
class _TrajectoryFit:
    """The residuals (trajectory minus record) of one record as a function of the unknown parameters.

    names: names of the k unknowns, in the order in which a vector x (k,) has their values. base: values, by name, of
    all parameters except the damping coefficients; those of unknowns are replaced by x. size: largest amplitude of the
    record, in its unit.
    """

    signal: Signal
    osc: Oscillator
    names: tuple[str, ...]
    base: dict[str, float]
    size: float

    @cached_property
    def trajectories(self) -> Trajectories:
        """Return the solver of trajectories at the record's times, with the tolerance `TOLERANCE`."""
        return Trajectories(self.osc, self.signal.t, self.signal.quantity, self.base, TOLERANCE * self.size)

    def until(self, time: float) -> _TrajectoryFit:
        """Return the same fit for only those samples that are not later than `time` (s)."""
        early = self.signal.t <= time
        return replace(self, signal=replace(self.signal, t=self.signal.t[early], y=self.signal.y[early]))

    def _parameters(self, x: np.ndarray) -> dict[str, float]:
        return {**self.base, **dict(zip(self.names, map(float, x)))}

    def linearise(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the residuals (trajectory minus record), (n,), and their Jacobian (n, k) by the unknowns x (k,).

        The residuals are in the unit of the record. Both are NaN if the motion is unbounded.
        """
        values, slopes = self.trajectories.with_slopes(self._parameters(x), self.names)
        return values - self.signal.y, slopes.T

    def mean_square(self, x: np.ndarray) -> float:
        """Return the mean square of the residuals in the squared unit of the record; ∞ if the motion is unbounded.

        x: values of the unknowns, (k,), in the order of `names`.
        """
        r = self.trajectories.record(self._parameters(x)) - self.signal.y
        return float(np.mean(r**2)) if np.all(np.isfinite(r)) else np.inf


def refine(signal: Signal, problem: Problem, first: Estimate) -> Estimate:
    """Fit the trajectory (the solution of the equation of motion) to the record by least squares, starting at `first`.

    The unknowns are the damping coefficients, which cannot be negative, and all parameters that are not known: those of
    the restoring law, and displacement (theta0) and velocity (omega0) at the start. They start from their values in
    `first`; those that are not coefficients start from the record's features if `first` has no value, or if these fit
    better (`_start`).

    A fit has lost the phase of the record if its rms residual is at least 0.3 of the record's standard deviation. Then
    the first two cycles are fitted, and this window is doubled until it covers the whole record. If this fit loses the
    phase too, the same is done once more, from the coefficients of `decay_start` and other values from the record's
    features. The result is the fit to the whole record with the smallest sum of squares.

    A recorded velocity or acceleration determines only the difference between theta0 and a rest angle that shifts the
    restoring force (`RestoringLaw.shift`). If both are unknown, the rest angle keeps its start value, and theta0 is
    fitted for this value.

    Parameters
    ----------
    signal
        The record.
    problem
        The damping terms, and the known parameters of the system.
    first
        The estimate of the first stage, with a value for each damping coefficient, or without any value.

    Returns
    -------
    Estimate
        The values with the smallest sum of squares, and their standard errors, which assume white residuals. A
        parameter has no standard error if it is at its lower bound, or if the record does not determine it; nor have
        theta0 and the rest angle if only their difference is determined. The outcome is OK, or a sentence for each of
        these problems: the search did not converge; a coefficient is at its lower bound 0; the record does not
        determine a parameter; the residual is larger or more correlated than noise (`misfit`).

    Raises
    ------
    Refusal
        If `first` has no values, if the trajectory is unbounded for every start, or if the record has no oscillation or
        too few samples.
    InputError
        If no oscillation is possible with the known restoring parameters.
    """
    if not first.values:
        raise Refusal(f"no initial estimate to refine: {first.outcome}")
    features = checked_features(signal)
    osc = oscillator(problem)
    base = start_parameters(signal, problem, features)
    unknown = free_names(problem)
    shift = osc.law.shift
    held = {}
    if signal.quantity != "angle" and shift in unknown and "theta0" in unknown:
        held = {shift: base[shift]}
        unknown.remove(shift)
        if {shift, "theta0"} <= set(first.values):
            start = first.values["theta0"] - first.values[shift] + base[shift]
            first = replace(first, values={**first.values, "theta0": start, shift: base[shift]})
    names = (*osc.coefficients, *unknown)
    size = float(np.abs(features.turning_amplitudes).max())
    units = 1e-5 / ratios_per_unit(problem, features)
    fit = _TrajectoryFit(signal, osc, names, base, size)
    floor = np.r_[np.zeros(units.size), np.full(len(unknown), -np.inf)]
    x = _start(fit, units, first, features)

    best = least_squares(fit.linearise, x, floor)
    # A root mean square residual above this means that the trajectory has lost the phase of the record.
    lost = 0.3 * float(np.std(signal.y))
    for start in (x, np.array([{**base, **decay_start(problem, features)}[name] for name in names])):
        if not np.sqrt(best.cost / signal.t.size) < lost:
            window = 2.0 * features.period
            while window < signal.t[-1]:
                start = least_squares(fit.until(window).linearise, start, floor).x
                window *= 2
            other = least_squares(fit.linearise, start, floor)
            best = other if other.cost < best.cost else best
    residual, jacobian = fit.linearise(best.x)
    if not np.all(np.isfinite(residual)):
        raise Refusal("no simulated motion has finite values; check the known values and the laws")

    problems = [] if best.converged else ["the trajectory fit did not converge"]
    zero = [name for name, value, unit in zip(osc.coefficients, best.x, units) if value < 1e-3 * unit]
    if zero:
        problems.append(
            f"the best fit has {' and '.join(f'{name} = 0' for name in zero)}, which is the lower bound"
        )
    if sentence := misfit(residual, signal, features):
        problems.append(sentence)
    values = {**dict(zip(names, map(float, best.x))), **held}
    moving = best.x > floor  # a parameter at its lower bound has no standard error
    j = jacobian[:, moving]
    scale = np.linalg.norm(j, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    freedom = max(residual.size - j.shape[1], 1)
    _, sizes, combinations = np.linalg.svd(j / scale, full_matrices=False)
    good = sizes > UNDETERMINED * sizes.max(initial=0.0)
    errors = np.linalg.norm(combinations[good] / sizes[good, None], axis=0) / scale
    errors *= np.sqrt((residual @ residual) / freedom)
    # A parameter is undetermined if it contributes to such a combination by more than rounding does.
    undetermined = np.any(np.abs(combinations[~good]) > 1e-4, axis=0)
    inside = [name for name, free in zip(names, moving) if free]
    stderr = {name: float(e) for name, e, no in zip(inside, errors, undetermined) if not no}
    if undetermined.any():
        doubted = " and ".join(name for name, no in zip(inside, undetermined) if no)
        problems.append(f"the record does not determine {doubted}, or only a combination of them")
    if held:
        stderr.pop("theta0", None)
    count, outcome = best.evaluations, "; ".join(problems) or OK
    return Estimate(first.estimator, "refined", values, stderr, evaluations=count, outcome=outcome)


def least_squares(
    linearise: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], start: np.ndarray, floor: np.ndarray
) -> Minimum:
    """Minimise a sum of squares by the Levenberg–Marquardt method, from `start` (k,), with lower bounds `floor` (k,).

    linearise: function that maps parameters x (k,) to the residuals (n,) and their Jacobian (n, k). A step to residuals
    that are not finite is rejected. There are at most `STEPS` steps; `Minimum.converged` says whether they were enough.
    """
    evaluations, lowest = 0, np.inf

    def expand(x: np.ndarray) -> Expansion:
        nonlocal evaluations, lowest
        r, jacobian = linearise(x)
        cost = float(r @ r) if np.all(np.isfinite(r)) else np.inf
        evaluations, lowest = evaluations + 1, min(cost, lowest)
        return Expansion(-cost, -2 * jacobian.T @ r, 2 * jacobian.T @ jacobian)

    def ended(step: Step) -> bool:
        cost = -step.at.value
        scale = np.sqrt(np.diag(step.at.information) / 2)
        small = bool(np.all(np.abs(step.move) * scale <= SMALL_CHANGE * np.sqrt(cost)))
        if step.gain > 0:
            return small or step.gain < SMALL_GAIN * cost or step.gain == cost
        return small or bool(np.all(np.abs(step.move) <= SMALL_STEP * np.abs(step.x))) or cost == 0.0

    result = levenberg_marquardt(expand, start, floor, ended, limit=STEPS, schedule=SCHEDULE)
    return Minimum(result.x, lowest, evaluations, result.converged)


def _start(fit: _TrajectoryFit, units: np.ndarray, first: Estimate, features: Features) -> np.ndarray:
    """Return the values from which the fit of the k unknowns starts, (k,), in the order of `fit.names`.

    Damping coefficients are those of the estimate `first`, which must have them all, but at least `units`, their
    smallest start values. The other unknowns have their values in `first`, or those of the record's features
    (`fit.base`) if these fit the first three periods better.
    """
    estimated = {**fit.base, **first.values}
    damping = {name: max(estimated[name], unit) for name, unit in zip(fit.osc.coefficients, units)}
    candidates = [
        np.array([{**start, **damping}[name] for name in fit.names])
        for start in (estimated, {**estimated, **fit.base})
    ]
    if not any(name in first.values for name in fit.names if name not in damping):
        return candidates[0]
    return min(candidates, key=fit.until(3 * features.period).mean_square)


def misfit(residual: np.ndarray, signal: Signal, features: Features) -> str | None:
    """Return a sentence if the residual (n,) of a trajectory is larger or more correlated than noise; else None.

    residual: trajectory minus record, in the unit of the record. A residual with an rms of at most `LEAST_RESIDUAL`
    times the largest amplitude gives None. If the residual is white noise, the probability of a sentence (a false
    alarm) is below 10⁻⁶.
    """
    n = residual.size
    rms = float(np.sqrt(np.mean(residual**2)))
    size = float(np.abs(features.turning_amplitudes).max())
    noise = max(noise_level(signal), features.roughness)
    if rms <= LEAST_RESIDUAL * size:
        return None
    lag = min(max(1, round(features.samples_per_cycle / 12)), n - 1)
    correlation = float(residual[lag:] @ residual[:-lag] / (residual @ residual))
    rougher = rms > (MOST_RESIDUAL + 5 / np.sqrt(2 * n)) * noise
    if not rougher and correlation <= max(MOST_CORRELATION, 5 / np.sqrt(n)):
        return None
    times = f", {rms / noise:.3g} times the noise of the record" if noise > 1e-6 * size else ""
    return (
        f"the rms residual of the best fit is {rms:.2g} {quantity_unit(signal.unit, signal.quantity)}{times}: "
        "the model is incomplete, or the noise is correlated"
    )


SINGULAR = 1e-8
"""The Cramér–Rao bound is infinite for all parameters in a combination whose singular value is at most this fraction of
the largest. These are the singular values of the scaled Jacobian (measured: rounding gives 1e-9 for a combination that
the record does not determine; a pendulum without known parameters has 1e-5)."""


def cramer_rao(
    problem: Problem,
    parameters: Mapping[str, float],
    times: np.ndarray,
    noise_sd: float,
    quantity: str = "angle",
) -> dict[str, float]:
    """Compute the Cramér–Rao bound: the smallest standard deviation of an unbiased estimate of each unknown parameter.

    For independent normal noise the Fisher information is JᵀJ/σ², where J (n, k) has the derivatives of the n samples
    by the k unknowns. These are the damping coefficients, and the restoring parameters, theta0 and omega0 (displacement
    and velocity at the start) that are not in `problem.system.known`. All other parameters count as exactly known: also
    those of damping terms other than their coefficients, and the width ε within which dry friction changes its sign.

    Parameters
    ----------
    problem
        The damping terms, and the names of the known parameters of the system; their values have no effect.
    parameters
        The true value of every parameter of the oscillator (`Oscillator.parameters`), also of the known ones, by name;
        other names have no effect.
    times
        Times of the samples, s, shape (n,), not decreasing; the motion starts at times[0].
    noise_sd
        Standard deviation of the noise, in the unit of the quantity.
    quantity
        "angle", "velocity" or "acceleration".

    Returns
    -------
    dict
        The bound of each unknown, by name, in the unit of the parameter; inf if the record does not determine the
        parameter.

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
