"""An envelope and its oscillation have the same damping: both are estimated from the same readings."""

import json

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.cli import main
from bayesdamp.interface.envelopes import analyse
from bayesdamp.records.envelope.record import make_record
from tests.physics.independent import viscous
from tests.records.tables import write_table

OMEGA = 2 * np.pi * 2.0


def motion(zeta: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a viscous decay from 0.3 rad in closed form, with 1 mrad of noise."""
    t = np.arange(0.0, 40.0, 0.01)
    return t, viscous(t, zeta, OMEGA, 0.3) + 1e-3 * np.random.default_rng(seed).standard_normal(t.size)


def lock_in_amplitude(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the amplitude as a lock-in amplifier measures it: means over a period of the product with a reference."""
    period = 50
    means = (y * np.exp(-1j * OMEGA * t)).reshape(-1, period).mean(axis=1)
    return t.reshape(-1, period).mean(axis=1), 2 * np.abs(means)


@pytest.fixture(scope="module")
def motion_fit() -> tuple[float, float]:
    """Return ζ and its standard deviation by a fit of the motion."""
    t, y = motion(0.05, 1)
    fit = bd.fit(bd.Signal(t=t, y=y), bd.Model("viscous", restoring="linear"))
    return fit.values["zeta"], fit.sd["zeta"]


def test_an_envelope_has_the_damping_of_its_oscillation(motion_fit, tmp_path):
    """Within the joint 99.7 % interval. Negative control: a damping that is larger by 3 %."""
    readings = lock_in_amplitude(*motion(0.05, 1))
    file = write_table(tmp_path / "lock_in.csv", "time (s),amplitude (rad)", *readings)
    options = ["--quantity", "envelope", "--frequency", "2", "--out", str(tmp_path / "out")]
    assert main(["compare", str(file), *options]) == 0
    content = json.loads((tmp_path / "out" / "verdict.json").read_text())[0]
    assert content["damping"] == "viscous"
    item = next(c for c in content["coefficients"] if c["name"] == "zeta")
    assert abs(difference(item["value"], np.hypot(item["sd_noise"], item["sd_law"]), motion_fit)) < 3.0
    other = analyse(make_record("x", *lock_in_amplitude(*motion(0.0515, 2)), "rad", 2.0)).verdict
    two = next(c for c in other.coefficients if c.name == "zeta")
    assert abs(difference(two.value, np.hypot(two.sd_noise, two.sd_law), motion_fit)) > 4.0


def difference(value: float, sd: float, other: tuple[float, float]) -> float:
    """Return the difference of two ζ over its standard deviation."""
    return (value - other[0]) / float(np.hypot(sd, other[1]))
