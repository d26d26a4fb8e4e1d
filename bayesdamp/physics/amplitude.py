"""Compute how an amplitude decays with time under a sum of damping terms or under a power law.

Averaged over a cycle (Krylov & Bogoliubov 1937; Nayfeh & Mook, Nonlinear Oscillations, 1979, ch. 3) the amplitude A of
an oscillation of angular frequency ω obeys dA/dt = -(ζA + 2μ_c/(πω) + 4μ_q ω A²/(3π)). With x = ln(A/A_ref), for a
reference amplitude A_ref, this is dx/dt = -Σ c_i exp((p_i - 1) x), where c_i is the decay rate -dx/dt (1/s) that term i
causes at A_ref, and p_i = 1, 0 and 2. For any other term the decay dA/dt = -W/(2πωA), with the work W in a cycle of a
harmonic motion, is tabulated over ln A. Sums are integrated numerically.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations, product

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.physics.damping import DampingTerm, FreeParameter
from bayesdamp.physics.kernel.solve import ALL, PARAMETERS, Motion
from bayesdamp.types import InputError

POWERS: Mapping[str, float] = {"viscous": 1.0, "coulomb": 0.0, "quadratic": 2.0}
"""Exponent p of the decay dA/dt ∝ -A^p that each term causes, in the order in which sums name the terms."""
SUMS = tuple(terms for count in (1, 2, 3) for terms in combinations(POWERS, count))
"""All seven sums of viscous, Coulomb and quadratic damping, each as a tuple of names; single terms come first."""
LOG_AT_REST = -60.0
"""Value of ln(A/A_ref) that is returned for an oscillation that has come to rest (A = 0), and the smallest value of a
decay (conventional)."""
EXPONENT_RANGE = -1.0, 3.0
"""Smallest and largest exponent p of a power law; p < 0 is friction that increases as the amplitude decreases."""
NEAR_VISCOUS = 1e-4
"""If the exponent p of a power law differs from 1 by less than this, the derivative by p is computed from a series."""
_NEAR_ONE = 1e-6  # if |p - 1| is smaller, p = 1 is used
LAW_PANELS, TAIL_PANELS = 1000, 400
"""Numbers of intervals in ln A over which a decay is integrated numerically: in the range of the readings, and below
it. The errors of ln A and the relative errors of its derivatives are then less than 1e-6, also near rest (measured)."""
LEAST_FALL = 1e-7
"""If ln A decreases by less than about this during a decay, the derivatives for a decrease of about this are used."""
MIN_RATE = 1e-30
"""Before something is divided by a decay rate (1/s), the rate is raised to at least this; an undamped amplitude then
stays constant."""

Shape = Callable[[np.ndarray], np.ndarray]
"""The shape of a damping term: a function s(x) of x = ln(A/A_ref) that returns the term's decay rate -dx/dt relative to
its value at x = 0."""
LOSS_GRID = np.linspace(-12.0, 1.5, 68)
"""Values of ln(A/A_start) at which decay rates of a term are tabulated; outside, a rate is extrapolated as a power of
A."""
MIN_RELATIVE_LOSS = 1e-12
"""Smallest decay rate in the table, relative to the largest; smaller rates are raised to it, so that their logarithm is
finite."""
LOSS_TOLERANCE = 1e-6
"""Two decay rates count as equal if their relative difference is at most this."""
_REFERENCES = ("reference_velocity", "reference_amplitude")
"""Those names in `damping.GIVEN` that are reference scales (all except the equilibrium)."""


def power_decay(t: np.ndarray, x0: float, log_rate: float, power: float) -> np.ndarray:
    """Return x = ln(A/A_ref), (n,), at times t (s), (n,), of a decay dA/dt ∝ -A^p that starts from x0 at t = 0.

    log_rate: ln of the decay rate -dx/dt (1/s) at A_ref. power: exponent p. After the oscillation has come to rest, x
    is `LOG_AT_REST`.
    """
    # With q = p - 1: x(t) = x0 - ln(1 + q r t)/q, where r is the decay rate at x0.
    q = power - 1.0
    speed = np.exp(log_rate + q * x0)
    if abs(q) < _NEAR_ONE:
        return np.maximum(x0 - speed * t, LOG_AT_REST)
    inside = q * speed * t
    with np.errstate(invalid="ignore", divide="ignore"):
        x = x0 - np.log1p(inside) / q
    return np.where((inside > -1.0) & (x > LOG_AT_REST), x, LOG_AT_REST)


def power_slopes(t: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the derivatives, (n, 3), of x = ln(A/A_ref) by the parameters of a decay dA/dt ∝ -A^exponent.

    t: times in s since the start, (n,). p: the parameters, in the order of the columns: x at the start, ln of the decay
    rate -dx/dt (1/s) at the start, exponent. The derivatives hold until the oscillation comes to rest.
    """
    q, passed = p[2] - 1.0, np.exp(p[1]) * t
    left = np.maximum(1.0 + q * passed, 1e-12)  # reaches 0 when the oscillation comes to rest
    if abs(q) < NEAR_VISCOUS:
        by_exponent = passed * passed * (0.5 - 2.0 / 3.0 * q * passed)
    else:
        by_exponent = (np.log(left) / q - passed / left) / q
    return np.column_stack([np.ones_like(t), -passed / left, by_exponent])


def coefficient_from_rate(
    term: str, rate: np.ndarray, reference: float, omega: float | None
) -> tuple[str, np.ndarray, str]:
    """Convert decay rates of a damping term to its coefficient; return the coefficient's name, values and unit.

    In the unit, `{}` stands for the amplitude's unit.

    Parameters
    ----------
    term
        Name of a damping term: viscous, coulomb or quadratic.
    rate
        Decay rates -d ln A/dt in 1/s at the reference amplitude, any shape.
    reference
        The reference amplitude, in any unit.
    omega
        Angular frequency in rad/s, or None if unknown. If known, the result is the coefficient `zeta`, `mu_c` or `mu_q`
        of the equation of motion; else the coefficient c of the decay of the amplitude, dA/dt = -c A (viscous, also
        called `zeta`), -c (`loss_c`) or -c A² (`loss_q`).
    """
    if term == "viscous":
        return "zeta", rate, "1/s"
    if omega is None:
        if term == "coulomb":
            return "loss_c", rate * reference, "{}/s"
        return "loss_q", rate / reference, "1/({} s)"
    if term == "coulomb":
        return "mu_c", rate * reference * np.pi * omega / 2, "{}/s²"
    return "mu_q", rate / reference * 3 * np.pi / (4 * omega), "1/{}"


@dataclass(frozen=True)
class DecayLaw:
    """The decay law dx/dt = -Σ c_i s_i(x) of x = ln(A/A_ref) under a sum of damping terms, integrated numerically.

    Term i has the decay rate c_i (1/s) at the reference amplitude A_ref and the shape s_i, with s_i(0) = 1. (For a term
    that has hardly any effect at A_ref, s_i(0) can be less than 1, and its rate there is c_i s_i(0); see `Sum.law` in
    `inference.envelope.sums`.)

    Attributes
    ----------
    terms
        Names of the terms.
    each
        The shape s_i of each term.
    low, high
        Values of x between which the integration has equal steps. Below `low` its steps increase, down to
        `LOG_AT_REST`. Decays that start above `high` are computed as if they started there.
    """

    terms: tuple[str, ...]
    each: tuple[Shape, ...]
    low: float
    high: float

    def shapes(self, x: np.ndarray) -> np.ndarray:
        """Return the shapes s_i(x) of the terms, (terms, n), at x = ln(A/A_ref), (n,).

        They are the decay rates -dx/dt of the terms relative to those at A_ref.
        """
        return np.stack([shape(x) for shape in self.each])

    def rate(self, x: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Return the total decay rate -dx/dt = Σ c_i s_i(x) in 1/s, (n,), at values of x, (n,); rates: c_i (1/s)."""
        return rates @ self.shapes(x)

    @cached_property
    def _nodes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the nodes of the integration over x, and the terms' shapes at them.

        Returns -x at the ends of the intervals, increasing, (q,); the shapes there, (terms, q); and the shapes at the
        first Gauss point in each interval, then those at the second, (terms, 2q - 2).
        """
        below = (self.low - LOG_AT_REST) * np.linspace(0.0, 1.0, TAIL_PANELS + 1)[1:] ** 2
        fallen = np.concatenate([np.linspace(-self.high, -self.low, LAW_PANELS + 1), below - self.low])
        middle, off = 0.5 * (fallen[1:] + fallen[:-1]), 0.5 * np.diff(fallen) / np.sqrt(3.0)
        return fallen, self.shapes(-fallen), self.shapes(-np.concatenate([middle - off, middle + off]))

    def solve(self, t: np.ndarray, x0: float, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return x, (n,), at times t of a decay that starts from x0, and its derivatives by the rates, (n, terms).

        The time t(x) = ∫ dx/rate is integrated numerically, and inverted by interpolation. After the oscillation has
        come to rest, x is `LOG_AT_REST`; the derivatives hold until then. If the rates hardly change x, they are
        raised, because the integrals do not exist without damping.

        t: increasing times in s since the start, (n,). rates: the rates c_i (1/s), which must not be negative,
        (terms,).
        """
        if rates.sum() * t[-1] < LEAST_FALL:
            rates = np.maximum(rates, LEAST_FALL / t[-1])
        fallen, ends, inside = self._nodes
        speed, slow = np.maximum(rates @ ends, MIN_RATE), 1.0 / np.maximum(rates @ inside, MIN_RATE)
        # ∂x/∂c_i = -f ∫ s_i/f dt with f = -dx/dt, and dt = -dx/f.
        passed, *integrals = _integrals(fallen, np.vstack([slow, inside * slow**2]))
        begun = _cubic(np.maximum(-x0, fallen[0]), fallen, passed, 1.0 / speed)
        at = np.clip(begun + np.append(0.0, t), passed[0], passed[-1])
        x, *since = _cubic(at, passed, np.vstack([-fallen, *integrals]), np.vstack([-speed, ends / speed]))
        x, since = np.where(at < passed[-1], x, LOG_AT_REST)[1:], np.transpose(since)
        return x, -self.rate(x, rates)[:, None] * (since[1:] - since[0])


def _integrals(x: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Return the integrals, (..., n), of functions from x[0] to each x, (n,).

    inside: the functions at the first Gauss point in each interval, then at the second, (..., 2n - 2).
    """
    first, second = np.split(inside, 2, axis=-1)
    integrals = np.zeros((*inside.shape[:-1], x.size))
    np.cumsum(0.5 * np.diff(x) * (first + second), axis=-1, out=integrals[..., 1:])
    return integrals


def _cubic(at: np.ndarray, x: np.ndarray, y: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return values, (..., k), at points `at`, (k,), by cubic Hermite interpolation.

    x: nodes that do not decrease, (n,). y, slope: the values and derivatives at them, (..., n).
    """
    i = np.clip(np.searchsorted(x, at) - 1, 0, x.size - 2)
    h = x[i + 1] - x[i]
    u = (at - x[i]) / h
    v = 1.0 - u
    return v * v * ((1.0 + 2.0 * u) * y[..., i] + u * h * slope[..., i]) + u * u * (
        (1.0 + 2.0 * v) * y[..., i + 1] - v * h * slope[..., i + 1]
    )


@dataclass(frozen=True)
class PowerLaw:
    """The decay law dA/dt ∝ -A^p, whose exponent p is a parameter.

    The two parameters, which its methods take as `rates`, are ln of the decay rate (1/s) at A_ref, and p.
    """

    terms: tuple[str, ...] = ("log_rate", "exponent")

    def rate(self, x: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Return the decay rate -dx/dt in 1/s at values of x = ln(A/A_ref), (n,).

        rates: ln of the decay rate (1/s) at A_ref, and the exponent p.
        """
        return np.exp(rates[0] + (rates[1] - 1.0) * x)

    def solve(self, t: np.ndarray, x0: float, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return x = ln(A/A_ref), (n,), of a decay that starts from x0, and its derivatives by the parameters, (n, 2).

        After the oscillation has come to rest, x is `LOG_AT_REST`; the derivatives hold until then. t: times in s since
        the start, (n,). rates: ln of the decay rate (1/s) at A_ref, and the exponent p.
        """
        x = power_decay(t, x0, float(rates[0]), float(rates[1]))
        # `power_slopes` has the rate at the start as a parameter; the chain rule converts to the rate at A_ref.
        own = power_slopes(t, np.array([x0, rates[0] + (rates[1] - 1.0) * x0, rates[1]]))
        return x, np.column_stack([own[:, 1], own[:, 2] + x0 * own[:, 1]])


@dataclass(frozen=True)
class AmplitudeSolver:
    """Compute decays x(t) = ln(A/A_ref) under a decay law, with the interface of the kernel's `Solver`.

    The parameters of `solve` are the rates in 1/s at the reference amplitude A_ref, in the order of the law's terms (or
    the two parameters of a `PowerLaw`), then x at the start.

    Attributes
    ----------
    law
        The decay law.
    t
        Times of the readings in s since the start, (n,).
    duration
        Duration of the decay in s. The knots of the deviation g are equidistant over it; g is the relative deviation of
        the decay rate from the law, linear in time between the knots.
    knots
        Number of knots.
    white
        Matrix (n, n) that whitens the noise of the readings; decays and derivatives are multiplied by it. None for
        white noise.
    restoring
        Part of the interface of `Solver`; not used here.
    """

    law: DecayLaw | PowerLaw
    t: np.ndarray
    duration: float
    knots: int
    white: np.ndarray | None = None
    restoring: str = "linear"

    @property
    def frequency(self) -> float:
        """Return 1/duration in 1/s. The interface of `Solver` needs a frequency, although nothing oscillates here."""
        return 1.0 / self.duration

    def solve(
        self,
        p: np.ndarray,
        active: np.ndarray | None = None,
        *,
        tangents: int = PARAMETERS,
        stop: int | None = None,
        tolerance: float | None = None,
    ) -> Motion:
        """Compute the decay for parameters p, (terms + 1,), with derivatives by p and by the deviation g at the knots.

        p: the rates in 1/s at A_ref (or the two parameters of a `PowerLaw`), then x at the start. In the result, the
        values are x at the readings, and the derivatives are those of x (for `tangents` = `NONE` none, for `PARAMETERS`
        by p, for `ALL` by p and g), both multiplied by `white`; the states are x and dx/dt, (n, 2).

        All rates are multiplied by 1 + g(t) (g: deviation), so that x(t) = X(t + ∫g dt) with the decay X for g = 0. To
        first order, ∂x/∂g_k = -rate(x) ∫ b_k dt with the basis function b_k of knot k. `active`, `stop` and `tolerance`
        have no effect.
        """
        rates, start = p[:-1], float(p[-1])
        x, by_rates = self.law.solve(self.t, start, rates)
        moving = x > LOG_AT_REST
        speed = np.where(moving, self.law.rate(x, rates), 0.0)
        slopes = np.empty((x.size, 0))
        if tangents:
            at_start = float(self.law.rate(np.array([start]), rates)[0])
            by_start = speed / at_start if at_start > 0 else np.ones_like(x)  # undamped
            slopes = np.column_stack([np.where(moving[:, None], by_rates, 0.0), by_start])
        if tangents == ALL:
            passed = basis_integrals(self.t / self.duration, self.knots) * self.duration
            slopes = np.column_stack([slopes, -speed[:, None] * passed])
        states = np.column_stack([x, -speed])
        if self.white is not None:
            x, slopes = self.white @ x, self.white @ slopes
        return Motion(x, slopes, self.t, states)


def linear_basis(s: np.ndarray, count: int) -> np.ndarray:
    """Return the basis functions, (n, count), of linear interpolation between `count` equidistant knots, at s, (n,).

    The knots are on [0, 1]. Function k is 1 at knot k and 0 at all other knots. Values s outside of [0, 1] are replaced
    by the nearer end.
    """
    at = np.clip(s, 0.0, 1.0) * (count - 1)
    return np.clip(1.0 - np.abs(at[:, None] - np.arange(count)), 0.0, None)


def basis_integrals(s: np.ndarray, count: int) -> np.ndarray:
    """Return the integrals of the functions of `linear_basis` from 0 to s, (n, count), for each s, (n,)."""
    at = np.clip(s, 0.0, 1.0) * (count - 1)
    u = at[:, None] - np.arange(count)
    rising = np.clip(u + 1.0, 0.0, 1.0)
    falling = np.clip(u, 0.0, 1.0)
    integrals = 0.5 * rising**2 + falling - 0.5 * falling**2
    integrals[:, 0] -= 0.5  # the first basis function has no rising half
    return integrals / (count - 1)


@dataclass(frozen=True)
class Scale:
    """Amplitude at the start of an oscillation, in the length unit of the terms, and angular frequency in rad/s.

    If one of them is unknown or not needed, it is 1, and coefficients are in units of it.
    """

    amplitude: float = 1.0
    frequency: float = 1.0


def parameter(p: FreeParameter, score: float, scale: Scale) -> float:
    """Return the value of a term's parameter p at a standard normal score: if the score is N(0, 1), p has its prior.

    The value increases with the score, also for a half-normal prior.
    The value is in the unit of the parameter. scale: amplitude and frequency on which the prior depends.
    """
    prior = p.prior(scale.amplitude, scale.frequency)
    return float(
        prior.value(
            np.asarray(
                scipy.special.ndtri(0.5 + 0.5 * scipy.special.ndtr(score)) if prior.reflected else score
            )
        )
    )


def parameters(term: DampingTerm, scores: tuple[float, ...], scale: Scale) -> dict[str, float]:
    """Return a term's parameters other than its coefficient, by name, at their standard normal scores.

    scores: one for each of `term.inferred`, in this order; a score of 0 gives the median of the prior. scale: amplitude
    and frequency on which the priors depend.
    """
    return {p.name: parameter(p, z, scale) for p, z in zip(term.inferred, scores, strict=True)}


@lru_cache(maxsize=4096)
def log_loss(
    term: DampingTerm, scores: tuple[float, ...] = (), scale: Scale = Scale()
) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that computes ln of the decay rate which a damping term causes at a coefficient of 1.

    The function takes x = ln(A/A_start), any shape, and returns ln of the rate -d ln A/dt (1/s). It interpolates a
    table over `LOSS_GRID`, and extrapolates the rate as a power of A outside.

    Parameters
    ----------
    term
        The damping term.
    scores
        Standard normal scores of the term's parameters other than its coefficient, in the order of `term.inferred`; a
        score of 0 gives the median of the parameter's prior.
    scale
        Amplitude A_start at the start (rad or m) and angular frequency (rad/s).

    Raises
    ------
    InputError
        If the term dissipates no energy, or its loss is not finite.
    """
    loss = rates_per_unit(term, LOSS_GRID, parameters(term, scores, scale), scale)
    most = float(np.max(loss))
    if not (np.all(np.isfinite(loss)) and most > 0):
        wrong = next((rate for rate in loss if not np.isfinite(rate)), most)
        raise InputError(
            f"damping term {term.name!r}: the energy lost per cycle must be finite and positive, but a decay rate is "
            f"{wrong:g}; correct its kernel or the priors of its parameters"
        )
    log = np.log(np.maximum(loss, MIN_RELATIVE_LOSS * most))
    # If the loss is zero at some amplitudes, a spline would overshoot.
    table = (
        scipy.interpolate.CubicSpline(LOSS_GRID, log)
        if loss.min() > MIN_RELATIVE_LOSS * most
        else scipy.interpolate.PchipInterpolator(LOSS_GRID, log)
    )
    ends = LOSS_GRID[[0, -1]]
    slopes = table(ends, 1)

    def at(x: np.ndarray) -> np.ndarray:
        x = np.asarray(x, float)
        low, high = np.minimum(x - ends[0], 0.0), np.maximum(x - ends[1], 0.0)
        return table(np.clip(x, *ends)) + slopes[0] * low + slopes[1] * high

    return at


def rates_per_unit(
    term: DampingTerm, x: np.ndarray, further: Mapping[str, float], scale: Scale
) -> np.ndarray:
    """Return the decay rates -d ln A/dt (1/s), (n,), of a term with a coefficient of 1, at x = ln(A/A_start), (n,).

    further: values of the term's parameters other than its coefficient, by name; missing reference scales follow from
    `scale`, the amplitude at the start and the angular frequency.
    """
    a, omega = scale.amplitude, scale.frequency
    known = {"rest": 0.0, "reference_velocity": a * omega, "reference_amplitude": a, **further}
    amplitudes = a * np.exp(x)
    if not term.inferred and not set(term.given) & set(_REFERENCES):
        return np.array([omega * term.ratio_per_unit(float(at), omega) for at in amplitudes])
    return np.array([term.work(float(at), omega, known) / (2 * np.pi * omega * at**2) for at in amplitudes])


@lru_cache(maxsize=256)
def scales_needed(term: DampingTerm) -> tuple[bool, bool]:
    """Return whether the shape of a term's decay rate depends on the amplitude, and whether on the frequency.

    The shape is the rate as a function of ln(A/A_start), up to a factor. If it stays the same when amplitude or
    frequency and the priors of the parameters scale together, this amplitude or frequency need not be known.
    """
    x = np.array([-4.0, -2.0, 0.0])

    def shapes(scale: Scale) -> np.ndarray:
        rows = []
        for scores in product((-1.0, 0.5), repeat=len(term.inferred)):
            loss = rates_per_unit(term, x, parameters(term, scores, scale), scale)
            rows.append(loss / max(float(loss.max()), 1e-300))
        return np.array(rows)

    here = shapes(Scale())
    return tuple(
        not np.allclose(here, shapes(s), LOSS_TOLERANCE, LOSS_TOLERANCE)
        for s in (Scale(0.037, 1.0), Scale(1.0, 41.0))
    )  # type: ignore[return-value]


def are_proportional(a: DampingTerm, b: DampingTerm) -> bool:
    """Return whether the energy losses of two terms are proportional at all amplitudes.

    An envelope cannot distinguish such terms. A term that has parameters besides its coefficient, or whose shape
    depends on amplitude or frequency, counts as proportional only to itself.
    """
    if a.inferred or b.inferred or any(scales_needed(a)) or any(scales_needed(b)):
        return a is b
    x = np.array([-6.0, -4.0, -2.0, -1.0, 0.0])
    first, second = (rates_per_unit(term, x, {}, Scale()) for term in (a, b))
    return bool(np.allclose(first / first[-1], second / second[-1], LOSS_TOLERANCE, 0.0))
