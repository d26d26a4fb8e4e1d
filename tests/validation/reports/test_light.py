"""The page on light damping: its records, its rows and its counts."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.interface.answer import answer
from validation.reports import light
from validation.reports.contradictions import true_ratio
from validation.reports.light import Drawn, log_weights, oscillation, probabilities
from validation.truth.motion import solved
from validation.truth.oscillator import Oscillator


def test_the_motion_has_the_ratio_and_the_fall_that_were_drawn() -> None:
    for damping in light.DAMPINGS:
        made = Drawn(damping, 0.003, 0.3 if "+" in damping else 0.0, 0.02, 8.0, 30.0, 0.01)
        oscillator = Oscillator("linear", {"stiffness": 900.0, "rest_angle": 0.0}, made.coefficients)
        for amplitude in (made.middle, made.size, made.size / made.fall):
            assert made.ratio_at(amplitude) == pytest.approx(true_ratio(oscillator, amplitude), rel=1e-4)
        assert made.ratio_at(made.middle) == pytest.approx(made.ratio)
        stop = float(made.decay()[0][-1])
        turns = np.abs(solved(oscillator, made.size, made.frequency, stop).turns)
        assert turns[-1] == pytest.approx(made.size / made.fall, rel=0.03)


def test_stored_weights_give_the_probabilities_of_the_verdict() -> None:
    made = Drawn("viscous+coulomb", 0.02, 0.2, 0.02, 6.0, 20.0, 0.03)
    signal, _ = oscillation(made, np.random.default_rng(2))
    found = answer(signal, restoring=["linear"], deviation="none", measured=False, sample=False)
    p = probabilities(log_weights(found))
    assert p[found.verdict.damping] == pytest.approx(found.verdict.probability, abs=1e-6)
    for rival in found.verdict.rivals:
        assert p[rival.damping] == pytest.approx(rival.probability, abs=1e-6)
