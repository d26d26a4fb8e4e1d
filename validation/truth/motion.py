"""A free decay from a release at rest, solved by SciPy half a cycle at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from validation.truth.oscillator import Oscillator

RTOL, ATOL = 1e-10, 1e-12
"""Tolerances of the solver; the absolute one is in units of the first amplitude and the frequency."""
HOLDS = 1.05
"""A motion is given up where a turning point is within this multiple of what dry friction can hold."""
PERIODS = 3.0
"""Half a cycle that takes longer than so many periods of small motions has escaped or creeps."""


class NoMotionError(Exception):
    """The motion sticks, creeps or escapes before the record is over."""


@dataclass(frozen=True, eq=False)
class Motion:
    """turn_times, turns: times in s since the release and displacements in rad of the turning points, shape (m,), the
    release first. equilibrium in rad. pieces: the solution between two turning points, in order."""

    turn_times: np.ndarray
    turns: np.ndarray
    equilibrium: float
    pieces: tuple[Callable[[np.ndarray], np.ndarray], ...]

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Angles (rad) and velocities (rad/s) at increasing times (n,) since the release, up to the last turning
        point."""
        state = np.empty((2, times.size))
        cuts = np.searchsorted(times, self.turn_times[1:], side="right")
        first = 0
        for piece, last in zip(self.pieces, cuts, strict=True):
            if last > first:
                state[:, first:last] = piece(times[first:last])
            first = last
        if first < times.size:
            raise ValueError("times beyond the last turning point of the motion")
        return state[0], state[1]

    def displacements(self, times: np.ndarray) -> np.ndarray:
        """Displacements from the equilibrium (rad) at increasing times (n,) since the release."""
        return self.at(times)[0] - self.equilibrium


def solved(oscillator: Oscillator, displacement: float, frequency: float, duration: float) -> Motion:
    """The motion that starts at rest at a displacement (rad) until the first turning point after duration (s).

    frequency: of small motions, rad/s. Raises NoMotionError where it sticks, creeps or escapes before.
    """
    zero, acceleration = oscillator.equilibrium(), oscillator.acceleration()
    atol = ATOL * abs(displacement) * np.array([1.0, frequency])
    longest = PERIODS * 2 * np.pi / frequency
    t, theta = 0.0, zero + displacement
    times, turns, pieces = [t], [displacement], []
    while t <= duration:
        pull = acceleration(t, theta, 0.0, 0.0)
        if abs(pull) <= HOLDS * oscillator.held(theta - zero):
            raise NoMotionError("it sticks")
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
            raise NoMotionError("it creeps or escapes")
        t, theta = float(piece.t[-1]), float(piece.y[0, -1])
        if (theta - zero) * turns[-1] >= 0:
            raise NoMotionError("it sticks")
        times.append(t)
        turns.append(theta - zero)
        pieces.append(piece.sol)
    return Motion(np.array(times), np.array(turns), zero, tuple(pieces))
