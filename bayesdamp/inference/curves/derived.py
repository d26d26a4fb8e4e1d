"""Quantities that follow from a posterior's draws: one class each, in `QUANTITIES`.

| name | unit | what |
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

E and ΔE are those of the undamped motion at an amplitude and of the damping force's work along it, by quadrature
with the model's own restoring law. Amplitudes follow dA/dn = −ΔE/(dE/dA) a cycle n (averaging to first order; of a
linear oscillator with viscous damping the half-life is exact, the decrement within half the ratio squared).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayesdamp.physics.arrays import slope_of
from bayesdamp.physics.orbit import Cycle, cycle, rest_position
from bayesdamp.physics.oscillator import Oscillator

SLOW = 1e-170
"""A velocity, rad/s, whose square is zero in double precision: what is not linear at rest has no slope there."""
CURVE_DRAWS = 1000
"""Draws behind a band over amplitudes: its edges are good to a tenth of an sd."""
_HALVING = np.polynomial.legendre.leggauss(6)


@dataclass(frozen=True)
class Motions:
    """The motions that draws stand for.

    values: every parameter of the oscillator, scalars or arrays of one shape; near: where the equilibrium is looked
    for, amplitude: the reference amplitude (both rad or m); inertia in kg m² (kg), None where it is not known.
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
        """Of the draws."""
        return next(iter(self._numbers.values())).shape

    @cached_property
    def _rest(self) -> np.ndarray:
        """The equilibria, rad or m."""
        return rest_position(self.osc, self._numbers, self.near)

    @cached_property
    def frequency(self) -> np.ndarray:
        """ω_n in rad/s; nan where there is no stable equilibrium."""
        with np.errstate(invalid="ignore"):
            return np.sqrt(self.osc.law.slope(self._rest, self._numbers))

    @cached_property
    def slopes(self) -> np.ndarray:
        """F′_damp at the equilibrium in 1/s, of the terms that do not switch."""
        smooth = [t for t in self.osc.terms if not t.switches]
        p = self.osc.settled(self._numbers)

        def force(v: np.ndarray) -> np.ndarray:
            parts = (p[t.parameter] * t.force(self._rest, v, 1.0, *(p[n] for n in t.further)) for t in smooth)
            return np.asarray(sum(parts, np.zeros(self.shape)))

        return slope_of(force, np.zeros(self.shape), SLOW)

    def at(self, amplitude: np.ndarray | float) -> Cycle:
        """The cycle at an amplitude, one for all or one for each draw."""
        return cycle(
            self.osc, self._numbers, np.broadcast_to(np.asarray(amplitude, float), self.shape), self.near
        )

    @cached_property
    def cycle(self) -> Cycle:
        """The cycle at the reference amplitude."""
        return self.at(self.amplitude)

    def coefficient(self, name: str) -> np.ndarray | None:
        """A coefficient times the inertia; None where one of the two is not there."""
        if self.inertia is None or name not in self.osc.coefficients:
            return None
        return self.inertia * np.broadcast_to(np.asarray(self.values[name], float), self.shape)


class Quantity(ABC):
    """One derived quantity. angular, linear: its unit for an angle in rad and for a displacement in m."""

    name: str
    angular: str
    linear: str

    @abstractmethod
    def of(self, motions: Motions) -> np.ndarray | None:
        """Its value for each draw; None where the model or what is known has no such thing."""

    def unit(self, displacement: str) -> str:
        """Its unit where displacements are in rad or in m."""
        return self.angular if displacement == "rad" else self.linear


class NaturalFrequency(Quantity):
    """ω_n = √F′_rest at the equilibrium."""

    name, angular, linear = "natural_frequency", "rad/s", "rad/s"

    def of(self, motions: Motions) -> np.ndarray:
        """ω_n in rad/s; nan where there is no stable equilibrium."""
        return motions.frequency


class DampingRatio(Quantity):
    """ζ = F′_damp/(2ω_n) at the equilibrium, of the terms that are linear there."""

    name, angular, linear = "damping_ratio", "1", "1"

    def of(self, motions: Motions) -> np.ndarray | None:
        """ζ; None where no term is linear at rest."""
        if all(t.switches for t in motions.osc.terms):
            return None
        slopes = motions.slopes
        return slopes / (2.0 * motions.frequency) if np.any(slopes) else None


class QualityFactor(Quantity):
    """Q = 1/(2ζ)."""

    name, angular, linear = "quality_factor", "1", "1"

    def of(self, motions: Motions) -> np.ndarray | None:
        """Q; None where there is no damping ratio at rest."""
        ratio = DampingRatio().of(motions)
        return None if ratio is None else 0.5 / ratio


class EquivalentRatio(Quantity):
    """ΔE/(4πE) of a cycle at the reference amplitude."""

    name, angular, linear = "equivalent_ratio", "1", "1"

    def of(self, motions: Motions) -> np.ndarray:
        """The ratio of the cycle at the reference amplitude."""
        return _ratio(motions.cycle)


class LogDecrement(Quantity):
    """Fall of ln A in a cycle at the reference amplitude."""

    name, angular, linear = "log_decrement", "1", "1"

    def of(self, motions: Motions) -> np.ndarray:
        """ΔE/(A dE/dA) at the reference amplitude."""
        return _decrement(motions.cycle, motions.amplitude)


class HalfLife(Quantity):
    """Time in which the amplitude halves from the reference amplitude."""

    name, angular, linear = "half_life", "s", "s"

    def of(self, motions: Motions) -> np.ndarray:
        """∫ T/δ d ln A from half the amplitude to it, in s, by Gauss and Legendre's rule."""
        time = np.zeros(motions.shape)
        for x, w in zip(*_HALVING, strict=True):
            a = motions.amplitude * 2.0 ** (-0.5 * (x + 1.0))
            at = motions.at(a)
            time += 0.5 * np.log(2.0) * w * a * np.asarray(at.period * at.slope / at.lost)
        return time


class EnergyFraction(Quantity):
    """ΔE/E of a cycle at the reference amplitude."""

    name, angular, linear = "energy_fraction", "1", "1"

    def of(self, motions: Motions) -> np.ndarray:
        """Energy lost over energy, of the cycle at the reference amplitude."""
        return np.asarray(motions.cycle.lost / motions.cycle.energy)


class EnergyLost(Quantity):
    """Inertia · ΔE of a cycle at the reference amplitude."""

    name, angular, linear = "energy_lost", "J", "J"

    def of(self, motions: Motions) -> np.ndarray | None:
        """In J; None where the inertia is not known."""
        return None if motions.inertia is None else motions.inertia * np.asarray(motions.cycle.lost)


class ViscousCoefficient(Quantity):
    """c = 2ζ · inertia."""

    name, angular, linear = "viscous_coefficient", "N m s", "N s/m"

    def of(self, motions: Motions) -> np.ndarray | None:
        """In N m s, or N s/m; None without inertia or viscous damping."""
        found = motions.coefficient("zeta")
        return None if found is None else 2.0 * found


class CoulombTorque(Quantity):
    """μ_c · inertia."""

    name, angular, linear = "coulomb_torque", "N m", "N"

    def of(self, motions: Motions) -> np.ndarray | None:
        """In N m, or N; None without inertia or friction."""
        return motions.coefficient("mu_c")


class QuadraticCoefficient(Quantity):
    """μ_q · inertia."""

    name, angular, linear = "quadratic_coefficient", "N m s²", "N s²/m²"

    def of(self, motions: Motions) -> np.ndarray | None:
        """In N m s², or N s²/m²; None without inertia or quadratic damping."""
        return motions.coefficient("mu_q")


QUANTITIES: tuple[Quantity, ...] = (
    NaturalFrequency(),
    DampingRatio(),
    QualityFactor(),
    EquivalentRatio(),
    LogDecrement(),
    HalfLife(),
    EnergyFraction(),
    EnergyLost(),
    ViscousCoefficient(),
    CoulombTorque(),
    QuadraticCoefficient(),
)


def derive(motions: Motions) -> dict[str, np.ndarray]:
    """Every derived quantity that the model has, of the draws' shape; nan or infinite where a draw has none.

    The natural frequency is left out where no draw changes it.
    """
    found = {q.name: q.of(motions) for q in QUANTITIES}
    fixed = all(np.ndim(motions.values[n]) == 0 for n in motions.osc.law.parameters)
    return {n: v for n, v in found.items() if v is not None and not (fixed and n == "natural_frequency")}


def units(displacement: str) -> dict[str, str]:
    """Unit of each derived quantity where displacements are in rad or in m."""
    return {q.name: q.unit(displacement) for q in QUANTITIES}


def against_amplitude(
    motions: Motions, amplitudes: np.ndarray, levels: Sequence[float] = (0.025, 0.5, 0.975)
) -> dict[str, np.ndarray]:
    """Quantiles of the logarithmic decrement and of the equivalent ratio at amplitudes (rad or m, shape (m,)): name to
    a row for each level, shape (levels, m), the median and central 95 % by default. From some 1,000 of the draws."""
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
    return np.asarray(at.lost / (4.0 * np.pi * at.energy))


def _decrement(at: Cycle, amplitude: np.ndarray | float) -> np.ndarray:
    return np.asarray(at.lost / (amplitude * at.slope))
