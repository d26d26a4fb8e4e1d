"""Simulate free decays with unusual damping forces, and record the envelopes through their turning points."""

from collections.abc import Callable, Sequence

import numpy as np

from validation.truth.motion import solve_motion
from validation.truth.oscillator import Discrepancy, Oscillator

FREQUENCY = 3.0
"""Frequency of small motions in Hz."""
OMEGA = 2 * np.pi * FREQUENCY
START = 0.2
"""Displacement at the release in rad."""
FLOOR = 1e-3
"""Noise floor as a fraction of the displacement at the release."""
CYCLES = 119.25
"""Number of cycles of a decay."""
Force = Callable[[float, float, float], float]
"""Damping force per unit of inertia, in rad/s², as a function of angle (rad), velocity (rad/s) and its sign."""
# With these coefficients, the amplitude falls by about 20 dB in 40 s.
FORCES: dict[str, Force] = {
    "cubic": lambda x, v, turn: 0.15 * v**3,
    "structural": lambda x, v, turn: 3.2 * abs(x) * turn,
    "power": lambda x, v, turn: 0.11 * abs(v) ** 1.5 * turn,
    "stribeck": lambda x, v, turn: 0.07 * (1 + 3.0 * np.exp(-((v / 1.2) ** 2))) * turn,
    "dry_position": lambda x, v, turn: 0.09 * (1 + 2.0 * (x / START) ** 2) * turn,
    "thinning": lambda x, v, turn: 0.5 * v / (1 + abs(v) / 0.35),
}


def turning_points(force: Force, cycles: float = CYCLES) -> tuple[np.ndarray, np.ndarray]:
    """Solve θ̈ + F(θ, θ̇) + ω²θ = 0 from a release at `START`; return the envelope through the turning points.

    force: the damping force F. cycles: number of cycles; the motion ends at the first turning point after them. Raises
    NoMotionError if the motion sticks before this.

    Returns
    -------
    t, amplitude : (n,) array
        Times in s midway between successive turning points, and half the distance of these points in rad.
    """
    spring = {"stiffness": OMEGA**2, "rest_angle": 0.0}
    oscillator = Oscillator("linear", spring, {}, discrepancy=Discrepancy(damping=force))
    motion = solve_motion(oscillator, START, OMEGA, cycles / FREQUENCY)
    return 0.5 * (motion.turn_times[1:] + motion.turn_times[:-1]), 0.5 * np.abs(np.diff(motion.turns))


def readings(
    force: Force, seed: int | Sequence[int], noise: float = 0.004, cycles: float = CYCLES
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate readings of the envelope of a decay: return times in s and noisy amplitudes in rad, shape (n,) each.

    Parameters
    ----------
    force
        The damping force.
    seed
        Seed of the noise.
    noise
        Relative standard deviation of each reading. A noise floor is added, with a thousandth of the displacement at
        the release (`FLOOR`).
    cycles
        Number of cycles of the decay.
    """
    t, a = turning_points(force, cycles)
    rng = np.random.default_rng(seed)
    floor = FLOOR * START * rng.standard_normal((2, a.size)) / np.sqrt(2)
    return t, np.hypot(a * np.exp(noise * rng.standard_normal(a.size)) + floor[0], floor[1])
