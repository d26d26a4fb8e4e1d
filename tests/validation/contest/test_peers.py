"""The script finds the damping ratio of a viscous decay and the motion of dry friction."""

import numpy as np
import pytest

from bayesdamp.types import Refusal, Signal
from tests.validation.answering import closed_form
from validation.contest import script

RATIO = 0.02


def test_the_script_finds_the_ratio_of_the_closed_form():
    record = closed_form(RATIO, cycles=20.0)
    verdict = script.answer(record.signal, record.amplitudes)
    np.testing.assert_allclose([at.value for at in verdict.damping_ratio], RATIO, rtol=1e-3)


def test_a_growing_oscillation_is_refused():
    t = np.arange(0.0, 20.0, 0.02)
    with pytest.raises(Refusal):
        script.answer(Signal(t, 0.01 * np.exp(0.1 * t) * np.cos(2 * np.pi * t)), (0.05, 0.03, 0.02))


def test_the_motion_of_the_script_is_the_closed_form_of_dry_friction():
    """On a linear spring friction c reduces the amplitude by 2c/k in each half cycle, and sticks below c/k."""
    p = np.array([0.0, 0.03, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0])
    motion = script.solve(np.pi * np.arange(40.0), p, 0.0)
    turns = np.arange(17)
    np.testing.assert_allclose(motion[:17], (-1.0) ** turns * (1 - 0.06 * turns), atol=3e-5)
    np.testing.assert_array_equal(motion[19:], motion[18])


def test_the_script_names_viscous_damping_with_an_interval_that_contains_its_ratio():
    """Control: with much noise and few cycles it decides nothing."""
    record = closed_form(RATIO, noise=0.002, cycles=60.0)
    verdict = script.answer(record.signal, record.amplitudes)
    assert (verdict.damping, verdict.decided) == ("viscous", True)
    for at in verdict.damping_ratio:
        assert at.low < RATIO < at.high < 1.02 * at.value
    noisy = closed_form(RATIO, noise=0.1, cycles=4.0)
    assert not script.answer(noisy.signal, noisy.amplitudes).decided
