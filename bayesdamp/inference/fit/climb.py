"""From scores to the top of the posterior that they are below."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bayesdamp.inference.fit.retraction import Retract, straight_on
from bayesdamp.inference.model.compiled import compiled
from bayesdamp.inference.model.target import Context, Layout

CLOSE = 1e-3
"""Posterior sds from which on a step ends a climb, if what it gains, in nats, is less than its cube."""
ROUGHLY = 0.1
"""The same where a mode is only compared with another: of a part of a record, of a window that grows."""
WALL = 1e-9
"""Where a folded score stops in place of zero, at which it has no slope."""


def climb(
    layout: Layout,
    context: Context,
    z: np.ndarray,
    *,
    limit: int = 60,
    retract: Retract = straight_on,
    close: float = CLOSE,
) -> tuple[np.ndarray, float, np.ndarray, int, bool]:
    """Levenberg–Marquardt on the log posterior: z, its value, the information, evaluations, converged."""
    curvature = compiled(layout).curvature

    def at(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        value, gradient, information = map(np.asarray, curvature(context, z))
        return value, gradient, information

    return maximise(at, np.asarray(layout.folded), z, limit=limit, retract=retract, close=close)


def maximise(
    curvature: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]],
    folded: np.ndarray,
    z: np.ndarray,
    *,
    limit: int = 60,
    retract: Retract = straight_on,
    close: float = CLOSE,
) -> tuple[np.ndarray, float, np.ndarray, int, bool]:
    """`climb` on any log density of scores, (d,), of which the folded ones, (d,) of bool, end at zero.

    curvature: z to log density, gradient (d,) and information (d, d). retract: where steps end. close: as `CLOSE`.
    """
    z = np.where(folded, np.maximum(np.abs(z), WALL), z)
    value, gradient, information = curvature(z)
    damping, evaluations = 1e-3, 1
    for _ in range(limit):
        if not np.isfinite(value) or not np.all(np.isfinite(information)):
            return z, -np.inf, np.eye(z.size), evaluations, False
        # A folded score ends at zero: where the slope holds it there, the others move without it.
        free = np.flatnonzero(~(folded & (z <= WALL) & (gradient <= 0)))
        inner = information[np.ix_(free, free)]
        move = np.zeros_like(z)
        move[free] = np.linalg.solve(inner + damping * np.diag(np.diag(inner)), gradient[free])
        move *= min(1.0, 3.0 / max(np.abs(move).max(), 1e-300))
        ahead = retract(z, move)
        trial = np.where(folded, np.maximum(ahead, WALL), ahead)
        expected = float(move @ gradient)  # of a step that no wall cuts short: that may point downwards
        move = trial - z
        new = curvature(trial)
        evaluations += 1
        gain = float(new[0] - value) if np.isfinite(new[0]) else -np.inf
        if gain >= 0:
            step = np.sqrt(max(float(move @ information @ move), 0.0))
            z, (value, gradient, information) = trial, new
            damping = max(damping / 5, 1e-12)
            if gain < close**3 * max(1.0, abs(float(value)) * 1e-3) and step < close:
                return z, float(value), information, evaluations, True
        else:
            if expected < 1e-7 or damping > 1e12:
                return z, float(value), information, evaluations, True
            damping = max(damping, 1e-9) * 6
    return z, float(value), information, evaluations, False
