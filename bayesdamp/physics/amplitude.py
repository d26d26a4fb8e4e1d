"""Compute how an amplitude decays with time under a sum of damping terms or under a power law.

A damping term is one of the damping forces that act on the oscillation. Averaged over a cycle (Krylov & Bogoliubov
1937; Nayfeh & Mook, Nonlinear Oscillations, 1979, ch. 3) the amplitude A of an oscillation of angular frequency ω obeys
dA/dt = -(ζA + 2μ_c/(πω) + 4μ_q ω A²/(3π)). Here ζ, μ_c and μ_q are the coefficients of viscous, Coulomb and quadratic
damping. With x = ln(A/A_ref), for a reference amplitude A_ref, this is dx/dt = -Σ c_i exp((p_i - 1) x). Here c_i is the
decay rate -dx/dt (1/s) that term i causes at A_ref, and p_i = 1, 0 and 2 for the three terms. For any other term the
decay rate W/(2πωA²) of ln A is tabulated over ln A, where W is the work per unit of inertia in a cycle of a harmonic
motion. The decay under a sum of terms is integrated numerically.
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
"""For each of three damping terms, the exponent p of the amplitude decay dA/dt ∝ -A^p that it causes. Sums of terms
name them in this order."""
SUMS = tuple(terms for count in (1, 2, 3) for terms in combinations(POWERS, count))
"""All seven sums of viscous, Coulomb and quadratic damping, each as a tuple of names; single terms come first."""
FORMS = (("cubic",), ("viscous", "cubic"))
"""Sums with another form of damping, whose decay rate has a part that is proportional to A², as in micromechanical
resonators. By default they are compared together with `SUMS`."""
LOG_AT_REST = -60.0
"""Value that is returned for ln(A/A_ref) of an oscillation that has come to rest (A = 0), where the logarithm is -∞. It
is also the smallest value that a computed decay can have (conventional)."""
EXPONENT_RANGE = -1.0, 3.0
"""Smallest and largest exponent p when the power law dA/dt ∝ -A^p is fitted. With p < 0 the friction increases as the
amplitude decreases."""
NEAR_VISCOUS = 1e-4
"""If the exponent p of a power law differs from 1 by less than this, the derivative of ln A by p is computed from a
series, because the general formula divides by p - 1."""
_NEAR_ONE = 1e-6  # if |p - 1| is smaller, the formula for p = 1 is used
LAW_PANELS, TAIL_PANELS = 1000, 400
"""Numbers of intervals in ln A over which a decay is integrated numerically: `LAW_PANELS` in the range of the measured
amplitudes, `TAIL_PANELS` below this range. The errors of ln A and the relative errors of its derivatives are then less
than 1e-6, also near rest (measured)."""
LEAST_FALL = 1e-7
"""Smallest decrease of ln A over a decay for which `DecayLaw.solve` uses the given decay rates. If they cause a smaller
decrease, they are raised to cause about this one, because its integrals do not exist without damping."""
MIN_RATE = 1e-30
"""Smallest decay rate (1/s) by which `DecayLaw.solve` divides; smaller rates are raised to it. An undamped amplitude
then stays constant."""

Shape = Callable[[np.ndarray], np.ndarray]
"""The shape of a damping term: a function s(x) of x = ln(A/A_ref) that returns the term's decay rate -dx/dt relative to
its value at x = 0."""
LOSS_GRID = np.linspace(-12.0, 1.5, 68)
"""Values of ln(A/A_start) at which the decay rate of a damping term is tabulated, where A is the amplitude and A_start
its value at the start. Outside of this range, the rate is extrapolated as a power of A."""
MIN_RELATIVE_LOSS = 1e-12
"""Smallest decay rate in the table of a damping term over `LOSS_GRID`, relative to the largest. Smaller rates are
raised to it, so that their logarithm is finite."""
LOSS_TOLERANCE = 1e-6
"""Largest relative difference of two decay rates that count as equal, when the decay rates of damping terms are
compared as functions of the amplitude."""
_REFERENCES = ("reference_velocity", "reference_amplitude")
"""Names of the reference scales of velocity and displacement on which the force of a damping term may depend. They are
those in `damping.GIVEN`, without the equilibrium."""


def power_decay(t: np.ndarray, x0: float, log_rate: float, power: float) -> np.ndarray:
    """Return x = ln(A/A_ref), (n,), at times t (s), (n,), of a decay dA/dt ∝ -A^p that starts from x0 at t = 0.

    log_rate: ln of the decay rate -dx/dt (1/s) at the reference amplitude A_ref. power: exponent p. After the
    oscillation has come to rest, x is `LOG_AT_REST`.
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
    """Return the derivatives, (n, 3), of x = ln(A/A_ref) by the parameters of a decay dA/dt ∝ -A^p.

    t: times in s since the start, (n,). p: the three parameters, in the order of the columns: x at the start, ln of the
    decay rate -dx/dt (1/s) at the start, and the exponent. The derivatives are valid until the oscillation comes to
    rest.
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

    In the returned unit, `{}` is a placeholder for the unit of the amplitude.

    Parameters
    ----------
    term
        Name of a damping term: viscous, coulomb or quadratic.
    rate
        Decay rates -d ln A/dt in 1/s at the reference amplitude, any shape.
    reference
        The reference amplitude, in any unit.
    omega
        Angular frequency in rad/s, or None if unknown. If it is known, the result is the coefficient `zeta`, `mu_c` or
        `mu_q` of the equation of motion. If it is unknown, the result is the coefficient c of the amplitude's decay:
        dA/dt = -c A (viscous; its name is also `zeta`), -c (Coulomb; `loss_c`) or -c A² (quadratic; `loss_q`).
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

    A is the amplitude. Term i has the decay rate c_i (1/s) at the reference amplitude A_ref. Its shape s_i describes
    how the decay rate depends on x, with s_i(0) = 1. (For a term that has hardly any effect at A_ref, s_i(0) can be
    less than 1. Its decay rate at A_ref is then c_i s_i(0); see `Sum.law` in `inference.envelope.sums`.)

    Attributes
    ----------
    terms
        Names of the terms.
    each
        The shape s_i of each term.
    low, high
        Values of x between which the integration has equal steps. Below `low` its steps increase, down to
        `LOG_AT_REST`. Decays that start above `high` are computed as if they started at `high`.
    """

    terms: tuple[str, ...]
    each: tuple[Shape, ...]
    low: float
    high: float

    def shapes(self, x: np.ndarray) -> np.ndarray:
        """Return the shapes s_i(x) of the damping terms, (terms, n), at x = ln(A/A_ref), (n,).

        The shape of a term is the decay rate -dx/dt that it causes, relative to its rate at the reference amplitude
        A_ref.
        """
        return np.stack([shape(x) for shape in self.each])

    def rate(self, x: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Return the total decay rate -dx/dt of x = ln(A/A_ref) in 1/s, (n,), at values of x, (n,).

        It is Σ c_i s_i(x). rates: the decay rate c_i (1/s) of each damping term at the reference amplitude A_ref,
        (terms,). The shape s_i is the rate of a term relative to its rate at A_ref.
        """
        return rates @ self.shapes(x)

    @cached_property
    def _nodes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the nodes of the numerical integration over x = ln(A/A_ref), and the terms' shapes at them.

        The shape of a damping term is its decay rate relative to its rate at A_ref. Returns three arrays: -x at the
        ends of the q - 1 intervals, increasing, (q,); the shapes at these points, (terms, q); and the shapes at the
        first Gauss point of each interval, then at the second of each, (terms, 2q - 2).
        """
        below = (self.low - LOG_AT_REST) * np.linspace(0.0, 1.0, TAIL_PANELS + 1)[1:] ** 2
        fallen = np.concatenate([np.linspace(-self.high, -self.low, LAW_PANELS + 1), below - self.low])
        middle, off = 0.5 * (fallen[1:] + fallen[:-1]), 0.5 * np.diff(fallen) / np.sqrt(3.0)
        return fallen, self.shapes(-fallen), self.shapes(-np.concatenate([middle - off, middle + off]))

    def solve(self, t: np.ndarray, x0: float, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return x = ln(A/A_ref), (n,), of a decay that starts from x0, and its derivatives by the rates, (n, terms).

        The time t(x) = ∫ dx/rate is integrated numerically, and inverted by interpolation. After the oscillation has
        come to rest, x is `LOG_AT_REST`; the derivatives are valid until then. If the rates hardly change x, they are
        raised, because the integrals do not exist without damping. If x0 is above `high`, the decay starts from `high`.

        t: increasing times in s since the start, the last above 0, (n,). rates: the decay rate c_i (1/s) of each
        damping term at the reference amplitude A_ref, not negative, (terms,).
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
    """Return the integrals, (..., n), of functions from x[0] to each x, (n,), by two-point Gauss quadrature.

    inside: values of the functions at the first Gauss point of each of the n - 1 intervals, then at the second of each,
    (..., 2n - 2).
    """
    first, second = np.split(inside, 2, axis=-1)
    integrals = np.zeros((*inside.shape[:-1], x.size))
    np.cumsum(0.5 * np.diff(x) * (first + second), axis=-1, out=integrals[..., 1:])
    return integrals


def _cubic(at: np.ndarray, x: np.ndarray, y: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return values of functions, (..., k), at points `at`, (k,), by cubic Hermite interpolation.

    x: nodes that do not decrease, (n,). y, slope: values and derivatives of the functions at the nodes, (..., n).
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
    """The decay law dA/dt ∝ -A^p of an amplitude A, whose exponent p is a parameter.

    Its methods take two parameters, named in `terms`, in the argument `rates`: ln of the decay rate (1/s) at the
    reference amplitude A_ref, and the exponent p.
    """

    terms: tuple[str, ...] = ("log_rate", "exponent")

    def rate(self, x: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Return the decay rate -dx/dt of x = ln(A/A_ref) in 1/s, (n,), at values of x, (n,), if dA/dt ∝ -A^p.

        rates: ln of the decay rate (1/s) at the reference amplitude A_ref, and the exponent p.
        """
        return np.exp(rates[0] + (rates[1] - 1.0) * x)

    def solve(self, t: np.ndarray, x0: float, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return x = ln(A/A_ref), (n,), of a decay that starts from x0, and its derivatives by the parameters, (n, 2).

        The decay is dA/dt ∝ -A^p. After the oscillation has come to rest, x is `LOG_AT_REST`; the derivatives are valid
        until then. t: times in s since the start, (n,). rates: the two parameters, ln of the decay rate (1/s) at the
        reference amplitude A_ref and the exponent p.
        """
        x = power_decay(t, x0, float(rates[0]), float(rates[1]))
        # `power_slopes` has the rate at the start as a parameter; the chain rule converts to the rate at A_ref.
        own = power_slopes(t, np.array([x0, rates[0] + (rates[1] - 1.0) * x0, rates[1]]))
        return x, np.column_stack([own[:, 1], own[:, 2] + x0 * own[:, 1]])


@dataclass(frozen=True)
class AmplitudeSolver:
    """Compute how an amplitude A decays, x(t) = ln(A/A_ref), with the interface of the kernel's `Solver`.

    It is for envelopes: records that contain only amplitudes. The parameters of `solve` are those of the decay law,
    then x at the start. A `DecayLaw` has a parameter for each of its damping terms: the decay rate in 1/s that the term
    causes at the reference amplitude A_ref. A `PowerLaw` has two parameters: ln of the decay rate (1/s) at A_ref, and
    the exponent.

    Attributes
    ----------
    law
        The decay law.
    t
        Times of the measured amplitudes in s since the start, (n,).
    duration
        Duration of the decay in s.
    knots
        Number of knots of the deviation g, which are equidistant over the duration. The decay rate is that of the law
        times 1 + g; g is linear in time between the knots.
    white
        Matrix (n, n) that whitens the noise of the measured ln A; decays and derivatives are multiplied by it. None for
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
        """Compute the decay x(t) = ln(A/A_ref) without deviation (g = 0), with derivatives by p and by g at the knots.

        p, (k + 1,): the k parameters of the decay law, then x at the start. The parameters of a `DecayLaw` are the
        decay rates in 1/s of its k damping terms at the reference amplitude A_ref. A `PowerLaw` has k = 2 parameters.
        In the result, the values are x at the times of the measured amplitudes. The columns of the derivatives are
        those by p and then by g for `tangents` = `ALL`, by p for `PARAMETERS`, and none for `NONE`; they are 0 after
        the oscillation has come to rest. Values and derivatives are multiplied by the matrix `white`. The states are x
        and dx/dt, (n, 2), without this factor.

        The deviation g(t) would multiply all rates by 1 + g(t). Therefore x(t) = X(t + ∫g dt), where X is the decay for
        g = 0. To first order, ∂x/∂g_k = -rate(x) ∫ b_k dt with the basis function b_k of knot k. `active`, `stop` and
        `tolerance` have no effect.
        """
        rates, start = p[:-1], float(p[-1])
        x, by_rates = self.law.solve(self.t, start, rates)
        moving = x > LOG_AT_REST
        speed = np.where(moving, self.law.rate(x, rates), 0.0)
        slopes = np.empty((x.size, 0))
        if tangents:
            at_start = float(self.law.rate(np.array([start]), rates)[0])
            by_start = speed / at_start if at_start > 0 else np.ones_like(x)  # 1: without damping
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

    The knots extend from 0 to 1. Function k is 1 at knot k, 0 at all other knots, and linear between knots. Values s
    outside of [0, 1] are replaced by the nearer end.
    """
    at = np.clip(s, 0.0, 1.0) * (count - 1)
    return np.clip(1.0 - np.abs(at[:, None] - np.arange(count)), 0.0, None)


def basis_integrals(s: np.ndarray, count: int) -> np.ndarray:
    """Return the integrals from 0 to s, (n, count), of the basis functions of linear interpolation, for each s, (n,).

    Basis function k is 1 at knot k, 0 at all other knots, and linear between knots. The `count` ≥ 2 knots are
    equidistant from 0 to 1. Values s outside of [0, 1] are replaced by the nearer end.
    """
    u = np.clip(s, 0.0, 1.0)[:, None] * (count - 1) - np.arange(count)
    rising = np.clip(u + 1.0, 0.0, 1.0)
    falling = np.clip(u, 0.0, 1.0)
    integrals = 0.5 * rising**2 + falling - 0.5 * falling**2
    integrals[:, 0] -= 0.5  # the first basis function has no rising half
    return integrals / (count - 1)


@dataclass(frozen=True)
class Scale:
    """Scales on which damping forces and priors of an envelope's analysis depend: amplitude at the start and frequency.

    The amplitude is in rad or m, the angular frequency in rad/s. A scale that is unknown or not needed is 1;
    coefficients are then relative to this scale.
    """

    amplitude: float = 1.0
    frequency: float = 1.0


def parameter(p: FreeParameter, score: float, scale: Scale) -> float:
    """Convert a standard normal score to the value of the parameter p of a damping term, in the unit of p.

    If the score is a random number with the distribution N(0, 1), the value has the prior distribution of the
    parameter. The value increases with the score, also for a half-normal prior. scale: amplitude and frequency on which
    the prior depends.
    """
    prior = p.prior(scale.amplitude, scale.frequency)
    if prior.reflected:
        score = float(scipy.special.ndtri(0.5 + 0.5 * scipy.special.ndtr(score)))
    return float(prior.value(np.asarray(score)))


def parameters(term: DampingTerm, scores: tuple[float, ...], scale: Scale) -> dict[str, float]:
    """Convert standard normal scores to a damping term's parameters other than its coefficient, returned by name.

    scores: one standard normal number for each parameter in `term.inferred`, in this order; 0 gives the median of the
    parameter's prior. scale: amplitude and frequency on which the priors depend.
    """
    return {p.name: parameter(p, z, scale) for p, z in zip(term.inferred, scores, strict=True)}


@lru_cache(maxsize=4096)
def log_loss(
    term: DampingTerm, scores: tuple[float, ...] = (), scale: Scale = Scale()
) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that computes ln of the decay rate which a damping term causes at a coefficient of 1.

    The function takes x = ln(A/A_start), any shape, where A is the amplitude and A_start its value at the start. It
    returns ln of the decay rate -d ln A/dt (1/s). It interpolates a table over `LOSS_GRID`, in which very small rates
    are raised to `MIN_RELATIVE_LOSS` times the largest, and extrapolates the rate as a power of A outside.

    Parameters
    ----------
    term
        The damping term.
    scores
        Standard normal numbers that the priors convert to the term's parameters other than its coefficient, in the
        order of `term.inferred`; 0 gives the median of the prior.
    scale
        Amplitude A_start at the start (rad or m) and angular frequency (rad/s).

    Raises
    ------
    InputError
        If the term dissipates no energy, or the energy lost in a cycle is not finite.
    """
    loss = rates_per_unit(term, LOSS_GRID, parameters(term, scores, scale), scale)
    most = float(np.max(loss))
    if not (np.all(np.isfinite(loss)) and most > 0):
        wrong = next((rate for rate in loss if not np.isfinite(rate)), most)
        raise InputError(
            f"damping term {term.name!r}: the energy lost per cycle must be finite and positive, but a decay rate is "
            f"{wrong:g}; correct its kernel or the priors of its parameters"
        )
    least = MIN_RELATIVE_LOSS * most
    log = np.log(np.maximum(loss, least))
    # A cubic spline would overshoot if the loss is zero at some amplitudes; PCHIP (monotonic) does not.
    spline = scipy.interpolate.CubicSpline if loss.min() > least else scipy.interpolate.PchipInterpolator
    table, ends = spline(LOSS_GRID, log), LOSS_GRID[[0, -1]]
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

    term: the damping term. further: values of its parameters other than the coefficient, by name. scale: amplitude
    A_start at the start and angular frequency ω; they also give the term's reference scales (amplitude A_start,
    velocity ωA_start) unless `further` contains these.
    """
    a, omega = scale.amplitude, scale.frequency
    known = {"rest": 0.0, "reference_velocity": a * omega, "reference_amplitude": a, **further}
    amplitudes = a * np.exp(x)
    if not term.inferred and not set(term.given) & set(_REFERENCES):
        return np.array([omega * term.ratio_per_unit(float(at), omega) for at in amplitudes])
    return np.array([term.work(float(at), omega, known) / (2 * np.pi * omega * at**2) for at in amplitudes])


@lru_cache(maxsize=256)
def scales_needed(term: DampingTerm) -> tuple[bool, bool]:
    """Return whether the shape of a damping term's decay rate depends on the amplitude, and whether on the frequency.

    The shape is the decay rate as a function of ln(A/A_start), divided by its largest value. It is compared for
    different amplitudes A_start and frequencies. The priors of the term's other parameters scale with these two, so
    each comparison uses the same points of the priors. If a result is False, this amplitude or frequency need not be
    known.
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
    """Return whether the energy losses of two damping terms are proportional at all amplitudes.

    A record that contains only amplitudes (an envelope) cannot distinguish such terms. A term counts as proportional
    only to itself if it has parameters besides its coefficient, or if `scales_needed` reports that its decay rate, as a
    function of the relative amplitude, changes its shape with the amplitude or the frequency.
    """
    if a.inferred or b.inferred or any(scales_needed(a)) or any(scales_needed(b)):
        return a is b
    x = np.array([-6.0, -4.0, -2.0, -1.0, 0.0])
    first, second = (rates_per_unit(term, x, {}, Scale()) for term in (a, b))
    return bool(np.allclose(first / first[-1], second / second[-1], LOSS_TOLERANCE, 0.0))
