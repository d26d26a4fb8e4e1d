"""Compute trajectories of the candidate laws fast, by compiled fourth-order Runge-Kutta with fixed steps.

Only fits use them, in `rivals` and in the script of the contest; the truth of a record comes from `motion`. A step in
which the velocity changes sign is divided at that point, found by a secant search. So the order is four also for
friction with an exact sign.
"""

import math

import numpy as np
from numba import njit

ROOT_STEPS = 12
"""Largest number of secant steps to the turning point within a step of the solver."""


@njit(cache=True)
def _force(law: int, theta: float, law_values: np.ndarray) -> float:
    k, rest, other = law_values[0], law_values[1], law_values[2]
    x = theta - rest
    if law == 0:
        return k * x - other * math.cos(theta)
    if law == 1:
        return k * x
    if law == 2:
        return k * math.sin(x)
    return k * x + other * x * x * x


@njit(cache=True)
def _acceleration(law: int, theta: float, v: float, sign: float, law_values: np.ndarray, damping: np.ndarray):
    loss = 2 * damping[0] * v + sign * (damping[1] + damping[2] * v * v)
    return -_force(law, theta, law_values) - loss


@njit(cache=True)
def _step(
    law: int, theta: float, v: float, sign: float, law_values: np.ndarray, damping: np.ndarray, h: float
):
    a1 = _acceleration(law, theta, v, sign, law_values, damping)
    v2 = v + 0.5 * h * a1
    a2 = _acceleration(law, theta + 0.5 * h * v, v2, sign, law_values, damping)
    v3 = v + 0.5 * h * a2
    a3 = _acceleration(law, theta + 0.5 * h * v2, v3, sign, law_values, damping)
    v4 = v + h * a3
    a4 = _acceleration(law, theta + h * v3, v4, sign, law_values, damping)
    return theta + h * (v + 2 * v2 + 2 * v3 + v4) / 6, v + h * (a1 + 2 * a2 + 2 * a3 + a4) / 6


@njit(cache=True)
def advance(
    law: int, theta: float, v: float, sign: float, law_values: np.ndarray, damping: np.ndarray, h: float
):
    """Return angle, velocity and its sign one step of size h (s) later; the sign is 0 after the motion has stopped."""
    left = h
    for _ in range(4):  # one turning point in a step, or more just before the motion stops
        new_theta, new_v = _step(law, theta, v, sign, law_values, damping, left)
        if sign * new_v >= 0:
            return new_theta, new_v, sign
        low, high, v_low, v_high = 0.0, left, v, new_v
        at = 0.0
        for _ in range(ROOT_STEPS):
            at = low + (high - low) * v_low / (v_low - v_high)
            new_theta, new_v = _step(law, theta, v, sign, law_values, damping, at)
            if abs(new_v) <= 1e-13 * (abs(v) + abs(v_high)):
                break
            if sign * new_v > 0:
                low, v_low = at, new_v
                v_high *= 0.5  # the Illinois rule
            else:
                high, v_high = at, new_v
                v_low *= 0.5
        pull = -_force(law, new_theta, law_values)
        theta, v, left = new_theta, 0.0, left - at
        if abs(pull) <= damping[1]:
            return theta, 0.0, 0.0
        sign = 1.0 if pull > 0 else -1.0
    return theta, v, sign


@njit(cache=True)
def trajectory(
    law: int,
    law_values: np.ndarray,
    damping: np.ndarray,
    theta: float,
    v: float,
    h: float,
    within: int,
    out: np.ndarray,
) -> None:
    """Fill an array with the angle (rad) and velocity (rad/s) every `within` steps.

    Parameters
    ----------
    law : int
        Number of the law in `LAWS`.
    law_values : (3,) array
        Parameters of the law, padded with zeros.
    damping : (3,) array
        Coefficients of viscous, Coulomb and quadratic damping.
    theta, v : float
        State at the start, rad and rad/s.
    h : float
        Step, s.
    within : int
        Number of steps between two rows.
    out : (n, 2) array
        Filled with angles and velocities; the first row is the start.
    """
    heading = v if v != 0 else -_force(law, theta, law_values)
    sign = 1.0 if heading > 0 else -1.0
    out[0, 0], out[0, 1] = theta, v
    for i in range(1, out.shape[0]):
        for _ in range(within):
            if sign != 0:
                theta, v, sign = advance(law, theta, v, sign, law_values, damping, h)
        out[i, 0], out[i, 1] = theta, v
