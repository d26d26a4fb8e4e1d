"""Weak SINDy: the equation of motion against test functions (paper, section 3.9, equation 22)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pydantic import Field
from scipy import sparse

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.regression.library import (
    Candidate,
    candidates,
    damping_values,
    judged,
    restoring_values,
)
from bayesdamp.estimators.regression.weak import Stretch, kernel_half_width, uniform, velocity_map, weights
from bayesdamp.estimators.regression.weak_regression import Rows, Sparse, solved, sparse_path, whitened
from bayesdamp.estimators.shared import (
    ORDER,
    beside_coefficients,
    checked_features,
    epsilon_of,
    free_names,
    free_start,
    known_restoring,
    motion,
    noise_level,
    oscillator,
    runs,
)
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

WIDTHS = (0.75, 1.0, 1.5, 2.0)
"""Widths of the test functions in periods that are tried."""
ROUNDS = 3
SUBDIVIDED = 15
"""Points between neighbouring samples at which a jumping function is averaged."""


class WeakSindyOptions(Options):
    """width: width of the test functions in periods, or 0 to choose it by the predicted standard error."""

    width: float = Field(default=0.0, ge=0.0, le=10.0)


class WeakSindy(Estimator[WeakSindyOptions]):
    """∫φ″θ + ∫φ F_rest(θ) + Σ ξ ∫φ f(θ, θ̇) = 0 with few terms, no derivative of the record being taken.

    The inertia is integrated by parts twice and viscous damping once. Terms that are not linear in θ̇ take it
    from the record's convolution with −ψ′, ψ smooth and compact, as wide as balances noise against bias. The
    rows' errors are correlated as the record's noise passes through φ″ + φ F′ and the columns: generalised
    least squares, renewed with the coefficients. Noise in the columns biases the normal equations by a known
    amount, which is subtracted.
    Terms fall from the library by their t-value; the number kept has the least Bayesian information criterion.
    """

    with_parameters = "its library is of fixed functions"
    options = WeakSindyOptions

    def initial(
        self, signal: Signal, problem: Problem, options: WeakSindyOptions, rng: np.random.Generator
    ) -> Estimate:
        """Coefficients by regression of the equation's weak form (Messenger and Bortz 2021)."""
        seen = checked_features(signal)
        sigma = noise_level(signal)
        library = candidates(
            problem, epsilon_of(problem, seen), signal.unit, beside_coefficients(problem, seen)
        )
        stretches = prepared(signal, problem, seen, sigma)
        own = np.array([one.damping in problem.damping for one in library])
        dissipates = np.array([one.damping is not None for one in library])
        known = known_restoring(problem)
        all_known = len(known) == len(oscillator(problem).law.parameters)

        base = own | (np.array([one.restoring for one in library]) & (not all_known))
        few, first = [one for one, kept in zip(library, base) if kept], np.zeros(int(base.sum()))
        if not all_known:  # the stiffness belongs to how noise passes
            first[[one.name for one in few].index("θ")] = seen.frequency**2
        tried = []
        for width in (options.width,) if options.width else WIDTHS:
            rows = assembled(stretches, few, problem, seen, width * seen.period)
            if rows is None or rows.inertia.size < len(library) + 4:
                continue
            guess = solved(whitened(rows, first, sigma), first == first, sigma)
            guess = solved(whitened(rows, guess.x, sigma), first == first, sigma)
            units = [
                oscillator(problem)
                .terms[problem.damping.index(one.damping)]
                .ratio_per_unit(seen.amplitude, seen.frequency)
                * spread
                for one, spread in zip(few, guess.stderr)
                if one.damping
            ]
            tried.append((float(np.linalg.norm(units)), width, guess.x))
        if not tried:
            raise Refusal("the record is too short for test functions")
        _, width, near = min(tried, key=lambda one: one[0])
        rows = assembled(stretches, library, problem, seen, width * seen.period)
        assert rows is not None
        x = np.zeros(len(library))
        x[base] = near
        white = whitened(rows, x, sigma)

        path, names = sparse_path(white, dissipates, sigma), [one.name for one in library]
        nothing = Sparse(np.zeros(own.size, bool), solved(white, own, sigma), np.inf, np.inf)
        best = min(path, key=lambda one: one.score, default=nothing)
        support = best.support
        selected = [name for name, kept in zip(names, support) if kept]
        # The model is given: its terms stay, and nothing may stand in for them or beside them but a force of θ that
        # makes up for a displacement whose constants of integration were guessed.
        of_theta = np.array([one.restoring for one in library])
        guessed = ORDER[signal.quantity] > 0 and not {"theta0", "omega0"} <= set(problem.system.known)
        allowed = base | (of_theta & guessed)
        support = (support & allowed) | own
        trace, found = [], best.solution
        for _ in range(ROUNDS):
            found = solved(white, support, sigma)
            white = whitened(rows, found.x, sigma, support)
            trace.append(float(found.x[own][0]))

        values, stderr = damping_values(problem, library, found.x, found.stderr)
        if not all_known:
            theta = np.concatenate([one.theta for one in stretches])
            omega = np.concatenate([one.omega for one in stretches])
            parts = [c * one.function(theta, omega) for one, c in zip(library, found.x) if one.restoring]
            values |= restoring_values(problem, theta, np.sum(parts, axis=0))
        if free_names(problem):
            moving = motion(signal, problem, seen)
            values |= free_start(problem, moving.theta0, moving.omega0)
        return Estimate(
            self.name,
            "initial",
            values,
            stderr,
            {"coefficient": np.array(trace)},
            {
                "selected": selected,
                "coefficients": [float(c) for c in best.solution.x[best.support]],
                "library": names,
                "threshold": best.threshold,
                "width_in_periods": width,
                "test_functions": int(rows.inertia.size),
                "path_threshold": [one.threshold for one in path],
                "path_terms": [int(one.support.sum()) for one in path],
                "path_score": [one.score for one in path],
            },
            evaluations=len(path) + ROUNDS,
            outcome=judged(library, best.support, allowed),
        )


def prepared(signal: Signal, problem: Problem, seen: Features, sigma: float) -> list[Stretch]:
    """The record in runs between gaps, each on a uniform clock with the velocity beside it."""
    order = ORDER[signal.quantity]
    pieces = [replace(signal, t=signal.t[run], y=signal.y[run]) for run in runs(signal.t, seen.period)]
    if order:
        moving = motion(signal, problem, seen)
        t, y = pieces[0].t, pieces[0].y
        t, y, theta, omega = uniform(t, y, moving.everywhere[0], moving.everywhere[1])
        return [Stretch(t[1] - t[0], t, y, theta, omega, sparse.csr_matrix((t.size, t.size)), order)]
    found = []
    for piece in pieces:
        t, y = uniform(piece.t, piece.y)
        h = float(t[1] - t[0])
        most = int(0.5 * seen.period / h)
        half = kernel_half_width(h, seen.frequency, seen.amplitude * seen.frequency, sigma, most)
        velocity = velocity_map(t.size, h, half)
        found.append(Stretch(h, t, y, y, velocity @ y, velocity, 0))
    return found


def assembled(
    stretches: list[Stretch], library: list[Candidate], problem: Problem, seen: Features, width: float
) -> Rows | None:
    """The weak form of the library on test functions `width` s wide; None where none fits in."""
    law, known = oscillator(problem).law, known_restoring(problem)
    inertia, columns, noise = [], [], []
    nudge = 1e-4 * seen.amplitude
    for one in stretches:
        n = one.t.size
        if n * one.h <= width:
            continue
        phi = weights(n, one.h, width, 0)
        first = weights(n, one.h, width, 2 - one.order)
        offset = law.linear_form(one.theta, known).offset
        through = first
        if one.order == 0:
            up, down = (law.linear_form(one.theta + d, known).offset for d in (nudge, -nudge))
            through = first + phi @ sparse.diags((up - down) / (2 * nudge))
        values, maps = [], []
        for candidate in library:
            value, noise_map = _column(candidate, one, phi, width, seen)
            values.append(value)
            maps.append(noise_map)
        inertia.append(first @ one.y + phi @ offset)
        columns.append(np.column_stack(values))
        noise.append((sparse.csr_matrix(through), maps))
    if not inertia:
        return None
    a, b = np.vstack(columns), np.concatenate(inertia)
    return Rows(b, a, noise)


def _column(
    candidate: Candidate, one: Stretch, phi: sparse.csr_matrix, width: float, seen: Features
) -> tuple[np.ndarray, sparse.csr_matrix]:
    """∫φ f for one candidate, (m,), and the map of the samples' noise into it, (m, n)."""
    n, f = one.t.size, candidate.function
    if candidate.damping == "viscous" and one.order < 2:
        linear = 2.0 * weights(n, one.h, width, 1 - one.order)
        return linear @ one.y, linear
    values = _between(f, one) if candidate.jumps else f(one.theta, one.omega)
    if one.order:
        return phi @ values, sparse.csr_matrix(phi.shape)
    d, through = 1e-3 * seen.amplitude, sparse.csr_matrix(phi.shape)
    if candidate.damping is None:
        by_theta = (f(one.theta + d, one.omega) - f(one.theta - d, one.omega)) / (2 * d)
        through = phi @ sparse.diags(by_theta)
    if not candidate.restoring:
        d *= 10 * seen.frequency
        by_omega = (f(one.theta, one.omega + d) - f(one.theta, one.omega - d)) / (2 * d)
        through = through + phi @ sparse.diags(by_omega) @ one.velocity
    return phi @ values, sparse.csr_matrix(through)


def _between(f, one: Stretch) -> np.ndarray:
    """Means of f over the cells around the samples, (n,): a jump counts where it is."""
    part = (np.arange(SUBDIVIDED) + 0.5) / SUBDIVIDED - 0.5
    at = np.clip(np.arange(one.t.size)[:, None] + part, 0, one.t.size - 1)
    base = np.arange(one.t.size)
    theta, omega = np.interp(at, base, one.theta), np.interp(at, base, one.omega)
    return f(theta.ravel(), omega.ravel()).reshape(at.shape).mean(axis=1)


PLUGIN = WeakSindy()
