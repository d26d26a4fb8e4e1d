"""Evaluate a solution of the equation of motion between the nodes of the integration (dense output).

Nodes are the ends of the integration steps. Between two nodes the solution is the quintic Hermite polynomial through
value, slope and curvature (first and second time derivative) at both, plus a correction k u³(1 − u)³. Here u is the
fraction of the step. k is chosen such that the curvature in the middle of the step is right.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from bayesdamp.machine import interruptible

inner = njit(fastmath={"contract"}, no_cpython_wrapper=True, no_cfunc_wrapper=True)  # type: ignore[call-overload]
"""Compile a function that only other compiled functions call; without wrappers for Python this takes less time."""


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function by Numba's `njit`, and cache the machine code on disk if a folder is writable.

    Multiplications and additions may be fused (rounded only once).
    """
    try:
        return njit(cache=True, nogil=True, fastmath={"contract"})(function)
    except RuntimeError:  # Numba raises it if both the installation and the home folder are read-only
        return njit(nogil=True, fastmath={"contract"})(function)


@inner
def quintic(before, after, step, order):
    """Return the coefficients of u⁰ to u⁶ in the order-th time derivative (0 to 2) of the solution within one step.

    u: time from the start of the step, as a fraction of its length. before, after: value, slope and curvature (first
    and second time derivative) at the start and at the end of the step, then the factor k of the correction k u³(1 −
    u)³; the k in `after` is not used. step: length of the step in s.
    """
    slope, bend = step * before[1], step * step * before[2]
    d = after[0] - before[0] - slope - 0.5 * bend
    v = step * after[1] - slope - bend
    a = step * step * after[2] - bend
    c2, c3 = 0.5 * bend, 10.0 * d - 4.0 * v + 0.5 * a
    c4, c5 = -15.0 * d + 7.0 * v - a, 6.0 * d - 3.0 * v + 0.5 * a
    k = before[3]
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


@inner
def end_of_step(times, node, t, first):
    """Return the index of the first sample after a given step of the integration.

    times: start of each step and end of the last one, in s, (s,). node: index of the step. t: times of the samples in
    s, increasing. first: index of the first sample in this step. Samples after the last step belong to the last step.
    """
    end = first
    if node == times.size - 2:
        return t.size
    while end < t.size and t[end] <= times[node + 1]:
        end += 1
    return end


@interruptible
@compiled
def at_times(times, states, t, order):
    """Return the order-th time derivative (0 to 2) of the solution of the motion at increasing times t, (n,).

    The result is interpolated between the nodes (ends of the integration steps). times: times of the nodes, (s,).
    states: value, slope and curvature (first and second time derivative) at the nodes, and the factor k of the
    correction k u³(1 − u)³ in the step after each node, where u is the fraction of the step, (s, 4).
    """
    values, first = np.empty(t.size), 0
    for node in range(times.size - 1):
        end = end_of_step(times, node, t, first)
        if end == first:
            continue
        begun, step = times[node], times[node + 1] - times[node]
        c0, c1, c2, c3, c4, c5, c6 = quintic(states[node], states[node + 1], step, order)
        for i in range(first, end):
            u = (t[i] - begun) / step
            values[i] = c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * (c5 + u * c6)))))
        first = end
    return values


@inner
def node_factors(m0, m1, m2, m3, m4, m5, m6, step, order):
    """Return seven factors with which a weighted sum over the samples in one step follows from the values at its ends.

    The sum is Σ weight · (order-th time derivative, 0 to 2, of the solution) over the samples. It equals the sum of
    each factor times its end value. The seven end values are value, slope, curvature (first and second time derivative)
    and correction k (see `quintic`) at the start of the step, then value, slope and curvature at its end.

    m0 to m6: sums over the samples of weight · uⁿ for n = 0 to 6, where u is the time from the start of the step as a
    fraction of its length. step: this length in s.
    """
    if order == 1:
        m0, m1, m2, m3, m4, m5, m6 = 0.0, m0, 2.0 * m1, 3.0 * m2, 4.0 * m3, 5.0 * m4, 6.0 * m5
        m1, m2, m3, m4, m5, m6 = m1 / step, m2 / step, m3 / step, m4 / step, m5 / step, m6 / step
    elif order == 2:
        share = 1.0 / (step * step)
        m0, m1, m2, m3, m4, m5, m6 = (
            0.0, 0.0, 2.0 * m0 * share, 6.0 * m1 * share, 12.0 * m2 * share, 20.0 * m3 * share, 30.0 * m4 * share,
        )  # fmt: skip
    # Factors of d, v, a in `quintic`: value, slope and curvature at the end minus those of the parabola from the start.
    d, v, a = 10.0 * m3 - 15.0 * m4 + 6.0 * m5, -4.0 * m3 + 7.0 * m4 - 3.0 * m5, 0.5 * (m3 + m5) - m4
    return (
        m0 - d, step * (m1 - d - v), step * step * (0.5 * (m2 - d) - v - a), m3 - 3.0 * m4 + 3.0 * m5 - m6,
        d, step * v, step * step * a,
    )  # fmt: skip


@interruptible
@compiled
def slopes_at_times(times, slopes, columns, t, size, order):
    """Return the order-th time derivative (0 to 2) of tangents, averaged over n windows of samples: (n, columns.size).

    A tangent is the derivative of the motion by one parameter. It is interpolated between the nodes (ends of the
    integration steps). times: times of the nodes, (s,). slopes: value, first and second time derivative, and factor k
    (see `quintic`) of all p tangents at the nodes, (s, p, 4). columns: indices of the tangents to evaluate. t:
    increasing times of the samples, `size` for each window, (n × size,). With size 1 the means are the values at t.
    """
    k, share = columns.size, 1.0 / size
    means, c, first = np.zeros((t.size // size, k)), np.zeros((7, k)), 0
    for node in range(times.size - 1):
        end = end_of_step(times, node, t, first)
        if end == first:
            continue
        begun, step = times[node], times[node + 1] - times[node]
        for p in range(k):
            q = columns[p]
            for j in range(4):
                c[j, p] = slopes[node, q, j]
            for j in range(3):
                c[4 + j, p] = slopes[node + 1, q, j]
        while first < end:
            row = first // size
            stop = min(end, (row + 1) * size)
            m0, m1, m2, m3, m4, m5, m6 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(first, stop):
                u = (t[i] - begun) / step
                u2, u3 = u * u, u * u * u
                m0, m1, m2, m3 = m0 + share, m1 + share * u, m2 + share * u2, m3 + share * u3
                m4, m5, m6 = m4 + share * u2 * u2, m5 + share * u2 * u3, m6 + share * u3 * u3
            w0, w1, w2, w3, w4, w5, w6 = node_factors(m0, m1, m2, m3, m4, m5, m6, step, order)
            for p in range(k):
                means[row, p] += (
                    w0 * c[0, p] + w1 * c[1, p] + w2 * c[2, p] + w3 * c[3, p]
                    + w4 * c[4, p] + w5 * c[5, p] + w6 * c[6, p]
                )  # fmt: skip
            first = stop
    return means
