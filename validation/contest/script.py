"""Do what a script of an afternoon could do: solve the motion, fit seven damping sums, and compare them by BIC.

The motion is x″ + 2z x′ + c sign(x′) + q x′|x′| + k x + b x³ = 0, or with k sin(x) for a pendulum. The unit of time
is the period of the spectral peak over 2π, and the unit of displacement is the largest displacement of the record.
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
"""Positions of the coefficients z, c and q of each of `SUMS` in the vector of parameters p."""
K, B, REST, X0, V0 = range(3, 8)
"""Positions in the vector of parameters p: stiffness k, cubic stiffness b, rest position, initial displacement and
velocity. Positions 0 to 2 are the damping coefficients z, c and q."""
SCALE = np.array([0.01, 0.01, 0.01, 0.01, 0.1, 0.1, 1.0, 1.0])
"""Typical change of each parameter in a fit, (8,), by which the least-squares method scales its steps."""
PENDULUM, DUFFING = (list(LAWS).index(law) for law in ("pendulum", "duffing"))
"""Numbers of the two restoring laws."""
STEP = 2 * math.pi / 40
"""Largest step of the solver in normalised time: 40 steps in a cycle."""
FIRST_CYCLES, GROWTH = 3, 2
"""Length in cycles of the window in which a fit starts, and the factor by which each next window is longer."""
NAMED = 0.95
"""Least weight of a damping sum that is stated without reservation."""
EXPLAINED = 0.5
"""Least share of the record's variance that the best fit must explain."""
FAR = 10.0
"""Largest absolute residual, in largest displacements of the record, so that residuals of an unbounded motion are
finite."""
LEAST_RATIO = 1e-6
"""Damping ratios up to this value count as no damping, and the record is refused."""
TINY = 1e-200
"""Smallest sum of squares that is used, so that its logarithm is finite for a record without noise."""
PADDING = 8
"""Factor by which padding with zeros lengthens the record before its spectral peak is searched."""
GAP = 1.5
"""Two samples that are more than this many median steps apart have a gap between them."""
POINTS = 24
"""Number of points in a quarter cycle at which the power is evaluated for the energy loss."""


@njit(cache=True)
def solve(times: np.ndarray, p: np.ndarray, radians: float) -> np.ndarray:
    """Return the displacements at times; steps end at turning points, where friction may stop the motion.

    Parameters
    ----------
    times : (n,) array
        Increasing times.
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
    """The fit of a damping sum.

    Attributes
    ----------
    radians : float
        Unit of displacement of a pendulum in rad; 0 for the cubic spring.
    p : (8,) array
        z, c, q, k, b, rest, and displacement and velocity at the first time.
    free : list of int
        Positions of the fitted parameters in p.
    covariance : (m, m) array
        Covariance of the fitted parameters.
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
        """Return the damping ratio at an amplitude (in largest displacements), and its standard deviation."""
        value = ratio(self.p, amplitude, self.radians)
        moved = self.p + 1e-6 * np.eye(self.p.size)[self.free]
        slope = (np.array([ratio(p, amplitude, self.radians) for p in moved]) - value) / 1e-6
        return value, math.sqrt(max(slope @ self.covariance @ slope, TINY))


def fit(times: np.ndarray, x: np.ndarray, guess: np.ndarray, terms: list[int], radians: float) -> Fit:
    """Fit a damping sum on one spring to a record by least squares.

    The window grows from `FIRST_CYCLES` to the whole record, so that the phase of the trajectory stays within a cycle
    of the record's. times, x: the record in normalised units, (n,). guess: first parameters, (8,). terms: positions
    of the coefficients in p. radians: as in `Fit`.
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
    """Return the equivalent damping ratio: energy lost in a cycle over 4π times the potential energy at the amplitude.

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
    """Return the quantile at `level` (0 to 1) of a mixture of n normal distributions; the weights sum to 1."""
    ends = float(np.min(means - 10 * sds)), float(np.max(means + 10 * sds))
    return float(brentq(lambda x: weights @ ndtr((x - means) / sds) - level, *ends, xtol=1e-12))  # pyright: ignore[reportArgumentType]


def start(times: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the parameters (8,) from which fits start, for a record in normalised units, (n,) each.

    They follow from a sinusoid fitted to the first cycle, and from the ratio of the last amplitude to the first.
    """
    first = times <= 2 * np.pi
    phase = times[first]
    columns = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(phase)])
    cosine, sine, rest = np.linalg.lstsq(columns, x[first], rcond=None)[0]
    last = max(np.ptp(x[times >= times[-1] - 2 * np.pi]) / 2, 1e-3)
    decay = max(math.log(math.hypot(cosine, sine) / last) / times[-1], 1e-3)
    return np.array([decay, decay, 2 * decay, 1.0, 0.0, rest, cosine, sine])


def frequency(t: np.ndarray, y: np.ndarray) -> float:
    """Return the frequency in Hz of the largest spectral line in the longest piece of a record between gaps, (n,)."""
    cuts = np.flatnonzero(np.diff(t) > GAP * np.median(np.diff(t))) + 1
    t, y = max(zip(np.split(t, cuts), np.split(y, cuts), strict=True), key=lambda piece: piece[0].size)
    step = float(np.median(np.diff(t)))
    grid = np.arange(t[0], t[-1] + 0.5 * step, step)
    values = np.interp(grid, t, y)
    n = PADDING * grid.size
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(grid.size), n))
    return float((np.argmax(power[PADDING:]) + PADDING) / (n * (grid[1] - grid[0])))


def answer(signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
    """Return damping ratios averaged over the fits of seven sums on two springs, weighted by exp(−BIC/2).

    A sum is named if its weight is at least `NAMED`. Raises Refusal if no sum fits, or the record is too short.
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
