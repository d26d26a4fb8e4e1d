"""The template of a kernel's variational equations, which a power series solves.

On a step they are linear, with coefficients that are read along the motion. Before the mark are stand-ins for the
forces of an oscillator, which `build` writes in their place.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from bayesdamp.physics.damping import EXACT, TINY

OWNERS = np.array([0], np.int64)
"""Of each further parameter, the term's number."""
SWITCHES = np.array([False])
"""Of each term, whether its force turns over within ε where the velocity does."""
LAW_SIZES = np.array([1], np.int64)
"""How many parameters each restoring law has."""
JUMPS = np.array([False])
"""Of each term, whether that is a jump where ε is 0, and not a shape that is rounded off."""


@njit
def shapes(x, v, epsilon, rounding, q, active, out):
    """Compute the forces per unit of the coefficients at one point.

    rounding: the ε of terms that are rounded off; q: the terms' further parameters, one after the other.
    """
    out[:] = 0.0


@njit
def damping(x, v, epsilon, rounding, q, c):
    """Compute the force of all terms at one point; a term with coefficient 0 costs nothing."""
    return 0.0


@njit
def damping_slopes(x, v, epsilon, rounding, q, c, active, sizes, share, out):
    """Compute the force of all terms at one point and its slopes by x and v.

    Into `out`, from its third place on, go each term's force per unit and the slopes of the whole by the further
    parameters, times share.
    """
    return 0.0, 0.0, 0.0


@njit
def gathered(coefficients, q, active, law):
    """Return coefficients, further parameters and the law's as tuples, which need no reference counts.

    Coefficients of terms that do not act are 0. Behind the coefficients: 1 where a term acts that is not among the
    first `build.USUAL`, else 0.
    """
    return (coefficients[0],), (0.0,), (law[0], law[1])


@njit
def restoring(x, p):
    """Compute the restoring force at one point. p: the law's parameters, then its number."""
    return p[0] * x


@njit
def restoring_slopes(x, p, sizes, share, out, first):
    """Compute the restoring force at one point and its slope by x.

    Slopes by the law's parameters, times share, go into `out` from `first` on.
    """
    out[first] = share * x
    return p[0] * x, p[0]


# --- tangents ---

POINTS = np.array([0.0, 0.5 - np.sqrt(3 / 28), 0.5, 0.5 + np.sqrt(3 / 28), 1.0])
"""Shares of a step where the coefficients are read: Lobatto's, with which the step's end is right to order eight."""
POWERS = np.linalg.inv(np.vander(POINTS, increasing=True))
WHOLE, HALF = (POWERS.T @ (end ** np.arange(1.0, 6.0) / np.arange(1.0, 6.0)) for end in (1.0, 0.5))
"""Weights at the points of an integral over a step and over its first half."""
MOST_TERMS, SMALL = 30, 1e-13
"""Terms of the power series of a step at most, and their size, over the sum's, at which it ends."""
SLOW = 2e-6
"""Share of the peak velocity at which slopes are taken where exact friction's motion is slower: twice the step of
central differences."""


@njit
def turned(v, sign):
    """Return the velocity, a tiny one where it is 0, and the ε with which friction has exactly this sign there."""
    if v == 0.0:
        v = sign * TINY
    return v, sign * v * EXACT


@njit
def linearise(x, v, w, g_at, h_at, c, q, epsilon, rounding, sign, active, law, sizes, row):
    """Slopes of the force by x and v at one point, and the sources of the tangents, into a row of `over_a_step`'s.

    w, g_at, h_at, c, q, epsilon, rounding, law: as in `acceleration`. row: (2 + m + e + r + 4,): by x and v, then
    coefficients, the terms' further parameters, the law's, and the hats of g and h to the left and right of w.
    sign: of the velocity, where friction has it exactly, else 0.
    """
    damps = 1.0 + g_at[0] + w * (g_at[1] - g_at[0])
    pulls = 1.0 + 2.0 * (h_at[0] + w * (h_at[1] - h_at[0]))
    last = row.size - 4
    if sign != 0.0:
        slow = SLOW * sizes[1]
        v, epsilon = turned(v if abs(v) > slow else sign * slow, sign)
    total, by_x, by_v = damping_slopes(x, v, epsilon, rounding, q, c, active, sizes, damps, row)
    force, slope = restoring_slopes(x, law, sizes, pulls, row, last - (len(law) - 1))
    row[0], row[1] = damps * by_x + pulls * slope, damps * by_v
    row[last], row[last + 1] = (1.0 - w) * total, w * total
    row[last + 2], row[last + 3] = 2.0 * (1.0 - w) * force, 2.0 * w * force


@njit
def middle(before, after, step):
    """Value, slope and curvature half way of a step (s), of the quintic that has those at both ends, (3,)."""
    value = 0.5 * (before[0] + after[0]) + step * (
        5 / 32 * (before[1] - after[1]) + step / 64 * (before[2] + after[2])
    )
    slope = 15 / 8 * (after[0] - before[0]) / step - 7 / 16 * (before[1] + after[1])
    slope += step / 32 * (after[2] - before[2])
    curvature = 1.5 * (after[1] - before[1]) / step - 0.25 * (before[2] + after[2])
    return value, slope, curvature


@njit
def along(before, after, step, more, share):
    """Value and slope at a share of a step (s): of the quintic and its correction, as `dense` reads them."""
    u, r = share, 1.0 - share
    value = (
        r
        * r
        * r
        * (
            (1.0 + 3.0 * u + 6.0 * u * u) * before[0]
            + u * step * ((1.0 + 3.0 * u) * before[1] + 0.5 * u * step * before[2])
        )
        + u
        * u
        * u
        * (
            (1.0 + 3.0 * r + 6.0 * r * r) * after[0]
            - r * step * ((1.0 + 3.0 * r) * after[1] - 0.5 * r * step * after[2])
        )
        + u * u * u * r * r * r * more
    )
    slope = (
        30.0 * u * u * r * r * (after[0] - before[0]) / step
        + r * r * ((1.0 + 2.0 * u - 15.0 * u * u) * before[1] + 0.5 * u * (2.0 - 5.0 * u) * step * before[2])
        + u * u * ((1.0 + 2.0 * r - 15.0 * r * r) * after[1] - 0.5 * r * (2.0 - 5.0 * r) * step * after[2])
        + 3.0 * u * u * r * r * (r - u) * more / step
    )
    return value, slope


@njit
def powers(read, column):
    """Coefficients of powers of the share of a step of the polynomial through five values."""
    r0, r1, r2, r3, r4 = read[0, column], read[1, column], read[2, column], read[3, column], read[4, column]
    return (
        r0,
        POWERS[1, 0] * r0 + POWERS[1, 1] * r1 + POWERS[1, 2] * r2 + POWERS[1, 3] * r3 + POWERS[1, 4] * r4,
        POWERS[2, 0] * r0 + POWERS[2, 1] * r1 + POWERS[2, 2] * r2 + POWERS[2, 3] * r3 + POWERS[2, 4] * r4,
        POWERS[3, 0] * r0 + POWERS[3, 1] * r1 + POWERS[3, 2] * r2 + POWERS[3, 3] * r3 + POWERS[3, 4] * r4,
        POWERS[4, 0] * r0 + POWERS[4, 1] * r1 + POWERS[4, 2] * r2 + POWERS[4, 3] * r3 + POWERS[4, 4] * r4,
    )


@njit
def unforced(x, v, step):
    """Return values and slopes at the last four of `POINTS` without sources, (8,) twice.

    The first are those of a unit of displacement where the step begins, the second of a unit of velocity.

    x, v: slopes of the force by displacement and velocity, as coefficients of powers of the share of a step, (5,).
    """
    y0, y1, y2, y3, y4, s0, s1, s2, s3, s4 = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    z0, z1, z2, z3, z4, t0, t1, t2, t3, t4 = 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0
    a1, a2, a3, a4, b1, b2, b3, b4 = 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0
    c1, c2, c3, c4, d1, d2, d3, d4 = 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0
    u1, u2, u3 = POINTS[1], POINTS[2], POINTS[3]
    p1, p2, p3 = 1.0, 1.0, 1.0
    for n in range(1, MOST_TERMS):
        share = step / n
        first = -share * (
            (x[0] * y0 + x[1] * y1 + x[2] * y2 + x[3] * y3 + x[4] * y4)
            + (v[0] * s0 + v[1] * s1 + v[2] * s2 + v[3] * s3 + v[4] * s4)
        )
        second = -share * (
            (x[0] * z0 + x[1] * z1 + x[2] * z2 + x[3] * z3 + x[4] * z4)
            + (v[0] * t0 + v[1] * t1 + v[2] * t2 + v[3] * t3 + v[4] * t4)
        )
        y4, y3, y2, y1, y0 = y3, y2, y1, y0, share * s0
        z4, z3, z2, z1, z0 = z3, z2, z1, z0, share * t0
        s4, s3, s2, s1, s0 = s3, s2, s1, s0, first
        t4, t3, t2, t1, t0 = t3, t2, t1, t0, second
        p1, p2, p3 = p1 * u1, p2 * u2, p3 * u3
        a1, a2, a3, a4 = a1 + p1 * y0, a2 + p2 * y0, a3 + p3 * y0, a4 + y0
        b1, b2, b3, b4 = b1 + p1 * s0, b2 + p2 * s0, b3 + p3 * s0, b4 + s0
        c1, c2, c3, c4 = c1 + p1 * z0, c2 + p2 * z0, c3 + p3 * z0, c4 + z0
        d1, d2, d3, d4 = d1 + p1 * t0, d2 + p2 * t0, d3 + p3 * t0, d4 + t0
        left = abs(y0) + abs(y1) - SMALL * abs(a4), abs(s0) + abs(s1) - SMALL * abs(b4)
        more = abs(z0) + abs(z1) - SMALL * abs(c4), abs(t0) + abs(t1) - SMALL * abs(d4)
        if max(left[0], left[1], more[0], more[1]) < 0.0:
            break
    return (a1, b1, a2, b2, a3, b3, a4, b4), (c1, d1, c2, d2, c3, d3, c4, d4)


@njit
def over_a_step(read, step, sources, local, half):
    """Solve the variational equations over a step: values and slopes at its end, (2, l), and values half way, (l,).

    The first two columns are of a unit of displacement and of velocity at the beginning, the others of the sources, by
    variation of constants. read: slopes of the force by x and v, then the sources, at `POINTS`, (5, l); sources:
    columns of those that act.
    """
    of_x, of_v = unforced(powers(read, 0), powers(read, 1), step)
    c1, d1, c2, d2, c3, d3, c4, d4 = of_x
    e1, f1, e2, f2, e3, f3, e4, f4 = of_v
    local[0, 0], local[1, 0], half[0] = c4, d4, c2
    local[0, 1], local[1, 1], half[1] = e4, f4, e2
    # A unit of velocity at each point, of which what was at the beginning is (−e, c) over the determinant.
    i1, i2, i3, i4 = c1 * f1 - d1 * e1, c2 * f2 - d2 * e2, c3 * f3 - d3 * e3, c4 * f4 - d4 * e4
    i1, i2, i3, i4 = -step / i1, -step / i2, -step / i3, -step / i4
    w0, w1, w2, w3 = WHOLE[0], WHOLE[1], WHOLE[2], WHOLE[3]
    a0, a1, a2, a3 = (
        -step * w0 * e4, w1 * i1 * (c1 * e4 - e1 * c4), w2 * i2 * (c2 * e4 - e2 * c4), w3 * i3 * (c3 * e4 - e3 * c4),
    )  # fmt: skip
    b0, b1, b2, b3, b4 = (
        -step * w0 * f4, w1 * i1 * (c1 * f4 - e1 * d4), w2 * i2 * (c2 * f4 - e2 * d4), w3 * i3 * (c3 * f4 - e3 * d4),
        -step * WHOLE[4],
    )  # fmt: skip
    m0, m1, m3, m4 = (
        -step * HALF[0] * e2, HALF[1] * i1 * (c1 * e2 - e1 * c2), HALF[3] * i3 * (c3 * e2 - e3 * c2),
        HALF[4] * i4 * (c4 * e2 - e4 * c2),
    )  # fmt: skip
    for p in sources:
        r0, r1, r2, r3, r4 = read[0, p], read[1, p], read[2, p], read[3, p], read[4, p]
        local[0, p] = a0 * r0 + a1 * r1 + a2 * r2 + a3 * r3
        local[1, p] = b0 * r0 + b1 * r1 + b2 * r2 + b3 * r3 + b4 * r4
        half[p] = m0 * r0 + m1 * r1 + m3 * r3 + m4 * r4


@njit
def curvatures(slopes, row, live, base, piece, knots, by_knots):
    """Curvatures of the tangents (k, 4) at one point from their values and slopes there and `linearise`'s row.

    live, base: as in `march`; knots: how many there are; by_knots: whether tangents by g and h are wanted.
    """
    for p in range(slopes.shape[0]):
        slopes[p, 2] = -(row[0] * slopes[p, 0] + row[1] * slopes[p, 1])
    for p in live:
        slopes[p, 2] -= row[2 + p]
    if by_knots:
        for i in range(2):
            p = base + 2 + piece + i
            slopes[p, 2] -= row[2 + base + i]
            slopes[p + knots, 2] -= row[4 + base + i]


@njit
def carry(old, new, local, half):
    """Carry a tangent from a step's beginning to its end; its value half way goes where its correction will be."""
    new[0] = local[0, 0] * old[0] + local[0, 1] * old[1]
    new[1] = local[1, 0] * old[0] + local[1, 1] * old[1]
    new[2] = 0.0
    old[3] = half[0] * old[0] + half[1] * old[1]


@njit
def add(old, new, local, half, read, place):
    """Add to a tangent the part that comes from a source."""
    new[0] += local[0, place]
    new[1] += local[1, place]
    new[2] -= read[4, place]
    old[3] += half[place]


@njit
def close(old, new, read, step):
    """Compute a tangent's curvature at the step's end, and the correction of its quintic."""
    new[2] -= read[4, 0] * new[0] + read[4, 1] * new[1]
    value, _, _ = middle(old, new, step)
    old[3] = 64.0 * (old[3] - value)


# --- end ---
