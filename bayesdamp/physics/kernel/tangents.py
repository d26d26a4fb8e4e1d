"""Template of the part of a kernel that integrates the tangents (derivatives of the motion by the parameters).

The tangents obey the variational equations, which are the derivatives of the equation of motion by the parameters.
These equations are linear. Their coefficients depend on the motion and are evaluated at five points of each step. The
equations are solved by a power series in time. `build` copies only the part between two marked lines. The functions and
constants before this part are placeholders for the forces of an oscillator, which `build` generates.

In all functions, m is the number of damping terms, e the number of their further parameters (those besides the
coefficients), and r the largest number of parameters of a restoring law in the kernel. A tangent at a node consists of
four numbers: the derivatives of displacement, velocity and acceleration, and the factor of the correction of the dense
output (the interpolation) in the step after the node.
"""

import numpy as np
from numba import njit

from bayesdamp.physics.damping import EXACT, TINY

OWNERS = np.array([0], np.int64)
"""For each of the e further parameters of damping terms (those besides the coefficients), the index of its term."""
SWITCHES = np.array([False])
"""For each of the m damping terms, whether its force changes rapidly near the velocity v = 0, within the width ε."""
LAW_SIZES = np.array([1], np.int64)
"""For each restoring law, by its index, the number of its parameters."""
JUMPS = np.array([False])
"""For each of the m damping terms, whether its force jumps at the velocity v = 0 if the smoothing width ε is 0, as dry
friction does. It is false for a force that is smooth there, or steep but continuous."""


@njit
def shapes(x, v, epsilon, rounding, q, active, out):
    """Write the force of each damping term, per unit of its coefficient, into `out`, (m,); 0 for terms that are off.

    x, v: displacement and velocity. epsilon: width ε of the range of velocities in which dry friction changes its sign.
    rounding: the same width for terms whose force is steep but continuous at v = 0. q: further parameters of all terms,
    term by term, (e,). active: which terms are on, (m,).
    """
    out[:] = 0.0


@njit
def damping(x, v, epsilon, rounding, q, c):
    """Return the damping force per unit of inertia, summed over all terms, at displacement x and velocity v.

    Terms with coefficient 0 are not evaluated. c, q: tuples of coefficients and further parameters (see `to_tuples`).
    epsilon: width of the range of velocities in which dry friction changes its sign. rounding: the same width for terms
    whose force is steep but continuous at v = 0.
    """
    return 0.0


@njit
def damping_slopes(x, v, epsilon, rounding, q, c, active, sizes, share, out):
    """Return the damping force per unit of inertia, and its derivatives by displacement x and velocity v.

    The derivatives by the m coefficients, then by the e further parameters of the terms, are multiplied by the factor
    `share` and written into `out` from index 2 on. For terms that are off nothing is written. sizes: typical magnitudes
    of x and v, from which the steps of difference quotients follow. c, q: tuples of coefficients and further parameters
    (see `to_tuples`). active: which terms are on, (m,). epsilon, rounding: as in `shapes`.
    """
    return 0.0, 0.0, 0.0


@njit
def to_tuples(coefficients, q, active, law):
    """Return coefficients, further parameters and law as three tuples, which Numba passes faster than arrays.

    The arguments are the coefficients of the m damping terms, their e further parameters q, which terms are on
    (`active`, (m,)), and `law`: the parameters of the restoring law, padded to the number r that the largest law has,
    then the index of the law.

    The first tuple, (m + 1,), has the coefficients, with 0 for terms that are off, and then 1 if any term after the
    first `build.USUAL_TERMS` is on, else 0. The second, (e + 1,), has q, term by term, and a 0. The third, (r + 1,),
    has the values in `law`.
    """
    return (coefficients[0],), (0.0,), (law[0], law[1])


@njit
def restoring(x, p):
    """Return the restoring force per unit of inertia at displacement x.

    p: tuple from `to_tuples` with the parameters of the restoring law, then the index of the law. The parameters are
    padded to the number of the law with the most.
    """
    return p[0] * x


@njit
def restoring_slopes(x, p, sizes, share, out, first):
    """Return the restoring force per unit of inertia at displacement x, and its derivative by x.

    The derivatives by the law's parameters are multiplied by the factor `share` and written into `out` from index
    `first` on. p: parameters of the law, then its index, as in `restoring`. sizes: typical magnitudes of x, of the
    velocity, and of the law's parameters, from which the steps of difference quotients follow.
    """
    out[first] = share * x
    return p[0] * x, p[0]


# --- tangents ---

POINTS = np.array([0.0, 0.5 - np.sqrt(3 / 28), 0.5, 0.5 + np.sqrt(3 / 28), 1.0])
"""Fractions of a step at which the variational equations (derivatives of the equation of motion by the parameters) are
evaluated: the five nodes of Gauss–Lobatto quadrature, which has order eight."""
POWERS = np.linalg.inv(np.vander(POINTS, increasing=True))
"""Matrix, (5, 5), that converts the values of a polynomial at the five `POINTS` of a step to its coefficients of powers
0 to 4."""
WHOLE, HALF = (POWERS.T @ (end ** np.arange(1.0, 6.0) / np.arange(1.0, 6.0)) for end in (1.0, 0.5))
"""Weights for the values of a function at the five `POINTS` of a step, (5,) each. The weighted sum of the values is the
integral of the function over the whole step (`WHOLE`), or over its first half (`HALF`), if the step has length 1."""
MAX_TERMS, SMALL = 30, 1e-13
"""Limits of the power series in time that solves the homogeneous variational equations in a step: `MAX_TERMS` is the
greatest number of its terms. The series ends earlier when the sum of its last two terms is smaller than `SMALL`,
relative to the sum of the series."""
SLOW = 2e-6
"""Smallest |v|, relative to the peak velocity, at which derivatives of the force are evaluated if friction is exact
(discontinuous at v = 0). It is twice the step of the central differences, which must not cross v = 0."""


@njit
def exact_sign(v, sign):
    """Return v and an ε such that tanh(v/ε) is exactly `sign` (1 or −1), even if the velocity v has the other sign.

    ε is the width of the change of sign of friction, negative if v has the other sign. If v is 0, a tiny velocity with
    the given sign is returned in its place.
    """
    if v == 0.0:
        v = sign * TINY
    return v, sign * v * EXACT


@njit
def linearise(x, v, w, g_at, h_at, c, q, epsilon, rounding, sign, active, law, sizes, row):
    """Write the derivatives of the total force at one point of the motion into `row`, (2 + m + e + r + 4,).

    The total force is (1 + g) times the damping force plus (1 + 2h) times the restoring force. g and h are the relative
    deviations of damping and frequency, given at knots. The derivatives are, in this order:

    - by displacement x and velocity v, 2 numbers: the coefficients of the variational equations;
    - by the m coefficients and e further parameters of the damping terms, and by the r parameters of the law;
    - by g at the knots to the left and right, then by h at these two knots, 4 numbers.

    All but the first two are sources of the variational equations.

    w: position of the time between the two knots, from 0 to 1. g_at, h_at: values of g and of h at the two knots. sign:
    sign of the velocity (1 or −1) if friction is exact (discontinuous); 0 if it is smoothed. c, q, law: tuples from
    `to_tuples`. epsilon, rounding, active: as in `shapes`. sizes: as in `restoring_slopes`.
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
    """Return value, slope and curvature at the middle of a step of the quintic Hermite polynomial between two nodes.

    Slope and curvature are the first and second time derivative. before, after: value, slope and curvature at the start
    and end of the step. step: its length in s.
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
    """Return value and slope (time derivative) of the solution at the fraction u = `share` of an integration step.

    The solution is the quintic Hermite polynomial between two nodes plus the correction k u³(1 − u)³ with k = `more`.
    before, after: value, slope and curvature (first and second time derivative) at the start and end of the step. step:
    its length in s.
    """
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
def polynomial_coefficients(r0, r1, r2, r3, r4):
    """Return the coefficients of powers 0 to 4 of the polynomial with the values r0 to r4 at the five `POINTS`.

    The polynomial's variable is the fraction of an integration step, as in `POINTS`.
    """
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

    The variational equation is the derivative of the equation of motion by a parameter: ÿ = −x(u) y − v(u) ẏ, where u
    is the fraction of the step. The first solution starts with displacement y = 1 and velocity ẏ = 0, the second with y
    = 0 and ẏ = 1. Each result contains displacement and velocity at the first of the four points, then at the second,
    and so on. x, v: derivatives of the force by displacement and velocity, as coefficients of the powers 0 to 4 of u,
    (5,). step: length of the step in s.
    """
    # The equation is ÿ = -x(u) y - v(u) ẏ. y0 to y4 and s0 to s4 are the last five terms of the power series of
    # displacement and velocity of the first solution at the end of the step; z0 to z4 and t0 to t4 are these terms of
    # the second solution. p1 to p3 are powers of `POINTS`. a and b are the sums of the series of displacement and
    # velocity of the first solution at the last four of `POINTS`; c and d are these sums of the second solution.
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
    """Solve the variational equations over a step, separately for each source, by variation of constants.

    The source is the derivative of the force by a parameter. read: the derivatives of the force at the five `POINTS` of
    the step, as written by `linearise`, (5, l). Columns 0 and 1 are the coefficients of the equations; each other
    column is one source. The results have the same l columns: `local`, (2, l), gets displacement and velocity at the
    end of the step, and `half`, (l,), the displacement at the middle. Columns 0 and 1 of the results are the solutions
    without source that start with displacement 1 and velocity 0, or 0 and 1. Each other column is the solution that
    starts from zero and has the source of its column. sources: indices of the columns from 2 on that are computed; the
    others stay as they are. step: length of the step in s.
    """
    of_x, of_v = homogeneous_solutions(
        polynomial_coefficients(read[0, 0], read[1, 0], read[2, 0], read[3, 0], read[4, 0]),
        polynomial_coefficients(read[0, 1], read[1, 1], read[2, 1], read[3, 1], read[4, 1]),
        step,
    )
    c1, d1, c2, d2, c3, d3, c4, d4 = of_x
    e1, f1, e2, f2, e3, f3, e4, f4 = of_v
    local[0, 0], local[1, 0], half[0] = c4, d4, c2
    local[0, 1], local[1, 1], half[1] = e4, f4, e2
    # A unit velocity at a point corresponds to the start values (−e, c) / (c f − d e) of displacement and velocity.
    # a, b and m are the factors with which the values of a source at `POINTS` are summed: a for the displacement and b
    # for the velocity at the end of the step, m for the displacement at its middle.
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
    """Compute the second time derivatives of all k tangents at one node and write them into `slopes[:, 2]`.

    A tangent is the derivative of the motion by one parameter. slopes: the tangents at the node, (k, 4); columns 0 and
    1, their values and first time derivatives, must be given. row: derivatives of the force at the node, as written by
    `linearise`. live: indices of the parameters on which the force depends directly, without g and h (deviations of
    damping and frequency). base: index of the tangent by the initial displacement θ₀. piece: index of the knot before
    the node. knots: number of knots. by_knots: whether the last tangents are those by the values of g and h at the
    knots.
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
    """Advance a tangent (derivative of the motion by one parameter) over a step, without the effect of its source.

    The source is the derivative of the force by the parameter; `add` adds its effect. old, new: the tangent at the
    start and at the end of the step, (4,) each: derivatives of displacement, velocity and acceleration, and the factor
    of the correction of the interpolation. local, half: results of `solve_step`.

    The displacement and velocity are written into `new`, and the acceleration in `new` is set to 0; `add` and `close`
    complete it. The displacement at the middle of the step is written into `old[3]`; `close` replaces it by the factor.
    """
    new[0] = local[0, 0] * old[0] + local[0, 1] * old[1]
    new[1] = local[1, 0] * old[0] + local[1, 1] * old[1]
    new[2] = 0.0
    old[3] = half[0] * old[0] + half[1] * old[1]


@njit
def add(old, new, local, half, read, place):
    """Add the effect of a source in a step to a tangent that `carry` has computed.

    A tangent is the derivative of the motion by one parameter, and its source the derivative of the force by it. read:
    derivatives of the force at the five `POINTS` of the step, as written by `linearise`. local, half: results of
    `solve_step`. place: column of the source in these three. old, new: the tangent at the start and end of the step, as
    in `carry`.
    """
    new[0] += local[0, place]
    new[1] += local[1, place]
    new[2] -= read[4, place]
    old[3] += half[place]


@njit
def close(old, new, read, step):
    """Complete a tangent after `carry` and `add`: its second derivative at the end of a step, and its correction.

    A tangent is the derivative of the motion by one parameter. old, new: the tangent at the start and end of the step,
    as in `carry`. `old[3]` becomes the factor k of the correction k u³(1 − u)³ of the interpolation in the step, where
    u is the fraction of the step. read: derivatives of the force at the five `POINTS` of the step, as written by
    `linearise`, (5, l). step: length of the step in s.
    """
    new[2] -= read[4, 0] * new[0] + read[4, 1] * new[1]
    value, _, _ = middle(old, new, step)
    old[3] = 64.0 * (old[3] - value)


# --- end ---
