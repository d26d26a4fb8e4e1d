"""Template of the part of a kernel that integrates the tangents (derivatives of the motion by the parameters).

The tangents obey the variational equations. Within a step these are linear, with coefficients that are evaluated along
the motion at five points; they are solved by a power series in time. `build` copies only the part between two marks;
the functions before it are stand-ins for the forces of an oscillator, which `build` generates.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from bayesdamp.physics.damping import EXACT, TINY

OWNERS = np.array([0], np.int64)
"""For each further parameter, the index of its damping term."""
SWITCHES = np.array([False])
"""For each term, whether its force changes its sign with the velocity, within the width ε."""
LAW_SIZES = np.array([1], np.int64)
"""For each restoring law, the number of its parameters."""
JUMPS = np.array([False])
"""For each term, whether its force jumps if ε = 0 (dry friction), instead of being steep but continuous."""


@njit
def shapes(x, v, epsilon, rounding, q, active, out):
    """Write the terms' forces per unit of their coefficients at one point into `out`; 0 for terms that are off.

    rounding: the ε of terms that are steep but continuous; q: the further parameters of all terms in sequence.
    """
    out[:] = 0.0


@njit
def damping(x, v, epsilon, rounding, q, c):
    """Return the damping force at one point. Terms with coefficient 0 are not evaluated. c: see `to_tuples`."""
    return 0.0


@njit
def damping_slopes(x, v, epsilon, rounding, q, c, active, sizes, share, out):
    """Return the damping force at one point, and its derivatives by x and v.

    The derivatives by the coefficients, then by the further parameters, all times `share`, are written into `out[2:]`.
    sizes: scales of x and v, for difference quotients.
    """
    return 0.0, 0.0, 0.0


@njit
def to_tuples(coefficients, q, active, law):
    """Return coefficients, further parameters and law as tuples, which Numba passes without reference counts.

    Coefficients of terms that are off are 0. After the coefficients follows 1 if any term beyond the first
    `build.USUAL_TERMS` is on, else 0.
    """
    return (coefficients[0],), (0.0,), (law[0], law[1])


@njit
def restoring(x, p):
    """Return the restoring force at one point. p: the law's parameters, then the index of the law."""
    return p[0] * x


@njit
def restoring_slopes(x, p, sizes, share, out, first):
    """Return the restoring force at one point, and its derivative by x.

    The derivatives by the law's parameters, times `share`, are written into `out` from index `first` on.
    """
    out[first] = share * x
    return p[0] * x, p[0]


# --- tangents ---

POINTS = np.array([0.0, 0.5 - np.sqrt(3 / 28), 0.5, 0.5 + np.sqrt(3 / 28), 1.0])
"""Fractions of a step at which the coefficients are evaluated: the five Gauss–Lobatto nodes (order eight)."""
POWERS = np.linalg.inv(np.vander(POINTS, increasing=True))
"""Matrix that gives the coefficients of a polynomial from its values at `POINTS`."""
WHOLE, HALF = (POWERS.T @ (end ** np.arange(1.0, 6.0) / np.arange(1.0, 6.0)) for end in (1.0, 0.5))
"""Weights at `POINTS` of the integral over a whole step, and over its first half."""
MAX_TERMS, SMALL = 30, 1e-13
"""Most terms of the power series in a step; it ends when the terms are smaller than this relative to the sum."""
SLOW = 2e-6
"""With exact friction, derivatives of the force are evaluated at no smaller velocity than this fraction of the peak
velocity. It is twice the step of central differences, which must not cross v = 0."""


@njit
def exact_sign(v, sign):
    """Return v (if 0, a tiny value instead) and an ε such that tanh(v/ε) is exactly `sign`."""
    if v == 0.0:
        v = sign * TINY
    return v, sign * v * EXACT


@njit
def linearise(x, v, w, g_at, h_at, c, q, epsilon, rounding, sign, active, law, sizes, row):
    """Write the derivatives of the force at one point into `row`, (2 + m + e + r + 4,).

    They are the derivatives by x and v, then by coefficients, further parameters, law's parameters, and by the values
    of g and h at the knots to the left and right. Those after the first two are the source terms of the variational
    equations. w, g_at, h_at, c, q, epsilon, rounding, law: as in `acceleration`. sign: sign of the friction's velocity
    if friction is exact, else 0.
    """
    damps = 1.0 + g_at[0] + w * (g_at[1] - g_at[0])
    pulls = 1.0 + 2.0 * (h_at[0] + w * (h_at[1] - h_at[0]))
    last = row.size - 4
    if sign != 0.0:
        slow = SLOW * sizes[1]
        v, epsilon = exact_sign(v if abs(v) > slow else sign * slow, sign)
    total, by_x, by_v = damping_slopes(x, v, epsilon, rounding, q, c, active, sizes, damps, row)
    force, slope = restoring_slopes(x, law, sizes, pulls, row, last - (len(law) - 1))
    row[0], row[1] = damps * by_x + pulls * slope, damps * by_v
    row[last], row[last + 1] = (1.0 - w) * total, w * total
    row[last + 2], row[last + 3] = 2.0 * (1.0 - w) * force, 2.0 * w * force


@njit
def middle(before, after, step):
    """Return value, slope and curvature at the middle of a step (s) of the quintic Hermite polynomial.

    before, after: value, slope and curvature at its ends.
    """
    value = 0.5 * (before[0] + after[0]) + step * (
        5 / 32 * (before[1] - after[1]) + step / 64 * (before[2] + after[2])
    )
    slope = 15 / 8 * (after[0] - before[0]) / step - 7 / 16 * (before[1] + after[1])
    slope += step / 32 * (after[2] - before[2])
    curvature = 1.5 * (after[1] - before[1]) / step - 0.25 * (before[2] + after[2])
    return value, slope, curvature


@njit
def along(before, after, step, more, share):
    """Return value and slope at a fraction `share` of a step (s), of the quintic with the correction `more`."""
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
def polynomial_coefficients(read, column):
    """Return the coefficients of the polynomial, in the fraction of a step, through the five values of a column."""
    r0, r1, r2, r3, r4 = read[0, column], read[1, column], read[2, column], read[3, column], read[4, column]
    return (
        r0,
        POWERS[1, 0] * r0 + POWERS[1, 1] * r1 + POWERS[1, 2] * r2 + POWERS[1, 3] * r3 + POWERS[1, 4] * r4,
        POWERS[2, 0] * r0 + POWERS[2, 1] * r1 + POWERS[2, 2] * r2 + POWERS[2, 3] * r3 + POWERS[2, 4] * r4,
        POWERS[3, 0] * r0 + POWERS[3, 1] * r1 + POWERS[3, 2] * r2 + POWERS[3, 3] * r3 + POWERS[3, 4] * r4,
        POWERS[4, 0] * r0 + POWERS[4, 1] * r1 + POWERS[4, 2] * r2 + POWERS[4, 3] * r3 + POWERS[4, 4] * r4,
    )


@njit
def homogeneous_solutions(x, v, step):
    """Return two solutions of the homogeneous variational equation in a step, at the last four of `POINTS`, (8,) each.

    The first starts with displacement 1 and velocity 0, the second with displacement 0 and velocity 1. Each result
    alternates displacement and velocity. x, v: derivatives of the force by displacement and velocity, as coefficients
    of powers of the fraction of a step, (5,).
    """
    # The equation is ÿ = -x(u) y - v(u) ẏ. y0 to y4 and s0 to s4 are the last five terms of the power series of
    # displacement and velocity of the first solution, z and t those of the second; a and b, c and d are the sums.
    y0, y1, y2, y3, y4, s0, s1, s2, s3, s4 = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    z0, z1, z2, z3, z4, t0, t1, t2, t3, t4 = 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0
    a1, a2, a3, a4, b1, b2, b3, b4 = 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0
    c1, c2, c3, c4, d1, d2, d3, d4 = 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0
    u1, u2, u3 = POINTS[1], POINTS[2], POINTS[3]
    p1, p2, p3 = 1.0, 1.0, 1.0
    for n in range(1, MAX_TERMS):
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
def solve_step(read, step, sources, local, half):
    """Solve the variational equations over a step, by variation of constants.

    Displacements and velocities at the end are written into `local`, (2, l), displacements at the middle into `half`,
    (l,). Columns 0 and 1 start with unit displacement and unit velocity and have no source; each other column starts
    with zeros and has one source. read: rows of `linearise` at `POINTS`, (5, l); sources: the columns that are not
    zero.
    """
    of_x, of_v = homogeneous_solutions(
        polynomial_coefficients(read, 0), polynomial_coefficients(read, 1), step
    )
    c1, d1, c2, d2, c3, d3, c4, d4 = of_x
    e1, f1, e2, f2, e3, f3, e4, f4 = of_v
    local[0, 0], local[1, 0], half[0] = c4, d4, c2
    local[0, 1], local[1, 1], half[1] = e4, f4, e2
    # A unit velocity at a point corresponds to the start values (−e, c) / (c f − d e) of displacement and velocity.
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
    """Write the second derivatives of the tangents (k, 4) at one point into `slopes[:, 2]`.

    They follow from the values and slopes there and the row of `linearise`. live: the parameters that have a source;
    base: index of theta0; knots: number of knots; by_knots: whether there are tangents by g and h.
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
    """Propagate a tangent over a step, without source; `old[3]` stores its value at the middle for `close`."""
    new[0] = local[0, 0] * old[0] + local[0, 1] * old[1]
    new[1] = local[1, 0] * old[0] + local[1, 1] * old[1]
    new[2] = 0.0
    old[3] = half[0] * old[0] + half[1] * old[1]


@njit
def add(old, new, local, half, read, place):
    """Add the effect of the source in column `place` to a tangent at the end of a step."""
    new[0] += local[0, place]
    new[1] += local[1, place]
    new[2] -= read[4, place]
    old[3] += half[place]


@njit
def close(old, new, read, step):
    """Complete a tangent's second derivative at the end of a step, and the correction of the step's quintic."""
    new[2] -= read[4, 0] * new[0] + read[4, 1] * new[1]
    value, _, _ = middle(old, new, step)
    old[3] = 64.0 * (old[3] - value)


# --- end ---
