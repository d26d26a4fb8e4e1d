"""bayesdamp: `compare` without sampling, as it comes."""

from __future__ import annotations

import numpy as np

from bayesdamp.types import Refusal, Signal
from validation.contest.reply import Reply


def answer(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """Raises Refusal with the sentence of an answer that has no ratios."""
    import bayesdamp as bd

    said = bd.compare(Signal(t - t[0], y, name="record"), amplitudes=amplitudes, sample=False).verdict
    if not said.damping_ratio:
        raise Refusal(said.sentence)
    value, low, high = zip(*[(r.value, r.low, r.high) for r in said.damping_ratio], strict=True)
    return Reply(value, low, high, said.damping if said.decided else "")
