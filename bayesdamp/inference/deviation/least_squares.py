"""Fit a motion under exact laws to a record by Levenberg–Marquardt (Moré 1977), with coefficients ≥ 0.

The first cycles are fitted first, and then longer and longer parts of the record, so that the motion stays in phase
with the record. Under exact laws, damping and restoring force have no deviations from their formulas.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.numerics.levenberg_marquardt import FIRST_LAMBDA, MIN_LAMBDA
from bayesdamp.physics.amplitude import AmplitudeSolver
from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.physics.kernel.solve import TOLERANCE

LESS, MORE, AGAIN, MOST_DAMPING = 0.2, 8.0, 1e-6, 1e8
"""Rules for Marquardt's damping parameter λ in a fit (conventional). After a successful step λ is multiplied by `LESS`.
After a failed step it is raised to at least `AGAIN` and then multiplied by `MORE`. From `MOST_DAMPING` on, no further
step is tried."""
MOST_STEPS = 40
"""Largest number of successful Levenberg–Marquardt steps in one search (conventional)."""
ROUGH, CLOSE = 1e-2, 1e-6
"""The search ends when a step decreases the sum of squares by less than this relative amount. `ROUGH` is for parts of
the record and for rough fits, `CLOSE` for the last search over the whole record."""
NOTHING = 0.1
"""A step is tried only if the linear model predicts a decrease of the sum of squares that is at least this fraction of
the decrease at which the search ends (`ROUGH`, `CLOSE`); otherwise the search ends at once."""
LARGEST = 1e100
"""A fit fails if the absolute value of a derivative of the motion is not below this: the motion then depends
chaotically on its start, and sums of squares overflow. The derivatives are by the inferred parameters, transformed so
that their priors are standard normal (conventional)."""
FIRST_CYCLES = 2.0
"""Length in cycles of the first part of the record that is fitted; each further part is twice as long, and the last is
the whole record."""
SEARCHED = 1e-7
"""Error of an integration step, as a fraction of the amplitude, in rough searches and for some linearisations. Larger
errors miss the corners of the motion where friction changes its sign (measured: at 1e-6 an upper limit of another form
of damping is a tenth too low)."""


@dataclass(frozen=True)
class LeastSquaresFit:
    """The least-squares fit of a motion under exact laws (without deviations) to a record.

    Attributes
    ----------
    parameters : Parameters
        Inferred and known parameters.
    active : ndarray of bool, shape (m,)
        Marks which of the solver's m damping terms belong to this model.
    z : ndarray, shape (d,)
        The d inferred parameters at the fit, each transformed so that its prior is standard normal (scores).
    residual : ndarray, shape (n,)
        Record minus motion, in the record's unit.
    tangents : ndarray, shape (n, d)
        Jacobian of the motion by the scores z, in the record's unit.
    motion : Motion
        The motion at the fit, without its derivatives.
    """

    parameters: Parameters
    active: np.ndarray
    z: np.ndarray
    residual: np.ndarray
    tangents: np.ndarray
    motion: Motion

    @property
    def values(self) -> np.ndarray:
        """Return the values of all parameters of the solver at the fit, (k,), in the order of `Solver.names`."""
        return self.parameters.values(self.z)

    @property
    def squares(self) -> float:
        """Return the sum of the squared residuals, in the record's unit squared."""
        return float(self.residual @ self.residual)


def nonnegative(root: np.ndarray, target: np.ndarray, positive: np.ndarray) -> np.ndarray:
    """Return the vector u, (d,), that minimises |root u − target|², where elements marked by `positive` must be ≥ 0.

    root: (n, d). target: (n,). positive: booleans, (d,).
    """
    basis, triangle = np.linalg.qr(root[:, ~positive])
    part, u = root[:, positive], np.zeros(root.shape[1])
    if positive.any():
        outside = part - basis @ (basis.T @ part)
        u[positive] = scipy.optimize.nnls(outside, target - basis @ (basis.T @ target))[0]
    u[~positive] = np.linalg.solve(triangle, basis.T @ (target - part @ u[positive]))
    return u


def fit(
    solver: Solver | AmplitudeSolver,
    parameters: Parameters,
    active: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
    *,
    noise: float,
    windows: bool = True,
    rough: bool = False,
) -> LeastSquaresFit | None:
    """Fit a motion under exact laws to a record by least squares, including the priors of the parameters.

    It minimises |residual|² + variance |z|², where z are the parameters, transformed so that their priors are standard
    normal (scores), and `variance` is the variance of the noise. No parameter with a half-normal prior, such as a
    coefficient, becomes negative. Return None if the motion at the start of the search in a part of the record is
    unbounded, or if a motion depends chaotically on its parameters.

    Parameters
    ----------
    solver : Solver or AmplitudeSolver
        Solver of the motions.
    parameters : Parameters
        Inferred and known parameters.
    active : ndarray of bool, shape (m,)
        Marks which of the solver's m damping terms exert a force.
    y : ndarray, shape (n,)
        The record, in the form in which the solver returns motions.
    z : ndarray, shape (d,)
        Standard normal scores of the inferred parameters from which the search starts.
    noise : float
        Lower bound of the noise's sd, in the record's unit. The sd is estimated from the residual; its square is the
        factor `variance` of the priors.
    windows : bool
        Whether to fit the first two cycles first, and then longer and longer parts, so that the motion stays in phase
        with the record. If false, the whole record is fitted at once.
    rough : bool
        Whether to end early, with larger errors. This is for a fit that is only compared with fits from other starts.
    """
    stages: list[tuple[int | None, bool]] = []
    span = FIRST_CYCLES * 2 * np.pi / solver.frequency
    while windows and span < 0.7 * solver.t[-1]:
        stop = int(np.searchsorted(solver.t, span))
        if stop >= 3 * z.size:
            stages.append((stop, True))
        span *= 2
    stages.append((None, rough))
    best = None
    for stop, is_rough in stages:
        best = _search(solver, parameters, active, y[:stop], z, noise, is_rough)
        if best is None:
            return None
        z = best.z
    return best


def _search(
    solver: Solver | AmplitudeSolver,
    parameters: Parameters,
    active: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
    noise: float,
    rough: bool,
) -> LeastSquaresFit | None:
    """Fit the motion to the first values y, (n,), of a record by Levenberg–Marquardt steps from the scores z.

    Parameters are those of `fit`. rough: whether to use the larger tolerances for parts of the record and for rough
    fits. Return None if the motion at z is unbounded, or if a motion depends chaotically on its parameters.
    """
    tolerance, close = (SEARCHED, ROUGH) if rough else (TOLERANCE, CLOSE)

    def solve(z: np.ndarray) -> Motion | None:
        return solver.solve(parameters.values(z), active, stop=y.size, tolerance=tolerance)

    def fit_at(z: np.ndarray, motion: Motion, jacobian: np.ndarray) -> LeastSquaresFit:
        return LeastSquaresFit(parameters, active, z, y - motion.y, jacobian, motion.without_tangents())

    motion, damping, steps, last = solve(z), FIRST_LAMBDA, 0, False
    if motion is None:
        return None
    while True:
        r, jacobian = y - motion.y, parameters.by_scores(motion.tangents, z)
        if not np.abs(jacobian).max() < LARGEST:
            return None
        if last:
            return fit_at(z, motion, jacobian)
        variance = max(float(r @ r) / r.size, noise**2)
        whole = np.asarray(np.linalg.qr(np.column_stack([jacobian, r]), mode="r"))
        d = jacobian.shape[1]
        triangle, target = whole[:d, :d], whole[:d, d]
        # Linearised about z, the cost (squared residuals + variance · squared scores) is |plain u − wanted|² + left.
        plain = np.concatenate([triangle, np.sqrt(variance) * np.eye(z.size)])
        wanted = np.concatenate([target + triangle @ z, np.zeros(z.size)])
        left = float(r @ r) - float(target @ target)
        # Marquardt's scale includes the prior; otherwise a score that does not change the motion would jump to 0.
        scale = np.linalg.norm(plain, axis=0)
        cost = float(r @ r) + variance * float(z @ z)
        while True:
            root = np.concatenate([plain, np.diag(np.sqrt(damping) * scale)])
            aim = np.concatenate([wanted, np.sqrt(damping) * scale * z])
            new = nonnegative(root, aim, parameters.positive)
            promised = cost - left - float(np.sum((plain @ new - wanted) ** 2))
            if damping >= MOST_DAMPING or promised < NOTHING * close * cost:
                return fit_at(z, motion, jacobian)
            new = parameters.retract(solver.restoring, z, new)
            trial = solve(new)
            residual = y if trial is None else y - trial.y
            after = float(residual @ residual) + variance * float(new @ new)
            if trial is not None and after < cost:
                break
            damping = max(damping, AGAIN) * MORE
        damping, steps = max(damping * LESS, MIN_LAMBDA), steps + 1
        z, motion = new, trial
        last = (cost - after) / cost < close or steps == MOST_STEPS
