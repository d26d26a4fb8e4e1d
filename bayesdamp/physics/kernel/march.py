"""The template of a kernel: Verner's pair of orders 7 and 6 with the variational equations.

`build` puts the forces of an oscillator before this source, and the two are compiled together; here the forces are
stand-ins. Solved is

    θ̈ + (1 + g(t)) Σ c_j shape_j(θ, θ̇) + (1 + 2 h(t)) F_rest(θ) = 0,

g and h piecewise linear between knots. Steps end on knots and at the end. The tangents are carried from step to step
by the step's own fundamental matrix, so that their cost does not grow with the number of knots (J. H.
Verner, Numer. Algorithms 53, 383 (2010)).

Where ε = 0 and a term jumps with the sign of the velocity, dry friction is exact: that sign is held from one turning
point to the next, steps end on the turning points, and there a second node at the same time has the acceleration after
it. Between the two the tangents of the velocity change by the ratio of the accelerations (the saltation matrix: R. I.
Leine and H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004, section 7.3). A body at rest
sticks while the pull is not larger than the friction at rest; g and h may release it later.
"""

from __future__ import annotations

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
    gathered,
    linearise,
    middle,
    over_a_step,
    restoring,
    shapes,
    turned,
)

# --- march ---

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
BEYOND = 0.022 / 64
"""Error of the dense output over its correction, for each ωh of the step: of Hermite's polynomials of u³(1 − u)³ and
of one degree more, on a sine."""
EDGE, WIDE, PARTS = 4.0, 3.0, 4.0
"""Velocity, in ε, at which a friction's turning over begins and ends. Where a step would cross it and is more than a
third of what the turning over takes, it ends at the edge, and quarters of the turning over follow: the stages of a long
step see little of it, its estimated error nothing, and what is missed changes by jumps with the parameters (measured:
errors ten to thirty times smaller at 1e-6 of the amplitude, of motions that follow the parameters smoothly)."""


LANDED, NEAR = 1e-4, 0.1
"""Times to a turning point, in radians of the oscillation, below which the accelerations alone tell where it is, to
rounding, and below which Newton's method finds it."""
STILL = 1e-12
"""Acceleration of a body at rest, as a share of the peak one, up to which it sticks."""


@njit
def acceleration(x, v, w, g, h, c, q, epsilon, rounding, law):
    """Compute θ̈ at one point under relative deviations g of the damping and h of the frequency.

    w: share of the way between two knots, where the deviations are g[0] and g[1]. c, q, law: tuples, as from
    `gathered`. rounding: the ε of terms that are rounded off.
    """
    damps, pulls = g[0] + w * (g[1] - g[0]), h[0] + w * (h[1] - h[0])
    return -(1.0 + damps) * damping(x, v, epsilon, rounding, q, c) - (1.0 + 2.0 * pulls) * restoring(x, law)


@njit
def signed(x, v, w, g, h, c, q, rounding, sign, law):
    """`acceleration` where friction has exactly this sign of the velocity."""
    v, epsilon = turned(v, sign)
    return acceleration(x, v, w, g, h, c, q, epsilon, rounding, law)


@njit
def freed(x, w, g, h, c, q, rounding, law, first, least):
    """Return the sign of the velocity with which a body at rest moves off, and its acceleration.

    If both signs are possible it is the first. Both are zero where friction holds the body. least: the smallest
    acceleration that counts.
    """
    for sign in (first, -first):
        a = signed(x, 0.0, w, g, h, c, q, rounding, sign, law)
        if a * sign > least:
            return sign, a
    return 0.0, 0.0


@njit
def held_until(x, t, piece, knots, g, h, c, q, rounding, law, least):
    """Return when friction no longer holds a body at rest, between which knots, and the sign of its velocity then.

    If it does not move again these are the last time and sign 0. Between two knots pull and friction change linearly.
    """
    at = (t - knots[piece]) / (knots[piece + 1] - knots[piece])
    while True:
        at_g, at_h = (g[piece], g[piece + 1]), (h[piece], h[piece + 1])
        for sign in (1.0, -1.0):
            now = sign * signed(x, 0.0, at, at_g, at_h, c, q, rounding, sign, law) - 2.0 * least
            end = sign * signed(x, 0.0, 1.0, at_g, at_h, c, q, rounding, sign, law) - 2.0 * least
            if now > 0.0 or end > 0.0:
                share = at if now > 0.0 else at - (1.0 - at) * now / (end - now)
                if share < 1.0 - 1e-9:
                    return knots[piece] + share * (knots[piece + 1] - knots[piece]), piece, sign
        piece, at = piece + 1, 0.0
        if piece == knots.size - 1:
            return knots[piece], piece - 1, 0.0


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
def with_room(times, states, slopes, count, room):
    """Return the first `count` nodes in arrays for `room` of them. Loops compile in a fraction of a slice's time."""
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
    """Weighted sums over points, (n,), of the terms' shapes, (d, m), for rows of further parameters, (d, e)."""
    work = np.zeros(out.shape[1])
    for d in range(out.shape[0]):
        for j in range(work.size):
            out[d, j] = 0.0
        for i in range(x.size):
            if epsilon > 0.0:
                shapes(x[i], v[i], epsilon, rounding, q[d], active, work)
            else:
                speed, width = turned(v[i], 1.0 if v[i] >= 0.0 else -1.0)
                shapes(x[i], speed, width, rounding, q[d], active, work)
            for j in range(work.size):
                out[d, j] += weight[i] * work[j]


@njit(cache=True, nogil=True)
def march(
    coefficients, q, active, law, epsilon, rounding, start, knots, g, h, tolerance, sizes, tangents, most
):
    """Integrate the equation of motion: return node times, states and tangents; the times are empty if it escapes.

    Times are (s,). States, (s, 4), are θ, θ̇, θ̈ and the correction of the quintic of the step that begins there;
    tangents, (s, k, 4), likewise. Where friction is exact a turning point is two nodes at one time, and so are the
    times at which a body begins and ends to stick.

    law: parameters of the restoring law, as many as the law with most has, then its number among `LAW_SIZES`.
    epsilon, rounding: widths of friction's turning over, 0 for the sign itself, and of what is rounded off.
    knots: (n,), from the first to the last time, g and h there. tolerance: of a step, as a share of the sizes of θ
    and θ̇ (sizes[:2]; then those of the law's parameters). tangents: 0 none, 1 by the parameters, 2 by g and h too,
    in the order coefficients, further parameters, law, θ₀, θ̇₀, g, h. most: steps at most.
    """
    m, e, r, n = coefficients.size, q.size, law.size - 1, knots.size
    own = m + e + LAW_SIZES[int(law[r])]
    base = m + e + r
    k = 0 if tangents == 0 else base + 2 + (2 * n if tangents == 2 else 0)
    room = 256
    times, states, slopes = np.zeros(room), np.zeros((room, 4)), np.zeros((room, k, 4))
    live, count = np.zeros(base, np.int64), 0
    for p in range(base):
        if (p < m and active[p]) or m + e <= p < own or (m <= p < m + e and active[OWNERS[p - m]]):
            live[count] = p
            count += 1
    live, hats, wide = live[:count], 2 + base, 2 + base + 4
    sources, moved = np.zeros(count + (4 if tangents == 2 else 0), np.int64), np.zeros(count + 2, np.int64)
    for i in range(sources.size):
        sources[i] = live[i] + 2 if i < count else hats + i - count
    for i in range(moved.size):
        moved[i] = live[i] if i < count else base + i - count
    read, local, half = np.zeros((5, wide)), np.zeros((2, wide)), np.zeros(wide)
    xs, vs, ws, kv = np.zeros(10), np.zeros(10), np.zeros(10), np.zeros(10)
    sized, more, rests = gathered(coefficients, q, active, law)
    x, v, t, piece = start[0], start[1], knots[0], 0
    at_g, at_h = (g[0], g[1]), (h[0], h[1])
    radian, least = sizes[0] / sizes[1], STILL * sizes[1] * sizes[1] / sizes[0]
    edge, usual, exact = 0.0, 0.0, False
    for j in range(m):
        if active[j] and SWITCHES[j]:
            exact = exact or (epsilon == 0.0 and JUMPS[j])
            edge = EDGE * (epsilon if epsilon > 0.0 else rounding)
    if exact:
        edge = 0.0
    elif epsilon == 0.0:
        epsilon = rounding
    sign, landed, sticks, aimed = 0.0, False, False, False
    if exact and v == 0.0:
        sign, a = freed(x, 0.0, at_g, at_h, sized, more, rounding, rests, 1.0, least)
        sticks = sign == 0.0
    elif exact:
        sign = 1.0 if v > 0.0 else -1.0
        a = signed(x, v, 0.0, at_g, at_h, sized, more, rounding, sign, rests)
    else:
        a = acceleration(x, v, 0.0, at_g, at_h, sized, more, epsilon, rounding, rests)
    states[0, 0], states[0, 1], states[0, 2], times[0] = x, v, a, t
    if tangents > 0:
        slopes[0, base, 0] = 1.0
        if not sticks:
            slopes[0, base + 1, 1] = 1.0
            linearise(
                x, v, 0.0, at_g, at_h, sized, more, epsilon, rounding, sign, active, rests, sizes, read[0]
            )
            curvatures(slopes[0], read[0], live, base, 0, n, tangents == 2)
    step = 0.05 * radian
    count, tries = 1, 0
    if abs(v) < edge and a != 0.0:
        usual, step = step, min(step, 2.0 * edge / abs(a) / PARTS)
    while True:
        if tries > most:
            return times[:0], states[:0], slopes[:0]
        tries += 1
        if count + 2 > room:
            room *= 2
            times, states, slopes = with_room(times, states, slopes, count, room)
        if sticks:  # until it moves again: the last node's tangents by the velocity are zero
            t, piece, sign = held_until(x, t, piece, knots, g, h, sized, more, rounding, rests, least)
            times[count], states[count, 0] = t, x
            for p in range(k):
                slopes[count, p, 0] = slopes[count - 1, p, 0]
            count += 1
            if sign == 0.0:
                return times[:count], states[:count], slopes[:count]
            sticks, landed, sign, a = False, True, -sign, 1.0
            continue
        left = knots[piece + 1] - t
        gone, width = t - knots[piece], knots[piece + 1] - knots[piece]
        at_g, at_h = (g[piece], g[piece + 1]), (h[piece], h[piece + 1])
        if landed:  # a second node at the same time
            w, before = gone / width, a
            sign, a = freed(x, w, at_g, at_h, sized, more, rounding, rests, -sign, least)
            landed, sticks = False, sign == 0.0
            times[count], states[count, 0], states[count, 1], states[count, 2] = t, x, 0.0, a
            for p in range(k):
                slopes[count, p, 0] = slopes[count - 1, p, 0]
                slopes[count, p, 1] = slopes[count - 1, p, 1] * (a / before)
            if k > 0 and not sticks:
                linearise(
                    x, 0.0, w, at_g, at_h, sized, more, epsilon, rounding, sign, active, rests, sizes, read[0]
                )
                curvatures(slopes[count], read[0], live, base, piece, n, tangents == 2)
            count += 1
            continue
        whole = step >= left * (1 - 1e-9)
        taken = left if whole else (step if aimed or step < 0.5 * left else 0.5 * left)
        xs[0], vs[0], ws[0], kv[0] = x, v, gone / width, a
        for i in range(1, 10):
            px, pv = 0.0, 0.0
            for j in range(i):
                px += A[i, j] * vs[j]
                pv += A[i, j] * kv[j]
            xs[i], vs[i], ws[i] = x + taken * px, v + taken * pv, (gone + C[i] * taken) / width
            if exact:
                kv[i] = signed(xs[i], vs[i], ws[i], at_g, at_h, sized, more, rounding, sign, rests)
            else:
                kv[i] = acceleration(xs[i], vs[i], ws[i], at_g, at_h, sized, more, epsilon, rounding, rests)
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
            step, aimed = taken * max(0.2, 0.9 * error ** (-1 / 7)), False
            continue
        if not exact:
            pa = acceleration(px, pv, w, at_g, at_h, sized, more, epsilon, rounding, rests)
        else:
            pa = signed(px, pv, w, at_g, at_h, sized, more, rounding, sign, rests)
            brakes, beyond = pa * sign < 0.0, pv * sign <= 0.0
            if brakes and abs(pv) < LANDED * radian * abs(pa):
                lag = -pv / pa
                turn = signed(
                    px + 0.5 * pv * lag, 0.0, w + lag / width, at_g, at_h, sized, more, rounding, sign, rests
                )
                lag = -2.0 * pv / (pa + turn) if turn * sign < 0.0 else left
                if 0.0 < taken + lag <= left:
                    px += lag * (pv + lag * (2.0 * pa + turn) / 6.0)
                    pv, pa, taken, landed = 0.0, turn, taken + lag, True
                    whole = left - taken <= STILL * (radian + t)
            elif brakes and (beyond or aimed) and abs(pv) < NEAR * radian * abs(pa):
                aimed = 0.0 < taken - pv / pa <= left
                if aimed:
                    usual, step = max(usual, taken), taken - pv / pa
                    continue
            if beyond and not landed:
                aimed, usual = True, max(usual, taken)
                step = taken * (0.5 if v == 0.0 else share_until(v, a, pv, pa, taken, 0.0))
                continue
        last, now = states[count - 1], states[count]
        times[count], now[0], now[1], now[2] = t + taken, px, pv, pa
        mx, mv, bend = middle(last, now, taken)
        middle_w = (gone + 0.5 * taken) / width
        if not exact:
            ma = acceleration(mx, mv, middle_w, at_g, at_h, sized, more, epsilon, rounding, rests)
        elif mv * sign < -1e-6 * sizes[1] and taken > 1e-6 * radian:  # two turning points in one step
            step, landed, aimed = 0.5 * taken, False, True
            continue
        else:
            ma = signed(mx, mv, middle_w, at_g, at_h, sized, more, rounding, sign, rests)
        last[3] = (bend - ma) * taken * taken / 0.375
        rest = BEYOND * abs(last[3]) * taken * sizes[1] / (sizes[0] * sizes[0]) / tolerance
        if rest > 1.0:
            step, landed, aimed = taken * max(0.2, 0.9 * rest ** (-1 / 7)), False, False
            continue
        error = max(error, rest)
        way = 1.0 if v > 0.0 else -1.0
        beyond = v * way > edge * (1.0 + 1e-9)
        if edge > 0.0 and beyond and pv * way < edge * (1.0 - 1e-6) and 2.0 * edge < WIDE * taken * abs(pa):
            usual, step = taken, taken * share_until(v, a, pv, pa, taken, edge * way)
            continue
        if tangents > 0:
            for i in range(1, 5):
                if i == 4:
                    sx, sv = px, pv
                else:
                    sx, sv = along(last, now, taken, last[3], POINTS[i])
                linearise(
                    sx, sv, (gone + POINTS[i] * taken) / width, at_g, at_h, sized, more, epsilon, rounding, sign,
                    active, rests, sizes, read[i],
                )  # fmt: skip
            over_a_step(read, taken, sources, local, half)
            old, new = slopes[count - 1], slopes[count]
            for p in moved:
                carry(old[p], new[p], local, half)
            for i in range(live.size):
                add(old[live[i]], new[live[i]], local, half, read, 2 + live[i])
            if tangents == 2:
                for i in range(piece + 2):
                    carry(old[base + 2 + i], new[base + 2 + i], local, half)
                    carry(old[base + 2 + n + i], new[base + 2 + n + i], local, half)
                for i in range(2):
                    p = base + 2 + piece + i
                    add(old[p], new[p], local, half, read, hats + i)
                    add(old[p + n], new[p + n], local, half, read, hats + 2 + i)
            for p in moved:
                close(old[p], new[p], read, taken)
            if tangents == 2:
                for i in range(piece + 2):
                    close(old[base + 2 + i], new[base + 2 + i], read, taken)
                    close(old[base + 2 + n + i], new[base + 2 + n + i], read, taken)
            for i in range(wide):
                read[0, i] = read[4, i]
            if (
                whole and tangents == 2
            ):  # the hat that was on the right is the one on the left of the next knots
                read[0, hats], read[0, hats + 1] = read[4, hats + 1], 0.0
                read[0, hats + 2], read[0, hats + 3] = read[4, hats + 3], 0.0
        t = knots[piece + 1] if whole else t + taken
        x, v, a, times[count] = px, pv, pa, t
        count += 1
        grown = taken * min(5.0, 0.9 * max(error, 1e-10) ** (-1 / 7))
        step = max(grown, step) if whole else grown
        if exact:
            step, aimed = min(max(step, usual) if landed else step, radian), False
            usual = 0.0 if landed else usual
        elif usual > 0.0 and not whole:
            if v * a < edge * abs(a) * (1.0 - 1e-3):  # before the edge on the other side
                step = min(step, 2.0 * edge / abs(a) / PARTS)
            else:
                step, usual = max(usual, step), 0.0
        if whole:
            piece += 1
            if piece == n - 1:
                return times[:count], states[:count], slopes[:count]


# --- end ---
