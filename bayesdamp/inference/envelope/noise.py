"""How readings of an envelope scatter about it: the scatter of a reading, and the effect of the floor.

A reading of x = ln A has three errors: u, the multiplicative scatter (laser power, gain; an Ornstein-Uhlenbeck
process); v/A, the part of the floor in phase with the oscillation, with half of the power of its fluctuations; and
white noise. The floor consists of two such processes: noise of a detector, and thermal motion of the mode, which is
correlated over the decay itself, because its amplitude relaxes at the same rate. A decay contains only a few
independent values of the latter, so that its share of the floor is averaged over. The other parameters are inferred
from the record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import minimize

from bayesdamp.inference.deviation.linear import MEAN_G, smooth_root
from bayesdamp.records.envelope.window import NoiseFloor

LONGEST_SCATTER = 0.04
"""Largest correlation time of the multiplicative scatter, in durations: a slower one is a deviation of the law."""
LONGEST_FLOOR = 1.0
"""The same of the floor: thermal motion of the mode itself is correlated over its own decay."""
FLOOR_KNOWN = 0.7
"""Standard deviation of the logarithm of the floor's power near the decay, where the floor is visible behind it: a
record has only a few independent values of a slow floor."""
FLOOR_UNKNOWN = 2.5
"""The same where no floor is visible."""
WIDE = 3.0
"""Prior sd of the logarithm of a scatter about the value that the record's roughness suggests."""
SMALLEST = 1e-4
"""Smallest white scatter of ln A: 1e-3 dB."""
SHARES = (0.0, 0.25, 0.5, 0.75, 0.9)
"""Slow shares of the floor's fluctuating power, equally probable before."""
SLOWER = 4.0
"""Factor on the duration of the multiplicative scatter in `Noise.slower`."""
SLOW = 0.3
"""Correlation length of the deviation, in durations, where the noise is inferred together with one."""


@dataclass(frozen=True)
class Noise:
    """Scatter of ln A.

    Attributes
    ----------
    scatter, scatter_time
        Standard deviation and correlation time (s) of the multiplicative part.
    floor, floor_time
        Power of the floor's fluctuating part in units of A_ref², and the correlation time (s) of its fast share.
    white
        Standard deviation of the white part.
    deviation
        τ_g of the deviation that these were inferred with.
    slow, slow_time
        Share of the floor's fluctuating power that is slow, and its correlation time (s).
    constant, constant_sd
        Power of the floor's constant part, and its standard deviation.
    each, apart
        Number of readings in a mean, and their distance in s.
    log_weight, log_density
        Log prior probability among others, and log posterior density, both up to a constant.
    """

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
        """Return the covariance, (n, n), of readings at times t (s) and ln(A/A_ref) x, without the constant part."""
        lag, inverse = np.abs(t[:, None] - t), np.exp(-x)
        return _covariance(
            lag, inverse, np.exp(lag / -self.slow_time), self.slow, self.each, self.apart,
            (self.scatter, self.scatter_time, self.floor, self.floor_time, self.white),
        )  # fmt: skip

    def slower(self, span: float) -> Noise:
        """Return a noise with a scatter that lasts SLOWER times longer and is as much stronger.

        From one reading to the next it is the same. A record hardly distinguishes the two, but rates depend on them.
        span: of the record, in s.
        """
        times = float(min(SLOWER, 2.0 * span / self.scatter_time))
        stronger = self.scatter * float(np.sqrt(times))
        return replace(self, scatter=stronger, scatter_time=self.scatter_time * times)


def _covariance(
    lag: np.ndarray, inverse: np.ndarray, thermal: np.ndarray, slow: float, each: float, apart: float,
    numbers: Sequence[float] | np.ndarray,
) -> np.ndarray:  # fmt: skip
    su, lu, floor, lv, white = numbers
    covariance = su * su * np.exp(lag / -lu)
    # Of means of `each` readings of an Ornstein-Uhlenbeck process of sd 1, `apart` s apart.
    a = np.exp(-apart / lv)
    whole = a**each
    share = (1.0 - whole) / (each * (1.0 - a))
    fast = share**2 * np.exp((lag - (each - 1.0) * apart) / -lv)
    own = (each * (1.0 - a * a) - 2.0 * a * (1.0 - whole)) / (each * (1.0 - a)) ** 2
    fast[np.diag_indices_from(fast)] = own
    kernel = (1.0 - slow) * fast
    if slow > 0:
        kernel += slow * thermal
    covariance += (0.5 * floor) * kernel * (inverse[:, None] * inverse)
    covariance[np.diag_indices_from(covariance)] += white * white
    return covariance


def infer_noise(
    t: np.ndarray,
    residual: np.ndarray,
    x: np.ndarray,
    columns: np.ndarray,
    warp: np.ndarray,
    floor: NoiseFloor | None,
    slow: float,
    slow_time: float,
    each: float,
    with_deviation: bool = False,
    begin: Noise | None = None,
    only_floor: bool = False,
) -> Noise:
    """Infer the most probable noise, with the law's parameters integrated out (restricted likelihood, Harville 1977).

    Parameters
    ----------
    t, residual, x : ndarray, shape (n,)
        Times in s, ln A minus the fit, and the fit.
    columns : ndarray, shape (n, k)
        Derivatives of x by the law's parameters, which have flat priors.
    warp : ndarray, shape (n, knots)
        Derivatives of x by the deviation's knots.
    floor : NoiseFloor or None
        The floor behind the decay, in units of A_ref².
    slow, slow_time, each
        As in `Noise`.
    with_deviation : bool
        Whether to infer a deviation of the law too.
    begin : Noise, optional
        Where the search starts.
    only_floor : bool
        Whether only the floor differs from `begin`.
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
    low = np.log([SMALLEST, step / 3, np.exp(floor_mean - 4 * floor_sd), apart / 3, SMALLEST, 1e-4])
    high = np.log([1.0, max(longest_u, step), np.exp(floor_mean + 4 * floor_sd), longest_v, 1.0, 0.5])
    scatter, scatter_time = 0.5 * np.log(rough * overall), np.log(step * longest_u) / 2
    centre = np.array([scatter, scatter_time, floor_mean, np.log(step), np.log(rough / 2), 0.0])
    width = np.array([WIDE, np.inf, floor_sd, np.inf, WIDE, np.inf])
    extra = np.zeros_like(lag)
    smooth = warp @ smooth_root(warp.shape[1], SLOW)
    kernel = smooth @ smooth.T
    if constant > 0:
        residual = residual - 0.5 * constant * inverse**2
        extra = (0.5 * constant_sd) ** 2 * np.outer(inverse, inverse) ** 2
    packed = np.column_stack([columns / np.linalg.norm(columns, axis=0), residual])
    ridge = 1e-8 * np.eye(columns.shape[1])
    first = centre.copy()
    first[5] = np.log(MEAN_G)
    if begin is not None:
        first[:5] = np.log([begin.scatter, begin.scatter_time, begin.floor, begin.floor_time, begin.white])
    first = np.clip(first, low, high)
    free = np.array([2]) if only_floor else np.arange(6 if with_deviation else 5)

    def cost(chosen: np.ndarray) -> float:
        theta = first.copy()
        theta[free] = chosen
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

    bounds = list(zip(low[free], high[free], strict=True))
    options = {"maxiter": 40, "ftol": 1e-7, "eps": 1e-4}
    fit = minimize(cost, first[free], method="L-BFGS-B", bounds=bounds, options=options)
    first[free] = fit.x
    su, lu, f, lv, white, tau = map(float, np.exp(first))
    log_density = log_weight - float(fit.fun)
    log_weight -= 0.5 * float((first[2] - floor_mean) / floor_sd) ** 2
    return Noise(
        su, lu, f, lv, white, tau if with_deviation else 0.0, slow, slow_time, constant, constant_sd,
        each, apart, log_weight, log_density,
    )  # fmt: skip


def whiten(covariance: np.ndarray, columns: Sequence[np.ndarray]) -> tuple[np.ndarray, float]:
    """Whiten columns by a covariance of the noise.

    Parameters
    ----------
    covariance : ndarray, shape (n, n)
        Of the noise.
    columns : sequence of ndarray, shapes (n,) or (n, k)
        The columns.

    Returns
    -------
    white : ndarray, shape (n, m)
        All columns side by side.
    log_det : float
        Log determinant of the covariance's triangle.
    """
    triangle = cholesky(covariance, lower=True, check_finite=False)
    white = solve_triangular(triangle, np.column_stack(columns), lower=True, check_finite=False)
    return white, float(np.log(np.diag(triangle)).sum())
