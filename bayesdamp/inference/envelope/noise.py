"""How readings of an envelope scatter about it: the reading's own scatter, and what the floor adds.

In x = ln A a reading is off by u, the multiplicative scatter (laser power, gain; an Ornstein-Uhlenbeck process), by
v/A, the floor's part in phase with the oscillation (its power is half of what the floor fluctuates with), and by white
noise. The floor has two such processes: noise of a detector, and thermal motion of the mode, which is correlated over
the decay itself (its amplitude relaxes at the same rate). A decay holds a few independent values of the latter, so that
its share of the floor is averaged over; the other numbers are inferred from the record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import minimize

from bayesdamp.inference.deviation.gaussian.hyperparameters import MEAN_G, smooth_root
from bayesdamp.records.envelope.decay import SeenFloor

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
SHARES = (0.0, 0.25, 0.5, 0.75, 0.9)
"""Of the floor's fluctuating power what is slow, uniform before."""
SLOWER = 4.0
SLOW = 0.3
"""Correlation length of the deviation, in durations, where the noise is inferred with one."""


@dataclass(frozen=True)
class Noise:
    """Scatter of ln A: sd and correlation time (s) of the multiplicative part; power of the floor's fluctuating part
    (in units of A_ref²), its share `slow` that is correlated over slow_time (s), and the correlation time of the other;
    power of its constant part and the sd of that; white sd; deviation: τ_g that these were inferred with; each: how
    many readings, so many s apart (`apart`), are averaged to one; log_weight: log prior probability among others, and
    log_density: log posterior density, both up to a constant."""

    scatter: float
    scatter_time: float
    floor: float
    floor_time: float
    white: float
    deviation: float = 0.0
    slow: float = 0.0
    slow_time: float = 1.0
    constant: float = 0.0
    constant_sd: float = 0.0
    each: float = 1.0
    apart: float = 1.0
    log_weight: float = 0.0
    log_density: float = 0.0

    def covariance(self, t: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Of the readings at times t (s) where ln(A/A_ref) is x, shape (n, n), without the constant part's."""
        lag, inverse = np.abs(t[:, None] - t), np.exp(-x)
        return _covariance(
            lag, inverse, np.exp(lag / -self.slow_time), self.slow, self.each, self.apart,
            (self.scatter, self.scatter_time, self.floor, self.floor_time, self.white),
        )  # fmt: skip

    def slower(self, span: float) -> Noise:
        """The same noise from one reading to the next, but with a scatter that lasts SLOWER times longer and is as much
        stronger: a record hardly tells them apart, and rates hang on it. span: of the record, in s."""
        times = min(SLOWER, 2.0 * span / self.scatter_time)
        return replace(
            self, scatter=self.scatter * float(np.sqrt(times)), scatter_time=self.scatter_time * float(times)
        )


def _covariance(
    lag: np.ndarray, inverse: np.ndarray, thermal: np.ndarray, slow: float, each: float, apart: float,
    numbers: Sequence[float] | np.ndarray,
) -> np.ndarray:  # fmt: skip
    su, lu, floor, lv, white = numbers
    found = su * su * np.exp(lag / -lu)
    kernel = (1.0 - slow) * _averaged(lag, lv, each, apart)
    if slow > 0:
        kernel += slow * thermal
    found += (0.5 * floor) * kernel * (inverse[:, None] * inverse)
    found[np.diag_indices_from(found)] += white * white
    return found


def _averaged(lag: np.ndarray, time: float, each: float, apart: float) -> np.ndarray:
    """Covariance of means of so many readings, so far apart, of an Ornstein-Uhlenbeck process of sd 1."""
    a = np.exp(-apart / time)
    whole = a**each
    share = (1.0 - whole) / (each * (1.0 - a))
    found = share**2 * np.exp((lag - (each - 1.0) * apart) / -time)
    own = (each * (1.0 - a * a) - 2.0 * a * (1.0 - whole)) / (each * (1.0 - a)) ** 2
    found[np.diag_indices_from(found)] = own
    return found


def infer_noise(
    t: np.ndarray,
    residual: np.ndarray,
    x: np.ndarray,
    columns: np.ndarray,
    warp: np.ndarray,
    floor: SeenFloor | None,
    slow: float,
    slow_time: float,
    each: float,
    with_deviation: bool = False,
    begin: Noise | None = None,
    only_floor: bool = False,
) -> Noise:
    """The most probable noise, what the law explains integrated out (restricted likelihood, Harville 1977).

    t, residual, x: times, ln A less the fit, fit, shape (n,); columns: derivatives of x that the law may explain, shape
    (n, k), with flat priors; warp: derivatives by the deviation's knots; floor: seen behind the decay, in units of
    A_ref²; slow, slow_time, each: see Noise; begin: where the search starts; only_floor: all but the floor is as there.
    """
    span = float(t[-1] - t[0])
    step = span / (t.size - 1)
    apart = step / each
    lag = np.abs(t[:, None] - t)
    inverse = np.exp(-x)
    thermal = np.exp(lag / -slow_time)
    rough = max(float(np.std(np.diff(residual)[: max(4, t.size // 2)])) / np.sqrt(2), SMALLEST)
    overall = max(float(np.std(residual)), rough)
    power, constant, constant_sd, log_weight = (0.0, 0.0, 0.0, 0.0) if floor is None else floor.parts(slow)
    floor_mean = np.log(2.0 * rough**2) + 2.0 * float(x[-1]) if floor is None else np.log(power)
    floor_sd = FLOOR_UNKNOWN if floor is None else FLOOR_KNOWN
    longest_u, longest_v = LONGEST_SCATTER * span, LONGEST_FLOOR * span
    low = np.log([SMALLEST, step / 3, 0.0 + np.exp(floor_mean - 4 * floor_sd), apart / 3, SMALLEST, 1e-4])
    high = np.log([1.0, max(longest_u, step), np.exp(floor_mean + 4 * floor_sd), longest_v, 1.0, 0.5])
    centre = np.array([0.5 * np.log(rough * overall), 0.0, floor_mean, 0.0, np.log(rough / 2), 0.0])
    centre[1], centre[3] = np.log(step * longest_u) / 2, np.log(step)
    width = np.array([WIDE, np.inf, floor_sd, np.inf, WIDE, np.inf])
    extra = np.zeros_like(lag)
    smooth = warp @ smooth_root(warp.shape[1], SLOW)
    kernel = smooth @ smooth.T
    if constant > 0:
        residual = residual - 0.5 * constant * inverse**2
        extra = (0.5 * constant_sd) ** 2 * np.outer(inverse, inverse) ** 2

    def cost(theta: np.ndarray) -> float:
        numbers = np.exp(theta)
        cov = _covariance(lag, inverse, thermal, slow, each, apart, numbers[:5]) + extra
        if with_deviation:
            cov += numbers[5] ** 2 * kernel
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
            value += numbers[5] / MEAN_G - theta[5]
        return float(value)

    packed = np.column_stack([columns / np.linalg.norm(columns, axis=0), residual])
    ridge = 1e-8 * np.eye(columns.shape[1])
    first = centre.copy()
    first[5] = np.log(MEAN_G)
    if begin is not None:
        first[:5] = np.log([begin.scatter, begin.scatter_time, begin.floor, begin.floor_time, begin.white])
    first = np.clip(first, low, high)
    free = np.array([2]) if only_floor else np.arange(6 if with_deviation else 5)

    def short(theta: np.ndarray) -> float:
        whole = first.copy()
        whole[free] = theta
        return cost(whole)

    found = minimize(
        short, first[free], method="L-BFGS-B", bounds=list(zip(low[free], high[free], strict=True)),
        options={"maxiter": 40, "ftol": 1e-7, "eps": 1e-4},
    )  # fmt: skip
    first[free] = found.x
    su, lu, f, lv, white, tau = (float(one) for one in np.exp(first))
    log_density = log_weight - float(found.fun)
    log_weight -= 0.5 * float((first[2] - floor_mean) / floor_sd) ** 2
    return Noise(
        su, lu, f, lv, white, tau if with_deviation else 0.0, slow, slow_time, constant, constant_sd,
        each, apart, log_weight, log_density,
    )  # fmt: skip


def whiten(covariance: np.ndarray, columns: Sequence[np.ndarray]) -> tuple[np.ndarray, float]:
    """Columns (each (n,) or (n, k)) in units in which the noise is white, side by side, and the log determinant of the
    covariance's triangle."""
    triangle = cholesky(covariance, lower=True, check_finite=False)
    packed = np.column_stack(columns)
    return solve_triangular(triangle, packed, lower=True, check_finite=False), float(
        np.log(np.diag(triangle)).sum()
    )
