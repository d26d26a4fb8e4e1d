"""Compute true equivalent damping ratios: along a motion, of an oscillator at an amplitude, and of a damping force."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import quad
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.optimize import root_scalar

from validation.truth.motion import Motion
from validation.truth.oscillator import COEFFICIENTS, Oscillator

PER_CYCLE = 24
"""Number of points of a `RatioCurve` in a cycle; cubic interpolation between these points adds an error below 1e-6."""


@dataclass(frozen=True, eq=False)
class RatioCurve:
    """The equivalent damping ratio as a function of the amplitude.

    Attributes
    ----------
    cycles : (n,) array
        Cycles since the release, increasing.
    amplitude : (n,) array
        Amplitudes in rad, decreasing.
    ratio : (n,) array
        Equivalent damping ratios.
    """

    cycles: np.ndarray
    amplitude: np.ndarray
    ratio: np.ndarray

    def __call__(self, amplitude: float) -> float:
        """Return the ratio at an amplitude (rad). Raises ValueError outside the range of the motion."""
        low, high = float(self.amplitude[-1]), float(self.amplitude[0])
        if not low * (1 - 1e-12) <= amplitude <= high * (1 + 1e-12):
            raise ValueError(
                f"amplitude {amplitude:g} rad is outside the range of the motion, {low:g} to {high:g} rad"
            )
        curve = CubicSpline(np.log(self.amplitude[::-1]), np.log(self.ratio[::-1]))
        return float(np.exp(curve(np.log(amplitude))))

    def amplitude_at(self, cycles: float) -> float:
        """Return the amplitude in rad after a number of cycles since the release."""
        return float(np.exp(CubicSpline(self.cycles, np.log(self.amplitude))(cycles)))


def ratio_curve(motion: Motion, potential: Callable[[float], float]) -> RatioCurve:
    """Return the equivalent damping ratio along a motion, as a function of the amplitude.

    It is the energy lost in a cycle, divided by 4π times the potential energy at the amplitude.

    Method: let S be the square root of the energy at a turning point, u = ln S, and n the number of cycles. Quintic
    splines interpolate n(u), separately for the turning points on each side. The loss in a cycle is −dS²/dn, so the
    ratio is −1/(2π n′(u)), which is averaged over both sides. The amplitude A is half the distance between the two
    displacements with this energy. For a linear spring with the frequency ω, the ratio is ζ/√(ω² − ζ²) with the viscous
    coefficient ζ, and 2μ/(πω²A) with the Coulomb friction μ.

    Parameters
    ----------
    motion : Motion
        The free decay.
    potential : callable
        Potential energy (rad²/s²) at a displacement from the equilibrium (rad).

    Raises
    ------
    ValueError
        The motion has fewer than four cycles.
    """
    size = np.log(np.sqrt([potential(x) for x in motion.turns]))
    count = 0.5 * np.arange(size.size)
    if count.size < 8:
        raise ValueError("the ratio needs four cycles of a motion")
    sides = [
        make_interp_spline(-size[side::2], count[side::2], k=5 if count[side::2].size > 5 else 3)
        for side in (0, 1)
    ]
    u = np.linspace(-size[1], -size[-2], round(PER_CYCLE * (count[-2] - count[1])) + 1)
    cycles = 0.5 * (sides[0](u) + sides[1](u))
    ratio = 0.25 / np.pi * (1 / sides[0](u, nu=1) + 1 / sides[1](u, nu=1))
    return RatioCurve(cycles, _half_range(potential, np.abs(motion.turns).max())(np.exp(-u)), ratio)


def harmonic_ratio(force: Callable[[float, float], float], amplitude: float, frequency: float) -> float:
    """Return the equivalent damping ratio of a damping force for a harmonic motion, by quadrature.

    force: damping force in rad/s², as a function of displacement (rad) and velocity (rad/s). amplitude: in rad.
    frequency: in rad/s.
    """

    def power(phase: float) -> float:
        v = amplitude * frequency * math.sin(phase)
        return force(amplitude * math.cos(phase), v) * v

    lost = sum(quad(power, low, high)[0] for low, high in pairwise(np.linspace(0, 2 * np.pi, 9)))
    return lost / (2 * np.pi * (frequency * amplitude) ** 2 * frequency)


def true_ratio(oscillator: Oscillator, amplitude: float) -> float:
    """Return the equivalent damping ratio of an oscillator at an amplitude, without the damping of its discrepancy.

    It is the energy lost in a cycle, divided by 4π times the potential energy at the turning points. amplitude: half
    the distance between the turning points, in rad.
    """
    potential = oscillator.potential()
    ends = (-0.5 * amplitude, 0.5 * amplitude)
    middle = root_scalar(lambda x: potential(x + amplitude) - potential(x - amplitude), bracket=ends).root
    top = potential(middle + amplitude)
    zeta, friction, drag = (oscillator.damping.get(term, 0.0) for term in COEFFICIENTS)

    def lost(phase: float) -> float:
        v = math.sqrt(2 * max(top - potential(middle + amplitude * math.sin(phase)), 0.0))
        turn = math.tanh(v / oscillator.epsilon) if oscillator.epsilon else 1.0
        return 2 * (2 * zeta * v + friction * turn + drag * v * v) * amplitude * math.cos(phase)

    return float(quad(lost, -0.5 * math.pi, 0.5 * math.pi, limit=200)[0]) / (4 * math.pi * top)


def _half_range(potential: Callable[[float], float], reach: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return the amplitude (rad) as a function of the square root of the energy (rad/s).

    The amplitude is half the distance between the turning points of a motion with this energy. potential: potential
    energy (rad²/s²) at a displacement (rad). reach: largest displacement of the motion, rad.
    """
    grid = 1.5 * reach * np.sin(0.5 * np.pi * np.linspace(-1.0, 1.0, 401))
    size = np.sign(grid) * np.sqrt([potential(x) for x in grid])
    rising = np.flatnonzero(np.diff(size) <= 0)  # beyond the energy barrier of a softening spring
    low = int(rising[rising < 200].max(initial=-1)) + 1
    high = int(rising[rising >= 200].min(initial=400)) + 1
    end = CubicSpline(size[low:high], grid[low:high])
    return lambda root: 0.5 * (end(root) - end(-root))
