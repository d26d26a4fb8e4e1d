"""Estimate damping by linear regression of the equation of motion.

The method is that of section 3.10, equation 23, of the paper that `bayesdamp.estimators` cites.
"""

from typing import Literal

import numpy as np

from bayesdamp.estimators.shared import (
    Estimator,
    Options,
    SmoothedMotion,
    checked_features,
    free_start,
    further_values,
    known_restoring,
    motion,
    oscillator,
    solve,
)
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.types import Estimate, Problem, Refusal, Signal

ROUNDS = 50
"""Largest number of iterations of the variant "irls" (iteratively reweighted least squares)."""


class LeastSquaresOptions(Options):
    """Options of the regression.

    variant: ordinary ("ols"), weighted by the inverse of the local mean square residual ("wls"), iteratively reweighted
    by Huber's weights ("irls"), or total least squares ("tls").
    """

    variant: Literal["ols", "wls", "irls", "tls"] = "ols"


class LeastSquares(Estimator[LeastSquaresOptions]):
    """Solve θ̈ + F_rest(θ) = −Σ coefficient · shape(θ, θ̇) for the unknown parameters by least squares.

    A shape is the force of a damping term with the coefficient 1. Coefficients may be negative.
    """

    options = LeastSquaresOptions

    def initial(
        self, signal: Signal, problem: Problem, options: LeastSquaresOptions, rng: np.random.Generator
    ) -> Estimate:
        """Regress the acceleration on the damping and the unknown restoring forces; return all unknown parameters.

        An unknown start comes from the smoothed record. There are no standard errors. Raises Refusal if
        `checked_features` or `motion` does, if the record determines only combinations of the parameters, or if total
        least squares has no solution.
        """
        features = checked_features(signal)
        smoothed = motion(signal, problem, features)
        osc, known = oscillator(problem), known_restoring(problem)
        theta, omega, _ = smoothed.everywhere
        start = osc.law.start(features.frequency, features.rest, known)
        arguments = start | further_values(problem, features)
        shapes = osc.shapes(theta, omega, arguments)

        form = osc.law.linear_form(theta, known)
        others = [smoothed.project(x) for x in form.columns.T]
        target = -(smoothed.alpha + smoothed.project(form.offset))
        # Wrong constants of integration add a constant and a linear trend to the restoring force.
        elapsed = smoothed.t - smoothed.t[0]
        drift = [elapsed**j for j in range(smoothed.integrated if len(known) else 0)]

        a = np.column_stack([*map(smoothed.project, shapes), *others, *drift])
        if np.linalg.matrix_rank(a / np.linalg.norm(a, axis=0)) < a.shape[1]:
            raise Refusal(
                "the record determines only combinations of the unknown parameters, not each of them"
            )

        terms = len(osc.coefficients)
        if options.variant == "tls":
            x = _solve_total(a, target, smoothed, osc, arguments, len(drift))
        else:
            x = _solve_variant(a, target, smoothed.t, features.period, options.variant)
        values = dict(zip(osc.coefficients, map(float, x)))
        if others:
            values |= form.decode(x[terms : terms + len(others)])
        values |= free_start(problem, smoothed.theta0, smoothed.omega0)
        return Estimate(self.name, "initial", values, evaluations=1)


def _solve_variant(a: np.ndarray, b: np.ndarray, t: np.ndarray, period: float, variant: str) -> np.ndarray:
    """Return the weighted least squares solution x (c,) of a x = b.

    variant: "ols" has weights 1; "wls" has the inverse of the mean square residual within a period, which has a lower
    limit; "irls" has Huber's weights. a (n, c), b (n,): values at the times t (n,). period: of the oscillation, in the
    unit of t.
    """

    def solve_weighted(weight: np.ndarray) -> np.ndarray:
        root, scale = np.sqrt(weight), np.linalg.norm(a, axis=0)
        return np.linalg.lstsq(a / scale * root[:, None], b * root, rcond=None)[0] / scale

    x = solve(a, b)
    if variant == "wls":
        rest = (b - a @ x) ** 2
        width = max(3, round(period / np.median(np.diff(t))))
        mode = "reflect" if rest.size > width else "edge"
        padded = np.pad(rest, (width // 2, width - 1 - width // 2), mode=mode)
        local = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
        x = solve_weighted(1.0 / np.maximum(local, 1e-3 * local.mean() + 1e-300))
    elif variant == "irls":
        for _ in range(ROUNDS):
            rest = np.abs(b - a @ x)
            limit = max(1.345 * 1.4826 * float(np.median(rest)), 1e-300)
            last, x = x, solve_weighted(np.minimum(1.0, limit / np.maximum(rest, 1e-300)))
            if np.allclose(x, last, rtol=1e-10, atol=0.0):
                break
    return x


def _solve_total(
    a: np.ndarray,
    b: np.ndarray,
    smoothed: SmoothedMotion,
    osc: Oscillator,
    arguments: dict[str, float],
    drift: int,
) -> np.ndarray:
    """Return the solution x (c,) of a x = b by total least squares, with errors in the columns of a (n, c) and in b.

    The first columns of a are the damping shapes, which are the forces of the terms with the coefficient 1. Then come
    the restoring terms, and `drift` columns that have (nearly) no error. The other errors are those that white noise
    within the spline's bandwidth causes. smoothed: the motion from which a and b were computed. arguments: values on
    which the shapes depend besides the motion, by name. Raises Refusal if there is no solution.
    """
    step = 1e-4 * float(np.abs(smoothed.omega).max())
    velocities = (smoothed.omega + step, smoothed.omega - step)
    up, down = (np.array(osc.shapes(smoothed.theta, velocity, arguments)) for velocity in velocities)
    slopes = smoothed.bandwidth / np.sqrt(3.0) * np.sqrt(np.mean(((up - down) / (2 * step)) ** 2, axis=1))
    restoring = np.ones(a.shape[1] - slopes.size - drift)
    # Dry friction with ε = 0 is constant except where the velocity changes its sign, and has no error either.
    noise = np.r_[
        np.maximum(slopes, 1e-6), restoring, np.full(drift, 1e-6), smoothed.bandwidth**2 / np.sqrt(5.0)
    ]
    vector = np.linalg.svd(np.linalg.qr(np.column_stack([a, b]) / noise, mode="r"))[2][-1]
    if abs(vector[-1]) < 1e-12:
        raise Refusal(
            "total least squares has no solution: the record does not determine the unknown parameters"
        )
    return -vector[:-1] / vector[-1] * noise[-1] / noise[:-1]


PLUGIN = LeastSquares()
