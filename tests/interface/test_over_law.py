"""Where the damping is surely not its law's, the answer says at which amplitude and how many times that it is."""

from __future__ import annotations

import numpy as np

from bayesdamp.interface.answer import answer
from bayesdamp.types import Signal
from bayesdamp.verdict.types import Verdict

OMEGA = 2 * np.pi * 1.1
FIRST = 0.015


def decay(second: float) -> Signal:
    """20 s of a viscous decay whose damping ratio is another after 10 s; in closed form, with noise of 0.3 %."""
    t = np.arange(0, 20, 0.01)
    fall = FIRST * np.minimum(t, 10) + second * np.maximum(t - 10, 0)
    noise = 0.003 * np.random.default_rng(4).standard_normal(t.size)
    return Signal(t, np.exp(-OMEGA * fall) * np.cos(OMEGA * t) + noise)


def verdict_on(second: float) -> Verdict:
    return answer(decay(second), damping=["viscous"], restoring=["linear"], sample=False).verdict


def test_a_damping_that_is_another_late_is_said_with_its_size() -> None:
    """The law's own is the mean over the energy, of which the later part has 5 %."""
    found = verdict_on(0.04)
    expected = (0.04 / FIRST) ** 0.95
    assert found.over_law.low < expected < found.over_law.high
    assert found.over_law.amplitude < np.exp(-OMEGA * FIRST * 10)
    assert " times the law's" in found.sentence
    assert Verdict.from_dict(found.to_dict()) == found


def test_a_damping_that_is_one_throughout_has_none() -> None:
    found = verdict_on(FIRST)
    assert found.over_law is None
    assert "times the law's" not in found.sentence
