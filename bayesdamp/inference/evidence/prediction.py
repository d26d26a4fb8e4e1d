"""Leave the future out: what the first half of a record says, alone, and of the second half."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.inference.checks.checks import DRAWS
from bayesdamp.inference.checks.forecast import Ahead
from bayesdamp.inference.curves.weighted import resampled
from bayesdamp.inference.evidence.methods.importance import Importance
from bayesdamp.inference.fit.mode import Mode, mode_near
from bayesdamp.types import OK, Evidence, Refusal


@dataclass(frozen=True)
class Prediction:
    """The second half of a record as the first one predicts it.

    start: its first sample's time in s. centre, sd: predictive mean and sd of each of its samples, noise included,
    shape (m,). rms: of the error, expected: root mean predictive variance, both in the unit of the record; coverage:
    share of the samples inside their 95 % interval. evidence: of the first half.
    """

    start: float
    centre: np.ndarray
    sd: np.ndarray
    rms: float
    expected: float
    coverage: float
    evidence: Evidence


def first_half(mode: Mode) -> Mode:
    """Return the mode on the first half of the samples, where laws hold exactly. Raises Refusal where there is none."""
    target = mode.likelihood.target
    part = slice(0, target.signal.t.size // 2)
    if part.stop <= len(target.names):
        raise Refusal(f"half the record has {part.stop} samples for {len(target.names)} parameters")
    return mode_near(mode.likelihood.of(part), mode, mode.z)


def predict(
    model: str, half: Mode, carry: Callable[[np.ndarray], Ahead], t: np.ndarray, y: np.ndarray, seed: int
) -> Prediction:
    """Importance evidence on the first half of a record, and its draws carried on over the second.

    Parameters
    ----------
    half : Mode
        Of the density on the first half.
    carry : callable
        Draws of the scores, (m, d), to what they say of the second half. Raises Refusal where no draw goes on.
    t, y : ndarray, shape (n,)
        The whole record.

    Raises
    ------
    Refusal
        Where the first half has no posterior, or no draw goes on.
    """
    found = Importance().evidence(model, half.likelihood.target, half, seed)
    rng = np.random.default_rng(seed)
    ahead = carry(found.arrays["y"][resampled(found.arrays["log_weights"], DRAWS, rng)])
    later = y.size - ahead.error.size
    return Prediction(
        start=float(t[later]),
        centre=y[later:] - ahead.error,
        sd=ahead.sd,
        rms=ahead.rms,
        expected=ahead.expected,
        coverage=ahead.coverage,
        evidence=replace(found, arrays={}),
    )


def log_predictive(whole: Evidence, half: Evidence) -> tuple[float, float]:
    """Log density of the second half given the first, and its standard error: a difference of log evidences."""
    if not whole.outcome == half.outcome == OK:
        return float("nan"), float("nan")
    return whole.log_evidence - half.log_evidence, float(np.hypot(whole.stderr, half.stderr))
