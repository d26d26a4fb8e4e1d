"""Sparse identification of nonlinear dynamics (paper, section 3.4, equation 16)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.methods._library import Candidate, candidates, judged, restoring_values
from bayesdamp.estimators.shared import (
    ORDER,
    Motion,
    checked_features,
    epsilon_of,
    free_names,
    known_restoring,
    motion,
    oscillator,
    runs,
)
from bayesdamp.signals.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from pysindy import STLSQ, CustomLibrary

SMOOTHINGS = (3.0, 3.6, 4.4, 5.4, 6.6, 8.0, 10.0, 12.0)
"""Knots a period that are tried; what suits the record best is kept. (Once the library has been thinned down to the
model's one term, the regression is least squares'; the derivatives that it sees are this method's own.)"""
RIDGES = (1e-10, 1e-7, 1e-4, 1e-2)
"""Ridge parameters, for columns and target of unit norm, along which the path of thresholds is walked."""
FLOOR = 1e-6
"""A part of the acceleration smaller than this share of it is no evidence for a term."""


CANCELLING = 10.0
"""Terms may cancel down to one part in so many; more is two of them fitting noise against each other."""


class SindyOptions(Options):
    """switch: how the library writes friction, as tanh(θ̇/ε) or as sign(θ̇) (paper, section 3.4)."""

    switch: Literal["tanh", "sign"] = "tanh"


@dataclass(frozen=True)
class Sparse:
    """One sparse solution: its terms (p,) of bool, the coefficients (p,), and where it lies on the path.

    squares: mean square error of each stretch as predicted from all others, (rad/s²)².
    """

    support: np.ndarray
    x: np.ndarray
    threshold: float
    ridge: float
    squares: np.ndarray

    @property
    def error(self) -> float:
        """Root mean square of the errors of the stretches, each predicted from all others."""
        return float(np.sqrt(np.mean(self.squares)))


class Sindy(Estimator):
    """θ̈ + known force = Θ(θ, θ̇) ξ with few terms, by sequentially thresholded least squares of pysindy.

    State and acceleration come from a spline whose knots are chosen by generalised cross-validation; the
    library's columns are smoothed as the acceleration was. What is known of the restoring force is taken from
    the acceleration, and every term of the library remains a candidate.
    """

    name = "sindy"
    options = SindyOptions

    def refuses(self, damping: tuple[str, ...]) -> str | None:
        return None

    def initial(
        self, signal: Signal, problem: Problem, options: Options, rng: np.random.Generator
    ) -> Estimate:
        assert isinstance(options, SindyOptions)
        seen = checked_features(signal)
        moving, knots = smoothest(signal, problem, seen)
        theta, omega, _ = moving.everywhere
        epsilon = 0.0 if options.switch == "sign" else epsilon_of(problem, seen)
        library = candidates(problem, epsilon, signal.unit)
        offset = oscillator(problem).law.linear_form(theta, known_restoring(problem)).offset
        target = -(moving.alpha + moving.project(offset))
        columns = np.column_stack([moving.project(column) for column in evaluated(library, theta, omega).T])
        drift = [
            (moving.t - moving.t[0]) ** j
            for j in range(moving.integrated if len(known_restoring(problem)) else 0)
        ]
        if drift:  # guessed constants of integration shift the force by a constant and a slope
            basis = np.linalg.qr(np.column_stack(drift))[0]
            columns, target = columns - basis @ (basis.T @ columns), target - basis @ (basis.T @ target)
        rows = target.size
        if not moving.clean:
            rows = min(rows, int((moving.t[-1] - moving.t[0]) * moving.bandwidth / np.pi) + 1)
        floor = FLOOR * float(np.sqrt(np.mean(moving.alpha**2)))
        dissipates = np.array([one.damping is not None for one in library])
        blocks = held_out_blocks(moving.t, seen.period)
        unknown = len(known_restoring(problem)) < len(oscillator(problem).law.parameters)
        path, best = sparse_path(columns, target, dissipates, blocks, floor)

        names = [one.name for one in library]
        selected = [name for name, kept in zip(names, best.support) if kept]
        own = np.array([one.damping in problem.damping for one in library])
        # The model is given: its terms stay, and nothing may stand in for them or beside them.
        of_law = np.array([one.restoring for one in library]) & unknown
        support = (best.support & of_law) | own
        x, spread = refit(columns, target, support, rows)
        index = {one.damping: i for i, one in enumerate(library) if one.damping}
        values, stderr = {}, {}
        for term in oscillator(problem).terms:
            values[term.parameter] = float(x[index[term.name]])
            stderr[term.parameter] = float(spread[index[term.name]])
        if unknown:
            of_theta = np.array([one.restoring for one in library])
            force = evaluated(library, theta, omega)[:, of_theta] @ x[of_theta]
            values |= restoring_values(problem, theta, force)
        for name, value in (("theta0", moving.theta0), ("omega0", moving.omega0)):
            if name in free_names(problem):
                values[name] = value
        return Estimate(
            self.name,
            "initial",
            values,
            stderr,
            {"error": np.array([one.error for one in path])},
            {
                "selected": selected,
                "coefficients": [float(c) for c in best.x[best.support]],
                "library": names,
                "threshold": best.threshold,
                "ridge": best.ridge,
                "knots_per_period": knots,
                "path_threshold": [one.threshold for one in path],
                "path_terms": [int(one.support.sum()) for one in path],
                "path_error": [one.error for one in path],
            },
            evaluations=len(path),
            outcome=judged(library, best.support, own | of_law),
        )


def smoothest(signal: Signal, problem: Problem, seen: Features) -> tuple[Motion, float]:
    """The motion with the knots a period for which generalised cross-validation is least; 0 if interpolated."""
    order = ORDER[signal.quantity]
    pieces = runs(signal.t, seen.period)
    y = np.concatenate([signal.y[run] for run in (pieces if order == 0 else pieces[:1])])
    best: tuple[float, Motion, float] | None = None
    for knots in SMOOTHINGS:
        if 4 * knots > seen.samples_per_cycle and best is not None:
            break
        try:
            moving = motion(signal, problem, seen, knots)
        except Refusal:
            continue
        if moving.clean:
            return moving, 0.0
        count = y.size * knots / seen.samples_per_cycle + 8
        left = float(np.mean((y - moving.everywhere[order]) ** 2))
        score = left / max(1.0 - count / y.size, 1e-3) ** 2
        if best is None or score < best[0]:
            best = score, moving, knots
    if best is None:
        raise Refusal("the samples are too few or too unevenly spaced for a smoothing spline")
    return best[1], best[2]


def evaluated(library: list[Candidate], theta: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """The library on states (n,), as pysindy evaluates it: (n, p)."""
    whole = CustomLibrary([_of_two(one) for one in library])
    return np.asarray(whole.fit_transform(np.column_stack([theta, omega])))


def _of_two(one: Candidate):
    """A plain function of two arguments: pysindy counts them."""

    def function(x, v):
        return one.function(np.asarray(x), np.asarray(v))

    return function


def refit(columns: np.ndarray, target: np.ndarray, support: np.ndarray, rows: int):
    """Coefficients (p,) of the terms in `support` and their standard errors (p,); `rows` count as independent."""
    a = columns[:, support]
    scale = np.linalg.norm(a, axis=0)
    x, spread = np.zeros(support.size), np.zeros(support.size)
    inverse = np.linalg.pinv(a / scale, rcond=1e-12)
    x[support] = inverse @ target / scale
    left = target - columns @ x
    sd = np.sqrt(left @ left / max(rows - support.sum(), 1))
    spread[support] = sd * np.sqrt(np.sum(inverse**2, axis=1)) / scale
    return x, spread


def sparse_path(
    columns: np.ndarray, target: np.ndarray, dissipates: np.ndarray, blocks: list[np.ndarray], floor: float
) -> tuple[list[Sparse], Sparse]:
    """Sparse solutions for every threshold at which a term falls, and for several ridges; and the one chosen.

    dissipates (p,): which terms are damping. blocks: the rows of each stretch that is held out in turn.
    Of the solutions whose mean square held-out error is above the least by no more than two standard errors
    of the difference (and floor²), the sparsest is chosen, and of several the one with the least error.
    Solutions with negative damping, or whose terms all but cancel, are not admitted.
    Rows are first rotated onto the columns: the same regression, fewer rows.
    """
    scale, size = np.linalg.norm(columns, axis=0), float(np.linalg.norm(target))
    if size == 0.0:
        raise Refusal("nothing is left of the acceleration once the known force is taken away")
    rows = np.column_stack([columns / scale, target / size])
    folds = [np.asarray(np.linalg.qr(rows[block], mode="r")) for block in blocks]
    small = np.asarray(np.linalg.qr(np.vstack(folds), mode="r"))
    a, b = small[:, :-1], small[:, -1]
    weight = np.array([block.size for block in blocks], float)
    unit = size / np.sqrt(weight)
    found: dict[tuple[bool, ...], Sparse] = {}
    for ridge in RIDGES:
        threshold = 0.0
        while (survivors := _thresholded(a, b, threshold, ridge)) is not None:
            mask, least = survivors
            if (key := tuple(mask.tolist())) not in found:
                held_out = unit * np.array([_held_out(folds, i, mask) for i in range(len(folds))])
                x = np.zeros(mask.size)
                x[mask] = np.linalg.lstsq(a[:, mask], b, rcond=1e-12)[0] * size / scale[mask]
                found[key] = Sparse(mask, x, threshold, ridge, held_out**2)
            threshold = max(least, threshold) * (1 + 1e-9) + 1e-300
    path = list(found.values())
    admitted = [one for one in path if _physical(one.x * scale, dissipates, size)]
    if not admitted:
        nothing = np.zeros(scale.size)
        return path, Sparse(nothing != 0.0, nothing, np.inf, 0.0, size**2 / weight)
    weight /= weight.sum()
    best = min(admitted, key=lambda one: float(weight @ one.squares))

    def ties(one: Sparse) -> bool:
        above = one.squares - best.squares
        mean = float(weight @ above)
        return mean <= 2 * float(np.sqrt(np.sum(weight**2 * (above - mean) ** 2))) + floor**2

    tied = [one for one in admitted if ties(one)]
    return path, min(tied, key=lambda one: (int(one.support.sum()), float(weight @ one.squares)))


def _physical(parts: np.ndarray, dissipates: np.ndarray, size: float) -> bool:
    """Whether damping takes energy out, and terms of norms `parts` (p,) do not cancel to a target of norm size."""
    return bool(np.all(parts[dissipates] >= 0) and np.abs(parts).sum() <= CANCELLING * size)


def _held_out(folds: list[np.ndarray], i: int, mask: np.ndarray) -> float:
    """Norm of the error in fold i of the solution from all others."""
    others = np.vstack([fold for j, fold in enumerate(folds) if j != i])
    x = np.linalg.lstsq(others[:, :-1][:, mask], others[:, -1], rcond=1e-12)[0]
    return float(np.linalg.norm(folds[i][:, -1] - folds[i][:, :-1][:, mask] @ x))


def held_out_blocks(t: np.ndarray, period: float) -> list[np.ndarray]:
    """Row numbers of stretches of about a period, four to ten of them, of times t (n,)."""
    count = int(np.clip(round((t[-1] - t[0]) / period), 4, 10))
    return [part for part in np.array_split(np.arange(t.size), count) if part.size]


def _thresholded(a: np.ndarray, b: np.ndarray, threshold: float, ridge: float):
    """Terms (p,) of bool that survive a threshold, and the smallest ridge coefficient; None if none does."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that all terms fell, which ends the path
        fit = STLSQ(threshold=threshold, alpha=ridge, max_iter=50, unbias=False).fit(a, b)
    weights = np.abs(np.asarray(fit.coef_)[0])
    mask = weights != 0.0
    return (mask, float(weights[mask].min())) if mask.any() else None


PLUGIN = Sindy()
