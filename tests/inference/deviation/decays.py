"""Free decays of an oscillator with a linear spring, by SciPy."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

W, A = 4.5, 0.3
"""rad/s and rad."""


def decay(force: Callable[[float, float, float], float], times: np.ndarray) -> np.ndarray:
    """Return displacement and velocity, (2, n), of ẍ + force(t, x, ẋ) + W²x = 0 from rest at A."""
    return solve_ivp(
        lambda t, s: [s[1], -force(t, s[0], s[1]) - W**2 * s[0]], (0, times[-1]), [A, 0.0], t_eval=times,
        rtol=1e-10, atol=1e-12, max_step=0.05,
    ).y  # fmt: skip
