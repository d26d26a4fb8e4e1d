"""Dense output: quintic Hermite polynomials between nodes of which value, slope and curvature are known."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """`njit`, the machine code kept on disk where there is a folder that can be written."""
    try:
        return njit(cache=True, nogil=True)(function)
    except RuntimeError:  # Numba's, of an installation and a home that are both read-only
        return njit(nogil=True)(function)


@compiled
def weights(u, step, order, out):
    """Weights, into `out` (6,), of value, slope and curvature at the beginning and the end of a step (s).

    For the derivative of that order (0 to 2) at share u of the step: the quintic that has the six numbers.
    """
    u2, u3 = u * u, u * u * u
    u4, u5 = u2 * u2, u2 * u3
    if order == 0:
        out[0] = 1 - 10 * u3 + 15 * u4 - 6 * u5
        out[1] = (u - 6 * u3 + 8 * u4 - 3 * u5) * step
        out[2] = 0.5 * (u2 - 3 * u3 + 3 * u4 - u5) * step * step
        out[3] = 10 * u3 - 15 * u4 + 6 * u5
        out[4] = (-4 * u3 + 7 * u4 - 3 * u5) * step
        out[5] = 0.5 * (u3 - 2 * u4 + u5) * step * step
    elif order == 1:
        out[0] = (-30 * u2 + 60 * u3 - 30 * u4) / step
        out[1] = 1 - 18 * u2 + 32 * u3 - 15 * u4
        out[2] = 0.5 * (2 * u - 9 * u2 + 12 * u3 - 5 * u4) * step
        out[3] = (30 * u2 - 60 * u3 + 30 * u4) / step
        out[4] = -12 * u2 + 28 * u3 - 15 * u4
        out[5] = 0.5 * (3 * u2 - 8 * u3 + 5 * u4) * step
    else:
        out[0] = (-60 * u + 180 * u2 - 120 * u3) / (step * step)
        out[1] = (-36 * u + 96 * u2 - 60 * u3) / step
        out[2] = 0.5 * (2 - 18 * u + 36 * u2 - 20 * u3)
        out[3] = (60 * u - 180 * u2 + 120 * u3) / (step * step)
        out[4] = (-24 * u + 84 * u2 - 60 * u3) / step
        out[5] = 0.5 * (6 * u - 24 * u2 + 20 * u3)


@compiled
def at_times(times, states, t, order):
    """The order-th derivative (0 to 2) at t, (n,), rising, of states (s, 3) at nodes (s,)."""
    found, w = np.zeros(t.size), np.zeros(6)
    node = 0
    for i in range(t.size):
        while node < times.size - 2 and times[node + 1] < t[i]:
            node += 1
        step = times[node + 1] - times[node]
        weights((t[i] - times[node]) / step, step, order, w)
        for j in range(3):
            found[i] += w[j] * states[node, j] + w[3 + j] * states[node + 1, j]
    return found


@compiled
def slopes_at_times(times, slopes, t, order):
    """`at_times` of each tangent, slopes (s, k, 3): shape (n, k)."""
    k = slopes.shape[1]
    found, w = np.zeros((t.size, k)), np.zeros(6)
    node = 0
    for i in range(t.size):
        while node < times.size - 2 and times[node + 1] < t[i]:
            node += 1
        step = times[node + 1] - times[node]
        weights((t[i] - times[node]) / step, step, order, w)
        for p in range(k):
            before, after = slopes[node, p], slopes[node + 1, p]
            found[i, p] = (
                w[0] * before[0]
                + w[1] * before[1]
                + w[2] * before[2]
                + w[3] * after[0]
                + w[4] * after[1]
                + w[5] * after[2]
            )
    return found
