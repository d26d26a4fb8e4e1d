"""The damping curve without a law, against the energy lost in a cycle by SciPy's quadrature."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad

from bayesdamp.interface.answer import measured_curve
from bayesdamp.records.oscillation.law_free import law_free
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


def lost(kind: str, a: float) -> float:
    """Return the energy lost in a cycle, per unit of inertia."""

    def power(phase: float) -> float:
        x, v = a * math.cos(phase), -a * W * math.sin(phase)
        return FORCES[kind](x, v) * v / W

    return sum(quad(power, i * math.pi / 4, (i + 1) * math.pi / 4)[0] for i in range(8))


@pytest.mark.parametrize("kind", FORCES)
def test_the_band_contains_the_true_curve(kind: str) -> None:
    """At 85 % or more of 40 correlated amplitudes. Control: it does not contain a curve that is a fifth higher."""
    y = decay(lambda _, x, v: FORCES[kind](x, v), TIMES)[0]
    y += SD * np.random.default_rng(4).standard_normal(TIMES.size)
    curve = measured_curve(law_free(Signal(TIMES, y)))
    amplitude, low, high = (curve[f"free/{name}"] for name in ("amplitude", "lost_low", "lost_high"))
    truth = np.array([lost(kind, a) for a in amplitude])
    assert np.mean((low <= truth) & (truth <= high)) > 0.85
    assert np.mean((low <= 1.2 * truth) & (1.2 * truth <= high)) < 0.5  # control
    ratio = truth / (2 * math.pi * (W * amplitude) ** 2)
    assert np.mean((curve["free/ratio_low"] <= ratio) & (ratio <= curve["free/ratio_high"])) > 0.85
    assert np.all(np.diff(amplitude) < 0)
