"""Whether a record comes back to where it was a period ago, as an oscillation does, or wanders."""

from __future__ import annotations

import numpy as np

NO_NEARER = 0.7
"""Mean square of changes over a period, as a share of those over half of one, from which nothing comes back: 2 of a
random walk, 1 of noise, 0.4 of an oscillation with a damping ratio of 0.3, 2/3 of two equal modes a fifth apart."""
NEAR = 0.05
"""The same share below which it does so without doubt."""
LEAST = 100
"""Steps from which they are asked whether they are independent: of fewer, noise hides that they are not."""
MOST = 20_000
"""Samples, the first ones, of which this is asked."""
USUAL = 0.9
"""Share of the steps that are not cut."""
HOLE = 0.25
"""Share of a time without samples that is a hole in it."""
BY_CHANCE = 1e-3
"""Probability of as much dependence among independent steps."""


def wandering(t: np.ndarray, y: np.ndarray, period: float, noise: float) -> str:
    """Words on what values y (n,) at times t (n,), s, do in place of oscillating with this period in s; empty where
    they do. noise: standard deviation of a sample's."""
    shared = _changes(t, y, period) - 2 * noise**2
    half = _changes(t, y, 0.5 * period) - 2 * noise**2
    if not (np.isfinite(shared) and np.isfinite(half)) or half <= 0:
        return ""
    share = shared / half
    if share > NO_NEARER:
        return "after a period it is no nearer to where it was than after half of one"
    spacing = float(np.median(np.diff(t)))
    if share > NEAR and _independent(t[:MOST], y[:MOST], spacing, round(0.5 * period / spacing)):
        return "it wanders as a random walk does, each step independent of those before"
    return ""


def _changes(t: np.ndarray, y: np.ndarray, lag: float) -> float:
    """Variance of what changes over a time, not into a hole; nan where the record is hardly longer."""
    after = t + lag
    place = np.clip(np.searchsorted(t, after), 1, t.size - 1)
    hole = max(HOLE * lag, 2.5 * float(np.median(np.diff(t))))
    first = (after <= t[-1]) & (t[place] - t[place - 1] < hole)
    change = np.interp(after[first], t, y) - y[first]
    return float(np.var(change)) if change.size > 2 else float("nan")


def _independent(t: np.ndarray, y: np.ndarray, spacing: float, lags: int) -> bool:
    """Whether the steps from sample to sample are white over so many lags (G. M. Ljung and G. E. P. Box, Biometrika 65,
    297, 1978), none of them over a hole, and the largest cut: one jump would hide all others."""
    from scipy.stats import chi2

    usual = np.diff(t) < 1.5 * spacing
    n = int(usual.sum())
    if n < LEAST:
        return False
    steps = np.diff(y)
    most = float(np.quantile(np.abs(steps[usual]), USUAL))
    steps = np.clip(steps, -most, most)
    steps = np.where(usual, steps - steps[usual].mean(), 0.0)
    lags = min(max(lags, 1), n // 4)
    if not np.any(steps):
        return False
    power = np.abs(np.fft.rfft(steps, 2 * steps.size)) ** 2
    shared = np.fft.irfft(power)[: lags + 1]
    k = np.arange(1, lags + 1)
    statistic = n * (n + 2) * float(np.sum((shared[1:] / shared[0]) ** 2 / (n - k)))
    return statistic < float(chi2.isf(BY_CHANCE, lags))
