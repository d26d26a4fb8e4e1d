"""Records as sparse models predict them, many models at once, and what each leaves of the record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from bayesdamp.estimators.regression.library import Candidate

STEPS = 100
"""Steps of Runge and Kutta's method in a period."""
TABLE = 4001
"""Entries of the tables of forces, over twice what the record shows of θ and θ̇."""
NUDGE = 1e-3
"""A coefficient is moved by this share of the force when derivatives are taken, a state by a tenth of that."""


@dataclass(frozen=True)
class Record:
    """What is to be predicted: y (n,) at times t (n,), the order-th derivative of the displacement.

    theta, omega (n,): the smoothed state; known: the force that is known, of angles (m,); period in s.
    """

    t: np.ndarray
    y: np.ndarray
    order: int
    theta: np.ndarray
    omega: np.ndarray
    known: Callable[[np.ndarray], np.ndarray]
    period: float


def left_over(
    record: Record, library: list[Candidate], x: np.ndarray, unit: np.ndarray, floor: float
) -> np.ndarray:
    """Sum of squares (m,) that each of the models x (m, p) leaves of the record, at its best nearby.

    The start of each, and those of its coefficients that are not zero, move by one step of Gauss and Newton: an
    error of the regression is not an error of the model. unit (p,): coefficients that make a noticeable force.
    floor: a sd below which nothing is told apart; it stands for what is less.
    """
    size = np.array([np.ptp(record.theta) / 2, np.abs(record.omega).max()])
    start = np.array([record.theta[0], record.omega[0]])
    moved = [(one, start) for one in x]
    steps = [
        [("state", j, 0.1 * NUDGE * size[j]) for j in range(2)]
        + [("term", j, NUDGE * unit[j]) for j in np.flatnonzero(one)]
        for one in x
    ]
    for one, changes in zip(x, steps):
        for kind, j, step in changes:
            coefficients, state = one.copy(), start.copy()
            (state if kind == "state" else coefficients)[j] += step
            moved.append((coefficients, state))
    curves = predicted(record, library, *(np.array(part) for part in zip(*moved)))
    found, at = np.empty(x.shape[0]), x.shape[0]
    for i, changes in enumerate(steps):
        by = curves[:, at : at + len(changes)] - curves[:, [i]]
        at += len(changes)
        scale = np.maximum(np.linalg.norm(by, axis=0), 1e-300)
        left = record.y - curves[:, i]
        left = left - by / scale @ np.linalg.lstsq(by / scale, left, rcond=1e-10)[0]
        found[i] = float(left @ left)
    return np.maximum(found, record.t.size * floor**2)


def predicted(record: Record, library: list[Candidate], x: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The recorded quantity (n, m) as models x (m, p) predict it from states start (m, 2)."""
    t, theta, omega = record.t, record.theta, record.omega
    middle, half = (theta.max() + theta.min()) / 2, np.ptp(theta)
    angles = middle + half * np.linspace(-1, 1, TABLE)
    fastest = 2 * float(np.abs(omega).max())
    speeds, rest = fastest * np.linspace(-1, 1, TABLE), np.zeros(TABLE)
    damping = np.array([one.damping is not None for one in library])
    values = np.column_stack(
        [one.function(rest, speeds) if of_speed else one.function(angles, rest)
         for one, of_speed in zip(library, damping)]
    )  # fmt: skip
    restoring = record.known(angles)[:, None] + values[:, ~damping] @ x[:, ~damping].T
    resisting = values[:, damping] @ x[:, damping].T
    every = np.arange(x.shape[0])

    def read(table: np.ndarray, share: np.ndarray) -> np.ndarray:
        place = np.clip((share + 1) * ((TABLE - 1) / 2), 0, TABLE - 1.001)
        i = place.astype(int)
        part = place - i
        return table[i, every] * (1 - part) + table[i + 1, every] * part

    def slope(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -read(restoring, (q - middle) / half) - read(resisting, v / fastest)

    count = max(int(np.ceil((t[-1] - t[0]) / record.period * STEPS)), 8)
    h = (t[-1] - t[0]) / count
    q, v = start[:, 0].copy(), start[:, 1].copy()
    path = np.empty((3, count + 1, x.shape[0]))
    for i in range(count + 1):
        a1 = slope(q, v)
        path[:, i] = q, v, a1
        v2 = v + h / 2 * a1
        a2 = slope(q + h / 2 * v, v2)
        v3 = v + h / 2 * a2
        a3 = slope(q + h / 2 * v2, v3)
        v4 = v + h * a3
        a4 = slope(q + h * v3, v4)
        q, v = q + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    nodes = np.linspace(t[0], t[-1], count + 1)
    rate = path[record.order + 1] if record.order < 2 else np.gradient(path[2], h, axis=0, edge_order=2)
    return np.asarray(CubicHermiteSpline(nodes, path[record.order], rate)(t))
