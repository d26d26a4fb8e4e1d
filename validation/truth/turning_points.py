"""Simulate free decays of oscillators with SciPy, and record the envelopes through their turning points."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import solve_ivp

FREQUENCY = 3.0
"""Frequency of small motions in Hz."""
OMEGA = 2 * np.pi * FREQUENCY
START = 0.2
"""Displacement at the release in rad."""
SHARP = 1e-4
"""Width of the velocity in rad/s within which the smoothed friction changes its sign."""
FLOOR = 1e-3
"""Noise floor as a fraction of the displacement at the release."""
Force = Callable[[float, float], float]
"""Damping acceleration in rad/s² of angle (rad) and velocity (rad/s)."""


def _sign(v: float) -> float:
    return float(np.tanh(v / SHARP))


# The coefficients give decays by about 20 dB in 40 s.
FORCES: dict[str, Force] = {
    "viscous": lambda x, v: 2 * 0.06 * v,
    "coulomb": lambda x, v: 0.13 * _sign(v),
    "quadratic": lambda x, v: 0.11 * v * abs(v),
    "cubic": lambda x, v: 0.15 * v**3,
    "displacement": lambda x, v: 150.0 * x * x * v,
    "structural": lambda x, v: 3.2 * abs(x) * _sign(v),
    "power": lambda x, v: 0.11 * abs(v) ** 1.5 * np.sign(v),
    "stribeck": lambda x, v: 0.07 * (1 + 3.0 * np.exp(-((v / 1.2) ** 2))) * _sign(v),
    "dry_position": lambda x, v: 0.09 * (1 + 2.0 * (x / START) ** 2) * _sign(v),
    "thinning": lambda x, v: 0.5 * v / (1 + abs(v) / 0.35),
}


def turning_points(force: Force, cycles: int = 120, least: float = 0.04) -> tuple[np.ndarray, np.ndarray]:
    """Solve θ̈ + F(θ, θ̇) + ω²θ = 0, released at `START`, and return the envelope through the turning points.

    The solution ends when the amplitude is below `least` times `START`, or after this number of cycles.

    Returns
    -------
    t, amplitude : (n,) array
        Times in s midway between successive turning points, and half the distance of these points in rad.
    """
    result = solve_ivp(
        lambda t, y: [y[1], -(OMEGA**2) * y[0] - force(y[0], y[1])], (0.0, 2 * np.pi / OMEGA * cycles), [START, 0.0],
        method="LSODA", rtol=1e-8, atol=1e-10, events=lambda t, y: y[1], max_step=0.03,
    )  # fmt: skip
    t, x = result.t_events[0], result.y_events[0][:, 0]
    middle, sizes = 0.5 * (t[1:] + t[:-1]), 0.5 * np.abs(np.diff(x))
    rested = np.flatnonzero(sizes < least * START)
    stop = int(rested[0]) if rested.size else sizes.size
    return middle[:stop], sizes[:stop]


def readings(force: Force, seed: int | Sequence[int], noise: float = 0.004) -> tuple[np.ndarray, np.ndarray]:
    """Return times in s and noisy amplitudes in rad of the envelope of a decay, shape (n,) each.

    Parameters
    ----------
    force
        The damping force.
    seed
        Seed of the noise.
    noise
        Relative standard deviation of each reading, in addition to a noise floor of a thousandth of the start.
    """
    t, a = turning_points(force)
    rng = np.random.default_rng(seed)
    floor = FLOOR * START * rng.standard_normal((2, a.size)) / np.sqrt(2)
    return t, np.hypot(a * np.exp(noise * rng.standard_normal(a.size)) + floor[0], floor[1])
