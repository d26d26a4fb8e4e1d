"""Dense output: quintic Hermite polynomials between nodes of which value, slope and curvature are known, and what a
point half way adds to them."""

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
    """Coefficients, of powers 0 to 6 of the share of a step (s), of the order-th derivative (0 to 2) of the polynomial
    that has these values, slopes and curvatures, (3,), at both ends, and
    the correction of a fourth number."""
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
    """The order-th derivative (0 to 2) at t, (n,), rising, of states (s, 3 or 4) at nodes (s,)."""
    found, first = np.empty(t.size), 0
    for node in range(times.size - 1):
        end = last_within(times, node, t, first)
        if end == first:
            continue
        begun, step = times[node], times[node + 1] - times[node]
        c0, c1, c2, c3, c4, c5, c6 = quintic(states[node], states[node + 1], step, order)
        for i in range(first, end):
            u = (t[i] - begun) / step
            found[i] = c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * (c5 + u * c6)))))
        first = end
    return found


@compiled
def slopes_at_times(times, slopes, columns, t, order):
    """`at_times` of some of the tangents, slopes (s, k, 3 or 4): shape (n, columns.size)."""
    k = columns.size
    found, c, first = np.empty((t.size, k)), np.empty((7, k)), 0
    for node in range(times.size - 1):
        end = last_within(times, node, t, first)
        if end == first:
            continue
        begun, step = times[node], times[node + 1] - times[node]
        for p in range(k):
            c[0, p], c[1, p], c[2, p], c[3, p], c[4, p], c[5, p], c[6, p] = quintic(
                slopes[node, columns[p]], slopes[node + 1, columns[p]], step, order
            )
        for i in range(first, end):
            u = (t[i] - begun) / step
            for p in range(k):
                found[i, p] = c[0, p] + u * (
                    c[1, p] + u * (c[2, p] + u * (c[3, p] + u * (c[4, p] + u * (c[5, p] + u * c[6, p]))))
                )
        first = end
    return found
