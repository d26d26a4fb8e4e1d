"""The page on light damping: its records, its rows and its counts."""

from __future__ import annotations

import numpy as np
import pytest

from validation.reports import light
from validation.reports.contradictions import true_ratio
from validation.reports.light import Drawn
from validation.truth.motion import solve_motion
from validation.truth.oscillator import Oscillator


def test_the_motion_has_the_ratio_and_the_fall_that_were_drawn() -> None:
    for damping in light.DAMPINGS:
        made = Drawn(damping, 0.003, 0.3 if "+" in damping else 0.0, 0.02, 8.0, 30.0, 0.01)
        oscillator = Oscillator("linear", {"stiffness": 900.0, "rest_angle": 0.0}, made.coefficients)
        for amplitude in (made.middle, made.size, made.size / made.fall):
            assert made.ratio_at(amplitude) == pytest.approx(true_ratio(oscillator, amplitude), rel=1e-4)
        assert made.ratio_at(made.middle) == pytest.approx(made.ratio)
        stop = float(made.decay()[0][-1])
        turns = np.abs(solve_motion(oscillator, made.size, made.frequency, stop).turns)
        assert turns[-1] == pytest.approx(made.size / made.fall, rel=0.03)
