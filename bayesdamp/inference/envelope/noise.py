"""The noise model of the readings of an envelope.

A reading of x = ln A has three errors: a multiplicative scatter u (such as of laser power or gain), which is an
Ornstein–Uhlenbeck process; v/A, where v is the part of the noise floor that is in phase with the oscillation and has
half of the floor's power; and white noise. The floor is the sum of two Ornstein–Uhlenbeck processes: fast noise of the
detector, and slow thermal motion of the mode, whose correlation time is that of the decay. A decay contains only a few
independent values of the slow part, so its fraction of the floor cannot be inferred; results are averaged over several
values of this fraction. The other parameters are inferred.
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
"""Largest correlation time of the multiplicative scatter of the readings, as a fraction of the duration of the decay.
Slower changes count as deviations of the decay from its damping law."""
LONGEST_FLOOR = 1.0
"""Largest correlation time of the fast part of the noise floor, which is the noise of the detector, as a fraction of
the duration of the decay."""
FLOOR_KNOWN = 0.7
"""Prior standard deviation of ln(power of the noise floor) if the floor was measured after the decay. It is not small,
because a record contains only a few independent values of a slow floor."""
FLOOR_UNKNOWN = 2.5
"""Prior standard deviation of ln(power of the noise floor) if the floor was not measured after the decay."""
LOG_SCATTER_SD = 3.0
"""Prior standard deviation of ln of the standard deviations of the multiplicative scatter and of the white noise. The
priors are centred on estimates from the residuals of the blocks and from differences of neighbouring ones."""
LEAST_SCATTER = 1e-4
"""Smallest standard deviations that the search for the noise of ln A (A is the amplitude) allows for the multiplicative
scatter and for the white noise (1e-4 is about 1e-3 dB)."""
SLOW_FRACTIONS = (0.0, 0.25, 0.5, 0.75, 0.9)
"""Possible values of the fraction of the noise floor's fluctuating power that is slow (thermal motion of the mode).
Results are averaged over them; they are equally probable a priori."""
SLOWER_FACTOR = 4.0
"""Factor by which `Noise.slower` increases the correlation time of the multiplicative scatter of the readings."""
DEVIATION_LENGTH = 0.3
"""While the noise is inferred, the decay rate may deviate from its damping law. This is the correlation length of the
deviation in time, as a fraction of the decay's duration."""


@dataclass(frozen=True)
class Noise:
    """The noise of ln A (A is the amplitude) in blocks of readings.

    Attributes
    ----------
    scatter, scatter_time
        Standard deviation and correlation time (s) of the multiplicative scatter.
    floor, floor_time
        Power of the fluctuating part of the noise floor in units of A_ref² (A_ref is the reference amplitude), and
        correlation time (s) of its fast part.
    white
        Standard deviation of the white noise of a block.
    deviation
        Standard deviation of the decay rate's relative deviation from its law, if this deviation was inferred together
        with the noise; otherwise 0.
    slow, slow_time
        Fraction of the floor's fluctuating power that is slow, and the correlation time (s) of this slow part.
    constant, constant_sd
        Power of the constant part of the floor in units of A_ref², and its standard deviation.
    each, apart
        Mean number of readings in a block, and time between two readings in s.
    log_weight
        Log prior probability of this noise relative to other possible noises, in nats, up to a constant.
    log_density
        Log posterior density of this noise in nats, up to a constant.
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
        """Return the covariance, (n, n), of the noise of ln A in n blocks of readings.

        t: times of the blocks in s, (n,). x: ln(A/A_ref) in the blocks, (n,). The error of the constant part of the
        noise floor is not included.
        """
        lag, inverse = np.abs(t[:, None] - t), np.exp(-x)
        return _covariance(
            lag, inverse, np.exp(lag / -self.slow_time), self.slow, self.each, self.apart,
            (self.scatter, self.scatter_time, self.floor, self.floor_time, self.white),
        )  # fmt: skip

    def slower(self, span: float) -> Noise:
        """Return a copy of this noise whose multiplicative scatter has a longer correlation time.

        The time is longer by the factor `SLOWER_FACTOR`, but at most twice `span`, the duration of the record in s. The
        variance of the scatter is increased by the same factor, so that differences of neighbouring readings stay the
        same. A record hardly distinguishes the two noises, but the uncertainty of rates depends on the choice.
        """
        times = float(min(SLOWER_FACTOR, 2.0 * span / self.scatter_time))
        stronger = self.scatter * float(np.sqrt(times))
        return replace(self, scatter=stronger, scatter_time=self.scatter_time * times)


def _covariance(
    lag: np.ndarray, inverse: np.ndarray, thermal: np.ndarray, slow: float, each: float, apart: float,
    numbers: Sequence[float] | np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return the covariance, (n, n), of the noise of ln A in blocks that are means of `each` readings.

    lag: time differences of the blocks in s, (n, n). inverse: A_ref/A, (n,). thermal: correlations of the slow part of
    the floor at these lags, (n, n). slow: fraction of the floor's fluctuating power in this part. apart: time between
    two readings in s. numbers: scatter, scatter_time, floor, floor_time and white of `Noise`, in this order.
    """
    su, lu, floor, lv, white = numbers
    covariance = su * su * np.exp(lag / -lu)
    # Covariance of means of `each` readings, `apart` (s) apart, of an Ornstein-Uhlenbeck process with unit variance.
    a = np.exp(-apart / lv)
    whole = a**each
    factor = (1.0 - whole) / (each * (1.0 - a))
    fast = factor**2 * np.exp((lag - (each - 1.0) * apart) / -lv)
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
    """Infer the most probable noise: maximise the restricted likelihood (Harville 1977) times the priors of the noise.

    The parameters of the damping law have flat priors and are integrated out. The search is within bounds such as
    `LONGEST_SCATTER`.

    Parameters
    ----------
    t, residual, x : ndarray, shape (n,)
        Times of the blocks in s, ln A minus its fit, and the fit of ln(A/A_ref).
    columns : ndarray, shape (n, k)
        Derivatives of x by the parameters of the law.
    warp : ndarray, shape (n, knots)
        Derivatives of x by the relative deviation of the decay rate from the law, at its knots in time.
    floor : NoiseFloor or None
        The noise floor measured after the decay, in units of A_ref²; None if it was not measured.
    slow, slow_time, each
        Attributes of the result that are not inferred, see `Noise`.
    with_deviation : bool
        True to infer the size of a deviation from the damping law together with the noise; False for no deviation.
    begin : Noise, optional
        Noise at which the search starts; by default rough estimates from the residuals.
    only_floor : bool
        True to infer only the power of the noise floor; the other values are then those at which the search starts.
        False to infer all.

    Returns
    -------
    Noise
        The most probable noise.
    """
    span = float(t[-1] - t[0])
    step = span / (t.size - 1)
    apart = step / each
    lag, inverse = np.abs(t[:, None] - t), np.exp(-x)
    thermal = np.exp(lag / -slow_time)
    rough = max(float(np.std(np.diff(residual)[: max(4, t.size // 2)])) / np.sqrt(2), LEAST_SCATTER)
    overall = max(float(np.std(residual)), rough)
    power, constant, constant_sd, log_weight = (0.0, 0.0, 0.0, 0.0) if floor is None else floor.parts(slow)
    floor_mean = np.log(2.0 * rough**2) + 2.0 * float(x[-1]) if floor is None else np.log(power)
    floor_sd = FLOOR_UNKNOWN if floor is None else FLOOR_KNOWN
    longest_u, longest_v = LONGEST_SCATTER * span, LONGEST_FLOOR * span
    low = np.log([LEAST_SCATTER, step / 3, np.exp(floor_mean - 4 * floor_sd), apart / 3, LEAST_SCATTER, 1e-4])
    high = np.log([1.0, max(longest_u, step), np.exp(floor_mean + 4 * floor_sd), longest_v, 1.0, 0.5])
    scatter, scatter_time = 0.5 * np.log(rough * overall), np.log(step * longest_u) / 2
    centre = np.array([scatter, scatter_time, floor_mean, np.log(step), np.log(rough / 2), 0.0])
    width = np.array([LOG_SCATTER_SD, np.inf, floor_sd, np.inf, LOG_SCATTER_SD, np.inf])
    extra = np.zeros_like(lag)
    smooth = warp @ smooth_root(warp.shape[1], DEVIATION_LENGTH)
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
        factor = np.linalg.cholesky(h.T @ h + ridge)
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


def whiten_columns(covariance: np.ndarray, columns: Sequence[np.ndarray]) -> tuple[np.ndarray, float]:
    """Multiply columns by the inverse of the Cholesky factor of the covariance of the noise.

    After this, the noise of a data column is independent with variance 1.

    Parameters
    ----------
    covariance : ndarray, shape (n, n)
        Covariance of the noise.
    columns : sequence of ndarray, shapes (n,) or (n, k)
        The columns.

    Returns
    -------
    white : ndarray, shape (n, m)
        The whitened columns, side by side in the given order.
    log_det : float
        Log determinant of the Cholesky factor (half of that of the covariance).
    """
    triangle = cholesky(covariance, lower=True, check_finite=False)
    white = solve_triangular(triangle, np.column_stack(columns), lower=True, check_finite=False)
    return white, float(np.log(np.diag(triangle)).sum())
