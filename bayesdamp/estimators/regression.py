"""Define the candidate terms of a regression, predict records from sums of them, and compute the model's parameters.

Sections 3.4 and 3.12 of the paper that `bayesdamp.estimators` cites.

In the weak form, each row of the regression is the equation of motion times one test function φ (zero outside a short
interval), integrated over time. The inertia of a row is ∫φ θ̈ dt plus the integral of the known force, and its columns
are the integrals of the candidate terms. The rows have correlated errors, and their columns have noise.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy import sparse
from scipy.interpolate import CubicHermiteSpline, make_interp_spline
from scipy.signal import savgol_coeffs, savgol_filter

from bayesdamp.estimators.shared import epsilon_of, further_values, known_restoring, oscillator, solve
from bayesdamp.physics.damping import PAPER_TERMS, TERMS
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import OK, Problem

SHAPES = {"viscous": "2θ̇", "coulomb": "tanh(θ̇/ε)", "quadratic": "θ̇|θ̇|"}
"""Formulae of the shapes of damping terms, by name; other terms are shown by their names."""
STEPS = 100
"""Number of Runge–Kutta steps in a period, for predictions."""
TABLE = 4001
"""Number of entries in the tables of functions of θ, which cover twice the record's range."""
STEP = 1e-3
"""Step of finite differences: a coefficient changes by this fraction of its typical size, and displacement and velocity
at the start by a tenth of this fraction of their amplitudes."""


@dataclass(frozen=True)
class CandidateTerm:
    """A function of displacement and velocity, (n,) each, in a library.

    name: formula for reports, or the name of a damping term. damping: name of the damping term with this shape; None if
    it is not damping. restoring: whether it depends on θ only. jumps: whether it is discontinuous where the velocity
    changes sign.
    """

    name: str
    function: Callable[[np.ndarray, np.ndarray], np.ndarray]
    damping: str | None = None
    restoring: bool = False
    jumps: bool = False


def candidates(
    problem: Problem, features: Features, unit: str, *, sharp: bool = False, mixed: bool = False
) -> list[CandidateTerm]:
    """Return the library: shapes of viscous, Coulomb and quadratic damping and of the problem's terms, then others.

    The others are functions of θ: 1, θ, cos θ, sin θ, θ² and θ³.

    Parameters
    ----------
    problem
        The damping terms, and what is known of the system.
    features
        Features of the record.
    unit
        Unit of the displacement, "rad" or "m"; the library of a record in metres has no cos θ and sin θ.
    sharp
        Whether friction is sign(θ̇) instead of tanh(θ̇/ε).
    mixed
        Whether the library also includes θ̇² and θθ̇, as its last functions.
    """
    epsilon = 0.0 if sharp else epsilon_of(problem, features)
    arguments = further_values(problem, features)
    library = []
    for name in dict.fromkeys((*PAPER_TERMS, *problem.damping)):
        term = TERMS.get(name)
        written = "sign(θ̇)" if name == "coulomb" and epsilon == 0.0 else SHAPES.get(name, name)
        further = [arguments[n] for n in term.further]
        shape = lambda x, v, term=term, q=further: np.asarray(term.force(x, v, epsilon, *q))  # noqa: E731
        library.append(CandidateTerm(written, shape, damping=name, jumps=term.switches and epsilon == 0.0))
    of_angle: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "1": np.ones_like,
        "θ": lambda x: x,
        "cos θ": np.cos,
        "sin θ": np.sin,
        "θ²": lambda x: x**2,
        "θ³": lambda x: x**3,
    }
    for name, f in of_angle.items():
        if unit == "rad" or name not in ("cos θ", "sin θ"):
            library.append(CandidateTerm(name, lambda x, v, f=f: f(x), restoring=True))
    if mixed:
        library.append(CandidateTerm("θ̇²", lambda x, v: v**2))
        library.append(CandidateTerm("θθ̇", lambda x, v: x * v))
    return library


def restoring_values(problem: Problem, theta: np.ndarray, force: np.ndarray) -> dict[str, float]:
    """Return the unknown restoring parameters, by name, that fit an estimated force by least squares.

    The result is empty if all are known.

    theta (n,): displacements. force (n,): estimate of F_rest(θ) at these displacements, per unit of inertia, in rad/s²
    or m/s²; the equation of motion is θ̈ + F_rest(θ) + damping = 0. The known part of F_rest, which is the `offset` of
    the law's `LinearForm`, is not included.
    """
    form = oscillator(problem).law.linear_form(theta, known_restoring(problem))
    if form.columns.shape[1] == 0:
        return {}
    return form.decode(solve(form.columns, force, 1e-12))


def damping_values(problem: Problem, library: list[CandidateTerm], x: np.ndarray) -> dict[str, float]:
    """Return the problem's damping coefficients, by name, of the coefficients x (p,) of all terms of the library."""
    index = {candidate.damping: i for i, candidate in enumerate(library) if candidate.damping}
    return {term.parameter: float(x[index[term.name]]) for term in oscillator(problem).terms}


def compare_selection(library: list[CandidateTerm], selected: np.ndarray, model: np.ndarray) -> str:
    """Return OK if a sparse regression selects the model's terms, otherwise a sentence that names the differences.

    The selection must contain all damping terms of the model and no term outside it. selected (p,): whether each term
    of the library is selected. model (p,): whether the model allows each term; a function of θ that it allows may be
    left out.
    """
    names = [candidate.name for candidate in library]
    of_damping = np.array([candidate.damping is not None for candidate in library])
    missing = [names[i] for i in np.flatnonzero(of_damping & model & ~selected)]
    extra = [names[i] for i in np.flatnonzero(selected & ~model)]
    faults = [f"without {' and '.join(missing)}, which the model has"] if missing else []
    faults += [f"with {' and '.join(extra)}, which the model does not have"] if extra else []
    terms = ", ".join(names[i] for i in np.flatnonzero(selected)) or "nothing"
    return f"the sparse regression selects {terms}: {'; '.join(faults)}" if faults else OK


@dataclass(frozen=True)
class RecordToPredict:
    """A record that models predict.

    t, y (n,): times and samples. order: order of the recorded derivative of the displacement. theta, omega (n,): the
    smoothed state. known: the known restoring force as a function of angles (m,). period: in s.
    """

    t: np.ndarray
    y: np.ndarray
    order: int
    theta: np.ndarray
    omega: np.ndarray
    known: Callable[[np.ndarray], np.ndarray]
    period: float


def residual_squares(
    record: RecordToPredict, library: list[CandidateTerm], x: np.ndarray, unit: np.ndarray, floor: float
) -> np.ndarray:
    """Return the residual sum of squares (m,), in the squared unit of the record, of predictions by models x (m, p).

    Row i of x has the coefficients of model i, in the order of the library; 0 for terms that it does not have.
    The start and the nonzero coefficients of each model are first improved by one Gauss–Newton step, so that errors of
    the regression do not count. unit (p,): typical sizes of the coefficients, from which the steps of difference
    quotients follow. floor: smallest root mean square residual; smaller ones are replaced by this value.
    """
    size = np.array([np.ptp(record.theta) / 2, np.abs(record.omega).max()])
    start = np.array([record.theta[0], record.omega[0]])
    points = np.column_stack([np.tile(start, (len(x), 1)), x])
    steps = np.diag(np.r_[0.1 * STEP * size, STEP * unit])
    changes = [steps[np.r_[True, True, coefficients != 0]] for coefficients in x]
    trials = np.vstack([points, *(point + move for point, move in zip(points, changes))])
    curves = predict(record, library, trials[:, 2:], trials[:, :2])
    ends = np.cumsum([len(x), *map(len, changes)])[:-1]
    squares = []
    for curve, others in zip(curves.T, np.split(curves, ends, axis=1)[1:]):
        by = others - curve[:, None]
        scale = np.maximum(np.linalg.norm(by, axis=0), 1e-300)
        left = record.y - curve
        left = left - by / scale @ np.linalg.lstsq(by / scale, left, rcond=1e-10)[0]
        squares.append(float(left @ left))
    return np.maximum(squares, record.t.size * floor**2)


def predict(
    record: RecordToPredict, library: list[CandidateTerm], x: np.ndarray, start: np.ndarray
) -> np.ndarray:
    """Predict the recorded quantity by each of m models, (n, m).

    Model i is θ̈ = −(known force) − Σ x[i, j] · (function j of the library), with x (m, p). start: displacement and
    velocity of each model at the first sample, (m, 2). Forces other than damping are read from a table over θ, computed
    at θ̇ = 0. Where a motion exceeds twice the range of the record, every force keeps its value at this limit.
    """
    t, theta, omega = record.t, record.theta, record.omega
    middle, half = (theta.max() + theta.min()) / 2, np.ptp(theta)
    angles = middle + half * np.linspace(-1, 1, TABLE)
    fastest = 2 * float(np.abs(omega).max())
    damping = np.array([candidate.damping is not None for candidate in library])
    values = np.column_stack([c.function(angles, np.zeros(TABLE)) for c in library if not c.damping])
    table = record.known(angles)[:, None] + values @ x[:, ~damping].T
    resisting = [c.function for c in library if c.damping]
    every = np.arange(x.shape[0])

    def slope(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        position = np.clip(((q - middle) / half + 1) * ((TABLE - 1) / 2), 0, TABLE - 1.001)
        i = position.astype(int)
        part = position - i
        force = table[i, every] * (1 - part) + table[i + 1, every] * part
        q, v = np.clip(q, angles[0], angles[-1]), np.clip(v, -fastest, fastest)
        for function, coefficients in zip(resisting, x[:, damping].T):
            force += coefficients * function(q, v)
        return -force

    count = max(int(np.ceil((t[-1] - t[0]) / record.period * STEPS)), 8)
    h = (t[-1] - t[0]) / count
    q, v = start[:, 0].copy(), start[:, 1].copy()
    path = np.empty((3, count + 1, x.shape[0]))
    for i in range(count + 1):
        a1 = slope(q, v)
        path[:, i] = q, v, a1
        v2 = v + h / 2 * a1
        a2 = slope(q + h / 2 * v, v2)
        v3 = v + h / 2 * a2
        a3 = slope(q + h / 2 * v2, v3)
        v4 = v + h * a3
        a4 = slope(q + h * v3, v4)
        q, v = q + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    nodes = np.linspace(t[0], t[-1], count + 1)
    rate = path[record.order + 1] if record.order < 2 else np.gradient(path[2], h, axis=0, edge_order=2)
    return np.asarray(CubicHermiteSpline(nodes, path[record.order], rate)(t))


POWER = 6
"""Power of the test function φ(s) = (1 − s²)^POWER on [−1, 1]; the trapezoidal rule is then exact to rounding."""
DEGREE = 6
"""Degree of the polynomials whose derivatives are the velocities."""
OVERLAP = 8
"""Number of test functions that begin within the width of one of them."""
LEAST_EIGENVALUE = 1e-7
"""Eigenvectors of the rows' covariance with an eigenvalue below this fraction of the largest are left out."""
FLOOR = 1e-6
"""Smallest rms residual that is distinguished from zero, as a fraction of the rms inertia (∫φ θ̈ dt) of all rows."""
NOISELESS = 1e-7
"""If the noise of a row with whitened errors is below this fraction of its inertia (∫φ θ̈ dt), the bias that noise
causes is not computed."""


@dataclass(frozen=True)
class Stretch:
    """The record before its first gap, with uniformly spaced samples.

    h: sampling interval in s. y (n,): the recorded quantity. theta, omega (n,): the state, at which functions of the
    library are evaluated. velocity (n, n): the matrix from samples to omega; zero for a recorded velocity or
    acceleration. order: order of the recorded derivative of the displacement, 0 to 2.
    """

    h: float
    y: np.ndarray
    theta: np.ndarray
    omega: np.ndarray
    velocity: sparse.csr_matrix
    order: int


def to_even_clock(t: np.ndarray, h: float, *curves: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return uniform times with the interval h (s), and curves at these times, from their values at the times t (n,).

    The curves are interpolated by cubic splines if an interval of t differs from h by more than a thousandth of h; the
    number of values may then differ from n. Otherwise t and the curves are returned unchanged.
    """
    if np.all(np.abs(np.diff(t) - h) <= 1e-3 * h):
        return (t, *curves)
    even = t[0] + h * np.arange(int((t[-1] - t[0]) / h + 1e-6) + 1)
    return (even, *(np.asarray(make_interp_spline(t, curve, k=3)(even)) for curve in curves))


def derivatives(s: np.ndarray, order: int) -> np.ndarray:
    """Return the derivative of an order of (1 − s²)^POWER by s; 0 outside [−1, 1]. The shape is that of s."""
    bump = np.polynomial.Polynomial([1.0, 0.0, -1.0]) ** POWER
    return np.where(np.abs(s) < 1, bump.deriv(order)(s) if order else bump(s), 0.0)


def test_function_weights(n: int, h: float, width: float, order: int) -> sparse.csr_matrix:
    """Return the weights (m, n) by which n samples, h (s) apart, are integrated against derivatives of test functions.

    Row j is (−1)^order h φ_j^(order), where φ_j has unit integral, is `width` (s) wide (or more, if that is too few
    samples), and is entirely within the samples. Each function begins an eighth of the width (`OVERLAP`) after the one
    before.
    """
    half = max(int(width / h) // 2, POWER)
    step = max(2 * half // OVERLAP, 1)
    centres = np.arange(half, n - half, step)
    s = np.arange(-half, half + 1) / half
    norm = h * half * float(np.sum(derivatives(s, 0))) / half
    row = (-1) ** order * h * derivatives(s, order) / (h * half) ** order / norm
    columns = centres[:, None] + np.arange(-half, half + 1)
    starts = np.arange(centres.size + 1) * row.size
    return sparse.csr_matrix((np.tile(row, centres.size), columns.ravel(), starts), shape=(centres.size, n))


def kernel_half_width(h: float, frequency: float, size: float, noise: float, most: int) -> int:
    """Return the half width (samples) of the derivative kernel whose velocity has the smallest mean square error.

    The assumed velocity has amplitude `size` at `frequency` (rad/s) and a third harmonic of one hundredth of it, as dry
    friction causes; the displacement has white noise of standard deviation `noise`. size: in rad/s or m/s; noise: in
    rad or m. h: sampling interval in s. most: largest half width in samples.
    """
    best, least = 4, np.inf
    for half in range(4, max(most, 4) + 1, max(1, most // 60)):
        j = np.arange(-half, half + 1)
        kernel = savgol_coeffs(j.size, DEGREE, deriv=1, delta=h, use="dot")
        wrong = 0.0
        for factor, fraction in ((1, 1.0), (3, 0.01)):
            w = factor * frequency
            wrong += (fraction * size * (float(kernel @ np.sin(w * j * h)) / w - 1.0)) ** 2 / 2
        wrong += noise**2 * float(kernel @ kernel)
        if wrong < least:
            best, least = half, wrong
    return best


def velocity_map(n: int, h: float, half: int) -> sparse.csr_matrix:
    """Return the matrix (n, n) that computes velocities from n displacements, h (s) apart.

    Row i has the weights of Savitzky and Golay: the derivative at sample i of a polynomial of degree `DEGREE` (less if
    n is small) that is fitted to the 2 half + 1 nearest samples.
    """
    half = min(half, (n - 1) // 2)
    width = 2 * half + 1
    degree = min(DEGREE, 2 * half)
    window = np.asarray(savgol_filter(np.eye(width), width, degree, deriv=1, delta=h, axis=0))
    middle = np.tile(window[half], (n - 2 * half, 1))
    columns = np.clip(np.arange(n) - half, 0, n - width)[:, None] + np.arange(width)
    values = np.vstack([window[:half], middle, window[half + 1 :]])
    return sparse.csr_matrix((values.ravel(), columns.ravel(), width * np.arange(n + 1)), shape=(n, n))


@dataclass(frozen=True)
class Rows:
    """The weak form, inertia + columns · x = 0 apart from noise, for m test functions φ and p terms f, coefficients x.

    inertia (m,): ∫φ θ̈ dt plus the integral of the known force. columns (m, p): ∫φ f dt for each term f.
    inertia_slopes, columns_slopes: the derivatives by the n samples of the inertia and of each column, (m, n) each.
    """

    inertia: np.ndarray
    columns: np.ndarray
    inertia_slopes: sparse.csr_matrix
    columns_slopes: list[sparse.csr_matrix]


@dataclass(frozen=True)
class WhiteRows:
    """The weak form (`Rows`), transformed so that its errors are independent and have the variance of a sample's noise.

    inertia (p + 1,), columns (p + 1, p): after a further orthogonal transformation that reduces the rows to p + 1.
    count: number of rows before this reduction. moments (p + 1, p + 1): traces tr(C⁻¹B_k B_lᵀ), with the covariance C
    of the rows for unit noise of the samples, and the derivatives B_k by the samples of each column and, last, of the
    inertia.
    """

    inertia: np.ndarray
    columns: np.ndarray
    count: int
    moments: np.ndarray


def whiten(rows: Rows, x: np.ndarray, sigma: float, wanted: np.ndarray) -> WhiteRows:
    """Return the rows, transformed so that their errors are independent if the coefficients are x (p,).

    sigma: standard deviation of the samples' noise, in the unit of the record. wanted (p,) of bool: the columns whose
    moments are computed; the others are 0, and all are 0 if the noise is negligible (`NOISELESS`).
    """
    slopes = [*rows.columns_slopes, rows.inertia_slopes]
    of_rows = sum((c * b for c, b in zip(x, slopes) if c != 0.0), rows.inertia_slopes)
    values, vectors = np.linalg.eigh((of_rows @ of_rows.T).toarray())
    sound = values > LEAST_EIGENVALUE * values[-1]
    turn = (vectors[:, sound] / np.sqrt(values[sound])).T
    metric = turn.T @ turn
    moments = np.zeros((x.size + 1, x.size + 1))
    if sigma > NOISELESS * float(np.linalg.norm(rows.inertia) / np.sqrt(max(np.trace(metric), 1e-300))):
        of = np.r_[np.flatnonzero(wanted), x.size]
        for place, i in enumerate(of):
            image = slopes[i].T @ metric
            for j in of[: place + 1]:
                moments[i, j] = slopes[j].T.multiply(image).sum()
    moments = np.tril(moments) + np.tril(moments, -1).T
    small = np.asarray(np.linalg.qr(np.column_stack([turn @ rows.columns, turn @ rows.inertia]), mode="r"))
    return WhiteRows(small[:, -1], small[:, :-1], turn.shape[0], moments)


@dataclass(frozen=True)
class Solution:
    """A sparse solution: coefficients x (p,) and their standard errors (p,).

    support (p,): whether each term is used. left: residual sum of squares. expected: its expectation from the noise of
    inertia and columns. sound: whether the terms can be distinguished despite the noise; otherwise the coefficients are
    not corrected for bias. score: Bayesian information criterion for errors of known size; the smallest is best.
    """

    support: np.ndarray
    x: np.ndarray
    stderr: np.ndarray
    left: float
    expected: float
    sound: bool
    score: float = np.inf


def solve_support(white: WhiteRows, support: np.ndarray, sigma: float) -> Solution:
    """Return the solution with the terms in `support` (p,), corrected for the bias from noise in their columns.

    white: the weak form with independent errors. support: mask of the terms that are used. sigma: standard deviation σ
    of the samples' noise n. The residual r = b + Gx, with the inertia b and the columns G,
    has the noise (A₀ + Σ x_l B_l) n, where A₀ and B_l are the derivatives of b and of column l by the samples. With its
    covariance C for σ = 1, the mean of (GᵀC⁻¹r)_k is σ² [tr(C⁻¹B_k A₀ᵀ) + Σ_l x_l tr(C⁻¹B_k B_lᵀ)], which is
    subtracted.
    """
    terms = np.flatnonzero(support)
    scale = np.linalg.norm(white.columns[:, terms], axis=0)
    a, b = white.columns[:, terms] / scale, white.inertia
    own = sigma**2 * white.moments[np.ix_(terms, terms)] / np.outer(scale, scale)
    mixed = sigma**2 * white.moments[terms, -1] / scale
    gram = a.T @ a
    inverse = np.linalg.pinv(a, rcond=1e-12)
    plain = -inverse @ b
    free = gram - own
    sound = bool(np.linalg.eigvalsh(free)[0] > 0.5 * np.linalg.eigvalsh(gram)[0]) if terms.size else True
    # The correction is added to the plain solution, so that there is no loss of digits without noise.
    x = plain + (np.linalg.solve(free, mixed + own @ plain) if sound else 0.0)
    left = float(np.sum((b + a @ x) ** 2))
    sd = np.sqrt(left / max(white.count - terms.size, 1))
    full, stderr = np.zeros(support.size), np.zeros(support.size)
    full[terms], stderr[terms] = x / scale, sd * np.sqrt(np.sum(inverse**2, axis=1)) / scale
    weights_of_noise = np.r_[full, 1.0]
    expected = sigma**2 * float(weights_of_noise @ white.moments @ weights_of_noise)
    return Solution(support, full, stderr, left, expected, sound)


def sparse_path(white: WhiteRows, dissipates: np.ndarray, sigma: float) -> list[Solution]:
    """Return sparse solutions: for every set of damping terms, other terms are removed in the order of their t-values.

    The score is the Bayesian information criterion for errors of known size. Solutions with negative damping, and those
    whose terms cannot be distinguished despite the noise, are excluded. The list is not sorted by the score, and can be
    empty. white: the weak form with independent errors. dissipates (p,): which terms are damping. sigma: standard
    deviation of the samples' noise, in the unit of the record.
    """
    floor = FLOOR * float(np.linalg.norm(white.inertia)) / np.sqrt(white.count)
    damping = np.flatnonzero(dissipates)
    path = []
    for chosen in product([False, True], repeat=damping.size):
        mask = ~dissipates
        mask[damping] = chosen
        while mask.any():
            solution = solve_support(white, mask.copy(), sigma)
            t = np.where(mask, np.abs(solution.x) / np.maximum(solution.stderr, 1e-300), np.inf)
            if solution.sound and np.all(solution.x[dissipates] >= 0):
                variance = solution.expected / white.count + floor**2
                score = solution.left / variance + white.count * np.log(variance)
                score += mask.sum() * np.log(white.count)
                path.append(replace(solution, score=float(score)))
            others = np.flatnonzero(mask & ~dissipates)
            if others.size == 0:
                break
            mask[others[np.argmin(t[others])]] = False
    return path
