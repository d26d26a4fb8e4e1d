"""Estimate damping by sparse identification of nonlinear dynamics (SINDy).

Section 3.4, equation 16, of the paper that `bayesdamp.estimators` cites.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np
from scipy.special import gammaln

from bayesdamp.estimators._protocol import Estimator, Options, optional_package
from bayesdamp.estimators.regression.library import (
    CandidateTerm,
    RecordToPredict,
    candidates,
    compare_selection,
    damping_values,
    residual_squares,
    restoring_values,
)
from bayesdamp.estimators.regression.oscillation_spline import OscillationSpline
from bayesdamp.estimators.shared import (
    before_gap,
    checked_features,
    free_start,
    integrate,
    known_restoring,
    motion,
    oscillator,
)
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import DERIVATIVES, Estimate, Problem, Refusal, Signal

RIDGES = (1e-8, 1e-3)
"""Weights of the ridge penalty, for columns and target of unit norm. For each of them the threshold is raised step by
step, so that functions of θ are removed one by one."""
TESTED = 2
"""Number of sparse solutions with functions of θ, for each set of damping terms, whose integrated predictions are
compared with the record."""
FLOOR = 1e-4
"""Smallest root mean square error of a prediction that is distinguished from zero, as a fraction of the amplitude."""
END = 0.5
"""Length at each end of a smoothed record, in periods, that the regression leaves out, because splines are inaccurate
there."""
MOST_CANCELLATION = 10.0
"""Largest sum of the rms of all terms (coefficient times column), as a multiple of the rms of the regression's target.
In a solution above it, large terms cancel each other and fit noise."""


class SindyOptions(Options):
    """Options of SINDy.

    switch: the form of friction in the library: "tanh" for tanh(θ̇/ε), "sign" for sign(θ̇) (section 3.4 of the paper
    that `bayesdamp.estimators` cites).
    """

    switch: Literal["tanh", "sign"] = "tanh"


@dataclass(frozen=True)
class Derivatives:
    """State and acceleration computed from the record.

    t, y (n,): times in s, and samples. theta, omega, alpha (n,): the motion at all samples, in rad, rad/s, rad/s² (or m
    for rad). rows (m,): indices of the samples that the regression uses. project: smooths values (n,) at all samples as
    the record is smoothed, and returns them at the rows, (m,). integrated: number of constants of integration that were
    guessed. freedom: effective number of independent rows.
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


@dataclass(frozen=True)
class SparseModel:
    """A sparse solution.

    support (p,): whether each term of the library is used. x (p,): the coefficients in natural units, 0 for unused
    terms. sound: whether its damping coefficients are not negative and its terms do not cancel each other. score:
    extended Bayesian information criterion of the predicted record; the smallest is best. It is ∞ if the solution is
    not sound.
    """

    support: np.ndarray
    x: np.ndarray
    sound: bool
    score: float = np.inf


class Sindy(Estimator[SindyOptions]):
    """Sparse regression of θ̈ + known force = −Θ(θ, θ̇) ξ on a library Θ, by pysindy's thresholded least squares.

    State and acceleration come from a smoothing spline for oscillations, and the library's columns are smoothed like
    the acceleration. A record without noise is interpolated. The known part of the restoring force is added to the
    acceleration.

    For every set of damping terms, functions of θ are removed one at a time by thresholds. The sparse solution is
    selected whose integrated prediction of the record has the smallest extended Bayesian information criterion
    (prediction test: Mangan, Kutz, Brunton and Proctor, Proceedings of the Royal Society A 473, 2017, 20170009;
    criterion: Chen and Chen, Biometrika 95, 2008, 759). The estimate comes from the best solution that has exactly the
    damping terms of the model. If another solution is selected, the outcome says so.
    """

    options = SindyOptions

    def initial(
        self, signal: Signal, problem: Problem, options: SindyOptions, rng: np.random.Generator
    ) -> Estimate:
        """Return the coefficients of a sparse regression of the acceleration (Brunton, Proctor and Kutz 2016).

        The outcome says if the selected solution has other terms.
        """
        optional_package("pysindy")
        features = checked_features(signal)
        state = _differentiate(signal, problem, features)
        library = candidates(problem, features, signal.unit, sharp=options.switch == "sign")
        law, known = oscillator(problem).law, known_restoring(problem)

        def force(theta: np.ndarray) -> np.ndarray:
            return law.linear_form(theta, known).offset

        functions = np.column_stack([c.function(state.theta, state.omega) for c in library])
        target = -(state.alpha[state.rows] + state.project(force(state.theta)))
        columns = np.column_stack([state.project(column) for column in functions.T])
        elapsed = state.t[state.rows] - state.t[0]
        drift = [elapsed**j for j in range(state.integrated if len(known) else 0)]
        if drift:  # wrong constants of integration add a constant and a linear trend to the force
            basis = np.linalg.qr(np.column_stack(drift))[0]
            columns, target = columns - basis @ (basis.T @ columns), target - basis @ (basis.T @ target)
        record = RecordToPredict(
            state.t, state.y, DERIVATIVES[signal.quantity], state.theta, state.omega, force, features.period
        )
        dissipates = np.array([candidate.damping is not None for candidate in library])
        own = np.array([candidate.damping in problem.damping for candidate in library])
        of_theta = np.array([candidate.restoring for candidate in library])
        path = sparse_models(columns, target, dissipates, state.freedom)
        floor = FLOOR * features.amplitude * features.frequency**record.order
        path = score_models(path, record, library, columns, target, floor)
        best = min((model for model in path if model.sound), key=lambda model: model.score)
        # The damping model is given: the estimate comes from a solution with exactly its damping terms.
        of_model = [model for model in path if np.array_equal(model.support & dissipates, own)]
        read = min(of_model, key=lambda model: (not model.sound, model.score))
        unknown = len(known) < len(law.parameters)

        values = damping_values(problem, library, read.x)
        if unknown:
            values |= restoring_values(problem, state.theta, functions[:, of_theta] @ read.x[of_theta])
        values |= free_start(problem, state.theta[0], state.omega[0])
        details = {
            "selected": [library[i].name for i in np.flatnonzero(best.support)],
            "coefficients": best.x[best.support].tolist(),
        }
        outcome = compare_selection(library, best.support, own | (of_theta & unknown))
        return Estimate(self.name, "initial", values, details=details, evaluations=len(path), outcome=outcome)


def _differentiate(signal: Signal, problem: Problem, features: Features) -> Derivatives:
    """Compute state and acceleration, by interpolation if the record has no noise, else by an oscillation spline."""
    plain, signal = motion(signal, problem, features), before_gap(signal, features.period)
    t, y = signal.t, signal.y
    if plain.clean:
        rows = np.flatnonzero(np.isin(t, plain.t))
        freedom = float(rows.size)
        return Derivatives(rows, t, y, *plain.everywhere, plain.project, plain.integrated, freedom)
    spline = OscillationSpline(t, y, features.period)
    end = min(END * features.period, 0.15 * float(t[-1] - t[0]))
    rows = np.flatnonzero((t >= t[0] + end) & (t <= t[-1] - end))
    curves, constants = (spline(0), spline(1), spline(2)), 0
    if DERIVATIVES[signal.quantity]:
        functions, constants = integrate(spline.curve(), signal, problem, features)
        curves = tuple(np.asarray(function(t)) for function in functions)
    return Derivatives(
        rows,
        t,
        y,
        *curves,
        project=lambda x: spline.smooth(x)[rows],
        integrated=constants,
        freedom=max(spline.freedom, 4.0),
    )


def sparse_models(
    columns: np.ndarray, target: np.ndarray, dissipates: np.ndarray, freedom: float
) -> list[SparseModel]:
    """Return sparse solutions: for every set of damping terms, without and with functions of θ.

    For each set of damping terms and each ridge, the threshold is raised so that functions of θ are removed one by one.
    Of these solutions the `TESTED` ones with the least Bayesian information criterion are kept, sound ones (see
    `SparseModel`) first; in it the number of samples is `freedom`, the effective number of independent rows. The list
    is in the order of the sets, not of the criterion. columns (n, p), target (n,): both sides of the regression, target
    = columns @ x. dissipates (p,): which terms are damping. Raises Refusal if the target is zero.
    """
    scale, size = np.linalg.norm(columns, axis=0), float(np.linalg.norm(target))
    if size == 0.0:
        raise Refusal("the known force explains the whole acceleration, so there is no damping to estimate")
    # An orthogonal transformation of the rows to p + 1 rows leaves the regression unchanged.
    small = np.asarray(np.linalg.qr(np.column_stack([columns / scale, target / size]), mode="r"))
    a, b = small[:, :-1], small[:, -1]
    damping, others = np.flatnonzero(dissipates), np.flatnonzero(~dissipates)

    def solution(mask: np.ndarray) -> tuple[SparseModel, float]:
        """Return the least squares solution with the terms in `mask`, and its residual sum of squares."""
        x = np.zeros(mask.size)
        x[mask] = np.linalg.lstsq(a[:, mask], b, rcond=1e-12)[0]
        sound = bool(np.all(x[dissipates] >= 0) and np.abs(x).sum() <= MOST_CANCELLATION)
        model = SparseModel(mask, x / (scale / size), sound)
        return model, float(np.sum((b - a @ x) ** 2))

    config_context = optional_package("sklearn").config_context
    stlsq = optional_package("pysindy").STLSQ
    path = []
    for chosen in product([False, True], repeat=damping.size):
        base = np.zeros(dissipates.size, bool)
        base[damping] = chosen
        basis = np.linalg.qr(a[:, base])[0]
        free, rest = (x - basis @ (basis.T @ x) for x in (a[:, others], b))
        with_others: dict[bytes, tuple[float, SparseModel]] = {}
        for ridge in RIDGES:
            threshold = 0.0
            while True:
                method = stlsq(threshold=threshold, alpha=ridge, max_iter=50, unbias=False)
                unchecked = config_context(skip_parameter_validation=True, assume_finite=True)
                with warnings.catch_warnings(), unchecked:
                    warnings.simplefilter("ignore")  # a warning that no term is left, which ends this path
                    weights = np.abs(np.asarray(method.fit(free, rest).coef_)[0])
                if not np.any(weights):
                    break
                mask = base.copy()
                mask[others] = weights != 0.0
                if mask.tobytes() not in with_others:
                    model, left = solution(mask)
                    score = freedom * np.log(left + 1e-300) + np.log(freedom) * mask.sum()
                    with_others[mask.tobytes()] = score, model
                threshold = max(float(weights[weights != 0.0].min()), threshold) * (1 + 1e-9) + 1e-300
        ranked = sorted(with_others.values(), key=lambda pair: (not pair[1].sound, pair[0]))
        path += [solution(base)[0], *(model for _, model in ranked[:TESTED])]
    return path


def score_models(
    path: list[SparseModel],
    record: RecordToPredict,
    library: list[CandidateTerm],
    columns: np.ndarray,
    target: np.ndarray,
    floor: float,
) -> list[SparseModel]:
    """Return the solutions with their scores n ln(s²) + k ln(n) + 2 ln(p choose k).

    n: number of samples. s²: mean square error of the prediction. k: number of terms in the solution, of p in the
    library. Solutions that are not sound have the score ∞ and come first in the result; the others keep the order of
    `path`. columns (n, p), target (n,): both sides of the regression, from whose norms the typical sizes of the
    coefficients follow. floor: smallest
    root mean square error of a prediction that is distinguished from zero, in the unit of the record.
    """
    unit = np.linalg.norm(target) / np.linalg.norm(columns, axis=0)
    sound = [model for model in path if model.sound]
    left = residual_squares(record, library, np.array([model.x for model in sound]), unit, floor)
    n, p = record.t.size, len(library)
    scored = [model for model in path if not model.sound]
    for model, square in zip(sound, left):
        k = int(model.support.sum())
        sets = float(gammaln(p + 1) - gammaln(k + 1) - gammaln(p - k + 1))
        score = n * float(np.log(square / n)) + k * float(np.log(n)) + 2 * sets
        scored.append(replace(model, score=score))
    return scored


PLUGIN = Sindy()
