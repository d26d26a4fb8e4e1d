"""The second stage of every estimator: the trajectory that fits the record best, from where the first is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bayesdamp.estimators.misfit import misfit
from bayesdamp.estimators.search import brent, least_squares
from bayesdamp.estimators.shared import (
    checked_features,
    decay_start,
    free_names,
    further_priors,
    oscillator,
    start_parameters,
)
from bayesdamp.numerics.lazily import jax, jnp
from bayesdamp.physics.integrate import make_plan
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.solver.plan import compiled_record
from bayesdamp.priors import Normal, Prior
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import OK, Estimate, Problem, Refusal, Signal

TOLERANCE = 1e-6
"""Largest error of a trajectory, as a share of the amplitude; a tenth of it for each further damping term,
since terms that share the damping amplify errors."""
FINER = 1e-3
"""So much smaller, once, where a fit leaves no more than the trajectory's own error."""


@lru_cache(maxsize=64)
def with_jacobian(osc: Oscillator):
    """Compiled once per shape of plan: samples (n,) and their derivatives by every parameter but ε (n, k)."""
    names = tuple(name for name in osc.parameters if name != "epsilon")

    def samples(x, plan, rest):
        return plan.record(osc, {**rest, **{name: x[i] for i, name in enumerate(names)}})

    @jax.jit
    def both(x, plan, rest):
        value, push = jax.linearize(lambda x: samples(x, plan, rest), x)
        return value, jax.vmap(push)(jnp.eye(len(names))).T

    return names, both


@dataclass
class _Fit:
    """The residuals of one record as a function of what is not known."""

    signal: Signal
    osc: Oscillator
    names: tuple[str, ...]
    base: dict[str, float]
    tolerance: float
    units: np.ndarray
    plan: object = None

    def parameters(self, x: np.ndarray) -> dict[str, float]:
        return {**self.base, **dict(zip(self.names, map(float, x)))}

    def replan(self, x: np.ndarray) -> None:
        self.plan = make_plan(
            self.osc, self.parameters(x), self.signal.t, self.signal.quantity, self.tolerance
        )

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """(n,), in the unit of the record."""
        p = {name: jnp.asarray(value) for name, value in self.parameters(x).items()}
        values = compiled_record(self.osc)(self.plan, {name: p[name] for name in self.osc.inputs})
        return np.asarray(values) - self.signal.y

    def evaluate(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (n,) and their Jacobian by the unknown parameters (n, k)."""
        if x.size == 1:  # differences of samples need no second compilation
            h = 1e-4 * max(float(x[0]), 10 * self.units[0])
            slope = (self.residuals(x + h) - self.residuals(x - h)) / (2 * h)
            return self.residuals(x), slope[:, None]
        every, both = with_jacobian(self.osc)
        p = self.parameters(x)
        rest = {name: jnp.asarray(p[name]) for name in self.osc.inputs if name not in every}
        values, jacobian = both(jnp.array([p[name] for name in every]), self.plan, rest)
        columns = [every.index(name) for name in self.names]
        return np.asarray(values) - self.signal.y, np.asarray(jacobian)[:, columns]


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
    tolerance = TOLERANCE * 0.1 ** (len(osc.terms) - 1) * size
    fit = _Fit(signal, osc, names, base, tolerance, units)
    lowest = [_lowest(p) for p in priors.values()]
    free = len(names) - units.size - len(lowest)
    floor = np.r_[np.zeros(units.size), lowest, np.full(free, -np.inf)]
    x = _start(fit, first, seen)

    fit.replan(x)
    evaluations, traces = 0, []
    if len(names) == 1:
        one = brent(lambda c: _mean_square(fit.residuals(np.array([c])), size), float(x[0]), float(units[0]))
        x, evaluations = one.x, one.evaluations
        traces.append(np.sqrt(one.costs))
        fit.replan(x)
    found = least_squares(fit.evaluate, x, floor)
    lost = 0.3 * float(np.std(signal.y))
    for start in (x, np.array([{**base, **decay_start(problem, seen)}[name] for name in names])):
        if not _rms(found.costs[-1], signal) < lost:
            other = _growing(fit, start, floor, seen)
            found = other if other.costs[-1] < found.costs[-1] else found
    for _ in range(3):
        evaluations += found.evaluations
        traces.append(np.sqrt(found.costs / signal.t.size))
        if _rms(found.costs[-1], signal) < 10 * fit.tolerance and fit.tolerance == tolerance:
            fit.tolerance *= FINER  # the record has no noise: what is left over is the solver's
        fit.replan(found.x)
        last, found = found.x, least_squares(fit.evaluate, found.x, floor)
        if np.all(np.abs(found.x - last) <= 1e-7 * np.abs(last)):
            break
    evaluations += found.evaluations
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


def _lowest(prior: Prior) -> float:
    """The lower end of a prior's support."""
    return (
        -np.inf
        if isinstance(prior, Normal)
        else float(prior.value(np.asarray(0.0 if prior.reflected else -8.0)))
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
    early = fit.signal.t <= 3 * seen.period
    costs = []
    for x in candidates:
        fit.replan(x)
        costs.append(_mean_square(fit.residuals(x)[early], np.inf))
    return candidates[int(np.argmin(costs))]


def _growing(fit: _Fit, x: np.ndarray, floor: np.ndarray, seen: Features):
    """Levenberg–Marquardt over two cycles, then twice as many, until the window holds the whole record."""
    t, window = fit.signal.t, 2.0 * seen.period
    fit.replan(x)
    while window < t[-1]:
        early = t <= window

        def part(x: np.ndarray, early: np.ndarray = early) -> tuple[np.ndarray, np.ndarray]:
            r, jacobian = fit.evaluate(x)
            return r[early], jacobian[early]

        x = least_squares(part, x, floor).x
        fit.replan(x)
        window *= 2
    return least_squares(fit.evaluate, x, floor)


def _mean_square(r: np.ndarray, size: float) -> float:
    """Mean square, or that of a residual ten times the record's size where the trajectory escapes."""
    value = float(np.mean(r**2)) if np.all(np.isfinite(r)) else np.inf
    return value if np.isfinite(value) else 100.0 * size**2


def _rms(cost: float, signal: Signal) -> float:
    return float(np.sqrt(cost / signal.t.size))


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
