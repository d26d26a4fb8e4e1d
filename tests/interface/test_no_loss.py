"""A record that grows, behind so large an offset that it is not told from rounding: answered, not a fault."""

from __future__ import annotations

import numpy as np

import bayesdamp as bd


def test_a_record_that_loses_nothing_is_answered() -> None:
    w = 2 * np.pi * 186.6
    t = np.arange(148) / (37 * 186.6)
    y = 1e-13 * (np.round(np.exp(0.01322 * w * t) * np.cos(w * t) + 1e6, 3))
    found = bd.compare(bd.Signal(t, y, name="grows"), sample=False)
    assert found.verdict.sentence
    found.plot()  # warnings are errors
    assert "–" in str(found) or found.verdict.damping_ratio[0].value > 0
