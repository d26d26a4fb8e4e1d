"""Compute trajectories of oscillators fast, by a compiled fourth-order Runge-Kutta method with fixed steps.

They are used only for fits, in `rivals` and in the script of the contest; the truth of a record comes from `motion`. A
step in which the velocity changes sign is divided at that point, which a secant search finds. Therefore the method is
of fourth order also for friction with an exact sign of the velocity.
"""

import math

import numpy as np
from numba import njit

ROOT_STEPS = 12
"""Largest number of secant steps to the turning point within a step of the solver."""


@njit(cache=True)
def _force(law: int, theta: float, p: np.ndarray) -> float:
    k, rest, other = p[0], p[1], p[2]
    x = theta - rest
    if law == 0:
        return k * x - other * math.cos(theta)
    if law == 1:
        return k * x
    if law == 2:
        return k * math.sin(x)
    return k * x + other * x * x * x


@njit(cache=True)
def _acceleration(law: int, theta: float, v: float, sign: float, p: np.ndarray):
    return -_force(law, theta, p) - (2 * p[3] * v + sign * (p[4] + p[5] * v * v))


@njit(cache=True)
def _step(law: int, theta: float, v: float, sign: float, p: np.ndarray, h: float):
    a1 = _acceleration(law, theta, v, sign, p)
    v2 = v + 0.5 * h * a1
    a2 = _acceleration(law, theta + 0.5 * h * v, v2, sign, p)
    v3 = v + 0.5 * h * a2
    a3 = _acceleration(law, theta + 0.5 * h * v2, v3, sign, p)
    v4 = v + h * a3
    a4 = _acceleration(law, theta + h * v3, v4, sign, p)
    return theta + h * (v + 2 * v2 + 2 * v3 + v4) / 6, v + h * (a1 + 2 * a2 + 2 * a3 + a4) / 6


@njit(cache=True)
def advance(law: int, theta: float, v: float, sign: float, p: np.ndarray, h: float):
    """Return angle, velocity and its sign after a step of size h (s); the sign is 0 after the motion has stopped."""
    left = h
    for _ in range(4):  # a step has one turning point, or more just before the motion stops
        new_theta, new_v = _step(law, theta, v, sign, p, left)
        if sign * new_v >= 0:
            return new_theta, new_v, sign
        low, high, v_low, v_high = 0.0, left, v, new_v
        at = 0.0
        for _ in range(ROOT_STEPS):
            at = low + (high - low) * v_low / (v_low - v_high)
            new_theta, new_v = _step(law, theta, v, sign, p, at)
            if abs(new_v) <= 1e-13 * (abs(v) + abs(v_high)):
                break
            if sign * new_v > 0:
                low, v_low = at, new_v
                v_high *= 0.5  # Illinois rule: faster convergence of the secant search
            else:
                high, v_high = at, new_v
                v_low *= 0.5
        pull = -_force(law, new_theta, p)
        theta, v, left = new_theta, 0.0, left - at
        if abs(pull) <= p[4]:
            return theta, 0.0, 0.0
        sign = 1.0 if pull > 0 else -1.0
    return theta, v, sign


@njit(cache=True)
def trajectory(law: int, p: np.ndarray, theta: float, v: float, h: float, within: int, out: np.ndarray):
    """Solve a motion, and fill the array `out` with angle (rad) and velocity (rad/s) after every `within` steps.

    Parameters
    ----------
    law : int
        Position of the restoring law in `LAWS`.
    p : (6,) array
        Parameters of the restoring law, padded with zeros to three; then coefficients of viscous, Coulomb and quadratic
        damping.
    theta, v : float
        Initial angle in rad and velocity in rad/s.
    h : float
        Step of the solver, s.
    within : int
        Number of steps between two rows of `out`.
    out : (n, 2) array
        Result: a row has angle and velocity; the first row is the initial state.
    """
    heading = v if v != 0 else -_force(law, theta, p)
    sign = 1.0 if heading > 0 else -1.0
    out[0, 0], out[0, 1] = theta, v
    for i in range(1, out.shape[0]):
        for _ in range(within):
            if sign != 0:
                theta, v, sign = advance(law, theta, v, sign, p, h)
        out[i, 0], out[i, 1] = theta, v
