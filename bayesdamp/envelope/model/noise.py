"""How readings of an envelope scatter about it: the reading's own scatter, and what the floor adds.

In x = ln A a reading is off by u, the multiplicative scatter (laser power, gain; an Ornstein-Uhlenbeck process), by
v/A, the floor's part in phase with the oscillation (its power is half of what the floor fluctuates with; thermal motion
and detector noise; another such process), and by white noise. All five numbers are inferred from the record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import minimize

from bayesdamp.envelope.model.deviation import knot_covariance

LONGEST_SCATTER = 0.04
"""Correlation time of the multiplicative scatter at most, in durations: what is slower is a deviation of the law."""
LONGEST_FLOOR = 1.0
"""Of the floor's: thermal motion of the mode itself is correlated over its own decay."""
FLOOR_KNOWN = 0.7
"""Standard deviation of the logarithm of the floor's power near the decay, seen behind it: a record shows a few
independent values of a slow floor only."""
FLOOR_UNKNOWN = 2.5
"""The same where no floor is seen."""
WIDE = 3.0
"""Of the logarithm of a scatter about where a record's own roughness puts it."""
SMALLEST = 1e-4
"""Least white scatter of ln A: 1e-3 dB."""
SLOWER = 4.0
SLOW = 0.3
"""Correlation length of the deviation, in durations, where the noise is inferred with one."""


@dataclass(frozen=True)
class Noise:
    """Scatter of ln A: sd and correlation time (s) of the multiplicative part, power of the fluctuating floor (in units
    of A_ref²) and its correlation time (s), white sd; deviation: τ_g that these were inferred with."""

    scatter: float
    scatter_time: float
    floor: float
    floor_time: float
    white: float
    deviation: float
    log_density: float

    def covariance(self, t: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Of the readings at times t (s) where ln(A/A_ref) is x, shape (n, n)."""
        return _covariance(
            np.abs(t[:, None] - t),
            np.exp(-x),
            self.scatter,
            self.scatter_time,
            self.floor,
            self.floor_time,
            self.white,
        )

    def slower(self, span: float) -> tuple[Noise, Noise]:
        """The same noise from one reading to the next, but with a scatter, or a floor, that lasts SLOWER times longer
        and is as much stronger: a record hardly tells them apart, and rates hang on it. span: of the record, in s."""
        times = np.minimum(SLOWER, 2.0 * span / np.array([self.scatter_time, self.floor_time]))
        return (
            replace(
                self,
                scatter=self.scatter * float(np.sqrt(times[0])),
                scatter_time=self.scatter_time * float(times[0]),
            ),
            replace(self, floor=self.floor * float(times[1]), floor_time=self.floor_time * float(times[1])),
        )


def _covariance(
    lag: np.ndarray, inverse: np.ndarray, su: float, lu: float, floor: float, lv: float, white: float
) -> np.ndarray:
    found = su * su * np.exp(lag / -lu)
    found += (0.5 * floor) * np.exp(lag / -lv) * (inverse[:, None] * inverse)
    found[np.diag_indices_from(found)] += white * white
    return found


def infer_noise(
    t: np.ndarray,
    residual: np.ndarray,
    x: np.ndarray,
    columns: np.ndarray,
    warp: np.ndarray,
    floor: float,
    with_deviation: bool,
    deviation_mean: float,
    begin: Noise | None = None,
) -> Noise:
    """The most probable noise, what the law explains integrated out (restricted likelihood, Harville 1977).

    t, residual, x: times, ln A less the fit, fit, shape (n,); columns: derivatives of x that the law may explain, shape
    (n, k), with flat priors; warp: derivatives by the deviation's knots; floor: power of the fluctuating floor behind
    the decay in units of A_ref², nan where none is seen.
    """
    span = float(t[-1] - t[0])
    step = span / (t.size - 1)
    lag = np.abs(t[:, None] - t)
    inverse = np.exp(-x)
    rough = max(float(np.std(np.diff(residual)[: max(4, t.size // 2)])) / np.sqrt(2), SMALLEST)
    overall = max(float(np.std(residual)), rough)
    known = np.isfinite(floor)
    floor_mean = np.log(floor) if known else np.log(2.0 * rough**2) + 2.0 * float(x[-1])
    floor_sd = FLOOR_KNOWN if known else FLOOR_UNKNOWN
    longest_u, longest_v = LONGEST_SCATTER * span, LONGEST_FLOOR * span
    low = np.log([SMALLEST, step / 3, 0.0 + np.exp(floor_mean - 4 * floor_sd), step / 3, SMALLEST, 1e-4])
    high = np.log([1.0, max(longest_u, step), np.exp(floor_mean + 4 * floor_sd), longest_v, 1.0, 0.5])
    centre = np.array([0.5 * np.log(rough * overall), 0.0, floor_mean, 0.0, np.log(rough / 2), 0.0])
    centre[1], centre[3] = np.log(step * longest_u) / 2, np.log(step * longest_v) / 2
    width = np.array([WIDE, np.inf, floor_sd, np.inf, WIDE, np.inf])
    kernel = warp @ knot_covariance(warp.shape[1], SLOW) @ warp.T

    def cost(theta: np.ndarray) -> float:
        su, lu, f, lv, white, tau = np.exp(theta)
        cov = _covariance(lag, inverse, su, lu, f, lv, white)
        if with_deviation:
            cov += tau * tau * kernel
        try:
            low_triangle = cholesky(cov, lower=True, check_finite=False, overwrite_a=True)
        except np.linalg.LinAlgError:
            return 1e10
        white_columns = solve_triangular(low_triangle, packed, lower=True, check_finite=False)
        h, r = white_columns[:, :-1], white_columns[:, -1]
        gram = h.T @ h + ridge
        factor = np.linalg.cholesky(gram)
        explained = solve_triangular(factor, h.T @ r, lower=True, check_finite=False)
        value = np.log(np.diag(low_triangle)).sum() + np.log(np.diag(factor)).sum()
        value += 0.5 * (r @ r - explained @ explained) + 0.5 * np.sum(((theta - centre) / width) ** 2)
        if with_deviation:
            value += tau / deviation_mean - theta[5]
        return float(value)

    packed = np.column_stack([columns / np.linalg.norm(columns, axis=0), residual])
    ridge = 1e-8 * np.eye(columns.shape[1])
    first = centre.copy()
    first[5] = np.log(deviation_mean)
    if begin is not None:
        first[:5] = np.log([begin.scatter, begin.scatter_time, begin.floor, begin.floor_time, begin.white])
    size = 6 if with_deviation else 5
    bounds = list(zip(low[:size], high[:size], strict=True))

    def short(theta: np.ndarray) -> float:
        return cost(np.concatenate([theta, first[size:]]))

    found = minimize(
        short,
        np.clip(first[:size], low[:size], high[:size]),
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": 40, "ftol": 1e-7, "eps": 1e-4},
    )
    su, lu, f, lv, white = np.exp(found.x[:5])
    return Noise(
        su, lu, f, lv, white, float(np.exp(found.x[5])) if with_deviation else 0.0, -float(found.fun)
    )


def whiten(covariance: np.ndarray, columns: Sequence[np.ndarray]) -> tuple[np.ndarray, float]:
    """Columns (each (n,) or (n, k)) in units in which the noise is white, side by side, and the log determinant of the
    covariance's triangle."""
    triangle = cholesky(covariance, lower=True, check_finite=False)
    packed = np.column_stack(columns)
    return solve_triangular(triangle, packed, lower=True, check_finite=False), float(
        np.log(np.diag(triangle)).sum()
    )
