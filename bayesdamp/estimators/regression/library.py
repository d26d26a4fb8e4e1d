"""Define the candidate terms of a regression, predict records from sums of them, and compute the model's parameters.

Sections 3.4 and 3.12 of the paper that `bayesdamp.estimators` cites.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

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

    theta (n,): displacements. force (n,): estimate of F_rest(θ) there, in θ̈ + F_rest(θ) + damping = 0 (per unit of
    inertia, in rad/s² or m/s²), without its known part, the `offset` of the law's `LinearForm`.
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
    """Return OK if a sparse regression selects all damping terms of the model and no term outside it, else a sentence.

    The sentence names the terms that are missing or superfluous. selected (p,): whether each term of the library is
    selected. model (p,): whether the model allows each term; a function of θ that it allows may be left out.
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
