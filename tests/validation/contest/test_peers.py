"""Each peer finds the closed form of a viscous decay; on a quadratic one, one number is not enough."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.types import Refusal
from tests.validation.answering import closed_form
from validation.contest.peers import ROSTER, script, textbook
from validation.truth.drawing import loss_rate

RATIO = 0.02
WITHIN = {
    "logarithmic decrement": 0.02, "Hilbert envelope, one line": 0.01,
    "Hilbert envelope, a line at each amplitude": 0.02, "half-power bandwidth": 0.02,
    "SciPy curve_fit, decaying cosine": 1e-6, "PySINDy": 0.05, "an engineer's script": 1e-3,
}  # fmt: skip
"""Largest relative error."""


def test_the_closed_form():
    for name in WITHIN:
        cycles = (
            60.0 if name == "half-power bandwidth" else 20.0
        )  # what has not died away has a wider spectrum
        record = closed_form(RATIO, noise=1e-4 if name == "PySINDy" else 0.0, cycles=cycles)
        said = ROSTER[name](record.signal.t, record.signal.y, record.amplitudes)
        np.testing.assert_allclose(said.values, RATIO, rtol=WITHIN[name])


def quadratic() -> tuple[np.ndarray, np.ndarray, tuple[float, ...], tuple[float, ...]]:
    """A decay by v|v| alone, solved by SciPy; its ratio is proportional to the amplitude."""
    t, drag, omega = np.arange(0.0, 20.0, 0.02), 0.4, 2 * np.pi
    path = solve_ivp(
        lambda _, s: (s[1], -(omega**2) * s[0] - drag * s[1] * abs(s[1])), (0, 20), (0.5, 0.0), t_eval=t, rtol=1e-9,
    )  # fmt: skip
    amplitudes = (0.4, 0.2, 0.09)
    return t, path.y[0], amplitudes, tuple(drag * loss_rate("quadratic", a, omega) for a in amplitudes)


def test_negative_control_a_quadratic_record_fools_one_number():
    for answer in [textbook.decrement, textbook.half_power, textbook.decaying_cosine]:
        t, y, amplitudes, true = quadratic()
        found = np.array(answer(t, y, amplitudes).values)
        assert np.max(np.abs(found / true - 1)) > 0.4


def test_what_grows_is_refused():
    for name in set(WITHIN) - {"half-power bandwidth"}:  # which knows no sign
        t = np.arange(0.0, 20.0, 0.02)
        with pytest.raises(Refusal):
            ROSTER[name](t, 0.01 * np.exp(0.1 * t) * np.cos(2 * np.pi * t), (0.05, 0.03, 0.02))


def test_the_scripts_motion_is_that_of_the_closed_form_of_friction():
    """On a linear spring friction c takes 2c/k of the amplitude in each half cycle, and holds below c/k."""
    p = np.array([0.0, 0.03, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0])
    found = script.solve(np.pi * np.arange(40.0), p, 0.0)
    turns = np.arange(17)
    np.testing.assert_allclose(found[:17], (-1.0) ** turns * (1 - 0.06 * turns), atol=3e-5)
    np.testing.assert_array_equal(found[19:], found[18])


def test_the_script_names_a_viscous_damping_and_holds_its_ratio():
    record = closed_form(RATIO, noise=0.002, cycles=60.0)
    said = script.answer(record.signal.t, record.signal.y, record.amplitudes)
    assert (said.named, said.decided) == ("viscous", True)
    for low, value, high in zip(said.low, said.values, said.high, strict=True):
        assert low < RATIO < high < 1.02 * value
    noisy = closed_form(RATIO, noise=0.1, cycles=4.0)  # negative control: it cannot be told there
    assert not script.answer(noisy.signal.t, noisy.signal.y, noisy.amplitudes).decided
