"""The forces of an oscillator with their derivatives, as arrays: what training by hand-made tangents needs."""

from __future__ import annotations

import numpy as np

from bayesdamp.physics.arrays import slope_of
from bayesdamp.physics.oscillator import Oscillator

WITHIN = 1e-2
"""Step of differences by the velocity, as a share of the width of a switch."""


class Forces:
    """Forces per inertia, rad/s², at n angles or velocities.

    free: names of the restoring parameters that are sought; known: the values of the others.
    """

    def __init__(
        self, osc: Oscillator, known: dict[str, float], free: tuple[str, ...], epsilon: float
    ) -> None:
        self._osc, self._free, self._epsilon = osc, free, epsilon
        self._known = {name: known[name] for name in osc.law.parameters if name not in free}

    def restoring(self, theta: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F_rest (n,), its slope by θ (n,), and its derivatives by the free parameters (n, k)."""
        law, p = self._osc.law, {**self._known, **dict(zip(self._free, values.tolist(), strict=True))}
        by = [
            slope_of(lambda v, name=name: law.force(theta, {**p, name: v}), np.full(theta.size, p[name]))
            for name in self._free
        ]
        return law.force(theta, p), law.slope(theta, p), np.array(by).reshape(-1, theta.size).T

    def shapes(self, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Damping force per unit of each coefficient and its slope by θ̇, both (n, terms)."""
        still = np.zeros_like(omega)
        switches = self._osc.switches and self._epsilon > 0
        step = WITHIN * self._epsilon if switches else None
        pairs = [
            (
                t.force(still, omega, self._epsilon),
                slope_of(lambda v, t=t: t.force(still, v, self._epsilon), omega, step),
            )
            for t in self._osc.terms
        ]
        values, slopes = zip(*pairs, strict=True)
        return np.column_stack(values), np.column_stack(slopes)
