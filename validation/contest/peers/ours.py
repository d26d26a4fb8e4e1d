"""Define the peer bayesdamp: `compare` without sampling, with its default options."""

from __future__ import annotations

import numpy as np

from bayesdamp.types import Refusal, Signal
from validation.contest.peers.shared import Reply


def answer(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """Return the damping ratios of bayesdamp's verdict at the amplitudes, and the damping if it is named outright.

    If the verdict has no damping ratios, raise a Refusal whose message is the sentence of the verdict.
    """
    import bayesdamp as bd

    verdict = bd.compare(Signal(t - t[0], y, name="record"), amplitudes=amplitudes, sample=False).verdict
    if not verdict.damping_ratio:
        raise Refusal(verdict.sentence)
    value, low, high = zip(*[(r.value, r.low, r.high) for r in verdict.damping_ratio], strict=True)
    return Reply(value, low, high, verdict.damping if verdict.decided else "")
