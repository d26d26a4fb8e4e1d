"""Fit a smoothing spline that penalises amplitudes and phases of an oscillation that do not change linearly in time."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar

from bayesdamp.types import Refusal

DEGREE = 7
"""Degree of the splines; the penalty needs five derivatives."""
KNOTS_PER_PERIOD = 16.0
"""Number of knots in a period. It is larger than needed, because the penalty determines the smoothing."""
DECADES = np.arange(-8.0, 6.0)
"""Values of log₁₀ λ at which the cross-validation score is first computed; the best is then refined within ± 1."""
PROBES = 32
"""Number of random vectors that estimate the trace of the smoothing matrix."""
OUTLIER = 6.0
"""Samples that deviate by more than this many robust standard deviations are left out."""


class OscillationSpline:
    """The spline x that minimises Σ(y − x)² + λ (n/T) ∫(Lx)² dt, with λ chosen by generalised cross-validation.

    L = D(D² + ω²)²/ω⁵ with D = d/dt, so that λ has no unit; T is the duration. Lx is zero for a
    constant and for oscillations at ω whose amplitude and phase are linear in time (Heckman and Ramsay, Canadian
    Journal of Statistics 28, 2000, 241). Samples that deviate by more than `OUTLIER` robust standard deviations are
    left out of the sum, and the spline is fitted again. The times may be uneven.

    Arguments: the times (s) and samples of the record, (n,) each; the period (s). Attributes: coefficients, those of
    the B-splines; log_penalty, log₁₀ λ; freedom, trace of the smoothing matrix, which is the effective number of
    parameters.
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
        """Return the derivative of an order (0 to 2) of the smoothed record at all samples, (n,)."""
        return self._designs[order] @ self.coefficients

    def curve(self) -> BSpline:
        """Return the spline as a function of time in s."""
        return BSpline(self.knots, self.coefficients, DEGREE)

    def smooth(self, x: np.ndarray) -> np.ndarray:
        """Return other values x (n,) at the same samples, smoothed in the same way, (n,)."""
        return self._designs[0] @ self._solve(self._designs[0].T @ (self._weight * x))

    def _solve(self, right: np.ndarray) -> np.ndarray:
        return cho_solve_banded((self._factor, True), right)

    def _choose(self, y: np.ndarray) -> None:
        """Choose the penalty by generalised cross-validation, and fit the coefficients to y (n,)."""
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
    """Return the matrix that maps spline coefficients to the derivative of an order at x (n,).

    Its shape is (n, number of coefficients). knots: all knots, with repeated ends, in the unit of x. order: 0 for the
    spline itself.
    """
    size = knots.size - DEGREE - 1
    down = sparse.identity(size, format="csr")
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
    w = (half * weights).ravel()
    first, third, fifth = (_design(knots, x, d) / frequency**d for d in (1, 3, 5))
    rough = first + 2.0 * third + fifth
    return sparse.csr_matrix(rough.T @ sparse.diags(w) @ rough)


def _band(matrix: sparse.csr_matrix) -> np.ndarray:
    """Return the lower band of a symmetric matrix in LAPACK's layout, (DEGREE + 1, size)."""
    return np.array([np.r_[matrix.diagonal(-k), np.zeros(k)] for k in range(DEGREE + 1)])
