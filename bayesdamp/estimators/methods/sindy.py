"""Estimate damping by sparse identification of nonlinear dynamics (SINDy).

The method is that of section 3.4, equation 16, of the paper that `bayesdamp.estimators` cites. Records with noise are
differentiated by `OscillationSpline`, a smoothing spline that penalises amplitudes and phases which do not change
linearly in time.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar
from scipy.special import gammaln

from bayesdamp.estimators.regression import (
    CandidateTerm,
    RecordToPredict,
    candidates,
    compare_selection,
    damping_values,
    residual_squares,
    restoring_values,
    selected_terms,
)
from bayesdamp.estimators.shared import (
    Estimator,
    Options,
    before_gap,
    checked_features,
    free_start,
    integrate,
    known_restoring,
    motion,
    optional_package,
    oscillator,
)
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import DERIVATIVES, Estimate, Problem, Refusal, Signal

DEGREE = 7
"""Degree of the smoothing splines; their penalty needs five derivatives."""
KNOTS_PER_PERIOD = 16.0
"""Number of knots of the smoothing spline in a period. It is larger than needed, because the penalty determines the
smoothing."""
DECADES = np.arange(-8.0, 6.0)
"""Values of log₁₀ λ at which the cross-validation score of the smoothing spline is first computed (λ: weight of its
penalty); the best value is then refined within ±1."""
PROBES = 32
"""Number of random vectors with which the trace of the smoothing matrix is estimated."""
OUTLIER = 6.0
"""Samples that deviate from the smoothing spline by more than this many robust standard deviations are left out of its
fit."""


class OscillationSpline:
    """The spline x that minimises Σ(y − x)² + λ (n/T) ∫(Lx)² dt, with λ chosen by generalised cross-validation.

    y are the n samples of the record, T is its duration, and ω its angular frequency. L = D(D² + ω²)²/ω⁵ with D = d/dt,
    so that λ has no unit. Lx is zero for a constant and for oscillations at ω whose amplitude and phase are linear in
    time (Heckman and Ramsay, Canadian Journal of Statistics 28, 2000, 241). Samples that deviate by more than `OUTLIER`
    robust standard deviations are left out of the sum, and the spline is fitted again. The times may be uneven.

    Arguments: the times (s) and samples of the record, (n,) each; the period (s). Attributes: coefficients, those of
    the B-splines; log_penalty, log₁₀ λ; freedom, trace of the smoothing matrix, which is the effective number of
    parameters. Raises Refusal if the samples are too few or too unevenly spaced.
    """

    def __init__(self, t: np.ndarray, y: np.ndarray, period: float) -> None:
        duration = float(t[-1] - t[0])  # uniform knots, at most one for two samples
        spacing = max(period / KNOTS_PER_PERIOD, 2.2 * duration / (t.size - 1))
        inner = np.linspace(t[0], t[-1], max(2, round(duration / spacing)) + 1)
        self.knots = np.r_[(t[0],) * DEGREE, inner, (t[-1],) * DEGREE]
        self._designs = [_design(self.knots, t, d).sorted_indices() for d in range(3)]
        self._penalty = _band(_penalty(self.knots, 2 * np.pi / period) * (y.size / duration))
        self.coefficients, self.freedom, self.log_penalty = np.zeros(0), 0.0, 0.0
        self._weight, self._factor = np.ones(y.size), np.zeros((0, 0))
        self._probes = np.random.default_rng(0).choice([-1.0, 1.0], (y.size, PROBES))
        self._choose(y)
        for _ in range(2):
            left = np.abs(y - self(0))
            good = left <= OUTLIER * 1.4826 * max(float(np.median(left)), 1e-300)
            if np.array_equal(good, self._weight > 0):
                break
            self._weight = good.astype(float)
            self._choose(y)

    def __call__(self, order: int) -> np.ndarray:
        """Return the smoothed record (order 0), or its first or second time derivative, at all samples, (n,)."""
        return self._designs[order] @ self.coefficients

    def curve(self) -> BSpline:
        """Return the spline as a function of time in s."""
        return BSpline(self.knots, self.coefficients, DEGREE)

    def smooth(self, x: np.ndarray) -> np.ndarray:
        """Smooth other values x (n,) at the same samples, with the penalty of the record; return them, (n,).

        The samples that were left out of the record's fit are left out here too.
        """
        return self._designs[0] @ self._solve(self._designs[0].T @ (self._weight * x))

    def _solve(self, right: np.ndarray) -> np.ndarray:
        return cho_solve_banded((self._factor, True), right)

    def _choose(self, y: np.ndarray) -> None:
        """Choose the penalty by generalised cross-validation, and fit the coefficients to y (n,).

        Sets `log_penalty`, `freedom` and `coefficients`. Raises Refusal if no penalty allows a fit.
        """
        b, count = self._designs[0], float(self._weight.sum())
        gram = _band(sparse.csr_matrix(b.T @ sparse.diags(self._weight) @ b))
        right, probes = b.T @ (self._weight * y), b.T @ (self._weight[:, None] * self._probes)

        def score(decade: float) -> float:
            try:
                self._factor = cholesky_banded(gram + 10.0**decade * self._penalty, lower=True)
            except LinAlgError:
                return np.inf
            self.coefficients = self._solve(right)
            self.freedom = float(np.sum(self._solve(probes) * probes)) / PROBES
            left = self._weight * (y - b @ self.coefficients)
            return float(left @ left) / max(1.0 - self.freedom / count, 1e-3) ** 2

        scores = [score(decade) for decade in DECADES]
        if not np.any(np.isfinite(scores)):
            raise Refusal("the samples are too few or too unevenly spaced for a smoothing spline")
        near = float(DECADES[int(np.argmin(scores))])
        best = minimize_scalar(
            score, bounds=(near - 1, near + 1), method="bounded", options={"xatol": 0.02, "maxiter": 20}
        )
        decade = float(best.x)  # pyright: ignore[reportAttributeAccessIssue]
        self.log_penalty = decade if score(decade) <= min(scores) else near
        score(self.log_penalty)


def _design(knots: np.ndarray, x: np.ndarray, order: int) -> sparse.csr_matrix:
    """Return the matrix that computes a spline, or a derivative of it, at x (n,) from the spline's coefficients.

    Its shape is (n, number of coefficients). knots: all knots, with repeated ends, in the unit of x. order: order of
    the derivative; 0 for the spline itself.
    """
    down = sparse.identity(knots.size - DEGREE - 1, format="csr")
    for d in range(order):
        degree, inner = DEGREE - d, knots[d : knots.size - d]
        gaps = inner[degree + 1 : -1] - inner[1 : -degree - 1]
        step = sparse.diags(degree / gaps) @ sparse.eye(gaps.size, gaps.size + 1, 1)
        step = step - sparse.diags(degree / gaps) @ sparse.eye(gaps.size, gaps.size + 1)
        down = sparse.csr_matrix(step @ down)
    inner = knots[order : knots.size - order]
    return sparse.csr_matrix(BSpline.design_matrix(x, inner, DEGREE - order) @ down)


def _penalty(knots: np.ndarray, frequency: float) -> sparse.csr_matrix:
    """Return the matrix M with which ∫(Lx)² dt = cᵀMc for a spline x with the coefficients c.

    L = D(D² + ω²)²/ω⁵ with D = d/dt. knots: all knots of the spline, with repeated ends, in s. frequency: ω in rad/s.
    """
    nodes, weights = np.polynomial.legendre.leggauss(DEGREE + 1)
    ends = knots[DEGREE : knots.size - DEGREE]
    half = np.diff(ends)[:, None] / 2
    x = ((ends[:-1, None] + ends[1:, None]) / 2 + half * nodes).ravel()
    first, third, fifth = (_design(knots, x, d) / frequency**d for d in (1, 3, 5))
    rough = first + 2.0 * third + fifth
    return sparse.csr_matrix(rough.T @ sparse.diags((half * weights).ravel()) @ rough)


def _band(matrix: sparse.csr_matrix) -> np.ndarray:
    """Return the lower band of a symmetric matrix in LAPACK's layout, (DEGREE + 1, size): row k has subdiagonal k."""
    return np.array([np.r_[matrix.diagonal(-k), np.zeros(k)] for k in range(DEGREE + 1)])


RIDGES = (1e-8, 1e-3)
"""Weights of the ridge penalty in thresholded least squares, for columns and target of unit norm. For each of them the
threshold, below which coefficients are set to zero, is raised step by step, so that functions of θ are removed one by
one."""
TESTED = 2
"""For each set of damping terms, number of sparse solutions with functions of θ that are tested by integration: their
predictions are compared with the record."""
FLOOR = 1e-4
"""Smallest root mean square error of a prediction that is distinguished from zero, as a fraction of the record's
amplitude."""
END = 0.5
"""Length at each end of a smoothed record, in periods, that the regression leaves out, because splines are inaccurate
there; it is at most 15 % of the record."""
MOST_CANCELLATION = 10.0
"""Largest sum of the rms of all terms (coefficient times column) of a solution, as a multiple of the rms of the
regression's target. In a solution above it, large terms cancel each other and fit noise."""


class SindyOptions(Options):
    """Options of SINDy.

    switch: the form of friction in the library: "tanh" for tanh(θ̇/ε) with the width ε of `epsilon_of` (if it is 0, for
    sign(θ̇)), "sign" for sign(θ̇) (section 3.4 of the paper that `bayesdamp.estimators` cites).
    """

    switch: Literal["tanh", "sign"] = "tanh"


@dataclass(frozen=True)
class Derivatives:
    """Displacement, velocity and acceleration that were computed from a record by differentiation.

    t, y (n,): times in s, and samples, before the first interruption of the sampling. theta, omega, alpha (n,): the
    motion at these times, in rad, rad/s, rad/s² (or m for rad). rows (m,): indices of the samples that the regression
    uses. project: smooths values (n,) at all n samples as the record is smoothed, and returns them at the rows, (m,).
    integrated: number of constants of integration that were guessed (0 for a recorded displacement). freedom: effective
    number of independent rows.
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
    """A solution of the sparse regression, with only some of the p candidate terms (the library).

    support (p,): whether each term is used. x (p,): coefficients of the unscaled terms, 0 for unused ones. sound:
    whether its damping coefficients are not negative and its terms do not cancel each other (`MOST_CANCELLATION`).
    score: extended Bayesian information criterion of the predicted record; the smallest is best. It is ∞ if the
    solution is not sound, and before `score_models`.
    """

    support: np.ndarray
    x: np.ndarray
    sound: bool
    score: float = np.inf


class Sindy(Estimator[SindyOptions]):
    """Solve θ̈ + known force = −Θ(θ, θ̇) ξ for a sparse ξ, by pysindy's thresholded least squares.

    Θ is a library of candidate terms, with a column for each term; ξ are their coefficients. State and acceleration
    come from a smoothing spline for oscillations, and the library's columns are smoothed like the acceleration. A
    record without noise is interpolated. The known part of the restoring force is added to the acceleration.

    For every set of damping terms, functions of θ are removed one at a time by thresholds. Each sparse solution is
    integrated to predict the record; the solution whose prediction has the smallest extended Bayesian information
    criterion is selected (prediction test: Mangan, Kutz, Brunton and Proctor, Proceedings of the Royal Society A 473,
    2017, 20170009; criterion: Chen and Chen, Biometrika 95, 2008, 759). The estimate comes from the best solution that
    has exactly the damping terms of the model; if none of these is sound (`SparseModel`), its coefficients may be
    negative. If the selected solution has other terms than the model, `outcome` is a sentence that names the
    differences.
    """

    options = SindyOptions

    def initial(
        self, signal: Signal, problem: Problem, options: SindyOptions, rng: np.random.Generator
    ) -> Estimate:
        """Return the coefficients of a sparse regression of the acceleration (Brunton, Proctor and Kutz 2016).

        If the regression selects other terms than those of the model, `outcome` is a sentence that names them;
        `details` has the names (`selected`) and coefficients (`coefficients`) of the terms that it selects. The
        estimate has only the model's terms, and no standard errors. Raises Refusal if pysindy is not installed, if
        `checked_features` or `motion` does, or if the target of the regression is zero.
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
        details = selected_terms(library, best.x, best.support)
        outcome = compare_selection(library, best.support, own | (of_theta & unknown))
        return Estimate(self.name, "initial", values, details=details, evaluations=len(path), outcome=outcome)


def _differentiate(signal: Signal, problem: Problem, features: Features) -> Derivatives:
    """Compute displacement, velocity and acceleration from a record.

    Only the record before its first interruption of the sampling is used. With negligible noise it is interpolated,
    otherwise smoothed by `OscillationSpline`. The rows of the result leave out the ends.
    """
    plain, signal = motion(signal, problem, features), before_gap(signal, features.period)
    t, y = signal.t, signal.y
    if plain.clean:
        rows = np.flatnonzero(np.isin(t, plain.t))
        return Derivatives(rows, t, y, *plain.everywhere, plain.project, plain.integrated, float(rows.size))
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
    """Return the solutions of a sparse regression among which the estimator chooses, for every set of damping terms.

    For each set there is the solution without functions of θ, and up to `TESTED` solutions with some. To find the
    latter, the threshold of the regression is raised for each weight in `RIDGES`, so that functions of θ are removed
    one by one. Sound solutions (see `SparseModel`) are preferred, then those with the smallest Bayesian information
    criterion, in which the number of samples is `freedom`, the effective number of independent rows. The list is in the
    order of the sets, not of the criterion. columns (n, p), target (n,): both sides of the regression, target
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
        """Return the least squares solution with the terms in `mask`, and its relative residual sum of squares.

        mask: whether each term is used, (p,). The solution is a model with all p coefficients (0 for unused terms) and
        the flag `sound` (see `SparseModel`). The sum of squares is divided by |target|².
        """
        x = np.zeros(mask.size)
        x[mask] = np.linalg.lstsq(a[:, mask], b, rcond=1e-12)[0]
        sound = bool(np.all(x[dissipates] >= 0) and np.abs(x).sum() <= MOST_CANCELLATION)
        return SparseModel(mask, x / (scale / size), sound), float(np.sum((b - a @ x) ** 2))

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
    """Return the solutions with their scores n ln(s²) + k ln(n) + 2 ln(p choose k), by which one is selected.

    This is the extended Bayesian information criterion; the smallest is best. n: number of samples. s²: mean square
    error of the prediction. k: number of terms in the solution, of p in the library. Solutions that are not sound have
    the score ∞ and come first in the result; the others keep the order of `path`. columns (n, p), target (n,): both
    sides of the regression, from whose norms the typical sizes of the coefficients follow. floor: smallest root mean
    square error of a prediction that is distinguished from zero, in the unit of the record.
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
