"""Decay of an amplitude under sums of damping terms and under a power law.

Averaged over a cycle (Krylov & Bogoliubov 1937; Nayfeh & Mook, Nonlinear Oscillations, 1979, ch. 3) an oscillation of
frequency ω loses amplitude as dA/dt = -(ζA + 2μ_c/(πω) + 4μ_q ω A²/(3π)). With x = ln(A/A_ref) each term is a rate in
1/s at the reference amplitude times a power of it, dx/dt = -Σ c_i exp((p_i - 1) x), with p = 1, 0 and 2. These sums
have closed forms. Of any other term, shipped or a user's own, what a cycle takes of an amplitude is tabulated over
ln A, dA/dt = -W/(2πωA) with the work W in a cycle of a harmonic motion; sums with such terms are integrated.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations, product

import numpy as np
import scipy  # loads its modules when they are used
from scipy.special import ndtr, ndtri

from bayesdamp.physics.damping import DampingTerm, FreeParameter
from bayesdamp.physics.kernel.solve import ALL, PARAMETERS, Motion
from bayesdamp.types import InputError

POWERS: Mapping[str, float] = {"viscous": 1.0, "coulomb": 0.0, "quadratic": 2.0}
"""Power of the amplitude with which a term's loss grows, in the order in which sums name them."""
SUMS = tuple(terms for count in (1, 2, 3) for terms in combinations(POWERS, count))
RESTED = -60.0
"""ln(A/A_ref) of an oscillation that has come to rest."""
EXPONENTS = -1.0, 3.0
"""Smallest and largest power of the amplitude: below 0 is friction that rises towards rest."""
NEAR_VISCOUS = 1e-4
"""Distance of the exponent from 1 below which its derivative follows from a series."""
_NEAR_ONE = 1e-6
_LINEAR = 1e-6
PANELS = 200
"""Number of panels of the amplitude's logarithm over which time is integrated: it is then right to 1e-8."""
LEAST = 1e-30
"""Least rate in 1/s: an undamped amplitude is constant."""
_GAUSS = np.array([-1.0, 1.0]) / np.sqrt(3.0)

Shape = Callable[[np.ndarray], np.ndarray]
"""A term's loss at x = ln(A/A_ref) relative to that at x = 0, of the amplitude itself."""
GRID = np.linspace(-12.0, 1.5, 68)
"""ln(A/A_start) of the table; beyond it a loss continues as a power of A."""
NOTHING = 1e-12
"""Least loss as a share of the largest one in the table."""
SAME = 1e-6
"""Relative difference up to which two losses are the same."""
_REFERENCES = ("reference_velocity", "reference_amplitude")


def decay(t: np.ndarray, x0: float, terms: Sequence[str], rates: np.ndarray) -> np.ndarray:
    """Return the decay x = ln(A/A_ref) at times t, shape (n,); RESTED from where it comes to rest.

    The sum of all three is a Riccati equation with constant coefficients, whose solution is a fraction in tanh or tan.

    Parameters
    ----------
    t
        Times in s from 0, shape (n,).
    x0
        x at the start.
    terms, rates
        Terms of the sum, and their rates in 1/s at the reference amplitude.
    """
    by_term = dict(zip(terms, rates, strict=True))
    c1, c0, c2 = (float(by_term.get(term, 0.0)) for term in POWERS)
    start = np.exp(x0)
    half = 0.5 * c1
    discriminant = half * half - c0 * c2
    k = np.sqrt(abs(discriminant))
    kt = k * t
    if discriminant < 0:
        # Amplitude passes zero before tan does infinity: from there on it has come to rest.
        late = kt >= 0.5 * np.pi
        grown = np.where(late, np.inf, np.tan(np.where(late, 0.0, kt)) / k)
    else:
        grown = np.where(np.abs(kt) > _LINEAR, np.tanh(kt) / max(k, 1e-300), t)
    with np.errstate(invalid="ignore", divide="ignore"):
        amplitude = (start - grown * (half * start + c0)) / (1.0 + grown * (half + c2 * start))
    if c0 == 0.0 and c2 == 0.0:
        return np.maximum(x0 - c1 * t, RESTED)
    if c0 == 0.0 and c1 > 0.0:  # without the difference of nearly equal numbers that tanh leaves late
        return np.maximum(x0 - c1 * t - np.log1p(-c2 * start * np.expm1(-c1 * t) / c1), RESTED)
    if c2 == 0.0 and c1 > 0.0:
        left = start * np.exp(-c1 * t) + c0 * np.expm1(-c1 * t) / c1
        amplitude = left
    return np.log(np.where(amplitude > np.exp(RESTED), amplitude, np.exp(RESTED)))


def power_decay(t: np.ndarray, x0: float, log_rate: float, power: float) -> np.ndarray:
    """Return x at times t under dA/dt = -c A^p alone, with the rate exp(log_rate) in 1/s at the reference amplitude."""
    q = power - 1.0
    speed = np.exp(log_rate + q * x0)
    if abs(q) < _NEAR_ONE:
        return np.maximum(x0 - speed * t, RESTED)
    inside = q * speed * t
    with np.errstate(invalid="ignore", divide="ignore"):
        x = x0 - np.log1p(inside) / q
    return np.where((inside > -1.0) & (x > RESTED), x, RESTED)


def power_slopes(t: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the derivatives of `power_decay`'s x by x at the start, ln of the rate there, and exponent, (n, 3)."""
    q, passed = p[2] - 1.0, np.exp(p[1]) * t
    left = np.maximum(1.0 + q * passed, 1e-12)  # 0 where it comes to rest
    if abs(q) < NEAR_VISCOUS:
        bend = passed * passed * (0.5 - 2.0 / 3.0 * q * passed)
    else:
        bend = (np.log(left) / q - passed / left) / q
    return np.column_stack([np.ones_like(t), -passed / left, bend])


def coefficient(
    term: str, rate: np.ndarray, reference: float, omega: float | None
) -> tuple[str, np.ndarray, str]:
    """Return name, values and unit, with `{}` for the amplitude's unit, of a term's coefficient.

    Parameters
    ----------
    term
        A damping term of `POWERS`.
    rate
        Rates in 1/s at the reference amplitude, any shape.
    reference
        The reference amplitude.
    omega
        Frequency in rad/s. With it the coefficient is `zeta`, `mu_c` or `mu_q` of the equation of motion; without it
        (None) the loss of amplitude: c A (1/s), c, c A².
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


class Law(ABC):
    """The decay dx/dt = -Σ c_i s_i(x) of x = ln(A/A_ref)."""

    terms: tuple[str, ...]

    @abstractmethod
    def shapes(self, x: np.ndarray) -> np.ndarray:
        """Return s_i at x (n,), shape (terms, n)."""

    @abstractmethod
    def decay(self, t: np.ndarray, x0: float, rates: np.ndarray) -> np.ndarray:
        """Return x at times t (s, from 0), shape (n,), from x0 with these rates c_i (1/s, not negative)."""

    def rate(self, x: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Return -dx/dt in 1/s at x, shape (n,)."""
        return rates @ self.shapes(x)

    def slopes(self, t: np.ndarray, x: np.ndarray, x0: float, rates: np.ndarray, step: float) -> np.ndarray:
        """Return the derivatives of the decay x at t by the rates, (n, terms); step: of a small rate, in 1/s."""
        columns = []
        for i in range(len(rates)):
            up, down = rates.copy(), rates.copy()
            up[i] += step
            down[i] = max(0.0, rates[i] - step)
            columns.append((self.decay(t, x0, up) - self.decay(t, x0, down)) / (up[i] - down[i]))
        return np.stack(columns, axis=1)


@dataclass(frozen=True)
class ClosedForm(Law):
    """The closed form of viscous, Coulomb and quadratic damping."""

    terms: tuple[str, ...]

    def shapes(self, x: np.ndarray) -> np.ndarray:
        """Return exp((p_i - 1) x), shape (terms, n)."""
        return np.exp(np.array([[POWERS[term] - 1.0] for term in self.terms]) * x)

    def decay(self, t: np.ndarray, x0: float, rates: np.ndarray) -> np.ndarray:
        """Return `laws.decay`."""
        return decay(t, x0, self.terms, rates)


@dataclass(frozen=True)
class PowerLaw(Law):
    """One power p of the amplitude, dA/dt = -c A^p; its parameters are ln of the rate c in 1/s at A_ref, and p."""

    terms: tuple[str, ...] = ("log_rate", "exponent")

    def shapes(self, x: np.ndarray) -> np.ndarray:
        """Raise NotImplementedError: its shape is not known beforehand."""
        raise NotImplementedError

    def decay(self, t: np.ndarray, x0: float, rates: np.ndarray) -> np.ndarray:
        """Return `laws.power_decay`."""
        return power_decay(t, x0, float(rates[0]), float(rates[1]))

    def rate(self, x: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Return -dx/dt in 1/s at x, shape (n,)."""
        return np.exp(rates[0] + (rates[1] - 1.0) * x)

    def slopes(self, t: np.ndarray, x: np.ndarray, x0: float, rates: np.ndarray, step: float) -> np.ndarray:
        """Return the derivatives from `laws.power_slopes`, which has the rate at the start."""
        own = power_slopes(t, np.array([x0, rates[0] + (rates[1] - 1.0) * x0, rates[1]]))
        return np.column_stack([own[:, 1], own[:, 2] + x0 * own[:, 1]])


@dataclass(frozen=True)
class Tabled(Law):
    """Any terms, whose shapes are tabulated between `low` and `high`; beyond, the sum continues as a power of A."""

    terms: tuple[str, ...]
    each: tuple[Shape, ...]
    low: float
    high: float

    def shapes(self, x: np.ndarray) -> np.ndarray:
        """Return the shape of each term at x (n,), (terms, n)."""
        return np.stack([shape(x) for shape in self.each])

    @cached_property
    def _nodes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x of the panels' ends, falling, and shapes there and at Gauss and Legendre's two points of each panel."""
        x = np.linspace(self.high, self.low, PANELS + 1)
        middle, half = 0.5 * (x[1:] + x[:-1]), 0.5 * (x[0] - x[1])
        inside = (middle[:, None] + half * _GAUSS).ravel()
        return x, self.shapes(x), self.shapes(inside)

    def decay(self, t: np.ndarray, x0: float, rates: np.ndarray) -> np.ndarray:
        """Return x from t(x) = ∫ dx/f by quadrature, inverted by cubics through its nodes and slopes."""
        x, ends, inside = self._nodes
        speed = np.maximum(rates @ ends, LEAST)
        slow = 1.0 / np.maximum(rates @ inside, LEAST)
        took = 0.5 * (x[0] - x[1]) * slow.reshape(-1, 2).sum(axis=1)
        passed = np.concatenate([[0.0], np.cumsum(took)])
        power = [
            float(np.diff(np.log(speed[side]))[0] / np.diff(x[side])[0])
            for side in (slice(2), slice(-2, None))
        ]
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
        """Return the derivatives by quadrature: a larger rate moves the amplitude on by f ∫ s_i/f dt."""
        if rates.sum() < step:  # a constant amplitude has no such integral
            rates = np.maximum(rates, step)
            x = self.decay(t, x0, rates)
        nodes, ends, inside = self._nodes
        speed = np.maximum(rates @ ends, LEAST)
        slow = inside / np.maximum(rates @ inside, LEAST) ** 2
        each = 0.5 * (nodes[0] - nodes[1]) * slow.reshape(len(rates), -1, 2).sum(axis=2)
        passed = np.concatenate([np.zeros((len(rates), 1)), np.cumsum(each, axis=1)], axis=1)[:, ::-1]
        at = np.clip(np.append(x0, x), nodes[-1], nodes[0])
        integrals = [
            _cubic(at, nodes[::-1], values, slope)
            for values, slope in zip(passed, -(ends / speed**2)[:, ::-1], strict=True)
        ]
        since = np.stack([integral[1:] - integral[0] for integral in integrals], axis=1)
        return -np.maximum(self.rate(x, rates), LEAST)[:, None] * since


def _between(fall: float, speed: float, power: float) -> float:
    """Return the time in which x falls to where the rate is `speed`, under a power of A."""
    return float(fall / speed if abs(power) < 1e-9 else -np.expm1(-power * fall) / (power * speed))


def _cubic(at: np.ndarray, x: np.ndarray, y: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return Hermite's cubics through values and slopes at rising x."""
    i = np.clip(np.searchsorted(x, at, side="right") - 1, 0, x.size - 2)
    h = x[i + 1] - x[i]
    u = (at - x[i]) / h
    v = 1.0 - u
    return v * v * ((1.0 + 2.0 * u) * y[i] + u * h * slope[i]) + u * u * (
        (1.0 + 2.0 * v) * y[i + 1] - v * h * slope[i + 1]
    )


@dataclass(frozen=True)
class AmplitudeSolver:
    """Decays of x = ln(A/A_ref) under a law, with the interface of the kernel's solver.

    Its parameters are the rates in 1/s at the reference amplitude, in the order of the law's terms, and x at the start.

    Attributes
    ----------
    law
        The sum of damping terms.
    t
        Times of the readings in s from the start, (n,).
    duration
        Duration of the decay in s, over which the deviation's knots are equidistant.
    knots
        Number of knots.
    step
        Step of a small rate in 1/s, for derivatives.
    white
        Matrix (n, n) that whitens the noise of the readings in decays; None for none.
    """

    law: Law
    t: np.ndarray
    duration: float
    knots: int
    step: float
    white: np.ndarray | None = None
    restoring: str = "linear"

    @property
    def frequency(self) -> float:
        """One over the duration, in 1/s, because nothing oscillates."""
        return 1.0 / self.duration

    @cached_property
    def hats(self) -> np.ndarray:
        """Linear interpolation of the deviation at the readings from its values at the knots, (n, knots)."""
        return hats(self.t / self.duration, self.knots)

    def solve(
        self,
        p: np.ndarray,
        active: np.ndarray | None = None,
        *,
        tangents: int = PARAMETERS,
        stop: int | None = None,
        tolerance: float | None = None,
    ) -> Motion:
        """Return the decay of parameters p, (d + 1,), with tangents by these and, if `ALL`, by the deviation.

        A faster decay is the same decay on another clock, x(t) = X(t + ∫g dt), so that to first order ∂x/∂g_k =
        -rate(x) ∫ b_k dt. Nothing is integrated, so `active`, `stop` and `tolerance` have no effect.
        """
        rates, start = p[:-1], float(p[-1])
        x = self.law.decay(self.t, start, rates)
        speed = np.where(x > RESTED, self.law.rate(x, rates), 0.0)
        slopes = np.empty((x.size, 0))
        if tangents:
            at_start = float(self.law.rate(np.array([start]), rates)[0])
            by_start = speed / at_start if at_start > 0 else np.ones_like(x)  # undamped
            slopes = np.column_stack([self.law.slopes(self.t, x, start, rates, self.step), by_start])
        if tangents == ALL:
            passed = warp_integrals(self.t / self.duration, self.knots) * self.duration
            slopes = np.column_stack([slopes, -speed[:, None] * passed])
        states = np.column_stack([x, -speed])
        if self.white is not None:
            x, slopes = self.white @ x, self.white @ slopes
        return Motion(x, slopes, self.t, states)


def hats(s: np.ndarray, count: int) -> np.ndarray:
    """Return the piecewise linear basis at s in [0, 1], shape (n, count)."""
    at = np.clip(s, 0.0, 1.0) * (count - 1)
    return np.clip(1.0 - np.abs(at[:, None] - np.arange(count)), 0.0, None)


def warp_integrals(s: np.ndarray, count: int) -> np.ndarray:
    """Return the exact integral of the basis from 0 to s, shape (n, count)."""
    at = np.clip(s, 0.0, 1.0) * (count - 1)
    u = at[:, None] - np.arange(count)
    rising = np.clip(u + 1.0, 0.0, 1.0)
    falling = np.clip(u, 0.0, 1.0)
    integrals = 0.5 * rising**2 + falling - 0.5 * falling**2
    integrals[:, 0] -= 0.5  # the first hat has no rising half
    return integrals / (count - 1)


@dataclass(frozen=True)
class Scale:
    """Amplitude at the start, in the unit of a term's own parameters, and frequency in rad/s.

    They are 1 where they are not known; terms are then in units of these.
    """

    amplitude: float = 1.0
    frequency: float = 1.0


def parameter(p: FreeParameter, score: float, scale: Scale) -> float:
    """Return a parameter's value at a score with a normal prior, also where the prior's own score is folded."""
    prior = p.prior(scale.amplitude, scale.frequency)
    return float(prior.value(np.asarray(ndtri(0.5 + 0.5 * ndtr(score)) if prior.reflected else score)))


def parameters(term: DampingTerm, scores: tuple[float, ...], scale: Scale) -> dict[str, float]:
    """Return a term's own parameters by name, at its scores."""
    return {p.name: parameter(p, z, scale) for p, z in zip(term.inferred, scores, strict=True)}


@lru_cache(maxsize=4096)
def log_loss(
    term: DampingTerm, scores: tuple[float, ...] = (), scale: Scale = Scale()
) -> Callable[[np.ndarray], np.ndarray]:
    """Return ln of the relative loss of amplitude in 1/s per unit of the coefficient, as a function of ln(A/A_start).

    Parameters
    ----------
    term
        The damping term.
    scores
        Scores of the term's parameters, see `parameter`.
    scale
        Amplitude and frequency at the start.

    Raises
    ------
    InputError
        Where the term takes no energy.
    """
    loss = losses(term, GRID, parameters(term, scores, scale), scale)
    most = float(np.max(loss))
    if not (np.all(np.isfinite(loss)) and most > 0):
        raise InputError(
            f"damping term {term.name!r}: a cycle's loss is {loss[-1]:g} at the largest amplitude, "
            "and must be positive; correct its kernel or the bounds of its parameters"
        )
    log = np.log(np.maximum(loss, NOTHING * most))
    # Where a loss begins or ends at an amplitude, a spline would oscillate.
    table = (
        scipy.interpolate.CubicSpline(GRID, log)
        if loss.min() > NOTHING * most
        else scipy.interpolate.PchipInterpolator(GRID, log)
    )
    ends = GRID[[0, -1]]
    slopes = table(ends, 1)

    def at(x: np.ndarray) -> np.ndarray:
        x = np.asarray(x, float)
        low, high = np.minimum(x - ends[0], 0.0), np.maximum(x - ends[1], 0.0)
        return table(np.clip(x, *ends)) + slopes[0] * low + slopes[1] * high

    return at


def losses(term: DampingTerm, x: np.ndarray, further: Mapping[str, float], scale: Scale) -> np.ndarray:
    """Return relative losses of amplitude in 1/s per unit of the coefficient, (n,), at ln(A/A_start), (n,)."""
    a, omega = scale.amplitude, scale.frequency
    known = {"rest": 0.0, "reference_velocity": a * omega, "reference_amplitude": a, **further}
    amplitudes = a * np.exp(x)
    if not term.inferred and not set(term.given) & set(_REFERENCES):
        return np.array([omega * term.ratio_per_unit(float(at), omega) for at in amplitudes])
    return np.array([term.work(float(at), omega, known) / (2 * np.pi * omega * at**2) for at in amplitudes])


@lru_cache(maxsize=256)
def scales_needed(term: DampingTerm) -> tuple[bool, bool]:
    """Return whether the shape of a term's loss depends on the unit of the amplitude, and on that of the frequency.

    A term whose parameters scale with the amplitude and frequency of the record, as their priors do, needs neither.
    """
    x = np.array([-4.0, -2.0, 0.0])

    def shapes(scale: Scale) -> np.ndarray:
        rows = []
        for scores in product((-1.0, 0.5), repeat=len(term.inferred)):
            loss = losses(term, x, parameters(term, scores, scale), scale)
            rows.append(loss / max(float(loss.max()), 1e-300))
        return np.array(rows)

    here = shapes(Scale())
    return tuple(not np.allclose(here, shapes(s), SAME, SAME) for s in (Scale(0.037, 1.0), Scale(1.0, 41.0)))  # type: ignore[return-value]


def alike(a: DampingTerm, b: DampingTerm) -> bool:
    """Return whether two terms lose the same at every amplitude, so that an envelope cannot distinguish them."""
    if a.inferred or b.inferred or any(scales_needed(a)) or any(scales_needed(b)):
        return a is b
    x = np.array([-6.0, -4.0, -2.0, -1.0, 0.0])
    first, second = (losses(term, x, {}, Scale()) for term in (a, b))
    return bool(np.allclose(first / first[-1], second / second[-1], SAME, 0.0))
