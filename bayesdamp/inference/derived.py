"""Quantities that are derived from posterior draws.

| name | unit | meaning |
|---|---|---|
| natural_frequency | rad/s | ω_n = √F′_rest at the equilibrium |
| damping_ratio | 1 | F′_damp/(2ω_n) at the equilibrium, of the terms that are linear there (friction has none) |
| quality_factor | 1 | 1/(2 · damping_ratio) |
| equivalent_ratio | 1 | ΔE/(4πE) of a cycle at the reference amplitude |
| log_decrement | 1 | decrease of ln A in a cycle at the reference amplitude, ΔE/(A dE/dA) |
| half_life | s | time in which the amplitude decreases from the reference amplitude to half of it |
| energy_fraction | 1 | ΔE/E of a cycle at the reference amplitude |
| energy_lost | J | inertia · ΔE |
| viscous_coefficient | N m s | inertia · 2ζ (N s/m for a translation) |
| coulomb_torque | N m | inertia · μ_c (N for a translation) |
| quadratic_coefficient | N m s² | inertia · μ_q (N s²/m² for a translation) |

F′_rest is the derivative of the restoring force by the position, F′_damp that of the damping force by the velocity,
both per unit of inertia. E is the energy of the undamped motion at an amplitude, and ΔE the work of the damping force
in a cycle of this motion, both per unit of inertia too, by quadrature with the restoring law of the model. By
first-order averaging, the amplitude changes by −ΔE/(dE/dA) in a cycle. For a linear oscillator with viscous damping the
half-life is exact, and the relative error of the decrement is half the damping ratio squared.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayesdamp.physics.forces import slope_of
from bayesdamp.physics.orbit import Cycle, cycle, rest_position
from bayesdamp.physics.oscillator import Oscillator

SLOW_VELOCITY = 1e-170
"""Step in rad/s of the difference quotient of the damping force at zero velocity. Its square is zero in double
precision, so that only terms that are linear in the velocity have a derivative there."""
_HALVING = np.polynomial.legendre.leggauss(6)
"""Nodes and weights of the 6-point Gauss–Legendre rule on [−1, 1], with which `Motions.half_life` integrates over ln A,
the logarithm of the amplitude."""


@dataclass(frozen=True)
class Motions:
    """Posterior draws of an oscillator's parameters, and the properties of its motion for each draw.

    Attributes
    ----------
    osc : Oscillator
        The oscillator: damping terms and restoring law.
    values : mapping of str to float or ndarray
        Values by name of all parameters of the oscillator, and of the equilibrium and reference scales that its damping
        terms need (`Oscillator.inputs`; theta0 and omega0 are not used): each a scalar, or an array of draws; all
        arrays have the same shape.
    near : float
        Position at which the search for the equilibrium starts, in rad or m.
    amplitude : float
        The reference amplitude, in rad or m, at which properties that depend on the amplitude are computed.
    inertia : float or None
        Moment of inertia in kg m² (mass in kg for a displacement); None if it is not known.
    """

    osc: Oscillator
    values: Mapping[str, np.ndarray | float]
    near: float
    amplitude: float
    inertia: float | None = None

    @cached_property
    def _numbers(self) -> dict[str, np.ndarray]:
        """The values of `Oscillator.inputs` except theta0 and omega0, by name, broadcast to arrays of one shape."""
        names = [n for n in self.osc.inputs if n not in ("theta0", "omega0")]
        arrays = np.broadcast_arrays(*[np.asarray(self.values[n], float) for n in names])
        return dict(zip(names, arrays, strict=True))

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the arrays of draws in `values`; () if all values are scalars."""
        return next(iter(self._numbers.values())).shape

    @cached_property
    def _rest(self) -> np.ndarray:
        """Equilibrium of each draw in rad or m, found by Newton's method from `near`, in the shape of the draws."""
        return rest_position(self.osc, self._numbers, self.near)

    @cached_property
    def frequency(self) -> np.ndarray:
        """The natural frequency ω_n of each draw in rad/s; nan if it has no stable equilibrium."""
        with np.errstate(invalid="ignore"):
            return np.sqrt(self.osc.law.slope(self._rest, self._numbers))

    @cached_property
    def damping_ratio(self) -> np.ndarray | None:
        """The damping ratio of each draw at the equilibrium; None if F′_damp is 0 for all draws, as for dry friction.

        It is F′_damp/(2ω_n), where F′_damp is the derivative of the damping force, per unit of inertia, by the velocity
        at zero velocity, in 1/s. Terms that jump or are steep there (`DampingTerm.switches`) are left out. It is nan if
        there is no stable equilibrium.
        """
        smooth = [t for t in self.osc.terms if not t.switches]
        if not smooth:
            return None
        p = self.osc.with_equilibrium(self._numbers)

        def force(v: np.ndarray) -> np.ndarray:
            parts = (p[t.parameter] * t.force(self._rest, v, 1.0, *(p[n] for n in t.further)) for t in smooth)
            return np.asarray(sum(parts, np.zeros(self.shape)))

        slopes = slope_of(force, np.zeros(self.shape), SLOW_VELOCITY)
        return slopes / (2.0 * self.frequency) if np.any(slopes) else None

    def at(self, amplitude: np.ndarray | float) -> Cycle:
        """Return the undamped cycle of each draw at an amplitude in rad or m, which may be different for each draw.

        Its values are nan where the draw has no such motion.
        """
        amplitudes = np.broadcast_to(np.asarray(amplitude, float), self.shape)
        return cycle(self.osc, self._numbers, amplitudes, self._rest)

    @cached_property
    def cycle(self) -> Cycle:
        """The undamped cycle of each draw at the reference amplitude."""
        return self.at(self.amplitude)

    @property
    def half_life(self) -> np.ndarray:
        """The half-life of each draw in s: the time in which the amplitude falls from the reference to half of it.

        It is ∫ T/δ d ln A over this range, by Gauss–Legendre quadrature. T is the period and δ the logarithmic
        decrement at amplitude A. It is infinite without damping, and nan where there is no such oscillation.
        """
        time = np.zeros(self.shape)
        for x, w in zip(*_HALVING, strict=True):
            a = self.amplitude * 2.0 ** (-0.5 * (x + 1.0))
            at = self.at(a)
            time += 0.5 * np.log(2.0) * w * a * np.asarray(at.period * at.energy_slope / at.energy_lost)
        return time

    def coefficient(self, name: str, factor: float = 1.0) -> np.ndarray | None:
        """Return a damping coefficient in SI units for each draw: factor · inertia · the coefficient `name`.

        name: its parameter, such as "zeta" or "mu_c". factor: a number from the definition, such as 2 for 2ζ. Return
        None if the inertia is not known or the model does not have this coefficient.
        """
        if self.inertia is None or name not in self.osc.coefficients:
            return None
        return factor * (self.inertia * np.broadcast_to(np.asarray(self.values[name], float), self.shape))


@dataclass(frozen=True)
class DerivedQuantity:
    """A quantity that is computed from the parameters of each posterior draw.

    Attributes
    ----------
    name : str
        Name in results.
    angular, linear : str
        Units for an angle in rad and for a displacement in m.
    of : callable
        Function that returns the values for all draws. It returns None if the model has no such quantity.
    """

    name: str
    angular: str
    linear: str
    of: Callable[[Motions], np.ndarray | None]


QUANTITIES = (
    DerivedQuantity("natural_frequency", "rad/s", "rad/s", lambda m: m.frequency),
    DerivedQuantity("damping_ratio", "1", "1", lambda m: m.damping_ratio),
    DerivedQuantity(
        "quality_factor", "1", "1", lambda m: None if m.damping_ratio is None else 0.5 / m.damping_ratio
    ),
    DerivedQuantity("equivalent_ratio", "1", "1", lambda m: equivalent_ratio(m.cycle)),
    DerivedQuantity("log_decrement", "1", "1", lambda m: _decrement(m.cycle, m.amplitude)),
    DerivedQuantity("half_life", "s", "s", lambda m: m.half_life),
    DerivedQuantity("energy_fraction", "1", "1", lambda m: np.asarray(m.cycle.energy_lost / m.cycle.energy)),
    DerivedQuantity(
        "energy_lost",
        "J",
        "J",
        lambda m: None if m.inertia is None else m.inertia * np.asarray(m.cycle.energy_lost),
    ),
    DerivedQuantity("viscous_coefficient", "N m s", "N s/m", lambda m: m.coefficient("zeta", 2.0)),
    DerivedQuantity("coulomb_torque", "N m", "N", lambda m: m.coefficient("mu_c")),
    DerivedQuantity("quadratic_coefficient", "N m s²", "N s²/m²", lambda m: m.coefficient("mu_q")),
)
"""All derived quantities, in the order of the results. The table at the start of this module defines them."""


@np.errstate(divide="ignore")  # the half-life and the quality factor are infinite without damping
def derive_quantities(motions: Motions) -> dict[str, np.ndarray]:
    """Compute the derived quantities that apply to the model: for each name, an array with the values of all draws.

    The names are those in `QUANTITIES`; the function `units` gives the units. Quantities that do not apply to the model
    of `motions` are left out. A value is nan or infinite if the quantity is not defined for that draw. The natural
    frequency is left out if the parameters of the restoring law are scalars, which are the same for all draws.
    """
    quantities = {q.name: q.of(motions) for q in QUANTITIES}
    fixed = all(np.ndim(motions.values[n]) == 0 for n in motions.osc.law.parameters)
    return {n: v for n, v in quantities.items() if v is not None and not (fixed and n == "natural_frequency")}


def units(displacement: str) -> dict[str, str]:
    """Return the unit of each derived quantity by name.

    displacement: "rad" for an angle; any other text for a displacement in m.
    """
    return {q.name: q.angular if displacement == "rad" else q.linear for q in QUANTITIES}


def equivalent_ratio(at: Cycle) -> np.ndarray:
    """Return the equivalent viscous damping ratio ΔE/(4πE) in the cycle of each draw.

    E is the energy of the cycle, ΔE the energy that is lost in it.
    """
    return np.asarray(at.energy_lost / (4.0 * np.pi * at.energy))


def _decrement(at: Cycle, amplitude: np.ndarray | float) -> np.ndarray:
    """Return the logarithmic decrement ΔE/(A dE/dA) for the cycle of each draw.

    amplitude: the amplitude A of the cycle in rad or m. E is the energy at this amplitude, ΔE the energy lost in the
    cycle.
    """
    return np.asarray(at.energy_lost / (amplitude * at.energy_slope))
