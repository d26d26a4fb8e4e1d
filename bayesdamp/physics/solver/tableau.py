"""Luther's explicit Runge–Kutta method of order six, seven stages (Mathematics of Computation 22, 1968)."""

import math

_R = math.sqrt(21.0)

A: tuple[tuple[float, ...], ...] = (
    (),
    (1.0,),
    (3 / 8, 1 / 8),
    (8 / 27, 2 / 27, 8 / 27),
    (3 * (3 * _R - 7) / 392, -8 * (7 - _R) / 392, 48 * (7 - _R) / 392, -3 * (21 - _R) / 392),
    (
        -5 * (231 + 51 * _R) / 1960,
        -40 * (7 + _R) / 1960,
        -320 * _R / 1960,
        3 * (21 + 121 * _R) / 1960,
        392 * (6 + _R) / 1960,
    ),
    (
        15 * (22 + 7 * _R) / 180,
        120 / 180,
        40 * (7 * _R - 5) / 180,
        -63 * (3 * _R - 2) / 180,
        -14 * (49 + 9 * _R) / 180,
        70 * (7 - _R) / 180,
    ),
)
"""Stage coefficients; the equations are autonomous, so the times of the stages are not needed."""

B: tuple[float, ...] = (9 / 180, 0.0, 64 / 180, 0.0, 49 / 180, 49 / 180, 9 / 180)
"""Weights of the stages."""

ORDER = 6
