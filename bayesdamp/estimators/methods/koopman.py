"""Extended dynamic mode decomposition (paper, section 3.12, equations 24 and 25)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field
from scipy.linalg import logm

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.regression.library import Candidate, candidates
from bayesdamp.estimators.regression.weak import derivatives, uniform
from bayesdamp.estimators.shared import (
    Motion,
    beside_coefficients,
    checked_features,
    epsilon_of,
    free_start,
    known_restoring,
    motion,
    oscillator,
    runs,
    solved,
)
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

STEP = 1.0 / 1000.0
"""The lag of a clean record, in periods; no less than one sample."""
NOISY_STEP = 1.0 / 24.0
"""The lag of a record with noise, in periods."""
FILTER = 1.2
"""Width of the filter on a record with noise, in periods."""
CLEAN_RANK, NOISY_RANK = 1e-9, 1e-3
"""Directions of the dictionary below this share of the largest are cut off."""


class KoopmanOptions(Options):
    """lag: time from one state to the next in periods, or 0 to choose it by the record's noise."""

    lag: float = Field(default=0.0, ge=0.0, le=0.2)


@dataclass(frozen=True)
class Observed:
    """Observables at times a lag apart: before, after (m, p), and the lag in s.

    columns (m, c), offset (m,): the restoring law's linear form at the times of `before`, filtered alike.
    """

    before: np.ndarray
    after: np.ndarray
    columns: np.ndarray
    offset: np.ndarray
    lag: float


@dataclass(frozen=True)
class Operator:
    """The one-step matrix K and the generator L, both (r, r) on r kept directions.

    directions (p, r): from observables to them; back (r, p): and back.
    """

    one_step: np.ndarray
    generator: np.ndarray
    directions: np.ndarray
    back: np.ndarray


class Koopman(Estimator[KoopmanOptions]):
    """g(x(t + τ)) ≈ K g(x(t)) for the paper's dictionary g; the damping is read off log(K)/τ.

    The row of the generator that belongs to θ̇ is the equation of motion: the acceleration that it gives along
    the record, less the known force, is projected on what is sought of the damping and restoring laws.
    Noise on the observables, and a dictionary that is not closed, bend log K alike forwards and backwards in
    time; half the difference of log K of both directions is free of it to first order. Noisy observables are
    filtered alike (a linear relation among them outlives a linear filter), and the lag is many samples.
    """

    with_parameters = "its library is of fixed functions"
    options = KoopmanOptions

    def initial(
        self, signal: Signal, problem: Problem, options: KoopmanOptions, rng: np.random.Generator
    ) -> Estimate:
        """Coefficients from the generator on a library of the state, the logarithm of its operator over a step."""
        seen = checked_features(signal)
        library = candidates(
            problem, epsilon_of(problem, seen), signal.unit, beside_coefficients(problem, seen), mixed=True
        )
        speed = next((i for i, one in enumerate(library) if one.damping == "viscous"), None)
        assert speed is not None
        moving = motion(signal, problem, seen)
        observed = observables(signal, moving, problem, library, seen, options.lag)
        operator = decomposed(observed, CLEAN_RANK if moving.clean else NOISY_RANK)

        # Twice θ̇ is the observable: half its row is θ̈ as a sum over the dictionary.
        row = 0.5 * operator.back.T[speed] @ operator.generator @ operator.directions.T
        row = row.real
        g = observed.before
        index = {one.damping: i for i, one in enumerate(library) if one.damping}
        shapes = g[:, [index[name] for name in problem.damping]]
        columns = np.column_stack([shapes, observed.columns])
        x = solved(columns, -(g @ row) - observed.offset, 1e-12)
        values = {name: float(c) for name, c in zip(oscillator(problem).coefficients, x)}
        if observed.columns.shape[1]:
            form = oscillator(problem).law.linear_form(moving.everywhere[0], known_restoring(problem))
            values |= form.decode(x[shapes.shape[1] :])
        values |= free_start(problem, moving.theta0, moving.omega0)
        of_step, of_generator = np.linalg.eigvals(operator.one_step), np.linalg.eigvals(operator.generator)
        of_step = of_step[np.argsort(-np.abs(of_step))]
        of_generator = of_generator[np.argsort(-of_generator.real)]
        return Estimate(
            self.name,
            "initial",
            values,
            details={
                "dictionary": [one.name for one in library],
                "lag": observed.lag,
                "rank": int(operator.one_step.shape[0]),
                "acceleration": [float(c) for c in row],
                "step_eigenvalues_re": of_step.real.tolist(),
                "step_eigenvalues_im": of_step.imag.tolist(),
                "generator_eigenvalues_re": of_generator.real.tolist(),
                "generator_eigenvalues_im": of_generator.imag.tolist(),
            },
            evaluations=2,
        )


def observables(
    signal: Signal,
    moving: Motion,
    problem: Problem,
    library: list[Candidate],
    seen: Features,
    lag: float,
) -> Observed:
    """Pairs of the dictionary's values a lag apart.

    The state is a spline's (see `shared.motion`); on an uneven clock it is put on an even one. Of a noisy
    record every observable is filtered by one smooth compact kernel, θ and θ̇ from the record itself.
    """
    pieces = runs(signal.t, seen.period)
    if signal.quantity != "angle":
        pieces = pieces[:1]
    ends = np.cumsum([signal.t[run].size for run in pieces])[:-1]
    law, known = oscillator(problem).law, known_restoring(problem)
    middle = law.linear_form(moving.everywhere[0], known)  # where it is expanded belongs to all pieces alike
    lawful = np.column_stack([middle.columns, middle.offset])
    before, after, forms, p, tau = [], [], [], len(library), 0.0
    split = [np.split(x, ends) for x in (*moving.everywhere[:2], lawful)]
    for run, theta, omega, form in zip(pieces, *split):
        t, y, theta, omega, *form = uniform(signal.t[run], signal.y[run], theta, omega, *form.T)
        h = float(t[1] - t[0])
        g = np.column_stack([*(one.function(theta, omega) for one in library), *form])
        share = lag or (STEP if moving.clean else NOISY_STEP)
        step = max(1, round(share * seen.period / h))
        tau = step * h
        if moving.clean:
            edge = min(20, t.size // 10)
            g = g[edge : t.size - edge]
        else:
            g = _filtered(g, y if signal.quantity == "angle" else None, library, h, FILTER * seen.period)
        if g.shape[0] <= step + 4 * len(library):
            continue
        before.append(g[:-step, :p])
        after.append(g[step:, :p])
        forms.append(g[:-step, p:])
    if not before:
        raise Refusal("the record is too short for pairs of states a lag apart")
    law_at = np.vstack(forms)
    return Observed(np.vstack(before), np.vstack(after), law_at[:, :-1], law_at[:, -1], tau)


def _filtered(
    g: np.ndarray, y: np.ndarray | None, library: list[Candidate], h: float, width: float
) -> np.ndarray:
    """Observables (n, p) through one kernel of `width` s; θ and θ̇ from the recorded angle y (n,) if given."""
    half = max(int(width / h) // 2, 3)
    s = np.arange(-half, half + 1) / half
    kernel = derivatives(s, 0)
    total = kernel.sum()
    smooth = np.column_stack([np.convolve(column, kernel / total, "valid") for column in g.T])
    if y is not None:
        slope = derivatives(s, 1) / (h * half) / total
        for i, one in enumerate(library):
            if one.damping == "viscous":
                smooth[:, i] = 2.0 * np.convolve(y, slope, "valid")
            elif one.name == "θ":
                smooth[:, i] = np.convolve(y, kernel / total, "valid")
    return smooth


def decomposed(observed: Observed, rank: float) -> Operator:
    """K by least squares on the directions of the dictionary that the record explores, and its generator."""
    both = np.vstack([observed.before, observed.after])
    scale = np.linalg.norm(both, axis=0)
    _, sizes, vectors = np.linalg.svd(np.linalg.qr(both / scale, mode="r"))
    kept = sizes > rank * sizes[0]
    turn = vectors[kept].T / sizes[kept]
    before, after = observed.before / scale @ turn, observed.after / scale @ turn
    forwards = np.linalg.lstsq(before, after, rcond=None)[0].T
    backwards = np.linalg.lstsq(after, before, rcond=None)[0].T
    generator = (_log(forwards) - _log(backwards)) / (2.0 * observed.lag)
    back = (vectors[kept] * sizes[kept, None]) * scale
    return Operator(forwards, generator, turn / scale[:, None], back)


def _log(matrix: np.ndarray) -> np.ndarray:
    values = np.linalg.eigvals(matrix)
    if np.any((np.abs(values.imag) <= 1e-12 * np.abs(values).max()) & (values.real <= 0)):
        raise Refusal("the one-step matrix has no logarithm: its eigenvalues reach zero or below")
    # scipy estimates norms inside with numpy's global random numbers: fixed here, and left as they were.
    before = np.random.get_state()
    np.random.seed(0)
    try:
        return np.real(np.asarray(logm(matrix)))
    finally:
        np.random.set_state(before)


PLUGIN = Koopman()
