"""The noise of a decay's readings, whatever its law, and which readings are none of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bayesdamp.inference.deviation.gaussian.hyperparameters import smooth_root
from bayesdamp.inference.envelope.candidates import KNOTS, Blocks, solver_of
from bayesdamp.inference.envelope.noise import SHARES, SLOW, Noise, infer_noise
from bayesdamp.inference.envelope.sums import Sum, loosest_fit
from bayesdamp.physics.amplitude.laws import Law
from bayesdamp.physics.kernel.solve import ALL
from bayesdamp.records.envelope.decay import ABOVE_FLOOR

CHECKED = 0.1
"""Share of the decay at its start that is held against the rest."""
SURPRISE = 4.5
"""Standard deviations at which it is none of the decay (of 5 normal ones, one in 30,000 is)."""


def noises(
    b: Blocks, sums: Sequence[Sum] = ()
) -> tuple[Blocks, list[tuple[Noise, np.ndarray]], np.ndarray, int, int]:
    """The decay as it is at its blocks' times, the noise inferred without and with a deviation, the inverse triangle in
    which fits are sought, how many blocks at the start are none of the decay, and how many stand before it comes too
    close to the floor.

    sums: what may describe it, beside the sum of viscous, Coulomb and quadratic damping.
    """
    n = b.t.size
    seen = np.sqrt(b.floor.power) if b.floor is not None else 1e-3
    rough = np.diag(1.0 / np.maximum(0.02, np.exp(-b.x) * seen))
    law, x0, rates = loosest_fit(b, sums, rough)
    fit = law.decay(b.t, x0, rates)
    b = replace(b, x=b.x - _bend(b, law, x0, rates, fit))
    tangents = solver_of(b, law).solve(np.append(rates, x0), tangents=ALL).tangents
    columns, warp = tangents[:, :-KNOTS], tangents[:, -KNOTS:]
    early = max(1, round(CHECKED * n)) if n >= 30 else 0
    rest = slice(early, n)
    given = (b.t[rest], (b.x - fit)[rest], fit[rest], columns[rest], warp[rest], b.floor)
    slow_time = 1.0 / b.mean_rate
    middle = infer_noise(*given, 0.5, slow_time, b.each)
    rivals = [
        infer_noise(*given, share, slow_time, b.each, begin=middle, only_floor=True) for share in SHARES
    ]
    best = max(rivals, key=lambda one: one.log_density)
    loose = infer_noise(*given, best.slow, slow_time, b.each, with_deviation=True, begin=best)
    rivals += [loose, best.slower(b.duration)]
    covariances = [(one, one.covariance(b.t, fit)) for one in rivals]
    smooth = loose.deviation * warp @ smooth_root(KNOTS, SLOW)
    whole = best.covariance(b.t, fit) + smooth @ smooth.T
    if best.constant > 0:
        one = 0.5 * best.constant * np.exp(-2.0 * fit)
        whole = whole + np.outer(one, one)
    inverse = np.linalg.inv(np.linalg.cholesky(whole))
    low = np.flatnonzero(np.exp(2.0 * fit) < 10.0 ** (ABOVE_FLOOR / 10.0) * best.floor)
    end = int(low[0]) if low.size else n
    return b, covariances, inverse, _strangers(whole, columns, b.x - fit, early), end


def _bend(b: Blocks, law: Law, x0: float, rates: np.ndarray, fit: np.ndarray) -> np.ndarray:
    """By how much the mean of a decay's readings in each block is off the decay at their mean time, to second order."""
    off = np.gradient(b.t) * np.sqrt(max(1.0 - b.each**-2, 0.0) / 12.0)
    before = law.decay(b.t - off, x0, rates)
    return 0.5 * (before + law.decay(b.t + off, x0, rates)) - fit


def _strangers(covariance: np.ndarray, columns: np.ndarray, residual: np.ndarray, early: int) -> int:
    """How many of the early blocks to leave out: up to the last that those after it do not foretell."""
    if early == 0:
        return 0
    # Backwards in time, each reading less what all later ones foretell of it, in its own sd; the law is left free.
    scale = columns / np.linalg.norm(columns, axis=0)
    whole = covariance + 1e2 * scale @ scale.T
    triangle = np.linalg.cholesky(whole[::-1, ::-1])
    innovations = np.linalg.solve(triangle, residual[::-1])[::-1][:early]
    off = np.zeros(early, bool)
    total = np.concatenate(
        [np.cumsum(innovations[::-1])[::-1], [0.0]]
    )  # from each block to the last early one
    for count in (1, 2, 4, 8):
        if count <= early:
            off[: early - count + 1] |= np.abs(
                total[: early - count + 1] - total[count:]
            ) > SURPRISE * np.sqrt(count)
    off = np.flatnonzero(off)
    return int(off[-1]) + 1 if off.size else 0
