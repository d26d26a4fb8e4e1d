"""The template of a kernel: Dormand and Prince's pair of orders 5 and 4 with the variational equations.

`build` puts the forces of an oscillator before this source, and the two are compiled together; here the forces are
stand-ins. Solved is

    θ̈ + (1 + g(t)) Σ c_j shape_j(θ, θ̇) + (1 + 2 h(t)) F_rest(θ) = 0,

g and h piecewise linear between knots. Steps end on knots and at the end. The tangents are carried from step to step
by the step's own fundamental matrix, so that their cost does not grow with the number of knots (J. R. Dormand and
P. J. Prince, J. Comput. Appl. Math. 6, 19 (1980)).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

# --- forces ---

OWNERS = np.array([0], np.int64)
"""Of each further parameter, the term's number."""
BY_POSITION = np.array([False])
"""Of each term, whether its force depends on the position."""
SWITCHES = np.array([False])
"""Of each term, whether its force turns over within ε where the velocity does."""


@njit
def shapes(x, v, epsilon, q, active, out):
    """Forces per unit of the coefficients at one point; q: the terms' further parameters, one after the other."""
    out[:] = 0.0


@njit
def restoring(x, p):
    """Restoring force at one point."""
    return p[0] * x


# --- march ---

A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
    ]
)
B = np.array([35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84])
E = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
C = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0])
EDGE, WIDE, PARTS = 4.0, 3.0, 4.0
"""Velocity, in ε, at which a friction's turning over begins and ends. Where a step would cross it and is more than a
third of what the turning over takes, it ends at the edge, and quarters of the turning over follow: the stages of a long
step see little of it, its estimated error nothing, and what is missed changes by jumps with the parameters (measured:
errors ten to thirty times smaller at 1e-6 of the amplitude, of motions that follow the parameters smoothly)."""


@njit
def acceleration(x, v, w, g, h, coefficients, q, epsilon, active, law, work):
    """θ̈ at one point, under relative deviations g of the damping and h of the frequency: w is the share of the way
    between two knots, where they are g[0] and g[1]."""
    shapes(x, v, epsilon, q, active, work)
    damping = 0.0
    for j in range(coefficients.size):
        damping += coefficients[j] * work[j]
    here, there = g[0] + w * (g[1] - g[0]), h[0] + w * (h[1] - h[0])
    return -(1.0 + here) * damping - (1.0 + 2.0 * there) * restoring(x, law)


@njit
def linearise(x, v, w, g_at, h_at, coefficients, q, epsilon, active, law, sizes, scratch, source):
    """Slopes of the force by x and v at one point; the sources of the tangents go into `source`.

    w, g_at, h_at: as in `acceleration`. source: (m + e + r + 4,): coefficients, the terms' further parameters, the
    law's, and the hats of g and h to the left and right of w.
    """
    g, h = g_at[0] + w * (g_at[1] - g_at[0]), h_at[0] + w * (h_at[1] - h_at[0])
    work, other = scratch[0], scratch[1]
    m, e, r = coefficients.size, q.size, law.size
    shapes(x, v, epsilon, q, active, work)
    damping = 0.0
    for j in range(m):
        source[j] = (1.0 + g) * work[j]
        damping += coefficients[j] * work[j]
    dx, dv = 1e-6 * sizes[0], 1e-6 * sizes[1]
    by_v = 0.0
    shapes(x, v + dv, epsilon, q, active, other)
    for j in range(m):
        by_v += coefficients[j] * other[j]
    shapes(x, v - dv, epsilon, q, active, other)
    for j in range(m):
        by_v -= coefficients[j] * other[j]
    by_x, varies = 0.0, False
    for j in range(m):
        varies = varies or (active[j] and BY_POSITION[j])
    if varies:
        shapes(x + dx, v, epsilon, q, active, other)
        for j in range(m):
            by_x += coefficients[j] * other[j]
        shapes(x - dx, v, epsilon, q, active, other)
        for j in range(m):
            by_x -= coefficients[j] * other[j]
    for i in range(e):
        source[m + i] = 0.0
        if not active[OWNERS[i]]:
            continue
        kept = q[i]
        d = 1e-6 * (abs(kept) + 1e-3)
        q[i] = kept + d
        shapes(x, v, epsilon, q, active, other)
        change = 0.0
        for j in range(m):
            change += coefficients[j] * other[j]
        q[i] = kept - d
        shapes(x, v, epsilon, q, active, other)
        for j in range(m):
            change -= coefficients[j] * other[j]
        q[i] = kept
        source[m + i] = (1.0 + g) * change / (2 * d)
    force = restoring(x, law)
    slope = (restoring(x + dx, law) - restoring(x - dx, law)) / (2 * dx)
    for i in range(r):
        kept = law[i]
        d = 1e-6 * (abs(kept) + sizes[2 + i])
        law[i] = kept + d
        change = restoring(x, law)
        law[i] = kept - d
        change -= restoring(x, law)
        law[i] = kept
        source[m + e + i] = (1.0 + 2.0 * h) * change / (2 * d)
    i = m + e + r
    source[i] = (1.0 - w) * damping
    source[i + 1] = w * damping
    source[i + 2] = 2.0 * (1.0 - w) * force
    source[i + 3] = 2.0 * w * force
    return (1.0 + g) * by_x / (2 * dx) + (1.0 + 2.0 * h) * slope, (1.0 + g) * by_v / (2 * dv)


@njit
def advance_tangents(
    x, v, w, step, g, h, coefficients, q, epsilon, active, law, sizes, scratch, begun, ended, stages, local
):
    """The step's fundamental matrix and what its sources add, (2, 2 + s), from its stages x, v, w, (6,).

    begun, ended: (2 + s,), slopes by x and v and the sources where the step begins, as they are known, and room for
    those of a stage; stages: room, (6, 2, 2 + s).
    """
    count = local.shape[1]
    for i in range(6):
        if i == 0:
            at = begun
        else:
            at = ended
            at[0], at[1] = linearise(
                x[i], v[i], w[i], g, h, coefficients, q, epsilon, active, law, sizes, scratch, at[2:]
            )
        combined(local, stages, A[i], i, step)
        by_x, by_v = at[0], at[1]
        for p in range(count):
            stages[i, 0, p] = local[1, p]
            stages[i, 1, p] = -(by_x * local[0, p] + by_v * local[1, p])
        for p in range(2, count):
            stages[i, 1, p] -= at[p]
    combined(local, stages, B, 6, step)


@njit
def share_until(v, a, new_v, new_a, step, wanted):
    """Share of a step at which the velocity is as wanted, between v and new_v: of the cubic through both ends."""
    low, high, at = 0.0, 1.0, (wanted - v) / (new_v - v)
    for _ in range(30):
        rest = 1.0 - at
        value = (
            rest * rest * ((1.0 + 2.0 * at) * v + at * step * a)
            + at * at * ((3.0 - 2.0 * at) * new_v - rest * step * new_a)
        ) - wanted
        if (value > 0.0) == (v > wanted):
            low = at
        else:
            high = at
        slope = (
            6.0 * at * rest * (new_v - v)
            + rest * (1.0 - 3.0 * at) * step * a
            + at * (3.0 * at - 2.0) * step * new_a
        )
        new = at - value / slope if slope != 0.0 else low
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - at) < 1e-12:
            return new
        at = new
    return at


@njit
def combined(local, stages, shares, number, step):
    """Tangents, (2, 2 + s), after shares of a step along the slopes of the first stages."""
    local[:] = 0.0
    local[0, 0], local[1, 1] = 1.0, 1.0
    for j in range(number):
        share = step * shares[j]
        if share == 0.0:
            continue
        for p in range(local.shape[1]):
            local[0, p] += share * stages[j, 0, p]
            local[1, p] += share * stages[j, 1, p]


@njit(cache=True, nogil=True)
def sums(x, v, weight, epsilon, q, active, out):
    """Weighted sums over points, (n,), of the terms' shapes, (d, m), for rows of further parameters, (d, e)."""
    work = np.zeros(out.shape[1])
    out[:] = 0.0
    for d in range(out.shape[0]):
        for i in range(x.size):
            shapes(x[i], v[i], epsilon, q[d], active, work)
            for j in range(work.size):
                out[d, j] += weight[i] * work[j]


@njit(cache=True, nogil=True)
def march(coefficients, q, active, law, epsilon, start, knots, g, h, tolerance, sizes, tangents, most):
    """Node times (s,), states (s, 3): θ, θ̇, θ̈, and tangents (s, k, 3); the times are empty where it escapes.

    knots: (n,), from the first to the last time, g and h there. tolerance: of a step, as a share of the sizes of θ
    and θ̇ (sizes[:2]; then those of the law's parameters). tangents: 0 none, 1 by the parameters, 2 by g and h too,
    in the order coefficients, further parameters, law, θ₀, θ̇₀, g, h. most: steps at most.
    """
    m, e, r, n = coefficients.size, q.size, law.size, knots.size
    base = m + e + r
    k = 0 if tangents == 0 else base + 2 + (2 * n if tangents == 2 else 0)
    room = 512
    times, states, slopes = np.zeros(room), np.zeros((room, 3)), np.zeros((room, k, 3))
    scratch, begun, ended = np.zeros((2, m)), np.zeros(base + 6), np.zeros(base + 6)
    sources, hats = begun[2:], 2 + base
    local = np.zeros((2, hats + (4 if tangents == 2 else 0)))
    stages = np.zeros((6, 2, local.shape[1]))
    xs, vs, ws, kx, kv = np.zeros(6), np.zeros(6), np.zeros(6), np.zeros(7), np.zeros(7)
    gs, hs = np.zeros(2), np.zeros(2)
    x, v, t, piece = start[0], start[1], knots[0], 0
    gs[0], gs[1], hs[0], hs[1] = g[0], g[1], h[0], h[1]
    a = acceleration(x, v, 0.0, gs, hs, coefficients, q, epsilon, active, law, scratch[0])
    states[0, 0], states[0, 1], states[0, 2], times[0] = x, v, a, t
    if tangents > 0:
        begun[0], begun[1] = linearise(
            x, v, 0.0, gs, hs, coefficients, q, epsilon, active, law, sizes, scratch, sources
        )
        slopes[0, base, 0], slopes[0, base, 2] = 1.0, -begun[0]
        slopes[0, base + 1, 1], slopes[0, base + 1, 2] = 1.0, -begun[1]
        for p in range(base):
            slopes[0, p, 2] = -sources[p]
        if tangents == 2:
            slopes[0, base + 2, 2] = -sources[base]
            slopes[0, base + 2 + n, 2] = -sources[base + 2]
    step = 0.05 * sizes[0] / sizes[1]
    count, tries = 1, 0
    edge, usual = 0.0, 0.0
    for j in range(m):
        if active[j] and SWITCHES[j]:
            edge = EDGE * epsilon
    while True:
        if tries > most:
            return times[:0], states[:0], slopes[:0]
        tries += 1
        left = knots[piece + 1] - t
        whole = step >= left * (1 - 1e-9)
        taken = left if whole else (step if step < 0.5 * left else 0.5 * left)
        width = knots[piece + 1] - knots[piece]
        gs[0], gs[1], hs[0], hs[1] = g[piece], g[piece + 1], h[piece], h[piece + 1]
        kx[0], kv[0] = v, a
        for i in range(6):
            px, pv = x, v
            for j in range(i):
                px += taken * A[i, j] * kx[j]
                pv += taken * A[i, j] * kv[j]
            w = (t - knots[piece] + C[i] * taken) / width
            xs[i], vs[i], ws[i] = px, pv, w
            if i > 0:
                kx[i] = pv
                kv[i] = acceleration(px, pv, w, gs, hs, coefficients, q, epsilon, active, law, scratch[0])
        px, pv = x, v
        for i in range(6):
            px += taken * B[i] * kx[i]
            pv += taken * B[i] * kv[i]
        w = ws[5]
        kx[6] = pv
        kv[6] = acceleration(px, pv, w, gs, hs, coefficients, q, epsilon, active, law, scratch[0])
        ex, ev = 0.0, 0.0
        for i in range(7):
            ex += taken * E[i] * kx[i]
            ev += taken * E[i] * kv[i]
        error = max(abs(ex) / sizes[0], abs(ev) / sizes[1]) / tolerance
        if not math.isfinite(error) or abs(px) > 1e3 * (sizes[0] + abs(start[0])):
            if not math.isfinite(error) and taken > 1e-9 * sizes[0] / sizes[1]:
                step = 0.2 * taken
                continue
            return times[:0], states[:0], slopes[:0]
        if error > 1.0:
            step = taken * max(0.2, 0.9 * error ** (-0.2))
            continue
        sign = 1.0 if v > 0.0 else -1.0
        beyond = v * sign > edge * (1.0 + 1e-9)
        if (
            edge > 0.0
            and beyond
            and pv * sign < edge * (1.0 - 1e-6)
            and 2.0 * edge < WIDE * taken * abs(kv[6])
        ):
            usual, step = taken, taken * share_until(v, a, pv, kv[6], taken, edge * sign)
            continue
        if count == room:
            room *= 2
            more_t, more_s, more_k = np.zeros(room), np.zeros((room, 3)), np.zeros((room, k, 3))
            more_t[:count], more_s[:count], more_k[:count] = times, states, slopes
            times, states, slopes = more_t, more_s, more_k
        if tangents > 0:
            advance_tangents(
                xs, vs, ws, taken, gs, hs, coefficients, q, epsilon, active, law, sizes, scratch, begun, ended,
                stages, local,
            )  # fmt: skip
            begun[0], begun[1] = linearise(
                px, pv, w, gs, hs, coefficients, q, epsilon, active, law, sizes, scratch, sources
            )
            old, new = slopes[count - 1], slopes[count]
            first = base + 2 + piece
            for p in range(k):
                new[p, 0] = local[0, 0] * old[p, 0] + local[0, 1] * old[p, 1]
                new[p, 1] = local[1, 0] * old[p, 0] + local[1, 1] * old[p, 1]
            for p in range(base):
                new[p, 0] += local[0, 2 + p]
                new[p, 1] += local[1, 2 + p]
            if tangents == 2:
                for i in range(2):
                    for c in range(2):
                        new[first + i, c] += local[c, hats + i]
                        new[first + n + i, c] += local[c, hats + 2 + i]
            for p in range(k):
                new[p, 2] = -(begun[0] * new[p, 0] + begun[1] * new[p, 1])
            for p in range(base):
                new[p, 2] -= sources[p]
            if tangents == 2:
                for i in range(2):
                    new[first + i, 2] -= sources[base + i]
                    new[first + n + i, 2] -= sources[base + 2 + i]
            if whole:  # what was the hat on the right is the one on the left of the next knots
                sources[base], sources[base + 1] = sources[base + 1], 0.0
                sources[base + 2], sources[base + 3] = sources[base + 3], 0.0
        t = knots[piece + 1] if whole else t + taken
        x, v, a = px, pv, kv[6]
        times[count], states[count, 0], states[count, 1], states[count, 2] = t, x, v, a
        count += 1
        grown = taken * min(5.0, 0.9 * max(error, 1e-10) ** (-0.2))
        step = max(grown, step) if whole else grown
        if usual > 0.0 and not whole:
            if v * a < edge * abs(a) * (1.0 - 1e-3):  # before the edge on the other side
                step = min(step, 2.0 * edge / abs(a) / PARTS)
            else:
                step, usual = max(usual, step), 0.0
        if whole:
            piece += 1
            if piece == n - 1:
                return times[:count], states[:count], slopes[:count]


# --- end ---
