"""Dense output: quintic Hermite polynomials between nodes, with a correction half way.

Value, slope and curvature are known at the nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """`njit`, the machine code kept on disk where there is a folder that can be written.

    A product and a sum may be rounded at once.
    """
    try:
        return njit(cache=True, nogil=True, fastmath={"contract"})(function)
    except RuntimeError:  # Numba's, of an installation and a home that are both read-only
        return njit(nogil=True, fastmath={"contract"})(function)


@compiled
def quintic(before, after, step, order):
    """Return coefficients of the order-th derivative (0 to 2) of a step's polynomial.

    They belong to powers 0 to 6 of the share of the step (s). The polynomial has these values, slopes and curvatures,
    (3,), at both ends, and the correction of a fourth number.
    """
    slope, bend = step * before[1], step * step * before[2]
    d = after[0] - before[0] - slope - 0.5 * bend
    v = step * after[1] - slope - bend
    a = step * step * after[2] - bend
    c2, c3, c4, c5 = (
        0.5 * bend,
        10.0 * d - 4.0 * v + 0.5 * a,
        -15.0 * d + 7.0 * v - a,
        6.0 * d - 3.0 * v + 0.5 * a,
    )
    k = before[3] if before.size > 3 else 0.0  # times u³(1 − u)³
    c3, c4, c5, c6 = c3 + k, c4 - 3.0 * k, c5 + 3.0 * k, -k
    if order == 0:
        return before[0], slope, c2, c3, c4, c5, c6
    if order == 1:
        share = 1.0 / step
        return (
            before[1], 2.0 * c2 * share, 3.0 * c3 * share, 4.0 * c4 * share, 5.0 * c5 * share, 6.0 * c6 * share, 0.0,
        )  # fmt: skip
    share = 1.0 / (step * step)
    return before[2], 6.0 * c3 * share, 12.0 * c4 * share, 20.0 * c5 * share, 30.0 * c6 * share, 0.0, 0.0


@compiled
def last_within(times, node, t, first):
    """One past the last of t, rising, from `first` on, that the step from a node takes."""
    end = first
    if node == times.size - 2:
        return t.size
    while end < t.size and t[end] <= times[node + 1]:
        end += 1
    return end


@compiled
def at_times(times, states, t, order):
    """Evaluate the order-th derivative (0 to 2) at rising times t, (n,), of states (s, 3 or 4) at nodes (s,)."""
    values, first = np.empty(t.size), 0
    for node in range(times.size - 1):
        end = last_within(times, node, t, first)
        if end == first:
            continue
        begun, step = times[node], times[node + 1] - times[node]
        c0, c1, c2, c3, c4, c5, c6 = quintic(states[node], states[node + 1], step, order)
        for i in range(first, end):
            u = (t[i] - begun) / step
            values[i] = c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * (c5 + u * c6)))))
        first = end
    return values


@compiled
def parts(m0, m1, m2, m3, m4, m5, m6, step, order):
    """Return the weights of a step's node values in a weighted sum over samples.

    The sum is over the order-th derivative of the step's polynomial. The node values are value, slope, curvature and
    correction where the step (s) begins, and the first three where it ends. m0 to m6: sums of weights times powers of
    the samples' shares of the step.
    """
    if order == 1:
        m0, m1, m2, m3, m4, m5, m6 = 0.0, m0, 2.0 * m1, 3.0 * m2, 4.0 * m3, 5.0 * m4, 6.0 * m5
        m1, m2, m3, m4, m5, m6 = m1 / step, m2 / step, m3 / step, m4 / step, m5 / step, m6 / step
    elif order == 2:
        share = 1.0 / (step * step)
        m0, m1, m2, m3, m4, m5, m6 = (
            0.0, 0.0, 2.0 * m0 * share, 6.0 * m1 * share, 12.0 * m2 * share, 20.0 * m3 * share, 30.0 * m4 * share,
        )  # fmt: skip
    # Of what the ends have beyond the parabola through the beginning: value, slope and curvature, as in `quintic`.
    d, v, a = 10.0 * m3 - 15.0 * m4 + 6.0 * m5, -4.0 * m3 + 7.0 * m4 - 3.0 * m5, 0.5 * (m3 + m5) - m4
    return (
        m0 - d, step * (m1 - d - v), step * step * (0.5 * (m2 - d) - v - a), m3 - 3.0 * m4 + 3.0 * m5 - m6,
        d, step * v, step * step * a,
    )  # fmt: skip


@compiled
def slopes_at_times(times, slopes, columns, t, order):
    """`at_times` of some of the tangents, slopes (s, k, 3 or 4): shape (n, columns.size)."""
    k, four = columns.size, slopes.shape[2] > 3
    values, c, first = np.empty((t.size, k)), np.zeros((7, k)), 0
    for node in range(times.size - 1):
        end = last_within(times, node, t, first)
        if end == first:
            continue
        begun, step = times[node], times[node + 1] - times[node]
        for p in range(k):
            q = columns[p]
            for j in range(3):
                c[j, p], c[4 + j, p] = slopes[node, q, j], slopes[node + 1, q, j]
            if four:
                c[3, p] = slopes[node, q, 3]
        for i in range(first, end):
            u = (t[i] - begun) / step
            u2, u3 = u * u, u * u * u
            w0, w1, w2, w3, w4, w5, w6 = parts(1.0, u, u2, u3, u2 * u2, u2 * u3, u3 * u3, step, order)
            for p in range(k):
                values[i, p] = (
                    w0 * c[0, p] + w1 * c[1, p] + w2 * c[2, p] + w3 * c[3, p]
                    + w4 * c[4, p] + w5 * c[5, p] + w6 * c[6, p]
                )  # fmt: skip
        first = end
    return values
