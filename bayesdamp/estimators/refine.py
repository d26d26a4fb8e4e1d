"""The second stage of every estimator: the trajectory that fits the record best, from where the first is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bayesdamp.estimators.search import brent, least_squares
from bayesdamp.estimators.shared import (
    checked_features,
    decay_start,
    free_names,
    further_priors,
    noise_level,
    oscillator,
    start_parameters,
)
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import Trajectories
from bayesdamp.priors import Normal
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import OK, Estimate, Problem, Refusal, Signal
from bayesdamp.units import quantity_unit

ROUGHER = 1.1
"""A residual of more than this many times the record's roughness, and five standard errors more, is told."""
CORRELATED = 0.1
"""So is one whose correlation over a twelfth of a period is above this and five standard errors from zero."""
SMALLEST = 1e-5
"""... if it is also more than this share of the amplitude: a trajectory's error is far below."""


def misfit(residual: np.ndarray, signal: Signal, seen: Features) -> str | None:
    """A sentence where the residual (n,) of a trajectory is more than noise, or None.

    White noise is mistaken for a misfit in less than one of 10⁶ records.
    """
    n = residual.size
    rms = float(np.sqrt(np.mean(residual**2)))
    size = float(np.abs(seen.turning_amplitudes).max())
    noise = max(noise_level(signal), seen.roughness)
    if rms <= SMALLEST * size:
        return None
    lag = min(max(1, round(seen.samples_per_cycle / 12)), n - 1)
    correlation = float(residual[lag:] @ residual[:-lag] / (residual @ residual))
    rougher = rms > (ROUGHER + 5 / np.sqrt(2 * n)) * noise
    if not rougher and correlation <= max(CORRELATED, 5 / np.sqrt(n)):
        return None
    times = f", {rms / noise:.3g} times the record's roughness" if noise > 1e-6 * size else ""
    return (
        f"the best fit leaves {rms:.2g} {quantity_unit(signal.unit, signal.quantity)}{times}: "
        "the model is not all of it, or the noise is correlated"
    )


TOLERANCE = 1e-11
"""Largest error of a trajectory, as a share of the amplitude: a record without noise is fitted to its last digits, and
a sum of squares is smooth enough for its minimum along what the record hardly determines."""


@dataclass(frozen=True)
class _Fit:
    """The residuals of one record as a function of what is not known."""

    signal: Signal
    osc: Oscillator
    names: tuple[str, ...]
    base: dict[str, float]
    size: float
    units: np.ndarray

    @cached_property
    def trajectories(self) -> Trajectories:
        """Solved to `TOLERANCE` at the record's times."""
        tolerance = TOLERANCE * self.size
        return Trajectories(self.osc, self.signal.t, self.signal.quantity, self.base, tolerance)

    def until(self, time: float) -> _Fit:
        """The fit of the samples up to a time, s."""
        kept = self.signal.t <= time
        return replace(self, signal=replace(self.signal, t=self.signal.t[kept], y=self.signal.y[kept]))

    def parameters(self, x: np.ndarray) -> dict[str, float]:
        return {**self.base, **dict(zip(self.names, map(float, x)))}

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """(n,), in the unit of the record."""
        return self.trajectories.record(self.parameters(x)) - self.signal.y

    def evaluate(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (n,) and their Jacobian by the unknown parameters (n, k)."""
        values, slopes = self.trajectories.with_slopes(self.parameters(x), self.names)
        return values - self.signal.y, slopes.T


def refine(signal: Signal, problem: Problem, first: Estimate) -> Estimate:
    """Least squares of the trajectory, started at `first`.

    Unknown are the damping coefficients (never below zero) and whatever of the restoring parameters, theta0
    and omega0 is not known; what `first` does not give starts from the record's features. One unknown:
    bounded Brent in a bracket from the estimate that widens by itself; several: Levenberg–Marquardt.
    Where the fit misses the record, it starts anew over two cycles and doubles the window until it holds all
    of it, since a frequency that is a little off loses step over many cycles. stderr is that of white
    residuals. Values stay in the result where the outcome says that the fit is poor.
    Raises Refusal where the trajectory escapes.
    """
    seen = checked_features(signal)
    osc = oscillator(problem)
    base = start_parameters(signal, problem, seen)
    priors = further_priors(problem, seen)
    names = (*osc.coefficients, *priors, *free_names(problem))
    size = float(np.abs(seen.turning_amplitudes).max())
    units = np.array([1e-5 / term.ratio_per_unit(seen.amplitude, seen.frequency) for term in osc.terms])
    fit = _Fit(signal, osc, names, base, size, units)
    signed = [isinstance(p, Normal) for p in priors.values()]
    ends = [float(p.value(np.asarray(0.0 if p.reflected else -8.0))) for p in priors.values()]
    lowest = np.where(signed, -np.inf, ends).tolist()
    free = len(names) - units.size - len(lowest)
    floor = np.r_[np.zeros(units.size), lowest, np.full(free, -np.inf)]
    x = _start(fit, first, seen)

    evaluations, traces = 0, []
    if len(names) == 1:
        one = brent(lambda c: _mean_square(fit.residuals(np.array([c])), size), float(x[0]), float(units[0]))
        x, evaluations = one.x, one.evaluations
        traces.append(np.sqrt(one.costs))
    found = least_squares(fit.evaluate, x, floor)
    lost = 0.3 * float(np.std(signal.y))
    for start in (x, np.array([{**base, **decay_start(problem, seen)}[name] for name in names])):
        if not np.sqrt(found.costs[-1] / signal.t.size) < lost:
            other = _growing(fit, start, floor, seen)
            found = other if other.costs[-1] < found.costs[-1] else found
    evaluations += found.evaluations
    traces.append(np.sqrt(found.costs / signal.t.size))
    residual, jacobian = fit.evaluate(found.x)
    if not np.all(np.isfinite(residual)):
        raise Refusal("the trajectory escapes from every start that was tried")

    rms = float(np.sqrt(np.mean(residual**2)))
    return Estimate(
        first.estimator,
        "refined",
        dict(zip(names, map(float, found.x))),
        _stderr(names, found.x, floor, residual, jacobian),
        {"rms": np.concatenate([*traces, [rms]])},
        evaluations=evaluations,
        outcome=_outcome(found.converged, found.x, fit, misfit(residual, signal, seen)),
    )


def _start(fit: _Fit, first: Estimate, seen: Features) -> np.ndarray:
    """Where to start: the first stage's values, or the record's own restoring law where that fits better."""
    own = {**fit.base, **first.values}
    damping = {name: max(own[name], unit) for name, unit in zip(fit.osc.coefficients, fit.units)}
    free = [name for name in fit.names if name not in damping]
    candidates = [
        np.array([{**start, **damping}[name] for name in fit.names]) for start in (own, {**own, **fit.base})
    ]
    if not any(name in first.values for name in free):
        return candidates[0]
    early = fit.until(3 * seen.period)
    return min(candidates, key=lambda x: _mean_square(early.residuals(x), np.inf))


def _growing(fit: _Fit, x: np.ndarray, floor: np.ndarray, seen: Features):
    """Levenberg–Marquardt over two cycles, then twice as many, until the window holds the whole record."""
    window = 2.0 * seen.period
    while window < fit.signal.t[-1]:
        x = least_squares(fit.until(window).evaluate, x, floor).x
        window *= 2
    return least_squares(fit.evaluate, x, floor)


def _mean_square(r: np.ndarray, size: float) -> float:
    """Mean square, or that of a residual ten times the record's size where the trajectory escapes."""
    value = float(np.mean(r**2)) if np.all(np.isfinite(r)) else np.inf
    return value if np.isfinite(value) else 100.0 * size**2


def _stderr(
    names: tuple[str, ...], x: np.ndarray, floor: np.ndarray, r: np.ndarray, jacobian: np.ndarray
) -> dict[str, float]:
    """Standard errors for white residuals; a parameter at its floor has none."""
    moving = x > floor
    j = jacobian[:, moving]
    freedom = max(r.size - j.shape[1], 1)
    scale = np.linalg.norm(j, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    covariance = np.linalg.pinv((j / scale).T @ (j / scale)) / np.outer(scale, scale) * (r @ r) / freedom
    inside = [name for name, free in zip(names, moving) if free]
    return dict(zip(inside, np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()))


def _outcome(converged: bool, x: np.ndarray, fit: _Fit, misfits: str | None) -> str:
    """ok, or what is wrong with the fit in a sentence."""
    said = [] if converged else ["the trajectory fit did not converge"]
    zero = [name for name, value, unit in zip(fit.osc.coefficients, x, fit.units) if value < 1e-3 * unit]
    if zero:
        said.append(f"the best {' and '.join(zero)} is at its bound 0")
    return "; ".join(said + ([misfits] if misfits else [])) or OK
