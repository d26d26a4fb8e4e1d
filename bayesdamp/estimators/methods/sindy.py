"""Sparse identification of nonlinear dynamics (paper, section 3.4, equation 16)."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np
from scipy.special import gammaln
from sklearn import config_context

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.regression.library import (
    Candidate,
    candidates,
    damping_values,
    judged,
    restoring_values,
)
from bayesdamp.estimators.regression.oscillation_spline import OscillationSpline
from bayesdamp.estimators.regression.prediction import Record, left_over
from bayesdamp.estimators.shared import (
    ORDER,
    beside_coefficients,
    checked_features,
    epsilon_of,
    free_start,
    integrated,
    known_restoring,
    motion,
    oscillator,
    runs,
)
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from pysindy import STLSQ, CustomLibrary

RIDGES = (1e-8, 1e-3)
"""Ridge parameters, for columns and target of unit norm, along which the path of thresholds is walked."""
FEW = 2
"""Sparse solutions with functions of θ that are put to the test for each set of damping terms."""
FLOOR = 1e-4
"""Predictions that differ by less than this share of the amplitude are not told apart."""
END = 0.5
"""Periods at each end of a smoothed run that the regression leaves out, where a spline is one-sided."""
CANCELLING = 10.0
"""Terms may cancel down to one part in so many; more is two of them fitting noise against each other."""


class SindyOptions(Options):
    """switch: how the library writes friction, as tanh(θ̇/ε) or as sign(θ̇) (paper, section 3.4)."""

    switch: Literal["tanh", "sign"] = "tanh"


@dataclass(frozen=True)
class Seen:
    """State and acceleration as the record shows them.

    rows (m,): samples at which the equation is regressed. theta, omega, alpha (n,) at all samples.
    t, y (n,): the samples. project: values (n,) to what the smoothing of the record made of them (m,).
    spline: what smoothed a recorded angle, None for others. freedom: how many rows count as independent.
    """

    rows: np.ndarray
    t: np.ndarray
    y: np.ndarray
    theta: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray
    project: Callable[[np.ndarray], np.ndarray]
    integrated: int
    freedom: float
    smoothing: float
    spline: OscillationSpline | None = None


@dataclass(frozen=True)
class Sparse:
    """One sparse solution: its terms (p,) of bool, the coefficients (p,), and where it lies on the path.

    sound: whether its damping takes energy out and its terms do not cancel. score: see `scored`.
    """

    support: np.ndarray
    x: np.ndarray
    threshold: float
    ridge: float
    sound: bool
    score: float = np.inf


class Sindy(Estimator[SindyOptions]):
    """θ̈ + known force = Θ(θ, θ̇) ξ with few terms, by sequentially thresholded least squares of pysindy.

    State and acceleration come from a smoothing spline that penalises what is no slowly changing oscillation;
    the library's columns are smoothed as the acceleration was. A record without noise is interpolated. What is
    known of the restoring force is taken from the acceleration, and every term of the library remains a candidate.

    For every set of damping terms functions of θ are thresholded away one by one. Of all sparse solutions found
    the one is selected whose prediction of the record, started once and integrated, has the least extended
    Bayesian information criterion (the prediction test of Mangan, Kutz, Brunton and Proctor, Proceedings of the
    Royal Society A 473, 2017, 20170009, with the criterion of Chen and Chen, Biometrika 95, 2008, 759).
    The damping is read off that solution; where its damping is not the model's, off the best of those whose
    damping is the model's, and the outcome says so.
    """

    with_parameters = "its library is of fixed functions"
    options = SindyOptions

    def initial(
        self, signal: Signal, problem: Problem, options: SindyOptions, rng: np.random.Generator
    ) -> Estimate:
        """Coefficients by sparse regression of the acceleration (Brunton, Proctor and Kutz 2016)."""
        features = checked_features(signal)
        seen = differentiated(signal, problem, features)
        epsilon = 0.0 if options.switch == "sign" else epsilon_of(problem, features)
        library = candidates(problem, epsilon, signal.unit, beside_coefficients(problem, features))
        law, known = oscillator(problem).law, known_restoring(problem)

        def force(theta: np.ndarray) -> np.ndarray:
            return law.linear_form(theta, known).offset

        target = -(seen.alpha[seen.rows] + seen.project(force(seen.theta)))
        columns = np.column_stack(
            [seen.project(column) for column in evaluated(library, seen.theta, seen.omega).T]
        )
        drift = [(seen.t[seen.rows] - seen.t[0]) ** j for j in range(seen.integrated if len(known) else 0)]
        if drift:  # guessed constants of integration shift the force by a constant and a slope
            basis = np.linalg.qr(np.column_stack(drift))[0]
            columns, target = columns - basis @ (basis.T @ columns), target - basis @ (basis.T @ target)
        record = Record(
            seen.t, seen.y, ORDER[signal.quantity], seen.theta, seen.omega, force, features.period
        )
        dissipates = np.array([one.damping is not None for one in library])
        own = np.array([one.damping in problem.damping for one in library])
        path = sparse_paths(columns, target, dissipates, seen.freedom)
        floor = FLOOR * features.amplitude * features.frequency**record.order
        path = scored(path, record, library, columns, target, floor)
        best = min((one for one in path if one.sound), key=lambda one: one.score)
        # The model is given: nothing may stand in for its damping or beside it.
        of_model = [one for one in path if np.array_equal(one.support & dissipates, own)]
        read = min(of_model, key=lambda one: (not one.sound, one.score))
        unknown = len(known) < len(law.parameters)
        of_law = np.array([one.restoring for one in library]) & unknown

        spread = standard_errors(seen, library, columns, target, read, force)
        values, stderr = damping_values(problem, library, read.x, spread)
        if unknown:
            of_theta = np.array([one.restoring for one in library])
            found = evaluated(library, seen.theta, seen.omega)[:, of_theta] @ read.x[of_theta]
            values |= restoring_values(problem, seen.theta, found)
        values |= free_start(problem, seen.theta[0], seen.omega[0])
        names = [one.name for one in library]
        weighed = [one for one in path if np.isfinite(one.score)]
        return Estimate(
            self.name,
            "initial",
            values,
            stderr,
            {"score": np.array([one.score for one in weighed])},
            {
                "selected": [name for name, kept in zip(names, best.support) if kept],
                "coefficients": [float(c) for c in best.x[best.support]],
                "read_from": [name for name, kept in zip(names, read.support) if kept],
                "library": names,
                "threshold": best.threshold,
                "ridge": best.ridge,
                "log_penalty": seen.smoothing,
                "path_threshold": [one.threshold for one in weighed],
                "path_terms": [int(one.support.sum()) for one in weighed],
                "path_score": [one.score for one in weighed],
            },
            evaluations=len(path),
            outcome=judged(library, best.support, own | of_law),
        )


def differentiated(signal: Signal, problem: Problem, features: Features) -> Seen:
    """State and acceleration: interpolated where the record has no noise, else from an oscillation spline."""
    order = ORDER[signal.quantity]
    pieces = runs(signal.t, features.period)
    pieces = pieces if order == 0 else pieces[:1]
    t, y = (np.concatenate([x[run] for run in pieces]) for x in (signal.t, signal.y))
    plain = motion(signal, problem, features)
    if plain.clean:
        rows = np.flatnonzero(np.isin(t, plain.t))
        return Seen(rows, t, y, *plain.everywhere, plain.project, plain.integrated, float(rows.size), 0.0)
    spline = OscillationSpline([signal.t[run] for run in pieces], y, features.period)
    inside = []
    for run in pieces:
        piece = signal.t[run]
        end = min(END * features.period, 0.15 * float(piece[-1] - piece[0]))
        inside.append((piece >= piece[0] + end) & (piece <= piece[-1] - end))
    rows = np.flatnonzero(np.concatenate(inside))
    first = signal if order == 0 else type(signal)(t, y, signal.quantity, signal.unit)
    if order == 0:
        curves, constants = tuple(spline(d) for d in range(3)), 0
    else:
        functions, constants = integrated(spline.curve(), first, problem, features)
        curves = tuple(np.asarray(function(t)) for function in functions)
    return Seen(
        rows,
        t,
        y,
        *curves,
        project=lambda x: spline.smoothed(x)[rows],
        integrated=constants,
        freedom=max(spline.freedom, 4.0),
        smoothing=spline.log_penalty,
        spline=spline if order == 0 else None,
    )


def evaluated(library: list[Candidate], theta: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """The library on states (n,), as pysindy evaluates it: (n, p)."""
    whole = CustomLibrary([_of_two(one) for one in library])
    return np.asarray(whole.fit_transform(np.column_stack([theta, omega])))


def _of_two(one: Candidate):
    """A plain function of two arguments: pysindy counts them."""

    def function(x, v):
        return one.function(np.asarray(x), np.asarray(v))

    return function


def sparse_paths(
    columns: np.ndarray, target: np.ndarray, dissipates: np.ndarray, freedom: float
) -> list[Sparse]:
    """Sparse solutions: for every set of damping terms, itself and the best few with functions of θ.

    Beside a set of damping terms the others pass every threshold at which one of them falls, for several ridges.
    Of these the FEW with the least Bayesian criterion of the regression are kept, `freedom` rows being independent.
    dissipates (p,): which terms are damping. Rows are first rotated onto the columns: the same regression.
    """
    scale, size = np.linalg.norm(columns, axis=0), float(np.linalg.norm(target))
    if size == 0.0:
        raise Refusal("nothing is left of the acceleration once the known force is taken away")
    small = np.asarray(np.linalg.qr(np.column_stack([columns / scale, target / size]), mode="r"))
    a, b = small[:, :-1], small[:, -1]
    damping, others = np.flatnonzero(dissipates), np.flatnonzero(~dissipates)
    found = []
    for chosen in product([False, True], repeat=damping.size):
        base = np.zeros(dissipates.size, bool)
        base[damping] = chosen
        basis = np.linalg.qr(a[:, base])[0]
        free, rest = (x - basis @ (basis.T @ x) for x in (a[:, others], b))
        beside: dict[bytes, tuple[float, Sparse]] = {}
        for ridge in RIDGES:
            threshold = 0.0
            while (survivors := _thresholded(free, rest, threshold, ridge)) is not None:
                mask, least = base.copy(), survivors[1]
                mask[others] = survivors[0]
                if mask.tobytes() not in beside:
                    one, left = _solution(a, b, mask, scale / size, dissipates, threshold, ridge)
                    score = freedom * np.log(left + 1e-300) + np.log(freedom) * mask.sum()
                    beside[mask.tobytes()] = score, one
                threshold = max(least, threshold) * (1 + 1e-9) + 1e-300
        ranked = sorted(beside.values(), key=lambda pair: (not pair[1].sound, pair[0]))
        found += [_solution(a, b, base, scale / size, dissipates, np.inf, 0.0)[0]]
        found += [one for _, one in ranked[:FEW]]
    return found


def _solution(
    a: np.ndarray, b: np.ndarray, mask: np.ndarray, scale: np.ndarray, dissipates: np.ndarray,
    threshold: float, ridge: float,
) -> tuple[Sparse, float]:  # fmt: skip
    """The unregularised solution with the terms in `mask`, and its sum of squares."""
    x = np.zeros(mask.size)
    x[mask] = np.linalg.lstsq(a[:, mask], b, rcond=1e-12)[0]
    sound = bool(np.all(x[dissipates] >= 0) and np.abs(x).sum() <= CANCELLING)
    return Sparse(mask, x / scale, threshold, ridge, sound), float(np.sum((b - a @ x) ** 2))


def scored(
    path: list[Sparse], record: Record, library: list[Candidate], columns: np.ndarray, target: np.ndarray,
    floor: float,
) -> list[Sparse]:  # fmt: skip
    """The solutions with their scores n ln(s²) + k ln(n) + 2 ln(number of sets of k terms).

    s²: mean square of what the prediction leaves of the record's n samples; k: the number of terms. Solutions that
    are not sound are not scored.
    """
    unit = np.linalg.norm(target) / np.linalg.norm(columns, axis=0)
    sound = [one for one in path if one.sound]
    left = left_over(record, library, np.array([one.x for one in sound]), unit, floor)
    n, p = record.t.size, len(library)
    found = [one for one in path if not one.sound]
    for one, square in zip(sound, left):
        k = int(one.support.sum())
        sets = float(gammaln(p + 1) - gammaln(k + 1) - gammaln(p - k + 1))
        score = n * float(np.log(square / n)) + k * float(np.log(n)) + 2 * sets
        found.append(replace(one, score=score))
    return found


def standard_errors(
    seen: Seen, library: list[Candidate], columns: np.ndarray, target: np.ndarray, one: Sparse,
    force: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:  # fmt: skip
    """Standard errors (p,) of a solution's coefficients.

    Of a smoothed angle, from the noise of the samples as it passes through θ̈, θ and θ̇ into the regression, to
    first order; else from the residual, `freedom` rows being independent.
    """
    a, spread = columns[:, one.support], np.zeros(one.support.size)
    scale = np.linalg.norm(a, axis=0)
    inverse = np.linalg.pinv(a / scale, rcond=1e-12) / scale[:, None]
    if seen.spline is None:
        left = target - columns @ one.x
        sd = np.sqrt(left @ left / max(min(seen.freedom, left.size) - one.support.sum(), 1.0))
        spread[one.support] = sd * np.sqrt(np.sum(inverse**2, axis=1))
        return spread
    left = seen.y - seen.spline(0)
    good = np.abs(left) <= 6 * 1.4826 * np.median(np.abs(left))
    sd = np.sqrt(np.sum(left[good] ** 2) / max(good.sum() - seen.freedom, 1.0))
    theta, omega = seen.theta, seen.omega
    d, e = 1e-4 * float(np.ptp(theta)), 1e-4 * float(np.ptp(omega))
    used = [(c, f.function) for c, f in zip(one.x, library) if c != 0.0]
    by_theta = (force(theta + d) - force(theta - d)) / (2 * d)
    by_theta = by_theta + sum(c * (f(theta + d, omega) - f(theta - d, omega)) / (2 * d) for c, f in used)
    by_omega = sum((c * (f(theta, omega + e) - f(theta, omega - e)) / (2 * e) for c, f in used), 0 * omega)
    noise = []
    for row in inverse:
        weights = np.zeros(theta.size)
        weights[seen.rows] = row
        through = seen.spline.adjoint(weights, 0)
        noise.append(
            seen.spline.adjoint(weights, 2)
            + seen.spline.adjoint(through * by_theta, 0)
            + seen.spline.adjoint(through * by_omega, 1)
        )
    spread[one.support] = sd * np.linalg.norm(np.array(noise), axis=1)
    return spread


def _thresholded(a: np.ndarray, b: np.ndarray, threshold: float, ridge: float):
    """Terms (p,) of bool that survive a threshold, and the smallest ridge coefficient; None if none does."""
    with warnings.catch_warnings(), config_context(skip_parameter_validation=True, assume_finite=True):
        warnings.simplefilter("ignore")  # that all terms fell, which ends the path
        fit = STLSQ(threshold=threshold, alpha=ridge, max_iter=50, unbias=False).fit(a, b)
    weights = np.abs(np.asarray(fit.coef_)[0])
    mask = weights != 0.0
    return (mask, float(weights[mask].min())) if mask.any() else None


PLUGIN = Sindy()
