"""Quantities derived from a posterior's draws, one for each row of `QUANTITIES`.

| name | unit | meaning |
|---|---|---|
| natural_frequency | rad/s | ω_n = √F′_rest at the equilibrium |
| damping_ratio | 1 | F′_damp/(2ω_n) at the equilibrium, of the terms that are linear there (friction has none) |
| quality_factor | 1 | 1/(2 · damping_ratio) |
| equivalent_ratio | 1 | ΔE/(4πE) of a cycle at the reference amplitude |
| log_decrement | 1 | fall of ln A a cycle at the reference amplitude, ΔE/(A dE/dA) |
| half_life | s | time in which the amplitude halves from the reference amplitude |
| energy_fraction | 1 | ΔE/E of a cycle at the reference amplitude |
| energy_lost | J | inertia · ΔE |
| viscous_coefficient | N m s | inertia · 2ζ (N s/m for a translation) |
| coulomb_torque | N m | inertia · μ_c (N for a translation) |
| quadratic_coefficient | N m s² | inertia · μ_q (N s²/m² for a translation) |

E is the energy of the undamped motion at an amplitude, and ΔE the work of the damping force along it, both by
quadrature with the model's own restoring law. Amplitudes follow dA/dn = −ΔE/(dE/dA) a cycle n (averaging to first
order). For a linear oscillator with viscous damping the half-life is exact, and the decrement right within half the
ratio squared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayesdamp.physics.forces import slope_of
from bayesdamp.physics.orbit import Cycle, cycle, rest_position
from bayesdamp.physics.oscillator import Oscillator

SLOW = 1e-170
"""A velocity in rad/s whose square is zero in double precision, so that only linear terms have a slope there."""
CURVE_DRAWS = 1000
"""Number of draws for a band over amplitudes: its edges are right within a tenth of an sd."""
_HALVING = np.polynomial.legendre.leggauss(6)


@dataclass(frozen=True)
class Motions:
    """The motions of an oscillator under posterior draws of its parameters.

    Attributes
    ----------
    osc : Oscillator
        Its damping terms and restoring law.
    values : mapping of str to float or ndarray
        Every parameter of the oscillator, scalars or arrays of one shape.
    near : float
        Where the search for the equilibrium starts, rad or m.
    amplitude : float
        The reference amplitude, rad or m.
    inertia : float or None
        In kg m² (kg for a displacement), None where it is not known.
    """

    osc: Oscillator
    values: Mapping[str, np.ndarray | float]
    near: float
    amplitude: float
    inertia: float | None = None

    @cached_property
    def _numbers(self) -> dict[str, np.ndarray]:
        names = [n for n in self.osc.inputs if n not in ("theta0", "omega0")]
        return dict(
            zip(names, np.broadcast_arrays(*[np.asarray(self.values[n], float) for n in names]), strict=True)
        )

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the draws."""
        return next(iter(self._numbers.values())).shape

    @cached_property
    def _rest(self) -> np.ndarray:
        """Equilibria, rad or m."""
        return rest_position(self.osc, self._numbers, self.near)

    @cached_property
    def frequency(self) -> np.ndarray:
        """ω_n in rad/s; nan where there is no stable equilibrium."""
        with np.errstate(invalid="ignore"):
            return np.sqrt(self.osc.law.slope(self._rest, self._numbers))

    @cached_property
    def damping_ratio(self) -> np.ndarray | None:
        """F′_damp/(2ω_n) at the equilibrium, of the smooth terms; None where none of them is linear there."""
        smooth = [t for t in self.osc.terms if not t.switches]
        if not smooth:
            return None
        p = self.osc.with_equilibrium(self._numbers)

        def force(v: np.ndarray) -> np.ndarray:
            parts = (p[t.parameter] * t.force(self._rest, v, 1.0, *(p[n] for n in t.further)) for t in smooth)
            return np.asarray(sum(parts, np.zeros(self.shape)))

        slopes = slope_of(force, np.zeros(self.shape), SLOW)
        return slopes / (2.0 * self.frequency) if np.any(slopes) else None

    def at(self, amplitude: np.ndarray | float) -> Cycle:
        """Return the cycle at an amplitude, which may differ between draws."""
        amplitudes = np.broadcast_to(np.asarray(amplitude, float), self.shape)
        return cycle(self.osc, self._numbers, amplitudes, self.near)

    @cached_property
    def cycle(self) -> Cycle:
        """The cycle at the reference amplitude."""
        return self.at(self.amplitude)

    @property
    def half_life(self) -> np.ndarray:
        """∫ T/δ d ln A from half the reference amplitude to it, in s, by Gauss and Legendre's rule."""
        time = np.zeros(self.shape)
        for x, w in zip(*_HALVING, strict=True):
            a = self.amplitude * 2.0 ** (-0.5 * (x + 1.0))
            at = self.at(a)
            time += 0.5 * np.log(2.0) * w * a * np.asarray(at.period * at.energy_slope / at.energy_lost)
        return time

    def coefficient(self, name: str, factor: float = 1.0) -> np.ndarray | None:
        """Return a factor times a coefficient times the inertia; None where one of them is missing."""
        if self.inertia is None or name not in self.osc.coefficients:
            return None
        return factor * (self.inertia * np.broadcast_to(np.asarray(self.values[name], float), self.shape))


@dataclass(frozen=True)
class DerivedQuantity:
    """One derived quantity.

    Attributes
    ----------
    name : str
        As in results.
    angular, linear : str
        Its unit for an angle in rad and for a displacement in m.
    of : callable
        Computes its value for each draw, None where it does not apply.
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
    DerivedQuantity("equivalent_ratio", "1", "1", lambda m: _ratio(m.cycle)),
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


def derive(motions: Motions) -> dict[str, np.ndarray]:
    """Compute every derived quantity that the model has, of the draws' shape; nan or infinite where a draw has none.

    The natural frequency is left out where it is the same for all draws.
    """
    quantities = {q.name: q.of(motions) for q in QUANTITIES}
    fixed = all(np.ndim(motions.values[n]) == 0 for n in motions.osc.law.parameters)
    return {n: v for n, v in quantities.items() if v is not None and not (fixed and n == "natural_frequency")}


def units(displacement: str) -> dict[str, str]:
    """Return the unit of each derived quantity, where displacements are in "rad" or in "m"."""
    return {q.name: q.angular if displacement == "rad" else q.linear for q in QUANTITIES}


def against_amplitude(
    motions: Motions, amplitudes: np.ndarray, levels: Sequence[float] = (0.025, 0.5, 0.975)
) -> dict[str, np.ndarray]:
    """Compute quantiles of the logarithmic decrement and of the equivalent ratio against the amplitude.

    Parameters
    ----------
    motions : Motions
        Draws, of which some 1,000 are used.
    amplitudes : ndarray, shape (m,)
        rad or m.
    levels : sequence of float
        Levels of the quantiles; by default the median and the central 95 %.

    Returns
    -------
    dict of str to ndarray, shape (levels, m)
        By name of the quantity.
    """
    every = max(1, int(np.prod(motions.shape)) // CURVE_DRAWS)
    few = {n: v if np.ndim(v) == 0 else np.ravel(v)[::every] for n, v in motions.values.items()}
    thinned = Motions(motions.osc, few, motions.near, motions.amplitude)
    curves: dict[str, list[np.ndarray]] = {"log_decrement": [], "equivalent_ratio": []}
    for a in amplitudes:
        at = thinned.at(a)
        curves["log_decrement"].append(_decrement(at, a))
        curves["equivalent_ratio"].append(_ratio(at))
    return {n: np.quantile(v, levels, axis=1) for n, v in curves.items()}


def _ratio(at: Cycle) -> np.ndarray:
    return np.asarray(at.energy_lost / (4.0 * np.pi * at.energy))


def _decrement(at: Cycle, amplitude: np.ndarray | float) -> np.ndarray:
    return np.asarray(at.energy_lost / (amplitude * at.energy_slope))
