"""Compute how an amplitude decays with time under a sum of damping terms or under a power law.

Averaged over a cycle (Krylov & Bogoliubov 1937; Nayfeh & Mook, Nonlinear Oscillations, 1979, ch. 3) the amplitude A of
an oscillation of angular frequency ω obeys dA/dt = -(ζA + 2μ_c/(πω) + 4μ_q ω A²/(3π)). With x = ln(A/A_ref), for a
reference amplitude A_ref, this is dx/dt = -Σ c_i exp((p_i - 1) x), where c_i is the decay rate -dx/dt (1/s) that term i
causes at A_ref, and p_i = 1, 0 and 2. Sums of these three terms have closed solutions. For any other term the decay
dA/dt = -W/(2πωA), with the work W in a cycle of a harmonic motion, is tabulated over ln A, and sums with such terms are
integrated numerically.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
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
_SMALL_ANGLE = 1e-6  # if |kt| is smaller, tanh(kt)/k = t is used
LAW_PANELS = 200
"""Number of intervals in ln A over which the time of a decay is integrated numerically; its relative error is then 1e-8
(measured)."""
MIN_RATE = 1e-30
"""Before something is divided by a decay rate (1/s), the rate is raised to at least this; an undamped amplitude then
stays constant."""
_GAUSS = np.array([-1.0, 1.0]) / np.sqrt(3.0)  # nodes of the two-point Gauss rule on [-1, 1]

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


def decay(t: np.ndarray, x0: float, terms: Sequence[str], rates: np.ndarray) -> np.ndarray:
    """Return x = ln(A/A_ref), (n,), at given times of a decay under a sum of viscous, Coulomb and quadratic damping.

    After the oscillation has come to rest, x is `LOG_AT_REST`. dA/dt = -(c0 + c1 A + c2 A²) (A relative to A_ref) is a
    Riccati equation with constant coefficients. With k² = |c1²/4 - c0 c2| its solution is A = (A_0 - T (c1/2 A_0 + c0))
    / (1 + T (c1/2 + c2 A_0)), T = tanh(kt)/k, or tan(kt)/k if c1²/4 < c0 c2.

    Parameters
    ----------
    t
        Times in s since the start, shape (n,).
    x0
        Value of x at t = 0.
    terms, rates
        Names of the terms (keys of `POWERS`), and the decay rate -dx/dt in 1/s that each causes at A_ref.
    """
    by_term = dict(zip(terms, rates, strict=True))
    c1, c0, c2 = (float(by_term.get(term, 0.0)) for term in POWERS)
    start = np.exp(x0)
    half = 0.5 * c1
    discriminant = half * half - c0 * c2
    k = np.sqrt(abs(discriminant))
    kt = k * t
    if discriminant < 0:
        # The amplitude reaches zero before tan(kt) diverges, and then stays there.
        late = kt >= 0.5 * np.pi
        tangent = np.where(late, np.inf, np.tan(np.where(late, 0.0, kt)) / k)
    else:
        tangent = np.where(np.abs(kt) > _SMALL_ANGLE, np.tanh(kt) / max(k, 1e-300), t)
    with np.errstate(invalid="ignore", divide="ignore"):
        amplitude = (start - tangent * (half * start + c0)) / (1.0 + tangent * (half + c2 * start))
    if c0 == 0.0 and c2 == 0.0:
        return np.maximum(x0 - c1 * t, LOG_AT_REST)
    if c0 == 0.0 and c1 > 0.0:  # this form has no cancellation at late times
        return np.maximum(x0 - c1 * t - np.log1p(-c2 * start * np.expm1(-c1 * t) / c1), LOG_AT_REST)
    if c2 == 0.0 and c1 > 0.0:
        amplitude = start * np.exp(-c1 * t) + c0 * np.expm1(-c1 * t) / c1
    return np.log(np.where(amplitude > np.exp(LOG_AT_REST), amplitude, np.exp(LOG_AT_REST)))


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


class DecayLaw(ABC):
    """A decay law dx/dt = -Σ c_i s_i(x) of x = ln(A/A_ref) under a sum of damping terms.

    Term i has the decay rate c_i (1/s) at the reference amplitude A_ref and the shape s_i, with s_i(0) = 1. (For a term
    that has hardly any effect at A_ref, s_i(0) can be less than 1, and its rate there is c_i s_i(0); see `Sum.law` in
    `inference.envelope.sums`.)
    """

    terms: tuple[str, ...]

    @abstractmethod
    def shapes(self, x: np.ndarray) -> np.ndarray:
        """Return the decay rates -dx/dt of the terms relative to those at A_ref, (terms, n), at x = ln(A/A_ref), (n,).

        They are the shapes s_i(x) in the definition of the law.
        """

    @abstractmethod
    def decay(self, t: np.ndarray, x0: float, rates: np.ndarray) -> np.ndarray:
        """Return x, (n,), at times t in s since the start, (n,), of a decay that starts from x0.

        rates: the rates c_i (1/s) of the terms, which must not be negative, (terms,).
        """

    def rate(self, x: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Return the total decay rate -dx/dt = Σ c_i s_i(x) in 1/s, (n,), at values of x, (n,); rates: c_i (1/s)."""
        return rates @ self.shapes(x)

    def slopes(self, t: np.ndarray, x: np.ndarray, x0: float, rates: np.ndarray, step: float) -> np.ndarray:
        """Return the derivatives, (n, terms), of x at times t by the rates c_i, as difference quotients.

        t: times in s since the start, (n,). x: values at these times, which only subclasses use. x0: value at the
        start. rates: the rates c_i (1/s). step: change of a rate in 1/s.
        """
        columns = []
        for i in range(len(rates)):
            up, down = rates.copy(), rates.copy()
            up[i] += step
            down[i] = max(0.0, rates[i] - step)
            columns.append((self.decay(t, x0, up) - self.decay(t, x0, down)) / (up[i] - down[i]))
        return np.stack(columns, axis=1)


@dataclass(frozen=True)
class ClosedForm(DecayLaw):
    """The decay law of sums of viscous, Coulomb and quadratic damping, in closed form."""

    terms: tuple[str, ...]

    def shapes(self, x: np.ndarray) -> np.ndarray:
        """Return the decay rates of the terms relative to those at A_ref, exp((p_i - 1) x), (terms, n), at x, (n,).

        Term i alone would cause the decay dA/dt ∝ -A^p_i.
        """
        return np.exp(np.array([[POWERS[term] - 1.0] for term in self.terms]) * x)

    def decay(self, t: np.ndarray, x0: float, rates: np.ndarray) -> np.ndarray:
        """Return x = ln(A/A_ref), (n,), at times t in s since the start, (n,), of a decay that starts from x0.

        rates: the decay rate at A_ref of each term in 1/s, (terms,). After the oscillation has come to rest, x is
        `LOG_AT_REST`.
        """
        return decay(t, x0, self.terms, rates)


@dataclass(frozen=True)
class PowerLaw(DecayLaw):
    """The decay law dA/dt ∝ -A^p, whose exponent p is a parameter.

    The two parameters, which its methods take as `rates`, are ln of the decay rate (1/s) at A_ref, and p.
    """

    terms: tuple[str, ...] = ("log_rate", "exponent")

    def shapes(self, x: np.ndarray) -> np.ndarray:
        """Raise NotImplementedError, because the shape of this law is not fixed: it depends on the exponent."""
        raise NotImplementedError

    def decay(self, t: np.ndarray, x0: float, rates: np.ndarray) -> np.ndarray:
        """Return x = ln(A/A_ref), (n,), at times t in s since the start, (n,), of a decay that starts from x0.

        rates: ln of the decay rate (1/s) at A_ref, and the exponent p. After the oscillation has come to rest, x is
        `LOG_AT_REST`.
        """
        return power_decay(t, x0, float(rates[0]), float(rates[1]))

    def rate(self, x: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Return the decay rate -dx/dt in 1/s at values of x = ln(A/A_ref), (n,).

        rates: ln of the decay rate (1/s) at A_ref, and the exponent p.
        """
        return np.exp(rates[0] + (rates[1] - 1.0) * x)

    def slopes(self, t: np.ndarray, x: np.ndarray, x0: float, rates: np.ndarray, step: float) -> np.ndarray:
        """Return the derivatives of x, (n, 2), by ln of the decay rate at A_ref, and by the exponent.

        They are exact; the arguments x and step are not used. t: times in s since the start, (n,). x0: value of x at
        the start. rates: ln of the decay rate (1/s) at A_ref, and the exponent p.
        """
        # `power_slopes` has the rate at the start as a parameter; the chain rule converts to the rate at A_ref.
        own = power_slopes(t, np.array([x0, rates[0] + (rates[1] - 1.0) * x0, rates[1]]))
        return np.column_stack([own[:, 1], own[:, 2] + x0 * own[:, 1]])


@dataclass(frozen=True)
class TabulatedLaw(DecayLaw):
    """The decay law of a sum of any terms, integrated numerically for x = ln(A/A_ref) between `low` and `high`.

    Outside this range the total decay rate is extrapolated as a power of A. each: the shape function of each term.
    """

    terms: tuple[str, ...]
    each: tuple[Shape, ...]
    low: float
    high: float

    def shapes(self, x: np.ndarray) -> np.ndarray:
        """Return the decay rates -dx/dt of the terms relative to those at A_ref, (terms, n), at x = ln(A/A_ref), (n,).

        They are the shapes s_i(x), which are evaluated at x itself: there is no interpolation between values in the
        table, and no extrapolation outside of it.
        """
        return np.stack([shape(x) for shape in self.each])

    @cached_property
    def _nodes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the nodes of the integration over x, and the terms' shapes at them.

        Returns x at the ends of the intervals, decreasing, (q,), with q = LAW_PANELS + 1; the shapes there, (terms, q);
        and the shapes at the two Gauss points in each interval, (terms, 2 LAW_PANELS).
        """
        x = np.linspace(self.high, self.low, LAW_PANELS + 1)
        middle, half = 0.5 * (x[1:] + x[:-1]), 0.5 * (x[0] - x[1])
        inside = (middle[:, None] + half * _GAUSS).ravel()
        return x, self.shapes(x), self.shapes(inside)

    def decay(self, t: np.ndarray, x0: float, rates: np.ndarray) -> np.ndarray:
        """Return x, (n,), at times t in s since the start, (n,), of a decay that starts from x0.

        The time t(x) = ∫ dx/rate is integrated numerically, and inverted by interpolation. rates: the rates c_i (1/s).
        """
        x, ends, inside = self._nodes
        speed = np.maximum(rates @ ends, MIN_RATE)
        slow = 1.0 / np.maximum(rates @ inside, MIN_RATE)
        durations = 0.5 * (x[0] - x[1]) * slow.reshape(-1, 2).sum(axis=1)
        passed = np.concatenate([[0.0], np.cumsum(durations)])
        # Local power of A at the two ends, for the extrapolation.
        power = [
            float(np.diff(np.log(speed[side]))[0] / np.diff(x[side])[0])
            for side in (slice(2), slice(-2, None))
        ]
        # `begun` is the time at which the tabulated decay, which starts at x[0], passes x0.
        if x0 > x[0]:
            begun = -_between(x0 - x[0], speed[0], power[0])
        elif x0 < x[-1]:
            begun = passed[-1] + _between(x[-1] - x0, speed[-1] * np.exp(power[1] * (x0 - x[-1])), power[1])
        else:
            begun = float(_cubic(np.array([x0]), x[::-1], passed[::-1], -1.0 / speed[::-1])[0])
        at = begun + t
        result = _cubic(np.clip(at, passed[0], passed[-1]), passed, x, -speed)
        for outside, place, since in ((at < 0.0, 0, at), (at > passed[-1], -1, at - passed[-1])):
            if outside.any():
                q = power[place]
                result[outside] = power_decay(
                    since[outside], float(x[place]), float(np.log(speed[place]) - q * x[place]), q + 1.0
                )
        return result

    def slopes(self, t: np.ndarray, x: np.ndarray, x0: float, rates: np.ndarray, step: float) -> np.ndarray:
        """Return the derivatives, (n, terms), of x at times t by the rates c_i, by quadrature.

        x: values at the times t, (n,). x0: value at the start. Integrals end at the ends of the table if x is outside
        of it. If the sum of the rates is below `step` (1/s), each rate is raised to at least `step`, because the
        integrals do not exist without damping.
        """
        # ∂x/∂c_i = -f ∫ s_i/f dt with f = -dx/dt.
        if rates.sum() < step:  # f = 0 has no such integral; use a small rate
            rates = np.maximum(rates, step)
            x = self.decay(t, x0, rates)
        nodes, ends, inside = self._nodes
        speed = np.maximum(rates @ ends, MIN_RATE)
        slow = inside / np.maximum(rates @ inside, MIN_RATE) ** 2
        each = 0.5 * (nodes[0] - nodes[1]) * slow.reshape(len(rates), -1, 2).sum(axis=2)
        passed = np.concatenate([np.zeros((len(rates), 1)), np.cumsum(each, axis=1)], axis=1)[:, ::-1]
        at = np.clip(np.append(x0, x), nodes[-1], nodes[0])
        integrals = [
            _cubic(at, nodes[::-1], values, slope)
            for values, slope in zip(passed, -(ends / speed**2)[:, ::-1], strict=True)
        ]
        since = np.stack([integral[1:] - integral[0] for integral in integrals], axis=1)
        return -np.maximum(self.rate(x, rates), MIN_RATE)[:, None] * since


def _between(fall: float, speed: float, power: float) -> float:
    """Return the time (s) in which x = ln A decreases by `fall`, if its decay rate is proportional to A^power.

    speed: the decay rate (1/s) at the end of this time.
    """
    return float(fall / speed if abs(power) < 1e-9 else -np.expm1(-power * fall) / (power * speed))


def _cubic(at: np.ndarray, x: np.ndarray, y: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return values, (k,), at points `at`, (k,), by cubic Hermite interpolation.

    x, y, slope: increasing nodes, and the values and derivatives at them, (n,) each.
    """
    i = np.clip(np.searchsorted(x, at, side="right") - 1, 0, x.size - 2)
    h = x[i + 1] - x[i]
    u = (at - x[i]) / h
    v = 1.0 - u
    return v * v * ((1.0 + 2.0 * u) * y[i] + u * h * slope[i]) + u * u * (
        (1.0 + 2.0 * v) * y[i + 1] - v * h * slope[i + 1]
    )


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
    step
        Change of a rate in 1/s for difference quotients.
    white
        Matrix (n, n) that whitens the noise of the readings; decays and derivatives are multiplied by it. None for
        white noise.
    restoring
        Part of the interface of `Solver`; not used here.
    """

    law: DecayLaw
    t: np.ndarray
    duration: float
    knots: int
    step: float
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
        x = self.law.decay(self.t, start, rates)
        speed = np.where(x > LOG_AT_REST, self.law.rate(x, rates), 0.0)
        slopes = np.empty((x.size, 0))
        if tangents:
            at_start = float(self.law.rate(np.array([start]), rates)[0])
            by_start = speed / at_start if at_start > 0 else np.ones_like(x)  # undamped
            slopes = np.column_stack([self.law.slopes(self.t, x, start, rates, self.step), by_start])
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
    """Return the value of a term's parameter p at a standard normal score; for scores ~ N(0, 1) it has its prior.

    This also holds for half-normal priors, whose own coordinate is the absolute value of a standard normal number.
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
