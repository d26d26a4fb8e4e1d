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


@njit
def acceleration(x, v, g, h, coefficients, q, epsilon, active, law, work):
    """θ̈ at one point, under relative deviations g of the damping and h of the frequency."""
    shapes(x, v, epsilon, q, active, work)
    damping = 0.0
    for j in range(coefficients.size):
        damping += coefficients[j] * work[j]
    return -(1.0 + g) * damping - (1.0 + 2.0 * h) * restoring(x, law)


@njit
def linearise(x, v, w, g, h, coefficients, q, epsilon, active, law, sizes, work, other, source):
    """Slopes of the force by x and v at one point; the sources of the tangents go into `source`.

    source: (m + e + r + 4,): coefficients, the terms' further parameters, the law's, and the hats of g and h to the
    left and right of w, the share of the way between two knots.
    """
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
    by_x = 0.0
    shapes(x + dx, v, epsilon, q, active, other)
    for j in range(m):
        by_x += coefficients[j] * other[j]
    shapes(x - dx, v, epsilon, q, active, other)
    for j in range(m):
        by_x -= coefficients[j] * other[j]
    for i in range(e):
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
    x, v, w, step, g, h, coefficients, q, epsilon, active, law, sizes, scratch, sources, local
):
    """The step's fundamental matrix and what its sources add, (2 + s, 2), from its stages x, v, w, (6,)."""
    count = local.shape[0]
    kx, kv = np.zeros((6, count)), np.zeros((6, count))
    for i in range(6):
        by_x, by_v = linearise(
            x[i],
            v[i],
            w[i],
            g[0] + w[i] * (g[1] - g[0]),
            h[0] + w[i] * (h[1] - h[0]),
            coefficients,
            q,
            epsilon,
            active,
            law,
            sizes,
            scratch[0],
            scratch[1],
            sources,
        )
        for p in range(count):
            dx = 1.0 if p == 0 else 0.0
            dv = 1.0 if p == 1 else 0.0
            for j in range(i):
                dx += step * A[i, j] * kx[j, p]
                dv += step * A[i, j] * kv[j, p]
            kx[i, p] = dv
            kv[i, p] = -(by_x * dx + by_v * dv)
            if p >= 2:
                kv[i, p] -= sources[p - 2]
    for p in range(count):
        dx = 1.0 if p == 0 else 0.0
        dv = 1.0 if p == 1 else 0.0
        for i in range(6):
            dx += step * B[i] * kx[i, p]
            dv += step * B[i] * kv[i, p]
        local[p, 0], local[p, 1] = dx, dv


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
    scratch, sources = np.zeros((2, m)), np.zeros(base + 4)
    local = np.zeros((2 + base + (4 if tangents == 2 else 0), 2))
    xs, vs, ws, kx, kv = np.zeros(6), np.zeros(6), np.zeros(6), np.zeros(7), np.zeros(7)
    gs, hs = np.zeros(2), np.zeros(2)
    x, v, t, piece = start[0], start[1], knots[0], 0
    a = acceleration(x, v, g[0], h[0], coefficients, q, epsilon, active, law, scratch[0])
    states[0, 0], states[0, 1], states[0, 2], times[0] = x, v, a, t
    if tangents > 0:
        by_x, by_v = linearise(
            x,
            v,
            0.0,
            g[0],
            h[0],
            coefficients,
            q,
            epsilon,
            active,
            law,
            sizes,
            scratch[0],
            scratch[1],
            sources,
        )
        slopes[0, base, 0], slopes[0, base, 2] = 1.0, -by_x
        slopes[0, base + 1, 1], slopes[0, base + 1, 2] = 1.0, -by_v
        for p in range(base):
            slopes[0, p, 2] = -sources[p]
        if tangents == 2:
            slopes[0, base + 2, 2] = -sources[base]
            slopes[0, base + 2 + n, 2] = -sources[base + 2]
    step = 0.05 * sizes[0] / sizes[1]
    count, tries = 1, 0
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
                kv[i] = acceleration(
                    px,
                    pv,
                    gs[0] + w * (gs[1] - gs[0]),
                    hs[0] + w * (hs[1] - hs[0]),
                    coefficients,
                    q,
                    epsilon,
                    active,
                    law,
                    scratch[0],
                )
        px, pv = x, v
        for i in range(6):
            px += taken * B[i] * kx[i]
            pv += taken * B[i] * kv[i]
        w = ws[5]
        kx[6] = pv
        kv[6] = acceleration(
            px,
            pv,
            gs[0] + w * (gs[1] - gs[0]),
            hs[0] + w * (hs[1] - hs[0]),
            coefficients,
            q,
            epsilon,
            active,
            law,
            scratch[0],
        )
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
        if count == room:
            room *= 2
            more_t, more_s, more_k = np.zeros(room), np.zeros((room, 3)), np.zeros((room, k, 3))
            more_t[:count], more_s[:count], more_k[:count] = times, states, slopes
            times, states, slopes = more_t, more_s, more_k
        if tangents > 0:
            advance_tangents(
                xs,
                vs,
                ws,
                taken,
                gs,
                hs,
                coefficients,
                q,
                epsilon,
                active,
                law,
                sizes,
                scratch,
                sources,
                local,
            )
            by_x, by_v = linearise(
                px,
                pv,
                w,
                gs[0] + w * (gs[1] - gs[0]),
                hs[0] + w * (hs[1] - hs[0]),
                coefficients,
                q,
                epsilon,
                active,
                law,
                sizes,
                scratch[0],
                scratch[1],
                sources,
            )
            old, new = slopes[count - 1], slopes[count]
            first = base + 2 + piece
            for p in range(k):
                new[p, 0] = local[0, 0] * old[p, 0] + local[1, 0] * old[p, 1]
                new[p, 1] = local[0, 1] * old[p, 0] + local[1, 1] * old[p, 1]
            for p in range(base):
                new[p, 0] += local[2 + p, 0]
                new[p, 1] += local[2 + p, 1]
            if tangents == 2:
                for i in range(2):
                    for c in range(2):
                        new[first + i, c] += local[2 + base + i, c]
                        new[first + n + i, c] += local[4 + base + i, c]
            for p in range(k):
                new[p, 2] = -(by_x * new[p, 0] + by_v * new[p, 1])
            for p in range(base):
                new[p, 2] -= sources[p]
            if tangents == 2:
                for i in range(2):
                    new[first + i, 2] -= sources[base + i]
                    new[first + n + i, 2] -= sources[base + 2 + i]
        t = knots[piece + 1] if whole else t + taken
        x, v, a = px, pv, kv[6]
        times[count], states[count, 0], states[count, 1], states[count, 2] = t, x, v, a
        count += 1
        grown = taken * min(5.0, 0.9 * max(error, 1e-10) ** (-0.2))
        step = max(grown, step) if whole else grown
        if whole:
            piece += 1
            if piece == n - 1:
                return times[:count], states[:count], slopes[:count]


# --- end ---
