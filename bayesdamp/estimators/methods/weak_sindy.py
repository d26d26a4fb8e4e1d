"""Estimate damping by weak SINDy: regression of the equation of motion integrated against test functions.

The method is that of section 3.9, equation 22, of the paper that `bayesdamp.estimators` cites.
"""

from dataclasses import replace

import numpy as np
from pydantic import Field
from scipy import sparse

from bayesdamp.estimators.regression import (
    CandidateTerm,
    Rows,
    Stretch,
    candidates,
    compare_selection,
    damping_values,
    kernel_half_width,
    restoring_values,
    selected_terms,
    solve_support,
    sparse_path,
    test_function_weights,
    to_even_clock,
    velocity_map,
    whiten,
)
from bayesdamp.estimators.shared import (
    Estimator,
    Options,
    before_gap,
    checked_features,
    free_names,
    free_start,
    known_restoring,
    motion,
    noise_level,
    oscillator,
    ratios_per_unit,
)
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import DERIVATIVES, Estimate, Problem, Refusal, Signal

WIDTHS = (0.75, 1.0, 1.5, 2.0)
"""Widths of the test functions, in periods, that are tried; that with the smallest predicted standard error is used."""
ROUNDS = 3
"""Number of times that the final regression is solved; each time its weights follow from the coefficients of the fit
before."""
SUBDIVIDED = 15
"""Number of points in the sampling interval around a sample, over which a discontinuous term is averaged."""


class WeakSindyOptions(Options):
    """Options of weak SINDy.

    width: width of the test functions in periods, or 0 to choose that of `WIDTHS` with the smallest predicted standard
    error of the damping.
    """

    width: float = Field(default=0.0, ge=0.0, le=10.0)


class WeakSindy(Estimator[WeakSindyOptions]):
    """Solve ∫φ″θ + ∫φ F_rest(θ) + Σ ξ ∫φ f(θ, θ̇) = 0 for sparse ξ, without second derivatives of the record.

    φ is a test function, F_rest the known restoring force, f a candidate term, and ξ its coefficient. The inertia ∫φθ̈
    is integrated by parts twice, and viscous damping once. For terms that are not linear in θ̇, the velocity comes from
    local polynomials (Savitzky and Golay) over a width that balances noise against bias. The record's noise enters
    through φ″ + φ F′ and through the columns, so the rows have correlated errors: we use generalised least squares,
    whose weights follow from the coefficients. Noise in the columns biases the normal equations by a known amount,
    which is subtracted. Terms are removed by their t-value; their number is chosen by the Bayesian information
    criterion.
    """

    options = WeakSindyOptions

    def initial(
        self, signal: Signal, problem: Problem, options: WeakSindyOptions, rng: np.random.Generator
    ) -> Estimate:
        """Return the coefficients of a sparse regression of the weak form (Messenger and Bortz 2021).

        The estimate has all damping terms of the model, and no others, with standard errors. If the regression selects
        other terms, `outcome` is a sentence that names them; `details` has the names (`selected`) and coefficients
        (`coefficients`) of the terms that it selects. Unknown restoring and start parameters have no standard errors.
        Raises Refusal if `checked_features` or `motion` does, or if the record is too short.
        """
        features = checked_features(signal)
        sigma, osc, known = noise_level(signal), oscillator(problem), known_restoring(problem)
        library = candidates(problem, features, signal.unit)
        stretch = _prepare(signal, problem, features, sigma)
        own = np.array([candidate.damping in problem.damping for candidate in library])
        dissipates = np.array([candidate.damping is not None for candidate in library])
        of_theta = np.array([candidate.restoring for candidate in library])
        all_known = len(known) == len(osc.law.parameters)

        base = own | (of_theta & (not all_known))
        few = [library[i] for i in np.flatnonzero(base)]
        first, every = np.zeros(len(few)), np.ones(len(few), bool)
        if not all_known:  # the errors of the rows depend on the stiffness
            first[[candidate.name for candidate in few].index("θ")] = features.frequency**2
        ratio = dict(zip(problem.damping, ratios_per_unit(problem, features)))
        tried = []
        for width in (options.width,) if options.width else WIDTHS:
            rows = _assemble(stretch, few, problem, features, width * features.period)
            if rows is None or rows.inertia.size < len(library) + 4:
                continue
            guess = solve_support(whiten(rows, first, sigma, every), every, sigma)
            guess = solve_support(whiten(rows, guess.x, sigma, every), every, sigma)
            errors = [ratio[c.damping] * spread for c, spread in zip(few, guess.stderr) if c.damping]
            tried.append((float(np.linalg.norm(errors)), width, guess.x))
        if not tried:
            raise Refusal("the record is too short: too few test functions fit into it")
        _, width, near = min(tried, key=lambda trial: trial[0])
        rows = _assemble(stretch, library, problem, features, width * features.period)
        assert rows is not None
        x = np.zeros(len(library))
        x[base] = near
        white = whiten(rows, x, sigma, np.ones(len(library), bool))

        path = sparse_path(white, dissipates, sigma)
        nothing = replace(solve_support(white, own, sigma), support=np.zeros(own.size, bool))
        best = min(path, key=lambda solution: solution.score, default=nothing)
        # The damping model is given: its terms are always used, and no others, except functions of θ that correct a
        # displacement with guessed constants of integration.
        guessed = DERIVATIVES[signal.quantity] > 0 and not {"theta0", "omega0"} <= set(problem.system.known)
        allowed = base | (of_theta & guessed)
        support = (best.support & allowed) | own
        fit = best
        for _ in range(ROUNDS):
            fit = solve_support(white, support, sigma)
            white = whiten(rows, fit.x, sigma, support)

        values, stderr = (damping_values(problem, library, x) for x in (fit.x, fit.stderr))
        if not all_known:
            state = stretch.theta, stretch.omega
            parts = [c * term.function(*state) for term, c in zip(library, fit.x) if term.restoring]
            values |= restoring_values(problem, stretch.theta, np.sum(parts, axis=0))
        if free_names(problem):
            smoothed = motion(signal, problem, features)
            values |= free_start(problem, smoothed.theta0, smoothed.omega0)
        details = selected_terms(library, best.x, best.support)
        outcome, evaluations = compare_selection(library, best.support, allowed), len(path) + ROUNDS
        return Estimate(
            self.name, "initial", values, stderr, details, evaluations=evaluations, outcome=outcome
        )


def _prepare(signal: Signal, problem: Problem, features: Features, sigma: float) -> Stretch:
    """Return the record before its first interruption of the sampling, with displacement and velocity.

    Uneven times are replaced by uniform ones, by interpolation. sigma: standard deviation of the noise, in the unit of
    the record; it sets the smoothing of the velocity of a recorded angle.
    """
    part, order = before_gap(signal, features.period), DERIVATIVES[signal.quantity]
    h = float(np.diff(part.t).mean())
    if order:
        smoothed = motion(signal, problem, features)
        t, y, theta, omega = to_even_clock(part.t, h, part.y, *smoothed.everywhere[:2])
        return Stretch(h, y, theta, omega, sparse.csr_matrix((t.size, t.size)), order)
    t, y = to_even_clock(part.t, h, part.y)
    most, speed = int(0.5 * features.period / h), features.amplitude * features.frequency
    velocity = velocity_map(t.size, h, kernel_half_width(h, features.frequency, speed, sigma, most))
    return Stretch(h, y, y, velocity @ y, velocity, 0)


def _assemble(
    stretch: Stretch, library: list[CandidateTerm], problem: Problem, features: Features, width: float
) -> Rows | None:
    """Return the weak form of the equation of motion for test functions `width` s wide.

    The result is None if the record is not longer than this width. stretch: the part of the record that is used.
    library: the candidate terms, one for each column of the result.
    """
    law, known, n = oscillator(problem).law, known_restoring(problem), stretch.y.size
    if n * stretch.h <= width:
        return None
    nudge = 1e-4 * features.amplitude
    phi = test_function_weights(n, stretch.h, width, 0)
    first = test_function_weights(n, stretch.h, width, 2 - stretch.order)
    offset = law.linear_form(stretch.theta, known).offset
    through = first
    if stretch.order == 0:
        up, down = (law.linear_form(stretch.theta + d, known).offset for d in (nudge, -nudge))
        through = first + phi @ sparse.diags((up - down) / (2 * nudge))
    values, maps = zip(*(_column(candidate, stretch, phi, width, features) for candidate in library))
    inertia = first @ stretch.y + phi @ offset
    return Rows(inertia, np.column_stack(values), sparse.csr_matrix(through), list(maps))


def _column(
    candidate: CandidateTerm, stretch: Stretch, phi: sparse.csr_matrix, width: float, features: Features
) -> tuple[np.ndarray, sparse.csr_matrix]:
    """Return the integrals ∫φ f of one candidate term f, (m,), and their derivatives by the samples, (m, n).

    The derivatives propagate the noise of the samples. stretch: the record, with n samples. phi: weights
    (m, n) of the m test functions φ on these samples. width: their width in s. The derivatives are 0 for a recorded
    velocity or acceleration, except for viscous damping of a velocity, which is linear in the record.
    """
    n, f, theta, omega = stretch.y.size, candidate.function, stretch.theta, stretch.omega
    if candidate.damping == "viscous" and stretch.order < 2:
        linear = 2.0 * test_function_weights(n, stretch.h, width, 1 - stretch.order)
        return linear @ stretch.y, linear
    if candidate.jumps:  # the mean over the interval around each sample resolves the position of a jump
        part = (np.arange(SUBDIVIDED) + 0.5) / SUBDIVIDED - 0.5
        places = np.clip(np.arange(n)[:, None] + part, 0, n - 1)
        states = (np.interp(places, np.arange(n), x).ravel() for x in (theta, omega))
        values = f(*states).reshape(places.shape).mean(axis=1)
    else:
        values = f(theta, omega)
    if stretch.order:
        return phi @ values, sparse.csr_matrix(phi.shape)
    d = 1e-3 * features.amplitude
    through = phi @ sparse.diags((f(theta + d, omega) - f(theta - d, omega)) / (2 * d))
    if not candidate.restoring:
        d *= 10 * features.frequency
        by_omega = (f(theta, omega + d) - f(theta, omega - d)) / (2 * d)
        through = through + phi @ sparse.diags(by_omega) @ stretch.velocity
    return phi @ values, sparse.csr_matrix(through)


PLUGIN = WeakSindy()
