"""Answer a record by a simple script, which an engineer could write in an afternoon, as a peer in the contest.

The script solves the motion, fits seven sums of damping terms on two springs, and compares them by BIC. The motion is
x″ + 2z x′ + c sign(x′) + q x′|x′| + k x + b x³ = 0, or with k sin(x) for a pendulum. The unit of time is the period of
the spectral peak divided by 2π, and the unit of displacement is the largest displacement of the record.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.optimize import brentq, least_squares
from scipy.special import ndtr

from bayesdamp.types import Refusal, Signal
from bayesdamp.verdict.parts import DampingRatio, Grade, Rival
from bayesdamp.verdict.types import Verdict
from validation.truth.oscillator import LAWS, SUMS, TERMS
from validation.truth.trajectory import advance

POSITIONS = [[TERMS.index(term) for term in name.split("+")] for name in SUMS]
"""For each damping sum in `SUMS`, the positions of its coefficients in the vector of parameters p: 0 for z (viscous), 1
for c (Coulomb), 2 for q (quadratic)."""
K, B, REST, X0, V0 = range(3, 8)
"""Positions in the vector of parameters p: stiffness k, cubic stiffness b, rest position, initial displacement and
velocity. Positions 0 to 2 are the damping coefficients z, c and q."""
SCALE = np.array([0.01, 0.01, 0.01, 0.01, 0.1, 0.1, 1.0, 1.0])
"""Typical change of each parameter in a fit, (8,), by which the least-squares method scales its steps."""
PENDULUM, DUFFING = (list(LAWS).index(law) for law in ("pendulum", "duffing"))
"""Numbers of these two restoring laws in `LAWS`."""
STEP = 2 * math.pi / 40
"""Largest step of the solver, in periods of the spectral peak divided by 2π: 40 steps in a cycle."""
FIRST_CYCLES, GROWTH = 3, 2
"""A fit starts with a window of the first `FIRST_CYCLES` cycles of a record; each next window is longer by the factor
`GROWTH`."""
NAMED = 0.95
"""Smallest weight (by BIC) at which a damping sum is stated without reservation."""
EXPLAINED = 0.5
"""Smallest fraction of the record's variance that the best fit must explain; otherwise there is no answer."""
FAR = 10.0
"""Largest absolute value of a residual, in units of the largest displacement of the record. Larger residuals are set to
this value, so that the residuals of an unbounded motion are finite."""
LEAST_RATIO = 1e-6
"""Damping ratios up to this value count as no damping, and the record is refused."""
TINY = 1e-200
"""Smallest sum of squares that is used; for a record without noise, its logarithm would otherwise be infinite. Also the
smallest variance of a damping ratio."""
PADDING = 8
"""Factor by which padding with zeros lengthens the record before its spectral peak is searched."""
GAP = 1.5
"""A record has a gap where two successive samples are more than this many median steps apart."""
POINTS = 24
"""Number of points in a quarter cycle at which the damping power is evaluated to compute the energy loss."""


@njit(cache=True)
def solve(times: np.ndarray, p: np.ndarray, radians: float) -> np.ndarray:
    """Solve the motion, and return the displacements at given times, (n,).

    A step of the solver ends at each turning point, because friction may stop the motion there.

    Parameters
    ----------
    times : (n,) array
        Increasing times, in units of the period of the spectral peak divided by 2π.
    p : (8,) array
        z, c, q, k, b, rest, and displacement and velocity at the first time.
    radians : float
        Unit of displacement of a pendulum in rad; 0 for the cubic spring.
    """
    law, scale = (PENDULUM, radians) if radians > 0 else (DUFFING, 1.0)
    values = np.array([p[3], 0.0, p[4], p[0], scale * p[1], p[2] / scale])
    out = np.empty(times.size)
    x, v = scale * p[6], scale * p[7]
    sign = np.sign(v) if v != 0 else -np.sign(x)
    for i in range(times.size):
        gap = times[i] - times[max(i - 1, 0)]
        steps = math.ceil(gap / STEP)
        for _ in range(steps):
            if sign != 0:
                x, v, sign = advance(law, x, v, sign, values, gap / steps)
        out[i] = x / scale
    return out


@dataclass(frozen=True)
class Fit:
    """The fit of one damping sum on one spring to a record.

    Attributes
    ----------
    radians : float
        Unit of displacement of a pendulum in rad; 0 for the cubic spring.
    p : (8,) array
        z, c, q, k, b, rest, and displacement and velocity at the first time.
    free : list of int
        Positions in p of the parameters that are fitted; the others are 0.
    covariance : (m, m) array
        Covariance of the m fitted parameters.
    squares, bic : float
        Sum of squares of the residuals, and Bayesian information criterion.
    """

    radians: float
    p: np.ndarray
    free: list[int]
    covariance: np.ndarray
    squares: float
    bic: float

    def ratio(self, amplitude: float) -> tuple[float, float]:
        """Return the damping ratio at an amplitude, in units of the largest displacement, and its standard error."""
        value = ratio(self.p, amplitude, self.radians)
        moved = self.p + 1e-6 * np.eye(self.p.size)[self.free]
        slope = (np.array([ratio(p, amplitude, self.radians) for p in moved]) - value) / 1e-6
        return value, math.sqrt(max(slope @ self.covariance @ slope, TINY))


def fit(times: np.ndarray, x: np.ndarray, guess: np.ndarray, terms: list[int], radians: float) -> Fit:
    """Fit a damping sum on one spring to a record by least squares.

    The fit starts with the first `FIRST_CYCLES` cycles and is repeated on longer windows up to the whole record, so
    that the fitted motion does not lose a cycle. times, x: the record in normalised units, (n,). guess: initial
    parameters, (8,). terms: positions of the damping coefficients in the vector of parameters. radians: unit of
    displacement of a pendulum in rad; 0 for the cubic spring.
    """
    free = [*terms, K, *([] if radians else [B]), REST, X0, V0]
    p = np.where(np.isin(np.arange(guess.size), free), guess, 0.0)
    p[:K] /= len(terms)
    low = np.where(np.array(free) < K, 0.0, -np.inf)
    end = 2 * np.pi * FIRST_CYCLES
    while True:
        n = int(np.searchsorted(times, end, side="right"))

        def residual(values: np.ndarray, n: int = n) -> np.ndarray:
            p[free] = values
            return np.clip(np.nan_to_num(solve(times[:n], p, radians) + p[REST] - x[:n], nan=FAR), -FAR, FAR)

        best = least_squares(residual, p[free], bounds=(low, np.inf), x_scale=SCALE[free], max_nfev=60)
        p[free] = best.x
        if n == times.size:
            break
        end *= GROWTH
    squares = max(2 * best.cost, TINY)
    covariance = squares / (n - len(free)) * np.linalg.pinv(best.jac.T @ best.jac)
    bic = n * math.log(squares / n) + len(free) * math.log(n)
    return Fit(radians, p, free, covariance, squares, bic)


def ratio(p: np.ndarray, amplitude: float, radians: float) -> float:
    """Return the equivalent damping ratio: energy loss in a cycle, divided by 4π times the energy at the amplitude.

    amplitude: in units of the largest displacement of the record. p: the eight parameters z, c, q, k, b, rest, and
    displacement and velocity at the start. radians: unit of displacement of a pendulum in rad; 0 for the cubic spring.
    """
    z, c, q, k, b = p[:REST]
    angle = 0.5 * np.pi * (np.arange(POINTS) + 0.5) / POINTS

    def energy(x: np.ndarray) -> np.ndarray:
        return k * (1 - np.cos(radians * x)) / radians**2 if radians else k * x**2 / 2 + b * x**4 / 4

    whole = energy(np.array(amplitude))
    v = np.sqrt(np.maximum(2 * (whole - energy(amplitude * np.sin(angle))), 0.0))
    lost = 2 * np.pi * np.mean((2 * z * v + c + q * v**2) * amplitude * np.cos(angle))
    return float(lost / (4 * np.pi * whole))


def _quantile(level: float, means: np.ndarray, sds: np.ndarray, weights: np.ndarray) -> float:
    """Return the quantile at `level` (0 to 1) of a mixture of n normal distributions, whose weights have the sum 1."""
    ends = float(np.min(means - 10 * sds)), float(np.max(means + 10 * sds))
    return float(brentq(lambda x: weights @ ndtr((x - means) / sds) - level, *ends, xtol=1e-12))  # pyright: ignore[reportArgumentType]


def start(times: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the parameters (8,) from which fits start, for a record in normalised units, (n,) each.

    They follow from a sinusoid fitted to the first cycle, and from the last amplitude divided by the first. times, x:
    the record in normalised units.
    """
    first = times <= 2 * np.pi
    phase = times[first]
    columns = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(phase)])
    cosine, sine, rest = np.linalg.lstsq(columns, x[first], rcond=None)[0]
    last = max(np.ptp(x[times >= times[-1] - 2 * np.pi]) / 2, 1e-3)
    decay = max(math.log(math.hypot(cosine, sine) / last) / times[-1], 1e-3)
    return np.array([decay, decay, 2 * decay, 1.0, 0.0, rest, cosine, sine])


def frequency(t: np.ndarray, y: np.ndarray) -> float:
    """Return the frequency in Hz of the largest spectral line, in the longest piece of a record without a gap."""
    cuts = np.flatnonzero(np.diff(t) > GAP * np.median(np.diff(t))) + 1
    t, y = max(zip(np.split(t, cuts), np.split(y, cuts), strict=True), key=lambda piece: piece[0].size)
    step = float(np.median(np.diff(t)))
    grid = np.arange(t[0], t[-1] + 0.5 * step, step)
    values = np.interp(grid, t, y)
    n = PADDING * grid.size
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(grid.size), n))
    return float((np.argmax(power[PADDING:]) + PADDING) / (n * (grid[1] - grid[0])))


def answer(signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
    """Answer a record: average damping ratios over the fits of seven damping sums on two springs.

    The weight of a fit is exp(−BIC/2). A sum is stated without reservation if its weight is at least `NAMED`.
    amplitudes: amplitudes at which the ratios are computed, in the unit of the record. Raises Refusal if no sum fits,
    the record is too short, or a ratio is not positive.
    """
    t, y = signal.t, signal.y
    times = 2 * np.pi * frequency(t, y) * (t - t[0])
    if times[-1] < 4 * np.pi:
        raise Refusal("the record has less than two cycles")
    middle = np.mean(y)
    size = float(np.max(np.abs(y - middle)))
    x = (y - middle) / size
    fits = [fit(times, x, start(times, x), terms, radians) for radians in (0.0, size) for terms in POSITIONS]
    if min(f.squares for f in fits) > (1 - EXPLAINED) * x.size * np.var(x):
        raise Refusal("no damping sum explains half of the variance of the record")
    bic = np.array([f.bic for f in fits])
    weights = np.exp(0.5 * (bic.min() - bic))
    weights /= weights.sum()
    ratios = []
    for a in amplitudes:
        means, sds = np.transpose([f.ratio(a / size) for f in fits])
        low, high = (_quantile(level, means, sds, weights) for level in (0.025, 0.975))
        ratios.append(DampingRatio(a, signal.unit, float(means @ weights), math.nan, math.nan, low, high))
    if not min(at.value for at in ratios) > LEAST_RATIO:
        raise Refusal("the estimated damping ratio is not positive at every amplitude")
    by_sum = weights.reshape(2, len(SUMS)).sum(axis=0)
    first, *rivals = sorted(map(Rival, SUMS, by_sum.tolist()), key=lambda sum_: -sum_.probability)
    decided = first.probability >= NAMED
    return Verdict(
        signal.name,
        Grade.EXACT,
        decided,
        first.damping,
        first.probability,
        tuple(rivals),
        damping_ratio=tuple(ratios),
    )
