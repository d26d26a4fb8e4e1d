"""The damping curve without a law, against the energy lost in a cycle by SciPy's quadrature."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import nnls

from bayesdamp.inference.deviation.findings import Findings, compute_findings
from bayesdamp.inference.deviation.quick import compare_signal
from bayesdamp.types import Signal
from tests.inference.deviation.decays import A, W, decay

SD = 0.0015
TIMES = np.arange(1000) * 2 * math.pi / W / 40
Force = Callable[[float, float], float]
FORCES: dict[str, Force] = {
    "friction and drag": lambda x, v: 0.03 * math.tanh(v / 0.01) + 0.03 * v * abs(v),
    # At 60 % of the first amplitude the loss has a minimum, which no sum of the terms has.
    "a dip": lambda x, v: 0.08 * v * (1 - 0.8 * math.exp(-((math.hypot(x, v / W) / A - 0.6) ** 2) / 0.01)),
}


@lru_cache
def findings_on(kind: str) -> Findings:
    y = decay(lambda _, x, v: FORCES[kind](x, v), TIMES)[0]
    y += SD * np.random.default_rng(4).standard_normal(TIMES.size)
    return compute_findings(compare_signal(Signal(TIMES, y), restoring=["linear"]))


def lost(kind: str, a: float) -> float:
    """Return the energy lost in a cycle, per unit of inertia."""

    def power(phase: float) -> float:
        x, v = a * math.cos(phase), -a * W * math.sin(phase)
        return FORCES[kind](x, v) * v / W

    return sum(quad(power, i * math.pi / 4, (i + 1) * math.pi / 4)[0] for i in range(8))


@pytest.mark.parametrize("kind", FORCES)
def test_the_band_contains_the_true_curve(kind: str) -> None:
    """At 85 % or more of 40 correlated amplitudes. Control: it does not contain a curve that is a fifth higher."""
    free = findings_on(kind).free
    truth = np.array([lost(kind, a) for a in free.amplitude])
    low, high = free.lost[:, 1], free.lost[:, 2]
    assert np.mean((low <= truth) & (truth <= high)) > 0.85
    assert np.mean((low <= 1.2 * truth) & (1.2 * truth <= high)) < 0.5  # control
    ratio = truth / (2 * math.pi * (W * free.amplitude) ** 2)
    assert np.mean((free.ratio[:, 1] <= ratio) & (ratio <= free.ratio[:, 2])) > 0.85
    assert np.all(np.diff(free.amplitude) < 0)


def unexplained_share(kind: str, low: float) -> float:
    """Return the part of the energy lost from A to `low` that the nearest sum of the paper's three terms does not
    explain."""
    a = np.linspace(A, low, 200)
    loss = np.array([lost(kind, each) for each in a])
    columns = np.column_stack([a, a**2, a**3]) / loss[:, None]
    weight = a / a.sum()
    fitted = nnls(np.sqrt(weight)[:, None] * columns, np.sqrt(weight))[0]
    return float(weight @ np.abs(1 - columns @ fitted))


def test_the_share_that_no_law_explains() -> None:
    """It is 0 if a sum of terms is true, and for a dip it is the distance from the nearest sum."""
    share = findings_on("friction and drag").unnamed
    assert share.low < 0.005
    assert share.high < 0.1
    share, truth = (
        findings_on("a dip").unnamed,
        unexplained_share("a dip", findings_on("a dip").amplitudes[1]),
    )
    assert truth > 0.1
    assert share.low < truth < share.high
    assert not share.low < 1.5 * truth < share.high  # control
