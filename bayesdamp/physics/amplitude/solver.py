"""The decay of an amplitude, as a fit asks a motion for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayesdamp.physics.amplitude.law import Law
from bayesdamp.physics.amplitude.laws import RESTED
from bayesdamp.physics.kernel.solve import ALL, PARAMETERS, Motion


@dataclass(frozen=True)
class AmplitudeSolver:
    """Decays of x = ln(A/A_ref) under a law.

    Its parameters are the rates in 1/s at the reference amplitude, in the order of the law's terms, and x at the start.

    Attributes
    ----------
    law
        The sum of damping terms.
    t
        Times of the readings in s from the start, (n,).
    duration
        Of the decay in s, over which the deviation's knots are equidistant.
    knots
        How many there are.
    step
        Of a small rate in 1/s, for derivatives.
    white
        What decays are multiplied by, (n, n), so that the noise of the readings is white; None: nothing.
    """

    law: Law
    t: np.ndarray
    duration: float
    knots: int
    step: float
    white: np.ndarray | None = None
    restoring: str = "linear"

    @property
    def frequency(self) -> float:
        """One over the duration, in 1/s: nothing oscillates."""
        return 1.0 / self.duration

    @cached_property
    def hats(self) -> np.ndarray:
        """The deviation at the readings by its values at the knots, (n, knots): straight lines between these."""
        return hats(self.t / self.duration, self.knots)

    def solve(
        self,
        p: np.ndarray,
        active: np.ndarray | None = None,
        *,
        tangents: int = PARAMETERS,
        stop: int | None = None,
        tolerance: float | None = None,
    ) -> Motion:
        """Return the decay of parameters p, (d + 1,), with tangents by these and, if `ALL`, by the deviation.

        A decay that is passed through faster is the same decay on another clock, x(t) = X(t + ∫g dt), so that to first
        order ∂x/∂g_k = -rate(x) ∫ b_k dt. Nothing is integrated: `active`, `stop` and `tolerance` have no meaning.
        """
        rates, start = p[:-1], float(p[-1])
        x = self.law.decay(self.t, start, rates)
        speed = np.where(x > RESTED, self.law.rate(x, rates), 0.0)
        slopes = np.empty((x.size, 0))
        if tangents:
            at_start = float(self.law.rate(np.array([start]), rates)[0])
            by_start = speed / at_start if at_start > 0 else np.ones_like(x)  # nothing damps it
            slopes = np.column_stack([self.law.slopes(self.t, x, start, rates, self.step), by_start])
        if tangents == ALL:
            passed = warp_integrals(self.t / self.duration, self.knots) * self.duration
            slopes = np.column_stack([slopes, -speed[:, None] * passed])
        states = np.column_stack([x, -speed])
        if self.white is not None:
            x, slopes = self.white @ x, self.white @ slopes
        return Motion(x, slopes, self.t, states)


def hats(s: np.ndarray, count: int) -> np.ndarray:
    """Piecewise linear basis at s in [0, 1], shape (n, count)."""
    at = np.clip(s, 0.0, 1.0) * (count - 1)
    return np.clip(1.0 - np.abs(at[:, None] - np.arange(count)), 0.0, None)


def warp_integrals(s: np.ndarray, count: int) -> np.ndarray:
    """∫ from 0 to s of the basis, shape (n, count), exactly."""
    at = np.clip(s, 0.0, 1.0) * (count - 1)
    u = at[:, None] - np.arange(count)
    rising = np.clip(u + 1.0, 0.0, 1.0)
    falling = np.clip(u, 0.0, 1.0)
    found = 0.5 * rising**2 + falling - 0.5 * falling**2
    found[:, 0] -= 0.5  # the first hat has no rising half
    return found / (count - 1)
