"""Estimate damping by linear regression of the equation of motion.

Section 3.10, equation 23, of the paper that `bayesdamp.estimators` cites.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.shared import (
    SmoothedMotion,
    checked_features,
    free_start,
    further_priors,
    further_values,
    known_restoring,
    motion,
    oscillator,
    search_further,
    solve,
)
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.types import DERIVATIVES, Estimate, Problem, Refusal, Signal

ROUNDS = 50
"""Largest number of iterations of the iteratively reweighted variant."""
REPLICAS = 64
"""Number of simulated noise vectors from which standard errors are computed (their own relative error is 9 %)."""


class LeastSquaresOptions(Options):
    """Options of the regression.

    variant: ordinary ("ols"), weighted by the inverse of the local mean square residual ("wls"), iteratively reweighted
    by Huber's weights ("irls"), or total least squares ("tls").
    """

    variant: Literal["ols", "wls", "irls", "tls"] = "ols"


class LeastSquares(Estimator[LeastSquaresOptions]):
    """Solve θ̈ + F_rest(θ) = −Σ coefficient · shape(θ, θ̇) for the unknown parameters by least squares.

    Coefficients may be negative.
    """

    options = LeastSquaresOptions

    def initial(
        self, signal: Signal, problem: Problem, options: LeastSquaresOptions, rng: np.random.Generator
    ) -> Estimate:
        """Regress the acceleration on the damping shapes and the unknown restoring terms.

        Return all unknown parameters, with standard errors of the damping coefficients and restoring parameters.
        """
        features = checked_features(signal)
        smoothed = motion(signal, problem, features)
        osc, known = oscillator(problem), known_restoring(problem)
        theta, omega, _ = smoothed.everywhere
        start = osc.law.start(features.frequency, features.rest, known)
        arguments = start | further_values(problem, features)

        form = osc.law.linear_form(theta, known)
        others = [smoothed.project(x) for x in form.columns.T]
        target = -(smoothed.alpha + smoothed.project(form.offset))
        # Wrong constants of integration add a constant and a linear trend to the restoring force.
        elapsed = smoothed.t - smoothed.t[0]
        drift = [elapsed**j for j in range(smoothed.integrated if len(known) else 0)]

        def columns(further: Mapping[str, float]) -> np.ndarray:
            shapes = osc.shapes(theta, omega, {**arguments, **further})
            return np.column_stack([*map(smoothed.project, shapes), *others, *drift])

        def left(further: dict[str, float]) -> float:
            trial = columns(further)
            return float(np.sum((target - trial @ solve(trial, target)) ** 2))

        further = search_further(further_priors(problem, features), left)
        arguments |= further
        a = columns(further)
        if np.linalg.matrix_rank(a / np.linalg.norm(a, axis=0)) < a.shape[1]:
            raise Refusal(
                "the record determines only combinations of the unknown parameters, not each of them"
            )

        terms = len(osc.coefficients)
        count = terms + len(others)
        if options.variant == "tls":
            weight, x = np.ones(target.size), _solve_total(a, target, smoothed, osc, arguments, len(drift))
        else:
            weight, x = _solve_variant(a, target, smoothed.t, features.period, options.variant)
        if smoothed.response is None or options.variant == "tls":
            covariance = _covariance(a, target - a @ x, weight, smoothed.t, features.period)
        else:
            restoring = known | form.decode(x[terms:count]) if others else known
            noise = _noise_of_equation(smoothed, osc, x[:terms], restoring, arguments)
            covariance = _propagate(a, weight, noise)

        # Rounding can make a variance negative if columns are nearly equal.
        variance = np.diag(covariance)[:count]
        stderr = dict(zip(osc.coefficients, np.sqrt(np.where(variance >= 0, variance, np.nan)).tolist()))
        values = {**dict(zip(osc.coefficients, map(float, x))), **further}
        if others:
            values |= form.decode(x[terms:count])
            stderr |= _decoded_stderr(form.decode, x[terms:count], covariance[terms:count, terms:count])
        if DERIVATIVES[signal.quantity] > 0 and "theta0" not in problem.system.known:
            stderr.pop(osc.law.shift, None)  # a velocity or acceleration does not determine it
        values |= free_start(problem, smoothed.theta0, smoothed.omega0)
        return Estimate(self.name, "initial", values, stderr, evaluations=1)


def _solve_variant(
    a: np.ndarray, b: np.ndarray, t: np.ndarray, period: float, variant: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return weights (n,) and the weighted least squares solution x (c,) of a x = b.

    variant: "ols" has weights 1; "wls" the inverse of the mean square residual within a period, scaled to a mean of 1;
    "irls" Huber's weights. a (n, c), b (n,): values at the times t (n,). period: of the oscillation, in the unit of t.
    """

    def solve_weighted(weight: np.ndarray) -> np.ndarray:
        root, scale = np.sqrt(weight), np.linalg.norm(a, axis=0)
        return np.linalg.lstsq(a / scale * root[:, None], b * root, rcond=None)[0] / scale

    weight, x = np.ones(b.size), solve(a, b)
    if variant == "wls":
        rest = (b - a @ x) ** 2
        width = max(3, round(period / np.median(np.diff(t))))
        mode = "reflect" if rest.size > width else "edge"
        padded = np.pad(rest, (width // 2, width - 1 - width // 2), mode=mode)
        local = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
        weight = 1.0 / np.maximum(local, 1e-3 * local.mean() + 1e-300)
        weight = weight / weight.mean()
        x = solve_weighted(weight)
    elif variant == "irls":
        for _ in range(ROUNDS):
            rest = np.abs(b - a @ x)
            limit = 1.345 * 1.4826 * float(np.median(rest))
            weight = np.minimum(1.0, limit / np.maximum(rest, 1e-300)) if limit > 0 else weight
            last, x = x, solve_weighted(weight)
            if np.allclose(x, last, rtol=1e-10, atol=0.0):
                break
    return weight, x


def _solve_total(
    a: np.ndarray,
    b: np.ndarray,
    smoothed: SmoothedMotion,
    osc: Oscillator,
    arguments: dict[str, float],
    drift: int,
) -> np.ndarray:
    """Return the solution x (c,) of a x = b by total least squares, with errors in the columns of a (n, c) and in b.

    The columns of a are the damping shapes, the restoring terms, and last `drift` columns that have (nearly) no error.
    The errors of the others are those that white noise within the spline's bandwidth causes. smoothed: the motion from
    which a and b were computed. arguments: values of the arguments of the damping shapes besides the coefficients, by
    name.
    """
    step = 1e-4 * float(np.abs(smoothed.omega).max())
    up, down = (
        np.array(osc.shapes(smoothed.theta, smoothed.omega + change, arguments)) for change in (step, -step)
    )
    slopes = smoothed.bandwidth / np.sqrt(3.0) * np.sqrt(np.mean(((up - down) / (2 * step)) ** 2, axis=1))
    restoring = np.ones(a.shape[1] - slopes.size - drift)
    # Dry friction with ε = 0 is constant except where the velocity changes its sign, and has no error either.
    noise = np.r_[
        np.maximum(slopes, 1e-6), restoring, np.full(drift, 1e-6), smoothed.bandwidth**2 / np.sqrt(5.0)
    ]
    scaled = np.column_stack([a, b]) / noise
    vector = np.linalg.svd(np.linalg.qr(scaled, mode="r"))[2][-1]
    if abs(vector[-1]) < 1e-12:
        raise Refusal(
            "total least squares has no solution: the record does not determine the unknown parameters"
        )
    return -vector[:-1] / vector[-1] * noise[-1] / noise[:-1]


def _covariance(
    a: np.ndarray, rest: np.ndarray, weight: np.ndarray, t: np.ndarray, period: float
) -> np.ndarray:
    """Return the covariance (c, c) of a solution whose residuals `rest` (n,) are correlated within half a period.

    a: columns (n, c). weight: weights of the rows, (n,). t, period: times (n,) and the period, in s. The estimate is
    that of Newey and West (1987).
    """
    lags = min(rest.size // 4, max(1, round(0.5 * period / np.median(np.diff(t)))))
    scale = np.linalg.norm(a, axis=0)
    scores = a / scale * (weight * rest)[:, None]
    middle = scores.T @ scores
    for lag in range(1, lags + 1):
        cross = scores[lag:].T @ scores[:-lag]
        middle += (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
    bread = np.linalg.pinv((a / scale * weight[:, None]).T @ (a / scale))
    return bread @ middle @ bread / np.outer(scale, scale)


def _noise_of_equation(
    smoothed: SmoothedMotion,
    osc: Oscillator,
    damping: np.ndarray,
    restoring: Mapping[str, float],
    arguments: Mapping[str, float],
) -> np.ndarray:
    """Return draws of the error of the equation of motion that the record's noise causes, at its m times.

    The shape is (m, REPLICAS), the unit rad/s². They are computed to first order. smoothed: the motion, with m times
    and the size of the noise. damping: coefficients, in the order of the terms. restoring: values of the law's
    parameters. arguments: arguments of the damping shapes besides the coefficients. The last two are by name.
    """
    assert smoothed.response is not None
    theta, omega, _ = smoothed.everywhere
    draws = np.random.default_rng(0).standard_normal((theta.size, REPLICAS))
    by_place, by_speed, by_change = smoothed.response(smoothed.noise * draws)
    d, e = 1e-4 * float(np.ptp(theta)), 1e-4 * float(np.ptp(omega))

    def force(x: np.ndarray) -> np.ndarray:
        return np.asarray(osc.law.force(x, restoring))

    def loss(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return damping @ np.array(osc.shapes(x, v, arguments))

    stiffness = (force(theta + d) - force(theta - d)) / (2 * d)
    stiffness = stiffness + (loss(theta + d, omega) - loss(theta - d, omega)) / (2 * d)
    damper = (loss(theta, omega + e) - loss(theta, omega - e)) / (2 * e)
    # The acceleration has been through the spline already; a second time leaves it as it is.
    return smoothed.project(by_change + stiffness[:, None] * by_place + damper[:, None] * by_speed)


def _propagate(a: np.ndarray, weight: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Return the covariance (c, c) of the solution of a x = b from r draws of the error in b, `noise` (m, r).

    a: columns (m, c). weight: weights of the rows, (m,).
    """
    scale = np.linalg.norm(a, axis=0)
    bread = np.linalg.pinv((a / scale * weight[:, None]).T @ (a / scale))
    moved = bread @ ((a / scale * weight[:, None]).T @ noise) / scale[:, None]
    return moved @ moved.T / noise.shape[1]


def _decoded_stderr(
    decode: Callable[[np.ndarray], dict[str, float]], c: np.ndarray, covariance: np.ndarray
) -> dict[str, float]:
    """Return standard errors, by name, of the restoring parameters `decode(c)`, by finite differences.

    covariance: that of the coefficients c (k,), (k, k).
    """
    decoded = decode(c)
    gradient = {name: np.zeros(c.size) for name in decoded}
    for j in range(c.size):
        step = 1e-6 * (abs(c[j]) + np.sqrt(max(covariance[j, j], 0.0))) + 1e-12
        moved = c.copy()
        moved[j] += step
        for name, value in decode(moved).items():
            gradient[name][j] = (value - decoded[name]) / step
    return {name: float(np.sqrt(max(g @ covariance @ g, 0.0))) for name, g in gradient.items()}


PLUGIN = LeastSquares()
