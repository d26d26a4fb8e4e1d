"""Leave the future out: what the first half of a record says, alone, and of the second half."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bayesdamp.inference.checks.checks import DRAWS
from bayesdamp.inference.checks.forecast import Ahead
from bayesdamp.inference.curves.weighted import resampled
from bayesdamp.inference.evidence.methods.importance import Importance
from bayesdamp.inference.fit.mode import Mode, mode_near
from bayesdamp.types import OK, Evidence, Refusal


def first_half(mode: Mode) -> Mode:
    """Return the mode on the first half of the samples, where laws hold exactly. Raises Refusal where there is none."""
    target = mode.likelihood.target
    part = slice(0, target.signal.t.size // 2)
    if part.stop <= len(target.names):
        raise Refusal(f"half the record has {part.stop} samples for {len(target.names)} parameters")
    return mode_near(mode.likelihood.of(part), mode, mode.z)


def predict(
    model: str, half: Mode, carry: Callable[[np.ndarray], Ahead], seed: int
) -> tuple[Evidence, Ahead]:
    """Importance evidence on the first half of a record, and its draws carried on over the second.

    Parameters
    ----------
    half : Mode
        Of the density on the first half.
    carry : callable
        Draws of the scores, (m, d), to what they say of the second half. Raises Refusal where no draw goes on.

    Raises
    ------
    Refusal
        Where the first half has no posterior, or no draw goes on.
    """
    found = Importance().evidence(model, half.likelihood.target, half, seed)
    rows = resampled(found.arrays["log_weights"], DRAWS, np.random.default_rng(seed))
    return replace(found, arrays={}), carry(found.arrays["y"][rows])


def log_predictive(whole: Evidence, half: Evidence) -> tuple[float, float]:
    """Log density of the second half given the first, and its standard error: a difference of log evidences."""
    if not whole.outcome == half.outcome == OK:
        return float("nan"), float("nan")
    return whole.log_evidence - half.log_evidence, float(np.hypot(whole.stderr, half.stderr))
