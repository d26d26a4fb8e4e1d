"""The equivalent damping ratio of a motion, from the energy at its turning points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline

from validation.truth.motion import Motion

PER_CYCLE = 24
"""Points of the curve that is kept; cubic interpolation between them adds less than 1e-6."""


@dataclass(frozen=True, eq=False)
class RatioCurve:
    """Equivalent damping ratio by amplitude.

    cycles: cycles since the release, shape (n,), increasing; amplitude: in rad, decreasing; ratio: dimensionless.
    """

    cycles: np.ndarray
    amplitude: np.ndarray
    ratio: np.ndarray

    def __call__(self, amplitude: float) -> float:
        """The ratio when the motion has this amplitude (rad). Raises ValueError outside of the motion's."""
        low, high = float(self.amplitude[-1]), float(self.amplitude[0])
        if not low * (1 - 1e-12) <= amplitude <= high * (1 + 1e-12):
            raise ValueError(
                f"amplitude {amplitude:g} rad is outside of the motion's {low:g} to {high:g} rad"
            )
        curve = CubicSpline(np.log(self.amplitude[::-1]), np.log(self.ratio[::-1]))
        return float(np.exp(curve(np.log(amplitude))))

    def amplitude_at(self, cycles: float) -> float:
        """Amplitude in rad, so many cycles after the release."""
        return float(np.exp(CubicSpline(self.cycles, np.log(self.amplitude))(cycles)))


def ratio_curve(motion: Motion, potential: Callable[[float], float]) -> RatioCurve:
    """Energy lost in a cycle over 4π times the potential energy of the amplitude, along a motion.

    potential: of a displacement from the equilibrium, rad²/s². The count n of cycles is interpolated over the logarithm
    u of the square root of the energy at turning points, on either side for itself, by quintic splines; the loss in a
    cycle is −dS²/dn, so the ratio is −1/(2π n′(u)), averaged over both sides. The amplitude is half the distance
    between the two displacements of that energy. For a linear spring and viscous damping this is ζ/√(ω² − ζ²), for
    Coulomb friction 2μ/(πω²A).
    """
    size = np.log(np.sqrt([potential(x) for x in motion.turns]))
    count = 0.5 * np.arange(size.size)
    sides = [_spline(-size[side::2], count[side::2]) for side in (0, 1)]
    u = np.linspace(-size[1], -size[-2], round(PER_CYCLE * (count[-2] - count[1])) + 1)
    cycles = 0.5 * (sides[0](u) + sides[1](u))
    ratio = 0.25 / np.pi * (1 / sides[0](u, nu=1) + 1 / sides[1](u, nu=1))
    return RatioCurve(cycles, _half_range(potential, np.abs(motion.turns).max())(np.exp(-u)), ratio)


def _spline(fallen: np.ndarray, count: np.ndarray):
    if count.size < 4:
        raise ValueError("the ratio needs four cycles of a motion")
    return make_interp_spline(fallen, count, k=5 if count.size > 5 else 3)


def _half_range(potential: Callable[[float], float], reach: float) -> Callable[[np.ndarray], np.ndarray]:
    """From the square root of the energy (rad/s) to half the distance between the motion's two ends (rad)."""
    grid = 1.5 * reach * np.sin(0.5 * np.pi * np.linspace(-1.0, 1.0, 401))
    size = np.sign(grid) * np.sqrt([potential(x) for x in grid])
    rising = np.flatnonzero(np.diff(size) <= 0)  # beyond a barrier of a softening spring
    low = int(rising[rising < 200].max(initial=-1)) + 1
    high = int(rising[rising >= 200].min(initial=400)) + 1
    end = CubicSpline(size[low:high], grid[low:high])
    return lambda root: 0.5 * (end(root) - end(-root))
