"""The records of the page on light damping."""

import numpy as np
import pytest

from validation.reports import accuracy
from validation.truth.oscillator import Oscillator
from validation.truth.ratio import true_ratio


def test_the_decay_has_the_ratio_and_the_duration_of_its_damping() -> None:
    """Means of 20 readings at both ends give the amplitudes; the decay between them lasts ∫ d ln A / (ω ratio).

    The noise biases the last mean, so the duration is compared to 10 %."""
    for number in range(3):
        case, frequency = accuracy.simulate(1e-5, number)
        oscillator = Oscillator("linear", {"stiffness": frequency**2, "rest_angle": 0.0}, case.parameters)
        (middle,) = case.amplitudes
        first, last = np.mean(case.signal.y[:20]), np.mean(case.signal.y[-20:])
        assert np.sqrt(first * last) == pytest.approx(middle, rel=0.05)
        grid = np.geomspace(last, first, 200)
        ratios = [true_ratio(oscillator, a) for a in grid]
        assert [case.ratio(a) for a in grid] == pytest.approx(ratios, rel=1e-4)
        duration = np.trapezoid(1 / (frequency * np.array(ratios)), np.log(grid))
        assert duration == pytest.approx(case.signal.t[-1] * 580 / 600, rel=0.1)
        assert abs(np.log10(case.ratio(middle) / 1e-5)) < accuracy.SPREAD
