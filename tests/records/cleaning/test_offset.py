"""The zero of a velocity or acceleration sensor is estimated and subtracted; a record without one is not changed."""

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
    """Return a viscous oscillation of unit amplitude by SciPy; its spring is softer by `bend` on one side."""

    def slope(_, s):
        return [s[1], -2 * 0.25 * s[1] - K * (s[0] + bend * s[0] ** 2)]

    t = T[seconds >= T]
    x, v = solve_ivp(slope, (0, 8), [0.3, 0.0], t_eval=t, rtol=1e-9, atol=1e-12).y
    acceleration = np.array([slope(0, s)[1] for s in zip(x, v)])
    y = {"angle": x, "velocity": v, "acceleration": acceleration}[quantity]
    return y / np.abs(y).max()


def offset(y: np.ndarray, quantity: str) -> float:
    signal = Signal(T[: y.size], y, quantity)
    return sensor_offset(signal, features(signal))


def test_the_zero_is_estimated():
    """Within five standard errors of a mean (false alarm: one in a million) and a thousandth of the amplitude.

    With a spring whose sides differ by a half, four thousandths more: its middle moves while the motion decays.
    """
    for quantity, bend, seconds in product(("velocity", "acceleration"), (0.0, 0.8), (1.2, 8.0)):
        y = motion(quantity, bend, seconds)
        noise = 0.01 * np.random.default_rng(1).standard_normal(y.size)
        allowed = 5 * 0.01 / np.sqrt(y.size) + 1e-3 + 4e-3 * bend
        assert offset(y + noise + 0.4, quantity) == pytest.approx(0.4, abs=allowed), (quantity, bend, seconds)


def test_a_record_without_an_offset_has_none():
    """An offset needs three standard errors: one record in 370 has one by chance, and three of 40 one run in 5,000."""
    for quantity in ("velocity", "acceleration"):
        y, rng = motion(quantity), np.random.default_rng(2)
        assert sum(offset(y + 0.02 * rng.standard_normal(y.size), quantity) != 0 for _ in range(40)) < 3
    assert offset(motion("angle") + 0.4, "angle") == 0.0


def test_a_straight_drift_is_subtracted_with_a_note():
    """Controls: without drift, and with a spring whose middle moves as the motion decays, nothing is subtracted. A
    drift by chance needs more than five standard errors."""
    rng = np.random.default_rng(4)
    for bend, drift in ((0.0, 0.03), (0.0, -0.2), (0.0, 0.0), (0.8, 0.0)):
        y = motion("angle", bend) + drift * T / 8 + 0.003 * rng.standard_normal(T.size)
        signal = clean(RawRecord(T, y), name="x")
        notes = [
            n for n in signal.provenance.notes if n.startswith("A drift of the zero in a straight line, by ")
        ]
        assert signal.provenance.drift == pytest.approx(drift / 8, rel=0.03, abs=0)
        assert np.std(signal.y + signal.provenance.drift * signal.t - y[-signal.t.size :]) < 1e-12
        assert [float(n.split(" by ")[1].split(" %")[0]) for n in notes] == pytest.approx(
            [100 * abs(drift)] * (drift != 0), rel=0.05
        )


def test_cleaning_subtracts_the_zero_with_a_note():
    """Gravity on an accelerometer, ten times the motion."""
    y = motion("acceleration") + 10.0 + 0.005 * np.random.default_rng(3).standard_normal(T.size)
    signal = clean(RawRecord(T, y), name="x", quantity="acceleration")
    assert signal.provenance.offset == pytest.approx(10.0, abs=2e-3)
    assert abs(np.mean(signal.y)) < 0.02
    assert "The sensor's zero, 10 rad/s²" in " ".join(map(str, signal.provenance.notes))
