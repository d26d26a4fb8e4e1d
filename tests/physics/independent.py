"""Motions that do not use the package: SciPy's eighth-order solver with its own equations, and closed forms."""

import math
from collections.abc import Callable, Mapping

import numpy as np
from scipy.integrate import solve_ivp

from validation.truth.oscillator import Oscillator

PAPER = {"zeta": 0.05, "mu_c": 0.03, "mu_q": 0.05}

START = {"theta0": 0.3, "omega0": 0.0, "epsilon": 0.1}
LAWS: dict[str, dict[str, float]] = {
    "horizontal_pendulum": {"stiffness": 20.0, "gravity": 1.0, "spring_angle": 0.0, **START},
    "linear": {"stiffness": 20.0, "rest_angle": 0.05, **START},
    "pendulum": {"stiffness": 20.0, "rest_angle": 0.1, **START, "theta0": 2.0},
    "duffing": {"stiffness": 20.0, "rest_angle": -0.02, "cubic": -60.0, **START},
}
"""Parameters of each law with a clear nonlinearity; those of the horizontal pendulum are from the paper."""


def restoring(law: str, p: Mapping[str, float]) -> Callable[[float], float]:
    """Return the restoring force as a function of the angle, for plain floats."""
    return Oscillator(law, p, {}).force()


def drag(p: Mapping[str, float]) -> Callable[[float, float], float]:
    """Return the damping force of the paper's terms in p as a function of velocity and sign (used if ε = 0)."""
    zeta, mu_c, mu_q = (p.get(n, 0.0) for n in ("zeta", "mu_c", "mu_q"))
    eps = p.get("epsilon", 1.0)

    def force(v: float, sign: float) -> float:
        friction = mu_c * (math.tanh(v / eps) if eps > 0 else sign) if mu_c else 0.0
        return 2 * zeta * v + friction + mu_q * v * abs(v)

    return force


def trajectory(
    law: str,
    p: Mapping[str, float],
    times: np.ndarray,
    force: Callable[[float, float], float] | None = None,
    longest: float = 0.05,
    grip: float | None = None,
) -> np.ndarray:
    """Return θ, θ̇, θ̈ at the times, (n, 3), at a relative tolerance of 1e-11.

    The solver restarts at each turning point, so that no step crosses the kink of θ̇|θ̇| or the jump of a sign. With
    exact friction a body stays at rest if the friction `grip` (mu_c by default) is large enough. longest: largest step
    in s.
    """
    spring, damp = restoring(law, p), force or drag(p)
    if grip is None:
        grip = p.get("mu_c", 0.0) if p.get("epsilon", 1.0) == 0 else 0.0
    out = np.full((times.size, 3), np.nan)
    t, x, v, end = float(times[0]), p["theta0"], p["omega0"], float(times[-1])
    while True:
        pull = -spring(x)
        if v == 0 and abs(pull) <= grip:
            out[times >= t] = x, 0.0, 0.0
            return out
        sign = math.copysign(1.0, v if v != 0 else pull)

        def slope(_, y, sign=sign):
            return y[1], -damp(y[1], sign) - spring(y[0])

        def turns(_, y):
            return y[1]

        turns.terminal, turns.direction = True, -sign
        fine = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13, "max_step": longest}
        run = solve_ivp(slope, (t, end), (x, v), events=turns, dense_output=True, **fine)
        inside = (times >= t) & (times <= run.t[-1])
        state = run.sol(times[inside]) if inside.any() else np.empty((2, 0))
        out[inside, :2] = state.T
        out[inside, 2] = [slope(0.0, y)[1] for y in state.T]
        if run.status != 1:
            return out
        t, x, v = float(run.t[-1]), float(run.y[0, -1]), 0.0


def viscous(t: np.ndarray, zeta: float, omega: float, start: float) -> np.ndarray:
    """Return θ of θ̈ + 2ζθ̇ + ω²θ = 0 from rest at `start`, in closed form."""
    w = math.sqrt(omega**2 - zeta**2)
    return start * np.exp(-zeta * t) * (np.cos(w * t) + zeta / w * np.sin(w * t))


def with_coulomb(p: Mapping[str, float], times: np.ndarray) -> np.ndarray:
    """Return θ, θ̇, θ̈ of a linear spring with exact Coulomb friction in closed form, (n, 3).

    The motion consists of half cosines about centres at a distance of μ_c/k from the rest angle, and ends at rest.
    """
    w = math.sqrt(p["stiffness"])
    out = np.zeros((times.size, 3))
    t, x, v = 0.0, p["theta0"] - p["rest_angle"], p["omega0"]
    while True:
        if v == 0 and p["stiffness"] * abs(x) <= p["mu_c"]:
            out[times >= t] = x + p["rest_angle"], 0.0, 0.0
            return out
        sign = math.copysign(1.0, v) if v else -math.copysign(1.0, x)
        centre = -sign * p["mu_c"] / p["stiffness"]
        size, phase = math.hypot(x - centre, v / w), math.atan2(-v / w, x - centre)
        # The velocity −size·w·sin(wt + phase) vanishes next where wt + phase is a multiple of π.
        first = math.pi * (math.floor(phase / math.pi + 1e-12) + 1) - phase
        end = t + first / w
        inside = (times >= t) & (times <= end)
        angle = w * (times[inside] - t) + phase
        out[inside, 0] = p["rest_angle"] + centre + size * np.cos(angle)
        out[inside, 1] = -size * w * np.sin(angle)
        out[inside, 2] = -size * w**2 * np.cos(angle)
        if end >= times[-1]:
            return out
        t, x, v = end, centre + size * math.cos(first + phase), 0.0
