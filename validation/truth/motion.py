"""Solve the motion of a free decay that is released with zero velocity, half a cycle at a time, with SciPy."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from validation.truth.oscillator import Oscillator

RTOL, ATOL = 1e-10, 1e-12
"""Relative and absolute tolerance of the solver. The absolute tolerance is in units of the first amplitude A for the
angle, and of ωA for the velocity, where ω is the angular frequency of small motions."""
HOLDS = 1.05
"""A motion counts as sticking, and is rejected, if the restoring force at a turning point is at most this multiple of
the static friction."""
PERIODS = 3.0
"""Longest half cycle, in periods of small motions. A motion with a longer one counts as creeping or unbounded, and is
rejected."""


class NoMotionError(Exception):
    """Raised if the motion sticks, creeps (too slow to turn) or escapes (is unbounded) before the end of the record."""


@dataclass(frozen=True, eq=False)
class Motion:
    """The solved motion of a free decay.

    Attributes
    ----------
    turn_times, turns : (m,) arrays
        Times in s since the release, and displacements in rad, of the turning points. The release is the first of them.
    equilibrium : float
        The equilibrium angle in rad.
    pieces : tuple of callable
        For each pair of successive turning points, the function that returns angles and velocities, (2, n), at times
        (n,) between them.
    """

    turn_times: np.ndarray
    turns: np.ndarray
    equilibrium: float
    pieces: tuple[Callable[[np.ndarray], np.ndarray], ...]

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return angles (rad) and velocities (rad/s) at increasing times (n,) in s since the release.

        Raises ValueError for times after the last turning point.
        """
        state = np.empty((2, times.size))
        cuts = np.searchsorted(times, self.turn_times[1:], side="right")
        first = 0
        for piece, last in zip(self.pieces, cuts, strict=True):
            if last > first:
                state[:, first:last] = piece(times[first:last])
            first = last
        if first < times.size:
            raise ValueError("some times are after the last turning point, up to which the motion was solved")
        return state[0], state[1]

    def displacements(self, times: np.ndarray) -> np.ndarray:
        """Return displacements from the equilibrium (rad) at increasing times (n,) in s since the release."""
        return self.at(times)[0] - self.equilibrium


def solve_motion(oscillator: Oscillator, displacement: float, frequency: float, duration: float) -> Motion:
    """Solve the motion from a release with zero velocity to the first turning point after the duration.

    Parameters
    ----------
    oscillator : Oscillator
        The law of motion.
    displacement : float
        Displacement from the equilibrium at the release, rad.
    frequency : float
        Frequency of small motions, rad/s.
    duration : float
        Duration of the motion in s.

    Raises
    ------
    NoMotionError
        The motion sticks, creeps or escapes before the duration has passed.
    """
    zero, acceleration = oscillator.equilibrium(), oscillator.acceleration()
    atol = ATOL * abs(displacement) * np.array([1.0, frequency])
    longest = PERIODS * 2 * np.pi / frequency
    t, theta = 0.0, zero + displacement
    times, turns, pieces = [t], [displacement], []
    while t <= duration:
        pull = acceleration(t, theta, 0.0, 0.0)
        if abs(pull) <= HOLDS * oscillator.static_friction(theta - zero):
            raise NoMotionError("the motion sticks")
        sign = float(np.sign(pull))

        def slope(t: float, state: np.ndarray, sign: float = sign) -> tuple[float, float]:
            theta, v = state.tolist()
            return v, acceleration(t, theta, v, sign)

        def turn(_: float, state: np.ndarray, sign: float = sign) -> float:
            return sign * state[1]

        turn.terminal, turn.direction = True, -1  # pyright: ignore[reportFunctionMemberAccess]
        piece = solve_ivp(
            slope, (t, t + longest), [theta, 0.0], method="DOP853", rtol=RTOL, atol=atol, events=turn,
            dense_output=True,
        )  # fmt: skip
        if piece.status != 1:
            raise NoMotionError("the motion creeps or escapes")
        t, theta = float(piece.t[-1]), float(piece.y[0, -1])
        if (theta - zero) * turns[-1] >= 0:
            raise NoMotionError("the motion sticks")
        times.append(t)
        turns.append(theta - zero)
        pieces.append(piece.sol)
    return Motion(np.array(times), np.array(turns), zero, tuple(pieces))
