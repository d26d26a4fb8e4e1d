"""Records whose damping drifts along them, made with SciPy's motions."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.integrate import solve_ivp

import bayesdamp as bd

STIFFNESS, NOISE = 20.0, 0.002
TIMES = np.linspace(0.0, 20.0, 160)
KNOTS = np.linspace(0.0, 20.0, 8)
WAVE = np.sin(np.linspace(0.0, 2 * np.pi, KNOTS.size))
STARTS = (0.3, 0.25)
CASES = {"repeats": ((0.05, 0.1), (0.05, -0.1)), "two specimens": ((0.05, 0.0), (0.1, 0.0))}
"""Of each record its damping (1/s), and by how much that rises and falls once over the record."""


def motion(zeta: float, start: float, g: np.ndarray, h: np.ndarray) -> np.ndarray:
    """SciPy's solution with damping times exp(g) and the spring times 1 + 2h; the factors straight between knots."""

    def slope(t: float, s: np.ndarray) -> tuple[float, float]:
        factor = 1 + np.interp(t, KNOTS, np.expm1(g))
        return s[1], -2 * zeta * factor * s[1] - STIFFNESS * (1 + 2 * np.interp(t, KNOTS, h)) * s[0]

    found = solve_ivp(slope, (0, 20), (start, 0.0), t_eval=TIMES, rtol=1e-9, atol=1e-11, max_step=0.2)
    return found.y[0]


@lru_cache
def signals(case: str) -> tuple[bd.Signal, ...]:
    """Both records of a case."""
    rng, nothing = np.random.default_rng(4), np.zeros(KNOTS.size)
    made = [
        motion(zeta, start, size * WAVE, nothing)
        for (zeta, size), start in zip(CASES[case], STARTS, strict=True)
    ]
    return tuple(bd.signal(TIMES, y + NOISE * rng.standard_normal(TIMES.size), cleaned=False) for y in made)
