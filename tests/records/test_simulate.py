"""Simulated records: their times, their faults, and that they hold no truth."""

import json

import numpy as np
import pytest

from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.types import InputError

OSC = Oscillator(("viscous",), "linear")
P = {"zeta": 0.0537, "stiffness": 20.731, "rest_angle": 0.1, "theta0": 0.4, "omega0": 0.0}


def made(seed=0, **options):
    settings = {"duration": 10.0, "samples": 2001, "name": "x", "rng": np.random.default_rng(seed), **options}
    return simulate_signal(OSC, P, **settings)


def test_holds_no_truth():
    text = json.dumps(made(noise_sd=0.0123).provenance.to_dict())
    for number in ("0.0537", "20.731", "0.0123"):
        assert number not in text


def test_noise():
    """Bounds are five standard errors wide: fewer than one seed in a million fails by chance."""
    still = made(samples=20001).y
    white = made(noise_sd=0.1, samples=20001).y - still
    assert white.std() == pytest.approx(0.1, abs=5 * 0.1 / np.sqrt(40000))
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 5 / np.sqrt(20000)
    slow = made(noise_sd=0.1, noise="correlated", noise_time=0.01, samples=20001).y - still
    rho = np.exp(-0.0005 / 0.01)
    assert np.corrcoef(slow[1:], slow[:-1])[0, 1] == pytest.approx(rho, abs=5 * np.sqrt((1 - rho**2) / 20000))
    heavy = made(noise_sd=0.1, noise="student_t", noise_dof=3.0, samples=20001).y - still
    assert np.median(np.abs(heavy)) == pytest.approx(0.1 * 0.7649, rel=0.05)


def test_outliers_gaps_and_quantum():
    still = made().y
    assert np.sum(made(outliers=7).y != still) == 7
    assert np.sum(made(outliers=0.01).y != still) == 20
    assert made(gaps=2).t.size == 2001 - 2 * 40
    assert np.sum(np.diff(made(gaps=2).t) > 0.006) == 2
    assert made(gaps=2).t[-1] == 10.0
    rounded = made(quantum=0.01)
    np.testing.assert_allclose(np.round(rounded.y / 0.01), rounded.y / 0.01, atol=1e-9)
    assert rounded.step == 0.01


@pytest.mark.parametrize(
    ("options", "message"), [({"noise": "pink"}, "unknown noise 'pink'"), ({"gaps": 30}, "gaps")]
)
def test_what_cannot_be_drawn_is_refused(options, message):
    """What else makes no sense is refused by the study's own checks, which all callers go through."""
    with pytest.raises(InputError, match=message):
        made(**options)
