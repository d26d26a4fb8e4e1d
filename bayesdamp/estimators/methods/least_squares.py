"""Linear regression of the equation of motion (paper, section 3.10, equation 23)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.search import least_over_further
from bayesdamp.estimators.shared import (
    Motion,
    beside_coefficients,
    checked_features,
    free_start,
    further_priors,
    known_restoring,
    motion,
    oscillator,
)
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.types import Estimate, Problem, Refusal, Signal

ROUNDS = 50
REPLICAS = 64
"""Draws of noise by which a standard error is known to 9 %."""


class LeastSquaresOptions(Options):
    """variant: ordinary, weighted by the local scatter, iteratively reweighted (Huber), or total."""

    variant: Literal["ols", "wls", "irls", "tls"] = "ols"


class LeastSquares(Estimator[LeastSquaresOptions]):
    """θ̈ + F_rest(θ) = −Σ coefficient · shape(θ, θ̇), solved for whatever is not known.

    A coefficient may come out negative: it is reported as it is.
    """

    options = LeastSquaresOptions

    def initial(
        self, signal: Signal, problem: Problem, options: LeastSquaresOptions, rng: np.random.Generator
    ) -> Estimate:
        """Coefficients by regression of the equation of motion over the samples."""
        seen = checked_features(signal)
        moving = motion(signal, problem, seen)
        osc, known = oscillator(problem), known_restoring(problem)
        theta, omega, _ = moving.everywhere
        given = beside_coefficients(problem, seen)
        given |= {n: v for n, v in osc.law.start(seen.frequency, seen.rest, known).items() if n not in given}

        form = osc.law.linear_form(theta, known)
        others = [moving.project(x) for x in form.columns.T]

        def of_damping(further: Mapping[str, float]) -> list[np.ndarray]:
            return [moving.project(x) for x in osc.shapes(theta, omega, {**given, **further})]

        target = -(moving.alpha + moving.project(form.offset))
        # Guessed constants of integration shift the restoring force by a constant and a slope.
        drift = [(moving.t - moving.t[0]) ** j for j in range(moving.integrated if len(known) else 0)]

        def left(further: dict[str, float]) -> float:
            tried = np.column_stack([*of_damping(further), *others, *drift])
            return float(np.sum((target - tried @ _solve(tried, target, np.ones(target.size))) ** 2))

        further = least_over_further(further_priors(problem, seen), left)
        given |= further
        damping = of_damping(further)
        a = np.column_stack([*damping, *others, *drift])
        if np.linalg.matrix_rank(a / np.linalg.norm(a, axis=0)) < a.shape[1]:
            raise Refusal("the record does not tell the unknown parameters apart")

        count = len(damping) + form.columns.shape[1]
        if options.variant == "tls":
            noise = _noise_of_columns(moving, osc, given, form.columns.shape[1], len(drift))
            x = _total(a, target, noise)
            weight = np.ones(target.size)
        else:
            weight, x = _weighted(a, target, moving.t, seen.period, options.variant)
        if moving.response is None or options.variant == "tls":
            covariance = _covariance(a, target - a @ x, weight, moving.t, seen.period)[:count, :count]
        else:
            restoring = known | form.decode(x[len(damping) : count]) if form.columns.shape[1] else known
            noise = _noise_of_equation(moving, osc, x[: len(damping)], restoring, given)
            covariance = _propagated(a, weight, noise)[:count, :count]

        names = osc.coefficients
        values = {**dict(zip(names, map(float, x))), **further}
        variance = np.diag(covariance)  # rounding may take one below zero where columns are nearly the same
        stderr = dict(zip(names, np.sqrt(np.where(variance >= 0, variance, np.nan)).tolist()))
        start, size = len(damping), form.columns.shape[1]
        if size:
            c, spread = x[start:count], covariance[start:count, start:count]
            values |= form.decode(c)
            stderr |= _decoded_stderr(form.decode, c, spread)
        values |= free_start(problem, moving.theta0, moving.omega0)
        return Estimate(self.name, "initial", values, stderr, evaluations=1)


def _solve(a: np.ndarray, b: np.ndarray, weight: np.ndarray) -> np.ndarray:
    root, scale = np.sqrt(weight), np.linalg.norm(a, axis=0)
    return np.linalg.lstsq(a / scale * root[:, None], b * root, rcond=None)[0] / scale


def _weighted(
    a: np.ndarray, b: np.ndarray, t: np.ndarray, period: float, variant: str
) -> tuple[np.ndarray, np.ndarray]:
    """(weights, solution): weights 1 (ols), one over the scatter within a period (wls), Huber's (irls)."""
    weight = np.ones(b.size)
    x = _solve(a, b, weight)
    if variant == "wls":
        rest = (b - a @ x) ** 2
        width = max(3, round(period / np.median(np.diff(t))))
        padded = np.pad(
            rest, (width // 2, width - 1 - width // 2), mode="reflect" if rest.size > width else "edge"
        )
        local = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
        weight = 1.0 / np.maximum(local, 1e-3 * local.mean() + 1e-300)
        weight = weight / weight.mean()
        x = _solve(a, b, weight)
    elif variant == "irls":
        for _ in range(ROUNDS):
            rest = np.abs(b - a @ x)
            limit = 1.345 * 1.4826 * float(np.median(rest))
            weight = np.minimum(1.0, limit / np.maximum(rest, 1e-300)) if limit > 0 else weight
            last, x = x, _solve(a, b, weight)
            if np.allclose(x, last, rtol=1e-10, atol=0.0):
                break
    return weight, x


def _total(a: np.ndarray, b: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Total least squares: errors in the columns of a (n, c) and in b, of sizes `noise` (c + 1,).

    Columns without error are eliminated first (mixed least and total least squares).
    """
    scaled = np.column_stack([a, b]) / noise
    vector = np.linalg.svd(np.linalg.qr(scaled, mode="r"))[2][-1]
    if abs(vector[-1]) < 1e-12:
        raise Refusal("total least squares has no solution: the unknown parameters are not told apart")
    return -vector[:-1] / vector[-1] * noise[-1] / noise[:-1]


def _noise_of_columns(
    moving: Motion, osc: Oscillator, given: dict[str, float], restoring: int, drift: int
) -> np.ndarray:
    """Relative size of the noise in each column and in the target: white noise within the bandwidth."""
    band = moving.bandwidth
    velocity = band / np.sqrt(3.0)
    step = 1e-4 * float(np.abs(moving.omega).max())
    up, down = (np.array(osc.shapes(moving.theta, moving.omega + sign * step, given)) for sign in (1, -1))
    rise = up - down
    slopes = velocity * np.sqrt(np.mean((rise / (2 * step)) ** 2, axis=1))
    return np.r_[slopes, np.ones(restoring), np.full(drift, 1e-6), band**2 / np.sqrt(5.0)]


def _covariance(
    a: np.ndarray, rest: np.ndarray, weight: np.ndarray, t: np.ndarray, period: float
) -> np.ndarray:
    """Covariance of the solution, for residuals that are correlated within half a period (Newey and West)."""
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
    moving: Motion,
    osc: Oscillator,
    damping: np.ndarray,
    restoring: Mapping[str, float],
    given: Mapping[str, float],
) -> np.ndarray:
    """What white noise of the record's size does to the equation of motion, to first order (m, REPLICAS)."""
    assert moving.response is not None
    theta, omega, _ = moving.everywhere
    draws = np.random.default_rng(0).standard_normal((theta.size, REPLICAS))
    by_place, by_speed, by_change = moving.response(moving.noise * draws)
    d, e = 1e-4 * float(np.ptp(theta)), 1e-4 * float(np.ptp(omega))

    def force(x: np.ndarray) -> np.ndarray:
        return np.asarray(osc.law.force(x, restoring))

    def loss(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return damping @ np.array(osc.shapes(x, v, given))

    stiffness = (force(theta + d) - force(theta - d)) / (2 * d)
    stiffness = stiffness + (loss(theta + d, omega) - loss(theta - d, omega)) / (2 * d)
    damper = (loss(theta, omega + e) - loss(theta, omega - e)) / (2 * e)
    # The acceleration has been through the spline already; a second time leaves it as it is.
    return moving.project(by_change + stiffness[:, None] * by_place + damper[:, None] * by_speed)


def _propagated(a: np.ndarray, weight: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Covariance of the solution from replicas (m, r) of what the noise does to the target."""
    scale = np.linalg.norm(a, axis=0)
    bread = np.linalg.pinv((a / scale * weight[:, None]).T @ (a / scale))
    moved = bread @ ((a / scale * weight[:, None]).T @ noise) / scale[:, None]
    return moved @ moved.T / noise.shape[1]


def _decoded_stderr(decode: object, c: np.ndarray, covariance: np.ndarray) -> dict[str, float]:
    """Standard errors of decoded parameters, by the gradient of the decoding."""
    at = decode(c)  # type: ignore[operator]
    gradient: dict[str, np.ndarray] = {name: np.zeros(c.size) for name in at}
    for j in range(c.size):
        step = 1e-6 * (abs(c[j]) + np.sqrt(max(covariance[j, j], 0.0))) + 1e-12
        moved = c.copy()
        moved[j] += step
        for name, value in decode(moved).items():  # type: ignore[operator]
            gradient[name][j] = (value - at[name]) / step
    return {name: float(np.sqrt(max(g @ covariance @ g, 0.0))) for name, g in gradient.items()}


PLUGIN = LeastSquares()
