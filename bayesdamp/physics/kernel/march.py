"""Template of the part of a kernel that integrates the equation of motion

    θ̈ + (1 + g(t)) Σ c_j shape_j(θ, θ̇) + (1 + 2 h(t)) F_rest(θ) = 0.

Here c_j is the coefficient of damping term j, shape_j its force per unit of the coefficient, and F_rest the restoring
force. g and h are relative deviations of the damping and of the frequency; they are linear between given times (knots).
The integration uses Verner's Runge–Kutta pair of orders 7 and 6 (J. H. Verner, Numer. Algorithms 53, 383 (2010)). Steps
end on the knots. The derivatives of the motion by its parameters (tangents) are computed together with it. In each step
all tangents are propagated by the same transition matrix, so that their cost hardly grows with the number of knots.

`build` copies this source behind the source of an oscillator's forces, and compiles both together. The forces that this
module imports from `tangents` are only placeholders.

The friction is exact (discontinuous) if ε, the width in velocity of its change of sign, is 0 and a term jumps with the
sign of the velocity. The sign of the velocity is then constant from one turning point to the next. Steps end on turning
points; a second node at the same time has the acceleration after the turning point. At a turning point, the tangents of
the velocity are multiplied by the ratio of the accelerations (the saltation matrix: R. I. Leine and H. Nijmeijer,
Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004, section 7.3). A body that comes to rest sticks if the
restoring force is not larger than the static friction at this time. It then stays at rest: later changes of g and h do
not release it.
"""

import math

import numpy as np
from numba import njit

from bayesdamp.physics.kernel.tangents import (
    JUMPS,
    LAW_SIZES,
    OWNERS,
    POINTS,
    SWITCHES,
    add,
    along,
    carry,
    close,
    curvatures,
    damping,
    exact_sign,
    linearise,
    middle,
    restoring,
    shapes,
    solve_step,
    to_tuples,
)

# --- march ---

# Nodes C, matrix A and weights B (order 7) of the Runge–Kutta pair. E: B minus the weights of order 6, with which the
# error is estimated.
C = np.array([0.0, 0.005, 49 / 450, 49 / 300, 911 / 2000, 0.60950944899783813171, 0.884, 0.925, 1.0, 1.0])
A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.005, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [-1.07679012345679012346, 1.18567901234567901235, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [49 / 1200, 0.0, 0.1225, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.63891392362557267805, 0.0, -2.45567263822365680966, 2.27225871459808413161, 0.0, 0.0, 0.0, 0.0, 0.0],
        [
            -2.66157737501875713112, 0.0, 10.80451388645613769565, -8.35391465739619941197,
            0.82048759495665697914, 0.0, 0.0, 0.0, 0.0,
        ],
        [
            6.06774143469677099272, 0.0, -24.71127363591108579734, 20.42751793078889394046,
            -1.90615797881664715062, 1.00617224924206801479, 0.0, 0.0, 0.0,
        ],
        [
            12.05467007625320299509, 0.0, -49.75478495046898932807, 41.14288863860467663260,
            -4.46176014997400418564, 2.04233482223917495982, -0.09834843665406107380, 0.0, 0.0,
        ],
        [
            10.13814652288180787642, 0.0, -42.64113603171750214622, 35.76384003992257007135,
            -4.34802284039290765334, 2.00986226837703589544, 0.34874904603382724060, -0.27143900510483128424, 0.0,
        ],
        [
            -45.03007203429867712435, 0.0, 187.32724376545888407524, -154.02882369350186905967,
            18.56465306347536233859, -7.14180967929507885493, 1.30880857816137862511, 0.0, 0.0,
        ],
    ]
)  # fmt: skip
B = np.array(
    [
        0.04715561848627222170, 0.0, 0.0, 0.25750564298434151896, 0.26216653977412620477, 0.15216092656738557403,
        0.49399691700324842469, -0.29430311714032504416, 0.08131747232495109999, 0.0,
    ]
)  # fmt: skip
E = B - np.array(
    [
        0.04460860660634117629, 0.0, 0.0, 0.26716403785713726805, 0.22010183001772930200, 0.21884317031431568310,
        0.22898717054112028834, 0.0, 0.0, 0.02029518466335628223,
    ]
)  # fmt: skip
DENSE_ERROR = 0.022 / 64
"""Factor that estimates the error of the dense output (interpolation within a step): `DENSE_ERROR` · |k| ωh. Here k is
the factor of the correction k u³(1 − u)³ (see `dense`) at the fraction u of a step, ω the angular frequency and h the
length of the step (derived for a sine, by comparison with the Hermite polynomial of one degree more)."""
EDGE, WIDE, PARTS = 4.0, 3.0, 4.0
"""Limits of the length of a step near v = 0, where friction that is smoothed within ε > 0 changes its sign.

The velocity is v, and ε the width in which the sign changes. The change takes place while |v| < EDGE · ε, which lasts
for the time T = 2 EDGE ε/|θ̈|. A step that reaches this range from outside and is longer than T/WIDE is shortened such
that it ends at |v| = EDGE · ε. Within the range, steps are not longer than T/PARTS. Otherwise a long step would
evaluate the force at hardly any time during the change of sign, and its error estimate would be too small (measured:
with these limits errors are 10 to 30 times smaller at a tolerance of 1e-6, and trajectories depend smoothly on the
parameters).
"""


AT_TURN, NEAR_TURN = 1e-4, 0.1
"""Limits of the time between the end of a step and a turning point (v = 0), in units of 1/ω (radians of the
oscillation). If this time is shorter than `AT_TURN`, the end of the step is moved to the turning point, whose time
follows from the accelerations to rounding error. If it is shorter than `NEAR_TURN`, the step is repeated, and its
length is corrected by Newton's method (measured)."""
STILL = 1e-12
"""Two limits. A body at rest sticks if its acceleration is not larger than `STILL` · ω²A, where ω²A is the peak
acceleration of a harmonic oscillation with typical amplitude A and frequency ω (conventional). A turning point and a
knot count as simultaneous if the relative difference of their times is below `STILL`."""


@njit
def acceleration(x, v, w, g, h, c, q, epsilon, rounding, law):
    """Return the acceleration θ̈ at displacement x and velocity v, in rad/s² or m/s².

    w: position of the time between two knots, from 0 at the left knot to 1 at the right one. g, h: deviations, two
    numbers each, for the left and the right knot; between them they are linear. The damping force is multiplied by 1 +
    g, the restoring force by 1 + 2h. c, q, law: tuples of the coefficients of the damping terms, their further
    parameters, and the parameters of the restoring law, as returned by `to_tuples`. epsilon: width ε of the range of
    velocities in which dry friction changes its sign. rounding: the same width for terms whose force is steep but
    continuous at v = 0.
    """
    damps, pulls = g[0] + w * (g[1] - g[0]), h[0] + w * (h[1] - h[0])
    return -(1.0 + damps) * damping(x, v, epsilon, rounding, q, c) - (1.0 + 2.0 * pulls) * restoring(x, law)


@njit
def acceleration_with_sign(x, v, w, g, h, c, q, rounding, sign, law):
    """Return the acceleration θ̈ (rad/s² or m/s²) if dry friction has exactly the sign `sign` (1 or −1).

    Friction has this sign even if the velocity v is 0 or has the other sign. This function is used instead of
    `acceleration` if ε = 0. x: displacement. w, g, h (time between two knots, and deviations at these), c, q, rounding,
    law: as in `acceleration`.
    """
    v, epsilon = exact_sign(v, sign)
    return acceleration(x, v, w, g, h, c, q, epsilon, rounding, law)


@njit
def release_direction(x, w, g, h, c, q, rounding, law, first, least):
    """Return the direction (1 or −1) in which a body at rest starts to move, and its acceleration (with sign).

    Both are 0 if static friction holds the body. x: displacement of the body. first: direction, 1 or −1, that is tried
    before the opposite one; it is returned if the body could start in both. least: largest absolute acceleration, in
    rad/s² or m/s², with which the body still sticks. The other arguments are those of `acceleration`.
    """
    for sign in (first, -first):
        a = acceleration_with_sign(x, 0.0, w, g, h, c, q, rounding, sign, law)
        if a * sign > least:
            return sign, a
    return 0.0, 0.0


@njit
def fraction_until(v, a, new_v, new_a, step, wanted):
    """Return the fraction of a step (0 to 1) after which the velocity equals `wanted`, a value between v and new_v.

    v, a: velocity and acceleration at the start of the step. new_v, new_a: those at its end. step: length of the step
    in s. The velocity within the step is the cubic Hermite polynomial through these four values. Its root is found by
    Newton's method, or by bisection where Newton's method fails.
    """
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
def enlarge(times, states, slopes, count, room):
    """Copy the first `count` nodes to longer arrays of times, states and tangents with space for `room` nodes.

    Return these three arrays. times: (s,). states: displacement, velocity, acceleration and interpolation factor, (s,
    4). slopes: the tangents, which are derivatives of the states by k parameters, (s, k, 4). The numbers are copied in
    loops, because array slices take longer to compile.
    """
    more_times, more_states = np.zeros(room), np.zeros((room, 4))
    more_slopes = np.zeros((room, slopes.shape[1], 4))
    for i in range(count):
        more_times[i] = times[i]
        for j in range(4):
            more_states[i, j] = states[i, j]
            for p in range(slopes.shape[1]):
                more_slopes[i, p, j] = slopes[i, p, j]
    return more_times, more_states, more_slopes


@njit(cache=True, nogil=True)
def sums(x, v, weight, epsilon, rounding, q, active, out):
    """Compute weighted sums over n points of the damping terms' forces, each per unit of its coefficient.

    The sums are written into `out`, (d, m), for d sets of parameters and m terms. x, v, weight: displacement, velocity
    and weight of each point, (n,). epsilon: width of the range of velocities in which dry friction changes its sign;
    with 0 it jumps with the sign of v. rounding: the same width for terms whose force is steep but continuous at v = 0.
    q: d sets of the e further parameters of all m terms, (d, e); each set gives one row of `out`. active: which terms
    are on, (m,); the sums of the others are 0.
    """
    work = np.zeros(out.shape[1])
    for d in range(out.shape[0]):
        for j in range(work.size):
            out[d, j] = 0.0
        for i in range(x.size):
            if epsilon > 0.0:
                shapes(x[i], v[i], epsilon, rounding, q[d], active, work)
            else:
                speed, width = exact_sign(v[i], 1.0 if v[i] >= 0.0 else -1.0)
                shapes(x[i], speed, width, rounding, q[d], active, work)
            for j in range(work.size):
                out[d, j] += weight[i] * work[j]


@njit(cache=True, nogil=True)
def march(
    coefficients, q, active, law, epsilon, rounding, start, knots, g, h, tolerance, sizes, tangents, max_steps
):
    """Integrate the equation of motion; return times of the nodes (ends of steps), states there, and tangents.

    All three arrays are empty if the trajectory escapes to infinity or needs more than `max_steps` steps. With exact
    friction there are two nodes at the same time at each turning point. A body that sticks stays at rest until the end.

    Parameters
    ----------
    coefficients, q
        Coefficients of the m damping terms, (m,), and their further parameters, term by term, (e,).
    active
        Which terms are on, (m,).
    law
        Parameters of the restoring law, padded to the largest number r of any law in the kernel, then the index of the
        law, (r + 1,).
    epsilon
        Width of the range of velocities in which dry friction changes its sign; 0 for exact (discontinuous) friction.
    rounding
        The same width for terms whose force is steep but continuous at v = 0.
    start
        θ and θ̇ at the first knot, (2,).
    knots
        Increasing times in s, (n,). The integration extends from the first to the last.
    g, h
        Deviations at the knots, (n,): the damping force is multiplied by 1 + g, the restoring force by 1 + 2h.
    tolerance
        Largest error of a step, relative to `sizes[0]` for θ and to `sizes[1]` for θ̇.
    sizes
        Typical magnitudes of θ and θ̇, then of each parameter of the law. The latter set the steps of difference
        quotients.
    tangents
        0 to compute no tangents; 1 for derivatives by the coefficients, the further parameters, the r padded parameters
        of the law, θ₀ and θ̇₀, in this order; 2 for these, then by the n values of g and the n values of h.
    max_steps
        Largest number of steps that are tried.

    Returns
    -------
    times
        Times of the s nodes, (s,).
    states
        θ, θ̇ and θ̈ at each node, and the factor k of the correction k u³(1 − u)³ that is added to the interpolation at
        the fraction u of the step after it, (s, 4).
    slopes
        The tangents: derivatives of these four numbers by k parameters, (s, k, 4); 0 for terms that are off.
    """
    # --- Sizes and work arrays. The source of a tangent is the derivative of the force by its parameter.
    # base: index of the tangent by θ₀. sources_of: indices of the parameters whose tangents have a source; they belong
    # to the law and to terms that are on. carried: these indices, and those of θ₀ and θ̇₀. rows: results of `linearise`
    # at `POINTS`. hats: first of the four columns in `rows` for sources by g and h. sources: all columns in `rows` for
    # sources that are not zero. c, q_p, law_p: coefficients, further parameters and law as tuples.
    m, e, r, n = coefficients.size, q.size, law.size - 1, knots.size
    end_of_law = m + e + LAW_SIZES[int(law[r])]
    base = m + e + r
    k = 0 if tangents == 0 else base + 2 + (2 * n if tangents == 2 else 0)
    room = 256
    times, states, slopes = np.zeros(room), np.zeros((room, 4)), np.zeros((room, k, 4))
    sources_of, count = np.zeros(base, np.int64), 0
    for p in range(base):
        if (p < m and active[p]) or m + e <= p < end_of_law or (m <= p < m + e and active[OWNERS[p - m]]):
            sources_of[count] = p
            count += 1
    sources_of, hats, row_size = sources_of[:count], 2 + base, 2 + base + 4
    sources, carried = np.zeros(count + (4 if tangents == 2 else 0), np.int64), np.zeros(count + 2, np.int64)
    for i in range(sources.size):
        sources[i] = sources_of[i] + 2 if i < count else hats + i - count
    for i in range(carried.size):
        carried[i] = sources_of[i] if i < count else base + i - count
    rows, transition, midpoint = np.zeros((5, row_size)), np.zeros((2, row_size)), np.zeros(row_size)
    xs, vs, ws, kv = np.zeros(10), np.zeros(10), np.zeros(10), np.zeros(10)
    c, q_p, law_p = to_tuples(coefficients, q, active, law)
    x, v, t, piece = start[0], start[1], knots[0], 0
    at_g, at_h = (g[0], g[1]), (h[0], h[1])
    radian_time, a_min = sizes[0] / sizes[1], STILL * sizes[1] * sizes[1] / sizes[0]
    edge, usual_step, exact = 0.0, 0.0, False
    for j in range(m):
        if active[j] and SWITCHES[j]:
            exact = exact or (epsilon == 0.0 and JUMPS[j])
            edge = EDGE * (epsilon if epsilon > 0.0 else rounding)
    if exact:
        edge = 0.0
    elif epsilon == 0.0:
        epsilon = rounding
    sign, at_turn, is_stuck, is_aimed = 0.0, False, False, False
    if exact and v == 0.0:
        sign, a = release_direction(x, 0.0, at_g, at_h, c, q_p, rounding, law_p, 1.0, a_min)
        is_stuck = sign == 0.0
    elif exact:
        sign = 1.0 if v > 0.0 else -1.0
        a = acceleration_with_sign(x, v, 0.0, at_g, at_h, c, q_p, rounding, sign, law_p)
    else:
        a = acceleration(x, v, 0.0, at_g, at_h, c, q_p, epsilon, rounding, law_p)
    states[0, 0], states[0, 1], states[0, 2], times[0] = x, v, a, t
    if tangents > 0:
        slopes[0, base, 0] = 1.0
        if not is_stuck:
            slopes[0, base + 1, 1] = 1.0
            linearise(x, v, 0.0, at_g, at_h, c, q_p, epsilon, rounding, sign, active, law_p, sizes, rows[0])
            curvatures(slopes[0], rows[0], sources_of, base, piece, n, tangents == 2)
    step = 0.05 * radian_time
    count, attempts = 1, 0
    if abs(v) < edge and a != 0.0:
        usual_step, step = step, min(step, 2.0 * edge / abs(a) / PARTS)
    while True:
        if attempts > max_steps:
            return times[:0], states[:0], slopes[:0]
        attempts += 1
        if count + 2 > room:
            room *= 2
            times, states, slopes = enlarge(times, states, slopes, count, room)
        if is_stuck:  # the body stays at rest until the last knot; tangents of its velocity are 0
            times[count], states[count, 0] = knots[n - 1], x
            for p in range(k):
                slopes[count, p, 0] = slopes[count - 1, p, 0]
            return times[: count + 1], states[: count + 1], slopes[: count + 1]
        remaining = knots[piece + 1] - t
        since_knot, width = t - knots[piece], knots[piece + 1] - knots[piece]
        at_g, at_h = (g[piece], g[piece + 1]), (h[piece], h[piece + 1])
        if at_turn:  # add a second node at the turning point, with the acceleration after it
            w, before = since_knot / width, a
            sign, a = release_direction(x, w, at_g, at_h, c, q_p, rounding, law_p, -sign, a_min)
            at_turn, is_stuck = False, sign == 0.0
            times[count], states[count, 0], states[count, 1], states[count, 2] = t, x, 0.0, a
            for p in range(k):
                slopes[count, p, 0] = slopes[count - 1, p, 0]
                slopes[count, p, 1] = slopes[count - 1, p, 1] * (a / before)
            if k > 0 and not is_stuck:
                linearise(
                    x, 0.0, w, at_g, at_h, c, q_p, epsilon, rounding, sign, active, law_p, sizes, rows[0]
                )
                curvatures(slopes[count], rows[0], sources_of, base, piece, n, tangents == 2)
            count += 1
            continue
        # --- One Runge–Kutta step of length `taken`, which ends on the next knot (`whole`) or before it.
        whole = step >= remaining * (1 - 1e-9)
        taken = remaining if whole else (step if is_aimed or step < 0.5 * remaining else 0.5 * remaining)
        xs[0], vs[0], ws[0], kv[0] = x, v, since_knot / width, a
        for i in range(1, 10):
            px, pv = 0.0, 0.0
            for j in range(i):
                px += A[i, j] * vs[j]
                pv += A[i, j] * kv[j]
            xs[i], vs[i], ws[i] = x + taken * px, v + taken * pv, (since_knot + C[i] * taken) / width
            if exact:
                kv[i] = acceleration_with_sign(xs[i], vs[i], ws[i], at_g, at_h, c, q_p, rounding, sign, law_p)
            else:
                kv[i] = acceleration(xs[i], vs[i], ws[i], at_g, at_h, c, q_p, epsilon, rounding, law_p)
        px, pv, ex, ev = 0.0, 0.0, 0.0, 0.0
        for i in range(10):
            px += B[i] * vs[i]
            pv += B[i] * kv[i]
            ex += E[i] * vs[i]
            ev += E[i] * kv[i]
        px, pv, w = x + taken * px, v + taken * pv, ws[9]
        error = taken * max(abs(ex) / sizes[0], abs(ev) / sizes[1]) / tolerance
        if not math.isfinite(error) or abs(px) > 1e3 * (sizes[0] + abs(start[0])):
            if not math.isfinite(error) and taken > 1e-9 * sizes[0] / sizes[1]:
                step = 0.2 * taken
                continue
            return times[:0], states[:0], slopes[:0]
        if error > 1.0:
            step, is_aimed = taken * max(0.2, 0.9 * error ** (-1 / 7)), False
            continue
        # --- With exact friction, let the step end on the turning point. `at_turn`: this step ends there. `is_aimed`:
        # the next attempt should end there. `usual_step`: length to which the steps return afterwards.
        if not exact:
            pa = acceleration(px, pv, w, at_g, at_h, c, q_p, epsilon, rounding, law_p)
        else:
            pa = acceleration_with_sign(px, pv, w, at_g, at_h, c, q_p, rounding, sign, law_p)
            brakes, beyond = pa * sign < 0.0, pv * sign <= 0.0
            if brakes and abs(pv) < AT_TURN * radian_time * abs(pa):
                lag = -pv / pa
                turn = acceleration_with_sign(
                    px + 0.5 * pv * lag, 0.0, w + lag / width, at_g, at_h, c, q_p, rounding, sign, law_p
                )
                lag = -2.0 * pv / (pa + turn) if turn * sign < 0.0 else remaining
                if 0.0 < taken + lag <= remaining:
                    px += lag * (pv + lag * (2.0 * pa + turn) / 6.0)
                    pv, pa, taken, at_turn = 0.0, turn, taken + lag, True
                    whole = remaining - taken <= STILL * (radian_time + t)
            elif brakes and (beyond or is_aimed) and abs(pv) < NEAR_TURN * radian_time * abs(pa):
                is_aimed = 0.0 < taken - pv / pa <= remaining
                if is_aimed:
                    usual_step, step = max(usual_step, taken), taken - pv / pa
                    continue
            if beyond and not at_turn:
                is_aimed, usual_step = True, max(usual_step, taken)
                step = taken * (0.5 if v == 0.0 else fraction_until(v, a, pv, pa, taken, 0.0))
                continue
        # --- Correction of the dense output, from the acceleration at the middle of the step, and its error.
        last, now = states[count - 1], states[count]
        times[count], now[0], now[1], now[2] = t + taken, px, pv, pa
        mx, mv, curvature = middle(last, now, taken)
        middle_w = (since_knot + 0.5 * taken) / width
        if not exact:
            ma = acceleration(mx, mv, middle_w, at_g, at_h, c, q_p, epsilon, rounding, law_p)
        elif mv * sign < -1e-6 * sizes[1] and taken > 1e-6 * radian_time:  # two turning points in one step
            step, at_turn, is_aimed = 0.5 * taken, False, True
            continue
        else:
            ma = acceleration_with_sign(mx, mv, middle_w, at_g, at_h, c, q_p, rounding, sign, law_p)
        last[3] = (curvature - ma) * taken * taken / 0.375
        dense_error = DENSE_ERROR * abs(last[3]) * taken * sizes[1] / (sizes[0] * sizes[0]) / tolerance
        if dense_error > 1.0:
            step, at_turn, is_aimed = taken * max(0.2, 0.9 * dense_error ** (-1 / 7)), False, False
            continue
        error = max(error, dense_error)
        # --- With ε > 0, end a long step where friction begins to change its sign (see EDGE).
        direction = 1.0 if v > 0.0 else -1.0
        beyond = v * direction > edge * (1.0 + 1e-9)
        if (
            edge > 0.0
            and beyond
            and pv * direction < edge * (1.0 - 1e-6)
            and 2.0 * edge < WIDE * taken * abs(pa)
        ):
            usual_step, step = taken, taken * fraction_until(v, a, pv, pa, taken, edge * direction)
            continue
        # --- Tangents.
        if tangents > 0:
            for i in range(1, 5):
                if i == 4:
                    sx, sv = px, pv
                else:
                    sx, sv = along(last, now, taken, last[3], POINTS[i])
                linearise(
                    sx, sv, (since_knot + POINTS[i] * taken) / width, at_g, at_h, c, q_p, epsilon, rounding, sign,
                    active, law_p, sizes, rows[i],
                )  # fmt: skip
            solve_step(rows, taken, sources, transition, midpoint)
            old, new = slopes[count - 1], slopes[count]
            for p in carried:
                carry(old[p], new[p], transition, midpoint)
            for i in range(sources_of.size):
                add(old[sources_of[i]], new[sources_of[i]], transition, midpoint, rows, 2 + sources_of[i])
            if tangents == 2:
                for i in range(piece + 2):
                    carry(old[base + 2 + i], new[base + 2 + i], transition, midpoint)
                    carry(old[base + 2 + n + i], new[base + 2 + n + i], transition, midpoint)
                for i in range(2):
                    p = base + 2 + piece + i
                    add(old[p], new[p], transition, midpoint, rows, hats + i)
                    add(old[p + n], new[p + n], transition, midpoint, rows, hats + 2 + i)
            for p in carried:
                close(old[p], new[p], rows, taken)
            if tangents == 2:
                for i in range(piece + 2):
                    close(old[base + 2 + i], new[base + 2 + i], rows, taken)
                    close(old[base + 2 + n + i], new[base + 2 + n + i], rows, taken)
            for i in range(row_size):
                rows[0, i] = rows[4, i]
            # g is a sum of hat functions, one for each knot, times its values there; so is h. After a knot, the hat
            # function of the knot before ends and that of the next knot begins.
            if whole and tangents == 2:
                rows[0, hats], rows[0, hats + 1] = rows[4, hats + 1], 0.0
                rows[0, hats + 2], rows[0, hats + 3] = rows[4, hats + 3], 0.0
        # --- Accept the step and choose the length of the next.
        t = knots[piece + 1] if whole else t + taken
        x, v, a, times[count] = px, pv, pa, t
        count += 1
        grown = taken * min(5.0, 0.9 * max(error, 1e-10) ** (-1 / 7))
        step = max(grown, step) if whole else grown
        if exact:
            step, is_aimed = min(max(step, usual_step) if at_turn else step, radian_time), False
            usual_step = 0.0 if at_turn else usual_step
        elif usual_step > 0.0 and not whole:
            if v * a < edge * abs(a) * (1.0 - 1e-3):  # still within the change of sign
                step = min(step, 2.0 * edge / abs(a) / PARTS)
            else:
                step, usual_step = max(usual_step, step), 0.0
        if whole:
            piece += 1
            if piece == n - 1:
                return times[:count], states[:count], slopes[:count]


# --- end ---
