"""A sensor's zero: found where there is one, and none where there is none."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.records.cleaning.clean import clean, sensor_offset
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.record import RawRecord
from bayesdamp.types import Signal

T = np.linspace(0.0, 8.0, 1600)
K = 200.0


def motion(quantity: str, bend: float = 0.0, seconds: float = 8.0) -> np.ndarray:
    """SciPy's viscous oscillator from 0.3 rad whose spring is `bend` softer to one side; unit amplitude."""

    def slope(_, s):
        return [s[1], -2 * 0.25 * s[1] - K * (s[0] + bend * s[0] ** 2)]

    t = T[seconds >= T]
    x, v = solve_ivp(slope, (0, 8), [0.3, 0.0], t_eval=t, rtol=1e-9, atol=1e-12).y
    found = {"angle": x, "velocity": v, "acceleration": np.array([slope(0, s)[1] for s in zip(x, v)])}[
        quantity
    ]
    return found / np.abs(found).max()


def found(y: np.ndarray, quantity: str) -> float:
    signal = Signal(T[: y.size], y, quantity)
    return sensor_offset(signal, features(signal))


def test_the_zero_is_found():
    """To five standard errors of a mean (1 in a million) and a thousandth of the amplitude; four thousandths of it
    where a spring's sides differ by a half: the middle moves while the motion decays, and that is a velocity."""
    for quantity, bend, seconds in product(("velocity", "acceleration"), (0.0, 0.8), (1.2, 8.0)):
        y = motion(quantity, bend, seconds)
        noise = 0.01 * np.random.default_rng(1).standard_normal(y.size)
        allowed = 5 * 0.01 / np.sqrt(y.size) + 1e-3 + 4e-3 * bend
        zero = found(y + noise + 0.4, quantity)
        assert zero == pytest.approx(0.4, abs=allowed), (quantity, bend, seconds)


def test_no_zero_is_made_up():
    """At three standard errors, of 40 records each: one is expected once in 370, three or more once in 5,000 runs."""
    for quantity in ("velocity", "acceleration"):
        y = motion(quantity)
        rng = np.random.default_rng(2)
        assert sum(found(y + 0.02 * rng.standard_normal(y.size), quantity) != 0 for _ in range(40)) < 3
    assert found(motion("angle") + 0.4, "angle") == 0.0


def test_cleaning_takes_it_off_and_says_so():
    """Gravity on an accelerometer, ten times the motion."""
    y = motion("acceleration") + 10.0 + 0.005 * np.random.default_rng(3).standard_normal(T.size)
    signal = clean(RawRecord(T, y, None, np.arange(T.size)), name="x", quantity="acceleration")
    assert signal.provenance.offset == pytest.approx(10.0, abs=2e-3)
    assert abs(np.mean(signal.y)) < 0.02
    assert "The sensor's zero, 10 rad/s²" in " ".join(map(str, signal.provenance.notes))
