"""Weak SINDy: the equation of motion against test functions (paper, section 3.9, equation 22)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from pydantic import Field
from scipy import sparse

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.methods._library import Candidate, candidates, restoring_values, told
from bayesdamp.estimators.methods._weak import (
    Stretch,
    kernel_half_width,
    uniform,
    velocity_map,
    weights,
    whitener,
)
from bayesdamp.estimators.shared import (
    ORDER,
    checked_features,
    epsilon_of,
    free_names,
    known_restoring,
    motion,
    noise_level,
    oscillator,
    runs,
)
from bayesdamp.signals.features import Features
from bayesdamp.types import OK, Estimate, Problem, Refusal, Signal

WIDTHS = (0.75, 1.0, 1.5, 2.0)
"""Widths of the test functions in periods that are tried."""
FLOOR = 1e-6
"""A part of the inertia smaller than this share of it is no evidence for a term."""
ROUNDS = 4
SUBDIVIDED = 15
"""Points between neighbouring samples at which a jumping function is averaged."""


class WeakSindyOptions(Options):
    """width: width of the test functions in periods, or 0 to choose it by the predicted standard error."""

    width: float = Field(default=0.0, ge=0.0, le=10.0)


@dataclass(frozen=True)
class Rows:
    """The weak form: inertia + columns x = noise, over m test functions.

    inertia (m,), columns (m, p); noise: per stretch the map of the samples' noise into inertia, and into each
    column, all (m_i, n_i).
    """

    inertia: np.ndarray
    columns: np.ndarray
    noise: list[tuple[sparse.csr_matrix, list[sparse.csr_matrix]]]

    def residual_noise(self, x: np.ndarray) -> list[sparse.csr_matrix]:
        """The map of the samples' noise into the residual at coefficients x (p,)."""
        return [
            sparse.csr_matrix(sum((c * b for c, b in zip(x, maps) if c != 0.0), first))
            for first, maps in self.noise
        ]


@dataclass(frozen=True)
class White:
    """Rows with independent errors of unit variance (times that of a sample)."""

    inertia: np.ndarray
    columns: np.ndarray
    map: np.ndarray


class WeakSindy(Estimator):
    """∫φ″θ + ∫φ F_rest(θ) + Σ ξ ∫φ f(θ, θ̇) = 0 with few terms, no derivative of the record being taken.

    The inertia is integrated by parts twice and viscous damping once. Terms that are not linear in θ̇ take it
    from the record's convolution with −ψ′, ψ smooth and compact, as wide as balances noise against bias. The
    rows' errors are correlated as the record's noise passes through φ″ + φ F′ and the columns: generalised
    least squares, renewed with the coefficients. Noise in the columns biases the normal equations by a known
    amount, which is subtracted.
    Terms fall from the library by their t-value; the number kept has the least Bayesian information criterion.
    """

    name = "weak_sindy"
    options = WeakSindyOptions

    def refuses(self, damping: tuple[str, ...]) -> str | None:
        return None

    def initial(
        self, signal: Signal, problem: Problem, options: Options, rng: np.random.Generator
    ) -> Estimate:
        assert isinstance(options, WeakSindyOptions)
        seen = checked_features(signal)
        sigma = noise_level(signal)
        library = candidates(problem, epsilon_of(problem, seen), signal.unit)
        stretches = prepared(signal, problem, seen, sigma)
        own = np.array([one.damping in problem.damping for one in library])
        dissipates = np.array([one.damping is not None for one in library])
        known = known_restoring(problem)
        all_known = len(known) == len(oscillator(problem).law.parameters)

        tried = []
        for width in (options.width,) if options.width else WIDTHS:
            rows = assembled(stretches, library, problem, seen, width * seen.period)
            if rows is None or rows.inertia.size < len(library) + 4:
                continue
            first = np.zeros(len(library))
            if not all_known:  # the stiffness belongs to how noise passes
                first[[one.name for one in library].index("θ")] = seen.frequency**2
            support = own | (np.array([one.restoring for one in library]) & (not all_known))
            white = whitened(rows, first)
            for _ in range(2):
                x, spread = solved(rows, white, support, sigma)
                white = whitened(rows, x)
            x, spread = solved(rows, white, support, sigma)
            units = [
                term.ratio_per_unit(seen.amplitude, seen.frequency)
                * spread[[one.damping for one in library].index(term.name)]
                for term in oscillator(problem).terms
            ]
            tried.append((float(np.linalg.norm(units)), width, rows, white))
        if not tried:
            raise Refusal("the record is too short for test functions")
        _, width, rows, white = min(tried, key=lambda one: one[0])

        path = sparse_path(white, dissipates)
        best = min(path, key=lambda one: one[1])
        support, names = best[0], [one.name for one in library]
        selected = [name for name, kept in zip(names, support) if kept]
        missing = [name for name, of, kept in zip(names, own, support) if of and not kept]
        if missing:  # the model is given: its terms stay, and no other damping may stand in for them
            support = (support & ~dissipates) | own
        trace = []
        for _ in range(ROUNDS):
            x, spread = solved(rows, white, support, sigma)
            white = whitened(rows, x)
            trace.append(float(x[own][0]))

        index = {one.damping: i for i, one in enumerate(library) if one.damping}
        values = {term.parameter: float(x[index[term.name]]) for term in oscillator(problem).terms}
        stderr = {term.parameter: float(spread[index[term.name]]) for term in oscillator(problem).terms}
        if not all_known:
            theta = np.concatenate([one.theta for one in stretches])
            omega = np.concatenate([one.omega for one in stretches])
            parts = [c * one.function(theta, omega) for one, c in zip(library, x) if one.restoring]
            values |= restoring_values(problem, theta, np.sum(parts, axis=0))
        if free_names(problem):
            moving = motion(signal, problem, seen)
            start = {"theta0": moving.theta0, "omega0": moving.omega0}
            values |= {name: value for name, value in start.items() if name in free_names(problem)}
        return Estimate(
            self.name,
            "initial",
            values,
            stderr,
            {"coefficient": np.array(trace)},
            {
                "selected": selected,
                "coefficients": [float(c) for c in best[2][best[0]]],
                "library": names,
                "threshold": best[3],
                "width_in_periods": width,
                "test_functions": int(rows.inertia.size),
                "path_threshold": [one[3] for one in path],
                "path_terms": [int(one[0].sum()) for one in path],
                "path_score": [one[1] for one in path],
            },
            evaluations=len(path) + ROUNDS,
            outcome=told(selected, missing) if missing else OK,
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
    values = f(one.theta, one.omega)
    jump = 1e-3 * seen.amplitude * seen.frequency
    if np.any(np.abs(f(one.theta[:1], np.array([jump])) - f(one.theta[:1], np.array([-jump]))) > 1.0):
        values = _between(f, one)
    if one.order:
        return phi @ values, sparse.csr_matrix(phi.shape)
    d = 1e-3 * seen.amplitude
    by_theta = (f(one.theta + d, one.omega) - f(one.theta - d, one.omega)) / (2 * d)
    d *= 10 * seen.frequency
    by_omega = (f(one.theta, one.omega + d) - f(one.theta, one.omega - d)) / (2 * d)
    through = phi @ sparse.diags(by_theta)
    if np.any(by_omega):
        through = through + phi @ sparse.diags(by_omega) @ one.velocity
    return phi @ values, sparse.csr_matrix(through)


def _between(f, one: Stretch) -> np.ndarray:
    """Means of f over the cells around the samples, (n,): a jump counts where it is."""
    part = (np.arange(SUBDIVIDED) + 0.5) / SUBDIVIDED - 0.5
    at = np.clip(np.arange(one.t.size)[:, None] + part, 0, one.t.size - 1)
    base = np.arange(one.t.size)
    theta, omega = np.interp(at, base, one.theta), np.interp(at, base, one.omega)
    return f(theta.ravel(), omega.ravel()).reshape(at.shape).mean(axis=1)


def whitened(rows: Rows, x: np.ndarray) -> White:
    """Rows with independent errors, if the coefficients are x (p,)."""
    turn = whitener(rows.residual_noise(x))
    return White(turn @ rows.inertia, turn @ rows.columns, turn)


def solved(rows: Rows, white: White, support: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (p,) of the terms in `support`, freed of the bias of noise in their columns; and stderr.

    Residual r = b + Gx with noise (A₀ + Σ x_l B_l) n makes GᵀC⁻¹r have the mean
    σ² [tr(C⁻¹B_k A₀ᵀ) + Σ_l x_l tr(C⁻¹B_k B_lᵀ)], which is set against it.
    """
    a, b = white.columns[:, support], white.inertia
    scale = np.linalg.norm(a, axis=0)
    a = a / scale
    kept = np.flatnonzero(support)
    own, mixed = np.zeros((kept.size, kept.size)), np.zeros(kept.size)
    start = 0
    for first, maps in rows.noise:
        turn = white.map[:, start : start + first.shape[0]]
        start += first.shape[0]
        images = [(maps[k].T @ turn.T / s).ravel() for k, s in zip(kept, scale)]
        inertia = (first.T @ turn.T).ravel()
        own += np.array([[u @ v for v in images] for u in images])
        mixed += np.array([u @ inertia for u in images])
    gram = a.T @ a
    x, spread = np.zeros(support.size), np.zeros(support.size)
    plain = np.linalg.lstsq(a, -b, rcond=1e-12)[0]
    corrected = gram - sigma**2 * own
    better = plain
    if np.linalg.eigvalsh(corrected)[0] > 0.5 * np.linalg.eigvalsh(gram)[0]:
        # A step from the plain solution, so that nothing is lost where there is no noise.
        better = plain + np.linalg.solve(corrected, sigma**2 * (mixed + own @ plain))
    left = b + a @ plain
    sd = np.sqrt(left @ left / max(b.size - kept.size, 1))
    x[kept] = better / scale
    spread[kept] = sd * np.sqrt(np.maximum(np.diag(np.linalg.pinv(gram, rcond=1e-14)), 0.0)) / scale
    return x, spread


def sparse_path(white: White, dissipates: np.ndarray) -> list[tuple[np.ndarray, float, np.ndarray, float]]:
    """(terms, score, coefficients, threshold) of the sparse solutions that lose no energy backwards.

    For every set of damping terms the others fall in the order of their t-values. score: the Bayesian
    information criterion; threshold: the least t-value that is left.
    """
    a, b = white.columns, -white.inertia
    scale, n = np.linalg.norm(a, axis=0), b.size
    small = np.linalg.qr(np.column_stack([a / scale, b]), mode="r")
    a, b = small[:, :-1], small[:, -1]
    floor = FLOOR * float(np.linalg.norm(b)) / np.sqrt(n)
    damping = np.flatnonzero(dissipates)
    found = []
    for chosen in product([False, True], repeat=damping.size):
        mask = ~dissipates
        mask[damping] = chosen
        while mask.any():
            inverse = np.linalg.pinv(a[:, mask], rcond=1e-12)
            x = inverse @ b
            error = float(np.sum((b - a[:, mask] @ x) ** 2)) / n + floor**2
            t = np.abs(x) / np.sqrt(np.sum(inverse**2, axis=1) * error * n / max(n - mask.sum(), 1))
            full = np.zeros(mask.size)
            full[mask] = x / scale[mask]
            if np.all(full[dissipates] >= 0):
                score = n * np.log(error) + mask.sum() * np.log(n)
                found.append((mask.copy(), float(score), full, float(t.min())))
            others = np.flatnonzero(mask & ~dissipates)
            if others.size == 0:
                break
            mask[others[np.argmin(t[np.searchsorted(np.flatnonzero(mask), others)])]] = False
    if not found:
        raise Refusal("no sparse solution has damping that takes energy out: the record is too noisy")
    return found


PLUGIN = WeakSindy()
