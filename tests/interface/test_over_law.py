"""Where the damping certainly differs from its law, the answer says at which amplitude and by which factor."""

import numpy as np

from bayesdamp.interface.answer import answer, compare_models
from bayesdamp.types import Signal
from bayesdamp.verdict.types import Verdict

OMEGA = 2 * np.pi * 1.1
FIRST = 0.015


def decay(second: float) -> Signal:
    """Return 20 s of a viscous decay whose damping ratio changes after 10 s, in closed form with noise of 0.3 %."""
    t = np.arange(0, 20, 0.01)
    fall = FIRST * np.minimum(t, 10) + second * np.maximum(t - 10, 0)
    noise = 0.003 * np.random.default_rng(4).standard_normal(t.size)
    return Signal(t, np.exp(-OMEGA * fall) * np.cos(OMEGA * t) + noise)


def test_a_change_of_the_damping_is_stated_with_its_size() -> None:
    """The law's damping is the mean over the energy, of which the later part has 5 %. Control: no change."""
    signals, models = [decay(0.04), decay(FIRST)], {"damping": ["viscous"], "restoring": ["linear"]}
    changed, control = (answer(s, compare_models(s, **models), sample=False).verdict for s in signals)
    assert changed.over_law.low < (0.04 / FIRST) ** 0.95 < changed.over_law.high
    assert changed.over_law.amplitude < np.exp(-OMEGA * FIRST * 10)
    assert " times the law's" in changed.sentence
    assert Verdict.from_dict(changed.to_dict()) == changed
    assert control.over_law is None
    assert "times the law's" not in control.sentence
